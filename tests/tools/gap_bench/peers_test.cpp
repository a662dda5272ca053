// The simpler methods, on motions whose law is known in closed form.
#include <array>
#include <cmath>
#include <vector>

#include "tools/gap_bench/peers/peers.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using peers::ForwardRun;

namespace {

constexpr double kStep_s = 0.02;
// d speed / dt = K (torque - c sign(speed) + b) - a speed
constexpr double kGain = 2.5;
constexpr double kRate_per_s = 1.7;
constexpr double kCoulomb_Nm = 0.4;

ForwardRun standing(Eigen::Index samples) {
    ForwardRun run;
    run.speed_rad_per_s.setZero(samples);
    run.torque_Nm.setZero(samples);
    return run;
}

// Torque held over each step, by the exact solution of the equation.
ForwardRun run(double direction, double ramp_Nm_per_s, double step_Nm, double offset_Nm) {
    constexpr Eigen::Index kSamples = 300;
    ForwardRun made = standing(kSamples);
    const double decay = std::exp(-kRate_per_s * kStep_s);
    double speed = direction * 2;
    for (Eigen::Index k = 0; k < kSamples; ++k) {
        const double torque = direction * (step_Nm + ramp_Nm_per_s * kStep_s * static_cast<double>(k) +
                                           0.3 * std::sin(0.1 * double(k)));
        made.speed_rad_per_s(k) = speed;
        made.torque_Nm(k) = torque;
        const double driving = kGain * (torque - direction * kCoulomb_Nm + offset_Nm);
        speed = decay * speed + driving * (1 - decay) / kRate_per_s;
    }
    return made;
}

std::vector<ForwardRun> runs(double offset_Nm) {
    return {run(1, 1, 1, offset_Nm), run(-1, 1, 1, offset_Nm), run(1, 0, 7, offset_Nm),
            run(-1, 0, 7, offset_Nm)};
}

void expect_law(const peers::OneStepLaw& law, double offset_Nm) {
    const double decay = std::exp(-kRate_per_s * kStep_s);
    const double gain = kGain * (1 - decay) / kRate_per_s;
    DOUBLES_EQUAL(decay, law.keeps, 1e-9);
    DOUBLES_EQUAL(gain, law.gain, 1e-9);
    DOUBLES_EQUAL(gain * kCoulomb_Nm, law.friction, 1e-9);
    DOUBLES_EQUAL(gain * offset_Nm, law.offset, 1e-9);
}

}  // namespace

TEST_GROUP(GapPeers){};

TEST(GapPeers, TheRegressionsFindTheLawExactly) {
    expect_law(peers::sysid_regression(runs(0), 0.0762), 0);
    expect_law(peers::plain_least_squares(runs(0)), 0);
    expect_law(peers::plain_least_squares(runs(0.15)), 0.15);
}

TEST(GapPeers, TheirFreeRunIsTheMotion) {
    const std::vector<ForwardRun> all = runs(0.15);
    const std::vector<ForwardRun> training(all.begin(), all.end() - 1);
    DOUBLES_EQUAL(0, peers::squared_error(peers::plain_least_squares(training), all.back()), 1e-12);
}

TEST(GapPeers, DryFrictionHoldsWhatItCan) {
    const peers::OneStepLaw law{.keeps = 1, .gain = 1, .friction = 0.5};
    ForwardRun run = standing(6);
    run.torque_Nm << 0.4, 0.7, -0.1, 0.2, -0.9, 0;
    const Eigen::VectorXd speed = peers::simulate(law, run);
    const std::array expected{0.0, 0.0, 0.2, 0.0, 0.0, -0.4};
    for (Eigen::Index k = 0; k < 6; ++k) DOUBLES_EQUAL(expected[std::size_t(k)], speed(k), 1e-12);
}

TEST(GapPeers, StepsAtStandstillSayNothing) {
    ForwardRun run = standing(5);
    run.speed_rad_per_s << 0, 2, 3, 0.5, -2;
    const std::vector<Eigen::Index> steps = peers::moving_steps(run, 1);
    LONGS_EQUAL(1, steps.size());
    LONGS_EQUAL(1, steps.front());
}

TEST(GapPeers, TheInertiaAlone) {
    ForwardRun run = standing(3);
    run.speed_rad_per_s << 0, 2, 6;
    run.torque_Nm << 1, 2, 9;  // the last one moves nothing any more
    const peers::OneStepLaw law = peers::torque_alone(std::vector<ForwardRun>{run});
    DOUBLES_EQUAL((1 * 2 + 2 * 4) / 5.0, law.gain, 1e-12);
    DOUBLES_EQUAL(1, law.keeps, 0);
}
