// The drives' formulas against numbers worked out by hand.
#include "tools/gap_trials/hidden/electronics.hpp"

#include <cmath>
#include <numbers>

#include <CppUTest/TestHarness.h>

using namespace wheelwright::hidden;

namespace {

constexpr double kStep_s = 5e-4;

HiddenSet only(const char* name, std::map<std::string, double, std::less<>> parameters) {
    return {{{name, std::move(parameters)}}};
}

// Shaft torque at once after a command, wheels as given.
Pair shaft(const HiddenSet& hidden, Pair command, PlantState wheels = {}, double t_s = 0) {
    TorquePath path(hidden, 20);
    path.command(0, command);
    return path.shaft_torque_Nm(t_s, kStep_s, wheels);
}

void near(Pair expected, Pair actual) {
    DOUBLES_EQUAL(expected.left, actual.left, 1e-9);
    DOUBLES_EQUAL(expected.right, actual.right, 1e-9);
}

}  // namespace

TEST_GROUP(HiddenElectronics){};

TEST(HiddenElectronics, WithoutEffectsTheCommandIsTheTorque) { near({0.7, -1.1}, shaft({}, {0.7, -1.1})); }

TEST(HiddenElectronics, StaticCurves) {
    near({0.45, -0.85}, shaft(only("dead_zone", {{"width_Nm", 0.25}}), {0.7, -1.1}));
    near({0, 0}, shaft(only("dead_zone", {{"width_Nm", 1.25}}), {0.7, -1.1}));
    near({0.7, -0.9}, shaft(only("torque_saturation", {{"limit_Nm", 0.9}}), {0.7, -1.1}));
    near({0.8, -1.3}, shaft(only("torque_bias", {{"left_Nm", 0.1}, {"right_Nm", -0.2}}), {0.7, -1.1}));
    const Pair uneven = shaft(only("torque_gain_mismatch", {{"relative", 0.21}}), {1.1, 1.1});
    near({1.0, 1.21}, uneven);
}

TEST(HiddenElectronics, BackEmfLimitsDrivingMoreThanBraking) {
    const HiddenSet hidden = only("back_emf_limit", {{"stall_Nm", 2}, {"no_load_rad_per_s", 20}});
    PlantState fast;
    fast.wheel_speed_rad_per_s = {15, 15};
    near({0.5, -1.7}, shaft(hidden, {1.5, -1.7}, fast));
    fast.wheel_speed_rad_per_s = {25, -25};
    near({0, 0}, shaft(hidden, {1.5, -1.5}, fast));
    near({-1.5, 1.5}, shaft(hidden, {-1.5, 1.5}, fast));
}

TEST(HiddenElectronics, DriftIsLinearOrSettles) {
    near({0.85, 0.85}, shaft(only("gain_drift", {{"loss", 0.3}, {"time_constant_s", 0}}), {1, 1}, {}, 10));
    const double settled = 1 - 0.3 * (1 - std::exp(-2.0));
    near({settled, settled},
         shaft(only("gain_drift", {{"loss", 0.3}, {"time_constant_s", 5}}), {1, 1}, {}, 10));
}

TEST(HiddenElectronics, RippleFollowsTheWheelsAngle) {
    PlantState turned;
    turned.wheel_angle_rad = {std::numbers::pi / 6, 0};
    near({1.2, 1.0}, shaft(only("torque_ripple", {{"amplitude_Nm", 0.2}, {"order", 3}, {"phase_rad", 0}}),
                           {1, 1}, turned));
}

TEST(HiddenElectronics, DelayNeedNotBeAMultipleOfTheStep) {
    const HiddenSet hidden = only("transport_delay", {{"delay_s", 0.0021}});
    TorquePath path(hidden, 20);
    path.command(0, {1, -2});
    double impulse = 0;
    for (int i = 0; i < 10; ++i) {
        if (i == 2) path.command(0.001, {0, 0});
        impulse += path.shaft_torque_Nm(i * kStep_s, kStep_s, {}).left * kStep_s;
        if (i == 3) DOUBLES_EQUAL(0, impulse, 1e-15);
        if (i == 4) DOUBLES_EQUAL(0.0004, impulse, 1e-12);
    }
    DOUBLES_EQUAL(0.001, impulse, 1e-12);
}

TEST(HiddenElectronics, LagLosesNoImpulse) {
    const HiddenSet hidden = only("actuator_lag", {{"time_constant_s", 0.02}});
    TorquePath path(hidden, 20);
    path.command(0, {1, 1});
    double impulse = 0;
    for (int i = 0; i < 400; ++i) impulse += path.shaft_torque_Nm(i * kStep_s, kStep_s, {}).right * kStep_s;
    // integral of 1 - exp(-t / T)
    DOUBLES_EQUAL(0.2 - 0.02 * (1 - std::exp(-10.0)), impulse, 1e-12);
}

TEST(HiddenElectronics, BacklashCrossesItsGapThenPushes) {
    const double inertia = 0.006;
    const HiddenSet hidden = only("backlash", {{"half_gap_rad", 0.05}, {"motor_inertia_kg_m2", inertia}});
    TorquePath path(hidden, 20);
    path.command(0, {0.8, 0});
    // From the middle of the gap to its side: t = sqrt(2 gap J / torque), the wheel held.
    const double crossing_s = std::sqrt(2 * 0.05 * inertia / 0.8);
    double impulse = 0;
    double last = 0;
    for (int i = 0; i < 800; ++i) {
        last = path.shaft_torque_Nm(i * kStep_s, kStep_s, {}).left;
        if (i * kStep_s < crossing_s - 2 * kStep_s) DOUBLES_EQUAL(0, last, 0);
        impulse += last * kStep_s;
    }
    DOUBLES_EQUAL(0.8, last, 1e-3);
    DOUBLES_EQUAL(0.8 * 0.4, impulse, 1e-3);  // at rest again: nothing is lost
}

TEST(HiddenElectronics, ReportedSpeedLags) {
    const HiddenSet hidden = only("measurement_lag", {{"time_constant_s", 0.04}});
    SpeedReport report(hidden);
    for (int i = 0; i < 80; ++i) report.advance(kStep_s, {5, -5});
    near({5 * (1 - std::exp(-1.0)), -5 * (1 - std::exp(-1.0))}, report.reported({5, -5}));
    near({5, -5}, SpeedReport({}).reported({5, -5}));
    DOUBLES_EQUAL(2 * std::numbers::pi / 4096 / 0.01, speed_step_rad_per_s(4096), 1e-12);
}
