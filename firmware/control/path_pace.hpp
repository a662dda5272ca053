// Slows a path down to what the robot can follow: finds the least factor on its period at which speed, yaw
// rate, their rates of change and the torque that the model needs for them stay within a share of the
// limits. The rest is left for feedback. The path's shape is kept, only its time is stretched.
//
// With the period k times as long, speeds fall by k and accelerations by k^2; the torque follows from the
// model (K5..K8 and the effects, dry friction included) at those.
//
// It walks along the path in pieces of a 64th of its time, shorter where the heading turns by more than 0.1
// rad, one point in each call of step(): some 1 100 instructions, and 70 to 600 calls. No allocation; one
// thread.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "firmware/control/feedback_linearisation.hpp"
#include "firmware/control/tracking.hpp"
#include "firmware/control/trajectory.hpp"

namespace wheelwright::control {

enum class PaceLimit : std::uint8_t { none, speed, yaw_rate, acceleration, yaw_acceleration, torque };

// Shares of the limits that a path may ask for; of the torque, what accelerates may have this share of what
// friction leaves. Feedback that brings an error of the position back to rest at the rate g, asks for g times
// the error in speed and for g^2 times in acceleration: of these two the second needs more room.
inline constexpr double kPaceShareOfSpeed = 0.9;
inline constexpr double kPaceShareOfTorque = 0.7;
// A path that still asks for too much torque at this multiple of its period is held up by friction, which
// slowness does not lessen.
inline constexpr double kMostStretch = 100;

template <typename Real>
struct PaceLimits {
    TrackingSettings<Real> tracking;  // what the tracker allows
    Real torque_Nm{};                 // of a wheel; not positive: not looked at
    // What stands behind the tracker's accelerations.
    PaceLimit acceleration_by = PaceLimit::acceleration;
    PaceLimit yaw_acceleration_by = PaceLimit::yaw_acceleration;
};

template <typename Real>
PaceLimits<Real> pace_limits(const model::RobotParameters& from) {
    PaceLimits<Real> to;
    to.tracking = tracking_settings<Real>(from);
    to.torque_Nm = Real(from.limits.torque_Nm);
    if (to.tracking.acceleration_m_per_s2 < Real(from.limits.acceleration_m_per_s2))
        to.acceleration_by = PaceLimit::torque;
    if (to.tracking.yaw_acceleration_rad_per_s2 < Real(from.limits.yaw_acceleration_rad_per_s2))
        to.yaw_acceleration_by = PaceLimit::torque;
    return to;
}

template <typename Real>
class PathPace {
  public:
    void begin(const PathSettings<Real>& asked) {
        asked_ = asked;
        stretch_ = 1;
        by_ = PaceLimit::none;
        tick_ = 0;
        step_ = kLongestStep;
        heading_known_ = false;
        running_ = true;
    }

    bool running() const { return running_; }

    // The next point. The plant and the limits are those of begin().
    void step(const PlantModel<Real>& plant, const PaceLimits<Real>& limits) {
        if (!running_) return;
        const std::uint32_t there = heading_known_ ? tick_ + step_ : 0;
        const Real whole_s = asked_.period_s + asked_.ramp_s;
        const ReferencePoint<Real> point = path_point(asked_, whole_s * Real(there) / Real(kTicks));
        const Real turned = wrap_angle_rad(point.pose.heading_rad - heading_rad_);
        if (heading_known_ && std::abs(turned) > Real(kMostTurn_rad) && step_ > 1) {
            step_ /= 2;
            return;
        }
        if (exceeds(plant, limits, point)) return;  // the same point again, at the new stretch
        heading_rad_ = point.pose.heading_rad;
        heading_known_ = true;
        tick_ = there;
        if (step_ < kLongestStep && tick_ % (2 * step_) == 0) step_ *= 2;
        running_ = tick_ < kTicks;
    }

    // The path in force, and what has stretched it; valid when no longer running().
    PathSettings<Real> path() const {
        PathSettings<Real> path = asked_;
        path.period_s *= stretch_;
        path.ramp_s *= stretch_;
        return path;
    }
    const PathSettings<Real>& asked() const { return asked_; }
    Real period_s() const { return asked_.period_s * stretch_; }
    PaceLimit limited_by() const { return by_; }

  private:
    static constexpr std::uint32_t kTicks = 1U << 16U;
    static constexpr std::uint32_t kLongestStep = kTicks / 64;
    static constexpr double kMostTurn_rad = 0.1;
    static constexpr double kFiner = 1.01;  // the stretch is found to so much

    // Raises the stretch where this point needs it. True: the torque has to be looked at again.
    bool exceeds(const PlantModel<Real>& plant, const PaceLimits<Real>& limits,
                 const ReferencePoint<Real>& point) {
        const TrackingSettings<Real>& t = limits.tracking;
        const auto at_least = [this](Real stretch, PaceLimit by) {
            if (!(stretch > stretch_)) return false;
            stretch_ = stretch;
            by_ = by;
            return true;
        };
        const auto share = [](Real size, Real limit, double part) {
            return std::abs(size) / (Real(part) * limit);
        };
        at_least(share(point.twist.v_m_per_s, t.speed_m_per_s, kPaceShareOfSpeed), PaceLimit::speed);
        at_least(share(point.twist.omega_rad_per_s, t.yaw_rate_rad_per_s, kPaceShareOfSpeed),
                 PaceLimit::yaw_rate);
        at_least(std::sqrt(share(point.rate.v_m_per_s2, t.acceleration_m_per_s2, kPaceShareOfTorque)),
                 limits.acceleration_by);
        at_least(
            std::sqrt(share(point.rate.omega_rad_per_s2, t.yaw_acceleration_rad_per_s2, kPaceShareOfTorque)),
            limits.yaw_acceleration_by);
        if (!(limits.torque_Nm > 0) || stretch_ >= Real(kMostStretch)) return false;
        const Real by_time = 1 / stretch_;
        model::Motion<Real> motion;
        motion.twist = {by_time * point.twist.v_m_per_s, by_time * point.twist.omega_rad_per_s};
        motion.wheel_speed_rad_per_s = model::wheel_speeds_from_twist(plant.geometry, motion.twist);
        motion.heading_rad = point.pose.heading_rad;
        const TwistRate<Real> rate{by_time * by_time * point.rate.v_m_per_s2,
                                   by_time * by_time * point.rate.omega_rad_per_s2};
        const WheelPair<Real> torque = linearising_torque_Nm(plant, motion, motion.twist, rate);
        // What turns the robot by itself falls with the speed's square too.
        const WheelPair<Real> friction =
            linearising_torque_Nm(plant, motion, motion.twist,
                                  model::acceleration(plant.dynamics, motion.twist, WheelPair<Real>{}));
        const auto used = [&](Real whole, Real steady) {
            return share(whole - steady, limits.torque_Nm - std::abs(steady), kPaceShareOfTorque);
        };
        const Real over = std::max(used(torque.left, friction.left), used(torque.right, friction.right));
        const bool none_left =
            std::max(std::abs(friction.left), std::abs(friction.right)) >= limits.torque_Nm;
        if (!none_left && over <= 1) return false;
        // Exact where all of the torque accelerates; speed-dependent friction asks for another round.
        const Real more = none_left ? Real(2) : std::max(std::sqrt(over), Real(kFiner));
        return at_least(stretch_ * more, PaceLimit::torque);
    }

    PathSettings<Real> asked_;
    Real stretch_ = 1;
    Real heading_rad_{};
    std::uint32_t tick_ = 0;
    std::uint32_t step_ = kLongestStep;
    PaceLimit by_ = PaceLimit::none;
    bool heading_known_ = false;
    bool running_ = false;
};

}  // namespace wheelwright::control
