#include "firmware/task/encoder_watch.hpp"

#include <algorithm>
#include <cmath>

#include "firmware/control/velocity_loop_speed.hpp"
#include "firmware/control/wheel_observer.hpp"

namespace wheelwright::task {
namespace {

constexpr double kNearlyAllTorque = 0.75;  // of the torque limit
constexpr double kUnseenSteps = 1.5;
constexpr double kBrakesShare = 1.5;  // of what the torque brakes by, with friction
constexpr int kHistoryCycles = 16;
constexpr int kPushedCycles = 80;
constexpr int kFrames = 8;
constexpr std::size_t kStopCycles = 6;  // in which the estimate of a drive follows an encoder that stops
constexpr int kComesOutCycles = 6;
constexpr double kStepShare =
    1.0 / 8;  // of an angle that is gone, by which the step is less than was thought

constexpr int kTongueFrames = 32;  // noise keeps no sign for so long
constexpr double kTongueShare = 0.25;

constexpr std::size_t kMirrorSpan = 8;  // cycles, of a speed by differences
constexpr std::size_t kMirrorApart = 12;
constexpr int kMirrorCycles = 4;
constexpr double kMirrorShare = 0.2;

constexpr double kAgainstShare = 0.5;
constexpr double kAgainst_s = 0.025;  // of full torque

double seconds(std::int64_t ns) { return 1e-9 * static_cast<double>(ns); }

}  // namespace

void EncoderWatch::configure(const model::RobotParameters& from) {
    constexpr double kUnknownFriction = 0.25;  // of the torque limit, each way
    constexpr double kFrictionMayBeWrong = 1.25;
    constexpr double kBeside = 0.1;  // of the torque limit
    torque_limit_Nm_ = from.limits.torque_Nm;
    const double dry_Nm = torque_limit_Nm_ - control::accelerating_Nm(from);
    const double friction_Nm =
        dry_Nm > 0 ? kFrictionMayBeWrong * dry_Nm : kUnknownFriction * torque_limit_Nm_;
    held_Nm_ = std::min(2 * friction_Nm + kBeside * torque_limit_Nm_, kNearlyAllTorque * torque_limit_Nm_);
    creeping_rad_per_s_ = from.safety.clear_speed_m_per_s / from.geometry.mean_radius_m();
}

void EncoderWatch::rest(const WheelEvidence& now) {
    const std::array<const drivers::DriveFeedback*, 2> told{&now.left, &now.right};
    for (std::size_t i = 0; i < 2; ++i) {
        Wheel wheel;
        wheel.angle_rad = told[i]->position_rad;
        wheel.roughness_rad = wheels_[i].roughness_rad;
        wheel.step_rad = wheels_[i].step_rad;
        wheels_[i] = wheel;
    }
    remembered_ = 0;
    turning_against_ = 0;
    difference_before_ = now.speed_rad_per_s.difference();
    wheels_[0].speed_now = now.speed_rad_per_s.left;
    wheels_[1].speed_now = now.speed_rad_per_s.right;
}

bool EncoderWatch::update(const WheelEvidence& now) {
    const double half_track_m = now.geometry.track_m / 2;
    const auto response = [&](double radius_m) {
        return now.dynamics == nullptr ? Response{}
                                       : Response{now.dynamics->k7_per_kg_m / radius_m,
                                                  now.dynamics->k8_per_kg_m2 * half_track_m / radius_m};
    };
    const Response left = response(now.geometry.wheel_radius_m.left);
    const Response right = response(now.geometry.wheel_radius_m.right);
    newest_ = (newest_ + 1) % kRemembered;
    remembered_ += remembered_ < kRemembered;
    wheels_[0].angles_rad[newest_] = now.left.position_rad;
    wheels_[1].angles_rad[newest_] = now.right.position_rad;
    wheels_[0].speeds_rad_per_s[newest_] = now.speed_rad_per_s.left;
    wheels_[1].speeds_rad_per_s[newest_] = now.speed_rad_per_s.right;
    for (Wheel& wheel : wheels_) learn_step(wheel, now.elapsed_s);

    bool lies = false;
    if (still(wheels_[0], now.left, now.speed_rad_per_s.left, now.unexplained_rad_per_s2.left,
              now.sent_torque_Nm.left))
        lies |= frozen(wheels_[0], now.sent_torque_Nm.left, now.sent_torque_Nm.right, now.elapsed_s,
                       now.dynamics == nullptr ? nullptr : &left);
    if (still(wheels_[1], now.right, now.speed_rad_per_s.right, now.unexplained_rad_per_s2.right,
              now.sent_torque_Nm.right))
        lies |= frozen(wheels_[1], now.sent_torque_Nm.right, now.sent_torque_Nm.left, now.elapsed_s,
                       now.dynamics == nullptr ? nullptr : &right);
    lies |= two_tongues(wheels_[0], now.left);
    lies |= two_tongues(wheels_[1], now.right);
    if (now.dynamics == nullptr) return lies;

    lies |= mirrored(wheels_[0], now.elapsed_s, left, now.acting_torque_Nm.left);
    lies |= mirrored(wheels_[1], now.elapsed_s, right, now.acting_torque_Nm.right);

    const WheelPair<double> beyond{beyond_friction_Nm(now.acting_torque_Nm.left),
                                   beyond_friction_Nm(now.acting_torque_Nm.right)};
    const auto full = [&](const Response& r) {
        return 2 * std::max(r.forward, r.turning) * torque_limit_Nm_;
    };
    const double left_change = now.speed_rad_per_s.left - wheels_[0].speed_now;
    const double right_change = now.speed_rad_per_s.right - wheels_[1].speed_now;
    wheels_[0].speed_now = now.speed_rad_per_s.left;
    wheels_[1].speed_now = now.speed_rad_per_s.right;
    lies |=
        against(wheels_[0].against, left_change,
                left.forward * beyond.sum() - left.turning * beyond.difference(), full(left), now.elapsed_s);
    lies |= against(wheels_[1].against, right_change,
                    right.forward * beyond.sum() + right.turning * beyond.difference(), full(right),
                    now.elapsed_s);
    lies |= against(turning_against_, right_change - left_change,
                    (left.turning + right.turning) * beyond.difference(),
                    2 * (left.turning + right.turning) * torque_limit_Nm_, now.elapsed_s);
    return lies;
}

bool EncoderWatch::update_alone(const WheelEvidence& now) {
    const WheelPair<double>& torque_Nm = now.sent_torque_Nm;
    const bool left = torque_Nm.left != 0 && torque_Nm.right == 0;
    const bool right = torque_Nm.right != 0 && torque_Nm.left == 0;
    if (!left && !right) return update(now);
    Wheel& pushed = wheels_[right ? 1 : 0];
    if ((right ? now.right.position_rad : now.left.position_rad) != pushed.angle_rad) {
        rest(now);
        return false;
    }
    const double other_rad = right ? now.left.position_rad : now.right.position_rad;
    return !(std::abs(other_rad - wheels_[right ? 0 : 1].angle_rad) <=
             kUnseenSteps * control::kCoarsestStep_rad);
}

// Whether the angle is the same as before.
bool EncoderWatch::still(Wheel& wheel, const drivers::DriveFeedback& told, double speed_rad_per_s,
                         double unexplained_rad_per_s2, double torque_Nm) const {
    if (told.position_rad == wheel.angle_rad) {
        wheel.frames += told.encoder_time_ns != wheel.told_ns;
        wheel.told_ns = told.encoder_time_ns;
        return wheel.frames >= 0;
    }
    if (wheel.frames >= 0 && wheel.coming_out == 0) {
        wheel.hidden_from_rad = wheel.angle_rad;
        wheel.coming_out = kComesOutCycles;
    }
    wheel.angle_rad = told.position_rad;
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

// An encoder's step is no more than what came out when it last told anew, and less the farther it has gone
// without a pause.
void EncoderWatch::learn_step(Wheel& wheel, double elapsed_s) const {
    if (wheel.step_rad == 0) wheel.step_rad = control::kCoarsestStep_rad;
    if (wheel.frames >= 0) return;
    wheel.step_rad -= kStepShare * std::abs(wheel.speeds_rad_per_s[newest_]) * elapsed_s;
    if (wheel.coming_out > 0) --wheel.coming_out;
    const double out_rad = wheel.coming_out > 0 ? std::abs(wheel.angle_rad - wheel.hidden_from_rad) : 0;
    wheel.step_rad = std::clamp(2 * out_rad, std::max(wheel.step_rad, 0.0), control::kCoarsestStep_rad);
}

bool EncoderWatch::frozen(Wheel& wheel, double torque_Nm, double other_Nm, double elapsed_s,
                          const Response* response) const {
    if (response == nullptr) {
        const double beyond_Nm = beyond_held_Nm(wheel, torque_Nm, 0);
        wheel.pushed_cycles = beyond_Nm != 0 ? wheel.pushed_cycles + 1 : 0;
        return wheel.pushed_cycles >= kPushedCycles;
    }
    const double own = response->forward + response->turning;
    const double others = response->forward - response->turning;
    const double slope_Nm = -wheel.unexplained_before / (2 * response->forward);
    // The least speed that it can have: what holds it may all brake it.
    const auto braked = [&](double speed, double seconds) {
        const double sign = speed < 0 ? -1 : 1;
        const double net =
            own * (sign * torque_Nm - held_Nm_ - std::abs(slope_Nm)) + others * sign * other_Nm;
        return sign * std::max(0.0, std::abs(speed) + std::min(0.0, net) * seconds);
    };
    if (wheel.frames == 0 && remembered_ > kStopCycles) {  // how fast was it, at least, before it stood?
        const double before = wheel.speeds_rad_per_s[(newest_ + kRemembered - kStopCycles) % kRemembered];
        wheel.speed = braked(before, kBrakesShare * kStopCycles * elapsed_s);
    }
    const double beyond_Nm = beyond_held_Nm(wheel, torque_Nm, slope_Nm);
    wheel.speed = beyond_Nm != 0 ? wheel.speed + beyond_Nm * own * elapsed_s : braked(wheel.speed, elapsed_s);
    wheel.unseen_rad += wheel.speed * elapsed_s;
    return wheel.frames >= kFrames && !(std::abs(wheel.unseen_rad) <= kUnseenSteps * wheel.step_rad);
}

// Angle against speed, of one drive.
bool EncoderWatch::two_tongues(Wheel& wheel, const drivers::DriveFeedback& told) const {
    if (told.encoder_time_ns == wheel.last_told_ns) return false;
    const double dt = std::min(seconds(told.encoder_time_ns - wheel.last_told_ns), 0.01);
    const double moved = told.position_rad - wheel.last_angle_rad;
    const double expected = told.speed_rad_per_s * dt;
    const bool goes_on = told.speed_rad_per_s * wheel.last_told_speed > 0;
    wheel.last_told_ns = told.encoder_time_ns;
    wheel.last_angle_rad = told.position_rad;
    wheel.last_told_speed = told.speed_rad_per_s;
    if (!goes_on) {
        wheel.of_one_sign = 0;
        wheel.beside_rad = wheel.by_speed_rad = 0;
        return false;
    }
    if (wheel.roughness_rad == 0) wheel.roughness_rad = control::kCoarsestStep_rad;
    // One leap is a new origin.
    const double most = std::abs(expected) + wheel.roughness_rad;
    wheel.beside_rad += std::clamp(moved - expected, -most, most);
    wheel.by_speed_rad += expected;
    if (++wheel.of_one_sign < kTongueFrames) return false;
    const double beside = std::abs(wheel.beside_rad);
    const bool lies = beside > kTongueShare * std::abs(wheel.by_speed_rad) + 2 * wheel.roughness_rad;
    if (!lies)
        wheel.roughness_rad = std::clamp(2 * beside, 0.8 * wheel.roughness_rad, control::kCoarsestStep_rad);
    wheel.of_one_sign = 0;
    wheel.beside_rad = wheel.by_speed_rad = 0;
    return lies;
}

bool EncoderWatch::mirrored(Wheel& wheel, double elapsed_s, const Response& response, double acting_Nm) {
    if (remembered_ < kRemembered) return false;
    const auto angle = [&](std::size_t ago) {
        return wheel.angles_rad[(newest_ + kRemembered - ago) % kRemembered];
    };
    const double now = angle(0) - angle(kMirrorSpan);
    const double before = angle(kMirrorApart) - angle(kMirrorApart + kMirrorSpan);
    const double brakes = kBrakesShare * 2 * std::max(response.forward, response.turning) * torque_limit_Nm_ *
                          elapsed_s * kMirrorApart;
    const double noise = 4 * (wheel.roughness_rad == 0 ? control::kCoarsestStep_rad : wheel.roughness_rad);
    const bool mirror = std::abs(now + before) < kMirrorShare * std::abs(before) &&
                        std::abs(before) > noise + brakes * elapsed_s * kMirrorSpan &&
                        !(beyond_friction_Nm(acting_Nm) * now > 0);
    wheel.mirrored_cycles = mirror ? wheel.mirrored_cycles + 1 : 0;
    return wheel.mirrored_cycles >= kMirrorCycles;
}

// Change of a speed, and the acceleration that the torque should give at least.
bool EncoderWatch::against(double& evidence, double change, double expected, double full,
                           double elapsed_s) const {
    const double should = std::abs(expected) * elapsed_s;
    const double opposed = expected > 0 ? -change : change;
    if (should == 0) {
        evidence = std::max(0.0, evidence - full * elapsed_s / 4);
        return false;
    }
    evidence = std::max(0.0, evidence + std::clamp(opposed, -should, should) - kAgainstShare * should);
    return evidence > kAgainst_s * full * kAgainstShare;
}

// What of a torque must accelerate a wheel that turns either way.
double EncoderWatch::beyond_friction_Nm(double torque_Nm) const {
    return torque_Nm - std::clamp(torque_Nm, -held_Nm_ / 2, held_Nm_ / 2);
}

// What of a torque must turn the wheel.
double EncoderWatch::beyond_held_Nm(const Wheel& wheel, double torque_Nm, double slope_Nm) const {
    double least = 0, most = 0;
    if (std::abs(torque_Nm) < kNearlyAllTorque * torque_limit_Nm_) {
        const bool crept =
            std::max(std::abs(wheel.speed_before), std::abs(wheel.speed_lately)) <= creeping_rad_per_s_;
        const double held_Nm = crept ? wheel.torque_Nm : 0;
        least = std::min({0.0, slope_Nm, held_Nm});
        most = std::max({0.0, slope_Nm, held_Nm});
    }
    return torque_Nm - std::clamp(torque_Nm, least - held_Nm_, most + held_Nm_);
}

}  // namespace wheelwright::task
