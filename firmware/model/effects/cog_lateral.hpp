#pragma once

#include <algorithm>
#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// The centre of gravity `offset` to the left of the middle line. It couples both accelerations:
//   m v' - m b omega' = F,   -m b v' + I omega' = N
// with m = 1 / (K7 r): K7 holds no other mass, so the offset seems smaller by the share that the wheels'
// rotation has in it. I is K8's, about the middle of the axle, b^2 included.
struct CogLateral {
    static constexpr std::array<EffectParameterInfo, 1> parameters{{
        {"offset_m", "m", -1.0, 1.0, "centre of gravity left of the middle line"},
    }};
    static constexpr EffectInfo info{
        "cog_lateral", "a centre of gravity beside the middle line",
        "Newton-Euler equations of a body about another point than its centre of "
        "gravity",
        parameters, "the push that both accelerations make on each other is added to the command"};

    // Forward motion turns the robot, and turning moves it on: both together give K7 / (1 - share) and
    // K8 / (1 - share) in a torque's own direction. The share is the same whichever K7 and K8 it is made
    // from; at most a half is believed.
    template <typename Real>
    static constexpr Real share(Real offset_m, Real track_m, const Dynamics<Real>& dynamics) {
        const Real mass_over_inertia = 2 * dynamics.k8_per_kg_m2 / (dynamics.k7_per_kg_m * track_m);
        return std::min(mass_over_inertia * offset_m * offset_m, Real(0.5));
    }

    // Mass times offset: the push is F = this * omega', N = this * v'.
    template <typename Real>
    static constexpr Real coupling_kg_m(const Parameters<Real>& p, const Geometry<Real>& geometry,
                                        const Dynamics<Real>& dynamics) {
        return p[0] / (dynamics.k7_per_kg_m * geometry.mean_radius_m());
    }

    // What accelerates the robot less, or more, because of the offset, at this acceleration of the axle's
    // middle.
    template <typename Real>
    static constexpr BodyForce<Real> push(const Parameters<Real>& p, const Geometry<Real>& geometry,
                                          const Dynamics<Real>& dynamics,
                                          const TwistRate<Real>& acceleration) {
        const Real coupling = coupling_kg_m(p, geometry, dynamics);
        return {coupling * acceleration.omega_rad_per_s2, coupling * acceleration.v_m_per_s2};
    }

    // The accelerations that come, where K7 and K8 alone would give these. The offset must be smaller than
    // the robot's radius of gyration.
    template <typename Real>
    static constexpr TwistRate<Real> coupled(const Parameters<Real>& p, const Geometry<Real>& geometry,
                                             const Dynamics<Real>& dynamics, const TwistRate<Real>& alone) {
        const Real mass_over_inertia = 2 * dynamics.k8_per_kg_m2 / (dynamics.k7_per_kg_m * geometry.track_m);
        const Real back = mass_over_inertia * p[0];
        const Real scale = 1 / (1 - p[0] * back);
        return {(alone.v_m_per_s2 + p[0] * alone.omega_rad_per_s2) * scale,
                (alone.omega_rad_per_s2 + back * alone.v_m_per_s2) * scale};
    }
};

}  // namespace wheelwright::model
