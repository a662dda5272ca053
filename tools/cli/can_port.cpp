#include "tools/cli/can_port.hpp"

#include <poll.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <utility>

#include "hal/linux/monotonic_clock.hpp"

namespace wheelwright::tools {
namespace {

volatile std::sig_atomic_t g_interrupted = 0;

void on_signal(int) { g_interrupted = 1; }

constexpr std::int64_t kPoll_ns = 500'000;
constexpr std::int64_t kLongestPoll_ns = 100'000'000;
constexpr std::int64_t kDownPause_ns = 50'000'000;
constexpr std::int64_t kSendPatience_ns = 50'000'000;

}  // namespace

std::unique_ptr<hal::SocketCanBus> open_can(const std::string& interface, int& exit_status) {
    auto opened = hal::SocketCanBus::open(interface);
    if (opened) return std::move(opened.value());
    std::fprintf(stderr, "wheelwright: %s\n", opened.error().message.c_str());
    exit_status = opened.error().exit_status();
    return nullptr;
}

std::int64_t can_now_ns() { return hal::MonotonicClock().now_ns(); }

std::int64_t wall_clock_offset_ns() { return hal::realtime_offset_ns(); }

std::string send_frame(hal::CanBus& bus, const hal::CanFrame& frame) {
    const std::int64_t patience_ns = can_now_ns() + kSendPatience_ns;
    for (;;) {
        switch (bus.send(frame)) {
            case hal::CanStatus::ok:
                return "";
            case hal::CanStatus::would_block:
                if (can_now_ns() > patience_ns) {
                    return "the transmit queue stays full: nobody on the bus acknowledges";
                }
                sleep_until(can_now_ns() + kPoll_ns);
                break;
            case hal::CanStatus::invalid:
                return "the interface does not take this frame";
            case hal::CanStatus::bus_down:
                return "the interface is down or gone";
        }
    }
}

bool receive_until(hal::SocketCanBus& bus, hal::ReceivedFrame& out, std::int64_t deadline_ns) {
    while (!interrupted()) {
        const hal::CanStatus status = bus.receive(out);
        if (status == hal::CanStatus::ok) return true;
        const std::int64_t left_ns = deadline_ns - can_now_ns();
        if (left_ns <= 0) return false;
        if (status == hal::CanStatus::bus_down) {
            // poll() would return at once, again and again
            sleep_until(can_now_ns() + std::min(left_ns, kDownPause_ns));
            continue;
        }
        const std::int64_t wait_ns = std::min(left_ns, kLongestPoll_ns);
        const timespec wait{0, static_cast<long>(wait_ns)};
        pollfd ready{bus.descriptor(), POLLIN, 0};
        ::ppoll(&ready, 1, &wait, nullptr);
    }
    return false;
}

void catch_interrupt() {
    struct sigaction action {};
    action.sa_handler = on_signal;
    ::sigaction(SIGINT, &action, nullptr);
    ::sigaction(SIGTERM, &action, nullptr);
}

bool interrupted() { return g_interrupted != 0; }
void forget_interrupt() { g_interrupted = 0; }

void sleep_until(std::int64_t deadline_ns) {
    timespec until{};
    until.tv_sec = deadline_ns / 1'000'000'000;
    until.tv_nsec = static_cast<long>(deadline_ns % 1'000'000'000);
    while (!interrupted() && ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
    }
}

}  // namespace wheelwright::tools
