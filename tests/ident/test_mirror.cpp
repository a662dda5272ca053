// One wheel that goes backwards: seen in how forward motion and turning act on each other, without a look
// from outside.
#include <cmath>

#include "firmware/ident/identification_run.hpp"
#include "firmware/ident/mirror_test.hpp"
#include "tests/ident/test_robot.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using ident::Mirror;
using test::RobotTruth;
using test::TestRobot;
using test::with_k5;

TEST_GROUP(MirrorImage){};

namespace {

// The ident mode, without a probe, on a robot whose left or right wheel goes backwards; none: 0.
ident::IdentCause end_with(const RobotTruth& truth, int wrong_side, bool& signs_agree) {
    ident::IdentificationOptions<double> o;
    o.excitation = {5, 0.01, 0.001, 0.8, 5, 1.5};
    o.estimator.filter.geometry = test::geometry_of(truth);
    o.estimator.filter.effects = test::both_frictions<double>();
    o.estimator.filter.sample_time_s = 0.001;
    o.estimator.filter.kernel_s = 0.0165;
    o.delay_phase_s = 4;
    o.duration_s = 40;
    ident::IdentificationRun<double> run;
    run.start(o, {}, 3);
    TestRobot robot(truth, 17);
    const double half_track_m = truth.track_m / 2;
    const double left = wrong_side < 0 ? -1 : 1;
    const double right = wrong_side > 0 ? -1 : 1;
    WheelPair<double> torque{};
    while (!run.finished()) {
        const WheelPair<double>& angle = robot.angle_rad();
        const Twist<double>& u = robot.velocity();
        const double rim_left = left * (u.v_m_per_s - half_track_m * u.omega_rad_per_s);
        const double rim_right = right * (u.v_m_per_s + half_track_m * u.omega_rad_per_s);
        torque = run.step({{left * angle.left, right * angle.right}, torque}, {},
                          {(rim_right + rim_left) / 2, (rim_right - rim_left) / truth.track_m});
        robot.step(left * torque.left, right * torque.right);
    }
    signs_agree = run.signs_agree();
    return run.cause();
}

}  // namespace

TEST(MirrorImage, one_wrong_sign_ends_the_run_with_its_name) {
    bool agree = true;
    for (const double k5_m : {0.0413, -0.0413, 0.004})
        for (const int side : {-1, 1}) {
            CHECK(end_with(with_k5(k5_m), side, agree) == ident::IdentCause::one_sign_wrong);
            CHECK_FALSE(agree);
        }
}

TEST(MirrorImage, right_signs_are_seen_to_agree) {
    bool agree = false;
    for (const double k5_m : {0.0413, -0.0413, 0.004}) {
        CHECK(end_with(with_k5(k5_m), 0, agree) == ident::IdentCause::good_enough);
        CHECK(agree);
    }
}

TEST(MirrorImage, a_centre_of_gravity_above_the_axle_tells_nothing) {
    bool agree = true;
    CHECK(end_with(with_k5(0), 0, agree) == ident::IdentCause::good_enough);
    CHECK_FALSE(agree);
}

namespace {

// What a robot's equations have, each known to a thousandth of K5's size.
ident::CouplingTerms<double> terms(double k5_m, double k6_per_m, double c_per_m, double d_per_m3) {
    ident::CouplingTerms<double> t;
    t.k7_per_kg_m = 0.4;
    t.k8_per_kg_m2 = 2.1;
    t.filed = {{{k5_m, 1e-4}, {k6_per_m, 2e-3}}};
    t.mirrored = {{{c_per_m, 1e-3}, {d_per_m3, 1e-2}}};
    return t;
}

}  // namespace

TEST(MirrorImage, has_to_show_in_both_equations_and_alike) {
    constexpr double h = 0.23;
    constexpr double k = 0.06;
    const double c = -k * 0.4 / (h * h * 2.1);
    const double d = k / (h * h * h);
    CHECK(judge_mirror(terms(0, 0, c, d), h) == Mirror::mirrored);
    CHECK(judge_mirror(terms(0, 0, -c, -d), h) == Mirror::mirrored);
    CHECK(judge_mirror(terms(k, -k * 2.1 / (h * 0.4), 0, 0), h) == Mirror::as_filed);
    // a centre of gravity beside the middle: v omega in v', no v^2 in omega'
    CHECK(judge_mirror(terms(0, 0, c, 0), h) == Mirror::unknown);
    CHECK(judge_mirror(terms(0, 0, c, -d), h) == Mirror::unknown);
    CHECK(judge_mirror(terms(0, 0, c, 3 * d), h) == Mirror::unknown);
    // as much of one as of the other
    CHECK(judge_mirror(terms(k, -k * 2.1 / (h * 0.4), c, d), h) == Mirror::unknown);
    // nothing known yet
    CHECK(judge_mirror(ident::CouplingTerms<double>{}, h) == Mirror::unknown);
}
