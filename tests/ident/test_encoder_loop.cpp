// A drive's encoder loop is written here as drives compute it, on angles; its reports are what the estimator
// of its lag gets, and their second differences what torques behind the loop must come out as.
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "firmware/ident/encoder_loop.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright::ident;

namespace {

constexpr double kPeriod_s = 1.0 / 8000, kCycle_s = 0.001;
constexpr int kPeriods = 8;  // in a cycle

struct DriveLoop {
    double bandwidth_rad_per_s;
    double position_rad = 0, speed_rad_per_s = 0;

    void take(double angle_rad) {
        position_rad += kPeriod_s * speed_rad_per_s;
        const double off = angle_rad - position_rad;
        position_rad += 2 * bandwidth_rad_per_s * kPeriod_s * off;
        speed_rad_per_s += bandwidth_rad_per_s * bandwidth_rad_per_s * kPeriod_s * off;
    }
};

// An acceleration that jumps every 20 cycles, as the excitation's does.
struct Wheel {
    std::mt19937 random{7};
    double rate_rad_per_s2 = 0, angle_rad = 0, before_rad = 0;
    int cycles = 0;

    void begin_cycle() {
        if (cycles++ % 20 == 0) rate_rad_per_s2 = std::uniform_real_distribution(-90.0, 90.0)(random);
    }
    void step() {
        const double next = 2 * angle_rad - before_rad + kPeriod_s * kPeriod_s * rate_rad_per_s2;
        before_rad = angle_rad;
        angle_rad = next;
    }
};

}  // namespace

TEST_GROUP(EncoderLoop){};

TEST(EncoderLoop, its_lag_is_read_from_reports_of_a_noisy_encoder_with_some_missing) {
    for (const double bandwidth : {60.0, 100.0, 330.0, 1000.0, 2100.0}) {
        Wheel wheel;
        DriveLoop loop{bandwidth};
        std::normal_distribution noise(0.0, 3e-4);
        EncoderLoopLag lag;
        DOUBLES_EQUAL(0, lag.lag_s(kPeriod_s), 0);
        for (int cycle = 1; cycle <= 20'000; ++cycle) {
            wheel.begin_cycle();
            for (int i = 0; i < kPeriods; ++i) {
                wheel.step();
                loop.take(wheel.angle_rad + noise(wheel.random));
            }
            if (cycle % 41 == 0) continue;
            const auto time_ns = std::int64_t{1'000'000} * cycle;
            lag.take(loop.position_rad, loop.speed_rad_per_s, time_ns, kCycle_s);
            lag.take(loop.position_rad, loop.speed_rad_per_s, time_ns, kCycle_s);  // seen twice, counts once
        }
        DOUBLES_EQUAL(1, bandwidth * lag.lag_s(kPeriod_s), 0.01);
    }
}

TEST(EncoderLoop, a_torque_behind_it_is_what_the_reports_show_of_the_acceleration) {
    for (const double bandwidth : {60.0, 100.0, 330.0, 1000.0, 2100.0}) {
        Wheel wheel;
        DriveLoop loop{bandwidth};
        ThroughEncoderLoop<double> through;
        through.configure(1 / bandwidth, kPeriod_s, kCycle_s);
        double last = 0, before_last = 0;  // positions, a period apart
        double largest_off = 0, largest = 0;
        for (int cycle = 0; cycle < 2000; ++cycle) {
            wheel.begin_cycle();
            double shown = 0;
            for (int i = 0; i < kPeriods; ++i) {
                wheel.step();
                loop.take(wheel.angle_rad);
                shown += (loop.position_rad - 2 * last + before_last) / (kPeriod_s * kPeriod_s) / kPeriods;
                before_last = last;
                last = loop.position_rad;
            }
            const double made = through.mean(wheel.rate_rad_per_s2);
            largest_off = std::max(largest_off, std::abs(made - shown));
            largest = std::max(largest, std::abs(wheel.rate_rad_per_s2 - shown));
        }
        DOUBLES_EQUAL(0, largest_off, 1e-3);
        CHECK(largest > 1);  // without the loop they differ
    }
}

TEST(EncoderLoop, one_that_is_not_known_changes_nothing) {
    ThroughEncoderLoop<float> through;
    DOUBLES_EQUAL(3, through.mean(3), 0);
    through.configure(0, kPeriod_s, kCycle_s);
    for (const float torque : {1.5F, -0.25F, 2.0F}) DOUBLES_EQUAL(torque, through.mean(torque), 0);
}
