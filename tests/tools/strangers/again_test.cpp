// Robots that are identified again, with a figure-8 between: what the first time has put into the live
// parameters (friction, a load beside the middle, a lower torque limit) stops no second time, and both agree.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tools/strangers/trial.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;

TEST_GROUP(Again){};

TEST(Again, a_second_identification_finds_what_the_first_one_did) {
    int compared = 0;
    for (int number = 1; number <= 12; ++number) {
        const DrawnRobot robot = draw_robot(590, number);
        Simulation sim(robot.believed.parameters, robot.truth.parameters, simulation_options(robot));
        sim.run_for(0.5);
        if (!identify(sim).succeeded) continue;
        const model::RobotParameters first = sim.parameters();
        TrackingOptions options;
        options.path = control::standard_figure_eight<double>(first);
        options.duration_s = options.path.period_s;
        CHECK(track(sim, options).entered);
        sim.host().silence();
        CHECK(enter_mode(sim, protocol::Mode::idle));
        CHECK(identify(sim).succeeded);
        const model::RobotParameters& second = sim.parameters();
        const auto apart = [&](double model::Dynamics<double>::*k) {
            const double error =
                std::hypot(first.dynamics_standard_error.*k, second.dynamics_standard_error.*k);
            return (second.dynamics.*k - first.dynamics.*k) / error;
        };
        const double k7 = apart(&model::Dynamics<double>::k7_per_kg_m);
        const double k8 = apart(&model::Dynamics<double>::k8_per_kg_m2);
        std::printf("%2d %6.1f kg: K7 and K8 apart by %.1f and %.1f standard errors\n", number,
                    robot.truth.mass->mass_kg, k7, k8);
        CHECK(std::max(std::abs(k7), std::abs(k8)) < 6);
        ++compared;
    }
    CHECK(compared >= 10);
}
