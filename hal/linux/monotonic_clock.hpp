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

}  // namespace wheelwright::hal
