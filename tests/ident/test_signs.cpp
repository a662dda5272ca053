// Which way the wheels go is not known at first: what the ident mode may do until then, and what it keeps.
// The whole run with its probe, on a robot of its own, judged by that robot's true motion.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "firmware/ident/identification_run.hpp"
#include "tests/ident/test_robot.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using ident::IdentCause;
using test::RobotTruth;
using test::TestRobot;
using test::with_k5;

TEST_GROUP(UnknownSigns){};

namespace {

// By its file; a room from which as much follows.
constexpr double kSpeed_m_per_s = 0.8;
constexpr double kRoom_m = 1.5;

struct Drive {
    ident::IdentificationRun<double> run;
    double fastest_m_per_s = 0, fastest_rad_per_s = 0, farthest_m = 0;
    // while the signs were not known
    double before_m_per_s = 0;
};

// left, right: -1 where that wheel goes backwards. `pose`: an external pose without noise, 20 a second.
Drive drive(const RobotTruth& truth, double left, double right, double yaw_rate_limit_rad_per_s,
            bool pose = false, double duration_s = 85, double coupling_standard_error_m = 0) {
    ident::IdentificationOptions<double> o;
    o.excitation = {0, 0, 0.001, kSpeed_m_per_s, yaw_rate_limit_rad_per_s, kRoom_m};
    o.estimator.filter.geometry = test::geometry_of(truth);
    o.estimator.filter.effects = test::both_frictions<double>();
    o.estimator.filter.sample_time_s = 0.001;
    o.delay_phase_s = 1;
    o.duration_s = duration_s;
    o.probe = true;
    o.probing.geometry = o.estimator.filter.geometry;
    o.probing.sample_time_s = 0.001;
    o.probing.torque_limit_Nm = 5;
    o.probing.speed_limit_m_per_s = kSpeed_m_per_s;
    o.probing.yaw_rate_limit_rad_per_s = yaw_rate_limit_rad_per_s;
    o.probing.distance_limit_m = kRoom_m;
    o.probing.pose_noise_m = 0.002;
    o.probing.heading_noise_rad = 0.004;
    o.sizing.track_m = truth.track_m;
    o.sizing.radius_m = truth.radius_m;
    o.sizing.sample_time_s = 0.001;
    o.sizing.distance_limit_m = kRoom_m;
    o.sizing.torque_limit_Nm = 5;
    o.sizing.robot_speed_limit_m_per_s = kSpeed_m_per_s;
    o.sizing.robot_yaw_rate_limit_rad_per_s = yaw_rate_limit_rad_per_s;
    o.sizing.coupling_standard_error_m = coupling_standard_error_m;
    Drive result;
    ident::IdentificationRun<double>& run = result.run;
    run.start(o, {}, 5);
    TestRobot robot(truth, 23);
    const double half_track_m = truth.track_m / 2;
    WheelPair<double> torque{};
    Pose<double> seen;  // by the wheels, as the file says
    Pose<double> true_pose;
    for (int cycle = 0; !run.finished(); ++cycle) {
        const Twist<double> u = robot.velocity();
        const double rim_left = left * (u.v_m_per_s - half_track_m * u.omega_rad_per_s);
        const double rim_right = right * (u.v_m_per_s + half_track_m * u.omega_rad_per_s);
        const Twist<double> filed{(rim_right + rim_left) / 2, (rim_right - rim_left) / truth.track_m};
        seen = model::advance_along_arc(seen, 1e-3 * filed.v_m_per_s, 1e-3 * filed.omega_rad_per_s);
        const Twist<double> truly = robot.true_velocity();
        true_pose = model::advance_along_arc(true_pose, 1e-3 * truly.v_m_per_s, 1e-3 * truly.omega_rad_per_s);
        ident::ProbeSample senses;
        senses.angle_rad = {left * robot.angle_rad().left, right * robot.angle_rad().right};
        senses.pose_is_new = pose && cycle % 50 == 0;
        senses.pose = true_pose;
        torque = run.step({senses.angle_rad, torque}, seen, filed, senses);
        robot.step(left * torque.left, right * torque.right);
        result.fastest_m_per_s = std::max(result.fastest_m_per_s, std::abs(truly.v_m_per_s));
        result.fastest_rad_per_s = std::max(result.fastest_rad_per_s, std::abs(truly.omega_rad_per_s));
        result.farthest_m = std::max(result.farthest_m, robot.true_distance_m());
        if (!run.signs_known()) result.before_m_per_s = result.fastest_m_per_s;
    }
    return result;
}

}  // namespace

TEST(UnknownSigns, one_wrong_sign_drives_within_the_real_limits_until_it_has_its_name) {
    for (const double yaw_rate : {1.0, 5.0, 20.0})
        for (const double k5_m : {0.0413, -0.01, 0.0})
            for (const double left : {-1.0, 1.0}) {
                const Drive d = drive(with_k5(k5_m), left, -left, yaw_rate);
                std::printf(
                    "\n  limit %4.1f rad/s, K5 %7.4f m, %s wheel: %-20s after %4.1f s, at most %.2f m/s, "
                    "%.2f rad/s, %.2f m",
                    yaw_rate, k5_m, left < 0 ? "left" : "right",
                    std::string(to_string_view(d.run.cause())).c_str(), d.run.elapsed_s(), d.fastest_m_per_s,
                    d.fastest_rad_per_s, d.farthest_m);
                CHECK(d.fastest_m_per_s <= kSpeed_m_per_s);
                CHECK(d.fastest_rad_per_s <= yaw_rate);
                CHECK(d.farthest_m <= kRoom_m);
                CHECK_FALSE(d.run.signs_known());
                // at 1 rad/s a centimetre pushes the robot with a thousandth of g
                if (k5_m > 0.04 || (k5_m != 0 && yaw_rate > 1))
                    CHECK(d.run.cause() == IdentCause::one_sign_wrong);
            }
    std::printf("\n");
}

TEST(UnknownSigns, the_limits_of_the_file_hold_once_the_signs_are_known) {
    for (const bool pose : {false, true}) {
        const Drive d = drive(RobotTruth{}, 1, 1, 1.0, pose);
        CHECK(d.run.cause() == IdentCause::good_enough);
        CHECK(d.run.signs_known());
        CHECK_EQUAL(!pose, d.run.signs_agree() && !d.run.findings().pose_seen);
        const double either_m_per_s = 1.0 * RobotTruth{}.track_m / 2;
        CHECK(d.before_m_per_s <= either_m_per_s);
        CHECK(d.fastest_m_per_s > 1.5 * either_m_per_s);
        CHECK(d.fastest_m_per_s <= kSpeed_m_per_s);
    }
}

// Nothing tells then: slow until time is up, K7 and K8 are right all the same, and the end says that the
// signs are not known to be.
TEST(UnknownSigns, a_centre_of_gravity_above_the_axle_leaves_them_unknown) {
    const RobotTruth truth = with_k5(0);
    constexpr double kYawRate_rad_per_s = 2.5;
    const Drive d = drive(truth, 1, 1, kYawRate_rad_per_s);
    CHECK(d.run.cause() == IdentCause::direction_unverified);
    CHECK(d.run.coupling_known());
    CHECK_FALSE(d.run.signs_known());
    CHECK_FALSE(d.run.signs_agree());
    CHECK(d.fastest_m_per_s <= kYawRate_rad_per_s * truth.track_m / 2);
    DOUBLES_EQUAL(truth.k7, d.run.estimate().dynamics.k7_per_kg_m, 0.01 * truth.k7);
    DOUBLES_EQUAL(truth.k8, d.run.estimate().dynamics.k8_per_kg_m2, 0.01 * truth.k8);
}

// Time is up before K5 and K6 are known as well as asked; 1.5 % of themselves will do then. One wrong sign
// would show in them: where they are too little to tell, nothing is kept.
TEST(UnknownSigns, K7_and_K8_alone_are_kept_only_where_they_are_known) {
    constexpr double kNeverReached_m = 1e-6;
    const auto end = [&](double k5_m, bool pose, double duration_s = 40) {
        return drive(with_k5(k5_m), 1, 1, 5.0, pose, duration_s, kNeverReached_m).run.cause();
    };
    CHECK(end(0.0413, false) == IdentCause::good_enough);
    CHECK(end(0.003, true, 20) == IdentCause::coupling_not_known);
    CHECK(end(0, true) == IdentCause::coupling_not_known);
    CHECK(end(0, false) == IdentCause::time_over);
}
