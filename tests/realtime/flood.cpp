// flood INTERFACE COUNT PID: sends COUNT frames of 8 bytes to INTERFACE at once, while the interrupt thread
// PID, which takes them off the sender's controller, has priority over the one that takes them off the
// receiver's (50): its controller overflows.
#include <linux/can.h>
#include <net/if.h>
#include <sched.h>
#include <sys/socket.h>

#include <cstdio>
#include <cstdlib>
#include <ctime>

namespace {
constexpr long kOnTheWire_ns = 3'000'000;  // until they have left, and still below safety.stale_feedback_s
}

int main(int argc, char** argv) {
    if (argc != 4) return 1;
    sched_param sender{};
    sched_param interrupt{};
    sched_param usual{};
    sender.sched_priority = 60;
    interrupt.sched_priority = 70;
    usual.sched_priority = 50;
    const pid_t thread = std::atoi(argv[3]);
    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = static_cast<int>(if_nametoindex(argv[1]));
    const int bus = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    if (bind(bus, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 ||
        sched_setscheduler(thread, SCHED_FIFO, &interrupt) != 0 ||
        sched_setscheduler(0, SCHED_FIFO, &sender) != 0) {
        std::perror("flood");
        return 1;
    }
    can_frame frame{};
    frame.can_id = 0x7FE;  // nobody's
    frame.can_dlc = 8;
    int sent = 0;
    for (const int count = std::atoi(argv[2]); sent < count && send(bus, &frame, sizeof frame, 0) > 0;)
        ++sent;
    timespec end{};
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &end);
    do clock_gettime(CLOCK_MONOTONIC, &now);
    while (now.tv_nsec - end.tv_nsec + 1'000'000'000 * (now.tv_sec - end.tv_sec) < kOnTheWire_ns);
    sched_setscheduler(thread, SCHED_FIFO, &usual);
    std::printf("%d frames sent\n", sent);
    return 0;
}
