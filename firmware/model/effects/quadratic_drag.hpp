#pragma once

#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// Drag force against the body's forward motion, growing with its square: F = -c |v| v.
struct QuadraticDrag {
    static constexpr std::array<EffectParameterInfo, 1> parameters{{
        {"drag_N_s2_per_m2", "N s^2/m^2", 0.0, 1000.0, "drag force on the body per squared speed"},
    }};
    static constexpr EffectInfo info{
        "quadratic_drag", "drag on the body that grows with the square of its speed: air, or water",
        "drag equation, Rayleigh (1876)", parameters, "its force is added to the command"};

    template <typename Real>
    static constexpr BodyForce<Real> column(unsigned, const EffectContext<Real>& at) {
        const Real v = at.motion.twist.v_m_per_s;
        return {v < 0 ? v * v : -v * v, 0};
    }
};

}  // namespace wheelwright::model
