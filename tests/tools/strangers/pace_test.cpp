// A figure-8 that asks for too much, on robots drawn at random, each identified by itself before: judged by
// the simulated robot's true motion.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tools/strangers/trial.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;

TEST_GROUP(Pace){};

TEST(Pace, a_figure_eight_beyond_the_limits_is_driven_within_them_on_its_path_and_said) {
    int driven = 0;
    for (int number = 1; number <= 12; ++number) {
        const DrawnRobot robot = draw_robot(31, number);
        SimulationOptions settings = simulation_options(robot);
        // A camera for all: odometry's drift is not the question.
        settings.world.external_pose_rate_Hz = 20;
        Simulation sim(robot.believed.parameters, robot.truth.parameters, settings);
        sim.run_for(0.5);
        if (!identify(sim).succeeded) continue;
        ++driven;
        for (const protocol::Mode mode : {protocol::Mode::trajectory, protocol::Mode::adaptive}) {
            TrackingOptions options;
            options.mode = mode;
            options.path = control::standard_figure_eight<double>(sim.parameters());
            options.path.period_s /= 8;
            options.judge_from_s = options.path.period_s;
            options.duration_s = 2.5 * options.path.period_s;
            sim.world().plant().place({0, 0, std::atan2(2 * options.path.width_m, options.path.length_m)},
                                      {});
            sim.run_for(0.2);
            double speed = 0, yaw_rate = 0;
            std::int64_t saturated = 0, cycles = 0;
            options.event = [&](Simulation& now, double time_s) {
                const double lap_s = now.cycle().control().pace().path().period_s;
                if (time_s < lap_s) return;
                speed = std::max(speed, std::abs(now.world().twist().v_m_per_s));
                yaw_rate = std::max(yaw_rate, std::abs(now.world().twist().omega_rad_per_s));
                const auto status = now.cycle().report().status;
                saturated += status.limit_torque_left || status.limit_torque_right ? 1 : 0;
                ++cycles;
            };
            const TrackingResult result = track(sim, options);
            const auto& limits = sim.parameters().limits;
            const double rms_share = result.rms_m / options.path.length_m;
            const double saturated_share = double(saturated) / double(std::max<std::int64_t>(cycles, 1));
            std::printf(
                "%2d %-10s %6.1f kg: %5.2f s -> %6.2f s by %-16s speed %.2f, yaw rate %.2f of their "
                "limits, at the torque limit %.4f of the time, RMS %.2f %% of the length\n",
                number, std::string(to_string_view(mode)).c_str(), robot.truth.mass->mass_kg,
                result.pace.asked_period_s, result.pace.period_s,
                std::string(to_string_view(result.pace.limited_by)).c_str(), speed / limits.speed_m_per_s,
                yaw_rate / limits.yaw_rate_rad_per_s, saturated_share, 100 * rms_share);
            CHECK(result.entered);
            CHECK(result.pace.limited_by != protocol::PaceLimit::none);
            DOUBLES_EQUAL(options.path.period_s, result.pace.asked_period_s, 0.006);
            CHECK(result.pace.period_s > 1.1 * options.path.period_s);
            CHECK(speed <= 1.02 * limits.speed_m_per_s);
            CHECK(yaw_rate <= 1.02 * limits.yaw_rate_rad_per_s);
            CHECK(saturated_share < 0.02);  // feedback against noise
            CHECK(rms_share < 0.01);
        }
    }
    CHECK(driven >= 9);
}
