// Rolling slip by definition: the rim is faster than the floor by torque times speed times a number, and a
// gyro sees the floor.
#include "tools/gap/inference/slip.hpp"

#include <CppUTest/TestHarness.h>

#include <cmath>
#include <random>

using namespace wheelwright;

namespace {

constexpr double kPeriod_s = 0.004;
const model::Geometry<double> kGeometry{{0.1, 0.1}, 0.5};

// 40 s of a robot whose two motions follow torques of several tones; the drives' loop makes two lags.
tools::MeasuredLog drive(double slip_per_Nm_rad_per_s, double each_lag_s, double noise_rad_per_s = 0.01) {
    std::mt19937_64 random(5);
    std::normal_distribution<double> noise(0, noise_rad_per_s);
    tools::MeasuredLog log;
    log.period_s = kPeriod_s;
    log.has_gyro = true;
    double v = 0;
    double yaw = 0;
    WheelPair<double> once;
    WheelPair<double> twice;
    const double keeps = std::exp(-kPeriod_s / each_lag_s);
    for (int i = 0; i < 10000; ++i) {
        const double t = i * kPeriod_s;
        const double ahead = 2 * std::sin(0.9 * t) + 2 * std::sin(5.3 * t + 1);
        const double around = 1.5 * std::sin(1.7 * t) + 1.5 * std::sin(7.1 * t);
        const WheelPair<double> torque{(ahead - around) / 2, (ahead + around) / 2};
        v += kPeriod_s * (ahead - 0.3 * v);
        yaw += kPeriod_s * (2 * around - 0.3 * yaw);
        const double r = kGeometry.wheel_radius_m.left;
        const auto rim = [&](double floor_m_per_s, double torque_Nm) {
            return (floor_m_per_s + slip_per_Nm_rad_per_s * torque_Nm * std::abs(floor_m_per_s / r)) / r;
        };
        const double half_m = kGeometry.track_m / 2;
        once.left = keeps * once.left + (1 - keeps) * rim(v - half_m * yaw, torque.left);
        once.right = keeps * once.right + (1 - keeps) * rim(v + half_m * yaw, torque.right);
        twice.left = keeps * twice.left + (1 - keeps) * once.left;
        twice.right = keeps * twice.right + (1 - keeps) * once.right;
        tools::MeasuredSample s;
        s.t_s = t;
        s.torque_Nm = torque;
        s.speed_rad_per_s = {twice.left + noise(random), twice.right + noise(random)};
        s.gyro_rad_per_s = yaw + 0.02 + noise(random);
        log.samples.push_back(s);
    }
    return log;
}

}  // namespace

TEST_GROUP(GapSlip){};

TEST(GapSlip, WheelsAndGyroDisagreeUnderForce) {
    constexpr double kSlip = 0.001;
    const auto found = gap::slip_by_gyro({drive(kSlip, 0.004)}, kGeometry);
    CHECK(found.has_value());
    DOUBLES_EQUAL(kSlip, found->value, 4 * found->error);
    CHECK(found->error < kSlip / 10);
}

TEST(GapSlip, WithoutSlipALateReportIsNone) {
    for (const double lag_s : {0.001, 0.004, 0.008}) CHECK(!gap::slip_by_gyro({drive(0, lag_s)}, kGeometry));
}

// However sure: of a tenth of a thousandth of the yaw rate no wheel and no lag is as the model has it.
TEST(GapSlip, ATrifleIsNone) {
    CHECK(gap::slip_by_gyro({drive(0.001, 0.004, 1e-4)}, kGeometry).has_value());
    CHECK(!gap::slip_by_gyro({drive(1e-5, 0.004, 1e-4)}, kGeometry).has_value());
}

TEST(GapSlip, WithoutAGyroNothingIsSaid) {
    tools::MeasuredLog log = drive(0.001, 0.004);
    log.has_gyro = false;
    CHECK(!gap::slip_by_gyro({log}, kGeometry));
}

// The gyro alone must be twice as sure as beside rows that agree; rows that deny it are believed. Rows that
// are sure beside all that comes late need no gyro, for a slip that is of interest.
TEST(GapSlip, RowsMustAgreeOrAtLeastNotDenyIt) {
    gap::Setting setting;
    setting.geometry = kGeometry;
    setting.dynamics = {0, 0, 0.5, 2};
    setting.peak_speed_rad_per_s = 20;
    const auto unsure = [](double value, double error) {
        return gap::SlipInRows{{value, error}, false, 0.1};
    };
    CHECK(gap::slip_of(gap::RollingSlip{1e-3, 2e-4}, unsure(8e-4, 2e-4), setting).has_value());
    CHECK(!gap::slip_of(gap::RollingSlip{1e-3, 2e-4}, unsure(1e-4, 2e-4), setting).has_value());
    CHECK(gap::slip_of(gap::RollingSlip{1e-3, 1e-4}, unsure(1e-4, 2e-4), setting).has_value());
    CHECK(!gap::slip_of(gap::RollingSlip{1e-3, 1e-4}, unsure(-8e-4, 2e-4), setting).has_value());
    CHECK(!gap::slip_of({}, unsure(1e-3, 1e-5), setting).has_value());
    CHECK(gap::slip_of({}, {{1e-3, 1e-5}, true, 0.1}, setting).has_value());
    CHECK(!gap::slip_of({}, {{1e-3, 1e-5}, true, 0.005}, setting).has_value());
    // slip = slip speed x force over load, at half of the largest speed: both ways to write one number
    const auto found = gap::slip_of(gap::RollingSlip{1e-3, 1e-5}, unsure(1e-3, 1e-5), setting);
    const auto settled = model::WheelSlip::forward(model::Parameters<double>{1, found->parameters[1]},
                                                   setting.geometry, setting.dynamics);
    DOUBLES_EQUAL(1e-3 * 10 * 0.1, settled.bodys_share * settled.slip_per_force, 1e-9);
}
