#pragma once

#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// A drive that gives no more than its limit: |tau| <= limit.
struct TorqueSaturation {
    static constexpr std::array<EffectParameterInfo, 1> parameters{{
        {"limit_Nm", "Nm", 0.0, 1000.0, "largest torque that a drive gives its wheel"},
    }};
    static constexpr EffectInfo info{
        "torque_saturation",
        "drives that give less torque than they are asked for",
        "saturation nonlinearity",
        parameters,
        "",
        "a limit has no inverse; limits.torque_Nm set to it keeps commands and integrators within it"};

    static constexpr int path_place = 60;
    template <typename Real>
    struct Memory {};
    template <typename Real>
    static constexpr Real deliver(const Parameters<Real>& p, Memory<Real>&, const PathInstant<Real>& at) {
        if (at.torque_Nm > p[0]) return p[0];
        return at.torque_Nm < -p[0] ? -p[0] : at.torque_Nm;
    }
};

}  // namespace wheelwright::model
