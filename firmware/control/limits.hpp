// Limits on what is commanded, and the names of the limiters for telemetry. All functions are pure, a few
// tens of instructions, and never enlarge a command. Limits are positive; a non-positive limit means zero.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "firmware/control/reference.hpp"
#include "firmware/model/dynamics.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/model/types.hpp"

namespace wheelwright::control {

// What is limiting now; numbers are bits of LimiterFlags and of the telemetry's value.
enum class Limiter : std::uint8_t {
    torque_sum,         // forward acceleration gets less torque than it asked for
    torque_difference,  // yaw acceleration gets less torque than it asked for
    speed,              // commanded speed is scaled (jointly with the yaw rate)
    yaw_rate,           // commanded yaw rate is scaled (jointly with the speed)
    acceleration,       // the change of the commanded speed is limited
    yaw_acceleration,   // the change of the commanded yaw rate is limited
};
inline constexpr std::array<std::string_view, 6> kLimiterNames{
    "torque_sum", "torque_difference", "speed", "yaw_rate", "acceleration", "yaw_acceleration"};

struct LimiterFlags {
    std::uint8_t bits = 0;

    constexpr void set(Limiter which) { bits = static_cast<std::uint8_t>(bits | (1U << unsigned(which))); }
    constexpr bool has(Limiter which) const { return (bits >> unsigned(which) & 1U) != 0; }
    // Less torque is sent than the law wanted, in the wheels' sum or in their difference.
    constexpr bool torque_limited() const {
        return has(Limiter::torque_sum) || has(Limiter::torque_difference);
    }
    constexpr void add(LimiterFlags other) { bits = static_cast<std::uint8_t>(bits | other.bits); }
};

// Scales speed and yaw rate by one factor, so that both lie within their limits and the curvature of the
// path, omega / v, is kept.
template <typename Real>
constexpr Twist<Real> scale_jointly(const Twist<Real>& wanted, Real speed_limit_m_per_s,
                                    Real yaw_rate_limit_rad_per_s, LimiterFlags& flags) {
    const Real v = std::abs(wanted.v_m_per_s);
    const Real w = std::abs(wanted.omega_rad_per_s);
    const Real v_limit = std::max(speed_limit_m_per_s, Real(0));
    const Real w_limit = std::max(yaw_rate_limit_rad_per_s, Real(0));
    if (v <= v_limit && w <= w_limit) return wanted;
    const Real by_speed = v > v_limit ? v_limit / v : Real(1);
    const Real by_yaw = w > w_limit ? w_limit / w : Real(1);
    flags.set(by_speed <= by_yaw ? Limiter::speed : Limiter::yaw_rate);
    const Real factor = std::min(by_speed, by_yaw);
    return {std::clamp(wanted.v_m_per_s * factor, -v_limit, v_limit),
            std::clamp(wanted.omega_rad_per_s * factor, -w_limit, w_limit)};
}

// Whether neither wheel's torque is beyond +-limit.
template <typename Real>
constexpr bool within_limit(const WheelPair<Real>& torque_Nm, Real limit_Nm) {
    return std::abs(torque_Nm.sum()) + std::abs(torque_Nm.difference()) <= 2 * limit_Nm;
}

// Keeps both wheel torques within +-limit. In terms of s = right + left and d = right - left the limit is
// |s| + |d| <= 2 limit. What of the wanted torque only holds the motion, that it may not grow by itself,
// comes first. Of the rest, turning first, for it keeps the robot on its path, but the sum keeps at least
// `kSumShare` if it asks for that much. Neither is enlarged, nor changes its sign.
inline constexpr double kSumShare = 0.3;

template <typename Real>
constexpr WheelPair<Real> limit_torque(const WheelPair<Real>& wanted_Nm, const WheelPair<Real>& holding_Nm,
                                       Real limit_Nm, LimiterFlags& flags) {
    if (within_limit(wanted_Nm, limit_Nm)) return wanted_Nm;
    const Real half = std::max(limit_Nm, Real(0));
    const Real whole = 2 * half;
    const Real sum = wanted_Nm.sum();
    const Real difference = wanted_Nm.difference();
    const auto part = [](Real holding, Real wanted) {
        return holding * wanted > 0 ? std::abs(holding) : Real(0);
    };
    const Real holds_sum = part(holding_Nm.sum(), sum);
    const Real holds = holds_sum + part(holding_Nm.difference(), difference);
    const Real for_sum =
        holds > whole ? holds_sum * (whole / holds) : holds_sum + Real(kSumShare) * (whole - holds);
    const Real most_d = std::max(whole - std::min(for_sum, std::abs(sum)), Real(0));
    const Real d = std::clamp(difference, -most_d, most_d);
    const Real most_s = whole - std::abs(d);
    const Real s = std::clamp(sum, -most_s, most_s);
    if (d != difference) flags.set(Limiter::torque_difference);
    if (s != sum) flags.set(Limiter::torque_sum);
    // rounding must not leave the limit
    return {std::clamp((s - d) / 2, -half, half), std::clamp((s + d) / 2, -half, half)};
}

// A robot that turns is pushed towards its centre of gravity, K5 omega^2 in eq (43); one that moves away from
// it, K6 v > 0, turns ever faster by itself. Above a certain yaw rate no torque holds it. Keeps the wanted
// one to where half of the torque does, which leaves the other half for the rest. v is the measured speed;
// the limit is a wheel's.
template <typename Real>
constexpr Real hold_yaw_rate(Real omega_rad_per_s, Real v_m_per_s, const model::Dynamics<Real>& k,
                             Real limit_Nm, LimiterFlags& flags) {
    const Real size = std::abs(omega_rad_per_s);
    const Real grows_Nm_s = k.k7_per_kg_m * std::max(k.k6_per_m * v_m_per_s, Real(0));
    const Real pushes_Nm_s2 = k.k8_per_kg_m2 * std::abs(k.k5_m);
    const Real most_Nm = k.k7_per_kg_m * k.k8_per_kg_m2 * std::max(limit_Nm, Real(0));
    if (!((pushes_Nm_s2 * size + grows_Nm_s) * size > most_Nm)) return omega_rad_per_s;
    flags.set(Limiter::yaw_rate);
    if (!(most_Nm > 0)) return 0;
    const Real root = std::sqrt(grows_Nm_s * grows_Nm_s + 4 * pushes_Nm_s2 * most_Nm);
    return std::copysign(2 * most_Nm / (grows_Nm_s + root), omega_rad_per_s);
}

// Scales speed and yaw rate by one factor, so that half of the torque holds them against the pushes of eq
// (43): a robot that cannot turn at this speed drives its curve more slowly. Unlike above, a robot that moves
// towards its centre of gravity, K6 v < 0, needs torque too, to turn at all. K7 and K8 must not be zero.
template <typename Real>
constexpr Twist<Real> hold_curve(const Twist<Real>& wanted, const model::Dynamics<Real>& k, Real limit_Nm,
                                 LimiterFlags& flags) {
    const Real most_Nm = std::max(limit_Nm, Real(0));  // of twice the limit, for both wheels
    const WheelPair<Real> holding_Nm = model::inverse_dynamics(k, wanted, TwistRate<Real>{});
    if (within_limit(holding_Nm, most_Nm / 2)) return wanted;
    flags.set(Limiter::yaw_rate);
    const Real factor = std::sqrt(most_Nm / (std::abs(holding_Nm.sum()) + std::abs(holding_Nm.difference())));
    return {wanted.v_m_per_s * factor, wanted.omega_rad_per_s * factor};
}

// The changes of speed and yaw rate that the limits and half of the torque allow: one half for speed and one
// for yaw, so that both can be had at once.
inline TwistRate<double> usual_acceleration(const model::RobotParameters& from) {
    return {std::min(from.limits.acceleration_m_per_s2, from.dynamics.k7_per_kg_m * from.limits.torque_Nm),
            std::min(from.limits.yaw_acceleration_rad_per_s2,
                     from.dynamics.k8_per_kg_m2 * from.limits.torque_Nm)};
}

// In which they bring the robot to rest from its limits of speed and yaw rate.
inline double braking_time_s(const model::RobotParameters& from) {
    const auto [acceleration, yaw_acceleration] = usual_acceleration(from);
    return std::max(from.limits.speed_m_per_s / acceleration,
                    from.limits.yaw_rate_rad_per_s / yaw_acceleration);
}

// Moves a commanded twist towards a target no faster than two accelerations allow. Speed and yaw rate move
// by the same share of their ways, so a target of the same curvature is reached without leaving the path.
// The result lies between the last command and the target on both axes, whatever their signs.
template <typename Real>
class TwistRateLimiter {
  public:
    // Accelerations in m/s^2 and rad/s^2.
    void configure(Real acceleration, Real yaw_acceleration) {
        acceleration_ = std::max(acceleration, Real(0));
        yaw_acceleration_ = std::max(yaw_acceleration, Real(0));
    }

    void reset(const Twist<Real>& now) { now_ = now; }
    const Twist<Real>& now() const { return now_; }

    const Twist<Real>& step(const Twist<Real>& target, Real dt_s, LimiterFlags& flags) {
        const Real dv = target.v_m_per_s - now_.v_m_per_s;
        const Real dw = target.omega_rad_per_s - now_.omega_rad_per_s;
        const Real v_step = acceleration_ * dt_s;
        const Real w_step = yaw_acceleration_ * dt_s;
        if (std::abs(dv) <= v_step && std::abs(dw) <= w_step) {
            now_ = target;
            return now_;
        }
        const Real by_v = std::abs(dv) > v_step ? v_step / std::abs(dv) : Real(1);
        const Real by_w = std::abs(dw) > w_step ? w_step / std::abs(dw) : Real(1);
        flags.set(by_v <= by_w ? Limiter::acceleration : Limiter::yaw_acceleration);
        const Real share = std::min(by_v, by_w);
        now_.v_m_per_s += dv * share;
        now_.omega_rad_per_s += dw * share;
        return now_;
    }

  private:
    Twist<Real> now_;
    Real acceleration_{};
    Real yaw_acceleration_{};
};

}  // namespace wheelwright::control
