#include "firmware/control/trajectory.hpp"

#include <cmath>
#include <cstdio>

#include "tests/control/bench_robot.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::control;

namespace {

// Speeds and accelerations must be the derivatives of the pose: central differences, from outside.
void check_derivatives(const PathSettings<double>& path, double from_s, double to_s) {
    const double h = 1e-5;
    for (double t = from_s; t < to_s; t += 0.0371) {
        const auto now = path_point(path, t);
        const auto before = path_point(path, t - h);
        const auto after = path_point(path, t + h);
        const double vx = (after.pose.x_m - before.pose.x_m) / (2 * h);
        const double vy = (after.pose.y_m - before.pose.y_m) / (2 * h);
        const double c = std::cos(now.pose.heading_rad), s = std::sin(now.pose.heading_rad);
        DOUBLES_EQUAL(now.twist.v_m_per_s, c * vx + s * vy, 1e-6);
        DOUBLES_EQUAL(0, c * vy - s * vx, 1e-6);  // no sideways motion
        DOUBLES_EQUAL(now.twist.omega_rad_per_s,
                      wrap_angle_rad(after.pose.heading_rad - before.pose.heading_rad) / (2 * h), 1e-5);
        DOUBLES_EQUAL(now.rate.v_m_per_s2, (after.twist.v_m_per_s - before.twist.v_m_per_s) / (2 * h), 1e-5);
        DOUBLES_EQUAL(now.rate.omega_rad_per_s2,
                      (after.twist.omega_rad_per_s - before.twist.omega_rad_per_s) / (2 * h), 1e-5);
    }
}

}  // namespace

TEST_GROUP(Trajectory){};

TEST(Trajectory, TheFigureEightIsGeronosLemniscateAtThatTime) {
    PathSettings<double> path{PathKind::figure_eight, 3.0, 1.5, 10.0, 0, {}};
    for (double t = 0; t < 40; t += 0.173) {
        const double p = 2 * bench::kPi * t / 10;
        const auto point = path_point(path, t);
        DOUBLES_EQUAL(1.5 * std::sin(p), point.pose.x_m, 1e-12);
        DOUBLES_EQUAL(0.75 * std::sin(2 * p), point.pose.y_m, 1e-12);
    }
    check_derivatives(path, 0.1, 11);
}

TEST(Trajectory, EveryPathsRatesAreItsDerivativesAlsoWhileItStartsSmoothlyAndWhereverItLies) {
    for (const auto kind : {PathKind::figure_eight, PathKind::line, PathKind::circle, PathKind::spin}) {
        for (const double length : {2.7, -2.7}) {
            if (length < 0 && kind != PathKind::circle && kind != PathKind::spin) continue;
            PathSettings<double> path{kind, length, 1.3, 7.0, 2.0, {0.7, -1.1, 2.2}};
            check_derivatives(path, 0.01, 1.95);
            check_derivatives(path, 2.05, 9.5);
            const auto start = path_point(path, 0.0);
            DOUBLES_EQUAL(0, start.twist.v_m_per_s, 1e-12);
            DOUBLES_EQUAL(0.7, start.pose.x_m, 1e-12);
            DOUBLES_EQUAL(-1.1, start.pose.y_m, 1e-12);
        }
    }
}

TEST(Trajectory, TheLineEndsAtRest) {
    const PathSettings<double> path{PathKind::line, 2.0, 0, 4.0, 1.0, {0, 0, 0.5}};
    const auto end = path_point(path, 100.0);
    DOUBLES_EQUAL(2 * std::cos(0.5), end.pose.x_m, 1e-12);
    DOUBLES_EQUAL(0, end.twist.v_m_per_s, 0);
}

TEST(Trajectory, SinglePrecisionAgrees) {
    const PathSettings<float> f{PathKind::figure_eight, 3.0F, 1.5F, 10.0F, 0, {}};
    const PathSettings<double> d{PathKind::figure_eight, 3.0, 1.5, 10.0, 0, {}};
    for (int k = 0; k < 4000; ++k) {
        const float t = 0.01F * static_cast<float>(k);
        const auto a = path_point(f, t);
        const auto b = path_point(d, static_cast<double>(t));
        DOUBLES_EQUAL(b.pose.x_m, double(a.pose.x_m), 2e-5);
        DOUBLES_EQUAL(b.twist.omega_rad_per_s, double(a.twist.omega_rad_per_s), 1e-4);
    }
}

TEST(Trajectory, AStreamedReferenceRunsOnBetweenItsSamplesAndStandsWhenTheyStop) {
    const PathSettings<double> path{PathKind::figure_eight, 3.0, 1.5, 10.0, 0, {}};
    StreamedReference<double> streamed;
    CHECK_FALSE(streamed.valid());
    double worst = 0, worst_jump = 0;
    Pose<double> last{};
    for (int k = 0; k < 5000; ++k) {
        const std::int64_t now = 5'000'000'000 + std::int64_t{1'000'000} * k;
        const double t = 1e-3 * k;
        if (k % 50 == 0) {
            const auto p = path_point(path, t);
            streamed.push(p.pose, p.twist, now);
        }
        const auto got = streamed.at(now);
        const auto truth = path_point(path, t);
        if (k > 100) {
            worst = std::max(worst, std::hypot(got.pose.x_m - truth.pose.x_m, got.pose.y_m - truth.pose.y_m));
            worst_jump = std::max(worst_jump, std::hypot(got.pose.x_m - last.x_m, got.pose.y_m - last.y_m));
        }
        last = got.pose;
    }
    std::printf(
        "\n  20 samples a second of the figure-8: off by %.2f mm at most, largest step %.2f mm in 1 ms\n",
        1e3 * worst, 1e3 * worst_jump);
    CHECK(worst < 1e-3);
    CHECK(worst_jump < 1.6e-3);  // 1.33 m/s
    const auto stopped = streamed.at(20'000'000'000);
    DOUBLES_EQUAL(0, stopped.twist.v_m_per_s, 0);
    const auto still = streamed.at(30'000'000'000);
    DOUBLES_EQUAL(stopped.pose.x_m, still.pose.x_m, 0);
}

// What differs little fades in over an interval; a leap that is meant is taken at once; what is older than
// the last sample is no sample.
TEST(Trajectory, AStreamedReferenceLeapsWhereItIsMeantToAndTakesNothingOld) {
    constexpr std::int64_t kStart_ns = 3'000'000'000;
    constexpr std::int64_t kInterval_ns = 50'000'000;
    for (const Pose<double>& off : {Pose<double>{0.02, 0.03, 0.1}, {0.2, 0, 0}, {0, 0.2, 0}, {0, 0, 0.5}}) {
        const bool leaps = off.x_m + off.y_m > 0.1 || off.heading_rad > 0.3;
        StreamedReference<double> streamed;
        streamed.push({1, 2, 0}, {}, kStart_ns);
        streamed.push({1 + off.x_m, 2 + off.y_m, off.heading_rad}, {}, kStart_ns + kInterval_ns);
        const auto at_once = streamed.at(kStart_ns + kInterval_ns).pose;
        const auto later = streamed.at(kStart_ns + 2 * kInterval_ns).pose;
        const double share = leaps ? 1 : 0;
        DOUBLES_EQUAL(1 + share * off.x_m, at_once.x_m, 1e-12);
        DOUBLES_EQUAL(2 + share * off.y_m, at_once.y_m, 1e-12);
        DOUBLES_EQUAL(share * off.heading_rad, at_once.heading_rad, 1e-12);
        DOUBLES_EQUAL(1 + off.x_m, later.x_m, 1e-12);
        DOUBLES_EQUAL(2 + off.y_m, later.y_m, 1e-12);
        DOUBLES_EQUAL(off.heading_rad, later.heading_rad, 1e-12);
        streamed.push({7, 7, 1}, {}, kStart_ns + kInterval_ns);
        streamed.push({7, 7, 1}, {}, kStart_ns);
        DOUBLES_EQUAL(later.x_m, streamed.at(kStart_ns + 2 * kInterval_ns).pose.x_m, 0);
    }
}
