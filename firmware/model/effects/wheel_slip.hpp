#pragma once

#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// Tyres that creep over the floor as they push: slip = slip_speed * force / (mu load), the rim's speed less
// the floor's, and never more force than mu load. The load of each wheel is half the robot's weight, with the
// mass 1 / (K7 r) and no share for a castor.
struct WheelSlip {
    static constexpr double kGravity_m_per_s2 = 9.80665;
    static constexpr std::array<EffectParameterInfo, 2> parameters{{
        {"friction_coefficient", "", 0.0, 5.0, "largest force of a tyre over its load"},
        {"slip_speed_m_per_s", "m/s", 0.0, 10.0, "slip at which a tyre reaches its largest force"},
    }};
    static constexpr EffectInfo info{
        "wheel_slip",
        "tyres that slip along their rolling direction",
        "linear slip up to Coulomb's limit, the small-slip part of Pacejka's tyre",
        parameters,
        "",
        "speed over the floor is not measured; an external pose corrects where it leads"};

    template <typename Real>
    static constexpr Real load_N(const Geometry<Real>& geometry, const Dynamics<Real>& dynamics) {
        return Real(kGravity_m_per_s2) / (2 * dynamics.k7_per_kg_m * geometry.mean_radius_m());
    }
    // Slip of a tyre that pushes with this force, |force| <= mu load.
    template <typename Real>
    static constexpr Real slip_m_per_s(const Parameters<Real>& p, Real load_N, Real force_N) {
        return p[1] * force_N / (p[0] * load_N);
    }
    // Force of a tyre that slips so.
    template <typename Real>
    static constexpr Real force_N(const Parameters<Real>& p, Real load_N, Real slip_m_per_s) {
        const Real most = p[0] * load_N;
        if (slip_m_per_s >= p[1]) return most;
        return slip_m_per_s <= -p[1] ? -most : most * slip_m_per_s / p[1];
    }
};

}  // namespace wheelwright::model
