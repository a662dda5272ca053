#pragma once

#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// Friction torque proportional to wheel speed: tau = -c * speed, on each wheel by itself.
struct ViscousFriction {
    static constexpr std::array<EffectParameterInfo, 2> parameters{{
        {"left_Nm_s_per_rad", "Nm s/rad", 0.0, 1000.0, "drag torque on the left wheel per wheel speed"},
        {"right_Nm_s_per_rad", "Nm s/rad", 0.0, 1000.0, "drag torque on the right wheel per wheel speed"},
    }};
    static constexpr EffectInfo info{
        "viscous_friction", "friction in bearings, gearbox grease and tyres that grows with wheel speed",
        "linear term of the Stribeck model, Armstrong-Helouvry, Dupont, Canudas de Wit (1994)", parameters,
        "its torque is added to the command"};

    template <typename Real>
    static constexpr WheelPair<Real> each_wheel(const EffectContext<Real>& at) {
        return {-at.motion.wheel_speed_rad_per_s.left, -at.motion.wheel_speed_rad_per_s.right};
    }
};

}  // namespace wheelwright::model
