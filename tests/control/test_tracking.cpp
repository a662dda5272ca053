// The figure-8 on a robot whose every number differs from the controller's, odometry fused with a noisy
// external pose.
#include <cmath>
#include <cstdio>

#include "firmware/control/odometry.hpp"
#include "firmware/control/tracking.hpp"
#include "firmware/control/trajectory.hpp"
#include "tests/control/inner_loop.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::control;

namespace {

struct Run {
    double k_error = 0;
    std::uint64_t seed = 1;
    bool external = true;
    bool calibrate = true;
    double external_delay_s = 0;  // and the controller knows it
    bool paper_law = false;
    bool streamed = false;
    Pose<double> start{0, 1, 0};
    int cycles = 42'000;
    PathSettings<double> path{PathKind::figure_eight, 3.0, 1.5, 10.0, 0, {}};
};

struct Figures {
    double rms_m = 0;
    double peak_m = 0;
    double caught_up_s = 0;  // last time more than 2 cm off
    double largest_torque_Nm = 0;
};

template <typename Real>
Figures drive(const Run& run) {
    auto parameters = bench::notes_robot();
    bench::set_coulomb(parameters, 0.3, 0.3);
    parameters.odometry.calibrate = run.calibrate;
    parameters.odometry.external_pose_delay_s = run.external_delay_s;
    bench::Truth truth;
    truth.k7 *= 1 + run.k_error;
    truth.k8 *= 1 - run.k_error;
    truth.k5 = 0.039;
    truth.coulomb_left_Nm = 0.31;
    truth.coulomb_right_Nm = 0.285;
    truth.viscous_Nm_s_per_rad = 0.005;
    truth.radius_left_m *= 1.004;
    truth.radius_right_m *= 1.0035;
    truth.track_m *= 0.994;
    bench::Robot robot(truth, run.seed);
    bench::Noise noise(run.seed + 1000);
    robot.x = run.start.x_m;
    robot.y = run.start.y_m;
    robot.heading = run.start.heading_rad;

    bench::InnerLoop<Real> inner(parameters);
    Odometry<Real> odometry;
    odometry.configure(odometry_settings<Real>(parameters));
    odometry.set_pose({Real(run.start.x_m), Real(run.start.y_m), Real(run.start.heading_rad)});
    TrajectoryTracker<Real> tracker;
    tracker.configure(tracking_settings<Real>(parameters));
    tracker.start({});
    StreamedReference<Real> streamed;
    const PathSettings<Real> path{run.path.kind,           Real(run.path.length_m), Real(run.path.width_m),
                                  Real(run.path.period_s), Real(run.path.ramp_s),   {}};
    for (int k = 0; k < 20; ++k) {
        inner.sense(robot);
        inner.observer.torque_sent({});
        robot.cycle(0, 0);
    }
    inner.loop.start(inner.model, inner.observer.motion(), {});

    constexpr int kPast = 512;
    static Pose<double> past[kPast];
    Figures figures;
    double sum = 0;
    int counted = 0;
    const std::int64_t start_ns = robot.now_ns();
    for (int k = 0; k < run.cycles; ++k) {
        inner.sense(robot);
        odometry.advance(inner.model.geometry, inner.observer.turned_rad(), robot.now_ns());
        past[k % kPast] = {robot.x, robot.y, robot.heading};
        const int age = static_cast<int>(std::lround(1e3 * run.external_delay_s));
        if (run.external && k % 50 == 7 && k >= age) {
            const auto& p = past[(k - age) % kPast];
            odometry.fuse({Real(p.x_m + 0.002 * noise.gaussian()), Real(p.y_m + 0.002 * noise.gaussian()),
                           Real(p.heading_rad + 0.004 * noise.gaussian())});
        }
        const double t = 1e-9 * static_cast<double>(robot.now_ns() - start_ns);
        const auto at_that_time = path_point(run.path, t);
        ReferencePoint<Real> reference = path_point(path, Real(t));
        if (run.streamed) {
            if (k % 50 == 0) streamed.push(reference.pose, reference.twist, robot.now_ns());
            reference = streamed.at(robot.now_ns());
        }
        const double off = std::hypot(at_that_time.pose.x_m - robot.x, at_that_time.pose.y_m - robot.y);
        if (off > 0.02) figures.caught_up_s = t;
        if (k >= 12'000) {
            sum += off * off;
            ++counted;
            figures.peak_m = std::max(figures.peak_m, off);
        }
        VelocityReference<Real> command;
        if (run.paper_law) {
            PoseControlSettings<Real> gains;
            gains.gamma1 = 1;
            gains.gamma2 = 3;
            gains.lambda_ratio = 3;
            command.twist = paper_pose_law(gains, polar_error(odometry.pose(), reference.pose, true), true);
        } else {
            command = tracker.update(reference, odometry.pose(), Real(1e-3)).reference;
        }
        inner.act(robot, command);
        figures.largest_torque_Nm = std::max({figures.largest_torque_Nm, std::abs(double(inner.torque.left)),
                                              std::abs(double(inner.torque.right))});
    }
    figures.rms_m = std::sqrt(sum / counted);
    return figures;
}

void print(const char* what, const Figures& f) {
    std::printf("  %-44s %7.2f mm rms %8.2f mm peak, within 2 cm from %5.2f s, torque up to %.2f Nm\n", what,
                1e3 * f.rms_m, 1e3 * f.peak_m, f.caught_up_s, f.largest_torque_Nm);
}

}  // namespace

TEST_GROUP(Tracking){};

TEST(Tracking, TheFigureEightFromOneMetreOffIsFollowedWithinFiveMillimetres) {
    std::printf("\n");
    for (const double error : {-0.05, 0.0, 0.05}) {
        for (std::uint64_t seed = 1; seed <= 3; ++seed) {
            Run run;
            run.k_error = error;
            run.seed = seed;
            const auto f = drive<double>(run);
            if (seed == 1)
                print(error < 0 ? "K wrong by -5 %" : error > 0 ? "K wrong by +5 %" : "K right", f);
            CHECK(f.rms_m <= 0.005);
            CHECK(f.peak_m <= 0.015);
            CHECK(f.caught_up_s < 6);
            CHECK(f.largest_torque_Nm <= 5);
        }
    }
}

TEST(Tracking, BesideItThePapersLawLagsAndOdometryAloneDrifts) {
    std::printf("\n");
    Run run;
    const auto ours = drive<double>(run);
    run.external = false;
    const auto alone = drive<double>(run);
    run.external = true;
    run.paper_law = true;
    const auto paper = drive<double>(run);
    print("tracking with external pose", ours);
    print("odometry alone", alone);
    print("the paper's law, mirrored", paper);
    CHECK(alone.rms_m > 10 * ours.rms_m);
    CHECK(paper.rms_m > 10 * ours.rms_m);
}

TEST(Tracking, ALateExternalPoseAndNoCalibrationAreBorne) {
    std::printf("\n");
    Run run;
    run.external_delay_s = 0.12;
    const auto late = drive<double>(run);
    print("external pose 120 ms late", late);
    CHECK(late.rms_m <= 0.005 && late.peak_m <= 0.015);
    run.external_delay_s = 0;
    run.calibrate = false;
    const auto bare = drive<double>(run);
    print("without calibration", bare);
    CHECK(bare.rms_m <= 0.005 && bare.peak_m <= 0.015);
}

TEST(Tracking, OtherPathsAndAStreamedReferenceAreFollowedToo) {
    std::printf("\n");
    Run run;
    run.path = {PathKind::circle, 2.2, 0, 9.0, 2.0, {}};
    auto f = drive<double>(run);
    print("circle", f);
    CHECK(f.rms_m <= 0.005 && f.peak_m <= 0.015);
    run.path = {PathKind::spin, -1, 0, 5.0, 2.0, {}};
    f = drive<double>(run);
    print("spin, from one metre beside", f);
    CHECK(f.caught_up_s < 10);
    run.path = {PathKind::line, 20.0, 0, 38.0, 2.0, {}};
    f = drive<double>(run);
    print("line", f);
    CHECK(f.rms_m <= 0.005 && f.peak_m <= 0.015);
    run.path = Run{}.path;
    run.streamed = true;
    f = drive<double>(run);
    print("figure-8 streamed at 20 Hz", f);
    CHECK(f.rms_m <= 0.005 && f.peak_m <= 0.015);
}

TEST(Tracking, WhereverItStartsItHasCaughtUpBeforeTwelveSeconds) {
    bench::Noise noise(17);
    double slowest = 0;
    for (std::uint64_t i = 0; i < 60; ++i) {
        Run run;
        run.seed = i;
        run.cycles = 12'000;
        run.start = {4 * noise.uniform() - 2, 4 * noise.uniform() - 2, 2 * bench::kPi * noise.uniform()};
        const auto f = drive<double>(run);
        slowest = std::max(slowest, f.caught_up_s);
        CHECK(f.largest_torque_Nm <= 5);
    }
    std::printf("\n  sixty starts up to 2.8 m off, any heading: within 2 cm from %.1f s at the latest\n",
                slowest);
    CHECK(slowest < 11);
}

TEST(Tracking, SinglePrecisionFollowsAsWell) {
    std::printf("\n");
    const auto f = drive<float>(Run{});
    print("float", f);
    CHECK(f.rms_m <= 0.005 && f.peak_m <= 0.015);
}
