#pragma once

#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// Dry friction of constant size against the wheel's motion; holds the wheel still while the other torques are
// smaller: tau = -f sign(speed), |tau| <= f at rest.
struct CoulombFriction {
    static constexpr std::array<EffectParameterInfo, 2> parameters{{
        {"left_Nm", "Nm", 0.0, 100.0, "dry friction torque of the left wheel"},
        {"right_Nm", "Nm", 0.0, 100.0, "dry friction torque of the right wheel"},
    }};
    static constexpr EffectInfo info{"coulomb_friction",
                                     "dry friction in gearbox and bearings, independent of speed",
                                     "Coulomb (1785), as a set-valued law with sticking", parameters,
                                     "its torque is added to the command, by the sign of the wanted speed"};

    template <typename Real>
    static constexpr WheelPair<Real> dry_direction(unsigned j) {
        return j == 0 ? WheelPair<Real>{1, 0} : WheelPair<Real>{0, 1};
    }
};

}  // namespace wheelwright::model
