// Drives that deliver less than they are told, after the probe has found nothing wrong.
#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "firmware/ident/identification_run.hpp"
#include "tests/ident/test_robot.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using test::RobotTruth;
using test::TestRobot;

TEST_GROUP(DeliveredTorque){};

namespace {

constexpr double kLimit_Nm = 5;

// The whole ident mode, without torque reports; after the probe the drives deliver `most_Nm` at most.
// Returns the standard errors of what less torque does more, since it has one.
std::vector<double> identify(ident::IdentificationRun<double>& run, const RobotTruth& truth, double most_Nm,
                             unsigned seed = 91) {
    ident::IdentificationOptions<double> o;
    o.excitation = {0, 0, 0.001, 0.8, 5, 1.5};
    o.estimator.filter.geometry = test::geometry_of(truth);
    o.estimator.filter.effects = test::both_frictions<double>();
    o.estimator.filter.sample_time_s = 0.001;
    o.delay_phase_s = 4;
    o.duration_s = 85;
    o.probe = true;
    o.probing.geometry = o.estimator.filter.geometry;
    o.probing.sample_time_s = 0.001;
    o.probing.torque_limit_Nm = kLimit_Nm;
    o.probing.speed_limit_m_per_s = 0.8;
    o.probing.yaw_rate_limit_rad_per_s = 5;
    o.probing.distance_limit_m = 1.5;
    o.sizing.track_m = truth.track_m;
    o.sizing.radius_m = truth.radius_m;
    o.sizing.sample_time_s = 0.001;
    o.sizing.distance_limit_m = 1.5;
    o.sizing.torque_limit_Nm = kLimit_Nm;
    o.sizing.robot_speed_limit_m_per_s = 0.8;
    o.sizing.robot_yaw_rate_limit_rad_per_s = 5;
    run.start(o, {}, 5);
    TestRobot robot(truth, seed);
    WheelPair<double> torque{};
    std::vector<double> errors;
    while (!run.finished()) {
        ident::ProbeSample senses;
        senses.angle_rad = robot.angle_rad();
        torque = run.step({robot.angle_rad(), torque}, robot.odometry(), robot.velocity(), senses);
        const double most = run.state() == ident::IdentState::probing ? kLimit_Nm : most_Nm;
        robot.step(std::clamp(torque.left, -most, most), std::clamp(torque.right, -most, most));
        if (run.estimator() == nullptr) continue;
        const double error = run.estimator()->excess_of_less_torque().standard_error;
        if (error < 1e8 && (errors.empty() || errors.back() != error)) errors.push_back(error);
    }
    return errors;
}

}  // namespace

TEST(DeliveredTorque, less_of_it_is_seen_without_reports_and_the_run_goes_on_with_less) {
    const RobotTruth truth;
    ident::IdentificationRun<double> run;
    identify(run, truth, kLimit_Nm);
    CHECK(run.cause() == ident::IdentCause::good_enough);
    CHECK_FALSE(run.findings().clipped);
    const double amplitude_Nm = run.options().excitation.amplitude_Nm;

    identify(run, truth, 0.7 * amplitude_Nm);
    CHECK(run.cause() == ident::IdentCause::good_enough);
    CHECK(run.findings().clipped);
    CHECK(run.findings().torque_limit_Nm < 0.8 * amplitude_Nm);
    CHECK(run.options().excitation.amplitude_Nm < 0.7 * amplitude_Nm);
    DOUBLES_EQUAL(truth.k7, run.estimate().dynamics.k7_per_kg_m, 0.02 * truth.k7);
    DOUBLES_EQUAL(truth.k8, run.estimate().dynamics.k8_per_kg_m2, 0.02 * truth.k8);
}

// Of a few of its rows the standard error may be anything. (Two of 1400 drawn robots were called clipped.)
TEST(DeliveredTorque, the_first_rows_of_less_torque_hardly_speak_for_it) {
    const RobotTruth truth;
    ident::IdentificationRun<double> run;
    const std::vector<double> errors = identify(run, truth, kLimit_Nm);
    CHECK(errors.size() > 10);
    CHECK(errors.front() > 100 * errors.back());
    CHECK(errors.back() < 0.002);
}

// So little that the probe's rough K7 and K8 cannot show it, and far more than the standard errors.
TEST(DeliveredTorque, a_few_per_cent_less_show_where_the_torque_is_less_now_and_then) {
    const RobotTruth truth;
    ident::IdentificationRun<double> run;
    for (const unsigned seed : {91U, 92U, 93U}) {
        identify(run, truth, kLimit_Nm, seed);
        CHECK_FALSE(run.findings().clipped);
    }
    const double amplitude_Nm = run.options().excitation.amplitude_Nm;
    for (const double share : {0.96, 0.98, 0.99}) {
        identify(run, truth, share * amplitude_Nm);
        std::printf(
            "\n  %.0f %% delivered: %s after %.1f s, limit %.3f of the amplitude, K7 %+.3f %%, K8 %+.3f %%",
            100 * share, std::string(to_string_view(run.cause())).c_str(), run.elapsed_s(),
            run.findings().torque_limit_Nm / amplitude_Nm,
            100 * (run.estimate().dynamics.k7_per_kg_m / truth.k7 - 1),
            100 * (run.estimate().dynamics.k8_per_kg_m2 / truth.k8 - 1));
        CHECK(run.cause() == ident::IdentCause::good_enough);
        CHECK(run.findings().clipped);
        DOUBLES_EQUAL(truth.k7, run.estimate().dynamics.k7_per_kg_m, 0.001 * truth.k7);
        DOUBLES_EQUAL(truth.k8, run.estimate().dynamics.k8_per_kg_m2, 0.001 * truth.k8);
    }
    std::printf("\n");
}
