#pragma once

#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// A castor: its fork turns about a pivot `arm` ahead of the axle, its wheel touches the floor `trail` behind
// the pivot and does not slip sideways. With the swivel angle d of the fork against straight ahead and the
// pivot's velocity (v, arm omega):
//   d' = (-v sin d + arm omega cos d) / trail - omega
//   along = v cos d + arm omega sin d             the wheel's rolling speed
// Both are sliding speeds of dry friction: `rolling` against `along`, `swivel` against d'. The one pushes
// along the fork; the other turns the body and, by the trail, pushes it across the fork.
struct CastorDrag {
    static constexpr std::array<EffectParameterInfo, 4> parameters{{
        {"rolling_N", "N", 0.0, 1000.0, "force that the castor's wheel resists rolling with"},
        {"swivel_Nm", "Nm", 0.0, 100.0, "dry friction torque of the fork's pivot"},
        {"arm_m", "m", -5.0, 5.0, "pivot ahead of the axle"},
        {"trail_m", "m", 0.0, 1.0, "wheel behind the pivot; below 1 mm counts as 1 mm"},
    }};
    static constexpr EffectInfo info{
        "castor_drag",
        "a castor that rolls and swivels with friction",
        "rolling without side slip, Campion, Bastin, D'Andrea-Novel (1996), with Coulomb friction in wheel "
        "and pivot",
        parameters,
        "",
        "its swivel angle is not measured; the integrators take up its slow part"};

    // Where the fork points, as sine and cosine of its angle; as it begins, the castor trails as in driving
    // straight ahead.
    template <typename Real>
    struct Memory {
        Real sine{0};
        Real cosine{1};
    };

    // Force on the body of one unit of friction j (0 rolling, 1 swivel) against positive sliding, reversed:
    // the sliding speed is force_N * v + yaw_torque_Nm * omega of what this returns.
    template <typename Real>
    static constexpr BodyForce<Real> direction(unsigned j, const Parameters<Real>& p,
                                               const Memory<Real>& memory) {
        if (j == 0) return {memory.cosine, p[2] * memory.sine};
        const Real trail = trail_m(p);
        return {-memory.sine / trail, p[2] * memory.cosine / trail - 1};
    }

    template <typename Real>
    static constexpr Real sliding(const BodyForce<Real>& direction, const Twist<Real>& u) {
        return direction.force_N * u.v_m_per_s + direction.yaw_torque_Nm * u.omega_rad_per_s;
    }

    // The fork turns while the robot moves so. Midpoint steps of at most 0.1 rad.
    template <typename Real>
    static constexpr void advance(const Parameters<Real>& p, Memory<Real>& memory, const Twist<Real>& u,
                                  Real step_s) {
        const auto size = [](Real x) { return x < 0 ? -x : x; };
        const auto rate = [&](const Memory<Real>& fork) { return sliding(direction(1, p, fork), u); };
        const Real most =
            (size(u.v_m_per_s) + size(p[2] * u.omega_rad_per_s)) / trail_m(p) + size(u.omega_rad_per_s);
        const int steps = 1 + static_cast<int>(most * step_s * 10);
        const Real h = step_s / static_cast<Real>(steps);
        for (int i = 0; i < steps; ++i) {
            const Memory<Real> middle = turned(memory, h / 2 * rate(memory));
            memory = turned(memory, h * rate(middle));
        }
    }

    // What the castor does to the body over the step that begins now, without sticking. Advances the memory.
    template <typename Real>
    static constexpr BodyForce<Real> push(const Parameters<Real>& p, Memory<Real>& memory,
                                          const EffectContext<Real>& at, Real step_s) {
        BodyForce<Real> total{};
        for (unsigned j = 0; j < 2; ++j) {
            const BodyForce<Real> d = direction(j, p, memory);
            const Real speed = sliding(d, at.motion.twist);
            const Real friction = speed > 0 ? -p[j] : speed < 0 ? p[j] : Real(0);
            total.force_N += friction * d.force_N;
            total.yaw_torque_Nm += friction * d.yaw_torque_Nm;
        }
        advance(p, memory, at.motion.twist, step_s);
        return total;
    }

  private:
    // By Cayley's rational rotation, which keeps the length; within 1e-7 rad for angles to 0.1.
    template <typename Real>
    static constexpr Memory<Real> turned(const Memory<Real>& fork, Real angle_rad) {
        const Real half = angle_rad / 2;
        const Real tangent = half + half * half * half / 3;
        const Real scale = 1 / (1 + tangent * tangent);
        const Real s = 2 * tangent * scale;
        const Real c = (1 - tangent * tangent) * scale;
        // one step of Newton's for the length, which rounding would let drift
        const Real length = (3 - fork.sine * fork.sine - fork.cosine * fork.cosine) / 2;
        return {length * (fork.sine * c + fork.cosine * s), length * (fork.cosine * c - fork.sine * s)};
    }

    template <typename Real>
    static constexpr Real trail_m(const Parameters<Real>& p) {
        return p[3] > Real(0.001) ? p[3] : Real(0.001);
    }
};

}  // namespace wheelwright::model
