#include "firmware/control/wheel_observer.hpp"

#include <cmath>
#include <cstdio>
#include <string>

#include "tests/control/inner_loop.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::control;

namespace {

template <typename Real>
struct Rig {
    PlantModel<Real> model;
    WheelObserver<Real> observer;
    bench::Robot robot;

    Rig(const model::RobotParameters& parameters, const bench::Truth& truth, std::uint64_t seed)
        : model(plant_model<Real>(parameters)), robot(truth, seed) {
        observer.configure(wheel_observer_settings<Real>(parameters, Real(1e-3)));
    }

    void cycle(double left_Nm, double right_Nm) {
        observer.torque_sent({Real(left_Nm), Real(right_Nm)});
        robot.cycle(left_Nm, right_Nm);
        observer.update(robot.now_ns(), {robot.left.position_rad, robot.speed_left(), robot.left.time_ns},
                        {robot.right.position_rad, robot.speed_right(), robot.right.time_ns}, model);
    }
};

bench::Truth matching(const model::RobotParameters& parameters) {
    bench::Truth truth;
    truth.transport_s = parameters.velocity_loop.actuation_delay_s - truth.lag_s;
    return truth;
}

}  // namespace

TEST_GROUP(WheelObserver){};

TEST(WheelObserver, FollowsAShakenRobotWithoutLagThoughTheWheelsAreSampledAtDifferentTimes) {
    const auto parameters = bench::notes_robot();
    Rig<double> rig(parameters, matching(parameters), 2);
    double off = 0, size = 0, worst_angle = 0;
    for (int k = 0; k < 3000; ++k) {
        const double t = 1e-3 * k;
        rig.cycle(1.5 * std::sin(30 * t) + 0.2, 1.1 * std::sin(37 * t + 1) - 0.1);
        if (k < 500) continue;
        const double error = rig.observer.motion().wheel_speed_rad_per_s.left - rig.robot.speed_left();
        off += error * error;
        size += rig.robot.speed_left() * rig.robot.speed_left();
        worst_angle = std::max(worst_angle,
                               std::abs(rig.observer.motion().wheel_angle_rad.right - rig.robot.wheel_right));
    }
    off = std::sqrt(off / 2500);
    size = std::sqrt(size / 2500);
    std::printf("\n  speed: rms %.2f rad/s, error rms %.4f rad/s; largest angle error %.2f mrad\n", size, off,
                1e3 * worst_angle);
    CHECK(off < 0.01 * size);
    CHECK(off < 0.03);
    CHECK(worst_angle < 5e-3);  // the frames' age at the largest speed
}

TEST(WheelObserver, FrictionItDoesNotKnowLeavesNoBias) {
    const auto parameters = bench::notes_robot();  // knows none
    auto truth = matching(parameters);
    truth.coulomb_left_Nm = 0.3;
    truth.coulomb_right_Nm = 0.2;
    truth.encoder_noise_rad = 0;
    Rig<double> rig(parameters, truth, 3);
    double bias = 0;
    for (int k = 0; k < 1000; ++k) {
        rig.cycle(0.45, 0.38);
        if (k >= 500)
            bias += (rig.observer.motion().wheel_speed_rad_per_s.left - rig.robot.speed_left()) / 500;
    }
    std::printf("\n  bias %.4f rad/s at %.1f rad/s\n", bias, rig.robot.speed_left());
    CHECK(std::abs(bias) < 0.005);
}

TEST(WheelObserver, AStuckWheelIsSeenAtRestUnderTorqueBelowItsFriction) {
    auto parameters = bench::notes_robot();
    bench::set_coulomb(parameters, 0.3, 0.3);
    auto truth = matching(parameters);
    truth.coulomb_left_Nm = truth.coulomb_right_Nm = 0.3;
    Rig<double> rig(parameters, truth, 4);
    double worst = 0;
    for (int k = 0; k < 1000; ++k) {
        rig.cycle(k % 100 < 50 ? 0.25 : -0.25, 0.2);
        if (k > 50) worst = std::max(worst, std::abs(rig.observer.motion().wheel_speed_rad_per_s.left));
    }
    std::printf("\n  largest speed seen at rest: %.4f rad/s\n", worst);
    CHECK(worst < 0.1);
    DOUBLES_EQUAL(0, rig.robot.wheel_left, 1e-8);
}

TEST(WheelObserver, TheTurnsAddUpToTheEncodersAngleInSinglePrecisionToo) {
    const auto parameters = bench::notes_robot();
    Rig<float> rig(parameters, matching(parameters), 5);
    double sum = 0;
    double start = 0;
    for (int k = 0; k < 20'000; ++k) {
        rig.cycle(k < 900 ? 0.5 : 0.0, k < 900 ? 0.6 : 0.01);
        if (k == 100) start = rig.robot.wheel_left;
        if (k > 100) sum += double(rig.observer.turned_rad().left);
    }
    std::printf("\n  wheel turned %.3f rad, sum of turns %.3f rad\n", rig.robot.wheel_left - start, sum);
    DOUBLES_EQUAL(rig.robot.wheel_left - start, sum, 5e-3);
}

TEST(WheelObserver, GivesBothAnglesAtOneInstantFromTheEncodersAlone) {
    const auto parameters = bench::notes_robot();
    auto truth = matching(parameters);
    truth.filter_rad_per_s = 0;
    truth.encoder_noise_rad = 0;
    truth.quantised = false;
    truth.frame_s = 0;
    truth.frame_jitter_s = 0;
    Rig<double> rig(parameters, truth, 6);
    double worst = 0;
    double past_left[4] = {0, 0, 0, 0};
    double past_right[4] = {0, 0, 0, 0};
    for (int k = 0; k < 500; ++k) {
        rig.cycle(3 * std::sin(0.02 * k), 2 * std::cos(0.03 * k));
        for (int i = 3; i > 0; --i) {
            past_left[i] = past_left[i - 1];
            past_right[i] = past_right[i - 1];
        }
        past_left[0] = rig.robot.wheel_left;
        past_right[0] = rig.robot.wheel_right;
        WheelPair<double> angles;
        if (k < 10) continue;
        CHECK(rig.observer.angles_at(rig.robot.now_ns() - 2'000'000, angles));
        worst =
            std::max({worst, std::abs(angles.left - past_left[2]), std::abs(angles.right - past_right[2])});
    }
    std::printf("\n  largest error of an angle at a common instant: %.2e rad (a count is 9.6e-5)\n", worst);
    CHECK(worst < 2e-5);
    WheelPair<double> angles;
    CHECK_FALSE(rig.observer.angles_at(rig.robot.now_ns() + 1'000'000, angles));
    CHECK_FALSE(rig.observer.angles_at(rig.robot.now_ns() - 50'000'000, angles));
}

TEST(WheelObserver, LateFramesDoNotShakeTheSpeed) {
    const auto parameters = bench::notes_robot();
    double noise[2];
    for (const int jitter : {0, 1}) {
        auto truth = matching(parameters);
        truth.encoder_noise_rad = 0;
        truth.frame_jitter_s = jitter * 0.25e-3;
        Rig<double> rig(parameters, truth, 7);
        double sum = 0;
        for (int k = 0; k < 3000; ++k) {
            rig.cycle(k < 700 ? 0.8 : 0, k < 700 ? 0.8 : 0);
            if (k < 1000) continue;
            const double error = rig.observer.motion().wheel_speed_rad_per_s.right - rig.robot.speed_right();
            sum += error * error;
        }
        noise[jitter] = std::sqrt(sum / 2000);
    }
    std::printf("\n  speed error at 10 rad/s: %.4f rad/s, with 0.25 ms of jitter %.4f rad/s\n", noise[0],
                noise[1]);
    CHECK(noise[1] < 0.12);
}

TEST(WheelObserver, StartsAnewAfterAGapAndSurvivesMissedCycles) {
    const auto parameters = bench::notes_robot();
    Rig<double> rig(parameters, matching(parameters), 8);
    CHECK_FALSE(rig.observer.valid());
    for (int k = 0; k < 300; ++k) rig.cycle(1, 1);
    CHECK(rig.observer.valid());
    // three cycles missed: the torque stays what it was
    for (int k = 0; k < 3; ++k) rig.robot.cycle(1, 1);
    rig.cycle(1, 1);
    DOUBLES_EQUAL(rig.robot.speed_left(), rig.observer.motion().wheel_speed_rad_per_s.left, 0.1);
    // a quarter of a second without frames
    for (int k = 0; k < 250; ++k) {
        rig.observer.torque_sent({0, 0});
        rig.robot.cycle(-1, -1);
        rig.observer.update(rig.robot.now_ns(), {}, {}, rig.model);
    }
    for (int k = 0; k < 40; ++k) rig.cycle(0, 0);
    DOUBLES_EQUAL(rig.robot.speed_left(), rig.observer.motion().wheel_speed_rad_per_s.left, 0.2);
    DOUBLES_EQUAL(rig.robot.wheel_left, rig.observer.motion().wheel_angle_rad.left, 5e-3);
}

TEST(WheelObserver, AFrameSoLateThatItCountsForTheNextSpoilsNoAngleLater) {
    const auto parameters = bench::notes_robot();
    const auto model = plant_model<double>(parameters);
    constexpr double kSpeed_rad_per_s = 10;
    double worst_rad = 0;
    int found = 0;
    for (const std::int64_t late_ns : {780'000, 850'000, 920'000}) {
        WheelObserver<double> observer;
        observer.configure(wheel_observer_settings<double>(parameters, 1e-3));
        for (int k = 1; k < 600; ++k) {
            const std::int64_t now_ns = 1'000'000'000 + 1'000'000LL * k;
            EncoderSample sample;
            sample.time_ns = now_ns - 950'000;
            sample.position_rad = kSpeed_rad_per_s * 1e-9 * static_cast<double>(sample.time_ns);
            sample.speed_rad_per_s = kSpeed_rad_per_s;
            if (k == 300) sample.time_ns += late_ns;
            observer.update(now_ns, sample, sample, model);
            observer.torque_sent({0, 0});
            for (std::int64_t ago_ns = 2'000'000; ago_ns < 5'000'000 && k >= 300; ago_ns += 100'000) {
                WheelPair<double> angles;
                if (!observer.angles_at(now_ns - ago_ns, angles)) continue;
                ++found;
                const double truth_rad = kSpeed_rad_per_s * 1e-9 * static_cast<double>(now_ns - ago_ns);
                CHECK(std::isfinite(angles.left) && std::isfinite(angles.right));
                worst_rad = std::max(
                    {worst_rad, std::abs(angles.left - truth_rad), std::abs(angles.right - truth_rad)});
            }
        }
    }
    std::printf("\n  angle off by %.1f mrad at most; it turns %.1f mrad in a period\n", 1e3 * worst_rad,
                kSpeed_rad_per_s);
    CHECK(found > 20'000);
    CHECK(worst_rad < 1.5e-3 * kSpeed_rad_per_s);
}

// A frame waits behind the other drive's, until their clocks have drifted apart; then one is lost.
TEST(WheelObserver, OneLostFrameIsNotTakenForALateOne) {
    const auto parameters = bench::notes_robot();
    const auto model = plant_model<double>(parameters);
    constexpr double kSpeed_rad_per_s = 10;
    for (const std::int64_t wait_ns : {120'000, 260'000, 380'000}) {
        WheelObserver<double> observer;
        observer.configure(wheel_observer_settings<double>(parameters, 1e-3));
        double worst_rad_per_s = 0;
        for (int k = 1; k < 600; ++k) {
            const std::int64_t now_ns = 1'000'000'000 + 1'000'000LL * k;
            EncoderSample sample;
            const std::int64_t sampled_ns = now_ns - 950'000;
            sample.time_ns = sampled_ns + (k < 300 ? wait_ns : 0);
            sample.position_rad = kSpeed_rad_per_s * 1e-9 * static_cast<double>(sampled_ns);
            sample.speed_rad_per_s = kSpeed_rad_per_s;
            const EncoderSample heard = k == 350 ? EncoderSample{} : sample;
            observer.update(now_ns, heard, heard, model);
            observer.torque_sent({0, 0});
            if (k < 250) continue;
            worst_rad_per_s = std::max(
                worst_rad_per_s, std::abs(observer.motion().wheel_speed_rad_per_s.right - kSpeed_rad_per_s));
        }
        CHECK(worst_rad_per_s < 1e-3 * kSpeed_rad_per_s);
    }
}

// Reports that come 33 ms late, then the true ones beside the last of the late ones: each late one would be
// corrected for seven times, and a filter that went astray has to come back by what the encoders tell.
TEST(WheelObserver, SamplesThatComeTooLateLeadNobodyAstray) {
    auto parameters = bench::notes_robot();
    parameters.drive.encoder_period_ms = 5;
    const PlantModel<double> model = plant_model<double>(parameters);
    for (const std::int64_t late_ms : {22, 33, 60}) {
        WheelObserver<double> observer;
        observer.configure(wheel_observer_settings<double>(parameters, 1e-3));
        constexpr double kSpeed = 12;
        const auto at = [](std::int64_t ms) {
            return EncoderSample{kSpeed * 1e-3 * static_cast<double>(ms), kSpeed, 1'000'000 * (100 + ms)};
        };
        double fastest = 0, slowest = kSpeed;
        for (std::int64_t ms = 1; ms < 1000; ++ms) {
            observer.torque_sent({0, 0});
            const bool late = ms >= 300 && ms < 600;
            const EncoderSample sample = at((ms - (late ? late_ms : 0)) / 5 * 5);
            observer.update(1'000'000 * (100 + ms), sample, sample, model);
            const double speed = observer.motion().wheel_speed_rad_per_s.left;
            if (ms > 200) fastest = std::max(fastest, speed);
            if (ms > 200) slowest = std::min(slowest, speed);
            if (ms >= 330 && ms < 600) {
                CHECK(1'000'000 * (100 + ms) - observer.taken_ns()[0] >= 30'000'000);  // told by its age
            }
        }
        CHECK_TEXT(fastest < 1.1 * kSpeed, std::to_string(fastest).c_str());
        CHECK_TEXT(slowest > 0.5 * kSpeed, std::to_string(slowest).c_str());
        DOUBLES_EQUAL(kSpeed, observer.motion().wheel_speed_rad_per_s.left, 0.1);
        DOUBLES_EQUAL(kSpeed * 0.999, observer.motion().wheel_angle_rad.left, 0.1);
    }
}

// However a filter went wrong, as by torques that nobody sent: samples that agree with each other and not
// with it begin its speed anew, and its angle with it.
TEST(WheelObserver, AFilterThatWentAstrayBeginsAtTheSampleNotAtItsOwnAngle) {
    const auto parameters = bench::notes_robot();
    const PlantModel<double> model = plant_model<double>(parameters);
    for (const double torque_Nm : {1e6, 1e200, 1e307}) {
        WheelObserver<double> observer;
        observer.configure(wheel_observer_settings<double>(parameters, 1e-3));
        std::int64_t astray_until_ms = 0;
        for (std::int64_t ms = 1; ms < 400; ++ms) {
            const double sent = ms >= 100 && ms < 110 ? torque_Nm : 0;
            observer.torque_sent({sent, sent});
            const EncoderSample sample{40, 0, 1'000'000 * ms};  // it stands
            observer.update(1'000'000 * ms, sample, sample, model);
            if (std::abs(observer.motion().wheel_speed_rad_per_s.left) > 0.01) astray_until_ms = ms;
        }
        CHECK(astray_until_ms < 110 + 2 * WheelObserver<double>::kNewOriginSamples);
        DOUBLES_EQUAL(0, observer.motion().wheel_speed_rad_per_s.left, 0.01);
        DOUBLES_EQUAL(40, observer.motion().wheel_angle_rad.left, 0.01);
    }
}

// Any new origin but one that is nearer than a step of this encoder and half of what the fastest wheel turns
// in a period: that one is read as a motion. What the file does not know of the encoder its samples show.
TEST(WheelObserver, ADrivesNewOriginIsNoMotion) {
    auto parameters = bench::notes_robot();
    parameters.velocity_loop.angle_noise_rad = 1e-4;
    const double nearest = fastest_wheel_rad_per_s(parameters) * 0.5e-3 + encoder_step_rad(parameters);
    DOUBLES_EQUAL(2e-3, encoder_step_rad(parameters), 1e-15);
    for (const double known_noise_rad : {1e-4, 0.0})
        for (const double size : {1.1, 2.0, 2.9, 3.9, 5.0, 100.0}) {
            for (const double way : {1.0, -1.0}) {
                parameters.velocity_loop.angle_noise_rad = known_noise_rad;
                Rig<double> rig(parameters, matching(parameters), 9);
                for (int k = 0; k < 300; ++k) rig.cycle(1, 1);
                CHECK(rig.robot.wheel_left > 6 * kCoarsestStep_rad);  // far enough to know it
                const double leap = way * size * nearest;
                double worst = 0, turned = 0;
                const double before = rig.robot.wheel_left;
                for (int k = 0; k < 100; ++k) {
                    rig.observer.torque_sent({1, 1});
                    rig.robot.cycle(1, 1);
                    rig.observer.update(
                        rig.robot.now_ns(),
                        {rig.robot.left.position_rad + leap, rig.robot.speed_left(), rig.robot.left.time_ns},
                        {rig.robot.right.position_rad, rig.robot.speed_right(), rig.robot.right.time_ns},
                        rig.model);
                    turned += rig.observer.turned_rad().left;
                    worst = std::max(worst, std::abs(rig.observer.motion().wheel_speed_rad_per_s.left -
                                                     rig.robot.speed_left()));
                }
                const std::string text = std::to_string(way * size);
                CHECK_TEXT(worst < 0.3, (text + ": " + std::to_string(worst)).c_str());
                DOUBLES_EQUAL_TEXT(rig.robot.wheel_left - before, turned, 0.02, text.c_str());
            }
        }
}

// Quick and slow, each step of it is a part of the way, whatever the way before has shown.
TEST(WheelObserver, TheCoarsestEncodersStepsAreItsWay) {
    auto parameters = bench::notes_robot();
    for (const int period_ms : {1, 5, 10}) {
        parameters.drive.encoder_period_ms = period_ms;
        const PlantModel<double> model = plant_model<double>(parameters);
        WheelObserver<double> observer;
        observer.configure(wheel_observer_settings<double>(parameters, 1e-3));
        // In step with the samples at first: not one of them leaps.
        const double one_a_sample =
            kCoarsestStep_rad / (1e-3 * period_ms) / fastest_wheel_rad_per_s(parameters);
        double angle = 0, turned = 0;
        EncoderSample sample;
        for (std::int64_t ms = 1; ms < 8000; ++ms) {
            const double of_fastest[] = {
                std::min(one_a_sample, 1.0), 0.01, 0.9, 0.02, -0.005, -0.5, -0.01, 0.3};
            angle += 1e-3 * of_fastest[ms / 1000] * fastest_wheel_rad_per_s(parameters);
            if (ms % period_ms == 0)
                sample = {kCoarsestStep_rad * std::floor(angle / kCoarsestStep_rad), 0, 1'000'000 * ms};
            observer.torque_sent({0, 0});
            observer.update(1'000'000 * ms, sample, sample, model);
            turned += observer.turned_rad().left;
        }
        DOUBLES_EQUAL_TEXT(angle, turned, 2 * kCoarsestStep_rad, std::to_string(period_ms).c_str());
    }
}
