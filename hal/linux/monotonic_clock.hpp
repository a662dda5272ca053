// CLOCK_MONOTONIC.
#pragma once

#include <cstdint>

#include "hal/clock.hpp"

namespace wheelwright::hal {

// Threads: any. No call allocates or throws.
class MonotonicClock final : public Clock {
  public:
    std::int64_t now_ns() const override;

    // Sleeps to an absolute time, so that a late wake-up does not shift the ones after it. Signals do not
    // shorten the sleep: who handles SIGTERM sees its flag at the next cycle.
    void sleep_until_ns(std::int64_t deadline_ns) override;
};

// CLOCK_REALTIME - CLOCK_MONOTONIC now. As good as the quickest of some readings: to be held up between the
// two clocks spoils one, not all. Threads: any; does not allocate or throw.
std::int64_t realtime_offset_ns();

}  // namespace wheelwright::hal
