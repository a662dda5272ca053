// The robot's motion: geometry, kinematics and the four dynamic parameters K5..K8.
//
//   v'     = K5 omega^2   + K7 (tau_right + tau_left)
//   omega' = K6 v omega   + K8 (tau_right - tau_left)                       paper eq (42), (43)
//
// K5 = a m / m_eff, K6 = -a m / I_eff, K7 = 1 / (m_eff r), K8 = b / (2 r I_eff), where a is the distance of
// the centre of gravity ahead of the axle, m_eff = m + 2 I_w / r^2 and I_eff = I_c + m a^2 + I_w b^2 / (2
// r^2). tau is the torque that accelerates: applied torque less what the effects (effects.hpp) take away.
#pragma once

#include <cmath>

#include "firmware/model/types.hpp"

namespace wheelwright::model {

template <typename Real>
struct Geometry {
    WheelPair<Real> wheel_radius_m;  // > 0
    Real track_m{};                  // > 0, distance between the wheels' contact points

    template <typename Other>
    // NOLINTNEXTLINE(google-explicit-constructor): clang-tidy 16 does not read the condition
    explicit(sizeof(Other) < sizeof(Real)) constexpr operator Geometry<Other>() const {
        return {WheelPair<Other>(wheel_radius_m), Other(track_m)};
    }
    constexpr Real mean_radius_m() const { return (wheel_radius_m.left + wheel_radius_m.right) / 2; }
};

// K5..K8. In physical robots k7 and k8 are positive and k6 = coupled_k6(...).
template <typename Real>
struct Dynamics {
    Real k5_m{};
    Real k6_per_m{};
    Real k7_per_kg_m{};
    Real k8_per_kg_m2{};

    template <typename Other>
    // NOLINTNEXTLINE(google-explicit-constructor): clang-tidy 16 does not read the condition
    explicit(sizeof(Other) < sizeof(Real)) constexpr operator Dynamics<Other>() const {
        return {Other(k5_m), Other(k6_per_m), Other(k7_per_kg_m), Other(k8_per_kg_m2)};
    }
};

// Standard gravity (3rd CGPM, 1901).
inline constexpr double kGravity_m_per_s2 = 9.80665;

// Share that the wheels' rotation, motors included, has in the mass m_eff that K7 stands for. Hardly a log of
// wheel speeds tells it: solid wheels of a sixth of the robot's mass, give or take, with its standard error.
inline constexpr double kRotationShare = 0.08;
inline constexpr double kRotationShareError = 0.04;

// Masses and lengths from which K5..K8 follow; what a simulated robot is described by.
template <typename Real>
struct MassProperties {
    Real mass_kg{};              // whole robot, wheels included
    Real yaw_inertia_kg_m2{};    // about the centre of gravity, wheels' spin excluded
    Real cog_ahead_m{};          // centre of gravity ahead of the axle
    Real wheel_inertia_kg_m2{};  // one wheel with its gearbox and rotor, about its axis
};

template <typename Real>
Dynamics<Real> dynamics_from_mass(const MassProperties<Real>& body, const Geometry<Real>& geometry) {
    const Real r = geometry.mean_radius_m();
    const Real b = geometry.track_m;
    const Real moment = body.cog_ahead_m * body.mass_kg;
    const Real m_eff = body.mass_kg + 2 * body.wheel_inertia_kg_m2 / (r * r);
    const Real i_eff =
        body.yaw_inertia_kg_m2 + moment * body.cog_ahead_m + body.wheel_inertia_kg_m2 * b * b / (2 * r * r);
    return {moment / m_eff, -moment / i_eff, 1 / (m_eff * r), b / (2 * r * i_eff)};
}

// The K6 that energy conservation demands beside the other three: power is
// v omega^2 (m_eff K5 + I_eff K6) = 0, hence K6 = -K5 * 2 K8 / (b K7).
template <typename Real>
Real coupled_k6(Real k5_m, Real k7_per_kg_m, Real k8_per_kg_m2, Real track_m) {
    return -k5_m * 2 * k8_per_kg_m2 / (track_m * k7_per_kg_m);
}

// The rotation's share in the inertia that K8 stands for, from that in the mass; 0..1 both. A wheel that
// turns with the robot moves at half of the track: I_w b^2 / (2 r^2) of dynamics_from_mass().
template <typename Real>
constexpr Real rotation_share_turning(const Dynamics<Real>& k, Real track_m,
                                      Real rotation_share = Real(kRotationShare)) {
    return rotation_share * track_m * k.k8_per_kg_m2 / (2 * k.k7_per_kg_m);
}

// Accelerations from the torque that accelerates, eq (42), (43).
template <typename Real>
constexpr TwistRate<Real> acceleration(const Dynamics<Real>& k, const Twist<Real>& u,
                                       const WheelPair<Real>& torque_Nm) {
    return {k.k5_m * u.omega_rad_per_s * u.omega_rad_per_s + k.k7_per_kg_m * torque_Nm.sum(),
            k.k6_per_m * u.v_m_per_s * u.omega_rad_per_s + k.k8_per_kg_m2 * torque_Nm.difference()};
}

// The torque that gives wanted accelerations: the inverse of acceleration(). K7 and K8 must not be zero.
template <typename Real>
constexpr WheelPair<Real> inverse_dynamics(const Dynamics<Real>& k, const Twist<Real>& u,
                                           const TwistRate<Real>& wanted) {
    const Real sum = (wanted.v_m_per_s2 - k.k5_m * u.omega_rad_per_s * u.omega_rad_per_s) / k.k7_per_kg_m;
    const Real difference =
        (wanted.omega_rad_per_s2 - k.k6_per_m * u.v_m_per_s * u.omega_rad_per_s) / k.k8_per_kg_m2;
    return {(sum - difference) / 2, (sum + difference) / 2};
}

template <typename Real>
constexpr Twist<Real> twist_from_wheel_speeds(const Geometry<Real>& g,
                                              const WheelPair<Real>& speed_rad_per_s) {
    const Real left = g.wheel_radius_m.left * speed_rad_per_s.left;
    const Real right = g.wheel_radius_m.right * speed_rad_per_s.right;
    return {(right + left) / 2, (right - left) / g.track_m};
}

template <typename Real>
constexpr WheelPair<Real> wheel_speeds_from_twist(const Geometry<Real>& g, const Twist<Real>& u) {
    const Real half_turn = u.omega_rad_per_s * g.track_m / 2;
    return {(u.v_m_per_s - half_turn) / g.wheel_radius_m.left,
            (u.v_m_per_s + half_turn) / g.wheel_radius_m.right};
}

// Moves a pose along the arc of constant curvature that covers `distance_m` while turning by `turn_rad`,
// eq (37). Exact for constant v and omega; the heading is not wrapped.
template <typename Real>
Pose<Real> advance_along_arc(const Pose<Real>& from, Real distance_m, Real turn_rad) {
    const Real half = turn_rad / 2;
    // chord / arc = sin(half) / half, by its series where the quotient would lose digits
    const Real shrink =
        std::abs(half) < Real(1e-2) ? 1 - half * half / 6 * (1 - half * half / 20) : std::sin(half) / half;
    const Real middle = from.heading_rad + half;
    return {from.x_m + distance_m * shrink * std::cos(middle),
            from.y_m + distance_m * shrink * std::sin(middle), from.heading_rad + turn_rad};
}

}  // namespace wheelwright::model
