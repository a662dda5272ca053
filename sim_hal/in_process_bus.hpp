// A CAN bus made of software: one wire, a few endpoints, each endpoint a hal::CanBus.
//
// What it models: the time each frame takes on the wire, one frame at a time; arbitration by identifier among
// the frames that wait when the wire becomes free; finite transmit and receive queues; a receive latency with
// jitter between the wire and the receiver (interrupts and kernel of a real machine); faults on purpose.
// What it does not model: acknowledgement, propagation delay, clock tolerance, error-passive nodes.
//
// Time is the Clock's. The bus looks at it in each call and first does everything that has happened on the
// wire since; so it needs no stepping, but whoever wants to act at the moment a frame arrives asks
// next_event_ns(). Frames queued at the same instant take part in the same arbitration, whatever the order of
// the calls. An endpoint sends its own frames in the order of the send() calls, as one SocketCAN queue does.
// Of equal identifiers the lower endpoint wins (a real bus would fail there: two nodes must not own one
// identifier).
//
// Everything random comes from the seed: equal options and equal calls give equal bytes and times.
// Memory: all of it is taken in the constructor. Threads: one. No call after the constructor allocates,
// blocks or throws. Cost: about 450 instructions for a classic frame from send() to receive() with two
// endpoints, the polls around it included.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "hal/can_bus.hpp"
#include "hal/clock.hpp"
#include "sim_hal/random.hpp"

namespace wheelwright::sim {

enum class Stuffing : std::uint8_t {
    worst_case,   // the most stuff bits the frame's length can have: what a load calculation assumes
    random_data,  // as many as random bits have on average, one in 30
};

struct InProcessBusOptions {
    std::uint32_t bit_rate = 1'000'000;       // arbitration phase; 10'000 .. 1'000'000
    std::uint32_t data_bit_rate = 5'000'000;  // data phase of FD frames with bit-rate switch
    bool fd = false;                          // accepts FD frames; a classic bus refuses them as invalid
    Stuffing stuffing = Stuffing::worst_case;
    std::size_t transmit_capacity = 16;   // frames per endpoint, the one on the wire included
    std::size_t receive_capacity = 256;   // frames per endpoint
    std::int64_t receive_latency_ns = 0;  // end of the frame to receive(), and up to
    std::int64_t receive_jitter_ns = 0;   // this much more, uniform; frames never overtake each other
    std::uint64_t seed = 1;
};

enum class FaultAction : std::uint8_t {
    drop,     // nobody receives it, and the sender does not know
    corrupt,  // one payload bit arrives flipped and no checksum of the bus noticed; empty frames pass
    destroy,  // an error on the wire: every node sees an error frame, the sender repeats its frame at once
};

// Applies to the frames on the wire with (id & mask) == (this->id & mask), classic or extended.
struct FaultRule {
    FaultAction action = FaultAction::drop;
    std::uint32_t id = 0;
    std::uint32_t mask = 0;                                           // 0: every frame
    std::uint32_t skip = 0;                                           // matching frames that pass first
    std::uint32_t count = std::numeric_limits<std::uint32_t>::max();  // then so many are candidates
    double probability = 1;                                           // with which a candidate is hit
};

// What the tap sees. Times are of the wire, without receive latency.
struct WireEvent {
    const hal::CanFrame* frame = nullptr;  // valid during the call
    std::int64_t start_ns = 0;
    std::int64_t end_ns = 0;  // the receivers' timestamp
    std::size_t sender = 0;   // endpoint; of no meaning for error frames
    bool dropped = false;     // by a fault: no receiver gets it
};

// Is told of each frame at the moment it ends on the wire, in wire order: a logger, or a test's witness. It
// must not call the bus.
class BusTap {
  public:
    virtual ~BusTap() = default;
    virtual void on_frame(const WireEvent& event) = 0;
};

// Monotonic counters of the wire.
struct WireTotals {
    std::uint64_t frames = 0;  // that reached their end, dropped and corrupted ones included
    std::uint64_t dropped = 0;
    std::uint64_t corrupted = 0;
    std::uint64_t destroyed = 0;
    std::int64_t busy_ns = 0;  // wire time taken, interframe spaces included: load = busy / elapsed
};

class InProcessBus {
  public:
    static constexpr std::size_t max_endpoints = 6;
    static constexpr std::size_t max_filters = 32;  // per endpoint
    static constexpr std::size_t max_faults = 8;
    static constexpr std::size_t max_taps = 4;
    static constexpr std::int64_t max_jitter_ns = 1'000'000'000;
    static constexpr std::int64_t never_ns = std::numeric_limits<std::int64_t>::max();

    // Error classes it reports, with the values of linux/can/error.h.
    static constexpr std::uint32_t error_protocol = 0x008;
    static constexpr std::uint32_t error_bus_off = 0x040;
    static constexpr std::uint32_t error_bus = 0x080;
    static constexpr std::uint32_t error_restarted = 0x100;

    class Endpoint final : public hal::CanBus {
      public:
        hal::CanStatus send(const hal::CanFrame& frame) override;
        bool waits(std::uint32_t id) const override;
        hal::CanStatus receive(hal::ReceivedFrame& out) override;
        bool set_filters(std::span<const hal::CanFilter> filters) override;
        hal::CanStatistics statistics() const override;

        // When receive() will give (or gave up waiting for) the oldest frame queued here; never_ns when none
        // is on its way. Counts only frames that have ended on the wire.
        std::int64_t next_receive_ns() const;

      private:
        friend class InProcessBus;
        struct Waiting {
            hal::ReceivedFrame received;
            std::int64_t available_ns = 0;
        };

        bool accepts(const hal::CanFrame& frame) const;  // by the filters that are set
        void offer(const hal::CanFrame& frame, std::int64_t timestamp_ns);
        void drop_transmit_queue();

        InProcessBus* bus_ = nullptr;
        std::uint32_t bit_ = 0;  // this endpoint in the bus's sets
        bool down_ = false;
        bool bus_off_ = false;
        bool accept_all_ = true;
        std::uint32_t transmit_errors_ = 0;
        std::int64_t latency_ns_ = 0;
        std::int64_t jitter_ns_ = 0;
        // Rings of a power of two; `..._capacity_` may be less.
        std::vector<hal::CanFrame> transmit_;
        std::size_t transmit_first_ = 0;
        std::size_t transmit_count_ = 0;
        std::size_t transmit_limit_ = 0;
        std::vector<Waiting> receive_;
        std::size_t receive_first_ = 0;
        std::size_t receive_count_ = 0;
        std::array<std::uint64_t, 2048 / 64> accepted_standard_{};
        std::array<hal::CanFilter, max_filters> extended_filters_{};
        std::size_t extended_filter_count_ = 0;
        hal::CanStatistics statistics_;
    };

    // 1 <= endpoint_count <= max_endpoints, and capacities at least 1; values outside are brought inside.
    // `clock` must outlive the bus.
    InProcessBus(const hal::Clock& clock, std::size_t endpoint_count,
                 const InProcessBusOptions& options = {});
    InProcessBus(const InProcessBus&) = delete;
    InProcessBus& operator=(const InProcessBus&) = delete;

    std::size_t endpoint_count() const { return endpoint_count_; }
    // index < endpoint_count(), here and below. The endpoint lives as long as the bus.
    Endpoint& endpoint(std::size_t index) { return endpoints_[index]; }

    // Does what has happened on the wire up to the clock's time. Every other call does it first; a tap that
    // wants the last frames of a run needs it at the end.
    void catch_up() {
        const std::int64_t now_ns = clock_->now_ns();
        if (now_ns > now_ns_) {
            run_to(now_ns);
        }
    }

    // When the frame that is on the wire, or would win the wire if nobody else sent, ends; never_ns when
    // nothing waits. Later than the clock's time after catch_up(). To move the clock there, then let the
    // receivers look, is to see each frame at its moment (add next_receive_ns() where a latency is set).
    std::int64_t next_event_ns();

    // Not after the moment at which receive() of this endpoint (of this bus) may next give something, as the
    // queues stand now; never_ns when it gives nothing until somebody sends. Later than the clock's time. The
    // frames that the endpoint sends itself are passed over, which makes this cheaper to follow than
    // next_event_ns().
    std::int64_t next_arrival_ns(const Endpoint& endpoint);

    // Wire time of a frame from its start to its last end-of-frame bit; the wire is then kept free for three
    // more bits.
    std::int64_t wire_time_ns(const hal::CanFrame& frame) const;

    // Not owned. False: there are max_taps already.
    bool add_tap(BusTap& tap);

    const WireTotals& totals() const { return totals_; }

    // --- faults on purpose --------------------------------------------------------------------------------

    // Rules are tried in the order they were added and the first that hits decides. False: max_faults exist.
    bool add_fault(const FaultRule& rule);
    void clear_faults();

    // Takes an endpoint's interface down: what it had queued is lost, it receives nothing, and both send()
    // and (once its waiting frames are taken) receive() say bus_down. The others do not notice.
    void set_down(std::size_t endpoint, bool down);

    // The same through the controller's error counter; also happens by itself after 32 destroyed frames in a
    // row. The endpoint receives an error frame with error_bus_off, and error_restarted on recovery.
    void set_bus_off(std::size_t endpoint);
    void recover(std::size_t endpoint);

    // Every endpoint that is up receives an error frame of this class now.
    void inject_error_frame(std::uint32_t error_class);

    // How many frames the endpoint's queue takes from now on, up to the bus's transmit_capacity.
    void limit_transmit_queue(std::size_t endpoint, std::size_t frames);

    // Changes the endpoint's latency from now on.
    void set_receive_latency(std::size_t endpoint, std::int64_t latency_ns, std::int64_t jitter_ns);

  private:
    enum class Fate : std::uint8_t { pass, drop, corrupt, destroy };
    struct Fault {
        FaultRule rule;
        std::uint32_t seen = 0;
    };

    void run_to(std::int64_t now_ns);
    std::size_t winner() const;
    void plan();
    void begin();
    void finish();
    [[gnu::noinline]] void destroy(Endpoint& from);
    [[gnu::noinline]] void corrupt(hal::CanFrame& frame);
    [[gnu::noinline]] void tell_taps(const WireEvent& event);
    Fate decide_fate(const hal::CanFrame& frame);
    void deliver_error(std::uint32_t receivers, std::uint32_t error_class, std::int64_t time_ns);
    void leave_bus(Endpoint& endpoint, std::int64_t time_ns);

    const hal::Clock* clock_;
    std::int64_t now_ns_;
    std::int64_t free_ns_;         // the wire can be taken from here on
    std::int64_t request_ns_ = 0;  // when the first of the waiting frames was queued
    std::int64_t start_ns_ = 0;    // of the frame on the wire, or planned
    std::int64_t end_ns_ = 0;
    bool on_wire_ = false;
    bool planned_ = false;  // sender_, start_ns_ and end_ns_ are of the next frame as the queues stand
    Fate fate_ = Fate::pass;
    std::size_t sender_ = 0;
    std::uint32_t waiting_ = 0;  // set of endpoints with frames to send
    std::uint32_t active_ = 0;   // set of endpoints that take part: up, and not bus-off
    std::uint32_t deaf_ = 0;     // set of endpoints whose filters accept nothing
    std::array<std::uint32_t, max_endpoints> head_key_{};  // arbitration field of each first frame

    std::size_t endpoint_count_;
    std::size_t transmit_capacity_;
    std::size_t receive_capacity_;
    std::size_t transmit_mask_;  // size of the rings, less one
    std::size_t receive_mask_;
    bool fd_;
    Stuffing stuffing_;
    std::uint32_t bit_rate_;
    std::uint32_t data_bit_rate_;
    std::int64_t interframe_ns_;
    std::int64_t error_frame_ns_;
    std::array<std::array<std::int64_t, 9>, 2> classic_ns_{};  // [extended][length]

    Random random_;
    std::array<Fault, max_faults> faults_{};
    std::size_t fault_count_ = 0;
    std::array<BusTap*, max_taps> taps_{};
    std::size_t tap_count_ = 0;
    WireTotals totals_;
    std::array<Endpoint, max_endpoints> endpoints_;
};

}  // namespace wheelwright::sim
