#pragma once

#include <algorithm>
#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// Small torques that do not arrive, and the others smaller by as much: tau = sign(u) max(|u| - width, 0).
struct DeadZone {
    static constexpr std::array<EffectParameterInfo, 1> parameters{{
        {"width_Nm", "Nm", 0.0, 100.0, "torque of which nothing arrives"},
    }};
    static constexpr EffectInfo info{"dead_zone", "commands that are too small to do anything",
                                     "dead-zone nonlinearity, Tao, Kokotovic (1996)", parameters,
                                     "its width is added to the command"};

    // What it takes from the applied torque.
    template <typename Real>
    static constexpr WheelPair<Real> torque(const Parameters<Real>& p, const EffectContext<Real>& at) {
        const auto lost = [&](Real u) { return -std::clamp(u, -p[0], p[0]); };
        return {lost(at.applied_torque_Nm.left), lost(at.applied_torque_Nm.right)};
    }

    // Around zero the jump of twice the width is spread over this share of it, or noise would make it
    // chatter.
    static constexpr double kSoftShare = 0.2;
    template <typename Real>
    static constexpr WheelPair<Real> asked(const Parameters<Real>& p, const WheelPair<Real>& delivered_Nm) {
        if (!(p[0] > 0)) return delivered_Nm;
        const Real steep = 1 / (Real(kSoftShare) * p[0]);
        const auto one = [&](Real wanted) {
            return wanted + p[0] * std::clamp(wanted * steep, Real(-1), Real(1));
        };
        return {one(delivered_Nm.left), one(delivered_Nm.right)};
    }

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
