// hog MILLISECONDS: keeps the processor from every other program for so long, at the highest real-time
// priority.
#include <sched.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>

namespace {

std::int64_t now_ns() {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

}  // namespace

int main(int argc, char** argv) {
    const std::int64_t wanted_ns = argc > 1 ? std::strtol(argv[1], nullptr, 10) * std::int64_t{1'000'000} : 0;
    sched_param highest{};
    highest.sched_priority = sched_get_priority_max(SCHED_FIFO);
    if (wanted_ns <= 0 || sched_setscheduler(0, SCHED_FIFO, &highest) != 0) {
        std::perror("hog");
        return 1;
    }
    const std::int64_t end_ns = now_ns() + wanted_ns;
    while (now_ns() < end_ns) {
    }
    return 0;
}
