#pragma once

#include <array>
#include <cstddef>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// Drives whose torque constants differ: of the torque asked, the left wheel gets (1 - c) and the right one
// (1 + c), with (1 + c) / (1 - c) = 1 + relative. What both have in common is K7's and K8's.
struct TorqueGainMismatch {
    static constexpr std::array<EffectParameterInfo, 1> parameters{{
        {"relative", "", -0.6, 1.5, "torque delivered per torque asked, right over left, minus one"},
    }};
    static constexpr EffectInfo info{
        "torque_gain_mismatch", "one drive gives more torque than the other for the same demand",
        "definition; the mean gain is one", parameters, "each command is divided by its gain"};

    template <typename Real>
    static constexpr WheelPair<Real> column(unsigned, const EffectContext<Real>& at) {
        return {-at.applied_torque_Nm.left, at.applied_torque_Nm.right};
    }

    static constexpr std::size_t coordinate_count = 1;
    template <typename Real>
    static constexpr Parameters<Real> coordinates(const Parameters<Real>& p) {
        return {p[0] / (2 + p[0])};
    }
    template <typename Real>
    static constexpr Parameters<Real> from_coordinates(const Parameters<Real>& c) {
        return {2 * c[0] / (1 - c[0])};
    }

    template <typename Real>
    static constexpr WheelPair<Real> asked(const Parameters<Real>& p, const WheelPair<Real>& delivered_Nm) {
        const Real c = coordinates(p)[0];
        return {delivered_Nm.left / (1 - c), delivered_Nm.right / (1 + c)};
    }

    static constexpr int path_place = 30;
    template <typename Real>
    struct Memory {};
    template <typename Real>
    static constexpr Real deliver(const Parameters<Real>& p, Memory<Real>&, const PathInstant<Real>& at) {
        const Real c = coordinates(p)[0];
        return at.torque_Nm * (at.right ? 1 + c : 1 - c);
    }
};

}  // namespace wheelwright::model
