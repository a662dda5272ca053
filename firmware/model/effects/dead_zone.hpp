#pragma once

#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// Small torques that do not arrive, and the others smaller by as much: tau = sign(u) max(|u| - width, 0).
struct DeadZone {
    static constexpr std::array<EffectParameterInfo, 1> parameters{{
        {"width_Nm", "Nm", 0.0, 100.0, "torque of which nothing arrives"},
    }};
    static constexpr EffectInfo info{"dead_zone", "commands that are too small to do anything",
                                     "dead-zone nonlinearity, Tao, Kokotovic (1996)", parameters};

    static constexpr int path_place = 20;
    template <typename Real>
    struct Memory {};
    template <typename Real>
    static constexpr Real deliver(const Parameters<Real>& p, Memory<Real>&, const PathInstant<Real>& at) {
        if (at.torque_Nm > p[0]) return at.torque_Nm - p[0];
        return at.torque_Nm < -p[0] ? at.torque_Nm + p[0] : Real(0);
    }
};

}  // namespace wheelwright::model
