#pragma once

#include <array>

#include "firmware/model/effect.hpp"
#include "firmware/model/exponential.hpp"

namespace wheelwright::model {

// A drive whose torque follows its command as a first-order lag: T tau' = u - tau.
struct ActuatorLag {
    static constexpr std::array<EffectParameterInfo, 1> parameters{{
        {"time_constant_s", "s", 0.0, 1.0, "time constant from commanded to delivered torque"},
    }};
    static constexpr EffectInfo info{
        "actuator_lag",
        "torque that builds up late: current control, inductance",
        "first-order lag",
        parameters,
        "",
        "its inverse differentiates the command, noise included; the loops stay damped with it"};

    static constexpr int path_place = 80;
    template <typename Real>
    struct Memory {
        Real torque_Nm{};
    };
    // Exact for a command that is held over the step.
    template <typename Real>
    static constexpr Real deliver(const Parameters<Real>& p, Memory<Real>& memory,
                                  const PathInstant<Real>& at) {
        if (!(p[0] > 0)) return at.torque_Nm;
        const Real steps = at.step_s / p[0];
        const Real away = memory.torque_Nm - at.torque_Nm;
        memory.torque_Nm = at.torque_Nm + away * exp_minus(steps);
        return at.torque_Nm + away * mean_exp_minus(steps);
    }
};

}  // namespace wheelwright::model
