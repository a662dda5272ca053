#include "firmware/task/judge.hpp"

#include <algorithm>
#include <cmath>

namespace wheelwright::task {
namespace {

using drivers::ArmRefusal;
using drivers::DriveFault;
using drivers::DriveState;

// A robot stands when no rim has been faster than this share of safety.clear_speed_m_per_s for so long.
constexpr double kStandingShare = 0.1;
constexpr int kStandingCycles = 20;
constexpr Real kSlowGain =
    Real(1) / 50;  // a cycle: what moves on or has stopped is known within a tenth of a second,
constexpr double kQuickShare = 10;  // as more than this times safety.clear_speed_m_per_s counts as that

// An active effect of 0 +- 0 has never been measured. Beside one, adaptation would lay its torque on K7 and
// K8. Where the parameters are not amounts (a phase), one of them may well be 0.
bool effects_measured(const model::RobotParameters& p) {
    bool measured = true;
    model::for_each_active_index(p.effects.active, [&](std::size_t i) {
        std::size_t unknown = 0;
        const std::size_t count = model::kEffects[i].parameters.size();
        for (std::size_t j = 0; j < count; ++j) {
            if (p.effects.parameter[i][j] == 0 && p.effects_standard_error.parameter[i][j] == 0) ++unknown;
        }
        measured = measured && unknown < (model::kLinearInParameters[i] ? 1 : count);
    });
    return measured;
}

}  // namespace

void Judge::configure() { effects_measured_ = effects_measured(parameters_); }

supervisor::Conditions Judge::judge(const Evidence& evidence) {
    supervisor::Conditions c = evidence.told;
    const DriveSight& left = evidence.left;
    const DriveSight& right = evidence.right;
    const auto either = [&](auto DriveSight::*what, auto value) {
        return left.*what == value || right.*what == value;
    };
    const auto& safety = parameters_.safety;
    const std::int64_t now_ns = evidence.seen.now_ns;
    // Frames that come and are not believed are none; a drive's new origin is believed after some.
    const double refused_s = safety.stale_feedback_s + 1e-3 * parameters_.drive.encoder_period_ms *
                                                           control::WheelObserver<Real>::kNewOriginSamples;
    const auto& [left_taken_ns, right_taken_ns] = evidence.seen.encoder_taken_ns;
    c.feedback_stale =
        stale(std::min(left.encoder_time_ns, right.encoder_time_ns), now_ns, safety.stale_feedback_s) ||
        stale(std::min(left_taken_ns, right_taken_ns), now_ns, refused_s);
    if (c.feedback_stale) ++stale_feedback_cycles_;
    const std::uint32_t foreign = left.foreign_control + right.foreign_control + evidence.strangers;
    c.foreign_control = foreign != foreign_control_;
    foreign_control_ = foreign;
    c.drive_disarmed_itself = either(&DriveSight::fault, DriveFault::left_armed);
    const bool other_torque = either(&DriveSight::fault, DriveFault::torque_not_followed);
    c.torque_not_followed = other_torque && evidence.wants_armed;
    c.drive_error =
        either(&DriveSight::state, DriveState::fault) && !c.drive_disarmed_itself && !other_torque;
    c.drive_silent = either(&DriveSight::state, DriveState::silent);
    c.drives_armed = left.state == DriveState::armed && right.state == DriveState::armed;
    c.arming_refused =
        evidence.wants_armed && (left.refusal != ArmRefusal::none || right.refusal != ArmRefusal::none);
    c.watchdog_confirmed = !either(&DriveSight::refusal, ArmRefusal::watchdog_not_confirmed);
    c.control_mode_confirmed = !either(&DriveSight::refusal, ArmRefusal::mode_not_confirmed);

    const model::Motion<Real>& motion = evidence.seen.motion;
    if (evidence.seen.encoder_speed != nullptr) {
        encoders_over_speed_ = encoders_over_speed(*evidence.seen.encoder_speed);
    }
    // Written so that what is no number counts as dangerous.
    c.over_speed = beyond_speed_limits(motion.twist, 0) || encoders_over_speed_;
    const WheelPair<Real>& radius_m = evidence.wheel_radius_m;
    const WheelPair<Real> rims_m_per_s{radius_m.left * motion.wheel_speed_rad_per_s.left,
                                       radius_m.right * motion.wheel_speed_rad_per_s.right};
    const auto within = [](const WheelPair<Real>& rims, double limit_m_per_s) {
        return std::abs(rims.left) <= limit_m_per_s && std::abs(rims.right) <= limit_m_per_s;
    };
    // the encoders' noise at rest, which has no mean, is no motion
    const Real quick_m_per_s = Real(kQuickShare * safety.clear_speed_m_per_s);
    const auto follow = [quick_m_per_s](Real& slow, Real rim_m_per_s) {
        slow += kSlowGain * (std::clamp(rim_m_per_s, -quick_m_per_s, quick_m_per_s) - slow);
        if (!std::isfinite(slow)) slow = rim_m_per_s;  // as long as the observer is
    };
    follow(slow_rims_m_per_s_.left, rims_m_per_s.left);
    follow(slow_rims_m_per_s_.right, rims_m_per_s.right);
    const WheelPair<Real>& torque_Nm = evidence.seen.last_torque_Nm;
    const bool pushed = torque_Nm.left != 0 || torque_Nm.right != 0;
    unpushed_cycles_ = pushed ? 0 : std::min(unpushed_cycles_ + 1, kSlowCycles);
    c.moving = !within(slow_rims_m_per_s_, safety.clear_speed_m_per_s) ||
               (unpushed_cycles_ < kSlowCycles && !within(rims_m_per_s, safety.clear_speed_m_per_s));
    const bool stands = evidence.braking && within(rims_m_per_s, kStandingShare * safety.clear_speed_m_per_s);
    resting_cycles_ = stands ? resting_cycles_ + 1 : 0;
    c.rolling = resting_cycles_ < kStandingCycles;
    const auto& k = parameters_.dynamics;
    const auto& e = parameters_.dynamics_standard_error;
    const double trust = parameters_.adaptation.trust_relative_error;
    c.model_trusted = effects_measured_ && e.k7_per_kg_m > 0 && e.k8_per_kg_m2 > 0 &&
                      e.k7_per_kg_m <= trust * k.k7_per_kg_m && e.k8_per_kg_m2 <= trust * k.k8_per_kg_m2;
    return c;
}

bool Judge::beyond_speed_limits(const Twist<double>& twist, double by_m_per_s) const {
    const auto& safety = parameters_.safety;
    const double by_rad_per_s = 2 * by_m_per_s / parameters_.geometry.track_m;
    return !(std::abs(twist.v_m_per_s) <= safety.over_speed_m_per_s + by_m_per_s &&
             std::abs(twist.omega_rad_per_s) <= safety.over_yaw_rate_rad_per_s + by_rad_per_s);
}

// The observer knows it first; with a wild model it may never. A step of a coarse encoder is in doubt.
bool Judge::encoders_over_speed(const control::EncoderSpeed& encoders) const {
    const auto& geometry = parameters_.geometry;
    return encoders.known() &&
           beyond_speed_limits(model::twist_from_wheel_speeds(geometry, encoders.rad_per_s()),
                               control::EncoderSpeed::kDoubt_rad_per_s * geometry.mean_radius_m());
}

}  // namespace wheelwright::task
