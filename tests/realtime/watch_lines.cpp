// watch_lines: says when a digital line of the emulated machine changes, whoever drives or holds it: from the
// registers of its PL061, beside the kernel's driver (iomem=relaxed). A change is printed with the time of
// the last look that did not see it and of the first one that did, and all eight levels:
//     1767225601.123456 1767225601.123457 06
// It takes all the time that nobody else wants: between two looks lies less than a microsecond, or another
// program.
#include <fcntl.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <ctime>

namespace {

constexpr off_t kPl061 = 0x0903'0000;     // of QEMU's `virt`
constexpr std::size_t kAllLines = 0x3FC;  // GPIODATA, masked by its address

timespec now() {
    timespec time{};
    clock_gettime(CLOCK_REALTIME, &time);
    return time;
}

void print(const timespec& time) {
    std::printf("%lld.%06ld ", static_cast<long long>(time.tv_sec), time.tv_nsec / 1000);
}

}  // namespace

int main() {
    const int memory = open("/dev/mem", O_RDONLY | O_SYNC | O_CLOEXEC);
    void* registers = mmap(nullptr, 4096, PROT_READ, MAP_SHARED, memory, kPl061);
    sched_param highest{};
    highest.sched_priority = sched_get_priority_max(SCHED_FIFO);
    if (registers == MAP_FAILED || sched_setscheduler(0, SCHED_FIFO, &highest) != 0) {
        std::perror("watch_lines");
        return 1;
    }
    const volatile auto* lines = reinterpret_cast<std::uint32_t*>(static_cast<char*>(registers) + kAllLines);
    std::uint32_t last = ~0U;
    timespec before = now();
    for (;;) {
        const timespec start = now();
        const std::uint32_t levels = *lines;
        if (levels != last) {
            print(before);
            print(now());
            std::printf("%02X\n", levels);
            std::fflush(stdout);
            last = levels;
        }
        before = start;
        const timespec pause{0, 100'000};
        nanosleep(&pause, nullptr);
    }
}
