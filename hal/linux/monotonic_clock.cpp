#include "hal/linux/monotonic_clock.hpp"

#include <cerrno>
#include <ctime>

namespace wheelwright::hal {

namespace {
constexpr std::int64_t ns_per_s = 1'000'000'000;
}

std::int64_t MonotonicClock::now_ns() const {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return std::int64_t{now.tv_sec} * ns_per_s + now.tv_nsec;
}

void MonotonicClock::sleep_until_ns(std::int64_t deadline_ns) {
    if (deadline_ns <= 0) {
        return;  // before the clock's origin
    }
    timespec deadline{};
    deadline.tv_sec = static_cast<time_t>(deadline_ns / ns_per_s);
    deadline.tv_nsec = static_cast<long>(deadline_ns % ns_per_s);
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, nullptr) == EINTR) {
    }
}

}  // namespace wheelwright::hal
