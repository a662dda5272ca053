#include <cmath>
#include <cstdio>
#include <random>

#include "firmware/ident/identification_run.hpp"
#include "tests/ident/test_robot.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using test::RobotTruth;
using test::TestRobot;

namespace {

template <typename Real>
ident::IdentificationOptions<Real> options_for(const RobotTruth& truth) {
    ident::IdentificationOptions<Real> o;
    o.excitation = {Real(5), 0.01, 0.001, Real(0.8), Real(5), Real(1.5)};
    o.estimator.filter.geometry = test::geometry_of(truth);
    o.estimator.filter.effects = test::both_frictions<Real>();
    o.estimator.filter.sample_time_s = 0.001;
    o.estimator.filter.kernel_s = 0.0165;  // blocks of 11 ms: no common factor with the bits
    o.delay_phase_s = 4;
    o.duration_s = 24;
    o.run_full_time = true;
    return o;
}

// The ident mode on the test robot; the only things that cross are angles, odometry and torques.
template <typename Real>
void identify(ident::IdentificationRun<Real>& run, const ident::IdentificationOptions<Real>& options,
              const RobotTruth& truth, unsigned seed) {
    TestRobot robot(truth, 1000 + seed);
    run.start(options, {}, seed);
    WheelPair<Real> torque{};
    while (!run.finished()) {
        const Pose<double>& pose = robot.odometry();
        const Twist<double>& u = robot.velocity();
        torque = run.step(
            {robot.angle_rad(), torque},
            {static_cast<Real>(pose.x_m), static_cast<Real>(pose.y_m), static_cast<Real>(pose.heading_rad)},
            {static_cast<Real>(u.v_m_per_s), static_cast<Real>(u.omega_rad_per_s)});
        robot.step(static_cast<double>(torque.left), static_cast<double>(torque.right));
    }
}

template <typename Real>
std::array<double, 4> values(const model::Dynamics<Real>& k) {
    return {static_cast<double>(k.k5_m), static_cast<double>(k.k6_per_m), static_cast<double>(k.k7_per_kg_m),
            static_cast<double>(k.k8_per_kg_m2)};
}
std::array<double, 4> truth_of(const RobotTruth& t) { return {t.k5, t.k6, t.k7, t.k8}; }

constexpr const char* kNames[] = {"K5", "K6", "K7", "K8"};

}  // namespace

TEST_GROUP(Identification){};

TEST(Identification, finds_all_four_within_two_percent_with_honest_intervals) {
    constexpr int kSeeds = test::seeds(200);
    double mean[6]{}, square[6]{}, worst[6]{};
    int covered[6]{};
    const auto note = [&](std::size_t i, double error, double standard_error, double size) {
        const double z = error / standard_error;
        mean[i] += z / kSeeds;
        square[i] += z * z / kSeeds;
        covered[i] += std::abs(z) < 1.96 ? 1 : 0;
        worst[i] = std::max(worst[i], std::abs(error) / size);
    };
    const RobotTruth truth;
    ident::IdentificationRun<double> run;
    for (unsigned seed = 1; seed <= kSeeds; ++seed) {
        identify(run, options_for<double>(truth), truth, seed);
        CHECK(run.state() == ident::IdentState::done);
        const auto& e = run.estimate();
        for (std::size_t i = 0; i < 4; ++i)
            note(i, values(e.dynamics)[i] - truth_of(truth)[i], values(e.standard_error)[i],
                 std::abs(truth_of(truth)[i]));
        const std::size_t coulomb = model::find_effect("coulomb_friction");
        note(4, e.effects.parameter[coulomb][0] - truth.coulomb_left_Nm,
             e.effects_standard_error.parameter[coulomb][0], truth.coulomb_left_Nm);
        const double delay = truth.delay_s + truth.lag_s;
        note(5, run.delay().delay_s - delay, run.delay().standard_error_s, delay);
    }
    std::printf("\n  %d seeds, 20 s of excitation each:\n", kSeeds);
    for (std::size_t i = 0; i < 6; ++i)
        std::printf("  %-7s worst %.3f %%, mean z %+.2f, rms z %.2f, 95 %% interval covers %.0f %%\n",
                    i < 4    ? kNames[i]
                    : i == 4 ? "Coulomb"
                             : "delay",
                    100 * worst[i], mean[i], std::sqrt(square[i]), 100.0 * covered[i] / kSeeds);
    for (std::size_t i = 0; i < 4; ++i) {
        CHECK(worst[i] < 0.02);
        if (!test::all_seeds()) continue;
        CHECK(std::abs(mean[i]) < 0.3 + 1 / std::sqrt(kSeeds));
        CHECK(std::sqrt(square[i]) > 0.8 && std::sqrt(square[i]) < 1.25);
        CHECK(covered[i] >= 0.88 * kSeeds);
    }
    CHECK(worst[4] < 0.02);
    CHECK(worst[5] * (truth.delay_s + truth.lag_s) < 1e-4);
}

TEST(Identification, works_the_same_in_float) {
    const RobotTruth truth;
    ident::IdentificationRun<float> in_float;
    ident::IdentificationRun<double> in_double;
    for (unsigned seed = 1; seed <= 4; ++seed) {
        identify(in_float, options_for<float>(truth), truth, seed);
        identify(in_double, options_for<double>(truth), truth, seed);
        CHECK(in_float.state() == ident::IdentState::done);
        for (std::size_t i = 0; i < 4; ++i) {
            const double t = std::abs(truth_of(truth)[i]);
            CHECK(std::abs(values(in_float.estimate().dynamics)[i] - truth_of(truth)[i]) < 0.02 * t);
            const double ratio = values(in_float.estimate().standard_error)[i] /
                                 values(in_double.estimate().standard_error)[i];
            CHECK(ratio > 0.8 && ratio < 1.25);
        }
    }
}

TEST(Identification, left_and_right_friction_of_their_own_come_out_on_their_own_side) {
    RobotTruth truth;
    truth.coulomb_left_Nm = 0.2;
    truth.coulomb_right_Nm = 0.45;
    truth.viscous_left = 0.013;
    truth.viscous_right = 0.027;
    ident::IdentificationRun<double> run;
    identify(run, options_for<double>(truth), truth, 3);
    const auto& found = run.estimate().effects.parameter;
    const std::size_t coulomb = model::find_effect("coulomb_friction");
    const std::size_t viscous = model::find_effect("viscous_friction");
    DOUBLES_EQUAL(0.2, found[coulomb][0], 0.01);
    DOUBLES_EQUAL(0.45, found[coulomb][1], 0.01);
    DOUBLES_EQUAL(0.013, found[viscous][0], 0.0015);
    DOUBLES_EQUAL(0.027, found[viscous][1], 0.0015);
    DOUBLES_EQUAL(truth.k7, run.estimate().dynamics.k7_per_kg_m, 0.005 * truth.k7);
}

TEST(Identification, without_friction_columns_its_errors_say_that_something_is_missing) {
    const RobotTruth truth;
    auto options = options_for<double>(truth);
    options.estimator.filter.effects = {};
    ident::IdentificationRun<double> run;
    identify(run, options, truth, 2);
    const double error = run.estimate().dynamics.k7_per_kg_m - truth.k7;
    const double errors = std::abs(error) / run.estimate().standard_error.k7_per_kg_m;
    std::printf("\n  without friction columns K7 is %.1f %% wrong, %.0f standard errors\n",
                100 * error / truth.k7, errors);
    CHECK(errors < 3);
    CHECK(run.model_incomplete());
    CHECK(std::abs(error) > 0.005 * truth.k7);  // something is
}

namespace {

// Root mean square error over standard error of K5..K8, some seeds.
std::array<double, 4> rms_z(const ident::IdentificationOptions<double>& options, const RobotTruth& truth) {
    constexpr unsigned kSeeds = 12;
    std::array<double, 4> square{};
    for (unsigned seed = 0; seed < kSeeds; ++seed) {
        ident::IdentificationRun<double> run;
        identify(run, options, truth, seed);
        const auto value = values(run.estimate().dynamics);
        const auto error = values(run.estimate().standard_error);
        for (std::size_t i = 0; i < 4; ++i)
            square[i] += std::pow((value[i] - truth_of(truth)[i]) / error[i], 2) / kSeeds;
    }
    std::printf("\n  rms z");
    for (std::size_t i = 0; i < 4; ++i) std::printf("  %s %.2f", kNames[i], std::sqrt(square[i]));
    return {std::sqrt(square[0]), std::sqrt(square[1]), std::sqrt(square[2]), std::sqrt(square[3])};
}

}  // namespace

TEST(Identification, does_not_take_wheels_less_alike_than_the_file_says_for_another_K5_or_K6) {
    const RobotTruth truth;
    auto options = options_for<double>(truth);
    options.estimator.filter.geometry.wheel_radius_m.left *= 1.01;
    options.estimator.filter.geometry.wheel_radius_m.right *= 0.99;
    for (const double z : rms_z(options, truth)) CHECK(z < 1.7);
}

TEST(Identification, does_not_take_dry_friction_about_a_reversal_for_a_smaller_K7_or_K8) {
    RobotTruth truth;
    truth.counts_per_turn = 8192;  // so that nobody knows when a wheel turns round
    truth.angle_noise_rad = 0;
    truth.coulomb_left_Nm = truth.coulomb_right_Nm = 0.7;
    auto options = options_for<double>(truth);
    options.excitation.amplitude_Nm = 2.5;
    options.excitation.bit_time_s = 0.02;
    options.estimator.filter.speed_span = 4;
    options.estimator.filter.standing_speed_rad_per_s = 0.4;
    options.estimator.filter.standing_samples = 12;
    for (const double z : rms_z(options, truth)) CHECK(z < 1.7);
}

TEST(Identification, stops_by_itself_when_the_errors_are_small_enough) {
    const RobotTruth truth;
    auto options = options_for<double>(truth);
    options.run_full_time = false;
    options.estimator.relative_standard_error = 0.005;
    ident::IdentificationRun<double> run;
    identify(run, options, truth, 5);
    std::printf("\n  0.5 %% reached after %.1f s, 4 s of them for the delay\n", run.elapsed_s());
    CHECK(run.state() == ident::IdentState::done);
    CHECK(run.elapsed_s() < 16);
    CHECK(std::abs(run.estimate().dynamics.k8_per_kg_m2 / truth.k8 - 1) < 0.02);
    const WheelPair<double> after = run.step({}, {}, {});
    DOUBLES_EQUAL(0, after.left, 0);
    DOUBLES_EQUAL(0, after.right, 0);
}

TEST(Identification, names_the_limit_that_stopped_it) {
    const RobotTruth truth;
    ident::IdentificationRun<double> run;
    auto options = options_for<double>(truth);
    options.duration_s = 5;
    options.estimator.relative_standard_error = 1e-5;
    identify(run, options, truth, 1);
    CHECK(run.state() == ident::IdentState::stopped_by_limit);
    CHECK(run.cause() == ident::IdentCause::time_over);

    // somebody carries the robot away
    run.start(options_for<double>(truth), {}, 1);
    run.step({}, {1.6, 0, 0}, {});
    CHECK(run.cause() == ident::IdentCause::area_left);

    // a pose that is not a number is no pose within the limit
    run.start(options_for<double>(truth), {}, 1);
    run.step({}, {std::nan(""), 0, 0}, {});
    CHECK(run.state() == ident::IdentState::stopped_by_limit);

    run.start(options_for<double>(truth), {}, 1);
    run.step({}, {}, {1.1, 0});
    CHECK(run.cause() == ident::IdentCause::too_fast);

    // a torque that never arrives: the wheels do not move
    run.start(options_for<double>(truth), {}, 1);
    while (!run.finished()) run.step({}, {}, {});
    CHECK(run.cause() == ident::IdentCause::delay_not_found);
}

TEST_GROUP(SharedEffects){};

namespace {

// Bits that never let a wheel turn back: each equation then sees the Coulomb friction of only one combination
// of the wheels, as a constant.
model::EffectSet<double> drive_forward(ident::DynamicsEstimate<double>& estimate, const RobotTruth& truth) {
    TestRobot robot(truth, 77);
    ident::DynamicsEstimatorOptions<double> options = options_for<double>(truth).estimator;
    options.filter.delay_s = truth.delay_s + truth.lag_s;
    ident::DynamicsEstimator<double> estimator;
    estimator.configure(options);
    ident::Prbs left(ident::kPrbsLeft, 3, 20);
    ident::Prbs right(ident::kPrbsRight, 4, 20);
    robot.set_motion(0.6, 0.4);
    WheelPair<double> torque{};
    for (int k = 0; k < 30000; ++k) {
        estimator.push({robot.angle_rad(), torque});
        const Twist<double> u = robot.true_velocity();
        const double forward = 0.35 + 2.0 * (0.6 - u.v_m_per_s);
        const double turn = 0.3 * (0.4 - u.omega_rad_per_s);
        torque = {forward - turn + 0.5 * left.next(), forward + turn + 0.5 * right.next()};
        robot.step(torque.left, torque.right);
    }
    estimate = estimator.estimate();
    return estimate.effects_standard_error;
}

}  // namespace

TEST(SharedEffects, come_out_where_each_equation_knows_only_a_sum_or_a_difference) {
    RobotTruth truth;
    truth.coulomb_left_Nm = 0.21;
    truth.coulomb_right_Nm = 0.43;
    ident::DynamicsEstimate<double> estimate;
    const auto error = drive_forward(estimate, truth);
    const std::size_t coulomb = model::find_effect("coulomb_friction");
    const auto& found = estimate.effects.parameter[coulomb];
    const auto& error_of = error.parameter[coulomb];
    std::printf(
        "\n  wheels that never reverse: Coulomb left %.3f +- %.3f (0.21), right %.3f +- %.3f (0.43)\n",
        found[0], error_of[0], found[1], error_of[1]);
    CHECK(error_of[0] < 0.05 && error_of[1] < 0.05);
    CHECK(std::abs(found[0] - 0.21) < 3.5 * error_of[0]);
    CHECK(std::abs(found[1] - 0.43) < 3.5 * error_of[1]);
}

TEST(SharedEffects, what_was_never_excited_is_unknown) {
    const RobotTruth truth;
    TestRobot robot(truth, 78);
    ident::DynamicsEstimator<double> estimator;
    auto options = options_for<double>(truth).estimator;
    options.filter.delay_s = truth.delay_s + truth.lag_s;
    estimator.configure(options);
    ident::Prbs bits(ident::kPrbsLeft, 5, 20);
    robot.set_motion(0.5, 0);
    WheelPair<double> torque{};
    for (int k = 0; k < 20000; ++k) {  // straight ahead: nothing turns
        // ideal angles, the same on both sides: no noise excites anything either
        const double turned = robot.angle_rad().left;
        estimator.push({{turned, turned}, torque});
        const double level = 0.3 + 3 * (0.5 - robot.true_velocity().v_m_per_s) + 0.5 * bits.next();
        torque = {level, level};
        robot.step(level, level);
    }
    const auto& e = estimator.estimate();
    CHECK(e.standard_error.k7_per_kg_m < 0.05);
    DOUBLES_EQUAL(static_cast<double>(ident::kUnknownError), e.standard_error.k8_per_kg_m2, 0);
    DOUBLES_EQUAL(static_cast<double>(ident::kUnknownError), e.standard_error.k6_per_m, 0);
    CHECK(!e.good_enough);
}

TEST_GROUP(DelayMeasurement){};

TEST(DelayMeasurement, recovers_delay_and_lag_within_a_tenth_of_a_millisecond) {
    ident::IdentificationRun<double> run;
    for (const double delay : {0.0004, 0.0017, 0.0026, 0.0041, 0.0050})
        for (const double lag : {0.0, 0.001}) {
            RobotTruth truth;
            truth.delay_s = delay;
            truth.lag_s = lag;
            auto options = options_for<double>(truth);
            options.duration_s = 4.5;
            identify(run, options, truth, 21);
            std::printf("\n  %.1f ms + %.0f ms lag: %.3f +- %.3f ms", 1e3 * delay, 1e3 * lag,
                        1e3 * run.delay().delay_s, 1e3 * run.delay().standard_error_s);
            CHECK(run.delay().valid);
            DOUBLES_EQUAL(delay + lag, run.delay().delay_s, 1e-4);
        }
    std::printf("\n");
}

// Viscous friction that only a turn tells from dry friction: the row that shows it first is mispredicted by
// what is not known yet, and says nothing of the noise.
TEST(DelayMeasurement, what_is_seen_late_does_not_make_the_standard_error_large) {
    RobotTruth truth;
    ident::RegressionFilterOptions<double> options;
    options.geometry = test::geometry_of(truth);
    options.effects = test::both_frictions<double>();
    options.sample_time_s = 0.001;
    options.kernel_s = 0.0165;
    ident::DelayEstimator<double> estimator;
    estimator.configure(options);
    TestRobot robot(truth, 7);
    std::mt19937_64 random(7);
    WheelPair<double> torque;
    double forward_only_s = 0;
    for (int cycle = 0; cycle < 8000; ++cycle) {
        estimator.push({robot.angle_rad(), torque});
        if (cycle == 4000) forward_only_s = estimator.estimate().standard_error_s;
        if (cycle % 16 == 0) {
            const double drive_Nm = 1.5 * (random() % 2 != 0 ? 1 : -1);
            const double faster_Nm = 0.3 + 2 * (0.5 - robot.true_velocity().v_m_per_s);
            const double turn_Nm = 0.8 * (random() % 2 != 0 ? 1 : -1);
            torque = {drive_Nm + faster_Nm - turn_Nm, drive_Nm + faster_Nm + turn_Nm};
            if (cycle > 4000 && cycle < 4600) torque = {-2 + drive_Nm / 2, 2 + drive_Nm / 2};
        }
        robot.step(torque.left, torque.right);
    }
    std::printf(" %.1f us, then %.1f us ", 1e6 * forward_only_s, 1e6 * estimator.estimate().standard_error_s);
    CHECK(estimator.estimate().standard_error_s < forward_only_s);
}

TEST_GROUP(RegressionRows){static ident::RegressionFilterOptions<double> options(double delay_s){
    ident::RegressionFilterOptions<double> o;
o.geometry = {{0.075, 0.071}, 0.32};
o.sample_time_s = 0.001;
o.kernel_s = 0.01;
o.delay_s = delay_s;
return o;
}
}
;

TEST(RegressionRows, are_exact_for_constant_acceleration_whatever_the_offset_of_the_angles) {
    // theta = offset + w t + a t^2 / 2 on each wheel; ten hours at 10 rad/s are 360 000 rad
    for (const double offset : {0.0, 3.6e5}) {
        ident::RegressionFilter<float> filter;
        ident::RegressionFilterOptions<float> o;
        o.geometry = options(0).geometry;
        o.sample_time_s = 0.001;
        o.kernel_s = 0.01;
        filter.configure(o);
        int rows = 0;
        for (int k = 0; k < 400; ++k) {
            const double t = k * 1e-3;
            if (!filter.push({{offset + 2 * t + 3 * t * t / 2, -offset + 4 * t - 5 * t * t / 2}, {1, 2}}))
                continue;
            ++rows;
            const auto& row = filter.row();
            DOUBLES_EQUAL((0.075 * 3 + 0.071 * -5) / 2, static_cast<double>(row.acceleration.v_m_per_s2),
                          2e-4);
            DOUBLES_EQUAL((0.071 * -5 - 0.075 * 3) / 0.32,
                          static_cast<double>(row.acceleration.omega_rad_per_s2), 2e-3);
            DOUBLES_EQUAL(1, static_cast<double>(row.torque_Nm[0].left), 1e-6);
            DOUBLES_EQUAL(2, static_cast<double>(row.torque_Nm[0].right), 1e-6);
            CHECK(row.usable);
        }
        CHECK(rows > 40);
    }
}

TEST(RegressionRows, carry_far_less_noise_than_the_plain_difference) {
    // a robot without friction, noise on the angles: residual of K7's equation, per unit of torque regressor
    RobotTruth truth;
    truth.coulomb_left_Nm = truth.coulomb_right_Nm = 0;
    truth.lag_s = 0;
    truth.delay_s = 0.002;
    truth.counts_per_turn = 1e9;
    for (const double noise : {0.0, 0.0002}) {
        truth.angle_noise_rad = noise;
        TestRobot robot(truth, 5);
        ident::RegressionFilter<double> filter;
        auto o = options(truth.delay_s);
        o.geometry = test::geometry_of(truth);
        filter.configure(o);
        ident::Excitation<double> excitation;
        excitation.start({5, 0.01, 0.001, 0.8, 5, 1.5}, {}, 4);
        WheelPair<double> torque{};
        double residual = 0;
        double signal = 0;
        int rows = 0;
        for (int k = 0; k < 10000; ++k) {
            if (filter.push({robot.angle_rad(), torque}) && k > 100) {
                const auto& r = filter.row();
                const double explained = truth.k5 * r.omega_squared + truth.k7 * r.torque_Nm[0].sum();
                residual += std::pow(r.acceleration.v_m_per_s2 - explained, 2);
                signal += std::pow(explained, 2);
                ++rows;
            }
            torque = excitation.step(robot.odometry(), robot.velocity());
            robot.step(torque.left, torque.right);
        }
        // two differences of white angle noise over 1 ms: sqrt(6) sigma / T^2, two wheels
        const double plain = std::sqrt(6.0) * noise / 1e-6 * 0.075 / std::sqrt(2.0);
        std::printf("\n  noise %.1f mrad: rows of %.2f m/s^2 leave %.4f (second difference at 1 kHz: %.0f)",
                    1e3 * noise, std::sqrt(signal / rows), std::sqrt(residual / rows), plain);
        CHECK(std::sqrt(residual / rows) < (noise > 0 ? plain / 50 : 2e-3 * std::sqrt(signal / rows)));
    }
    std::printf("\n");
}

TEST(RegressionRows, are_masked_while_a_wheel_stands_and_when_told_so) {
    ident::RegressionFilter<double> filter;
    filter.configure(options(0.002));
    const auto usable = [&](auto&& left_angle, int bad_sample) {
        filter.restart();
        int good = 0;
        int bad = 0;
        for (int k = 0; k < 300; ++k) {
            ident::IdentSample<double> sample{{left_angle(k * 1e-3), 5e-3 * k}, {}};
            sample.usable = k != bad_sample;
            if (filter.push(sample)) ++(filter.row().usable ? good : bad);
        }
        return std::pair{good, bad};
    };
    CHECK(usable([](double t) { return 3 * t; }, -1).second == 0);
    CHECK(usable([](double) { return 1.0; }, -1).first == 0);
    // one bad sample spoils the three rows that contain it
    CHECK(usable([](double t) { return 3 * t; }, 150).second == 3);
    // passing quickly through zero spoils nothing
    CHECK(usable([](double t) { return 75 * (t - 0.15) * (t - 0.15); }, -1).second == 0);
}

TEST_GROUP(UnlistedFriction){};

TEST(UnlistedFriction, gets_columns_where_it_is_felt_and_there_is_room) {
    const std::size_t dry = model::find_effect("coulomb_friction");
    const std::size_t viscous = model::find_effect("viscous_friction");
    const auto added = [](model::EffectSet<double> effects, double dry_share) {
        ident::add_friction(effects, dry_share, 0.005);
        return effects.active;
    };
    model::EffectSet<double> effects;
    CHECK(added(effects, 0.1)[dry] && added(effects, 0.1)[viscous]);
    CHECK_FALSE(added(effects, 0.004)[dry]);

    effects.parameter[dry][0] = 0.3;  // known, and said not to be there
    CHECK_FALSE(added(effects, 0.1)[dry]);

    effects = {};
    effects.active[model::find_effect("torque_bias")] = true;  // two of the four columns
    CHECK(added(effects, 0.1)[dry]);
    CHECK_FALSE(added(effects, 0.1)[viscous]);

    effects = {};
    effects.active[model::find_effect("stribeck_friction")] = true;
    CHECK_FALSE(added(effects, 0.1)[dry]);
}
