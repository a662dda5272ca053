// The drawn robots: in their distributions, the file a builder's, the truth its own, and again by number.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "tools/strangers/draw.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;

namespace {

constexpr int kRobots = 100;

bool given(const task::RobotFile& file, const std::string& table) {
    return std::any_of(file.given.begin(), file.given.end(),
                       [&](const std::string& key) { return key.rfind(table, 0) == 0; });
}

}  // namespace

TEST_GROUP(DrawnRobots){};

TEST(DrawnRobots, the_same_seed_and_number_give_the_same_files) {
    const DrawnRobot one = draw_robot(7, 3);
    const DrawnRobot again = draw_robot(7, 3);
    CHECK(one.robot_toml == again.robot_toml && one.plant_toml == again.plant_toml);
    CHECK(one.robot_toml != draw_robot(7, 4).robot_toml);
    CHECK(one.robot_toml != draw_robot(8, 3).robot_toml);
}

TEST(DrawnRobots, are_what_the_document_says) {
    int clip = 0;
    int weak = 0;
    int posed = 0;
    int told = 0;
    double lightest = 1e9;
    double heaviest = 0;
    for (int i = 1; i <= kRobots; ++i) {
        const DrawnRobot robot = draw_robot(1, i);
        const model::RobotParameters& truth = robot.truth.parameters;
        const model::MassProperties<double>& mass = *robot.truth.mass;
        const double radius_m = robot.believed.parameters.geometry.mean_radius_m();
        const double torque_Nm = robot.believed.parameters.limits.torque_Nm;
        CHECK(mass.mass_kg >= 1 && mass.mass_kg <= 200);
        CHECK(radius_m >= 0.0249 && radius_m <= 0.2001);
        const double rotors_kg = 2 * mass.wheel_inertia_kg_m2 / std::pow(truth.geometry.mean_radius_m(), 2);
        const double share = rotors_kg / (rotors_kg + mass.mass_kg);
        CHECK(share > 0.019 && share < 0.61);
        CHECK(std::abs(mass.cog_ahead_m) <= 0.41 * truth.geometry.track_m);
        CHECK(truth.drive.left.gear_ratio >= 1 && truth.drive.left.gear_ratio <= 50);
        const double counts = robot.truth.simulation.encoder_counts_per_turn;
        CHECK(counts >= 1000 && counts <= 65536);
        const double delay_s = robot.truth.simulation.torque_lag_s + robot.truth.simulation.command_latency_s;
        CHECK(delay_s >= 0.299e-3 && delay_s <= 4.001e-3);
        const auto& dry = truth.effects.parameter[model::find_effect("coulomb_friction")];
        CHECK(dry[0] <= 0.28 * torque_Nm && dry[1] <= 0.28 * torque_Nm);
        const double limit_A = robot.truth.simulation.current_limit_A;
        const double can_Nm =
            limit_A * truth.drive.left.torque_constant_Nm_per_A * truth.drive.left.gear_ratio;
        CHECK((can_Nm < torque_Nm) == robot.clips);
        CHECK((truth.drive.left.torque_scale != truth.drive.right.torque_scale) == robot.weak_wheel);
        clip += robot.clips ? 1 : 0;
        weak += robot.weak_wheel ? 1 : 0;
        posed += robot.external_pose ? 1 : 0;
        told += robot.torque_feedback ? 1 : 0;
        lightest = std::min(lightest, mass.mass_kg);
        heaviest = std::max(heaviest, mass.mass_kg);
    }
    std::printf(
        "%d robots of %.1f to %.0f kg: %d clip, %d have a weak wheel, %d an external pose, %d tell torque\n",
        kRobots, lightest, heaviest, clip, weak, posed, told);
    // five standard deviations
    DOUBLES_EQUAL(0.15 * kRobots, clip, 18);
    DOUBLES_EQUAL(0.15 * kRobots, weak, 18);
    DOUBLES_EQUAL(0.5 * kRobots, posed, 25);
    DOUBLES_EQUAL(0.8 * kRobots, told, 20);
    CHECK(lightest < 2 && heaviest > 100);
}

TEST(DrawnRobots, the_firmware_is_told_what_a_builder_knows) {
    for (int i = 1; i <= kRobots; ++i) {
        const DrawnRobot robot = draw_robot(2, i);
        const model::RobotParameters& believed = robot.believed.parameters;
        const model::RobotParameters& truth = robot.truth.parameters;
        for (const char* table :
             {"ident.", "dynamics.", "mass.", "simulation.", "velocity_loop.", "adaptation."})
            CHECK_FALSE(given(robot.believed, table));
        for (const char* effect : {"viscous_friction", "coulomb_friction"}) {
            const std::size_t at = model::find_effect(effect);
            CHECK(believed.effects.active[at] == robot.lists_friction);
            CHECK(believed.effects.parameter[at][0] == 0 && believed.effects.parameter[at][1] == 0);
        }
        CHECK_EQUAL(truth.drive.left.sign, believed.drive.left.sign);
        CHECK_EQUAL(truth.drive.right.sign, believed.drive.right.sign);
        CHECK_EQUAL(truth.drive.left.node, believed.drive.left.node);
        CHECK_EQUAL(truth.drive.right.node, believed.drive.right.node);
        CHECK_EQUAL(truth.drive.generation, believed.drive.generation);
        const auto off = [](double a, double b) { return std::abs(a / b - 1); };
        CHECK(off(believed.geometry.track_m, truth.geometry.track_m) < 0.0051);
        CHECK(off(believed.geometry.wheel_radius_m.left, truth.geometry.wheel_radius_m.left) < 0.0051);
        CHECK(off(believed.geometry.wheel_radius_m.right, truth.geometry.wheel_radius_m.right) < 0.0051);
        CHECK(believed.safety.over_speed_m_per_s > 1.2 * believed.limits.speed_m_per_s);
        CHECK(believed.safety.over_yaw_rate_rad_per_s > 1.2 * believed.limits.yaw_rate_rad_per_s);
    }
}

TEST(DrawnRobots, a_fault_is_one_thing_and_the_rest_is_a_good_robot) {
    for (std::size_t f = 1; f < kRobotFaultNames.size(); ++f) {
        const auto fault = static_cast<RobotFault>(f);
        for (int i = 1; i <= 10; ++i) {
            const DrawnRobot robot = draw_robot(3, i, fault);
            const model::RobotParameters& believed = robot.believed.parameters;
            const model::RobotParameters& truth = robot.truth.parameters;
            CHECK_FALSE(robot.weak_wheel);
            CHECK_EQUAL(fault == RobotFault::clipping, robot.torque_share < 1);
            CHECK_EQUAL(fault == RobotFault::swapped_wheels,
                        truth.drive.left.node != believed.drive.left.node);
            const int wrong = (truth.drive.left.sign != believed.drive.left.sign ? 1 : 0) +
                              (truth.drive.right.sign != believed.drive.right.sign ? 1 : 0);
            if (fault != RobotFault::swapped_wheels)
                CHECK_EQUAL(fault == RobotFault::wrong_sign ? 1 : 0, wrong);
            const auto& dry = truth.effects.parameter[model::find_effect("coulomb_friction")];
            const double limit_Nm = believed.limits.torque_Nm;
            CHECK_EQUAL(fault == RobotFault::too_heavy, dry[0] > limit_Nm && dry[1] > limit_Nm);
            CHECK_EQUAL(fault == RobotFault::wheel_blocked, (dry[0] > limit_Nm) != (dry[1] > limit_Nm));
            CHECK_EQUAL(fault == RobotFault::no_room, given(robot.believed, "ident."));
        }
    }
}
