// The ODrive driver against frames written by hand from the CANSimple description: id = node << 5 | command,
// little endian, floats IEEE 754. Node 3 everywhere, so 0x07 (Set_Axis_State) is 0x067 and so on.
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <initializer_list>
#include <limits>

#include "drivers/drive_catalogue.hpp"
#include "drivers/odrive/odrive_drive.hpp"
#include "firmware/model/robot_parameters.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::drivers;

namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr std::int64_t kMs = 1'000'000;

struct Recorder final : FrameSink {
    void push(const hal::CanFrame& frame) override {
        if (count < frames.size()) frames[count++] = frame;
    }
    std::array<hal::CanFrame, 256> frames;
    std::size_t count = 0;
};

hal::CanFrame frame(std::uint32_t id, std::initializer_list<int> bytes) {
    hal::CanFrame f;
    f.id = id;
    f.length = static_cast<std::uint8_t>(bytes.size());
    std::size_t i = 0;
    for (const int byte : bytes) f.data[i++] = static_cast<std::uint8_t>(byte);
    return f;
}

OdriveConfig config(OdriveGeneration generation) {
    OdriveConfig c;
    c.generation = generation;
    c.node = 3;
    c.sign = -1;
    c.gear_ratio = 6.25;
    c.torque_constant_Nm_per_A = 0.0625;
    c.heartbeat_timeout_s = 0.35;
    c.arming_timeout_s = 2;
    c.watchdog_assured = true;
    return c;
}

// A driver with a clock of its own, and the frames it has sent.
struct Bench {
    explicit Bench(const OdriveConfig& c) : drive(c), older(c.generation == OdriveGeneration::v0_5) {}

    void cycle() {
        now += kMs;
        drive.update(now, sent);
    }
    void cycles(int n) {
        for (int i = 0; i < n; ++i) cycle();
    }
    bool receive(std::uint32_t id, std::initializer_list<int> bytes) {
        return drive.accept({frame(id, bytes), now + 1000});
    }
    void heartbeat(int state, int error_byte_1 = 0) {
        receive(0x061, {0, error_byte_1, 0, 0, state, 0, 0, 0});
    }

    void encoder(float turns, float turns_per_s) {
        hal::CanFrame f = frame(0x069, {0, 0, 0, 0, 0, 0, 0, 0});
        std::memcpy(f.data.data(), &turns, 4);
        std::memcpy(f.data.data() + 4, &turns_per_s, 4);
        drive.accept({f, now + 1000});
    }

    // Arms without looking: an idle drive that obeys.
    void arm() {
        heartbeat(1);
        cycle();
        drive.request_arm();
        if (older) {  // waits for a heartbeat that is younger than the request, and for its time-out
            cycles(200);
            heartbeat(1);
            cycles(150);
        }
        cycles(6);
        heartbeat(8);
        cycle();
        CHECK(drive.state() == DriveState::armed);
        sent.count = 0;
    }

    void check_sent(std::initializer_list<hal::CanFrame> expected) {
        CHECK_EQUAL(expected.size(), sent.count);
        std::size_t i = 0;
        for (const hal::CanFrame& want : expected) {
            const hal::CanFrame& have = sent.frames[i++];
            CHECK_EQUAL(want.id, have.id);
            CHECK_EQUAL(want.length, have.length);
            CHECK(!have.remote && !have.extended && !have.fd);
            MEMCMP_EQUAL(want.data.data(), have.data.data(), want.length);
        }
        sent.count = 0;
    }

    OdriveDrive drive;
    bool older;
    Recorder sent;
    std::int64_t now = 1000 * kMs;
};

const std::initializer_list<int> kZero8{0, 0, 0, 0, 0, 0, 0, 0};

}  // namespace

TEST_GROUP(OdriveArming){};

TEST(OdriveArming, generation_0_5_sends_the_documented_order_one_step_in_a_cycle) {
    Bench b(config(OdriveGeneration::v0_5));
    b.heartbeat(1);
    b.cycle();
    CHECK(b.drive.state() == DriveState::idle);
    b.drive.request_arm();
    b.check_sent({});
    // Feeds its watchdog until heartbeats have told what is wrong now, here and on the board's other axis.
    b.cycles(200);
    b.heartbeat(1, 0x08);  // it had expired
    b.cycles(151);
    for (std::size_t i = 0; i < b.sent.count; ++i) CHECK_EQUAL(0x06EU, b.sent.frames[i].id);
    b.sent.count = 0;
    CHECK(b.drive.state() == DriveState::arming);
    b.cycle();
    b.check_sent({frame(0x078, {}), frame(0x06E, kZero8)});
    b.cycle();
    b.check_sent({frame(0x06B, {1, 0, 0, 0, 1, 0, 0, 0})});
    b.cycle();
    b.check_sent({frame(0x06E, kZero8)});
    b.cycle();  // it cannot be read back: once more
    b.check_sent({frame(0x06B, {1, 0, 0, 0, 1, 0, 0, 0}), frame(0x06E, kZero8)});
    b.cycle();
    b.check_sent({frame(0x067, {8, 0, 0, 0}), frame(0x06E, kZero8)});
    b.cycles(3);
    b.check_sent({frame(0x06E, kZero8), frame(0x06E, kZero8), frame(0x06E, kZero8)});
    b.heartbeat(8);
    CHECK(b.drive.state() == DriveState::armed);
    b.cycle();
    b.check_sent({});
    CHECK(b.drive.refusal() == ArmRefusal::none);
}

TEST(OdriveArming, generation_0_6_reads_the_watchdog_before_closed_loop) {
    OdriveConfig c = config(OdriveGeneration::v0_6);
    c.watchdog_assured = false;
    c.watchdog_endpoint = 0x0123;
    Bench b(c);
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    b.cycles(2);
    b.check_sent({frame(0x06B, {1, 0, 0, 0, 1, 0, 0, 0}), frame(0x06E, kZero8)});
    b.cycle();
    b.check_sent({frame(0x064, {0, 0x23, 0x01, 0, 0, 0, 0, 0}), frame(0x06E, kZero8)});
    b.cycles(5);
    for (std::size_t i = 0; i < b.sent.count; ++i) CHECK_EQUAL(0x06EU, b.sent.frames[i].id);
    b.sent.count = 0;
    // The answer to another question does not count.
    b.receive(0x065, {0, 0x24, 0x01, 0, 1});
    b.cycle();
    b.check_sent({frame(0x06E, kZero8)});
    b.receive(0x065, {0, 0x23, 0x01, 0, 1});
    b.cycle();
    b.check_sent({frame(0x06B, {1, 0, 0, 0, 1, 0, 0, 0}), frame(0x06E, kZero8)});
    b.cycle();
    b.check_sent({frame(0x067, {8, 0, 0, 0}), frame(0x06E, kZero8)});
    b.heartbeat(8);
    CHECK(b.drive.state() == DriveState::armed);
}

// What has an endpoint is read back: watchdog on, its time-out (0.05 s), the modes. 100, 101 .. are the
// endpoints.
TEST(OdriveArming, generation_0_6_reads_back_all_that_has_an_endpoint) {
    struct Case {
        int wrong;  // which answer is wrong, 4: none
        std::initializer_list<int> says;
        ArmRefusal refusal;
    };
    for (const Case& one :
         {Case{4, {}, ArmRefusal::none}, Case{0, {0, 0, 0, 0}, ArmRefusal::watchdog_not_confirmed},
          Case{1, {0, 0, 0x80, 0x3F}, ArmRefusal::watchdog_not_confirmed},        // 1 s
          Case{1, {0x9A, 0x99, 0x59, 0x3D}, ArmRefusal::watchdog_not_confirmed},  // 0.0531 s
          Case{1, {0xE1, 0xCC, 0x4C, 0x3D}, ArmRefusal::watchdog_not_confirmed},  // 0.0500001 s
          Case{1, {0, 0, 0, 0}, ArmRefusal::watchdog_not_confirmed},              // 0 s
          Case{1, {0, 0, 0xC0, 0x7F}, ArmRefusal::watchdog_not_confirmed},        // NaN
          Case{1, {0x0A, 0xD7, 0x23, 0x3C}, ArmRefusal::none},                    // 0.01 s
          Case{2, {3, 0, 0, 0}, ArmRefusal::mode_not_confirmed},                  // position
          Case{3, {2, 0, 0, 0}, ArmRefusal::mode_not_confirmed}}) {               // velocity ramp
        OdriveConfig c = config(OdriveGeneration::v0_6);
        c.watchdog_endpoint = 100;
        c.watchdog_timeout_endpoint = 101;
        c.control_mode_endpoint = 102;
        c.input_mode_endpoint = 103;
        c.arming_timeout_s = 0.2;
        Bench b(c);
        b.heartbeat(1);
        b.cycle();
        b.drive.request_arm();
        int modes = 0;
        bool closed_loop = false;
        const std::initializer_list<int> right[4]{
            {1, 0, 0, 0}, {0xCD, 0xCC, 0x4C, 0x3D}, {1, 0, 0, 0}, {1, 0, 0, 0}};
        for (int i = 0; i < 190; ++i) {
            b.sent.count = 0;
            b.cycle();
            for (std::size_t k = 0; k < b.sent.count; ++k) {
                const hal::CanFrame& sent = b.sent.frames[k];
                modes += sent.id == 0x06B ? 1 : 0;
                closed_loop = closed_loop || (sent.id == 0x067 && sent.data[0] == 8);
                if (sent.id != 0x064) continue;
                const int which = sent.data[1] - 100;
                const auto& value = which == one.wrong ? one.says : right[which];
                const int* v = value.begin();
                b.receive(0x065, {0, sent.data[1], 0, 0, v[0], v[1], v[2], v[3]});
            }
            if (i % 50 == 0) b.heartbeat(1);
        }
        b.cycles(20);
        CHECK(b.drive.refusal() == (one.refusal == ArmRefusal::none ? ArmRefusal::timed_out : one.refusal));
        CHECK_EQUAL(one.refusal == ArmRefusal::none, closed_loop);
        CHECK(one.refusal == ArmRefusal::mode_not_confirmed ? modes > 5 : modes == 1);
    }
}

TEST(OdriveArming, a_drive_that_says_its_watchdog_is_off_is_refused_even_when_vouched_for) {
    OdriveConfig c = config(OdriveGeneration::v0_6);
    c.watchdog_endpoint = 0x0123;
    Bench b(c);
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    b.cycles(4);
    b.sent.count = 0;
    b.receive(0x065, {0, 0x23, 0x01, 0, 0, 0, 0, 0});
    b.cycles(100);
    CHECK(b.drive.state() == DriveState::idle);
    CHECK(b.drive.refusal() == ArmRefusal::watchdog_not_confirmed);
    b.check_sent({});
}

TEST(OdriveArming, an_unanswered_watchdog_question_is_repeated_and_then_refuses) {
    OdriveConfig c = config(OdriveGeneration::v0_6);
    c.watchdog_endpoint = 0x0123;
    c.arming_timeout_s = 0.1;
    Bench b(c);
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    b.cycles(110);
    int questions = 0;
    for (std::size_t i = 0; i < b.sent.count; ++i) {
        questions += b.sent.frames[i].id == 0x064 ? 1 : 0;
        CHECK(b.sent.frames[i].id != 0x067);
    }
    CHECK(questions >= 3 && questions <= 6);
    CHECK(b.drive.refusal() == ArmRefusal::watchdog_not_confirmed);
}

TEST(OdriveArming, without_a_known_watchdog_nothing_is_sent) {
    for (const OdriveGeneration generation : {OdriveGeneration::v0_5, OdriveGeneration::v0_6}) {
        OdriveConfig c = config(generation);
        c.watchdog_assured = false;
        // A 0.5 drive cannot be asked, so an endpoint does not help it.
        c.watchdog_endpoint = generation == OdriveGeneration::v0_5 ? 0x0123 : 0;
        Bench b(c);
        b.heartbeat(1);
        b.cycle();
        b.drive.request_arm();
        b.cycles(20);
        b.check_sent({});
        CHECK(b.drive.state() == DriveState::idle);
        CHECK(b.drive.refusal() == ArmRefusal::watchdog_not_confirmed);
    }
}

TEST(OdriveArming, a_silent_drive_is_refused) {
    Bench b(config(OdriveGeneration::v0_6));
    CHECK(b.drive.state() == DriveState::silent);
    b.drive.request_arm();
    b.cycles(5);
    b.check_sent({});
    CHECK(b.drive.refusal() == ArmRefusal::silent);
}

// A robot file with the wrong generation: some frames have a form that the other one does not know.
TEST(OdriveArming, frames_of_the_other_generation_are_told_and_refused) {
    struct Case {
        OdriveGeneration told;
        std::uint32_t id;
        std::initializer_list<int> bytes;
        bool other;
    };
    using enum OdriveGeneration;
    for (const Case& each : {
             Case{v0_6,
                  0x061,
                  {0, 0, 0, 0, 1, 0, 0, 0x80},
                  true},  // trajectory done, as in each heartbeat of 0.5
             Case{v0_6, 0x061, {0, 0, 0, 0, 1, 0, 0, 1}, true},  // controller error
             Case{v0_6,
                  0x061,
                  {0, 0, 0, 1, 1, 3, 1, 0},
                  false},  // watchdog, result 3, trajectory done: 0.6 itself
             Case{v0_6, 0x074, {0, 0, 0, 0, 0, 0, 0, 0}, false},     // both have currents
             Case{v0_5, 0x061, {0, 0, 0, 1, 1, 0, 0, 0}, true},      // an expired watchdog of 0.6
             Case{v0_5, 0x061, {0, 0, 0, 0, 1, 3, 0, 0}, true},      // result 3
             Case{v0_5, 0x061, {0, 0, 0, 0, 1, 2, 0, 0}, true},      // result 2
             Case{v0_5, 0x061, {0, 8, 0, 0, 1, 1, 1, 0x81}, false},  // watchdog and all flags: 0.5 itself
             Case{v0_5, 0x07C, {0, 0, 0, 0, 0, 0, 0, 0}, true},      // torques
         }) {
        Bench b(config(each.told));
        b.heartbeat(1);
        b.cycle();
        CHECK(b.drive.state() == DriveState::idle);
        for (int i = 0; i < 3; ++i) {  // what a drive really sends comes again
            b.receive(each.id, each.bytes);
            b.heartbeat(1);
        }
        CHECK_EQUAL(each.other, b.drive.state() == DriveState::other_generation);
        b.cycle();
        b.drive.request_arm();
        b.cycle();
        CHECK_EQUAL(each.other, b.drive.refusal() == ArmRefusal::other_generation);
        CHECK_EQUAL(each.other, b.sent.count == 0);
    }
}

// Anybody may send one such frame.
TEST(OdriveArming, one_frame_of_the_other_generation_is_no_evidence_and_some_are_forgotten) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    b.receive(0x061, {0, 0, 0, 0, 1, 0, 0, 1});
    b.cycle();
    CHECK(b.drive.state() == DriveState::idle);
    b.drive.request_arm();
    b.cycles(5);
    b.check_sent({});  // but a reason to wait
    CHECK(b.drive.refusal() == ArmRefusal::none);
    b.heartbeat(1);
    b.cycle();
    b.check_sent({});  // some doubt is left
    b.heartbeat(1);
    b.cycle();
    CHECK(b.drive.state() == DriveState::arming);

    Bench doubted(config(OdriveGeneration::v0_6));
    for (int i = 0; i < 5; ++i) doubted.receive(0x061, {0, 0, 0, 0, 1, 0, 0, 1});
    doubted.cycle();
    CHECK(doubted.drive.state() == DriveState::other_generation);
    for (int i = 0; i < 4; ++i) doubted.heartbeat(1);
    CHECK(doubted.drive.state() == DriveState::idle);
    doubted.drive.request_arm();
    doubted.cycle();
    CHECK(doubted.drive.state() == DriveState::arming);
}

TEST(OdriveArming, a_heartbeat_from_before_the_request_does_not_arm) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    b.cycles(4);  // the fourth cycle asks for closed loop
    CHECK(b.drive.accept({frame(0x061, {0, 0, 0, 0, 8, 0, 0, 0}), b.now - 1}));
    CHECK(b.drive.state() == DriveState::arming);
    b.heartbeat(8);
    CHECK(b.drive.state() == DriveState::armed);
}

TEST(OdriveArming, an_axis_found_running_is_made_idle_first) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(8);
    b.cycle();
    CHECK(b.drive.state() == DriveState::fault);
    CHECK(b.drive.fault() == DriveFault::armed_unasked);
    CHECK_EQUAL(1U, b.drive.counters().foreign_control);
    b.check_sent({frame(0x06E, {0, 0, 0, 0, 0, 0, 0, 0}), frame(0x067, {1, 0, 0, 0})});
    b.drive.request_arm();
    b.cycles(3);
    b.check_sent({frame(0x067, {1, 0, 0, 0})});
    b.heartbeat(8);
    b.cycle();
    b.check_sent({});
    b.heartbeat(1);
    b.cycle();
    b.check_sent({frame(0x06B, {1, 0, 0, 0, 1, 0, 0, 0})});
}

// The story: Clear_Errors was the first step of every arming, so that a drive's emergency stop from before
// was cleared in silence and driven off.
TEST(OdriveArming, an_old_error_refuses_and_is_not_cleared_until_somebody_asks_for_it) {
    for (const OdriveGeneration generation : {OdriveGeneration::v0_5, OdriveGeneration::v0_6}) {
        Bench b(config(generation));
        b.heartbeat(1, 0x02);
        b.cycle();
        CHECK(b.drive.state() == DriveState::fault);
        CHECK(b.drive.fault() == DriveFault::error);
        b.drive.request_arm();
        b.cycles(20);
        CHECK(b.drive.refusal() == ArmRefusal::drive_error);
        CHECK(b.drive.state() == DriveState::fault);
        CHECK_EQUAL(0x200U, b.drive.feedback().error_bits);
        b.check_sent({});
        b.drive.request_clear_errors();
        b.cycle();
        CHECK_EQUAL(1U, b.sent.count);
        CHECK_EQUAL(0x078U, b.sent.frames[0].id);
        b.heartbeat(1, 0x02);  // perhaps written before the clearing was obeyed
        CHECK(b.drive.state() == DriveState::arming);
        b.cycles(10);
        b.heartbeat(1);
        CHECK(b.drive.state() == DriveState::idle);
        b.arm();
    }
}

TEST(OdriveArming, an_error_that_survives_clearing_refuses_an_arming_that_waits_for_it) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1, 0x02);
    b.cycle();
    b.drive.request_clear_errors();
    b.cycle();
    b.sent.count = 0;
    b.drive.request_arm();
    b.cycles(10);
    b.check_sent({});
    CHECK(b.drive.state() == DriveState::arming);
    CHECK(b.drive.refusal() == ArmRefusal::none);
    b.heartbeat(1, 0x02);
    b.cycle();
    CHECK(b.drive.refusal() == ArmRefusal::drive_error);
    b.check_sent({});
}

TEST(OdriveArming, an_error_that_comes_while_arming_refuses) {
    Bench fed(config(OdriveGeneration::v0_5));
    fed.heartbeat(1);
    fed.cycle();
    fed.drive.request_arm();
    fed.cycles(7);
    fed.heartbeat(1, 0x40);  // an emergency stop since the last heartbeat
    fed.sent.count = 0;
    fed.cycles(5);
    CHECK(fed.drive.refusal() == ArmRefusal::drive_error);
    fed.check_sent({});
    Bench asked(config(OdriveGeneration::v0_6));
    asked.heartbeat(1);
    asked.cycle();
    asked.drive.request_arm();
    asked.cycles(10);
    asked.heartbeat(1, 0x02);  // why it does not enter closed loop
    CHECK(asked.drive.refusal() == ArmRefusal::drive_error);
}

// 0.6 may send active_errors and disarm_reason by themselves (error_msg_rate_ms).
TEST(OdriveArming, a_disarm_reason_that_the_heartbeat_does_not_show_refuses) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    b.receive(0x063, {0, 0, 0, 0, 0, 0, 0, 0x02});  // estop_requested
    b.cycle();
    CHECK(b.drive.state() == DriveState::fault);
    CHECK_EQUAL(0x02000000U, b.drive.feedback().error_bits);
    b.drive.request_arm();
    b.cycle();
    CHECK(b.drive.refusal() == ArmRefusal::drive_error);
    b.drive.request_clear_errors();
    b.cycles(10);
    b.receive(0x063, kZero8);
    b.heartbeat(1);
    CHECK(b.drive.state() == DriveState::idle);
    b.arm();
}

TEST(OdriveArming, arming_times_out_and_takes_the_request_back) {
    OdriveConfig c = config(OdriveGeneration::v0_5);
    c.arming_timeout_s = 0.05;
    c.heartbeat_timeout_s = 0.02;
    Bench b(c);
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    for (int i = 0; i < 50; ++i) {
        if (i % 10 == 9) b.heartbeat(1);
        b.cycle();
    }
    b.heartbeat(1);
    b.sent.count = 0;
    b.cycles(3);
    CHECK(b.drive.refusal() == ArmRefusal::timed_out);
    CHECK_EQUAL(0x067U, b.sent.frames[b.sent.count - 1].id);
    CHECK_EQUAL(1, b.sent.frames[b.sent.count - 1].data[0]);
    b.heartbeat(1);
    CHECK(b.drive.state() == DriveState::idle);
}

TEST(OdriveArming, torque_is_not_passed_on_before_armed) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    b.cycle();
    b.drive.command_torque(1, b.sent);
    b.check_sent({});
    b.drive.request_arm();
    for (int i = 0; i < 8; ++i) {
        b.cycle();
        const std::size_t before = b.sent.count;
        b.drive.command_torque(1, b.sent);
        CHECK_EQUAL(before, b.sent.count);
    }
}

TEST(OdriveArming, a_stop_in_the_same_cycle_wins_over_arming) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    b.drive.request_disarm();
    b.cycle();
    b.check_sent({frame(0x067, {1, 0, 0, 0})});
    b.cycles(10);
    b.check_sent({});
    CHECK(b.drive.state() == DriveState::idle);
}

TEST(OdriveArming, disarming_sends_zero_then_idle_until_the_drive_says_so) {
    Bench b(config(OdriveGeneration::v0_6));
    b.arm();
    b.drive.request_disarm();
    b.cycle();
    b.check_sent({frame(0x06E, kZero8), frame(0x067, {1, 0, 0, 0})});
    b.drive.command_torque(2, b.sent);
    b.check_sent({});
    CHECK(b.drive.state() == DriveState::arming);
    b.cycles(60);
    b.check_sent({});  // no heartbeat has denied it yet
    b.heartbeat(8);
    b.cycle();
    b.check_sent({frame(0x067, {1, 0, 0, 0})});
    b.heartbeat(1);
    b.cycle();
    CHECK(b.drive.state() == DriveState::idle);
    CHECK(b.drive.fault() == DriveFault::none);
    b.check_sent({});
}

TEST_GROUP(OdriveFaults){};

TEST(OdriveFaults, an_error_while_armed_ends_torque_and_is_named) {
    for (const OdriveGeneration generation : {OdriveGeneration::v0_5, OdriveGeneration::v0_6}) {
        Bench b(config(generation));
        b.arm();
        b.receive(0x061, {0, 0x40, 0, 0, 8, 0, 0, 0});
        CHECK(b.drive.state() == DriveState::fault);
        CHECK(b.drive.fault() == DriveFault::error);
        b.drive.command_torque(1, b.sent);
        b.check_sent({});
        b.cycle();
        b.check_sent({frame(0x06E, kZero8), frame(0x067, {1, 0, 0, 0})});
        CHECK_EQUAL(0x4000U, b.drive.feedback().error_bits);
        const std::string_view name = b.drive.error_name(0x4000);
        CHECK(name == (generation == OdriveGeneration::v0_5 ? "estop_requested" : "inverter_over_temp"));
    }
}

TEST(OdriveFaults, error_bits_have_the_names_of_their_generation) {
    CHECK(odrive_error_name(OdriveGeneration::v0_5, 0x800) == "watchdog_timer_expired");
    CHECK(odrive_error_name(OdriveGeneration::v0_6, 0x01000000) == "watchdog_timer_expired");
    CHECK(odrive_error_name(OdriveGeneration::v0_5, 0x4000) == "estop_requested");
    CHECK(odrive_error_name(OdriveGeneration::v0_6, 0x02000000) == "estop_requested");
    CHECK(odrive_error_name(OdriveGeneration::v0_6, 0x800) == "dc_bus_over_regen_current");
    CHECK(odrive_error_name(OdriveGeneration::v0_6, 0x00800000) == "unknown");
}

// The story: ODrive issue 700. With the motor unplugged, the heartbeat's error stayed 0 and only the axis
// state left closed loop, so a driver that watched the error alone believed it was still armed.
TEST(OdriveFaults, leaving_closed_loop_without_any_error_is_a_fault) {
    Bench b(config(OdriveGeneration::v0_5));
    b.arm();
    b.heartbeat(1);
    CHECK(b.drive.state() == DriveState::fault);
    CHECK(b.drive.fault() == DriveFault::left_armed);
    b.cycle();
    b.heartbeat(1);
    b.cycles(5);
    CHECK(b.drive.state() == DriveState::fault);  // until somebody acknowledges
    b.drive.request_clear_errors();
    b.sent.count = 0;
    b.cycle();
    b.check_sent({frame(0x078, {})});
    b.cycles(10);
    b.heartbeat(1);
    CHECK(b.drive.state() == DriveState::idle);
    CHECK(b.drive.fault() == DriveFault::none);
}

TEST(OdriveFaults, error_flags_of_motor_encoder_and_controller_count_in_0_5) {
    for (const int flag : {5, 6, 7}) {
        Bench b(config(OdriveGeneration::v0_5));
        b.arm();
        std::array<int, 8> bytes{0, 0, 0, 0, 8, 0, 0, 0};
        bytes[static_cast<std::size_t>(flag)] = 1;
        b.receive(0x061, {0, 0, 0, 0, 8, bytes[5], bytes[6], bytes[7]});
        CHECK(b.drive.fault() == DriveFault::error);
    }
    Bench b(config(OdriveGeneration::v0_5));
    b.arm();
    b.receive(0x061, {0, 0, 0, 0, 8, 0, 0, 0x80});  // trajectory done is no error
    CHECK(b.drive.state() == DriveState::armed);
}

TEST(OdriveFaults, a_heartbeat_that_stops_is_a_fault_at_its_time_out) {
    Bench b(config(OdriveGeneration::v0_6));
    b.arm();
    b.receive(0x069, {0, 0, 0, 0, 0, 0, 0, 0});
    b.cycles(348);
    CHECK(b.drive.state() == DriveState::armed);
    b.receive(0x069, {0, 0, 0, 0, 0, 0, 0, 0});  // encoder frames are no sign of the axis state
    b.sent.count = 0;
    b.cycles(3);
    CHECK(b.drive.state() == DriveState::silent);
    CHECK(b.drive.fault() == DriveFault::silent);
    b.check_sent({frame(0x06E, kZero8), frame(0x067, {1, 0, 0, 0})});
    b.drive.command_torque(1, b.sent);
    b.cycles(500);
    b.check_sent({});  // its watchdog does the rest; frames would feed it
    b.heartbeat(8);    // back, and still running
    b.cycle();
    b.check_sent({frame(0x06E, kZero8), frame(0x067, {1, 0, 0, 0})});
    CHECK(b.drive.state() == DriveState::fault);
}

TEST(OdriveFaults, a_silent_drive_ends_arming) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    b.cycles(360);
    CHECK(b.drive.state() == DriveState::silent);
    CHECK(b.drive.refusal() == ArmRefusal::silent);
}

TEST(OdriveFaults, a_drive_that_ignores_disarming_is_a_fault) {
    OdriveConfig c = config(OdriveGeneration::v0_6);
    c.arming_timeout_s = 0.2;
    Bench b(c);
    b.arm();
    b.drive.request_disarm();
    for (int i = 0; i < 250; ++i) {
        if (i % 50 == 0) b.heartbeat(8);
        b.cycle();
    }
    CHECK(b.drive.state() == DriveState::fault);
    CHECK(b.drive.fault() == DriveFault::disarm_failed);
}

// Its heartbeat would say so up to its period later, or never, where it comes back in closed loop.
TEST(OdriveFaults, an_armed_drive_that_counts_anew_after_a_gap_has_left_that_state) {
    for (const bool at_rest : {true, false}) {
        Bench b(config(OdriveGeneration::v0_6));
        b.arm();
        float turns = 3;
        for (int i = 0; i < 50; ++i, turns += 0.01F) {
            b.encoder(turns, 10);
            b.cycle();
        }
        const double before_rad = b.drive.feedback().position_rad;
        b.cycles(3);
        b.sent.count = 0;
        b.encoder(at_rest ? 0.F : 0.02F, at_rest ? 0.F : 10.F);
        CHECK(b.drive.state() == DriveState::fault);
        CHECK(b.drive.fault() == DriveFault::left_armed);
        DOUBLES_EQUAL(before_rad, b.drive.feedback().position_rad, 2 * kPi / 6.25 * 0.1);  // no motion
        b.cycle();
        b.check_sent({frame(0x06E, kZero8), frame(0x067, {1, 0, 0, 0})});
    }
}

TEST(OdriveFaults, lost_encoder_frames_and_a_new_origin_alone_are_no_reboot) {
    Bench b(config(OdriveGeneration::v0_6));
    b.arm();
    float turns = 3;
    float speed = 10;
    for (int i = 0; i < 400; ++i, speed -= 0.05F, turns += 1e-3F * speed) {  // turns back
        if (i % 7 != 3 && i % 7 != 4 && i % 7 != 5) b.encoder(turns, speed);
        b.cycle();
        if (i % 50 == 0) b.heartbeat(8);
    }
    CHECK(b.drive.state() == DriveState::armed);
    b.encoder(turns, speed);
    b.cycle();
    b.encoder(0, speed);
    b.cycle();
    CHECK(b.drive.state() == DriveState::armed);
}

TEST(OdriveFaults, an_idle_drive_that_has_been_away_is_told_to_be_idle_at_once) {
    Bench b(config(OdriveGeneration::v0_6));
    for (int i = 0; i < 20; ++i) {
        b.encoder(0.5F, 0);
        b.heartbeat(1);
        b.cycle();
    }
    b.cycles(3);
    b.encoder(0.5F, 0);
    b.cycle();
    b.check_sent({});  // some frames are always lost
    b.cycles(20);
    b.check_sent({});
    b.encoder(0, 0);
    b.cycle();
    b.check_sent({frame(0x06E, kZero8), frame(0x067, {1, 0, 0, 0})});
    for (int i = 0; i < 20; ++i) {
        b.encoder(0, 0);
        b.cycle();
    }
    b.check_sent({});
    b.heartbeat(1);
    b.cycle();
    CHECK(b.drive.state() == DriveState::idle);
    b.check_sent({});
}

TEST(OdriveFaults, a_drive_that_is_back_is_heard_by_its_first_report_whatever_that_is) {
    OdriveConfig seldom = config(OdriveGeneration::v0_6);
    seldom.encoder_period_s = 0.01;
    Bench b(seldom);
    b.heartbeat(1);
    for (int i = 0; i < 5; ++i) {
        b.encoder(0.5F, 0);
        b.cycles(10);
    }
    b.receive(0x07C, {0, 0, 0, 0, 0, 0, 0, 0});
    b.cycles(9);  // 19 ms after the last encoder frame
    b.receive(0x07C, {0, 0, 0, 0, 0, 0, 0, 0});
    b.cycles(2);
    b.check_sent({});
    b.receive(0x07C, {0, 0, 0, 0, 0, 0, 0, 0});
    b.cycle();
    b.check_sent({frame(0x06E, kZero8), frame(0x067, {1, 0, 0, 0})});
    b.receive(0x07C, {0, 0, 0, 0, 0, 0, 0, 0});
    b.encoder(0.5F, 0);
    b.cycle();
    b.check_sent({});  // told once
}

TEST(OdriveFaults, who_arms_a_drive_again_and_again_is_answered_by_estop) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    b.cycle();
    b.receive(0x067, {8, 0, 0, 0});
    b.cycle();
    b.check_sent({});  // the cycle's answer is to disarm
    b.cycles(5);
    for (int i = 0; i < 3; ++i) {
        b.receive(0x067, {8, 0, 0, 0});
        b.cycle();
        b.check_sent({frame(0x062, {})});
    }
    b.receive(0x067, {1, 0, 0, 0});  // idle is nobody's harm
    b.cycle();
    b.check_sent({});
    b.cycles(1100);
    b.heartbeat(1);
    b.receive(0x067, {8, 0, 0, 0});
    b.cycle();
    b.check_sent({});
    b.cycles(999);
    b.receive(0x067, {8, 0, 0, 0});  // a second later: no more within it
    b.cycle();
    b.check_sent({});

    Bench first(config(OdriveGeneration::v0_6));
    first.now = 0;  // the clock has only begun
    first.receive(0x067, {8, 0, 0, 0});
    first.cycle();
    first.check_sent({});

    Bench armed(config(OdriveGeneration::v0_6));
    armed.arm();
    armed.receive(0x067, {8, 0, 0, 0});
    armed.cycle();
    armed.check_sent({frame(0x062, {})});
}

TEST(OdriveFaults, an_expired_watchdog_is_a_fault_while_armed_and_none_while_idle) {
    Bench b(config(OdriveGeneration::v0_5));
    b.heartbeat(1, 0x08);  // 0x800
    b.cycle();
    CHECK(b.drive.state() == DriveState::idle);
    b.arm();
    b.heartbeat(1, 0x08);
    CHECK(b.drive.state() == DriveState::fault);
    b.drive.request_clear_errors();
    b.cycles(10);
    b.heartbeat(1, 0x08);  // expired again: nobody feeds an idle drive
    CHECK(b.drive.state() == DriveState::idle);
}

TEST(OdriveFaults, a_fault_can_be_armed_away) {
    Bench b(config(OdriveGeneration::v0_6));
    b.arm();
    b.heartbeat(1);
    b.cycle();
    b.heartbeat(1);
    b.drive.request_arm();
    b.cycles(6);
    CHECK(b.drive.state() == DriveState::arming);
    b.heartbeat(8);
    CHECK(b.drive.state() == DriveState::armed);
    CHECK(b.drive.fault() == DriveFault::none);
}

TEST_GROUP(OdriveFeedback){};

TEST(OdriveFeedback, encoder_estimates_arrive_at_the_wheel_with_sign_gear_and_receive_time) {
    Bench b(config(OdriveGeneration::v0_6));
    // 10.5 rev = 0x41280000, -2.25 rev/s = 0xC0100000
    const hal::ReceivedFrame received{frame(0x069, {0, 0, 0x28, 0x41, 0, 0, 0x10, 0xC0}), 123'456'789};
    CHECK(b.drive.accept(received));
    DOUBLES_EQUAL(-10.5 * 2 * kPi / 6.25, b.drive.feedback().position_rad, 1e-12);
    DOUBLES_EQUAL(2.25 * 2 * kPi / 6.25, b.drive.feedback().speed_rad_per_s, 1e-12);
    CHECK_EQUAL(123'456'789, b.drive.feedback().encoder_time_ns);
    CHECK_EQUAL(0, b.drive.feedback().torque_time_ns);
}

TEST(OdriveFeedback, torque_comes_from_current_in_0_5_and_from_the_estimate_in_0_6) {
    Bench old(config(OdriveGeneration::v0_5));
    // set 1 A, measured 4 A = 0x40800000
    old.receive(0x074, {0, 0, 0x80, 0x3F, 0, 0, 0x80, 0x40});
    DOUBLES_EQUAL(-4 * 0.0625 * 6.25, old.drive.feedback().torque_Nm, 1e-12);
    old.receive(0x07C, {0, 0, 0x80, 0x3F, 0, 0, 0x80, 0x40});  // 0.5: the ADC voltage, not a torque
    DOUBLES_EQUAL(-4 * 0.0625 * 6.25, old.drive.feedback().torque_Nm, 1e-12);

    OdriveConfig c = config(OdriveGeneration::v0_6);
    c.torque_scale = 0.9;
    Bench b(c);
    // target 1 Nm, estimate -0.5 Nm = 0xBF000000
    b.receive(0x07C, {0, 0, 0x80, 0x3F, 0, 0, 0, 0xBF});
    DOUBLES_EQUAL(0.5 * 6.25 * 0.9, b.drive.feedback().torque_Nm, 1e-12);
    CHECK(b.drive.feedback().torque_time_ns > 0);
}

TEST(OdriveFeedback, supply_voltage_and_temperature_are_passed_on) {
    Bench b(config(OdriveGeneration::v0_6));
    CHECK_EQUAL(0, b.drive.feedback().supply_time_ns);
    CHECK_EQUAL(0, b.drive.feedback().temperature_time_ns);
    b.receive(0x077, {0, 0, 0xC0, 0x41, 0, 0, 0, 0});     // 24 V
    b.receive(0x075, {0, 0, 0, 0x42, 0, 0, 0x80, 0x42});  // 32 degC, 64 degC
    DOUBLES_EQUAL(24, b.drive.feedback().bus_voltage_V, 0);
    DOUBLES_EQUAL(32, b.drive.feedback().inverter_temperature_degC, 0);
    DOUBLES_EQUAL(64, b.drive.feedback().motor_temperature_degC, 0);
    CHECK(b.drive.feedback().supply_time_ns > 0);
    CHECK(b.drive.feedback().temperature_time_ns > 0);
}

TEST(OdriveFeedback, a_motor_without_a_thermistor_has_no_temperature_and_its_inverter_has_one) {
    Bench b(config(OdriveGeneration::v0_6));
    b.receive(0x075, {0, 0, 0, 0x42, 0, 0, 0xC0, 0x7F});  // 32 degC, NaN
    DOUBLES_EQUAL(32, b.drive.feedback().inverter_temperature_degC, 0);
    CHECK(std::isnan(b.drive.feedback().motor_temperature_degC));
    CHECK_EQUAL(0U, b.drive.counters().not_finite);
    b.receive(0x075, {0, 0, 0, 0x42});
    CHECK_EQUAL(1U, b.drive.counters().wrong_length);
}

TEST(OdriveFeedback, sensorless_estimates_of_0_5_are_no_temperatures) {
    Bench b(config(OdriveGeneration::v0_5));
    b.receive(0x075, {0, 0, 2, 0x43, 0, 0, 2, 0x43});  // 130 turns, 130 turns a second
    CHECK_EQUAL(0, b.drive.feedback().temperature_time_ns);
}

TEST(OdriveFeedback, commanded_wheel_torque_becomes_motor_torque) {
    OdriveConfig c = config(OdriveGeneration::v0_6);
    Bench b(c);
    b.arm();
    b.drive.command_torque(2.5, b.sent);  // -0.4 Nm at the motor = 0xBECCCCCD
    b.check_sent({frame(0x06E, {0xCD, 0xCC, 0xCC, 0xBE, 0, 0, 0, 0})});
    b.drive.set_torque_scale(0.8);
    b.drive.command_torque(2.5, b.sent);  // -0.5 Nm = 0xBF000000
    b.check_sent({frame(0x06E, {0, 0, 0, 0xBF, 0, 0, 0, 0})});
}

TEST(OdriveFeedback, a_commanded_torque_that_is_no_number_is_sent_as_zero_and_counted) {
    Bench b(config(OdriveGeneration::v0_6));
    b.arm();
    for (const double bad :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), -1e300}) {
        b.drive.command_torque(bad, b.sent);
        b.check_sent({frame(0x06E, kZero8)});
    }
    CHECK_EQUAL(3U, b.drive.counters().command_not_finite);
}

TEST(OdriveFeedback, frames_with_not_finite_numbers_change_nothing_and_are_counted) {
    Bench b(config(OdriveGeneration::v0_6));
    b.receive(0x069, {0, 0, 0x28, 0x41, 0, 0, 0x10, 0xC0});
    const DriveFeedback before = b.drive.feedback();
    b.now += kMs;
    b.receive(0x069, {0, 0, 0xC0, 0x7F, 0, 0, 0x10, 0xC0});  // position NaN
    b.receive(0x069, {0, 0, 0x28, 0x41, 0, 0, 0x80, 0xFF});  // speed -infinity
    b.receive(0x07C, {0, 0, 0x80, 0x3F, 1, 0, 0x80, 0x7F});  // torque, a signalling NaN
    DOUBLES_EQUAL(before.position_rad, b.drive.feedback().position_rad, 0);
    DOUBLES_EQUAL(before.speed_rad_per_s, b.drive.feedback().speed_rad_per_s, 0);
    CHECK_EQUAL(before.encoder_time_ns, b.drive.feedback().encoder_time_ns);
    CHECK_EQUAL(0, b.drive.feedback().torque_time_ns);
    CHECK_EQUAL(3U, b.drive.counters().not_finite);
}

TEST(OdriveFeedback, frames_of_the_wrong_length_change_nothing_and_are_counted) {
    Bench b(config(OdriveGeneration::v0_6));
    b.receive(0x069, {0, 0, 0x28, 0x41, 0, 0, 0x10});
    b.receive(0x061, {0, 0, 0, 0, 8});
    b.receive(0x069, {});
    CHECK_EQUAL(0, b.drive.feedback().encoder_time_ns);
    CHECK_EQUAL(0, b.drive.feedback().heartbeat_time_ns);
    CHECK_EQUAL(3U, b.drive.counters().wrong_length);
}

TEST(OdriveFeedback, frames_of_other_nodes_and_other_kinds_are_left_alone) {
    Bench b(config(OdriveGeneration::v0_6));
    CHECK(!b.receive(0x041, {0, 0, 0, 0, 8, 0, 0, 0}));  // node 2
    CHECK(!b.receive(0x081, {0, 0, 0, 0, 8, 0, 0, 0}));  // node 4
    hal::CanFrame odd = frame(0x061, {0, 0, 0, 0, 8, 0, 0, 0});
    odd.extended = true;
    CHECK(!b.drive.accept({odd, b.now}));
    odd.extended = false;
    odd.error = true;
    CHECK(!b.drive.accept({odd, b.now}));
    CHECK_EQUAL(0, b.drive.feedback().heartbeat_time_ns);
}

TEST(OdriveFeedback, somebody_elses_commands_to_the_drive_are_noticed) {
    Bench b(config(OdriveGeneration::v0_6));
    CHECK(b.receive(0x06E, {0, 0, 0, 0, 0, 0, 0, 0}));
    CHECK(b.receive(0x067, {8, 0, 0, 0}));
    CHECK_EQUAL(2U, b.drive.counters().foreign_commands);
    CHECK_EQUAL(2U, b.drive.counters().foreign_control);
    CHECK(b.receive(0x067, {1, 0, 0, 0}));  // to idle, and limits
    CHECK(b.receive(0x06F, {0, 0, 0, 0, 0, 0, 0, 0}));
    CHECK(b.receive(0x062, {}));  // what the driver makes nothing of is this drive's all the same
    CHECK_EQUAL(4U, b.drive.counters().foreign_commands);
    CHECK_EQUAL(2U, b.drive.counters().foreign_control);
}

TEST(OdriveFaults, frames_that_the_bus_refused_are_pushed_again) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    b.cycle();
    b.drive.request_disarm();
    b.cycle();
    b.check_sent({frame(0x067, {1, 0, 0, 0})});
    CHECK(b.drive.refused(frame(0x067, {1, 0, 0, 0})));
    CHECK_FALSE(b.drive.refused(frame(0x087, {1, 0, 0, 0})));
    b.cycle();
    b.check_sent({frame(0x06E, {0, 0, 0, 0, 0, 0, 0, 0}), frame(0x067, {1, 0, 0, 0})});
    b.heartbeat(1);
    b.cycle();
    b.check_sent({});
    CHECK(b.drive.state() == DriveState::idle);
}

TEST(OdriveFeedback, every_frame_of_every_length_and_pattern_leaves_finite_feedback) {
    for (const OdriveGeneration generation : {OdriveGeneration::v0_5, OdriveGeneration::v0_6}) {
        Bench b(config(generation));
        std::uint32_t x = 12345;
        for (int i = 0; i < 200'000; ++i) {
            hal::ReceivedFrame received;
            x = x * 1664525U + 1013904223U;
            received.frame.id = 0x060 | (x >> 27U);
            received.frame.length = static_cast<std::uint8_t>((x >> 20U) % 9);
            for (std::size_t k = 0; k < 8; ++k) {
                x = x * 1664525U + 1013904223U;
                const std::uint8_t byte = static_cast<std::uint8_t>(x >> 24U);
                received.frame.data[k] = (x & 0x700000U) == 0 ? 0xFF : byte;
            }
            received.timestamp_ns = ++b.now;
            b.drive.accept(received);
            CHECK(std::isfinite(b.drive.feedback().position_rad));
            CHECK(std::isfinite(b.drive.feedback().speed_rad_per_s));
            CHECK(std::isfinite(b.drive.feedback().torque_Nm));
            CHECK(b.drive.state() != DriveState::armed);
        }
        CHECK(b.drive.counters().not_finite > 100);
        CHECK(b.drive.counters().wrong_length > 100);
    }
}

TEST_GROUP(OdriveConfiguration){};

TEST(OdriveConfiguration, the_robot_file_reaches_the_drive_left_and_right) {
    model::RobotParameters p = model::default_parameters();
    p.drive.generation = 5;
    p.drive.left = {7, -1, 5.5, 0.031, 1.07};
    p.drive.right = {9, 1, 6.5, 0.029, 0.93};
    p.drive.heartbeat_period_ms = 50;
    p.drive.encoder_period_ms = 2;
    p.drive.torque_period_ms = 20;
    p.drive.supply_period_ms = 200;
    p.drive.temperature_period_ms = 500;
    p.drive.watchdog_assured = true;
    p.drive.watchdog_endpoint = 391;
    const OdriveConfig left = odrive_config(p, Wheel::left);
    const OdriveConfig right = odrive_config(p, Wheel::right);
    CHECK(left.generation == OdriveGeneration::v0_5);
    CHECK_EQUAL(7U, left.node);
    CHECK_EQUAL(9U, right.node);
    DOUBLES_EQUAL(-1, left.sign, 0);
    DOUBLES_EQUAL(1, right.sign, 0);
    DOUBLES_EQUAL(5.5, left.gear_ratio, 0);
    DOUBLES_EQUAL(6.5, right.gear_ratio, 0);
    DOUBLES_EQUAL(0.029, right.torque_constant_Nm_per_A, 0);
    DOUBLES_EQUAL(1.07, left.torque_scale, 0);
    DOUBLES_EQUAL(0.05, left.heartbeat_period_s, 1e-12);
    DOUBLES_EQUAL(0.002, left.encoder_period_s, 1e-12);
    DOUBLES_EQUAL(0.02, left.torque_period_s, 1e-12);
    DOUBLES_EQUAL(0.2, left.supply_period_s, 1e-12);
    DOUBLES_EQUAL(0.5, left.temperature_period_s, 1e-12);
    CHECK(left.watchdog_assured);
    CHECK_EQUAL(391, left.watchdog_endpoint);
}

TEST(OdriveConfiguration, the_catalogue_makes_the_drive_in_place) {
    model::RobotParameters p = model::default_parameters();
    DriveSlot slot;
    MotorDrive* drive = make_drive(slot, p, Wheel::right);
    CHECK(drive != nullptr);
    CHECK(reinterpret_cast<char*>(drive) >= reinterpret_cast<char*>(&slot));
    CHECK(reinterpret_cast<char*>(drive) < reinterpret_cast<char*>(&slot + 1));
    CHECK(drive->state() == DriveState::silent);
    p.drive.generation = 99;
    CHECK(make_drive(slot, p, Wheel::right) == nullptr);
}

TEST(OdriveConfiguration, all_reports_that_there_are_find_room_in_the_list) {
    OdriveConfig c = config(OdriveGeneration::v0_6);
    c.torque_period_s = c.supply_period_s = c.temperature_period_s = 0.01;
    CHECK_EQUAL(6U, OdriveDrive(c).frames().size());
    c.generation = OdriveGeneration::v0_5;  // tells no temperature
    CHECK_EQUAL(5U, OdriveDrive(c).frames().size());
}

TEST(OdriveConfiguration, periodic_frames_are_listed_for_the_bus_load) {
    const OdriveDrive drive(config(OdriveGeneration::v0_5));
    double bits_per_s = 0;
    for (const DriveFrame& f : drive.frames()) {
        bits_per_s += 135 / f.period_s;  // eight bytes, 11-bit id, worst case
        CHECK_EQUAL(8, f.length);
        CHECK_EQUAL(3U, f.id >> 5U);
    }
    // Torque and encoder at 1 kHz, current at 100 Hz, heartbeat at 10 Hz.
    DOUBLES_EQUAL(135 * (1000 + 1000 + 100 + 10), bits_per_s, 1e-6);
    CHECK_EQUAL(4U, drive.frames().size());
    CHECK(drive.frames()[2].name == "Get_Iq");
    CHECK(drive.frames()[3].to_drive);
    OdriveConfig c = config(OdriveGeneration::v0_6);
    c.torque_period_s = 0;
    CHECK_EQUAL(3U, OdriveDrive(c).frames().size());
}

// --- what no story above looks at: found by mutants of the driver ------------------------------------------

namespace {

constexpr hal::CanFrame with_floats(std::uint32_t id, float first, float second) {
    hal::CanFrame f;
    f.id = id;
    f.length = 8;
    const std::array<float, 2> both{first, second};
    const auto bytes = std::bit_cast<std::array<std::uint8_t, 8>>(both);
    for (std::size_t i = 0; i < bytes.size(); ++i) f.data[i] = bytes[i];
    return f;
}

// An armed drive at whose motor 1 Nm at the wheel is 0.16 Nm, with a slack of 0.032 Nm.
struct TorqueBench : Bench {
    explicit TorqueBench(OdriveGeneration generation) : Bench(with_limit(generation)) { arm(); }
    static OdriveConfig with_limit(OdriveGeneration generation) {
        OdriveConfig c = config(generation);
        c.torque_limit_Nm = 2;
        return c;
    }

    void ask(double torque_Nm, int times = 10) {
        for (int i = 0; i < times; ++i) {
            cycle();
            drive.command_torque(torque_Nm, sent);
            sent.count = 0;
        }
    }
    // The drive's set-point, at the motor.
    void report(double motor_Nm) {
        const double value = older ? motor_Nm / 0.0625 : motor_Nm;  // 0.5 tells it in A
        drive.accept({with_floats(older ? 0x074 : 0x07C, static_cast<float>(value), 0), now + 2000});
    }
    bool follows() const { return drive.state() == DriveState::armed; }
};

constexpr std::array kGenerations{OdriveGeneration::v0_5, OdriveGeneration::v0_6};

}  // namespace

TEST(OdriveFaults, a_drive_that_gives_more_than_was_asked_is_a_fault_after_two_reports) {
    for (const OdriveGeneration generation : kGenerations) {
        TorqueBench b(generation);
        const auto told = [&](double motor_Nm) {
            b.ask(1);
            b.report(motor_Nm);
        };
        for (int i = 0; i < 5; ++i) told(-0.16);
        for (int i = 0; i < 5; ++i) told(0.34);  // not beyond twice and the slack
        told(0.36);
        told(0.16);  // one alone may be of a torque that was asked in between
        told(0.36);
        CHECK(b.follows());
        told(-0.36);
        CHECK(b.drive.fault() == DriveFault::torque_not_followed);
        // Armed again it is judged anew: not by what was asked before.
        b.cycle();
        b.heartbeat(1);
        b.arm();
        told(0.36);  // nothing was asked before this report
        told(0.36);
        CHECK(b.follows());
        told(0.36);
        CHECK_FALSE(b.follows());
    }
}

TEST(OdriveFaults, a_drive_that_gives_nothing_is_a_fault_once_its_heartbeat_denies_that_it_stopped) {
    for (const OdriveGeneration generation : kGenerations) {
        for (const double asked_Nm : {1.0, 0.5}) {  // 0.08 Nm: just more than twice the slack
            TorqueBench b(generation);
            const auto told = [&](double motor_Nm) {
                b.ask(asked_Nm);
                b.report(motor_Nm);
            };
            told(0);
            told(0);
            told(0);
            CHECK(b.follows());
            b.heartbeat(8);
            told(0.03);
            CHECK(b.drive.fault() == DriveFault::torque_not_followed);
        }
        TorqueBench quick(generation);  // the heartbeat may come between the two reports
        quick.ask(1);
        quick.report(0.16);
        quick.ask(1);
        quick.report(0);
        quick.heartbeat(8);
        quick.ask(1);
        CHECK(quick.follows());
        quick.report(0);
        CHECK_FALSE(quick.follows());
    }
}

TEST(OdriveFaults, little_torque_or_a_moment_without_any_is_nothing_to_judge) {
    for (const OdriveGeneration generation : kGenerations) {
        TorqueBench little(generation), moment(generation), more(generation), unasked(generation);
        for (int i = 0; i < 10; ++i) {
            little.ask(0.35);  // 0.056 Nm: within twice the slack
            moment.ask(1, 4);
            moment.ask(0, 1);
            moment.ask(1, 4);
            for (TorqueBench* b : {&little, &moment}) {
                b->report(0);
                b->heartbeat(8);
                CHECK(b->follows());
            }
            more.ask(1, 4);
            more.ask(0.1, 4);  // what was more is not forgotten over what is less
            more.report(0.32);
            CHECK(more.follows());
        }
        unasked.ask(0.1);
        for (int i = 0; i < 5; ++i) unasked.report(0.5);  // nothing was asked between two of them
        CHECK(unasked.follows());
    }
}

// Positions are floats: far from zero the drive is told to count anew.
TEST(OdriveFeedback, a_position_that_has_gone_far_is_counted_anew_and_goes_on) {
    for (const OdriveGeneration generation : kGenerations) {
        for (const float way : {1.F, -1.F}) {
            Bench b(config(generation));
            const auto turned = [&](double rev, double speed_rev_per_s = 0) {
                b.drive.accept({with_floats(0x069, way * static_cast<float>(rev),
                                            way * static_cast<float>(speed_rev_per_s)),
                                b.now});
                b.sent.count = 0;
                b.cycle();
            };
            const auto position_rev = [&] {
                return -way * b.drive.feedback().position_rad * 6.25 / (2 * kPi);
            };
            const auto told = [&] {
                for (std::size_t i = 0; i < b.sent.count; ++i) CHECK_EQUAL(0x079U, b.sent.frames[i].id);
                return b.sent.count;
            };
            b.heartbeat(1);
            for (int i = 0; i < 20; ++i) turned(1024);  // the last that is near
            for (int i = 0; i < 20; ++i) {              // jumps are no way that was gone
                turned(1100);
                turned(1612);
                CHECK_EQUAL(0U, told());
            }
            turned(1100);
            for (int i = 0; i < 3; ++i) {
                turned(1500);
                turned(1100);
            }
            CHECK_EQUAL(0U, told());
            turned(1100.5, 100);
            CHECK_EQUAL(1U, told());
            b.heartbeat(1);
            for (int i = 1; i < 100; ++i) {
                turned(1100.5);
                CHECK_EQUAL(0U, told());
            }
            turned(1100.5);  // not followed within 0.1 s: once more
            CHECK_EQUAL(1U, told());
            turned(1800);  // a wild frame is not the new count
            turned(1100.5);
            DOUBLES_EQUAL(1100.5, position_rev(), 1e-9);
            turned(1100.5);
            turned(400, 500);  // the new count: 1 ms after the last of the old one, 500 turns a second
            DOUBLES_EQUAL(1101, position_rev(), 1e-9);
            turned(400.5, 500);
            DOUBLES_EQUAL(1101.5, position_rev(), 1e-9);
            for (int i = 0; i < 300; ++i) {
                turned(401);
                CHECK_EQUAL(0U, told());
            }
            // The next time it is told again, after eight frames, three times at most.
            b.heartbeat(1);
            turned(1200);
            for (int i = 0; i < 7; ++i) {
                turned(1200);
                CHECK_EQUAL(0U, told());
            }
            std::size_t times = 0;
            for (int i = 0; i < 1000; ++i) {
                if (i % 100 == 0) b.heartbeat(1);
                turned(1200);
                times += told();
            }
            CHECK_EQUAL(3U, times);
        }
    }
}

TEST(OdriveFeedback, a_drive_that_follows_at_once_goes_on) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    for (int i = 0; i < 10; ++i) b.drive.accept({with_floats(0x069, -1100, 0), b.now});
    b.cycle();
    b.check_sent({frame(0x079, kZero8)});
    b.drive.accept({with_floats(0x069, 0, 0), b.now});
    DOUBLES_EQUAL(1100 * 2 * kPi / 6.25, b.drive.feedback().position_rad, 1e-9);
}

TEST(OdriveFeedback, a_drive_that_counts_anew_unasked_has_jumped) {
    Bench b(config(OdriveGeneration::v0_6));
    for (int i = 0; i < 20; ++i) b.drive.accept({with_floats(0x069, -1100, 0), b.now});
    b.drive.accept({with_floats(0x069, 0.5, 0), b.now});
    DOUBLES_EQUAL(-0.5 * 2 * kPi / 6.25, b.drive.feedback().position_rad, 1e-12);
    b.heartbeat(1);
    b.cycles(10);
    b.check_sent({});
}

TEST(OdriveFeedback, a_drive_that_arms_is_not_told_to_count_anew) {
    Bench b(config(OdriveGeneration::v0_6));
    for (int i = 0; i < 20; ++i) b.drive.accept({with_floats(0x069, 1100, 0), b.now});
    b.heartbeat(1);
    b.drive.request_arm();
    b.cycles(20);
    for (std::size_t i = 0; i < b.sent.count; ++i) CHECK(b.sent.frames[i].id != 0x079);
}

TEST(OdriveFeedback, a_current_is_a_torque_with_its_time) {
    Bench b(config(OdriveGeneration::v0_5));
    b.receive(0x074, {0, 0, 0x80, 0x3F, 0, 0, 0x80, 0x40});
    CHECK_EQUAL(b.now + 1000, b.drive.feedback().torque_time_ns);
}

// Its answer must not be taken for the other generation's.
TEST(OdriveFeedback, a_question_of_somebody_else_is_noticed) {
    Bench b(config(OdriveGeneration::v0_5));
    hal::CanFrame question = frame(0x07C, {});
    question.remote = true;
    CHECK(b.drive.accept({question, b.now}));
    CHECK_EQUAL(1U, b.drive.counters().foreign_commands);
    for (int i = 0; i < 3; ++i) b.receive(0x07C, kZero8);
    b.heartbeat(1);
    CHECK(b.drive.state() == DriveState::idle);
    b.receive(0x067, {1});  // short, but to idle
    CHECK_EQUAL(0U, b.drive.counters().foreign_control);
}

TEST(OdriveArming, a_heartbeat_ends_the_silence_at_once_and_its_end_is_exact) {
    Bench b(config(OdriveGeneration::v0_6));
    b.now = 0;
    b.cycle();
    CHECK(b.drive.state() == DriveState::silent);  // never heard, though the clock has only begun
    b.drive.accept({frame(0x061, {0, 0, 0, 0, 1, 0, 0, 0}), b.now});
    CHECK(b.drive.state() == DriveState::idle);
    b.cycles(350);
    CHECK(b.drive.state() == DriveState::idle);
    b.cycle();
    CHECK(b.drive.state() == DriveState::silent);
}

TEST(OdriveArming, heartbeats_about_the_time_of_the_request_are_not_its_answer) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    b.cycles(4);  // the fourth asks for closed loop
    const std::int64_t asked = b.now;
    b.drive.accept({frame(0x061, {0, 0, 0, 0, 8, 0, 0, 0}), asked});
    CHECK(b.drive.state() == DriveState::arming);
    for (const std::int64_t after : {1 * kMs, 5 * kMs}) {  // an error of before
        b.drive.accept({frame(0x061, {0, 2, 0, 0, 1, 0, 0, 0}), asked + after});
        CHECK(b.drive.state() == DriveState::arming);
    }
    b.drive.accept({frame(0x061, {0, 2, 0, 0, 1, 0, 0, 0}), asked + 5 * kMs + 1});
    CHECK(b.drive.refusal() == ArmRefusal::drive_error);
}

TEST(OdriveArming, a_heartbeat_at_the_time_of_clearing_does_not_tell_what_is_left) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1, 2);
    b.cycle();
    b.drive.request_clear_errors();
    b.cycle();
    b.drive.accept({frame(0x061, {0, 0, 0, 0, 1, 0, 0, 0}), b.now + 5 * kMs});
    CHECK(b.drive.state() == DriveState::arming);
}

TEST(OdriveArming, a_stop_while_arming_ends_it_and_is_repeated_until_obeyed) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    b.cycles(4);
    b.sent.count = 0;
    b.drive.request_disarm();
    b.cycle();
    b.check_sent({frame(0x06E, kZero8), frame(0x067, {1, 0, 0, 0})});
    b.heartbeat(8);  // the request for closed loop was obeyed yet
    CHECK(b.drive.state() != DriveState::armed);
    b.cycles(50);
    b.check_sent({});
    b.cycle();
    b.check_sent({frame(0x067, {1, 0, 0, 0})});
}

TEST(OdriveArming, silence_while_arming_is_a_fault_once_it_is_heard_again) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    b.cycles(360);
    b.heartbeat(1);
    CHECK(b.drive.fault() == DriveFault::silent);
    CHECK(b.drive.state() == DriveState::fault);
}

// However the drive has come to be told: what it was told an earlier time counts for nothing.
TEST(OdriveArming, each_disarming_begins_anew) {
    enum class Way { asked, error, timed_out };
    for (const Way way : {Way::asked, Way::error, Way::timed_out}) {
        OdriveConfig c = config(OdriveGeneration::v0_6);
        c.arming_timeout_s = 0.2;
        Bench b(c);
        b.arm();
        b.drive.request_disarm();
        b.cycle();
        for (int i = 0; i < 30; ++i) {
            b.heartbeat(1);
            b.cycles(10);
        }
        if (way == Way::timed_out) {
            b.drive.request_arm();
            b.cycles(190);
            b.heartbeat(8, 2);  // closed loop with an error: not armed
            b.sent.count = 0;
        } else {
            b.arm();
            if (way == Way::asked) b.drive.request_disarm();
            if (way == Way::error) b.heartbeat(8, 2);
        }
        b.cycle();
        b.check_sent({frame(0x06E, kZero8), frame(0x067, {1, 0, 0, 0})});
        b.cycles(9);
        b.heartbeat(8);  // soon after: not yet repeated
        b.cycles(30);
        b.check_sent({});
        b.cycles(12);
        b.check_sent({frame(0x067, {1, 0, 0, 0})});
        CHECK(b.drive.fault() != DriveFault::disarm_failed);
    }
}

TEST(OdriveArming, a_second_arming_takes_every_step_again) {
    OdriveConfig c = config(OdriveGeneration::v0_6);
    c.watchdog_endpoint = 0x0123;
    Bench b(c);
    const auto answer = [&](int value) { b.receive(0x065, {0, 0x23, 0x01, 0, value, 0, 0, 0}); };
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    b.cycles(4);
    answer(0);  // the watchdog is off
    b.cycle();
    CHECK(b.drive.refusal() == ArmRefusal::watchdog_not_confirmed);
    b.sent.count = 0;
    for (int time = 0; time < 2; ++time) {  // it has been switched on
        if (time == 1) {                    // and the axis runs, told to be idle but not obeying
            b.drive.request_disarm();
            b.cycle();
            b.heartbeat(8);
            b.sent.count = 0;
        }
        b.drive.request_arm();
        b.cycle();
        CHECK(b.drive.refusal() == ArmRefusal::none);
        if (time == 1) {
            b.check_sent({frame(0x067, {1, 0, 0, 0})});
            b.heartbeat(1);
            b.cycle();
        }
        b.check_sent({frame(0x06B, {1, 0, 0, 0, 1, 0, 0, 0})});
        b.cycle();
        b.check_sent({frame(0x06E, kZero8)});
        b.cycle();
        b.check_sent({frame(0x064, {0, 0x23, 0x01, 0, 0, 0, 0, 0}), frame(0x06E, kZero8)});
        answer(1);
        b.cycle();
        b.check_sent({frame(0x06B, {1, 0, 0, 0, 1, 0, 0, 0}), frame(0x06E, kZero8)});
        b.cycle();
        b.check_sent({frame(0x067, {8, 0, 0, 0}), frame(0x06E, kZero8)});
        b.heartbeat(8);
        CHECK(b.drive.state() == DriveState::armed);
    }
}

TEST(OdriveArming, clearing_and_arming_in_one_cycle_are_both_done) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    b.receive(0x063, {0, 0, 0, 0, 0, 0, 0, 0x02});  // a reason that is told once
    b.cycle();
    b.drive.request_clear_errors();
    b.drive.request_arm();
    b.cycle();
    b.check_sent({frame(0x078, {0})});
    b.cycles(10);
    b.heartbeat(1);
    b.cycle();
    b.check_sent({frame(0x06B, {1, 0, 0, 0, 1, 0, 0, 0})});
}

TEST(OdriveArming, a_new_request_forgets_why_the_last_one_was_refused) {
    Bench b(config(OdriveGeneration::v0_6));
    b.drive.request_arm();
    b.cycle();
    CHECK(b.drive.refusal() == ArmRefusal::silent);
    b.heartbeat(1);
    b.drive.request_arm();
    b.cycle();
    CHECK(b.drive.refusal() == ArmRefusal::none);
}

TEST(OdriveArming, a_drive_that_stays_in_closed_loop_times_out_whatever_could_be_asked) {
    OdriveConfig c = config(OdriveGeneration::v0_6);
    c.watchdog_endpoint = 0x0123;
    c.arming_timeout_s = 0.1;
    Bench b(c);
    b.heartbeat(8);
    b.cycle();
    b.drive.request_arm();
    for (int i = 0; i < 12; ++i) {
        b.heartbeat(8);
        b.cycles(10);
    }
    CHECK(b.drive.refusal() == ArmRefusal::timed_out);
}

TEST(OdriveArming, questions_follow_each_other_at_once_and_an_answer_needs_its_question) {
    OdriveConfig c = config(OdriveGeneration::v0_6);
    c.watchdog_endpoint = 100;
    c.control_mode_endpoint = 102;
    Bench b(c);
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    b.cycles(3);
    b.sent.count = 0;
    b.receive(0x065, {0, 100, 0, 0, 1, 0, 0, 0});
    b.receive(0x065, {0, 102, 0, 0, 1, 0, 0, 0});  // nobody has asked for it yet
    b.cycle();
    b.check_sent({frame(0x064, {0, 102, 0, 0, 0, 0, 0, 0}), frame(0x06E, kZero8)});
}

// 0.5 feeds the watchdog for the heartbeat's time-out, or half of the arming's, and waits for a heartbeat.
TEST(OdriveArming, generation_0_5_waits_as_long_as_it_says) {
    OdriveConfig c = config(OdriveGeneration::v0_5);
    Bench unheard(c);
    unheard.heartbeat(1);
    unheard.cycle();
    unheard.drive.request_arm();
    unheard.cycles(2);
    unheard.heartbeat(1);  // too soon after the request
    unheard.cycles(340);
    unheard.sent.count = 0;
    unheard.cycles(10);
    for (std::size_t i = 0; i < unheard.sent.count; ++i) CHECK(unheard.sent.frames[i].id != 0x06B);
    c.arming_timeout_s = 0.6;
    Bench b(c);
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    b.cycle();
    int waited = 0;
    for (bool done = false; !done && waited < 1000; ++waited) {
        if (waited % 100 == 50) b.heartbeat(1);
        b.sent.count = 0;
        b.cycle();
        done = b.sent.frames[0].id == 0x06B;
    }
    CHECK_EQUAL(301, waited);
}

TEST(OdriveFaults, a_refused_frame_is_pushed_again_while_arming_and_while_clearing) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    b.cycle();
    b.drive.request_arm();
    for (int time = 0; time < 2; ++time) {
        b.cycle();
        b.check_sent({frame(0x06B, {1, 0, 0, 0, 1, 0, 0, 0})});
        if (time == 0) CHECK(b.drive.refused(frame(0x06B, {1, 0, 0, 0, 1, 0, 0, 0})));
    }
    Bench clearing(config(OdriveGeneration::v0_6));
    clearing.heartbeat(1, 2);
    clearing.cycle();
    clearing.drive.request_clear_errors();
    for (int time = 0; time < 2; ++time) {
        clearing.cycle();
        clearing.check_sent({frame(0x078, {0})});
        if (time == 0) CHECK(clearing.drive.refused(frame(0x078, {0})));
    }
    clearing.drive.refused(frame(0x06E, kZero8));
    clearing.cycle();
    clearing.check_sent({});
    // An idle that was refused is not confirmed by a heartbeat that came meanwhile.
    Bench idle(config(OdriveGeneration::v0_6));
    idle.arm();
    idle.drive.request_disarm();
    idle.cycle();
    idle.drive.refused(frame(0x067, {1, 0, 0, 0}));
    idle.heartbeat(1);
    idle.sent.count = 0;
    idle.cycle();
    idle.check_sent({frame(0x06E, kZero8), frame(0x067, {1, 0, 0, 0})});
}

TEST(OdriveConfiguration, limits_and_endpoints_reach_the_drive) {
    model::RobotParameters p = model::default_parameters();
    p.drive.heartbeat_timeout_s = 0.21;
    p.drive.arming_timeout_s = 1.3;
    p.drive.watchdog_timeout_s = 0.03;
    p.limits.torque_Nm = 3.5;
    p.drive.watchdog_timeout_endpoint = 392;
    p.drive.control_mode_endpoint = 393;
    p.drive.input_mode_endpoint = 394;
    const OdriveConfig c = odrive_config(p, Wheel::right);
    DOUBLES_EQUAL(0.21, c.heartbeat_timeout_s, 0);
    DOUBLES_EQUAL(1.3, c.arming_timeout_s, 0);
    DOUBLES_EQUAL(0.03, c.watchdog_timeout_s, 0);
    DOUBLES_EQUAL(3.5, c.torque_limit_Nm, 0);
    CHECK_EQUAL(392, c.watchdog_timeout_endpoint);
    CHECK_EQUAL(393, c.control_mode_endpoint);
    CHECK_EQUAL(394, c.input_mode_endpoint);
}

TEST(OdriveConfiguration, the_listed_frames_are_those_of_the_generation_and_their_way) {
    for (const OdriveGeneration generation : kGenerations) {
        OdriveConfig c = config(generation);
        c.supply_period_s = c.temperature_period_s = 0.1;
        const OdriveDrive drive(c);
        for (const DriveFrame& f : drive.frames()) {
            CHECK_EQUAL(f.name == "Set_Input_Torque", f.to_drive);
            CHECK_FALSE(f.extended);
        }
        CHECK(drive.frames()[2].name == (generation == OdriveGeneration::v0_5 ? "Get_Iq" : "Get_Torques"));
    }
}

// A step of the coarsest encoder is 0.0977 turns of this motor, a wheel that covers it in 0.1 s turns it by
// 0.977 turns a second.
TEST(OdriveFaults, a_drive_counts_anew_after_a_gap_where_it_cannot_have_gone_from_where_it_was) {
    struct Case {
        float rev, speed_rev_per_s;  // before the gap, and 4 ms later:
        float next_rev, next_rev_per_s;
        bool anew;
    };
    for (const Case& each : {
             Case{0.5F, 0, 0.597F, 0, false},     // less than a step
             Case{0.5F, 0, 0.598F, 0, true},      // more
             Case{3, -10, 0.25F, -10, true},      // 0.04 were expected
             Case{0.2F, 20, 0.36F, 20, false},    // it went at twice its speed
             Case{5, 0, 1, 0, true},              // within the first turn
             Case{5, 0, 1.5F, 0, false},          // beyond it
             Case{0.05F, 1, 0, 0, true},          // stops dead at 0
             Case{0.05F, 0.9F, 0, 0, false},      // from a speed that may end so
             Case{0.05F, 2, 0.05F, 0, false},     // not at 0
             Case{0.05F, 2, 0, 1, false},         // does not stop
             Case{-0.05F, -2, -0.05F, -2, false}  // no motion: a step at most
         }) {
        Bench b(config(OdriveGeneration::v0_6));
        b.arm();
        b.drive.accept({with_floats(0x069, each.rev, each.speed_rev_per_s), b.now});
        b.drive.accept({with_floats(0x069, each.next_rev, each.next_rev_per_s), b.now + 4 * kMs});
        CHECK(b.drive.fault() == (each.anew ? DriveFault::left_armed : DriveFault::none));
        // Meanwhile it has gone on.
        const double rev = each.anew ? each.rev + 0.004 * each.speed_rev_per_s : each.next_rev;
        DOUBLES_EQUAL(rev, -b.drive.feedback().position_rad * 6.25 / (2 * kPi), 1e-6);
    }
}

TEST(OdriveFaults, a_drive_is_away_after_5_ms_and_only_a_new_count_is_a_fault_of_one_that_works) {
    for (const std::uint32_t report : {0x069U, 0x07CU}) {
        for (const std::int64_t late_ns : {0, 1}) {
            Bench b(config(OdriveGeneration::v0_6));
            b.heartbeat(1);
            b.drive.accept({with_floats(0x069, 0.5F, 0), b.now});
            b.drive.accept({with_floats(report, 0.5F, 0), b.now + 5 * kMs + late_ns});
            b.cycle();
            CHECK_EQUAL(late_ns == 0 ? 0U : 2U, b.sent.count);
        }
        Bench armed(config(OdriveGeneration::v0_6));
        armed.arm();
        armed.encoder(0.5F, 0);
        armed.cycles(10);
        armed.drive.accept({with_floats(report, 0.5F, 0), armed.now});
        CHECK(armed.drive.state() == DriveState::armed);
    }
    Bench arming(config(OdriveGeneration::v0_6));
    arming.heartbeat(1);
    arming.drive.request_arm();
    arming.encoder(3, 0);
    arming.cycles(10);
    arming.receive(0x07C, kZero8);
    CHECK(arming.drive.state() == DriveState::arming);
    arming.encoder(3, 0);
    arming.cycles(3);
    arming.encoder(0.5F, 0);
    CHECK(arming.drive.refusal() == ArmRefusal::silent);
    arming.heartbeat(8);
    CHECK(arming.drive.state() != DriveState::armed);
}

TEST(OdriveFeedback, a_drive_that_was_told_to_count_anew_and_does_after_a_gap_was_not_away) {
    Bench b(config(OdriveGeneration::v0_6));
    b.heartbeat(1);
    for (int i = 0; i < 10; ++i) b.drive.accept({with_floats(0x069, -1100, 0), b.now});
    b.cycle();
    b.check_sent({frame(0x079, kZero8)});
    b.cycles(2);
    b.drive.accept({with_floats(0x069, 0.25F, 0), b.now});
    DOUBLES_EQUAL(1100 * 2 * kPi / 6.25, b.drive.feedback().position_rad, 1e-9);
    b.cycle();
    b.check_sent({});
}

// The story: an old drive that ignored the order went far and came back. Its way back was taken for the new
// count, and the angle leapt by hundreds of turns.
TEST(OdriveFeedback, a_drive_that_does_not_count_anew_and_comes_back_by_itself_is_where_it_says) {
    for (const float way : {1.F, -1.F}) {
        Bench b(config(OdriveGeneration::v0_6));
        const auto told_at = [&](float rev, float speed_rev_per_s = 0) {
            b.drive.accept({with_floats(0x069, way * rev, way * speed_rev_per_s), b.now});
            b.cycle();
            return -way * b.drive.feedback().position_rad * 6.25 / (2 * kPi);
        };
        const auto goes_far = [&] {
            b.heartbeat(1);
            told_at(1000);
            b.sent.count = 0;
            for (int i = 0; i < 8; ++i) told_at(1100);
            b.check_sent({frame(0x079, kZero8)});
        };
        goes_far();
        for (const float rev : {1000.F, 760.F, 510.F}) DOUBLES_EQUAL(rev, told_at(rev), 1e-9);
        goes_far();  // it is told again
        told_at(760);
        DOUBLES_EQUAL(1100 + 0.002 * 100, told_at(500, 100), 1e-9);  // 2 ms after it was far
    }
}

// Who reads a log tells the driver what was sent.
TEST(OdriveFeedback, an_order_to_count_anew_that_was_sent_counts_for_this_drive_and_far_from_its_origin) {
    struct Case {
        float rev;
        std::uint32_t id;
        bool goes_on;
    };
    for (const OdriveGeneration generation : kGenerations) {
        for (const Case& each : {Case{1100, 0x079, true}, Case{300, 0x079, false}, Case{1100, 0x099, false},
                                 Case{1100, 0x078, false}, Case{1100, 0x0D9, false}}) {
            Bench b(config(generation));
            for (int i = 0; i < 2; ++i) b.drive.accept({with_floats(0x069, each.rev, 0), b.now});
            b.drive.was_sent(frame(each.id, kZero8));
            b.drive.accept({with_floats(0x069, 0.5F, 0), b.now});
            const double rev = -b.drive.feedback().position_rad * 6.25 / (2 * kPi);
            DOUBLES_EQUAL(each.goes_on ? each.rev : 0.5, rev, 1e-9);
        }
    }
}

TEST(OdriveArming, what_makes_it_idle_can_be_had_at_any_time) {
    for (const OdriveGeneration generation : kGenerations) {
        Bench b(config(generation));
        b.drive.push_idle(b.sent);
        b.check_sent({frame(0x06E, kZero8), frame(0x067, {1, 0, 0, 0})});
        b.arm();
        b.drive.push_idle(b.sent);
        b.check_sent({frame(0x06E, kZero8), frame(0x067, {1, 0, 0, 0})});
    }
}
