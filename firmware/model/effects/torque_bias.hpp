#pragma once

#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// A constant torque that a drive adds by itself: tau = +b on each wheel.
struct TorqueBias {
    static constexpr std::array<EffectParameterInfo, 2> parameters{{
        {"left_Nm", "Nm", -100.0, 100.0, "torque added to the left wheel"},
        {"right_Nm", "Nm", -100.0, 100.0, "torque added to the right wheel"},
    }};
    static constexpr EffectInfo info{"torque_bias",
                                     "offset of a drive's current measurement: torque that nobody asked for",
                                     "constant term of the standard robot model, Gautier, Khalil (1990)",
                                     parameters, "subtracted from the command"};

    template <typename Real>
    static constexpr WheelPair<Real> each_wheel(const EffectContext<Real>&) {
        return {1, 1};
    }

    // Where a limit follows, the bias counts towards it.
    static constexpr int path_place = 50;
    template <typename Real>
    struct Memory {};
    template <typename Real>
    static constexpr Real deliver(const Parameters<Real>& p, Memory<Real>&, const PathInstant<Real>& at) {
        return at.torque_Nm + p[at.right ? 1 : 0];
    }
};

}  // namespace wheelwright::model
