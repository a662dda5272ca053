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
    static constexpr EffectInfo info{
        "torque_bias", "offset of a drive's current measurement: torque that nobody asked for",
        "constant term of the standard robot model, Gautier, Khalil (1990)", parameters};

    template <typename Real>
    static constexpr WheelPair<Real> each_wheel(const EffectContext<Real>&) {
        return {1, 1};
    }
};

}  // namespace wheelwright::model
