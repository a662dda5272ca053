// The simulated drive against the CANSimple description, with frames written by hand, and against formulas.
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <initializer_list>

#include "sim_hal/sim_odrive.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using sim::SimOdrive;
using sim::SimOdriveConfig;

namespace {

constexpr double kTwoPi = 6.283185307179586;
constexpr std::int64_t kMs = 1'000'000;

struct Recorder final : drivers::FrameSink {
    void push(const hal::CanFrame& frame) override {
        last[frame.id & 0x1FU] = frame;
        ++count[frame.id & 0x1FU];
        node = frame.id >> 5U;
    }
    std::array<hal::CanFrame, 32> last;
    std::array<int, 32> count{};
    std::uint32_t node = 0;
};

SimOdriveConfig config(int generation) {
    SimOdriveConfig c;
    c.generation = generation;
    c.node = 3;
    c.sign = -1;
    c.gear_ratio = 6.25;
    c.torque_constant_Nm_per_A = 0.0625;
    c.torque_noise_Nm = 0;
    c.encoder_noise_rad = 0;
    c.command_latency_s = 0;
    c.heartbeat_period_ms = 10;
    c.watchdog_timeout_s = 0.05;
    return c;
}

float float_at(const hal::CanFrame& frame, std::size_t at) {
    float value = 0;
    std::memcpy(&value, frame.data.data() + at, sizeof value);
    return value;
}

struct Bench {
    explicit Bench(const SimOdriveConfig& c) : drive(c, 0) {}

    void send(std::uint32_t id, std::initializer_list<int> bytes, bool remote = false) {
        hal::CanFrame frame;
        frame.id = id;
        frame.length = static_cast<std::uint8_t>(bytes.size());
        frame.remote = remote;
        std::size_t i = 0;
        for (const int byte : bytes) frame.data[i++] = static_cast<std::uint8_t>(byte);
        drive.receive(frame, now, out);
    }
    void torque(float motor_Nm) {
        std::array<unsigned char, 4> b{};
        std::memcpy(b.data(), &motor_Nm, 4);
        send(0x06E, {b[0], b[1], b[2], b[3], 0, 0, 0, 0});
    }
    // Runs the drive on a wheel at `speed`, its torque going nowhere.
    void advance(std::int64_t until_ns, bool feed = false) {
        while (drive.next_event_ns() <= until_ns) {
            const std::int64_t at = drive.next_event_ns();
            mean_torque = drive.advance_torque(static_cast<double>(at - now) * 1e-9);
            angle += speed * static_cast<double>(at - now) * 1e-9;
            now = at;
            drive.run_event(angle, speed, out);
            if (feed && at > fed_at) torque(fed_torque);
            fed_at = at;
        }
        mean_torque = drive.advance_torque(static_cast<double>(until_ns - now) * 1e-9);
        angle += speed * static_cast<double>(until_ns - now) * 1e-9;
        now = until_ns;
    }
    void advance_ms(int ms, bool feed = false) { advance(now + ms * kMs, feed); }
    void arm() {
        send(0x078, {0});
        send(0x06B, {1, 0, 0, 0, 1, 0, 0, 0});
        torque(0);
        send(0x067, {8, 0, 0, 0});
        advance_ms(6, true);
        CHECK(drive.armed());
    }

    SimOdrive drive;
    Recorder out;
    std::int64_t now = 0;
    double angle = 0;
    double speed = 0;
    double mean_torque = 0;
    float fed_torque = 0;
    std::int64_t fed_at = 0;
};

}  // namespace

TEST_GROUP(SimDrive){};

TEST(SimDrive, heartbeat_and_encoder_come_at_their_periods_on_the_drives_own_clock) {
    SimOdriveConfig c = config(6);
    c.clock_error_ppm = 1000;
    c.phase_ns = 300'000;
    Bench b(c);
    b.advance(1000 * kMs);
    CHECK_EQUAL(3U, b.out.node);
    // Milliseconds of 1.001 ms from 0.3 ms on.
    CHECK_EQUAL(999, b.out.count[0x09]);
    CHECK(std::abs(b.out.count[0x01] - 100) <= 1);
    CHECK(std::abs(b.out.count[0x1C] - 100) <= 1);
    CHECK_EQUAL(0, b.out.count[0x14]);
    CHECK_EQUAL(300'000 + 999 * 1'001'000, b.drive.next_event_ns());
}

TEST(SimDrive, generation_0_5_reports_current_instead_of_torque) {
    Bench b(config(5));
    b.fed_torque = 0.25F;
    b.arm();
    b.advance_ms(50, true);
    CHECK_EQUAL(0, b.out.count[0x1C]);
    DOUBLES_EQUAL(0.25 / 0.0625, float_at(b.out.last[0x14], 0), 1e-6);
    DOUBLES_EQUAL(0.25 / 0.0625, float_at(b.out.last[0x14], 4), 1e-6);
}

TEST(SimDrive, closed_loop_is_refused_while_an_error_stands) {
    Bench b(config(6));
    b.drive.raise_error(0x100);
    b.send(0x067, {8, 0, 0, 0});
    b.advance_ms(20);
    CHECK(!b.drive.armed());
    CHECK_EQUAL(0x01, b.out.last[0x01].data[1]);
    CHECK_EQUAL(1, b.out.last[0x01].data[4]);
    b.send(0x078, {0});
    b.send(0x067, {8, 0, 0, 0});
    b.advance_ms(20);
    CHECK(b.drive.armed());
    CHECK_EQUAL(8, b.out.last[0x01].data[4]);
}

TEST(SimDrive, an_old_input_torque_acts_on_arming_when_the_order_is_not_kept) {
    Bench b(config(6));
    b.send(0x06B, {1, 0, 0, 0, 1, 0, 0, 0});
    b.torque(0.5F);
    b.send(0x067, {8, 0, 0, 0});
    b.advance_ms(10);
    DOUBLES_EQUAL(-0.5 * 6.25, b.drive.torque_target_Nm(), 1e-6);
}

// A set-point of torque is then added to what holds the axis.
TEST(SimDrive, without_torque_mode_the_axis_is_held) {
    Bench b(config(6));
    b.send(0x067, {8, 0, 0, 0});
    b.torque(0.5F);
    b.advance_ms(10);
    CHECK(b.drive.armed());
    DOUBLES_EQUAL(-0.5 * 6.25, b.drive.torque_target_Nm(), 1e-6);
    b.torque(0);
    b.angle += 0.05;  // by hand
    b.advance_ms(10);
    CHECK(b.drive.torque_target_Nm() < -0.01);
}

TEST(SimDrive, torque_follows_a_first_order_lag_after_the_latency) {
    SimOdriveConfig c = config(6);
    c.command_latency_s = 0.0002;
    c.torque_lag_s = 0.0007;
    c.torque_scale = 0.9;
    c.phase_ns = 900'000;
    Bench b(c);
    b.arm();
    const std::int64_t sent = b.now;
    b.torque(-0.4F);
    const double full = 0.4 * 6.25 * 0.9;
    double integral = 0;
    for (int us = 50; us <= 1500; us += 50) {
        b.advance(sent + us * 1000);
        if (us <= 200) DOUBLES_EQUAL(0, b.mean_torque, 0);
        // advance() may have been cut by an event: compare only pieces without one.
        const double end = us * 1e-6 - 0.0002;
        if (us > 200 && b.mean_torque > 0) {
            const double from = end - 50e-6;
            const double mean =
                full * (1 - 0.0007 / 50e-6 * (std::exp(-from / 0.0007) - std::exp(-end / 0.0007)));
            if (std::fabs(b.mean_torque - mean) < 1e-6) integral += 1;
        }
    }
    CHECK(integral >= 23);  // of 26 pieces; a millisecond's event cuts one or two of them
}

TEST(SimDrive, torque_is_limited_by_the_current_limit) {
    SimOdriveConfig c = config(6);
    c.current_limit_A = 8;
    Bench b(c);
    b.fed_torque = 3;
    b.arm();
    DOUBLES_EQUAL(-8 * 0.0625 * 6.25, b.drive.torque_target_Nm(), 1e-9);
}

TEST(SimDrive, torque_noise_has_the_configured_size_and_only_while_armed) {
    SimOdriveConfig c = config(6);
    c.torque_noise_Nm = 0.02;
    Bench b(c);
    b.advance_ms(5);
    DOUBLES_EQUAL(0, b.mean_torque, 0);
    b.arm();
    double square = 0;
    for (int i = 0; i < 20000; ++i) {
        b.advance_ms(1, true);
        square += b.mean_torque * b.mean_torque;
    }
    DOUBLES_EQUAL(0.02, std::sqrt(square / 20000), 0.0006);
}

TEST(SimDrive, the_velocity_filter_answers_a_step_with_two_equal_poles) {
    SimOdriveConfig c = config(6);
    c.counts_per_turn = 0;  // ideal
    c.filter_bandwidth_rad_per_s = 700;
    Bench b(c);
    b.advance_ms(3);
    const std::int64_t start = b.drive.next_event_ns();
    b.advance(start);
    b.speed = 4;
    const double motor = -4 * 6.25 / kTwoPi;
    for (int ms = 1; ms <= 6; ++ms) {
        b.advance(start + ms * kMs);
        const double bt = 700 * ms * 1e-3;
        // The cubic between milliseconds knows the new speed a little early, and readings are 1/8 ms apart.
        const double expected = motor * (1 - (1 + bt) * std::exp(-bt));
        if (ms > 1) DOUBLES_EQUAL(expected, float_at(b.out.last[0x09], 4), 0.04 * std::fabs(motor));
    }
    b.advance_ms(20);
    DOUBLES_EQUAL(motor, float_at(b.out.last[0x09], 4), 1e-4);
}

TEST(SimDrive, encoder_position_is_quantised_to_counts_with_the_error_of_rounding) {
    SimOdriveConfig c = config(6);
    c.counts_per_turn = 512;
    Bench b(c);
    double sum = 0;
    double square = 0;
    double worst = 0;
    constexpr int kPlaces = 2000;
    for (int i = 0; i < kPlaces; ++i) {
        b.angle = 0.0371 * i;  // stands there; far more than a count apart
        b.advance_ms(25);
        const double counts = b.angle * -6.25 / kTwoPi * 512;
        const double error = static_cast<double>(float_at(b.out.last[0x09], 0)) * 512 - counts;
        sum += error;
        square += error * error;
        worst = std::fmax(worst, std::fabs(error));
    }
    const double rms = std::sqrt(square / kPlaces);
    std::printf("encoder: mean error %.3f, rms %.3f, worst %.3f counts\n", sum / kPlaces, rms, worst);
    // True place and estimate each lie anywhere in the same count: rms sqrt(1/12 + 1/12) at most 1 apart.
    CHECK(worst <= 1.01);
    DOUBLES_EQUAL(std::sqrt(1.0 / 6), rms, 0.05);
}

TEST(SimDrive, reports_may_come_in_counts_of_a_coarse_encoder) {
    SimOdriveConfig c = config(6);
    c.counts_per_turn = 0;
    c.report_counts_per_wheel_turn = 1024;
    Bench b(c);
    b.speed = 5.3;
    b.advance_ms(100);
    const double motor_step = c.gear_ratio / (1024 * 0.010);  // turns a second
    const double true_speed = -5.3 * c.gear_ratio / kTwoPi;
    DOUBLES_EQUAL(motor_step * std::round(true_speed / motor_step), float_at(b.out.last[9], 4), 1e-5);
    const double counts = float_at(b.out.last[9], 0) * 1024 / c.gear_ratio;
    DOUBLES_EQUAL(std::round(counts), counts, 1e-3);
    DOUBLES_EQUAL(b.angle * 1024 / kTwoPi, -counts, 7);
}

TEST(SimDrive, a_speed_may_be_reported_late) {
    SimOdriveConfig c = config(6);
    c.counts_per_turn = 0;
    c.report_lag_s = 0.05;
    Bench b(c);
    b.speed = -5.3;
    b.advance_ms(120);
    // behind the drive's own filter of 2 ms
    const double settled = 1 - std::exp(-(0.120 - 0.002) / 0.05);
    DOUBLES_EQUAL(settled * 5.3 * c.gear_ratio / kTwoPi, float_at(b.out.last[9], 4), 0.02);
}

TEST(SimDrive, encoder_noise_reaches_the_speed_as_the_filter_says) {
    SimOdriveConfig c = config(6);
    c.counts_per_turn = 0;
    c.encoder_noise_rad = 0.0002;
    c.filter_bandwidth_rad_per_s = 500;
    Bench b(c);
    double square = 0;
    constexpr int kCount = 40'000;
    for (int i = 0; i < kCount; ++i) {
        b.advance_ms(1);
        const double wheel = static_cast<double>(float_at(b.out.last[0x09], 4)) * kTwoPi / 6.25;
        square += wheel * wheel;
    }
    // White noise of density sigma^2 dt through b^2 s / (s + b)^2: variance sigma^2 dt b^3 / 4.
    const double expected = 0.0002 * std::sqrt(125e-6 * 500.0 * 500.0 * 500.0 / 4);
    std::printf("speed noise: %.4f rad/s, formula %.4f\n", std::sqrt(square / kCount), expected);
    DOUBLES_EQUAL(expected, std::sqrt(square / kCount), 0.06 * expected);
}

TEST(SimDrive, position_loses_resolution_as_a_float_does) {
    SimOdriveConfig c = config(6);
    Bench b(c);
    b.angle = -9000.3 * kTwoPi / 6.25;  // 9000.3 motor turns
    b.advance_ms(100);
    const double position = static_cast<double>(float_at(b.out.last[0x09], 0));
    DOUBLES_EQUAL(9000.3, position, 1e-3);
    DOUBLES_EQUAL(0, std::fmod(position, 1.0 / 1024), 0);  // floats between 8192 and 16384 are 2^-10 apart
}

TEST(SimDrive, the_frozen_encoder_stands_still_and_thaws) {
    Bench b(config(6));
    b.speed = 3;
    b.advance_ms(100);
    b.drive.faults().frozen_encoder = true;
    b.advance_ms(100);
    DOUBLES_EQUAL(0, float_at(b.out.last[0x09], 4), 0);
    const float stuck = float_at(b.out.last[0x09], 0);
    b.advance_ms(100);
    DOUBLES_EQUAL(static_cast<double>(stuck), static_cast<double>(float_at(b.out.last[0x09], 0)), 1e-4);
    b.drive.faults().frozen_encoder = false;
    b.advance_ms(100);
    DOUBLES_EQUAL(-3 * 6.25 / kTwoPi, float_at(b.out.last[0x09], 4), 0.02);
}

TEST(SimDrive, a_reversed_encoder_counts_the_other_way_from_where_it_is_and_back) {
    Bench b(config(6));
    b.speed = 3;
    const double turns_per_ms = -3e-3 * 6.25 / kTwoPi;
    b.advance_ms(100);
    const float before = float_at(b.out.last[0x09], 0);
    b.drive.reverse_encoder();
    b.advance_ms(100);
    DOUBLES_EQUAL(static_cast<double>(before) - 100 * turns_per_ms,
                  static_cast<double>(float_at(b.out.last[0x09], 0)), std::abs(8 * turns_per_ms));
    DOUBLES_EQUAL(3 * 6.25 / kTwoPi, float_at(b.out.last[0x09], 4), 0.02);
    b.drive.reverse_encoder();
    b.advance_ms(100);
    DOUBLES_EQUAL(static_cast<double>(before), static_cast<double>(float_at(b.out.last[0x09], 0)),
                  std::abs(16 * turns_per_ms));
    DOUBLES_EQUAL(-3 * 6.25 / kTwoPi, float_at(b.out.last[0x09], 4), 0.02);
}

TEST(SimDrive, estop_and_unplugging_end_closed_loop_with_and_without_an_error) {
    for (const int generation : {5, 6}) {
        Bench b(config(generation));
        b.arm();
        b.send(0x062, {});
        CHECK(!b.drive.armed());
        CHECK_EQUAL(generation == 5 ? 0x4000U : 0x02000000U, b.drive.error_bits());
        b.arm();
        b.drive.faults().motor_unplugged = true;
        b.advance_ms(15, true);
        CHECK(!b.drive.armed());
        CHECK_EQUAL(0U, b.drive.error_bits());
        CHECK_EQUAL(1, b.out.last[0x01].data[4]);
        CHECK_EQUAL(0, b.out.last[0x01].data[0]);
    }
}

TEST(SimDrive, a_mute_drive_obeys_and_a_deaf_one_talks) {
    Bench b(config(6));
    b.drive.faults().mute = true;
    b.arm();
    CHECK_EQUAL(0, b.out.count[0x01] + b.out.count[0x09]);
    b.drive.faults() = {};
    b.drive.faults().deaf = true;
    b.advance_ms(30, true);
    CHECK(b.out.count[0x09] > 25);
    b.advance_ms(40, true);
    CHECK(!b.drive.armed());  // heard nothing: watchdog
    CHECK_EQUAL(0x01000000U, b.drive.error_bits());
}

TEST(SimDrive, switched_off_and_on_it_is_idle_at_position_zero) {
    Bench b(config(6));
    b.speed = 2;
    b.arm();
    b.advance_ms(300, true);
    b.drive.faults().powered_off = true;
    b.out.count = {};
    b.advance_ms(50);
    CHECK_EQUAL(0, b.out.count[0x09]);
    b.speed = 0;
    b.advance_ms(5);
    b.drive.faults().powered_off = false;
    b.advance_ms(20);
    CHECK(!b.drive.armed());
    DOUBLES_EQUAL(0, float_at(b.out.last[0x09], 0), 2e-4);
}

TEST(SimDrive, remote_requests_are_answered) {
    Bench b(config(6));
    for (const std::uint32_t command : {0x00U, 0x03U, 0x09U, 0x14U, 0x15U, 0x17U, 0x1CU}) {
        b.out.count = {};
        b.send(0x060 | command, {}, true);
        CHECK_EQUAL(1, b.out.count[command]);
    }
    DOUBLES_EQUAL(24, float_at(b.out.last[0x17], 0), 0);
}

TEST(SimDrive, the_endpoint_tells_and_sets_whether_the_watchdog_is_on) {
    SimOdriveConfig c = config(6);
    c.watchdog_endpoint = 0x0187;
    Bench b(c);
    b.send(0x064, {0, 0x87, 0x01, 0, 0, 0, 0, 0});
    CHECK_EQUAL(1, b.out.count[0x05]);
    CHECK_EQUAL(0x87, b.out.last[0x05].data[1]);
    CHECK_EQUAL(0x01, b.out.last[0x05].data[2]);
    CHECK_EQUAL(1, b.out.last[0x05].data[4]);
    b.send(0x064, {1, 0x87, 0x01, 0, 0, 0, 0, 0});
    b.send(0x064, {0, 0x87, 0x01, 0, 0, 0, 0, 0});
    CHECK_EQUAL(0, b.out.last[0x05].data[4]);
    b.send(0x064, {0, 0x88, 0x01, 0, 0, 0, 0, 0});
    CHECK_EQUAL(2, b.out.count[0x05]);
}

TEST(SimDrive, frames_that_make_no_sense_are_counted_and_change_nothing) {
    Bench b(config(6));
    b.fed_torque = 0.25F;
    b.arm();
    b.send(0x06E, {0, 0, 0xC0, 0x7F, 0, 0, 0, 0});  // NaN
    b.send(0x06E, {0, 0, 0});
    b.send(0x067, {1});
    CHECK_EQUAL(3U, b.drive.bad_frames());
    CHECK(b.drive.armed());
    DOUBLES_EQUAL(-0.25 * 6.25, b.drive.torque_target_Nm(), 1e-9);
}

TEST_GROUP(SimDriveWatchdog){};

TEST(SimDriveWatchdog, silence_of_the_host_ends_the_torque_within_time_out_and_a_millisecond) {
    for (const int generation : {5, 6}) {
        Bench b(config(generation));
        b.fed_torque = 0.5F;
        b.arm();
        b.torque(0.5F);
        b.advance_ms(49);
        CHECK(b.drive.armed());
        CHECK(b.mean_torque < -3);
        b.advance_ms(3);
        CHECK(!b.drive.armed());
        DOUBLES_EQUAL(0, b.mean_torque, 0);
        CHECK_EQUAL(generation == 5 ? 0x800U : 0x01000000U, b.drive.error_bits());
    }
}

TEST(SimDriveWatchdog, in_0_5_polling_alone_keeps_an_old_torque_alive_and_in_0_6_it_does_not) {
    for (const int generation : {5, 6}) {
        Bench b(config(generation));
        b.fed_torque = 0.5F;
        b.arm();
        for (int i = 0; i < 100; ++i) {
            b.send(0x069, {}, true);
            b.advance_ms(1);
        }
        CHECK_EQUAL(generation == 5, b.drive.armed());
    }
}

TEST(SimDriveWatchdog, it_counts_while_idle_in_0_5_only) {
    for (const int generation : {5, 6}) {
        Bench b(config(generation));
        b.advance_ms(60);
        CHECK_EQUAL(generation == 5 ? 0x800U : 0U, b.drive.error_bits());
    }
}

TEST(SimDriveWatchdog, switched_off_it_never_trips) {
    SimOdriveConfig c = config(6);
    c.watchdog_enabled = false;
    Bench b(c);
    b.fed_torque = 0.5F;
    b.arm();
    b.advance_ms(2000);
    CHECK(b.drive.armed());
}

TEST(SimDriveWatchdog, frames_to_other_nodes_do_not_feed) {
    Bench b(config(5));
    b.arm();
    for (int i = 0; i < 60; ++i) {
        b.send(0x08E, {0, 0, 0, 0, 0, 0, 0, 0});
        b.advance_ms(1);
    }
    CHECK(!b.drive.armed());
}
