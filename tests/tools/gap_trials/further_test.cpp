// The true model that a free run is measured against: a robot file, with the project's own mass properties as
// the reference.
#include "tools/gap_trials/further.hpp"

#include <cmath>
#include <string>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/effects.hpp"
#include "firmware/task/robot_file.hpp"
#include "sim_hal/plant.hpp"
#include "tools/gap_trials/hidden/effects.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

hidden::Trial robot_with(const hidden::HiddenEffect& effect, const std::string& plant) {
    hidden::Trial trial;
    trial.plant = plant;
    trial.robot = {0.081, 0.36, 10.7, 0.33, 0.047, 0.06, 0.55, 0.0043, 0.17, 2.5};
    trial.hidden.effects = {effect};
    return trial;
}

model::RobotParameters read(const hidden::Trial& trial) {
    const task::RobotFileResult result = task::parse_robot_file(tools::true_model_toml(trial), "true.toml");
    for (const task::Diagnostic& problem : result.problems) FAIL(task::to_text(problem).c_str());
    return result.robot->parameters;
}

double parameter(const model::RobotParameters& robot, std::string_view effect, std::size_t index) {
    const std::size_t i = model::find_effect(effect);
    CHECK(robot.effects.active[i]);
    return robot.effects.parameter[i][index];
}

}  // namespace

TEST_GROUP(TrueModel){};

TEST(TrueModel, ItIsARobotFileForEveryEffect) {
    for (const hidden::EffectInfo& info : hidden::all_effects()) {
        if (info.fault_of_log) continue;
        hidden::HiddenEffect effect{std::string(info.name), {}};
        for (const hidden::ParameterInfo& p : info.parameters())
            effect.parameters[std::string(p.name)] = 0.013;
        if (info.name == "encoder_quantisation") effect.parameters["counts_per_turn"] = 4096;
        const model::RobotParameters robot = read(robot_with(effect, "own"));
        LONGS_EQUAL(0.013 < parameter(robot, info.name, 0) ? 1 : 0,
                    info.name == "encoder_quantisation" ? 1 : 0);
    }
}

TEST(TrueModel, ItsDynamicsAreThoseOfTheMasses) {
    const hidden::Trial trial =
        robot_with({"coulomb_friction", {{"left_Nm", 0.2}, {"right_Nm", 0.3}}}, "ode");
    const model::RobotParameters robot = read(trial);
    const hidden::Robot& r = trial.robot;
    const model::Dynamics<double> wanted = sim::plant_dynamics(
        sim::plant_from_mass({{r.wheel_radius_m, r.wheel_radius_m}, r.track_m},
                             {r.mass_kg, r.yaw_inertia_kg_m2, r.cog_ahead_m, r.wheel_inertia_kg_m2}, {}));
    DOUBLES_EQUAL(wanted.k5_m, robot.dynamics.k5_m, 1e-9);
    DOUBLES_EQUAL(wanted.k6_per_m, robot.dynamics.k6_per_m, 1e-9);
    DOUBLES_EQUAL(wanted.k7_per_kg_m, robot.dynamics.k7_per_kg_m, 1e-9);
    DOUBLES_EQUAL(wanted.k8_per_kg_m2, robot.dynamics.k8_per_kg_m2, 1e-9);
    DOUBLES_EQUAL(0.3, parameter(robot, "coulomb_friction", 1), 1e-12);
}

TEST(TrueModel, WhereTheCatalogueTakesTheWheelsRotationForMassTheNumbersFollow) {
    // m (v' - y w') = F: the catalogue has y / (K7 r) in place of m y, and y^2 m is part of the inertia
    const hidden::Trial offset = robot_with({"cog_lateral", {{"offset_m", 0.03}}}, "ode");
    const model::RobotParameters robot = read(offset);
    const double r = offset.robot.wheel_radius_m;
    DOUBLES_EQUAL(10.7 * 0.03, parameter(robot, "cog_lateral", 0) / (robot.dynamics.k7_per_kg_m * r), 1e-9);
    const model::RobotParameters level =
        read(robot_with({"torque_bias", {{"left_Nm", 0.1}, {"right_Nm", 0.1}}}, "ode"));
    const auto inertia = [&](const model::RobotParameters& p) {
        return 0.36 / (2 * r * p.dynamics.k8_per_kg_m2);
    };
    DOUBLES_EQUAL(10.7 * 0.03 * 0.03, inertia(robot) - inertia(level), 1e-9);
    // what the project's own robot does is the catalogue's
    DOUBLES_EQUAL(0.03,
                  parameter(read(robot_with({"cog_lateral", {{"offset_m", 0.03}}}, "own")), "cog_lateral", 0),
                  1e-12);
    // gravity pulls at the mass without the wheels' rotation, whatever its share is
    const model::RobotParameters hill =
        read(robot_with({"slope", {{"angle_rad", 0.05}, {"uphill_rad", 1}}}, "ode"));
    const double pulls_at = (1 - model::kRotationShare) / (hill.dynamics.k7_per_kg_m * r);
    DOUBLES_EQUAL(10.7 * std::sin(0.05), pulls_at * std::sin(parameter(hill, "slope", 0)), 1e-9);
}
