// SocketCAN on a real kernel: run where vcan0 and vcan1 exist (toolchain/uml/with-vcan).
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/socket.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <memory>
#include <string>

#include "hal/linux/monotonic_clock.hpp"
#include "hal/linux/socketcan_bus.hpp"
#include "tests/contract/can_bus_contract.hpp"

using namespace wheelwright;

namespace {

bool contains(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

void shell(const std::string& command) {
    if (std::system(command.c_str()) != 0) {
        FAIL(("this failed: " + command).c_str());
    }
}

std::unique_ptr<hal::SocketCanBus> open_bus(const char* interface = "vcan0") {
    hal::SocketCanOptions options;
    options.receive_buffer_bytes = 1 << 18;
    auto bus = hal::SocketCanBus::open(interface, options);
    if (!bus) {
        FAIL(bus.error().message.c_str());
    }
    return std::move(bus.value());
}

// Sends what SocketCanBus refuses to: error frames, as a controller's driver reports them.
class ErrorSource {
  public:
    ErrorSource() : socket_(::socket(PF_CAN, SOCK_RAW, CAN_RAW)) {
        sockaddr_can address{};
        address.can_family = AF_CAN;
        address.can_ifindex = static_cast<int>(if_nametoindex("vcan0"));
        CHECK(bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
    }
    ~ErrorSource() { close(socket_); }
    ErrorSource(const ErrorSource&) = delete;
    ErrorSource& operator=(const ErrorSource&) = delete;

    std::uint64_t reported() const { return reported_; }

    void report(std::uint32_t error_class) {
        ++reported_;
        can_frame frame{};
        frame.can_id = CAN_ERR_FLAG | error_class;
        frame.can_dlc = 8;
        CHECK(write(socket_, &frame, sizeof frame) == ssize_t{sizeof frame});
    }

  private:
    int socket_;
    std::uint64_t reported_ = 0;
};

// Waits for a frame: vcan delivers in a soft interrupt, which a busy machine may put off until after send().
hal::CanStatus receive_soon(hal::CanBus& bus, hal::ReceivedFrame& out) {
    hal::MonotonicClock clock;
    const std::int64_t limit_ns = clock.now_ns() + 5'000'000'000;
    hal::CanStatus status = bus.receive(out);
    while (status == hal::CanStatus::would_block && clock.now_ns() < limit_ns) {
        clock.sleep_until_ns(clock.now_ns() + 1'000'000);
        status = bus.receive(out);
    }
    return status;
}

class SocketCanRig {
  public:
    SocketCanRig() : witness_(open_bus()), buses_{open_bus(), open_bus(), open_bus()} {}
    ~SocketCanRig() {
        if (limited_) {
            shell("tc qdisc del dev vcan0 root");
        }
    }
    SocketCanRig(const SocketCanRig&) = delete;
    SocketCanRig& operator=(const SocketCanRig&) = delete;

    hal::CanBus& bus(int index) { return *buses_[static_cast<std::size_t>(index)]; }
    std::int64_t now_ns() const { return clock_.now_ns(); }
    bool carries_fd() const { return buses_[0]->carries_fd(); }
    std::size_t flood_frames() const { return 2000; }

    // vcan itself has no queue; a rate limit gives it one of twenty frames, 1000 of which pass in a second.
    bool limit_transmit_queue() {
        shell("tc qdisc add dev vcan0 root tbf rate 128kbit burst 64b limit 320b");
        limited_ = true;
        return true;
    }
    void set_down(bool down) { shell(down ? "ip link set vcan0 down" : "ip link set vcan0 up"); }
    void make_error_frame(std::uint32_t error_class) { errors_.report(error_class); }
    void set_bus_off(bool off) { errors_.report(off ? 0x40 : 0x100); }

    // The witness, who has been there longest and so is served last, must have seen all that was sent.
    void settle() {
        std::uint64_t sent = errors_.reported();
        for (const auto& bus : buses_) {
            sent += bus->statistics().frames_sent;
        }
        hal::ReceivedFrame received;
        while (witnessed_ < sent) {
            const hal::CanStatus status = receive_soon(*witness_, received);
            if (status == hal::CanStatus::would_block) {
                FAIL("a frame that was sent has not arrived within five seconds");
            }
            witnessed_ += status == hal::CanStatus::ok ? 1 : 0;
        }
        // vcan hands a frame to its listeners when it is queued, so seeing it does not mean that it has left.
        if (limited_) {
            shell(
                "timeout 5 sh -c 'until tc -s qdisc show dev vcan0 | grep -q \"backlog 0b 0p\"; do sleep "
                "0.01; done'");
        }
    }

  private:
    mutable hal::MonotonicClock clock_;
    std::unique_ptr<hal::SocketCanBus> witness_;
    std::uint64_t witnessed_ = 0;
    std::array<std::unique_ptr<hal::SocketCanBus>, 3> buses_;
    ErrorSource errors_;
    bool limited_ = false;
};

bool in_user_mode_linux() {
    std::ifstream info("/proc/cpuinfo");
    std::string line;
    while (std::getline(info, line)) {
        if (contains(line, "User Mode Linux")) {
            return true;
        }
    }
    return false;
}

}  // namespace

TEST_GROUP(SocketCanContract){};
#define ON_SOCKETCAN(name)          \
    TEST(SocketCanContract, name) { \
        SocketCanRig rig;           \
        contract::name(rig);        \
    }
WHEELWRIGHT_CAN_BUS_CONTRACT(ON_SOCKETCAN)

TEST_GROUP(SocketCan){};

TEST(SocketCan, each_reason_not_to_open_is_named_with_its_remedy) {
    const auto missing = hal::SocketCanBus::open("nocan7");
    CHECK(!missing);
    LONGS_EQUAL(4, missing.error().exit_status());
    CHECK(contains(missing.error().message, "no interface nocan7"));
    CHECK(contains(missing.error().message, "ip link"));

    const auto loopback = hal::SocketCanBus::open("lo");
    CHECK(!loopback);
    LONGS_EQUAL(1, loopback.error().exit_status());
    CHECK(contains(loopback.error().message, "not a CAN interface"));

    shell("ip link set vcan1 down");
    const auto down = hal::SocketCanBus::open("vcan1");
    shell("ip link set vcan1 up");
    CHECK(!down);
    LONGS_EQUAL(4, down.error().exit_status());
    CHECK(contains(down.error().message, "vcan1 is down"));
    CHECK(contains(down.error().message, "ip link set vcan1 up"));
    CHECK(hal::SocketCanBus::open("vcan1").has_value());
}

TEST(SocketCan, interfaces_do_not_hear_each_other) {
    const auto one = open_bus("vcan0");
    const auto other = open_bus("vcan1");
    const auto neighbour = open_bus("vcan0");
    CHECK(one->send(contract::make_frame(0x1, 1)) == hal::CanStatus::ok);
    hal::ReceivedFrame received;
    CHECK(receive_soon(*neighbour, received) == hal::CanStatus::ok);
    LONGS_EQUAL(0, contract::drain(*other));
}

TEST(SocketCan, an_interface_that_is_removed_is_down_for_good) {
    shell("ip link add dev vcan9 type vcan && ip link set vcan9 up");
    const auto bus = open_bus("vcan9");
    CHECK(bus->send(contract::make_frame(0x1, 1)) == hal::CanStatus::ok);
    CHECK_FALSE(bus->gone());
    shell("ip link del vcan9");
    hal::ReceivedFrame received;
    CHECK(receive_soon(*bus, received) == hal::CanStatus::bus_down);
    CHECK(bus->send(contract::make_frame(0x1, 1)) == hal::CanStatus::bus_down);
    CHECK(bus->receive(received) == hal::CanStatus::bus_down);
    CHECK_TRUE(bus->gone());
}

TEST(SocketCan, cansend_and_candump_understand_us) {
    const auto bus = open_bus();
    shell("cansend vcan0 123#0102030405060708 && cansend vcan0 12345678#R && cansend vcan0 001#");
    hal::ReceivedFrame received;
    CHECK(receive_soon(*bus, received) == hal::CanStatus::ok);
    LONGS_EQUAL(0x123, received.frame.id);
    LONGS_EQUAL(8, received.frame.length);
    for (std::size_t i = 0; i < 8; ++i) {
        LONGS_EQUAL(i + 1, received.frame.data[i]);
    }
    CHECK(receive_soon(*bus, received) == hal::CanStatus::ok);
    LONGS_EQUAL(0x12345678, received.frame.id);
    CHECK(received.frame.extended);
    CHECK(received.frame.remote);
    CHECK(receive_soon(*bus, received) == hal::CanStatus::ok);
    LONGS_EQUAL(1, received.frame.id);
    LONGS_EQUAL(0, received.frame.length);

    std::FILE* dump = popen("candump -L -n 1 -T 5000 vcan0,7A5:7FF", "r");
    hal::MonotonicClock clock;
    hal::CanFrame frame = contract::make_frame(0x7A5, 3);
    frame.data = {0xDE, 0xAD, 0x01};
    // candump starts when it starts: repeat until it has seen one.
    for (int i = 0; i < 20; ++i) {
        CHECK(bus->send(frame) == hal::CanStatus::ok);
        clock.sleep_until_ns(clock.now_ns() + 50'000'000);
    }
    std::array<char, 200> line{};
    CHECK(std::fgets(line.data(), static_cast<int>(line.size()), dump) != nullptr);
    pclose(dump);
    CHECK(contains(line.data(), "vcan0 7A5#DEAD01"));
}

TEST(SocketCan, a_stamp_is_the_kernels_and_not_the_time_of_reading) {
    const auto sender = open_bus();
    const auto receiver = open_bus();
    hal::MonotonicClock clock;
    hal::ReceivedFrame received;
    const std::int64_t before_ns = clock.now_ns();
    CHECK(sender->send(contract::make_frame(0x1, 1)) == hal::CanStatus::ok);
    const std::int64_t after_ns = clock.now_ns();
    clock.sleep_until_ns(after_ns + 50'000'000);
    CHECK(receive_soon(*receiver, received) == hal::CanStatus::ok);
    CHECK(received.timestamp_ns >= before_ns);
    CHECK(received.timestamp_ns <= after_ns + 10'000'000);
}

// Somebody (a time server) sets the wall clock while frames wait: monotonic stamps must not follow it.
TEST(SocketCan, setting_the_wall_clock_does_not_move_the_stamps) {
    if (!in_user_mode_linux()) {
        std::printf("not tried: it would set this machine's clock\n");
        return;
    }
    const auto sender = open_bus();
    const auto receiver = open_bus();
    hal::MonotonicClock clock;
    for (const int step_s : {100, -100, 3}) {
        hal::ReceivedFrame received;
        const std::int64_t before_ns = clock.now_ns();
        CHECK(sender->send(contract::make_frame(0x1, 1)) == hal::CanStatus::ok);
        const std::int64_t after_ns = clock.now_ns();
        clock.sleep_until_ns(after_ns + 20'000'000);
        timespec wall{};
        clock_gettime(CLOCK_REALTIME, &wall);
        wall.tv_sec += step_s;
        CHECK(clock_settime(CLOCK_REALTIME, &wall) == 0);
        CHECK(receive_soon(*receiver, received) == hal::CanStatus::ok);
        std::printf("step %d s: stamped %.3f ms after sending began\n", step_s,
                    static_cast<double>(received.timestamp_ns - before_ns) / 1e6);
        CHECK(received.timestamp_ns >= before_ns);
        CHECK(received.timestamp_ns <= after_ns + 10'000'000);
    }
}
