// Pose goals with robots drawn at random from 1 to 200 kg, each identified by itself before, with what the
// firmware takes by default: judged by where the simulated robot really is.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "tools/strangers/trial.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;

TEST_GROUP(Goals){};

namespace {

// Drives goals around the robot; the worst of each figure. False: it was not identified.
bool drive_goals(const DrawnRobot& robot) {
    SimulationOptions settings = simulation_options(robot);
    settings.world.external_pose_rate_Hz = 20;  // odometry's drift is not the question
    model::RobotParameters believed = robot.believed.parameters;
    believed.pose_control = model::default_parameters().pose_control;
    Simulation sim(believed, robot.truth.parameters, settings);
    sim.run_for(0.5);
    if (!identify(sim).succeeded) return false;
    const double track_m = believed.geometry.track_m;
    const double noise_m = settings.world.external_pose_noise_m;
    const double tolerance_m = std::max(track_m / 32, 5 * noise_m);
    double slowest_s = 0, farthest_m = 0, turned_rad = 0;
    int reached = 0, goals = 0;
    for (const double bearing : {0.3, 1.9, 3.0, -1.2}) {
        for (const double heading : {0.0, 2.5}) {
            const Pose<double> from = sim.world().pose();
            const double way_m = 5 * track_m;
            const Pose<double> goal{from.x_m + way_m * std::cos(bearing),
                                    from.y_m + way_m * std::sin(bearing), heading};
            const GoalResult result =
                drive_to(sim, goal, protocol::PoseDirection::automatic, 60, tolerance_m);
            ++goals;
            reached += result.reached ? 1 : 0;
            slowest_s = std::max(slowest_s, result.time_s);
            farthest_m = std::max(farthest_m, result.distance_m);
            turned_rad = std::max(turned_rad, std::abs(result.heading_error_rad));
        }
    }
    const double cruise_s = 5 * track_m / believed.limits.speed_m_per_s;
    std::printf(
        "%2d %6.1f kg, track %.2f m, %.2f m/s, %.2f rad/s^2: %d of %d, at most %5.1f s (%.2f s at full "
        "speed), %.1f mm and %.4f rad at the end\n",
        int(robot.number), robot.truth.mass->mass_kg, track_m, believed.limits.speed_m_per_s,
        2 * sim.parameters().dynamics.k8_per_kg_m2 * believed.limits.torque_Nm, reached, goals, slowest_s,
        cruise_s, 1e3 * farthest_m, turned_rad);
    CHECK_EQUAL(goals, reached);
    return true;
}

}  // namespace

TEST(Goals, robots_from_one_to_two_hundred_kilogrammes_reach_poses_in_time_and_hold_them) {
    int driven = 0;
    for (int number = 1; number <= 12; ++number) driven += drive_goals(draw_robot(31, number)) ? 1 : 0;
    CHECK(driven >= 10);
}
