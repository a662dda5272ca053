// Whether the encoders can be believed: a wheel whose angle does not change by a single digit although the
// torque says that it must have turned has an encoder that is frozen. (A wheel that stands still against
// something turns back and forth by counts as its torque changes; what does not even do that for long is
// called implausible as well, and stopped.)
//
// Per wheel, from its last change of angle on, the angle it must have gone unseen is integrated: from the
// speed it had, and from the acceleration by the torque beyond what can be held without moving: friction, and
// a slope's share, which is what accelerated the wheel while it turned, or what held it when it crept to a
// stop. Nobody holds nearly the whole torque limit. Too much unseen is one and a half steps of the coarsest
// encoder. Where no model is known yet, it is time; and where one wheel alone is pushed, to find out whether
// it turns at all, it is the other one's turning so far: a wheel that is held fast moves no robot.
//
// One thread; no allocation. update(): about 40 instructions while the wheels turn.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "firmware/control/velocity_loop_speed.hpp"
#include "firmware/control/wheel_observer.hpp"
#include "firmware/model/dynamics.hpp"
#include "firmware/model/types.hpp"

namespace wheelwright::control {

inline constexpr double kNearlyAllTorque = 0.75;  // of the torque limit

struct EncoderWatchSettings {
    double torque_limit_Nm{};
    double held_Nm{};  // friction may hold it without motion
    double creeping_rad_per_s{};
};

inline EncoderWatchSettings encoder_watch_settings(const model::RobotParameters& from) {
    constexpr double kUnknownFriction = 0.25;  // of the torque limit, each way
    constexpr double kFrictionMayBeWrong = 1.25;
    constexpr double kBeside = 0.1;  // of the torque limit
    const double limit_Nm = from.limits.torque_Nm;
    const double dry_Nm = limit_Nm - accelerating_Nm(from);
    const double friction_Nm = dry_Nm > 0 ? kFrictionMayBeWrong * dry_Nm : kUnknownFriction * limit_Nm;
    return {limit_Nm, std::min(2 * friction_Nm + kBeside * limit_Nm, kNearlyAllTorque * limit_Nm),
            from.safety.clear_speed_m_per_s / from.geometry.mean_radius_m()};
}

class EncoderWatch {
  public:
    void configure(const EncoderWatchSettings& settings) { settings_ = settings; }

    // Nothing drives: forgets, the wheels may be anywhere.
    void rest(const WheelPair<double>& angle_rad) {
        wheels_ = {};
        wheels_[0].angle_rad = angle_rad.left;
        wheels_[1].angle_rad = angle_rad.right;
    }

    // A cycle in which torques were sent. `angle_rad` as the drives told them last, `told_ns` when; `speed`
    // as the observer has it. True: an encoder is not to be believed.
    template <typename Real>
    bool update(double elapsed_s, const WheelPair<double>& angle_rad,
                const std::array<std::int64_t, 2>& told_ns, const WheelPair<Real>& speed_rad_per_s,
                const WheelPair<double>& torque_Nm, const model::Geometry<Real>& geometry,
                const WheelPair<Real>& unexplained_rad_per_s2, const model::Dynamics<Real>* dynamics) {
        const bool left = still(wheels_[0], angle_rad.left, told_ns[0], speed_rad_per_s.left,
                                unexplained_rad_per_s2.left, torque_Nm.left);
        const bool right = still(wheels_[1], angle_rad.right, told_ns[1], speed_rad_per_s.right,
                                 unexplained_rad_per_s2.right, torque_Nm.right);
        if (!left && !right) return false;
        const double half_track_m = geometry.track_m / 2;
        const auto hidden = [&](Wheel& wheel, double torque, double radius_m) {
            if (dynamics == nullptr) {
                const double beyond_Nm = beyond_held_Nm(wheel, torque, 0);
                wheel.pushed_cycles = beyond_Nm != 0 ? wheel.pushed_cycles + 1 : 0;
                return wheel.pushed_cycles >= kPushedCycles;
            }
            const double forward = dynamics->k7_per_kg_m / radius_m;
            const double turning = dynamics->k8_per_kg_m2 * half_track_m / radius_m;
            if (wheel.frames == 0) {  // the first cycle: how fast was it, at least, before it stood?
                const double brakes = kBrakesShare * 2 * std::max(forward, turning) *
                                      settings_.torque_limit_Nm * elapsed_s *
                                      (kHistoryCycles + wheel.history_age);
                wheel.speed = std::max(std::abs(wheel.speed_before) - brakes, 0.0);
                if (wheel.speed_before < 0) wheel.speed = -wheel.speed;
            }
            const double beyond_Nm = beyond_held_Nm(wheel, torque, -wheel.unexplained_before / (2 * forward));
            if (beyond_Nm != 0) {
                wheel.speed += beyond_Nm * (forward + turning) * elapsed_s;
            } else if (wheel.speed * torque < 0) {
                wheel.speed = 0;
            }
            wheel.unseen_rad += wheel.speed * elapsed_s;
            return wheel.frames >= kFrames && !(std::abs(wheel.unseen_rad) <= kUnseen_rad);
        };
        const bool left_lies = left && hidden(wheels_[0], torque_Nm.left, geometry.wheel_radius_m.left);
        const bool right_lies = right && hidden(wheels_[1], torque_Nm.right, geometry.wheel_radius_m.right);
        return left_lies || right_lies;
    }

    // The same where one wheel is pushed alone.
    bool update_alone(const WheelPair<double>& angle_rad, const WheelPair<double>& torque_Nm) {
        const bool left = torque_Nm.left != 0 && torque_Nm.right == 0;
        const bool right = torque_Nm.right != 0 && torque_Nm.left == 0;
        Wheel& pushed = wheels_[right ? 1 : 0];
        if ((!left && !right) || (right ? angle_rad.right : angle_rad.left) != pushed.angle_rad) {
            rest(angle_rad);
            return false;
        }
        return !(std::abs((right ? angle_rad.left : angle_rad.right) - wheels_[right ? 0 : 1].angle_rad) <=
                 kUnseen_rad);
    }

  private:
    static constexpr double kUnseen_rad = 1.5 * kCoarsestStep_rad;
    static constexpr double kBrakesShare = 1.5;  // of what the torque brakes by, with friction
    static constexpr int kHistoryCycles = 16;
    static constexpr int kPushedCycles = 80;
    static constexpr int kFrames = 4;

    struct Wheel {
        double angle_rad = 0;  // and the torque at its last change
        double torque_Nm = 0;
        double speed = 0;  // unseen, since then
        double unseen_rad = 0;
        std::int64_t told_ns = 0;
        int frames = -1;  // since then, with the same angle
        int pushed_cycles = 0;
        double speed_before = 0, speed_lately = 0;  // 16 to 32 cycles ago, and up to 16
        double unexplained_before = 0, unexplained_lately = 0;
        int history_age = 0;
    };

    // Whether the angle is the same as before.
    static bool still(Wheel& wheel, double angle_rad, std::int64_t told_ns, double speed_rad_per_s,
                      double unexplained_rad_per_s2, double torque_Nm) {
        if (angle_rad == wheel.angle_rad) {
            wheel.frames += told_ns != wheel.told_ns;
            wheel.told_ns = told_ns;
            return wheel.frames >= 0;
        }
        wheel.angle_rad = angle_rad;
        wheel.torque_Nm = torque_Nm;
        if (wheel.frames >= 0) {
            wheel.frames = -1;
            wheel.speed = wheel.unseen_rad = 0;
            wheel.pushed_cycles = 0;
        }
        if (++wheel.history_age >= kHistoryCycles) {
            wheel.speed_before = wheel.speed_lately;
            wheel.speed_lately = speed_rad_per_s;
            wheel.unexplained_before = wheel.unexplained_lately;
            wheel.unexplained_lately = unexplained_rad_per_s2;
            wheel.history_age = 0;
        }
        return false;
    }

    // What of a torque must turn the wheel.
    double beyond_held_Nm(const Wheel& wheel, double torque_Nm, double slope_Nm) const {
        double least = 0, most = 0;
        if (std::abs(torque_Nm) < kNearlyAllTorque * settings_.torque_limit_Nm) {
            const bool crept = std::max(std::abs(wheel.speed_before), std::abs(wheel.speed_lately)) <=
                               settings_.creeping_rad_per_s;
            const double held_Nm = crept ? wheel.torque_Nm : 0;
            least = std::min({0.0, slope_Nm, held_Nm});
            most = std::max({0.0, slope_Nm, held_Nm});
        }
        return torque_Nm - std::clamp(torque_Nm, least - settings_.held_Nm, most + settings_.held_Nm);
    }

    EncoderWatchSettings settings_;
    std::array<Wheel, 2> wheels_;
};

}  // namespace wheelwright::control
