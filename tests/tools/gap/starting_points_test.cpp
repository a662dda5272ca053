// What an amount makes of a starting point's column is what the parameters that it stands for do: these are
// simulated and written.
#include "tools/gap/hypotheses/starting_points.hpp"

#include <CppUTest/TestHarness.h>

#include "tools/gap/hypotheses/hypotheses.hpp"

using namespace wheelwright;

namespace {

constexpr double kPeak_Nm = 2, kPeak_rad_per_s = 10;

gap::Setting setting() {
    gap::Setting s;
    s.geometry = {{0.1, 0.1}, 0.5};
    s.dynamics = {0, 0, 0.5, 2};
    s.peak_torque_Nm = kPeak_Nm;
    s.peak_speed_rad_per_s = kPeak_rad_per_s;
    return s;
}

double taken(std::size_t effect, const gap::Parameters<double>& p, double torque_Nm, double speed_rad_per_s) {
    gap::Interval i;
    i.dt_s = 0.004;
    i.torque = i.torque_before = {torque_Nm, torque_Nm};
    i.before = i.after = {speed_rad_per_s, speed_rad_per_s};
    return gap::hypothesis_of(effect).columns(p, setting())->over(i).left;
}

}  // namespace

TEST_GROUP(GapStartingPoints){};

TEST(GapStartingPoints, ALimitTakesSoManyTimesAsMuchOfTheLargestTorque) {
    for (const char* name : {"torque_saturation", "back_emf_limit"}) {
        const std::size_t effect = model::find_effect(name);
        const gap::StartingPoints start = gap::hypothesis_of(effect).starting_points(setting());
        for (const gap::Parameters<double>& point : start.points) {
            for (const double amount : {0.3, 1.0, 1.4}) {
                const auto p = start.parameters(point, Eigen::VectorXd::Constant(1, amount));
                for (const double share : {0.0, 0.4, 0.8}) {
                    const double speed = share * kPeak_rad_per_s;
                    const double column = taken(effect, point, kPeak_Nm, speed);
                    if (column == 0 || kPeak_Nm + amount * column < 0) continue;
                    DOUBLES_EQUAL_TEXT(amount * column, taken(effect, p, kPeak_Nm, speed), 1e-9, name);
                }
            }
        }
    }
}

TEST(GapStartingPoints, ACastorHoldsTheRobotUpAndStribecksFrictionRisesAsTheWheelCreeps) {
    const auto is = [](const char* name, const gap::Parameters<double>& p) {
        return gap::hypothesis_of(model::find_effect(name)).starting_points(setting()).itself(p);
    };
    CHECK_TRUE(is("castor_drag", {1, 0.01, -0.13, 0.03}));
    CHECK_FALSE(is("castor_drag", {1, 0.01, -0.12, 0.03}));
    CHECK_TRUE(is("stribeck_friction", {0.2, 0.23, 1}));
    CHECK_FALSE(is("stribeck_friction", {0.2, 0.21, 1}));
}

TEST(GapStartingPoints, ALoadMovesOnWhatFrictionLeavesOfTheTorque) {
    gap::Setting with_friction = setting();
    with_friction.friction = {0.3, 0.02};
    const std::size_t load = model::find_effect("payload_step");
    const auto column = gap::hypothesis_of(load).columns({0, 1, 0}, with_friction);
    gap::Interval i;
    i.t_s = 1;
    i.dt_s = 0.004;
    i.before = i.after = {5, -5};
    i.torque = {0.4, -0.4};  // all that friction takes
    DOUBLES_EQUAL(0, column->over(i).left, 1e-12);
    i.t_s = 1.004;
    i.torque = {0.9, 0.1};
    // half of what is left goes into as much load as there is robot, 20 kg
    const auto robots_mass = gap::hypothesis_of(load).columns({0, 20, 0}, with_friction);
    DOUBLES_EQUAL(-(0.9 - 0.4 + 0.1 + 0.4) / 4, robots_mass->over(i).left, 1e-12);
}
