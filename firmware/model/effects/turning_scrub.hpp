#pragma once

#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// Dry friction of the contact patches against turning: N = -n sign(omega), |N| <= n while the heading holds.
struct TurningScrub {
    static constexpr std::array<EffectParameterInfo, 1> parameters{{
        {"scrub_Nm", "Nm", 0.0, 1000.0, "dry friction torque on the body against turning"},
    }};
    static constexpr EffectInfo info{
        "turning_scrub", "tyres that scrub over the floor while the robot turns",
        "Coulomb (1785), about the yaw axis, as a set-valued law with sticking", parameters,
        "its torque is added to the command, by the sign of the wanted yaw rate"};

    template <typename Real>
    static constexpr BodyForce<Real> dry_direction(unsigned) {
        return {0, 1};
    }
};

}  // namespace wheelwright::model
