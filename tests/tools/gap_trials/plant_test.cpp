// The engine's robot against mechanics worked out here: without effects it must obey the base model to far
// below any sensor's noise, and each effect must do what its formula says.
#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <numbers>
#include <utility>

#include "tools/gap_trials/hidden/ode_plant.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright::hidden;

namespace {

constexpr double kStep_s = 5e-4;
constexpr double kGravity = 9.81;

Robot some_robot() {
    Random random(77);
    return draw_robot(random);
}

HiddenSet only(const char* name, std::map<std::string, double, std::less<>> parameters) {
    return {{{name, std::move(parameters)}}};
}

using Torques = std::function<Pair(double t_s)>;
using Watch = std::function<void(double t_s, const PlantState&)>;

PlantState drive(Plant& plant, double duration_s, const Torques& torques, const Watch& watch = {}) {
    const int steps = static_cast<int>(std::lround(duration_s / kStep_s));
    for (int i = 0; i < steps; ++i) {
        if (watch) watch(i * kStep_s, plant.state());
        plant.advance(kStep_s, torques(i * kStep_s));
    }
    return plant.state();
}

Torques always(double left, double right) {
    return [=](double) { return Pair{left, right}; };
}

Pair lively(double t) {
    return {0.9 * std::sin(3 * t) - 0.5 * std::sin(11 * t),
            0.8 * std::sin(2.1 * t) + 0.4 * std::sin(7 * t + 1)};
}

// A wheel of the robot that goes straight behaves like this much mass.
double mass_at_wheels(const Robot& r) {
    return r.mass_kg + 2 * r.wheel_inertia_kg_m2 / (r.wheel_radius_m * r.wheel_radius_m);
}

double inertia_at_wheels(const Robot& r) {
    return r.yaw_inertia_kg_m2 + r.mass_kg * r.cog_ahead_m * r.cog_ahead_m +
           r.wheel_inertia_kg_m2 * r.track_m * r.track_m / (2 * r.wheel_radius_m * r.wheel_radius_m);
}

}  // namespace

TEST_GROUP(HiddenPlant){};

TEST(HiddenPlant, WithoutEffectsItObeysTheBaseModel) {
    const Robot robot = some_robot();
    const HiddenSet nothing;
    const auto plant = make_ode_plant(robot, nothing);
    // v = v0 + K5 int omega^2 + K7 int sum and omega = omega0 + K6 int v omega + K8 int difference
    Eigen::MatrixXd a(4000, 2);
    Eigen::MatrixXd b(4000, 2);
    Eigen::VectorXd v(4000);
    Eigen::VectorXd yaw(4000);
    Eigen::Vector4d sums = Eigen::Vector4d::Zero();
    Eigen::Index row = 0;
    PlantState last;
    double work_J = 0;
    double off_m_per_s = 0;
    drive(*plant, 10, lively, [&](double t, const PlantState& s) {
        if (t > 0) {
            const Pair u = lively(t - kStep_s);
            const double r = robot.wheel_radius_m;
            const auto speed = [&](const PlantState& x) {
                return r * (x.wheel_speed_rad_per_s.left + x.wheel_speed_rad_per_s.right) / 2;
            };
            const auto turn = [&](const PlantState& x) {
                return r * (x.wheel_speed_rad_per_s.right - x.wheel_speed_rad_per_s.left) / robot.track_m;
            };
            sums[0] += kStep_s * (turn(last) * turn(last) + turn(s) * turn(s)) / 2;
            sums[1] += kStep_s * (u.left + u.right);
            sums[2] += kStep_s * (speed(last) * turn(last) + speed(s) * turn(s)) / 2;
            sums[3] += kStep_s * (u.right - u.left);
            off_m_per_s = std::max(off_m_per_s, std::abs(s.speed_m_per_s - speed(s)));
            work_J +=
                kStep_s * (u.left * (s.wheel_speed_rad_per_s.left + last.wheel_speed_rad_per_s.left) / 2 +
                           u.right * (s.wheel_speed_rad_per_s.right + last.wheel_speed_rad_per_s.right) / 2);
            if (row < 4000 && std::lround(t / kStep_s) % 5 == 0) {
                a.row(row) << sums[0], sums[1];
                b.row(row) << sums[2], sums[3];
                v[row] = speed(s);
                yaw[row] = turn(s);
                ++row;
            }
        }
        last = s;
    });
    const auto forward = a.topRows(row).householderQr().solve(v.head(row)).eval();
    const auto turning = b.topRows(row).householderQr().solve(yaw.head(row)).eval();
    const double m = mass_at_wheels(robot);
    const double i = inertia_at_wheels(robot);
    const double moment = robot.mass_kg * robot.cog_ahead_m;
    DOUBLES_EQUAL(moment / m, forward[0], 1e-3 * moment / m);
    DOUBLES_EQUAL(1 / (m * robot.wheel_radius_m), forward[1], 1e-4 * forward[1]);
    DOUBLES_EQUAL(-moment / i, turning[0], 1e-3 * moment / i);
    DOUBLES_EQUAL(robot.track_m / (2 * robot.wheel_radius_m * i), turning[1], 1e-4 * turning[1]);
    // What is left is a hundredth of the smallest noise of a wheel's speed, 0.002 rad/s.
    const double rows = static_cast<double>(row);
    const double rest_v =
        (v.head(row) - a.topRows(row) * forward).norm() / std::sqrt(rows) / robot.wheel_radius_m;
    const double rest_yaw = (yaw.head(row) - b.topRows(row) * turning).norm() / std::sqrt(rows) *
                            robot.track_m / (2 * robot.wheel_radius_m);
    CHECK(yaw.norm() / std::sqrt(rows) > 0.5);
    DOUBLES_EQUAL(0, rest_v, 2e-5);
    DOUBLES_EQUAL(0, rest_yaw, 2e-5);
    // no slip, and no energy from nowhere
    DOUBLES_EQUAL(0, off_m_per_s, 5e-4);
    DOUBLES_EQUAL(work_J, plant->kinetic_energy_J(), 0.005 * plant->kinetic_energy_J());
}

TEST(HiddenPlant, FrictionTakesWhatItsFormulaSays) {
    const Robot robot = some_robot();
    const double m = mass_at_wheels(robot);
    const double r = robot.wheel_radius_m;
    const auto coast = [&](const HiddenSet& hidden, double for_s) {
        const auto plant = make_ode_plant(robot, hidden);
        const double begin = drive(*plant, 1, always(0.7, 0.7)).wheel_speed_rad_per_s.left;
        return std::pair{begin, drive(*plant, for_s, always(0, 0)).wheel_speed_rad_per_s.left};
    };
    const auto viscous =
        coast(only("viscous_friction", {{"left_Nm_s_per_rad", 0.02}, {"right_Nm_s_per_rad", 0.02}}), 1);
    DOUBLES_EQUAL(std::exp(-2 * 0.02 / (m * r * r)), viscous.second / viscous.first, 1e-4);

    const HiddenSet dry = only("coulomb_friction", {{"left_Nm", 0.12}, {"right_Nm", 0.12}});
    const auto coulomb = coast(dry, 1);
    DOUBLES_EQUAL(2 * 0.12 / (m * r * r), coulomb.first - coulomb.second, 1e-3);
    const auto stopped = coast(dry, 20);
    DOUBLES_EQUAL(0, stopped.second, 1e-9);
    const auto stuck = make_ode_plant(robot, dry);
    DOUBLES_EQUAL(0, drive(*stuck, 1, always(0.119, -0.119)).wheel_angle_rad.left, 1e-9);

    const HiddenSet sticky =
        only("stribeck_friction", {{"coulomb_Nm", 0.1}, {"static_Nm", 0.2}, {"stribeck_rad_per_s", 1}});
    const auto breaks = make_ode_plant(robot, sticky);
    DOUBLES_EQUAL(0, drive(*breaks, 1, always(0.195, 0.195)).wheel_angle_rad.left, 1e-9);
    CHECK(drive(*breaks, 1, always(0.25, 0.25)).wheel_angle_rad.left > 0.4);

    const auto drag = coast(only("quadratic_drag", {{"drag_N_s2_per_m2", 3}}), 2);
    DOUBLES_EQUAL(1 / (r * drag.first) + 3 * 2 / m, 1 / (r * drag.second), 1e-3);
}

TEST(HiddenPlant, TurningScrubHoldsTheHeadingOnly) {
    const Robot robot = some_robot();
    const HiddenSet hidden = only("turning_scrub", {{"scrub_Nm", 0.8}});
    const double moment_per_torque = robot.track_m / (2 * robot.wheel_radius_m);  // of right less left
    const double holds = 0.8 / moment_per_torque;
    const auto plant = make_ode_plant(robot, hidden);
    const PlantState still = drive(*plant, 1, always(-0.49 * holds, 0.49 * holds));
    DOUBLES_EQUAL(0, still.yaw_rate_rad_per_s, 1e-9);
    const PlantState straight = drive(*plant, 1, always(0.3, 0.3));
    DOUBLES_EQUAL(0.6 / (mass_at_wheels(robot) * robot.wheel_radius_m), straight.speed_m_per_s, 1e-3);
    DOUBLES_EQUAL(0, straight.yaw_rate_rad_per_s, 1e-9);
}

TEST(HiddenPlant, SlopeIsGravitys) {
    const Robot robot = some_robot();
    const HiddenSet hidden = only("slope", {{"angle_rad", 0.05}, {"uphill_rad", std::numbers::pi}});
    const auto plant = make_ode_plant(robot, hidden);
    const double expected = robot.mass_kg * kGravity * std::sin(0.05) / mass_at_wheels(robot);
    DOUBLES_EQUAL(expected, drive(*plant, 1, always(0, 0)).speed_m_per_s, 1e-3 * expected);
}

TEST(HiddenPlant, WheelsOfUnequalRadiusDriveAnArc) {
    const Robot robot = some_robot();
    const HiddenSet hidden = only("wheel_radius_mismatch", {{"relative", 0.06}});
    const auto plant = make_ode_plant(robot, hidden);
    const PlantState end = drive(*plant, 1, [](double) { return Pair{0.5, 0.5}; });
    const double left = 2 * robot.wheel_radius_m / 2.06;
    const double right = 1.06 * left;
    DOUBLES_EQUAL(
        (right * end.wheel_speed_rad_per_s.right - left * end.wheel_speed_rad_per_s.left) / robot.track_m,
        end.yaw_rate_rad_per_s, 2e-3);
    DOUBLES_EQUAL((right * end.wheel_speed_rad_per_s.right + left * end.wheel_speed_rad_per_s.left) / 2,
                  end.speed_m_per_s, 2e-3);
}

TEST(HiddenPlant, WeightOnTheLeftTurnsLeftWhenPushed) {
    const Robot robot = some_robot();
    const HiddenSet hidden = only("cog_lateral", {{"offset_m", 0.03}});
    const auto plant = make_ode_plant(robot, hidden);
    // At rest: m (v' - y w') = F and I w' - m y v' = 0 with all of mass and inertia seen at the wheels, in
    // which the offset adds m y^2 to the inertia.
    const double push = 0.6;
    const PlantState end = drive(*plant, 0.02, always(push, push));
    const double m = mass_at_wheels(robot);
    const double i = inertia_at_wheels(robot) + robot.mass_kg * 0.03 * 0.03;
    const double my = robot.mass_kg * 0.03;
    const double force = 2 * push / robot.wheel_radius_m;
    const double determinant = m * i - my * my;
    DOUBLES_EQUAL(0.02 * force * my / determinant, end.yaw_rate_rad_per_s, 1e-4);
    DOUBLES_EQUAL(0.02 * force * i / determinant, end.speed_m_per_s, 1e-4);
}

TEST(HiddenPlant, SlipGrowsWithForceUpToTheTyresLimit) {
    const Robot robot = some_robot();
    const HiddenSet hidden = only("wheel_slip", {{"friction_coefficient", 0.6}, {"slip_speed_m_per_s", 0.1}});
    const auto plant = make_ode_plant(robot, hidden);
    const PlantState gentle = drive(*plant, 0.5, always(0.5, 0.5));
    const double load =
        robot.mass_kg * kGravity * (1 - robot.cog_ahead_m / robot.castor_ahead_m) / 2;  // at rest, each wheel
    const double slip = robot.wheel_radius_m * gentle.wheel_speed_rad_per_s.left - gentle.speed_m_per_s;
    const double force = robot.mass_kg * (2 * 0.5 / robot.wheel_radius_m / mass_at_wheels(robot)) / 2;
    DOUBLES_EQUAL(0.1 * force / (0.6 * load), slip, 0.1 * slip);
    const auto spun = make_ode_plant(robot, hidden);
    const PlantState wild = drive(*spun, 1, always(6, 6));
    // Pushed with all the tyres can, which is what they carry while the push lifts the nose.
    CHECK(wild.speed_m_per_s < 0.6 * kGravity * 1.05);
    CHECK(robot.wheel_radius_m * wild.wheel_speed_rad_per_s.left > 2 * wild.speed_m_per_s);
}

TEST(HiddenPlant, PayloadMakesItHeavierFromItsTimeOn) {
    const Robot robot = some_robot();
    const HiddenSet hidden = only("payload_step", {{"time_s", 0.5}, {"mass_kg", 3}, {"inertia_kg_m2", 0.1}});
    const auto plant = make_ode_plant(robot, hidden);
    const double before = drive(*plant, 0.5, always(0.4, 0.4)).speed_m_per_s;
    const double after = drive(*plant, 0.5, always(0.4, 0.4)).speed_m_per_s;
    const double m = mass_at_wheels(robot);
    DOUBLES_EQUAL(m / (m + 3), (after - before) / before, 1e-3);
}

TEST(HiddenPlant, CastorDragsAndSwivels) {
    const Robot robot = some_robot();
    const HiddenSet hidden =
        only("castor_drag", {{"rolling_N", 2.5}, {"swivel_Nm", 0.01}, {"arm_m", 0.17}, {"trail_m", 0.03}});
    const auto plant = make_ode_plant(robot, hidden);
    drive(*plant, 1, always(0.6, 0.6));
    const double begin = plant->state().speed_m_per_s;
    const double end = drive(*plant, 0.5, always(0, 0)).speed_m_per_s;
    // straight on only the rolling drag acts; the castor itself weighs 0.2 kg
    DOUBLES_EQUAL(2.5 * 0.5 / (mass_at_wheels(robot) + 0.2), begin - end, 0.004);
    // backwards it turns round, and for a while the robot does not go straight
    double turned = 0;
    drive(*plant, 3, always(-0.5, -0.5),
          [&](double, const PlantState& s) { turned = std::max(turned, std::abs(s.yaw_rate_rad_per_s)); });
    CHECK(plant->state().speed_m_per_s < 0);
    CHECK(plant->effect_rms_Nm("castor_drag") > 0.02);
}
