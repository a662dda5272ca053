// The contract's rig over sim::InProcessBus.
#pragma once

#include <cstddef>
#include <cstdint>

#include "sim_hal/in_process_bus.hpp"
#include "sim_hal/virtual_clock.hpp"

namespace wheelwright {

class InProcessRig {
  public:
    explicit InProcessRig(const sim::InProcessBusOptions& options = {})
        : options_(options), bus_(clock_, 3, options) {}

    sim::InProcessBus::Endpoint& bus(int index) { return bus_.endpoint(static_cast<std::size_t>(index)); }
    std::int64_t now_ns() const { return clock_.now_ns(); }
    bool carries_fd() const { return options_.fd; }
    std::size_t flood_frames() const { return options_.receive_capacity + 20; }
    bool limit_transmit_queue() { return true; }
    void set_down(bool down) { bus_.set_down(0, down); }
    void make_error_frame(std::uint32_t error_class) { bus_.inject_error_frame(error_class); }
    void set_bus_off(bool off) {
        if (off) {
            bus_.set_bus_off(0);
        } else {
            bus_.recover(0);
        }
    }

    void settle() {
        for (std::int64_t next_ns = bus_.next_event_ns(); next_ns != sim::InProcessBus::never_ns;
             next_ns = bus_.next_event_ns()) {
            clock_.advance_to(next_ns);
        }
        clock_.advance_to(clock_.now_ns() + options_.receive_latency_ns + options_.receive_jitter_ns);
    }

    sim::VirtualClock& clock() { return clock_; }
    sim::InProcessBus& wire() { return bus_; }

  private:
    sim::InProcessBusOptions options_;
    sim::VirtualClock clock_{1'000'000'000};
    sim::InProcessBus bus_;
};

}  // namespace wheelwright
