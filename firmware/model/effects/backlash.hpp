#pragma once

#include <array>
#include <cmath>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// A gap in the gear: the motor, with `motor_inertia` seen at the wheel, turns freely by `half_gap` to either
// side of the wheel, on which the encoder sits. In the gap the motor accelerates under the whole torque and
// nothing arrives. In contact it turns with the wheel: what arrives is the torque less what accelerates the
// motor, and it can only push. On contact the motor's momentum passes at once, without rebound.
//
// So what arrives moves the robot *without* its motors: rest() gives that robot's K5..K8. The same motion, as
// of the robot *with* its motors, is that of as_whole(): in contact the torque; in the gap nothing; on
// contact at once what the torque has done in the gap. What the motors' share of drag does meanwhile is left
// out of it. It knows of the wheel's acceleration only when contact is lost, so a measured wheel's noise is
// not in it.
struct Backlash {
    static constexpr std::array<EffectParameterInfo, 2> parameters{{
        {"half_gap_rad", "rad", 0.0, 1.0, "angle of the wheel by which the motor is free to either side"},
        {"motor_inertia_kg_m2", "kg m^2", 0.0, 10.0, "inertia on the motor's side, as seen at the wheel"},
    }};
    static constexpr EffectInfo info{
        "backlash",
        "play in the gear between motor and wheel",
        "dead-zone model with impact, Nordin, Gutman (2002), for stiff teeth",
        parameters,
        "",
        "no torque acts through the gap, and hurrying across it would only strike the teeth harder"};

    static constexpr int path_place = 100;
    template <typename Real>
    struct Memory {
        Real ahead_rad{};        // motor against wheel at the end of the last step, in -half_gap..half_gap
        Real speed_rad_per_s{};  // of the motor
        Real wheel_angle_rad{};  // where the wheel was expected at the end of the last step
        int side = 0;            // of contact: 1 the motor drives the wheel forward, -1 back, 0 free
        bool begun = false;
        Real gathered_Nm_s{};  // by the motor since it lost contact
    };

    template <typename Real>
    static constexpr Real deliver(const Parameters<Real>& p, Memory<Real>& m, const PathInstant<Real>& at) {
        return over_step(p, m, at).arrives / at.step_s;
    }

    // The mean torque over the step that moves the robot with its motors in the same way.
    template <typename Real>
    static constexpr Real as_whole(const Parameters<Real>& p, Memory<Real>& m, const PathInstant<Real>& at) {
        return over_step(p, m, at).as_whole / at.step_s;
    }

    // The robot without its motors.
    template <typename Real>
    static constexpr Dynamics<Real> rest(const Parameters<Real>& p, const Geometry<Real>& g,
                                         const Dynamics<Real>& k) {
        const Real r = g.mean_radius_m();
        const Real mass = 1 / (k.k7_per_kg_m * r);
        const Real inertia = g.track_m / (2 * r * k.k8_per_kg_m2);
        const Real rest_mass = mass - 2 * p[1] / (r * r);
        const Real rest_inertia = inertia - p[1] * g.track_m * g.track_m / (2 * r * r);
        return {k.k5_m * mass / rest_mass, k.k6_per_m * inertia / rest_inertia, 1 / (rest_mass * r),
                g.track_m / (2 * r * rest_inertia)};
    }

  private:
    template <typename Real>
    struct Impulse {
        Real arrives{};   // at the robot without its motors
        Real as_whole{};  // at the robot with them
    };

    // The wheel is taken to keep its speed over the step; what it did otherwise is made up for in the next.
    template <typename Real>
    static constexpr Impulse<Real> over_step(const Parameters<Real>& p, Memory<Real>& m,
                                             const PathInstant<Real>& at) {
        const Real gap = p[0];
        const Real inertia = p[1] > Real(1e-9) ? p[1] : Real(1e-9);
        const Real wheel = at.speed_rad_per_s;
        if (!m.begun) {
            m.begun = true;
            m.speed_rad_per_s = wheel;
            m.wheel_angle_rad = at.angle_rad;
        }
        Real rest_s = at.step_s;
        Impulse<Real> impulse;
        if (m.side == 0) {
            m.ahead_rad += m.wheel_angle_rad - at.angle_rad;
            if (m.ahead_rad >= gap || m.ahead_rad <= -gap) {  // the wheel met it
                m.side = m.ahead_rad > 0 ? 1 : -1;
                touch(m, gap, inertia, wheel, impulse);
            }
        }
        // In contact to the step's end, in the gap to its end, or the gap's end first: three of these at
        // most.
        for (int part = 0; part < 4 && rest_s > 0; ++part) {
            if (m.side != 0) {
                const Real arrives = at.torque_Nm * rest_s - inertia * (wheel - m.speed_rad_per_s);
                if (arrives * static_cast<Real>(m.side) >= 0) {
                    impulse.arrives += arrives;
                    impulse.as_whole += at.torque_Nm * rest_s;
                    m.speed_rad_per_s = wheel;
                    rest_s = 0;
                    break;
                }
                touch(m, gap, inertia, wheel, impulse);
                m.side = 0;  // teeth do not pull
            }
            const Real acceleration = at.torque_Nm / inertia;
            const Real relative = m.speed_rad_per_s - wheel;
            Real meets_s = rest_s;
            int side = 0;
            for (const int end : {1, -1}) {
                const Real when =
                    first_after(acceleration, relative, m.ahead_rad - static_cast<Real>(end) * gap);
                if (when > 0 && when < meets_s) {
                    meets_s = when;
                    side = end;
                }
            }
            m.ahead_rad += meets_s * (relative + acceleration * meets_s / 2);
            m.speed_rad_per_s += acceleration * meets_s;
            m.gathered_Nm_s += at.torque_Nm * meets_s;
            rest_s -= meets_s;
            if (side == 0) break;
            m.side = side;
            touch(m, gap, inertia, wheel, impulse);
        }
        m.wheel_angle_rad = at.angle_rad + wheel * at.step_s;
        return impulse;
    }

    // The motor takes the wheel's speed at once. Away from the wheel it may go as it goes.
    template <typename Real>
    static constexpr void touch(Memory<Real>& m, Real gap, Real inertia, Real wheel, Impulse<Real>& impulse) {
        const auto side = static_cast<Real>(m.side);
        m.ahead_rad = side * gap;
        impulse.as_whole += m.gathered_Nm_s;
        m.gathered_Nm_s = 0;
        if (side * (m.speed_rad_per_s - wheel) <= 0) return;
        impulse.arrives += inertia * (m.speed_rad_per_s - wheel);
        m.speed_rad_per_s = wheel;
    }

    // The smallest t > 0 with a t^2 / 2 + b t + c = 0; 0 when there is none.
    template <typename Real>
    static Real first_after(Real a, Real b, Real c) {
        const Real square = b * b - 2 * a * c;
        if (square < 0) return 0;
        const Real q = -(b + (b < 0 ? -std::sqrt(square) : std::sqrt(square)));
        const Real one = a != 0 ? q / a : Real(0);
        const Real other = q != 0 ? 2 * c / q : Real(0);
        if (one > 0 && other > 0) return one < other ? one : other;
        return one > other ? one : other;
    }
};

}  // namespace wheelwright::model
