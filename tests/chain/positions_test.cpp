// Positions that have grown for long: drives tell them as floats. Judged on the simulated robot's true speed.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tests/chain/robots.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;
using protocol::Fault;
using protocol::Mode;

TEST_GROUP(ChainPositions){};

namespace {

double turns_per_m() {
    const auto& p = chain::real().parameters;
    return p.drive.left.gear_ratio / (6.283185307179586 * p.geometry.mean_radius_m());
}

// The default robot, identified, with drives of a generation.
struct Robot {
    explicit Robot(int generation) {
        believed.drive.generation = truth.drive.generation = generation;
        believed.drive.watchdog_assured = true;
    }
    model::RobotParameters believed = chain::identified();
    model::RobotParameters truth = chain::real().parameters;
};

SimulationOptions options(std::uint64_t seed, bool separate) {
    SimulationOptions o = chain::options(seed);
    o.separate_host_bus = separate;
    return o;
}

// Root mean square error of the observer's speed of a wheel, while the robot is drawn along by hand.
double speed_noise_rad_per_s(double km, bool keeps_its_count, int generation) {
    const Robot robot(generation);
    Simulation sim(robot.believed, robot.truth, options(7, false));
    sim.run_for(0.5);
    for (const std::size_t side : {0U, 1U}) {
        sim.world().drive(side).set_position(1000 * km * turns_per_m());
        sim.world().drive(side).faults().keeps_its_count = keeps_its_count;
    }
    sim::Plant& plant = sim.world().plant();
    double squares = 0;
    int n = 0;
    sim.run_for(2, [&] {
        const double error =
            sim.cycle().observer().motion().wheel_speed_rad_per_s.left - plant.wheel_speed_rad_per_s().left;
        plant.place(plant.pose(), {0.5, 0});
        if (sim.time_s() < 1.5) return;
        squares += error * error;
        ++n;
    });
    return std::sqrt(squares / n);
}

}  // namespace

TEST(ChainPositions, a_position_that_has_grown_for_100_km_tells_as_much_as_at_first) {
    for (const int generation : {5, 6}) {
        const double first = speed_noise_rad_per_s(0, false, generation);
        for (const double km : {0.0, 6.0, 60.0, 100.0, -100.0}) {
            const double kept = speed_noise_rad_per_s(km, true, generation);
            const double anew = speed_noise_rad_per_s(km, false, generation);
            std::printf("\n  generation 0.%d, %4.0f km: speed noise %.3f rad/s, counted anew %.3f",
                        generation, km, kept, anew);
            CHECK(anew <= 1.3 * first);
        }
    }
    std::printf("\n");
}

// The true speed does not show it, and the odometry loses nothing.
TEST(ChainPositions, a_position_is_counted_anew_while_the_robot_drives) {
    for (const int generation : {5, 6}) {
        for (const double way : {1.0, -1.0}) {
            for (const bool separate : {false, true}) {
                const Robot robot(generation);
                Simulation sim(robot.believed, robot.truth, options(9, separate));
                sim.run_for(0.5);
                sim.world().left().set_position(way * (1000 - 2 * turns_per_m()));
                sim.world().right().set_position(way * (1000 + 1 * turns_per_m()));
                sim.run_for(0.3);
                sim.host().external_poses(false);
                const double wanted = way * 0.3 * sim.parameters().limits.speed_m_per_s;
                sim.host().velocity({wanted, 0});
                CHECK(enter_mode(sim, Mode::velocity));
                sim.run_for(1);
                const double true_before_m = sim.world().pose().x_m;
                const double told_before_m = sim.cycle().odometry().pose().x_m;
                double off_m_per_s = 0;
                sim.run_for(5, [&] {
                    off_m_per_s = std::max(off_m_per_s, std::abs(sim.world().twist().v_m_per_s - wanted));
                });
                CHECK(sim.cycle().supervisor().fault() == Fault::none);
                const double went_m = std::hypot(sim.world().pose().x_m - true_before_m, 0);
                const double told_m = std::abs(sim.cycle().odometry().pose().x_m - told_before_m);
                std::printf("  0.%d: speed off by %.1f mm/s, %.3f m told as %.3f\n", generation,
                            1e3 * off_m_per_s, went_m, told_m);
                CHECK(off_m_per_s < 0.03 * std::abs(wanted));
                CHECK(std::abs(went_m - told_m) < 0.01 * went_m);
            }
        }
    }
}

TEST(ChainPositions, thirty_days_after_the_start_it_drives_as_at_first) {
    SimulationOptions o = chain::options(5);
    o.start_ns = 30LL * 86'400 * 1'000'000'000;
    Simulation sim(chain::identified(), chain::real().parameters, o);
    sim.run_for(0.5);
    sim.host().velocity({0.5, 0});
    CHECK(enter_mode(sim, Mode::velocity));
    sim.run_for(3);
    CHECK(std::abs(sim.world().twist().v_m_per_s - 0.5) < 0.02);
    CHECK(sim.cycle().supervisor().fault() == Fault::none);
}
