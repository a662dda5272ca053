#include "firmware/task/encoder_watch.hpp"

#include <algorithm>
#include <cmath>

#include "firmware/control/velocity_loop_speed.hpp"
#include "firmware/control/wheel_observer.hpp"

namespace wheelwright::task {
namespace {

constexpr double kNearlyAllTorque = 0.75;  // of the torque limit

constexpr double kUnseenSteps = 1.5;
constexpr int kFrames = 8;
constexpr std::size_t kStopCycles = 6;  // in which a drive's estimate follows an encoder that stops
constexpr double kStopShare = 1.5;      // of what torque and friction brake in that time
constexpr double kTurnsShare = 0.5;     // of a creeping speed
constexpr int kHistoryCycles = 16;
constexpr int kPushedCycles = 80;
constexpr double kFinestStep_rad = 0.012;  // two steps of the coarsest encoder that is identified with
constexpr int kComesOutCycles = 6;
constexpr double kStepShare = 1;  // of an angle gone without a pause, by which a step is less than thought
constexpr double kCameOutStays = 0.7;  // from one stillness to the next

constexpr int kTongueFrames = 32;  // noise keeps no sign for so long
constexpr double kTongueShare = 0.25;
constexpr double kAgreeShare = 0.1;
constexpr double kWildTimes = 4;
constexpr double kSmoothest_rad = 0.003;  // angle and speed of the best encoder differ by at most

constexpr std::size_t kMirrorSpan = 8;  // cycles, of a speed by differences
constexpr std::size_t kMirrorApart = 16;
constexpr int kMirrorCycles = 6;
constexpr double kMirrorShare = 0.2;

constexpr int kAgainstCycles = 8;  // a block: noise of the speeds is less than what full torque does in it
constexpr double kAgainstShare = 0.5;
constexpr double kForgotten = 0.03;  // of what full torque does
constexpr double kAgainst_s = 0.02;  // of full torque

double seconds(std::int64_t ns) { return 1e-9 * static_cast<double>(ns); }

// What is left of a number towards zero.
double beyond(double number, double held) { return number - std::clamp(number, -held, held); }

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
    rubs_Nm_ = friction_Nm + kBeside * torque_limit_Nm_;
    creeping_rad_per_s_ = from.safety.clear_speed_m_per_s / from.geometry.mean_radius_m();
}

void EncoderWatch::rest(const WheelEvidence& now) {
    const std::array<const drivers::DriveFeedback*, 2> told{&now.left, &now.right};
    for (std::size_t i = 0; i < 2; ++i) {
        Wheel wheel;
        wheel.angle_rad = told[i]->position_rad;
        wheel.roughness_rad = wheels_[i].roughness_rad;
        wheel.step_rad = wheels_[i].step_rad;
        wheel.came_out_rad = wheels_[i].came_out_rad;
        wheels_[i] = wheel;
    }
    remembered_ = 0;
    wheels_[0].course.speed = now.speed_rad_per_s.left;
    wheels_[1].course.speed = now.speed_rad_per_s.right;
    turning_ = {now.speed_rad_per_s.difference(), 0, 0};
    alone_at_rad_ = {now.left.position_rad, now.right.position_rad};
    block_cycles_ = 0;
    block_s_ = 0;
}

bool EncoderWatch::update(const WheelEvidence& now) {
    newest_ = (newest_ + 1) % kRemembered;
    remembered_ += remembered_ < kRemembered;
    const bool known = now.dynamics != nullptr;
    const auto response = [&](double radius_m) {
        return known ? Response{now.dynamics->k7_per_kg_m / radius_m,
                                now.dynamics->k8_per_kg_m2 * now.geometry.track_m / 2 / radius_m}
                     : Response{};
    };
    const Response left = response(now.geometry.wheel_radius_m.left);
    const Response right = response(now.geometry.wheel_radius_m.right);
    const WheelPair<double>& sent = now.sent_torque_Nm;
    const auto look_at = [&](Wheel& wheel, const drivers::DriveFeedback& told, double speed_rad_per_s,
                             double unexplained, double own_Nm, double other_Nm, const Response& r) {
        wheel.angles_rad[newest_] = told.position_rad;
        wheel.speeds_rad_per_s[newest_] = speed_rad_per_s;
        learn_step(wheel, now.elapsed_s);
        bool lies =
            still(wheel, told, speed_rad_per_s, unexplained, own_Nm) &&
            (known ? goes_unseen(wheel, own_Nm, other_Nm, now.elapsed_s, r) : pushed_in_vain(wheel, own_Nm));
        lies = two_tongues(wheel, told) || lies;
        return (known && mirrored(wheel, now.elapsed_s, r)) || lies;
    };
    const bool left_lies = look_at(wheels_[0], now.left, now.speed_rad_per_s.left,
                                   now.unexplained_rad_per_s2.left, sent.left, sent.right, left);
    const bool right_lies = look_at(wheels_[1], now.right, now.speed_rad_per_s.right,
                                    now.unexplained_rad_per_s2.right, sent.right, sent.left, right);
    const bool lies = left_lies || right_lies;
    return known ? against_torque(now, left, right) || lies : lies;
}

bool EncoderWatch::update_alone(const WheelEvidence& now) {
    const WheelPair<double>& torque_Nm = now.sent_torque_Nm;
    const bool left = torque_Nm.left != 0 && torque_Nm.right == 0;
    const bool right = torque_Nm.right != 0 && torque_Nm.left == 0;
    const double pushed_rad = right ? now.right.position_rad : now.left.position_rad;
    const double other_rad = right ? now.left.position_rad : now.right.position_rad;
    if ((!left && !right) || pushed_rad != alone_at_rad_[0]) alone_at_rad_ = {pushed_rad, other_rad};
    const bool turns_other =
        std::abs(other_rad - alone_at_rad_[1]) > kUnseenSteps * control::kCoarsestStep_rad;
    if (now.dynamics != nullptr || (!left && !right)) return update(now) || turns_other;
    // Where nothing is known, a wheel that does not turn is the probe's to name.
    const std::array<double, 2> at_rad = alone_at_rad_;
    rest(now);
    alone_at_rad_ = at_rad;
    return turns_other;
}

// Whether the angle is the same as before.
bool EncoderWatch::still(Wheel& wheel, const drivers::DriveFeedback& told, double speed_rad_per_s,
                         double unexplained_rad_per_s2, double torque_Nm) const {
    if (told.position_rad == wheel.angle_rad) {
        wheel.frames += told.encoder_time_ns != wheel.told_ns;
        wheel.told_ns = told.encoder_time_ns;
        return wheel.frames >= 0;
    }
    if (wheel.frames >= 0) {
        if (wheel.coming_out == 0) wheel.coming_out = kComesOutCycles;
        wheel.frames = -1;
        wheel.speed = wheel.unseen_rad = 0;
        wheel.turned = false;
        wheel.pushed_cycles = 0;
    }
    wheel.angle_rad = told.position_rad;
    wheel.torque_Nm = torque_Nm;
    if (++wheel.history_age >= kHistoryCycles) {
        wheel.speed_before = wheel.speed_lately;
        wheel.speed_lately = speed_rad_per_s;
        wheel.unexplained_before = wheel.unexplained_lately;
        wheel.unexplained_lately = unexplained_rad_per_s2;
        wheel.history_age = 0;
    }
    return false;
}

// An encoder's step is no more than twice what came out when it lately told anew after a stillness, and what
// it has gone since shows how much less the first guess may be.
void EncoderWatch::learn_step(Wheel& wheel, double elapsed_s) const {
    if (wheel.step_rad == 0) wheel.step_rad = control::kCoarsestStep_rad;
    if (wheel.frames >= 0) return;
    if (wheel.coming_out > 0 && --wheel.coming_out == 0) {
        const double before_rad =
            wheel.angles_rad[(newest_ + kRemembered - static_cast<std::size_t>(kComesOutCycles)) %
                             kRemembered];
        const double out_rad = std::abs(wheel.angles_rad[newest_] - before_rad);
        wheel.came_out_rad = std::max(2 * out_rad, kCameOutStays * wheel.came_out_rad);
    }
    const double less_rad = kStepShare * std::abs(wheel.speeds_rad_per_s[newest_]) * elapsed_s;
    wheel.step_rad = std::min(std::max({wheel.step_rad - less_rad, wheel.came_out_rad, kFinestStep_rad}),
                              control::kCoarsestStep_rad);
}

bool EncoderWatch::pushed_in_vain(Wheel& wheel, double torque_Nm) const {
    wheel.pushed_cycles = beyond_held_Nm(wheel, torque_Nm, 0) != 0 ? wheel.pushed_cycles + 1 : 0;
    return wheel.pushed_cycles >= kPushedCycles;
}

bool EncoderWatch::goes_unseen(Wheel& wheel, double torque_Nm, double other_Nm, double elapsed_s,
                               const Response& response) const {
    const double own = response.forward + response.turning;
    const double others = response.forward - response.turning;
    const double slope_Nm = -wheel.unexplained_before / (2 * response.forward);
    // The least speed of a wheel that has just been turning.
    const auto least = [&](double speed, double seconds) {
        const double sign = speed < 0 ? -1 : 1;
        const double net_Nm = sign * torque_Nm - rubs_Nm_ - std::abs(slope_Nm);
        return sign * std::max(0.0, std::abs(speed) + (own * net_Nm + others * sign * other_Nm) * seconds);
    };
    if (wheel.frames == 0 && remembered_ > kStopCycles) {
        const double before = wheel.speeds_rad_per_s[(newest_ + kRemembered - kStopCycles) % kRemembered];
        const double after = least(before, kStopShare * static_cast<double>(kStopCycles) * elapsed_s);
        wheel.speed = std::abs(after) < std::abs(before) ? after : before;
        if (std::abs(wheel.speed) < kTurnsShare * creeping_rad_per_s_) wheel.speed = 0;
        wheel.turned = wheel.speed != 0;
    }
    if (wheel.turned) {
        wheel.speed = least(wheel.speed, elapsed_s);
        wheel.turned = wheel.speed != 0;
    } else {
        wheel.speed += beyond_held_Nm(wheel, torque_Nm, slope_Nm) * own * elapsed_s;
    }
    wheel.unseen_rad += wheel.speed * elapsed_s;
    // What friction holds is not known so well that a fine encoder's step would tell.
    const double step_rad = wheel.turned ? wheel.step_rad : control::kCoarsestStep_rad;
    return wheel.frames >= kFrames && !(std::abs(wheel.unseen_rad) <= kUnseenSteps * step_rad);
}

// Angle against speed, of one drive.
bool EncoderWatch::two_tongues(Wheel& wheel, const drivers::DriveFeedback& told) const {
    if (told.encoder_time_ns == wheel.last_told_ns) return false;
    const double moved = told.position_rad - wheel.last_angle_rad;
    const bool goes_on = told.speed_rad_per_s * wheel.last_told_speed > 0;
    // One of two may be wild.
    const double before = std::abs(wheel.last_told_speed);
    const double speed = std::copysign(
        std::abs(told.speed_rad_per_s) < kWildTimes * before ? std::abs(told.speed_rad_per_s) : before,
        told.speed_rad_per_s);
    const double expected = speed * seconds(told.encoder_time_ns - wheel.last_told_ns);
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
    // Learned where they agree well, or a lie would be learned too.
    if (beside <= kAgreeShare * std::abs(wheel.by_speed_rad))
        wheel.roughness_rad = std::clamp(2 * beside, std::max(0.6 * wheel.roughness_rad, kSmoothest_rad),
                                         control::kCoarsestStep_rad);
    wheel.of_one_sign = 0;
    wheel.beside_rad = wheel.by_speed_rad = 0;
    return lies;
}

bool EncoderWatch::mirrored(Wheel& wheel, double elapsed_s, const Response& response) const {
    if (remembered_ < kRemembered) return false;
    const auto angle = [&](std::size_t ago) {
        return wheel.angles_rad[(newest_ + kRemembered - ago) % kRemembered];
    };
    const double now = angle(0) - angle(kMirrorSpan);
    const double before = angle(kMirrorApart) - angle(kMirrorApart + kMirrorSpan);
    // Twice what the torque limit does meanwhile, as the speed changes by twice itself.
    const double turned_rad = full_rad_per_s2(response) * elapsed_s * kMirrorApart * elapsed_s * kMirrorSpan;
    const double noise_rad =
        4 * (wheel.roughness_rad == 0 ? control::kCoarsestStep_rad : wheel.roughness_rad);
    const bool mirror =
        std::abs(now + before) < kMirrorShare * std::abs(before) && std::abs(before) > noise_rad + turned_rad;
    wheel.mirrored_cycles = mirror ? wheel.mirrored_cycles + 1 : 0;
    return wheel.mirrored_cycles >= kMirrorCycles;
}

// What the torque must do at least, beside friction and the couplings of forward motion and turning, against
// how the speeds change, in blocks of some cycles.
bool EncoderWatch::against_torque(const WheelEvidence& now, const Response& left, const Response& right) {
    const Twist<double> twist = model::twist_from_wheel_speeds(now.geometry, now.speed_rad_per_s);
    const double omega = twist.omega_rad_per_s;
    const double radius_m = now.geometry.mean_radius_m();
    const double ahead = std::abs(now.dynamics->k5_m * omega * omega) / radius_m;
    const double round =
        std::abs(now.dynamics->k6_per_m * twist.v_m_per_s * omega) * now.geometry.track_m / 2 / radius_m;
    const WheelPair<double> net_Nm{beyond(now.acting_torque_Nm.left, rubs_Nm_),
                                   beyond(now.acting_torque_Nm.right, rubs_Nm_)};
    const double dt = now.elapsed_s;
    wheels_[0].course.expected +=
        dt * beyond(left.forward * net_Nm.sum() - left.turning * net_Nm.difference(), ahead + round);
    wheels_[1].course.expected +=
        dt * beyond(right.forward * net_Nm.sum() + right.turning * net_Nm.difference(), ahead + round);
    turning_.expected += dt * beyond((left.turning + right.turning) * net_Nm.difference(), 2 * round);
    block_s_ += dt;
    if (++block_cycles_ < kAgainstCycles) return false;
    bool lies = against(wheels_[0].course, now.speed_rad_per_s.left, full_rad_per_s2(left));
    lies = against(wheels_[1].course, now.speed_rad_per_s.right, full_rad_per_s2(right)) || lies;
    lies = against(turning_, now.speed_rad_per_s.difference(),
                   2 * (left.turning + right.turning) * torque_limit_Nm_) ||
           lies;
    block_cycles_ = 0;
    block_s_ = 0;
    return lies;
}

bool EncoderWatch::against(Course& course, double speed, double full_rad_per_s2) const {
    const double should = std::abs(course.expected);
    const double opposed = course.expected > 0 ? course.speed - speed : speed - course.speed;
    course.speed = speed;
    course.expected = 0;
    const double forgotten = kForgotten * full_rad_per_s2 * block_s_;
    course.evidence = std::max(
        0.0, course.evidence + std::clamp(opposed, -should, should) - kAgainstShare * should - forgotten);
    return course.evidence > kAgainstShare * kAgainst_s * full_rad_per_s2;
}

// Of a wheel, by both torques.
double EncoderWatch::full_rad_per_s2(const Response& response) const {
    return 2 * std::max(response.forward, response.turning) * torque_limit_Nm_;
}

// What of a torque must turn a wheel that stands.
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
