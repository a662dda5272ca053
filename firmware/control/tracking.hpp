// Follows a moving reference point: feed-forward of its velocities and accelerations, and feedback on the
// error in the robot's frame, with gains per distance driven, so that the shape of convergence does not
// depend on speed:
//
//   v     = v_r cos(e_h) + k_along e_x
//   omega = omega_r + k_across v_r sinc(e_h) e_y + k_heading speed e_h
//
// (Kanayama, Kimura, Miyazaki, Noguchi 1990; Samson 1993.) e_x, e_y, e_h: reference less robot in the robot's
// frame. speed is |v_r| with a floor that grows with the yaw rate, so that a spin keeps its heading.
//
// Far from the path the position error is shortened, keeping its direction, to catch_up_m: the robot then
// steers towards the path at a bounded angle and overtakes at a bounded speed, and the law takes over as it
// is without a switch. Commands are scaled jointly to the limits and limited in acceleration.
//
// One thread; no allocation; about 420 instructions.
#pragma once

#include <algorithm>
#include <cmath>

#include "firmware/control/limits.hpp"
#include "firmware/control/pose_control.hpp"
#include "firmware/control/reference.hpp"
#include "firmware/model/robot_parameters.hpp"

namespace wheelwright::control {

inline constexpr double kHeadingPerAcross = 5.0 / 3;
inline constexpr double kSteeringShare = 0.7;
inline constexpr double kAlongShare = 0.25;
// Steering counts for this share of the speed limit at least, and for this share of the track times the yaw
// rate: a robot that stands or spins keeps its heading.
inline constexpr double kLeastPace = 0.02;
inline constexpr double kPacePerTrack = 0.3;

template <typename Real>
struct TrackingSettings {
    Real along_gain_per_s{};
    Real across_gain_per_m2{};
    Real heading_gain_per_m{};
    Real catch_up_m{};  // position errors count for no more than this
    Real least_pace_m_per_s{}, pace_per_yaw_rate_m{};
    Real speed_m_per_s{};
    Real yaw_rate_rad_per_s{};
    Real acceleration_m_per_s2{};
    Real yaw_acceleration_rad_per_s2{};
};

// Settings from the robot file. Gains that it leaves at "auto": the robot comes back to the path within the
// length l, as e'' + 5/3 e'/l + e/l^2 = 0 over the distance driven (damping 5/6). That is its track; longer
// where the yaw acceleration that a steering angle asks for, some v^2 / l^2 at the speed v, would be more
// than the robot has. Along the path a quarter of the acceleration brings it back to rest from an error of l.
template <typename Real>
TrackingSettings<Real> tracking_settings(const model::RobotParameters& from) {
    const auto& t = from.trajectory;
    const auto [acceleration, yaw_acceleration] = usual_acceleration(from);
    const double speed = from.limits.speed_m_per_s;
    const double track = from.geometry.track_m;
    const double length = std::max(track, kSteeringShare * speed / std::sqrt(yaw_acceleration));
    const double across = t.across_gain_per_m2 > 0 ? t.across_gain_per_m2 : 1 / (length * length);
    const double heading =
        t.heading_gain_per_m > 0 ? t.heading_gain_per_m : kHeadingPerAcross * std::sqrt(across);
    TrackingSettings<Real> to;
    to.along_gain_per_s =
        Real(t.along_gain_per_s > 0 ? t.along_gain_per_s : std::sqrt(kAlongShare * acceleration / length));
    to.across_gain_per_m2 = Real(across);
    to.heading_gain_per_m = Real(heading);
    to.catch_up_m = Real(0.7 * heading / across);
    to.least_pace_m_per_s = Real(kLeastPace * speed);
    to.pace_per_yaw_rate_m = Real(kPacePerTrack * track);
    to.speed_m_per_s = Real(speed);
    to.yaw_rate_rad_per_s = Real(from.limits.yaw_rate_rad_per_s);
    to.acceleration_m_per_s2 = Real(acceleration);
    to.yaw_acceleration_rad_per_s2 = Real(yaw_acceleration);
    return to;
}

template <typename Real>
struct TrackingCommand {
    VelocityReference<Real> reference;
    Real along_m{};  // reference less robot, in the robot's frame
    Real across_m{};
    Real heading_rad{};
    bool catching_up = false;  // the position error is beyond catch_up_m
    LimiterFlags flags;
};

template <typename Real>
class TrajectoryTracker {
  public:
    void configure(const TrackingSettings<Real>& settings) {
        settings_ = settings;
        limiter_.configure(settings.acceleration_m_per_s2, settings.yaw_acceleration_rad_per_s2);
    }

    // The commanded twist starts at the robot's present one.
    void start(const Twist<Real>& present) { limiter_.reset(present); }

    TrackingCommand<Real> update(const ReferencePoint<Real>& reference, const Pose<Real>& robot, Real dt_s) {
        TrackingCommand<Real> out;
        const Real c = std::cos(robot.heading_rad);
        const Real s = std::sin(robot.heading_rad);
        const Real dx = reference.pose.x_m - robot.x_m;
        const Real dy = reference.pose.y_m - robot.y_m;
        const Real heading = wrap_angle_rad(reference.pose.heading_rad - robot.heading_rad);
        out.along_m = c * dx + s * dy;
        out.across_m = c * dy - s * dx;
        out.heading_rad = heading;
        const Real distance = std::sqrt(dx * dx + dy * dy);
        out.catching_up = distance > settings_.catch_up_m;
        const Real shorten = out.catching_up ? settings_.catch_up_m / distance : Real(1);

        const Real v_r = reference.twist.v_m_per_s;
        const Real w_r = reference.twist.omega_rad_per_s;
        const Real pace =
            std::abs(v_r) + settings_.pace_per_yaw_rate_m * std::abs(w_r) + settings_.least_pace_m_per_s;
        const Bearing bearing = bearing_of(heading);
        Twist<Real> wanted{
            v_r * bearing.cosine + settings_.along_gain_per_s * shorten * out.along_m,
            w_r + settings_.across_gain_per_m2 * v_r * bearing.sine_over_angle * shorten * out.across_m +
                settings_.heading_gain_per_m * pace * heading};
        wanted = scale_jointly(wanted, settings_.speed_m_per_s, settings_.yaw_rate_rad_per_s, out.flags);
        const Twist<Real> before = limiter_.now();
        LimiterFlags slow;
        out.reference.twist = limiter_.step(wanted, dt_s, slow);
        out.flags.add(slow);
        if (slow.bits == 0) {
            out.reference.rate = reference.rate;
        } else {
            out.reference.rate = {(out.reference.twist.v_m_per_s - before.v_m_per_s) / dt_s,
                                  (out.reference.twist.omega_rad_per_s - before.omega_rad_per_s) / dt_s};
        }
        return out;
    }

  private:
    struct Bearing {
        Real cosine;
        Real sine_over_angle;
    };

    // On the path the angle is small, and the series are exact to rounding.
    static Bearing bearing_of(Real angle_rad) {
        if (std::abs(angle_rad) > Real(0.25)) {
            return {std::cos(angle_rad), sine_over_angle(angle_rad, std::sin(angle_rad))};
        }
        const Real x = angle_rad * angle_rad;
        const auto over = [](int n) { return 1 / Real(n); };
        return {1 - x * over(2) *
                        (1 - x * over(12) * (1 - x * over(30) * (1 - x * over(56) * (1 - x * over(90))))),
                1 - x * over(6) *
                        (1 - x * over(20) * (1 - x * over(42) * (1 - x * over(72) * (1 - x * over(110)))))};
    }

    TrackingSettings<Real> settings_;
    TwistRateLimiter<Real> limiter_;
};

}  // namespace wheelwright::control
