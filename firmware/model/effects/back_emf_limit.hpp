#pragma once

#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// A motor that runs out of voltage as it turns faster: with s = speed / no_load,
//   min(0, -stall (1 + s)) <= tau <= max(0, stall (1 - s)).
// Driving, it gives less the faster it turns; braking, the voltage helps.
struct BackEmfLimit {
    static constexpr std::array<EffectParameterInfo, 2> parameters{{
        {"stall_Nm", "Nm", 0.0, 1000.0, "largest torque of a wheel that does not turn"},
        {"no_load_rad_per_s", "rad/s", 0.0, 10000.0, "wheel speed at which no torque is left; 0: no limit"},
    }};
    static constexpr EffectInfo info{
        "back_emf_limit",
        "torque that a motor's own voltage takes away at speed",
        "torque-speed line of the direct-current motor",
        parameters,
        "",
        "a limit has no inverse; limits.speed_m_per_s and limits.torque_Nm keep commands below it"};

    static constexpr int path_place = 70;
    template <typename Real>
    struct Memory {};
    template <typename Real>
    static constexpr Real deliver(const Parameters<Real>& p, Memory<Real>&, const PathInstant<Real>& at) {
        if (!(p[1] > 0)) return at.torque_Nm;
        const Real share = at.speed_rad_per_s / p[1];
        const Real most = share < 1 ? p[0] * (1 - share) : Real(0);
        const Real least = share > -1 ? -p[0] * (1 + share) : Real(0);
        if (at.torque_Nm > most) return most;
        return at.torque_Nm < least ? least : at.torque_Nm;
    }
};

}  // namespace wheelwright::model
