// Feedback linearisation, eq (61)-(64): the torque that makes u' = nu, with the catalogue's effects
// compensated. Works with any set of active effects; cost about 60 instructions and 20 per active effect.
#pragma once

#include <algorithm>
#include <cmath>

#include "firmware/control/velocity_loop_speed.hpp"
#include "firmware/model/dynamics.hpp"
#include "firmware/model/effects.hpp"
#include "firmware/model/robot_parameters.hpp"

namespace wheelwright::control {

// What the controllers know of the robot. K7 and K8 must not be zero.
template <typename Real>
struct PlantModel {
    model::Geometry<Real> geometry;
    model::Dynamics<Real> dynamics;
    model::EffectSet<Real> effects;
    // false: none is active but the first kCommonEffects and cog_lateral
    bool rare_effects = true;
    // Of a wheel, see below; in rad/s.
    Real sure_speed_rad_per_s = Real(0.15);
    Real soft_speed_rad_per_s = Real(0.04);
};

// Dry friction is compensated by the sign of the *reference* speed, softened over soft_speed, because a sign
// of the measured speed chatters at rest; measured speed joins in where it is beyond doubt (sure_speed), so
// that a braking wheel is not told to push against a friction that already brakes it. Beyond doubt is six
// standard deviations of the observer's speed, and 0.45 % of the speed limit, as the noise may not be known;
// softened over a 3.75th of it.
inline constexpr double kObserverCycle_s = 1e-3;  // the firmware's cycle
inline constexpr double kSureSigmas = 6;
inline constexpr double kSureShare = 0.0045;
inline constexpr double kSurePerSoft = 3.75;

template <typename Real>
PlantModel<Real> plant_model(const model::RobotParameters& from) {
    PlantModel<Real> to;
    to.geometry = model::Geometry<Real>(from.geometry);
    to.dynamics = model::Dynamics<Real>(from.dynamics);
    to.effects = model::EffectSet<Real>(from.effects);
    bool rare = false;
    for (std::size_t i = model::kCommonEffects; i < model::kEffectCount; ++i)
        rare = rare || (to.effects.active[i] && i != model::kCogLateral);
    to.rare_effects = rare;
    to.geometry = model::actual_geometry(to.effects, to.geometry);
    // The observer averages an angle's noise over its time: sigma omega sqrt(omega T), T between reports.
    const double bandwidth = velocity_loop_speed(from, kObserverCycle_s).observer_bandwidth_rad_per_s;
    const double report_s = encoder_report_s(from, kObserverCycle_s);
    const double noise = from.velocity_loop.angle_noise_rad * bandwidth * std::sqrt(bandwidth * report_s);
    const double sure =
        std::max(kSureSigmas * noise, kSureShare * from.limits.speed_m_per_s / from.geometry.mean_radius_m());
    to.sure_speed_rad_per_s = Real(sure);
    to.soft_speed_rad_per_s = Real(sure / kSurePerSoft);
    return to;
}

// The torque that the effects are expected to add at the wheels.
template <std::size_t kUpTo = model::kEffectCount, typename Real>
constexpr WheelPair<Real> expected_effect_torque_Nm(const PlantModel<Real>& plant,
                                                    const model::Motion<Real>& measured,
                                                    const Twist<Real>& reference) {
    const WheelPair<Real> reference_speed = model::wheel_speeds_from_twist(plant.geometry, reference);
    WheelPair<Real> total = model::smooth_effect_torque_Nm<false, kUpTo>(
        plant.effects, {measured, {}, plant.geometry, plant.dynamics});
    model::for_each_dry<kUpTo>(
        plant.effects, plant.geometry, measured.wheel_speed_rad_per_s,
        [&](std::size_t, unsigned, const WheelPair<Real>& direction, Real limit_Nm) {
            const Real sliding = model::sliding_speed(direction, measured.wheel_speed_rad_per_s);
            const Real sure =
                sliding - std::clamp(sliding, -plant.sure_speed_rad_per_s, plant.sure_speed_rad_per_s);
            const Real asked = model::sliding_speed(direction, reference_speed);
            const Real amount =
                -limit_Nm * std::clamp((asked + sure) / plant.soft_speed_rad_per_s, Real(-1), Real(1));
            total.left += amount * direction.left;
            total.right += amount * direction.right;
        });
    return total;
}

// The accelerations that come, where K7 and K8 alone would give these.
template <typename Real>
constexpr TwistRate<Real> coupled_acceleration(const PlantModel<Real>& plant, const TwistRate<Real>& alone) {
    if (!plant.effects.active[model::kCogLateral]) return alone;
    return model::CogLateral::coupled(plant.effects.parameter[model::kCogLateral], plant.geometry,
                                      plant.dynamics, alone);
}

namespace detail {

template <std::size_t kUpTo, typename Real>
constexpr WheelPair<Real> linearising_torque_Nm(const PlantModel<Real>& plant,
                                                const model::Motion<Real>& measured,
                                                const Twist<Real>& reference, const TwistRate<Real>& nu) {
    WheelPair<Real> total = model::inverse_dynamics(plant.dynamics, measured.twist, nu);
    if (plant.effects.active[model::kCogLateral]) {
        const WheelPair<Real> push = model::wheel_torque_Nm(
            plant.geometry, model::CogLateral::push(plant.effects.parameter[model::kCogLateral],
                                                    plant.geometry, plant.dynamics, nu));
        total.left -= push.left;
        total.right -= push.right;
    }
    const WheelPair<Real> effects = expected_effect_torque_Nm<kUpTo>(plant, measured, reference);
    return model::asked_torque_Nm<kUpTo>(
        plant.effects, WheelPair<Real>{total.left - effects.left, total.right - effects.right});
}

template <std::size_t kUpTo, typename Real>
constexpr TwistRate<Real> linearised_acceleration(const PlantModel<Real>& plant,
                                                  const model::Motion<Real>& measured,
                                                  const Twist<Real>& reference,
                                                  const WheelPair<Real>& torque_Nm) {
    const WheelPair<Real> effects = expected_effect_torque_Nm<kUpTo>(plant, measured, reference);
    const WheelPair<Real> delivered = model::delivered_torque_Nm<kUpTo>(
        plant.effects, {measured, torque_Nm, plant.geometry, plant.dynamics});
    return coupled_acceleration(plant, model::acceleration(plant.dynamics, measured.twist,
                                                           WheelPair<Real>{delivered.left + effects.left,
                                                                           delivered.right + effects.right}));
}

// Out of the way of the usual case.
template <typename Real>
[[gnu::noinline]] constexpr WheelPair<Real> linearising_torque_of_all_Nm(const PlantModel<Real>& plant,
                                                                         const model::Motion<Real>& measured,
                                                                         const Twist<Real>& reference,
                                                                         const TwistRate<Real>& nu) {
    return linearising_torque_Nm<model::kEffectCount>(plant, measured, reference, nu);
}
template <typename Real>
[[gnu::noinline]] constexpr TwistRate<Real> linearised_acceleration_of_all(
    const PlantModel<Real>& plant, const model::Motion<Real>& measured, const Twist<Real>& reference,
    const WheelPair<Real>& torque_Nm) {
    return linearised_acceleration<model::kEffectCount>(plant, measured, reference, torque_Nm);
}

}  // namespace detail

// Wheel torques for the acceleration nu, eq (62). Not limited.
template <typename Real>
constexpr WheelPair<Real> linearising_torque_Nm(const PlantModel<Real>& plant,
                                                const model::Motion<Real>& measured,
                                                const Twist<Real>& reference, const TwistRate<Real>& nu) {
    if (plant.rare_effects) return detail::linearising_torque_of_all_Nm(plant, measured, reference, nu);
    return detail::linearising_torque_Nm<model::kCommonEffects>(plant, measured, reference, nu);
}

// The acceleration nu that a torque stands for: the inverse of linearising_torque_Nm().
template <typename Real>
constexpr TwistRate<Real> linearised_acceleration(const PlantModel<Real>& plant,
                                                  const model::Motion<Real>& measured,
                                                  const Twist<Real>& reference,
                                                  const WheelPair<Real>& torque_Nm) {
    if (plant.rare_effects)
        return detail::linearised_acceleration_of_all(plant, measured, reference, torque_Nm);
    return detail::linearised_acceleration<model::kCommonEffects>(plant, measured, reference, torque_Nm);
}

}  // namespace wheelwright::control
