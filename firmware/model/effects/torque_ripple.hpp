#pragma once

#include <array>

#include "firmware/model/effect.hpp"
#include "firmware/model/sine_cosine.hpp"

namespace wheelwright::model {

// Torque that a motor's poles and slots, or a gear, add with the wheel's angle:
//   tau = u + amplitude sin(order angle + phase), on the right wheel with phase + phase_difference.
struct TorqueRipple {
    static constexpr std::array<EffectParameterInfo, 4> parameters{{
        {"amplitude_Nm", "Nm", 0.0, 100.0, "largest torque of the ripple"},
        {"order", "", 0.0, 10000.0, "periods in a turn of the wheel"},
        {"phase_rad", "rad", -3.15, 3.15, "phase at the left wheel's angle 0"},
        {"phase_difference_rad", "rad", -3.15, 3.15, "phase at the right wheel's angle 0 less the left's"},
    }};
    static constexpr EffectInfo info{"torque_ripple", "torque that swings with the wheel's angle",
                                     "cogging torque as one harmonic, Hanselman (1994)", parameters,
                                     "subtracted from the command, by the wheel's angle"};

    template <typename Real>
    static constexpr WheelPair<Real> torque(const Parameters<Real>& p, const EffectContext<Real>& at) {
        const auto& angle = at.motion.wheel_angle_rad;
        return {ripple(p, angle.left, false), ripple(p, angle.right, true)};
    }

    static constexpr int path_place = 90;
    template <typename Real>
    struct Memory {};
    template <typename Real>
    static constexpr Real deliver(const Parameters<Real>& p, Memory<Real>&, const PathInstant<Real>& at) {
        return at.torque_Nm + ripple(p, at.angle_rad, at.right);
    }

  private:
    template <typename Real>
    static constexpr Real ripple(const Parameters<Real>& p, Real angle_rad, bool right) {
        return p[0] * sine_cosine(p[1] * angle_rad + p[2] + (right ? p[3] : Real(0))).sine;
    }
};

}  // namespace wheelwright::model
