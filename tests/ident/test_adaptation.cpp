#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "firmware/ident/adaptive_estimator.hpp"
#include "firmware/ident/model_guard.hpp"
#include "tests/ident/test_robot.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using test::RobotTruth;
using test::TestRobot;

namespace {

struct Reference {
    double v, omega, v_rate, omega_rate;
};

// Gerono figure-8, x = 1.5 sin p, y = 0.75 sin 2p, one lap in 10 s.
Reference figure_eight(double t) {
    const double d = 2 * M_PI / 10;
    const double p = d * t;
    const double x1 = 1.5 * d * std::cos(p), y1 = 1.5 * d * std::cos(2 * p);
    const double x2 = -1.5 * d * d * std::sin(p), y2 = -3 * d * d * std::sin(2 * p);
    const double x3 = -d * d * x1, y3 = -4 * d * d * y1;
    const double s = x1 * x1 + y1 * y1;
    const double v = std::sqrt(s);
    const double v_rate = (x1 * x2 + y1 * y2) / v;
    const double cross = x1 * y2 - y1 * x2;
    return {v, cross / s, v_rate, (x1 * y3 - y1 * x3) / s - cross * 2 * v * v_rate / (s * s)};
}

// The robot driven by feed-forward and a velocity loop with the guarded model, as the firmware's modes do.
template <typename Real>
struct AdaptiveDrive {
    explicit AdaptiveDrive(unsigned seed, const RobotTruth& truth = {}) : robot(truth, seed) {
        ident::AdaptiveEstimatorOptions<Real> o;
        o.filter.geometry = test::geometry_of(truth);
        o.filter.effects = test::both_frictions<Real>();
        o.filter.sample_time_s = 0.001;
        o.filter.kernel_s = 0.05;
        o.filter.delay_s = 0.0027;
        // the controller's file differs from the truth in every number
        o.dynamics = {static_cast<Real>(truth.k5 * 1.05), 0, static_cast<Real>(truth.k7 * 1.01),
                      static_cast<Real>(truth.k8 * 0.99)};
        o.standard_error = {Real(0.003), 0, Real(0.015), Real(0.07)};
        const std::size_t coulomb = model::find_effect("coulomb_friction");
        const std::size_t viscous = model::find_effect("viscous_friction");
        o.effects = o.filter.effects;
        o.effects.parameter[coulomb] = {Real(0.31), Real(0.295)};
        o.effects_standard_error.parameter[coulomb] = {Real(0.01), Real(0.01)};
        o.effects.parameter[viscous] = {Real(0.001), Real(0.0005)};
        o.effects_standard_error.parameter[viscous] = {Real(0.001), Real(0.001)};
        estimator.configure(o);
        guard.configure({Real(0.1), Real(0.5), Real(0.05), Real(3), Real(0.001), Real(0.32)}, o.dynamics,
                        o.effects);
    }

    void cycle(const Reference& r) {
        estimator.push({robot.angle_rad(), told});
        guard.update(estimator.estimate(), true);
        const Twist<double> u = robot.velocity();
        const auto& k = guard.dynamics();
        const auto torque = model::inverse_dynamics<double>(
            {static_cast<double>(k.k5_m), static_cast<double>(k.k6_per_m), static_cast<double>(k.k7_per_kg_m),
             static_cast<double>(k.k8_per_kg_m2)},
            u, {r.v_rate + 100 * (r.v - u.v_m_per_s), r.omega_rate + 100 * (r.omega - u.omega_rad_per_s)});
        apply(torque.left + 0.3, torque.right + 0.3);
    }
    void apply(double left, double right) {
        told = {static_cast<Real>(std::clamp(left, -5.0, 5.0)),
                static_cast<Real>(std::clamp(right, -5.0, 5.0))};
        robot.step(static_cast<double>(told.left), static_cast<double>(told.right));
    }
    // K7 and K8 are what a torque does in its own direction: a sum of 1 Nm to v', with each drive's gain, so
    // that a part of it turns a robot whose centre of gravity is beside the middle, and the turning moves it.
    double error7() const {
        const RobotTruth& t = robot.truth();
        const double mean = (t.gain_left + t.gain_right) / 2, half = (t.gain_right - t.gain_left) / 2;
        const double response = (mean * t.k7 + half * t.offset_m * t.k8) / (1 - robot.coupling());
        return std::abs(static_cast<double>(estimator.estimate().dynamics.k7_per_kg_m) / response - 1);
    }
    double error8() const {
        const RobotTruth& t = robot.truth();
        const double mean = (t.gain_left + t.gain_right) / 2, half = (t.gain_right - t.gain_left) / 2;
        const double response = t.k8 * (mean + half * 2 * t.offset_m / t.track_m) / (1 - robot.coupling());
        return std::abs(static_cast<double>(estimator.estimate().dynamics.k8_per_kg_m2) / response - 1);
    }

    TestRobot robot;
    ident::AdaptiveEstimator<Real> estimator;
    ident::ModelGuard<Real> guard;
    WheelPair<Real> told{};
};

enum class Drop { speed_stays, momentum_stays };

// Returns how many of `seeds` have K7 and K8 within 5 % three seconds after +30 %.
template <typename Real>
int count_adapted(int seeds, Drop drop, const char* what) {
    int good = 0;
    double worst7 = 0, worst8 = 0, friction = 0;
    unsigned changes = 0;
    for (int seed = 0; seed < seeds; ++seed) {
        AdaptiveDrive<Real> drive(300 + static_cast<unsigned>(seed));
        const Reference start = figure_eight(0);
        drive.robot.set_motion(start.v, start.omega);
        const int drop_at = 14000 + 531 * seed;  // all over the lap
        for (int k = 0; k <= drop_at + 3000; ++k) {
            if (k == drop_at && drop == Drop::speed_stays) drive.robot.load(1.3);
            if (k == drop_at && drop == Drop::momentum_stays) drive.robot.drop_load_at_rest(1.3);
            drive.cycle(figure_eight(k * 1e-3));
        }
        const auto& e = drive.estimator.estimate();
        changes = std::max(changes, e.changes);
        worst7 = std::max(worst7, drive.error7());
        worst8 = std::max(worst8, drive.error8());
        for (const Real f : {e.effects.parameter[1][0], e.effects.parameter[1][1]})
            friction = std::max(friction, std::abs(static_cast<double>(f) / 0.3 - 1));
        if (drive.error7() < 0.05 && drive.error8() < 0.05) ++good;
    }
    std::printf("\n  %s: %d of %d; worst K7 %.2f %%, K8 %.2f %%, Coulomb %.1f %%; at most %u changes seen\n",
                what, good, seeds, 100 * worst7, 100 * worst8, 100 * friction, changes);
    return good;
}

}  // namespace

TEST_GROUP(Adaptation){};

TEST(Adaptation, follows_a_payload_within_three_seconds) {
    CHECK(count_adapted<double>(20, Drop::speed_stays, "+30 %, speed stays") >= 19);
}

TEST(Adaptation, follows_a_payload_that_brakes_the_robot_when_it_lands) {
    CHECK(count_adapted<double>(20, Drop::momentum_stays, "+30 %, momentum stays") >= 19);
}

TEST(Adaptation, follows_a_payload_wherever_it_lies_and_learns_k5_again) {
    constexpr std::array<std::array<double, 2>, 5> kPlaces{
        {{0, 0}, {0.12, 0}, {-0.1, 0.05}, {0.04, -0.1}, {0, 0.12}}};
    for (const auto& [ahead_m, left_m] : kPlaces) {
        for (const double gain_right : {1.0, 0.8}) {  // also where one drive is weak
            RobotTruth truth;
            truth.gain_right = gain_right;
            truth.gain_left = 2 - gain_right;
            AdaptiveDrive<double> drive(17, truth);
            const Reference start = figure_eight(0);
            drive.robot.set_motion(start.v, start.omega);
            for (int k = 0; k <= 25000; ++k) {
                if (k == 15000) drive.robot.load_at(0.25, ahead_m, left_m);
                drive.cycle(figure_eight(k * 1e-3));
            }
            const auto& e = drive.estimator.estimate();
            const double k5 = drive.robot.truth().k5;
            std::printf(
                "\n  +25 %% at (%.2f, %.2f), right drive %.1f: K7 %.2f %%, K8 %.2f %%, K5 %.4f of %.4f\n",
                ahead_m, left_m, gain_right, 100 * drive.error7(), 100 * drive.error8(), e.dynamics.k5_m, k5);
            CHECK(drive.error7() < 0.01 && drive.error8() < 0.01);
            DOUBLES_EQUAL(k5, e.dynamics.k5_m, 0.002);
        }
    }
}

TEST(Adaptation, follows_a_payload_in_float) {
    CHECK(count_adapted<float>(10, Drop::speed_stays, "+30 % in float") == 10);
}

TEST(Adaptation, sees_no_change_where_there_is_none) {
    AdaptiveDrive<double> drive(7);
    const Reference start = figure_eight(0);
    drive.robot.set_motion(start.v, start.omega);
    double worst = 0;
    for (int k = 0; k < 300000; ++k) {
        drive.cycle(figure_eight(k * 1e-3));
        if (k > 5000) worst = std::max({worst, drive.error7(), drive.error8()});
    }
    std::printf("\n  five minutes of figure-8: K7 and K8 within %.2f %%, %u changes seen\n", 100 * worst,
                drive.estimator.estimate().changes);
    LONGS_EQUAL(0, drive.estimator.estimate().changes);
    CHECK(worst < 0.01);
}

TEST(Adaptation, parked_for_ten_minutes_nothing_drifts) {
    AdaptiveDrive<float> drive(8);
    const auto before = drive.estimator.estimate();
    for (int k = 0; k < 600000; ++k) {
        drive.estimator.push({drive.robot.angle_rad(), drive.told});
        drive.apply(k % 1000 < 500 ? 0.1 : -0.15, 0.05);  // friction holds
    }
    const auto& after = drive.estimator.estimate();
    DOUBLES_EQUAL(before.dynamics.k5_m, after.dynamics.k5_m, 0);
    DOUBLES_EQUAL(before.dynamics.k7_per_kg_m, after.dynamics.k7_per_kg_m, 0);
    DOUBLES_EQUAL(before.dynamics.k8_per_kg_m2, after.dynamics.k8_per_kg_m2, 0);
    DOUBLES_EQUAL(before.covariance_diagonal.k7_per_kg_m, after.covariance_diagonal.k7_per_kg_m, 0);
    DOUBLES_EQUAL(before.effects.parameter[1][0], after.effects.parameter[1][0], 0);
    LONGS_EQUAL(0, after.rows);
    std::printf("\n  parked: %u rows used, %u masked\n", after.rows, after.masked_rows);
    CHECK(after.masked_rows > 10000);
}

TEST(Adaptation, a_circle_at_constant_speed_freezes_what_it_does_not_excite) {
    AdaptiveDrive<double> drive(9);
    // first a lap that teaches everything, then ten minutes of circle
    const Reference start = figure_eight(0);
    drive.robot.set_motion(start.v, start.omega);
    for (int k = 0; k < 20000; ++k) drive.cycle(figure_eight(k * 1e-3));
    for (int k = 0; k < 10000; ++k) drive.cycle({0.8, 0.6, 0, 0});
    const auto settled = drive.estimator.estimate();
    double largest_variance = 0;
    for (int k = 0; k < 600000; ++k) {
        drive.cycle({0.8, 0.6, 0, 0});
        largest_variance =
            std::max(largest_variance, drive.estimator.estimate().covariance_diagonal.k8_per_kg_m2);
    }
    const auto& after = drive.estimator.estimate();
    const double moved7 = std::abs(after.dynamics.k7_per_kg_m / settled.dynamics.k7_per_kg_m - 1);
    const double moved8 = std::abs(after.dynamics.k8_per_kg_m2 / settled.dynamics.k8_per_kg_m2 - 1);
    std::printf("\n  ten minutes of circle: K7 moved %.4f %%, K8 %.4f %%; excitation %.3f and %.3f\n",
                100 * moved7, 100 * moved8, after.excitation.k7_per_kg_m, after.excitation.k8_per_kg_m2);
    CHECK(drive.estimator.frozen().k7 && drive.estimator.frozen().k8);
    CHECK(moved7 < 0.002 && moved8 < 0.002);
    CHECK(drive.error7() < 0.01 && drive.error8() < 0.01);
    // no more doubt than a load's share put on unnoticed, evenly anything up to 0.3
    const double load = 0.3 * settled.dynamics.k8_per_kg_m2;
    CHECK(largest_variance <= load * load / 3 + 4 * settled.covariance_diagonal.k8_per_kg_m2);
    // and it still follows a payload when the figure-8 begins again
    drive.robot.load(1.3);
    for (int k = 0; k < 10000; ++k) drive.cycle(figure_eight(k * 1e-3));
    CHECK(drive.error7() < 0.05 && drive.error8() < 0.05);
}

TEST(Adaptation, ties_k5_and_k6) {
    AdaptiveDrive<double> drive(10);
    const Reference start = figure_eight(0);
    drive.robot.set_motion(start.v, start.omega);
    for (int k = 0; k < 15000; ++k) drive.cycle(figure_eight(k * 1e-3));
    const auto& k = drive.estimator.estimate().dynamics;
    DOUBLES_EQUAL(-k.k5_m * 2 * k.k8_per_kg_m2 / (0.32 * k.k7_per_kg_m), k.k6_per_m, 1e-12);
    DOUBLES_EQUAL(drive.robot.truth().k5, k.k5_m, 0.02 * drive.robot.truth().k5);
}

TEST(Adaptation, learns_nothing_from_rows_marked_unusable) {
    AdaptiveDrive<double> drive(11);
    for (int k = 0; k < 20000; ++k) {
        ident::IdentSample<double> sample{drive.robot.angle_rad(), drive.told};
        sample.usable = k % 20 != 0;  // slip is flagged now and then
        drive.estimator.push(sample);
        drive.apply(k % 400 < 200 ? 2 : -1, 1);
    }
    LONGS_EQUAL(0, drive.estimator.estimate().rows);
}

TEST_GROUP(GuardedModel) {
    static constexpr double kDwell_s = 0.1;
    static constexpr double kRate_per_s = 0.5;
    ident::ModelGuard<double> guard;
    ident::DynamicsEstimate<double> estimate;

    void setup() override {
        const model::Dynamics<double> file{0.04, model::coupled_k6(0.04, 1.4, 6.7, 0.32), 1.4, 6.7};
        guard.configure({kDwell_s, kRate_per_s, 0.05, 3, 0.001, 0.32}, file, {});
        estimate.dynamics = file;
        estimate.standard_error = {0.001, 0.01, 0.01, 0.05};
    }
    void run(double seconds, bool may_adapt = true) {
        for (int k = 0; k < std::lround(seconds * 1000); ++k) guard.update(estimate, may_adapt);
    }
};

TEST(GuardedModel, follows_a_trusted_estimate_at_a_bounded_rate_and_dwell) {
    estimate.dynamics.k7_per_kg_m = 1.0;
    double last = 1.4;
    int last_change = -100;
    for (int k = 0; k < 3000; ++k) {
        guard.update(estimate, true);
        const double now = guard.dynamics().k7_per_kg_m;
        if (now == last) continue;
        CHECK(k - last_change >= 100);
        CHECK(std::abs(now - last) <= kRate_per_s * kDwell_s * 1.4 + 1e-12);
        last = now;
        last_change = k;
    }
    DOUBLES_EQUAL(1.0, last, 1e-12);
    const auto& k = guard.dynamics();
    DOUBLES_EQUAL(model::coupled_k6(k.k5_m, k.k7_per_kg_m, k.k8_per_kg_m2, 0.32), k.k6_per_m, 1e-12);
}

// A robot that is larger in all its lengths follows a load in the same time.
TEST(GuardedModel, follows_K5_from_nothing_in_proportion_to_the_robot) {
    const auto moved_in_a_second = [&](double track_m) {
        const model::Dynamics<double> file{0, 0, 1.4, 6.7};
        guard.configure({kDwell_s, kRate_per_s, 0.05, 3, 0.001, track_m}, file, {});
        estimate.dynamics = file;
        estimate.dynamics.k5_m = 0.2 * track_m;
        run(1);
        return guard.dynamics().k5_m / track_m;
    };
    const double small = moved_in_a_second(0.11);
    CHECK(small > 0.01);
    DOUBLES_EQUAL(small, moved_in_a_second(0.9), 1e-12);
}

TEST(GuardedModel, holds_when_the_estimate_is_uncertain_or_adaptation_is_barred) {
    estimate.dynamics.k8_per_kg_m2 = 5.0;
    estimate.standard_error.k8_per_kg_m2 = 0.6;
    run(2);
    DOUBLES_EQUAL(6.7, guard.dynamics().k8_per_kg_m2, 0);
    CHECK(guard.state() == ident::GuardState::holding);
    estimate.standard_error.k8_per_kg_m2 = 0.05;
    run(2, false);
    DOUBLES_EQUAL(6.7, guard.dynamics().k8_per_kg_m2, 0);
    run(2);
    DOUBLES_EQUAL(5.0, guard.dynamics().k8_per_kg_m2, 1e-12);
}

TEST(GuardedModel, goes_back_to_the_robot_files_model_when_the_estimate_is_absurd) {
    estimate.dynamics.k7_per_kg_m = 1.1;
    run(2);
    DOUBLES_EQUAL(1.1, guard.dynamics().k7_per_kg_m, 1e-12);
    const model::Dynamics<double> good = estimate.dynamics;
    const auto absurd = [&](double model::Dynamics<double>::*which, double value) {
        estimate.dynamics.*which = value;
        run(2);
        CHECK(guard.state() == ident::GuardState::reverting);
        DOUBLES_EQUAL(1.4, guard.dynamics().k7_per_kg_m, 1e-12);
        estimate.dynamics = good;
        run(2);
        DOUBLES_EQUAL(1.1, guard.dynamics().k7_per_kg_m, 1e-12);
    };
    for (const double value : {std::nan(""), 14.0, 0.3, -1.4, HUGE_VAL})
        absurd(&model::Dynamics<double>::k7_per_kg_m, value);
    for (const double value : {std::nan(""), 67.0, 1.5, -6.7, HUGE_VAL})
        absurd(&model::Dynamics<double>::k8_per_kg_m2, value);
    absurd(&model::Dynamics<double>::k5_m, std::nan(""));
}
