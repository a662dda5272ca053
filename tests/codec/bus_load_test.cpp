// References: the tables of published worst cases for classic CAN (n data bytes: 55 + 10 n and 80 + 10 n
// bits), and the bus shares of common drives at 1 kHz with two wheels.
#include "firmware/protocol/bus_load.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <vector>

#include "drivers/odrive/odrive_0_6_messages.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"

#include <CppUTest/TestHarness.h>

namespace protocol = wheelwright::protocol;
namespace odrive = wheelwright::drivers::odrive_0_6;
using protocol::PeriodicFrame;
using protocol::worst_case_bits;

TEST_GROUP(BusLoad){};

TEST(BusLoad, worst_case_bits_of_classic_frames) {
    for (int n = 0; n <= 8; ++n) {
        LONGS_EQUAL(55 + 10 * n, worst_case_bits(n, false));
        LONGS_EQUAL(80 + 10 * n, worst_case_bits(n, true));
    }
}

TEST(BusLoad, shares_of_common_drives_at_1_kHz) {
    struct Case {
        const char* name;
        std::vector<PeriodicFrame> frames;
        double percent_at_1M;
    };
    const PeriodicFrame byte8{"8", 8, false, 1e-3};
    const PeriodicFrame byte6{"6", 6, false, 1e-3};
    const PeriodicFrame byte4{"4", 4, false, 1e-3};
    const PeriodicFrame byte0{"0", 0, false, 1e-3};
    const PeriodicFrame extended4{"x4", 4, true, 1e-3};
    const PeriodicFrame extended8{"x8", 8, true, 1e-3};
    const std::vector<Case> cases{
        {"C620: 1 command, 2 feedback", {byte8, byte8, byte8}, 40.5},
        {"MIT: 2 commands, 2 replies of 6", {byte8, byte8, byte6, byte6}, 50.0},
        {"ODrive: 2 torque, 2 encoder", {byte8, byte8, byte8, byte8}, 54.0},
        {"ODrive: and 2 currents", {byte8, byte8, byte8, byte8, byte8, byte8}, 81.0},
        {"CiA 402: SYNC, 2 RPDO(4), 2 TPDO(8)", {byte0, byte4, byte4, byte8, byte8}, 51.5},
        {"VESC: 2 current, 2 STATUS", {extended4, extended4, extended8, extended8}, 56.0},
    };
    for (const Case& c : cases) {
        DOUBLES_EQUAL(c.percent_at_1M, 100 * load_fraction(c.frames, 1e6), 1e-9);
        DOUBLES_EQUAL(2 * c.percent_at_1M, 100 * load_fraction(c.frames, 5e5), 1e-9);
    }
}

TEST(BusLoad, fd_frames_take_about_what_is_published) {
    // Two moteus wheels, 48-byte commands and 24-byte replies at 1 and 5 Mbit/s: about 0.50 ms.
    const double time_s =
        2 * (protocol::fd_frame_time_s(48, true, 1e6, 5e6) + protocol::fd_frame_time_s(24, true, 1e6, 5e6));
    std::printf("moteus, two wheels: %.3f ms (published: about 0.50 ms)\n", time_s * 1e3);
    DOUBLES_EQUAL(0.50e-3, time_s, 0.05e-3);
    // Without switching to a faster rate it cannot be much quicker than the bits of its data.
    CHECK(protocol::fd_frame_time_s(64, false, 1e6, 1e6) > 512e-6);
}

TEST(BusLoad, event_frames_take_no_part) {
    const PeriodicFrame event = protocol::periodic_frame(protocol::all_messages[0]);
    STRCMP_EQUAL("EmergencyStop", event.name.data());
    DOUBLES_EQUAL(0.0, load_fraction(event, 1e6), 0.0);
}

TEST(BusLoad, of_the_protocol_leaves_room_on_a_shared_bus) {
    double telemetry = 0;
    double commands = 0;
    for (const protocol::MessageInfo& message : protocol::all_messages) {
        (message.sender == "Firmware" ? telemetry : commands) +=
            load_fraction(protocol::periodic_frame(message), 1e6);
    }
    const PeriodicFrame torque{"torque", odrive::SetInputTorque::length, false, 1e-3};
    const PeriodicFrame encoder{"encoder", odrive::GetEncoderEstimates::length, false, 1e-3};
    const double drives = 2 * (load_fraction(torque, 1e6) + load_fraction(encoder, 1e6));
    std::printf(
        "at 1 Mbit/s: telemetry %.1f %%, all cyclic commands at once %.1f %%, two drives at 1 kHz %.1f %%\n",
        100 * telemetry, 100 * commands, 100 * drives);
    CHECK(telemetry + commands + drives < 0.80);
}
