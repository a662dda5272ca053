// Drawn robots whose encoders report less often than each cycle, through the firmware as it is. With samples
// as old as one period and a millisecond many that report each 5 ms ended with `delay_not_found`.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <utility>

#include "tools/strangers/trial.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;

TEST_GROUP(SlowReports){};

TEST(SlowReports, are_enough_to_identify_and_drive) {
    for (const std::int64_t period_ms : {2, 5, 10}) {
        int robots = 0, number = 0;
        double worst = 0, slowest = 0;
        while (robots < 2) {
            const DrawnRobot robot = draw_robot(4711, ++number);
            if (robot.report_period_ms != period_ms) continue;
            ++robots;
            const RobotResult result = run_trial(robot, {"", true});
            CHECK(result.identified);
            CHECK(result.driving && result.driving->blocker.empty());
            worst = std::max(worst, result.worst_error());
            const Driving& driving = *result.driving;
            slowest = std::max({slowest, driving.forward.settling_s / driving.settling_aim_s,
                                driving.turning.settling_s / driving.settling_aim_s});
        }
        std::printf("each %d ms: K7, K8 within %.2f %%, steps settle in %.2f of the time\n",
                    static_cast<int>(period_ms), 100 * worst, slowest);
        CHECK(worst < 0.02);
        CHECK(slowest <= 1);
    }
}

// By pulses whose first reports told of the torque before, these were called clipped.
TEST(SlowReports, of_ten_milliseconds_do_not_look_like_drives_that_clip) {
    for (const auto& [seed, number] : {std::pair{44863883U, 60}, {3840165189U, 87}, {2073226816U, 81}}) {
        const DrawnRobot robot = draw_robot(seed, number);
        CHECK(!robot.clips && robot.report_period_ms == 10);
        const RobotResult result = run_trial(robot, {"", false});
        CHECK(result.identified);
        DOUBLES_EQUAL(0, result.clipped_s, 0);
    }
}

// Robots that may turn slowly only, so that friction is half of the torque: the sign of a speed that is only
// seen each 10 ms was trusted as if only the encoders' noise hid it, and K7 was 1 to 3 % low.
TEST(SlowReports, of_ten_milliseconds_hide_when_a_wheel_turns_round) {
    double worst = 0, worst_z = 0;
    for (const int number : {26, 39, 136}) {
        DrawnRobot robot = draw_robot(3905599894U, number);
        CHECK(robot.report_period_ms == 10);
        for (const std::uint64_t noise : {1, 2, 3}) {
            robot.simulation_seed = noise;
            const RobotResult result = run_trial(robot, {"", false});
            CHECK(result.identified);
            worst = std::max(worst, result.worst_error());
            for (const std::size_t k : {2, 3})
                worst_z = std::max(worst_z,
                                   std::abs(result.estimate[k] - result.truth[k]) / result.standard_error[k]);
        }
    }
    std::printf("turning slowly, each 10 ms: K7, K8 within %.2f %%, %.1f standard errors\n", 100 * worst,
                worst_z);
    CHECK(worst < 0.01);
    CHECK(worst_z < 3);
}
