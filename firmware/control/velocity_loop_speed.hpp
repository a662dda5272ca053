// How quick velocity loops and wheel observer of a robot may be: what the robot file leaves at "auto" follows
// from the measured delay, the encoders' noise and the torque.
//
// Any thread; no allocation. About 200 operations.
#pragma once

#include <algorithm>
#include <cmath>

#include "firmware/model/effects.hpp"
#include "firmware/model/robot_parameters.hpp"

namespace wheelwright::control {

// -ln 0.01: after so many time constants a first-order response has settled to 1 %.
inline constexpr double kTimeConstantsToOnePercent = 4.605170185988091;

struct VelocityLoopSpeed {
    double settling_time_s{};
    double observer_bandwidth_rad_per_s{};
};

// What dry friction leaves of a wheel's torque, and a tenth of the limit at least, so that a model of
// friction that is wrong makes no loop slow without end.
inline double accelerating_Nm(const model::RobotParameters& from) {
    const double limit_Nm = from.limits.torque_Nm;
    return std::max(limit_Nm - model::dry_friction_Nm(from.effects, from.geometry), limit_Nm / 10);
}

// How often the encoders are reported: each cycle, or as the robot file says.
inline double encoder_report_s(const model::RobotParameters& from, double cycle_s) {
    return std::max(cycle_s, 1e-3 * from.drive.encoder_period_ms);
}

// What the robot file says; "auto" follows from the robot:
// - delay: a loop needs some fourteen times its delay to settle (where an effect makes the torque later, this
//   bounds a given time too). Reports of the encoders that come less often than each cycle are in the mean
//   older by half of the difference;
// - encoders: what is left of their noise in the true speed, after a loop that settles in t,
//   r sigma sqrt(T) (4.6 / t)^1.5 with reports each T, shall be 0.6 % of a step that the torque can give in
//   t, 0.3 t a, with a by what dry friction leaves of the torque, at a wheel's rim, forward or turning,
//   whichever is less;
// - fifty cycles, so that a loop is seen as continuous.
// The observer is 2.7 times as fast as a loop that settles so (12.5 / 4.6): with that the default robot has
// 55 degrees of phase margin (`wheelwright demo`).
inline VelocityLoopSpeed velocity_loop_speed(const model::RobotParameters& from, double cycle_s) {
    constexpr double kSettlingPerDelay = 14;
    constexpr double kFewestCycles = 50;
    constexpr double kObserverPerSettling = 12.5;
    constexpr double kRippleShare = 0.006;
    constexpr double kStepShare = 0.3;
    const auto& loop = from.velocity_loop;
    const double effects_s = model::effects_delay_s(from.effects);
    const double report_s = encoder_report_s(from, cycle_s);
    const double by_delay_s =
        kSettlingPerDelay * (loop.actuation_delay_s + effects_s + (report_s - cycle_s) / 2);
    VelocityLoopSpeed speed{loop.settling_time_s, loop.observer_bandwidth_rad_per_s};
    if (loop.settling_time_s > 0) {
        if (effects_s > 0) speed.settling_time_s = std::max(speed.settling_time_s, by_delay_s);
    } else {
        const double rim_per_Nm =
            2 * std::min(from.dynamics.k7_per_kg_m, from.dynamics.k8_per_kg_m2 * from.geometry.track_m / 2);
        const double acceleration_m_per_s2 = rim_per_Nm * accelerating_Nm(from);
        const double noise = from.geometry.mean_radius_m() * loop.angle_noise_rad * std::sqrt(report_s) *
                             std::pow(Real(kTimeConstantsToOnePercent), Real(1.5));
        const double by_noise_s =
            std::pow(Real(noise / (kRippleShare * kStepShare * acceleration_m_per_s2)), Real(0.4));
        speed.settling_time_s = std::max({kFewestCycles * cycle_s, by_delay_s, by_noise_s});
    }
    if (loop.observer_bandwidth_rad_per_s <= 0)
        speed.observer_bandwidth_rad_per_s = kObserverPerSettling / speed.settling_time_s;
    return speed;
}

}  // namespace wheelwright::control
