// What a black box records of each cycle, and how that lies in memory: bytes one behind the other, times as
// what they differ by from what is expected, so that half a minute takes 2.3 MB. A tape is written by the
// cycle's thread, without a bound: whoever gives it memory leaves room for a cycle at its worst.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "firmware/task/cycle.hpp"

namespace wheelwright::task {

enum class RecordKind : std::uint8_t {
    cycle,       // it begins; what follows happened in it, in this order
    received,    // a frame
    sent,        // a frame
    refused,     // a frame: the bus did not take it
    waits,       // a frame with this identifier was said to wait still
    statistics,  // they have changed
    end,         // of the cycle
};

struct BoxStatistics {
    std::uint64_t receive_overflow = 0, error_frames = 0, bus_off = 0;
    bool operator==(const BoxStatistics&) const = default;
};

// What a cycle is told that is neither a frame nor time.
struct CycleInputs {
    hal::LineLevel stop_line = hal::LineLevel::inactive;
    bool enable_written = true;
    std::array<bool, 2> bus_down{};
    bool terminate = false;
    SaveMailbox::Answers save;
};

// What it has decided.
struct CycleState {
    protocol::Mode mode{}, requested{};
    supervisor::Phase phase{};
    supervisor::Owner owner{};
    protocol::Fault fault{};
    protocol::Blocker blocker{};

    static CycleState of(const supervisor::Supervisor& s) {
        return {s.mode(), s.requested(), s.phase(), s.owner(), s.fault(), s.blocker()};
    }
    bool operator==(const CycleState&) const = default;
};

struct CycleRecord {
    CycleTime time;
    std::int64_t sending_ns = 0;
    CycleInputs inputs;
    CycleState state;
};

struct BoxFrame {
    RecordKind kind{};
    std::uint8_t bus = 0;         // 0: the drives', 1: the host's own
    hal::ReceivedFrame received;  // sent and refused ones: without a time
};

struct BoxCycle {
    CycleRecord told;
    std::vector<BoxFrame> frames;           // received, sent, refused, waits; in order
    std::vector<BoxStatistics> statistics;  // as they changed
};

// Writes a tape. Each begins with start().
class TapeWriter {
  public:
    void start(std::byte* at) {
        *this = {};
        next_ = at;
    }
    std::byte* position() const { return next_; }

    void cycle(const CycleTime& time);
    void frame(RecordKind kind, std::uint8_t bus, const hal::CanFrame& frame, std::int64_t time_ns);
    void waits(std::uint8_t bus, std::uint32_t id);
    void statistics(const BoxStatistics& now);
    void end(const CycleRecord& record);

  private:
    friend class TapeReader;
    // On the tape where they change.
    static_assert(std::has_unique_object_representations_v<CycleState> &&
                  std::is_trivially_copyable_v<CycleInputs> && sizeof(CycleInputs) == 8 &&
                  sizeof(CycleState) == 6);
    // All of a frame that is before its data.
    static constexpr std::size_t kHead_bytes = offsetof(hal::CanFrame, data);
    static_assert(std::is_trivially_copyable_v<hal::CanFrame>);

    void put(std::uint64_t bytes, std::size_t count);

    std::byte* next_ = nullptr;
    std::int64_t scheduled_ns_ = 0;
    std::uint64_t inputs_ = 0, state_ = UINT64_MAX;  // the first is another
};

// Reads it, cycle by cycle.
class TapeReader {
  public:
    explicit TapeReader(std::span<const std::byte> tape) : rest_(tape) {}
    // False: that was all.
    bool next(BoxCycle& cycle);

  private:
    std::uint64_t number(std::size_t count);
    std::int64_t time(bool is_brief);
    void bytes(void* to, std::size_t count);

    std::span<const std::byte> rest_;
    std::int64_t scheduled_ns_ = 0;
    CycleInputs inputs_;
    CycleState state_;
};

}  // namespace wheelwright::task
