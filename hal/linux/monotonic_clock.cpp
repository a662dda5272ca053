#include "hal/linux/monotonic_clock.hpp"

#include <cerrno>
#include <ctime>

namespace wheelwright::hal {

namespace {
constexpr std::int64_t ns_per_s = 1'000'000'000;

std::int64_t read_ns(clockid_t clock) {
    timespec now{};
    clock_gettime(clock, &now);
    return std::int64_t{now.tv_sec} * ns_per_s + now.tv_nsec;
}
}  // namespace

std::int64_t MonotonicClock::now_ns() const { return read_ns(CLOCK_MONOTONIC); }

std::int64_t realtime_offset_ns() {
    constexpr int kReadings = 8;
    std::int64_t quickest_ns = INT64_MAX;
    std::int64_t offset_ns = 0;
    for (int i = 0; i < kReadings; ++i) {
        const std::int64_t before_ns = read_ns(CLOCK_MONOTONIC);
        const std::int64_t realtime_ns = read_ns(CLOCK_REALTIME);
        const std::int64_t took_ns = read_ns(CLOCK_MONOTONIC) - before_ns;
        if (took_ns >= quickest_ns) continue;
        quickest_ns = took_ns;
        offset_ns = realtime_ns - before_ns - took_ns / 2;
    }
    return offset_ns;
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
