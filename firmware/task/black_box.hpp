// The black box: the last half minute of what the cycles were told and what they sent, in memory. Stands
// between the cycle and its ports and writes down what passes; the frame that a cycle sees is the one that is
// recorded. A fault hands a whole record to somebody who has time to write it to a disk
// (black_box_writer.hpp).
//
// A record can be replayed because a cycle is a function of (memory, inputs). The inputs are here, and the
// memory is copied now and then by the writer while the loop sleeps: the cycle only counts up a sequence
// number before and after itself, and a copy during which it has moved is thrown away (a seqlock). So the
// loop copies no state, and waits for nobody.
//
// A record is a ring of segments of kSegmentCycles, each with a copy of the memory from its beginning; the
// oldest is given up for a new one. A record that is handed over keeps its segments until they are written;
// the next one begins in those that are free, one at least, and gets the others back one by one. Where frames
// come so densely that a segment is full before, the record is shorter.
//
// Threads: begin(), sending(), end() and the ports are the cycle's. snapshot(), record(), release() and
// lost_faults() are the writer's. All memory is taken by watch().
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <type_traits>

#include "firmware/task/black_box_tape.hpp"
#include "firmware/task/cycle.hpp"

namespace wheelwright::task {

inline constexpr double kBlackBoxWindow_s = 30;

class BlackBox {
  public:
    static constexpr std::uint64_t kSegmentCycles = 3000;
    static constexpr std::size_t kRecordSegments = 11;  // the window, and one that is being filled
    static constexpr std::size_t kSegments = kRecordSegments + 1;
    static_assert((kRecordSegments - 1) * kSegmentCycles * kCyclePeriod_s >= kBlackBoxWindow_s);
    // Two drives at 1 kHz, host and telemetry make 207 kB of it.
    static constexpr std::size_t kSegment_bytes = 240'000;
    // What a fault has led to is recorded too.
    static constexpr std::uint64_t kCyclesAfterFault = 1000;

    // `real` are the ports of machine or simulation.
    BlackBox(const CyclePorts& real, SaveMailbox& mailbox);
    ~BlackBox();
    BlackBox(const BlackBox&) = delete;
    BlackBox& operator=(const BlackBox&) = delete;

    // For the cycle's constructor; then watch() it. All of them outlive the recording.
    CyclePorts ports();
    void watch(Cycle& cycle);  // takes 3.5 MB, and copies the cycle's memory for the first time

    // The cycle's thread. Around think(), and around send().
    void begin(const CycleTime& time);
    void sending(std::int64_t now_ns) { record_.sending_ns = now_ns; }
    void end();

    // ---- for whoever writes

    // Copies the memory where the newest segment has no copy yet. False: a cycle came between, try again.
    bool snapshot();

    struct Segment {
        std::unique_ptr<std::byte[]> records;
        std::size_t used_bytes = 0;
        std::uint64_t first_cycle = 0;  // its number, from 1 on
        // Cycle::memory() and the statistics last recorded, one behind the other, after a cycle. The
        // writer's; until it has made a copy they are of what the segment held before.
        std::unique_ptr<std::byte[]> memory;
        std::uint64_t memory_cycle = kNever;
        std::atomic<bool> handed{false};  // to the writer, who gives it back

        std::span<const std::byte> tape() const { return {records.get(), used_bytes}; }

        bool has_memory() const { return memory_cycle != kNever && memory_cycle + 1 >= first_cycle; }
        static constexpr std::uint64_t kNever = UINT64_MAX;
    };
    struct Record {
        std::array<Segment*, kRecordSegments> segments{};  // in order of time
        std::size_t segment_count = 0;
        protocol::Fault fault{};
        std::uint64_t fault_cycle = 0;
        std::uint32_t further_faults = 0;  // behind the first, in the same record
    };
    // A record to be written, or nullptr. release_segment() gives one's memory back, in their order,
    // release() that of all.
    const Record* record() const { return handed_.load(std::memory_order_acquire) ? &written_ : nullptr; }
    void release_segment(std::size_t i) {
        written_.segments[i]->handed.store(false, std::memory_order_release);
    }
    void release() {
        for (std::size_t i = 0; i < written_.segment_count; ++i) release_segment(i);
        handed_.store(false, std::memory_order_release);
    }
    // Faults so far that are in no record, as an earlier one took too long to write.
    std::uint32_t lost_faults() const { return lost_faults_.load(std::memory_order_relaxed); }
    // After the last cycle: a fault that waits for what follows it, or for the writer, waits no longer.
    void flush();

    std::size_t memory_bytes() const { return memory_bytes_; }

  private:
    template <std::uint8_t kNumber>
    class Bus final : public hal::CanBus {
      public:
        Bus(BlackBox& box, hal::CanBus& real) : box_(box), real_(real) {}
        hal::CanStatus send(const hal::CanFrame& frame) override;
        bool waits(std::uint32_t id) const override;
        hal::CanStatus receive(hal::ReceivedFrame& out) override;
        bool set_filters(std::span<const hal::CanFilter> filters) override {
            return real_.set_filters(filters);
        }
        hal::CanStatistics statistics() const override;

      private:
        BlackBox& box_;
        hal::CanBus& real_;
    };
    class StopLine final : public hal::DigitalInput {
      public:
        StopLine(BlackBox& box, hal::DigitalInput& real) : box_(box), real_(real) {}
        hal::LineLevel read() override;

      private:
        BlackBox& box_;
        hal::DigitalInput& real_;
    };
    class EnableLine final : public hal::DigitalOutput {
      public:
        EnableLine(BlackBox& box, hal::DigitalOutput& real) : box_(box), real_(real) {}
        bool write(bool active) override;

      private:
        BlackBox& box_;
        hal::DigitalOutput& real_;
    };

    void begin_segment();
    void close_segment();
    std::size_t free_segment() const;
    void note_fault();
    void hand_over();

    Bus<0> drive_bus_;
    std::optional<Bus<1>> host_bus_;
    std::optional<StopLine> stop_line_;
    std::optional<EnableLine> enable_line_;
    CyclePorts real_;
    SaveMailbox& mailbox_;
    Cycle* cycle_ = nullptr;
    std::size_t memory_bytes_ = 0;

    std::array<Segment, kSegments> segments_;
    std::array<std::size_t, kRecordSegments> order_{};  // of the record that runs, in order of time
    std::size_t count_ = 0;
    TapeWriter tape_;
    const std::byte* full_ = nullptr;  // where a segment has no room for another cycle at its worst
    std::uint64_t number_ = 0;         // of the cycle
    CycleRecord record_;               // of the cycle that runs
    bool runs_ = false;
    BoxStatistics statistics_;  // last recorded

    protocol::Fault fault_{};
    std::uint64_t fault_cycle_ = 0;  // of one that waits to be handed over; 0: none does
    protocol::Fault waiting_fault_{};
    std::uint32_t further_faults_ = 0;

    std::atomic<std::uint64_t> sequence_{0};  // twice the cycle's number, and one less while it runs
    std::atomic<std::uint64_t> newest_{0};    // segment, as a count of segments and its place
    std::uint64_t copied_ = 0;                // the writer's: the newest that has its copy
    std::atomic<bool> handed_{false};
    Record written_;
    std::atomic<std::uint32_t> lost_faults_{0};
};

// A cycle in a loop (run_cycles()), with its box.
class RecordedCycle {
  public:
    RecordedCycle(Cycle& cycle, BlackBox& box) : cycle_(cycle), box_(box) {}
    void think(const CycleTime& time) {
        box_.begin(time);
        cycle_.think(time);
    }
    void send(std::int64_t now_ns) {
        box_.sending(now_ns);
        cycle_.send(now_ns);
        box_.end();
    }
    std::int64_t send_phase_ns() const { return cycle_.send_phase_ns(); }
    void request_termination() { cycle_.request_termination(); }
    bool finished() const { return cycle_.finished(); }

  private:
    Cycle& cycle_;
    BlackBox& box_;
};

}  // namespace wheelwright::task
