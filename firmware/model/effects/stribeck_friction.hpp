#pragma once

#include <array>

#include "firmware/model/effect.hpp"
#include "firmware/model/exponential.hpp"

namespace wheelwright::model {

// Dry friction that is largest at rest: tau = -limit sign(speed), |tau| <= limit at rest, on both wheels
// alike, with limit = coulomb + (static - coulomb) exp(-(speed / stribeck)^2).
struct StribeckFriction {
    static constexpr std::array<EffectParameterInfo, 3> parameters{{
        {"coulomb_Nm", "Nm", 0.0, 100.0, "dry friction torque of each wheel at speed"},
        {"static_Nm", "Nm", 0.0, 100.0, "dry friction torque of each wheel at rest"},
        {"stribeck_rad_per_s", "rad/s", 0.0, 1000.0, "wheel speed over which it falls from one to the other"},
    }};
    static constexpr EffectInfo info{
        "stribeck_friction", "dry friction that is larger at rest and creeping than at speed",
        "Stribeck (1902); exponential form of Bo, Pavelescu (1982)", parameters,
        "its torque at this speed is added to the command, by the sign of the wanted speed"};

    // What friction opposes sliding at this speed with, at most; of the first or the second wheel.
    template <typename Real>
    static constexpr Real dry_limit(const Parameters<Real>& p, Real sliding_speed_rad_per_s) {
        return limit_of_share(p, share_of_static(p, sliding_speed_rad_per_s));
    }
    // The same in Nm, where `share` (share_of_static(), 0 to 1) is known.
    template <typename Real>
    static constexpr Real limit_of_share(const Parameters<Real>& p, Real share) {
        return p[0] + (p[1] - p[0]) * share;
    }
    // How much of what friction has at rest beyond that at speed is there at this speed: 0 to 1.
    template <typename Real>
    static constexpr Real share_of_static(const Parameters<Real>& p, Real sliding_speed_rad_per_s) {
        if (!(p[2] > 0)) return 0;
        const Real ratio = sliding_speed_rad_per_s / p[2];
        return exp_minus(ratio * ratio);
    }
};

}  // namespace wheelwright::model
