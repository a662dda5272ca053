// What the firmware asks of time. Implementations: hal/linux (CLOCK_MONOTONIC), sim_hal (virtual).
#pragma once

#include <cstdint>

namespace wheelwright::hal {

class Clock {
  public:
    virtual ~Clock() = default;

    // Monotonic time since an arbitrary origin, in nanoseconds.
    virtual std::int64_t now_ns() const = 0;

    // Returns no earlier than `deadline_ns` on the same time base; at once when that has passed.
    virtual void sleep_until_ns(std::int64_t deadline_ns) = 0;
};

}  // namespace wheelwright::hal
