#include "firmware/control/encoder_watch.hpp"

namespace wheelwright::control {
namespace {

constexpr Real kUnseen_rad = Real(kMostUnseen_rad);
constexpr Real kBrakesShare = Real(1.5);    // of what the torque brakes by, with friction
constexpr Real kFrictionGrows = Real(1.5);  // when cold, or to break away; at most, and as much less
constexpr int kPushedCycles = 80;
constexpr int kFrames = 4;

constexpr int kSpans = 4;               // over which a speed is looked at
constexpr Real kLikeness = Real(0.5);   // so far from what it should be, or from its mirror image, as a share
constexpr Real kBeyondNoise = Real(5);  // mean deviations: a speed that is more than noise
constexpr Real kGainBeyondNoise = Real(2);
constexpr Real kGainShare = Real(0.6);  // of what full torque makes of a speed in a span: no slope does
constexpr int kAgainstCycles = 80;
constexpr int kAgainstSpans = 16;         // in a row: some settling times of the loops
constexpr Real kTurnShare = Real(0.25);   // of what full torque makes of a turn: no scrub does
constexpr int kAveraged = 64;             // spans
constexpr Real kGainOfPush = Real(0.25);  // of what the torques alone would give
constexpr int kAgainstPushCycles = 40;
constexpr Real kLeaptAlone = Real(0.05);  // of a leap, is the other wheel's
constexpr int kLeapSpans = 5;             // it takes at most
constexpr int kSettled = 4;               // spans: the observer has followed the leap
constexpr Real kLeastShare = Real(0.2);   // encoders lose each other count, or three of four
constexpr Real kScaleDoubt = Real(0.5);
constexpr int kMostSpansAfterLeap = 64;

// Where K5 and K6 are zeros nobody has found them yet.
bool knows_body(const model::Dynamics<Real>& k) { return k.k5_m != 0 || k.k6_per_m != 0; }

}  // namespace

EncoderWatchSettings encoder_watch_settings(const model::RobotParameters& from, bool identifying) {
    constexpr double kUnknownFriction = 0.5;  // of the torque limit
    constexpr double kFrictionMayBeWrong = 1.25;
    constexpr double kBeside = 0.1;  // of the torque limit
    const double limit_Nm = from.limits.torque_Nm;
    const double dry_Nm = limit_Nm - accelerating_Nm(from);
    // The observer follows within some of its time constants, and not without a few reports.
    const double span_s = 1 / velocity_loop_speed(from, kObserverCycle_s).observer_bandwidth_rad_per_s;
    constexpr int kGentleSpan_cycles = 15;
    constexpr int kReportsInASpan = 3;
    const int reports_cycles = kReportsInASpan * from.drive.encoder_period_ms;
    const int span_cycles =
        std::max(reports_cycles,
                 identifying ? kGentleSpan_cycles
                             : std::clamp(static_cast<int>(std::lround(span_s / kObserverCycle_s)), 6, 20));
    const double friction_Nm = dry_Nm > 0 ? double(kFrictionGrows) * dry_Nm : kUnknownFriction * limit_Nm;
    const double most_held_Nm = double(kNearlyAllTorque) * limit_Nm;
    // No sooner than the angle can have changed: by what full torque does until the drives have told of it.
    const double full_rad_per_s2 =
        (from.dynamics.k7_per_kg_m + from.dynamics.k8_per_kg_m2 * from.geometry.track_m / 2) * limit_Nm /
        from.geometry.mean_radius_m();
    const double late_s =
        from.velocity_loop.actuation_delay_s + kFrames * from.drive.encoder_period_ms * kObserverCycle_s;
    const double seen_rad = kMostUnseenSteps * encoder_step_rad(from) + full_rad_per_s2 * late_s * late_s / 2;
    return {Real(limit_Nm),
            Real(std::min(friction_Nm, most_held_Nm)),
            Real(from.safety.clear_speed_m_per_s / from.geometry.mean_radius_m()),
            span_cycles,
            Real(2 * limit_Nm / from.geometry.mean_radius_m() * span_cycles * kObserverCycle_s),
            Real(identifying ? kFrictionMayBeWrong * dry_Nm : 0),
            std::clamp(Real(seen_rad), identifying ? Real(0) : kUnseen_rad / 2, kUnseen_rad),
            from.drive.encoder_period_ms,
            Real(std::min(friction_Nm + (identifying ? 0 : kBeside * limit_Nm), most_held_Nm))};
}

void EncoderWatch::configure(const EncoderWatchSettings& settings) {
    constexpr int kHistory_cycles = 16, kFewestReports = 4;
    settings_ = settings;
    history_reports_ = std::max(kFewestReports, kHistory_cycles / settings.report_cycles);
}

void EncoderWatch::rest(const std::array<EncoderAngle, 2>& told) {
    wheels_ = {};
    for (const std::size_t i : {0, 1}) {
        wheels_[i].told = told[i];
        if (!std::isfinite(told[i].unsure_rad)) wheels_[i].told.unsure_rad = 0;
    }
    instants_known_ = cycles_ = 0;
    against_cycles_ = against_push_cycles_ = {};
    turns_against_spans_ = goes_against_spans_ = 0;
    leapt_ = {};
    leaps_ = mirrored_ = false;
}

bool EncoderWatch::update(Real elapsed_s, const std::array<EncoderAngle, 2>& told,
                          const WheelObserver<Real>& observer, const WheelPair<Real>& torque_Nm,
                          const PlantModel<Real>& plant, bool model_known) {
    const WheelPair<Real>& speed = observer.motion().wheel_speed_rad_per_s;
    const WheelPair<Real>& expected = observer.expected_acceleration();
    expected_rad_per_s_.left += elapsed_s * expected.left;
    expected_rad_per_s_.right += elapsed_s * expected.right;
    if (settings_.known_friction_Nm > 0) push(elapsed_s, observer.acting_torque_Nm(), plant);
    ++cycles_;
    if ((mirrored_ && model_known) || observer.both_leap()) return true;
    const WheelPair<Real> unexplained = observer.unexplained_acceleration();
    const Real friction_Nm = settings_.known_friction_Nm;
    if (friction_Nm > 0) remember_changes(elapsed_s, torque_Nm, plant);
    const bool left = still(wheels_[0], told[0], {speed.left, unexplained.left});
    const bool right = still(wheels_[1], told[1], {speed.right, unexplained.right});
    if (!left && !right) return false;
    const auto& radius_m = plant.geometry.wheel_radius_m;
    // A body that turns pulls at its wheels: that alone may hold one against full torque.
    const WheelPair<Real> holds_Nm = model::inverse_dynamics(plant.dynamics, observer.motion().twist, {});
    const auto net_push = [&](bool is_still, Real speed_rad_per_s, Real push_Nm) {
        const bool creeps = std::abs(speed_rad_per_s) <= settings_.creeping_rad_per_s;
        if (creeps && is_still) return Range{0, 0};
        return Range{push_Nm - (creeps || speed_rad_per_s > 0 ? friction_Nm : 0),
                     push_Nm + (creeps || speed_rad_per_s < 0 ? friction_Nm : 0)};
    };
    const Pushed left_pushed{torque_Nm.left, holds_Nm.left, net_push(right, speed.right, torque_Nm.right),
                             wheels_[1].lately.unexplained_rad_per_s2};
    const Pushed right_pushed{torque_Nm.right, holds_Nm.right, net_push(left, speed.left, torque_Nm.left),
                              wheels_[0].lately.unexplained_rad_per_s2};
    const bool left_lies =
        left && hidden(wheels_[0], elapsed_s, left_pushed, radius_m.left, plant, model_known);
    const bool right_lies =
        right && hidden(wheels_[1], elapsed_s, right_pushed, radius_m.right, plant, model_known);
    return left_lies || right_lies;
}

// Whether the angle is the same as before, as far as it is known behind the drive's loop; or what is told is.
// What that loop still shows of the motion fades in the first frames.
bool EncoderWatch::still(Wheel& wheel, const EncoderAngle& told, const Motion& now) const {
    const double unsure_rad = std::max(told.unsure_rad, wheel.told.unsure_rad);
    if (told.position_rad == wheel.told.position_rad ||
        std::abs(told.angle_rad - wheel.told.angle_rad) <= unsure_rad) {
        wheel.unseen.frames += told.time_ns != wheel.told.time_ns;
        if (wheel.unseen.frames <= kFrames && std::isfinite(told.unsure_rad)) wheel.told = told;
        return true;
    }
    wheel.told = told;
    wheel.unseen.frames = -1;
    if (++wheel.history_age >= history_reports_) {
        wheel.before = wheel.lately;
        wheel.lately = now;
        wheel.history_age = 0;
    }
    return false;
}

// Whether a wheel whose angle stands still has gone too far unseen.
bool EncoderWatch::hidden(Wheel& wheel, Real elapsed_s, const Pushed& pushed, Real radius_m,
                          const PlantModel<Real>& plant, bool model_known) const {
    Unseen& unseen = wheel.unseen;
    if (unseen.frames <= 0) unseen = {.frames = unseen.frames};
    if (!model_known) {
        const bool turns = std::abs(pushed.torque_Nm) > settings_.held_unknown_Nm;
        unseen.pushed_cycles = turns ? unseen.pushed_cycles + 1 : 0;
        return unseen.pushed_cycles >= kPushedCycles;
    }
    const Real forward = plant.dynamics.k7_per_kg_m / radius_m;
    const Real turning = plant.dynamics.k8_per_kg_m2 * plant.geometry.track_m / (2 * radius_m);
    const Real before = wheel.before.speed_rad_per_s;
    const Real brakes = kBrakesShare * 2 * std::max(forward, turning) * settings_.torque_limit_Nm * elapsed_s;
    const bool level_floor = settings_.known_friction_Nm > 0;
    if (unseen.frames == 0) {  // the first cycle: how fast was it, at least and at most, before it stood?
        const Real changed =
            level_floor ? kBrakesShare * wheel.before.changed_rad_per_s
                        : brakes * Real((history_reports_ + wheel.history_age) * settings_.report_cycles);
        unseen.speed_rad_per_s = {before - changed, before + changed};
        unseen.from_rest = std::abs(before) <= changed;
        if (!level_floor) {
            const Real least = unseen.from_rest ? 0 : before - std::copysign(changed, before);
            unseen.speed_rad_per_s = {least, least};
        }
    }
    Range& speed = unseen.speed_rad_per_s;
    if (level_floor) {
        push_on(speed, pushed, (forward - turning) / (forward + turning), (forward + turning) * elapsed_s);
    } else {
        const Real beyond_Nm =
            beyond_held_Nm(wheel, pushed.torque_Nm, pushed.holds_Nm, pushed.beside_rad_per_s2, 2 * forward);
        if (beyond_Nm != 0) {
            speed.least += beyond_Nm * (forward + turning) * elapsed_s;
        } else if (speed.least * pushed.torque_Nm < 0) {
            speed.least -= std::clamp(speed.least, -brakes, brakes);
        }
        speed.most = speed.least;
    }
    Range& angle = unseen.angle_rad;
    angle.least += speed.least * elapsed_s;
    angle.most += speed.most * elapsed_s;
    unseen.time_s += elapsed_s;
    const Real most_rad = unseen.from_rest ? settings_.unseen_from_rest_rad : kUnseen_rad;
    const bool may_stand = angle.least <= most_rad && angle.most >= -most_rad;
    if (unseen.frames < kFrames) return false;
    if (level_floor && may_stand) {  // what it was quicker by at first would have shown
        const Real below_rad = std::max(-most_rad - angle.least, Real(0));
        const Real above_rad = std::max(angle.most - most_rad, Real(0));
        angle = {angle.least + below_rad, angle.most - above_rad};
        speed = {speed.least + below_rad / unseen.time_s, speed.most - above_rad / unseen.time_s};
        if (!unseen.from_rest && speed.least <= 0 && speed.most >= 0) {
            angle = {};
            unseen.time_s = 0;
            unseen.from_rest = true;
        }
    }
    return !may_stand;
}

// By how much, at most, torques and friction can have changed the wheels' speeds since they were noted.
void EncoderWatch::remember_changes(Real elapsed_s, const WheelPair<Real>& torque_Nm,
                                    const PlantModel<Real>& plant) {
    const auto& g = plant.geometry;
    const Real forward = elapsed_s * plant.dynamics.k7_per_kg_m;
    const Real turning = elapsed_s * plant.dynamics.k8_per_kg_m2 * g.track_m / 2;
    const Real by_own = forward + turning;
    const Real by_other = std::abs(forward - turning);
    const Real left_Nm = std::abs(torque_Nm.left) + settings_.known_friction_Nm;
    const Real right_Nm = std::abs(torque_Nm.right) + settings_.known_friction_Nm;
    const auto add = [](Wheel& wheel, Real change_rad_per_s) {
        wheel.before.changed_rad_per_s += change_rad_per_s;
        wheel.lately.changed_rad_per_s += change_rad_per_s;
    };
    add(wheels_[0], (by_own * left_Nm + by_other * right_Nm) / g.wheel_radius_m.left);
    add(wheels_[1], (by_own * right_Nm + by_other * left_Nm) / g.wheel_radius_m.right);
}

// What of a torque must turn the wheel. `gain_rad_per_s2`: of its speed, by a newton metre on each wheel.
Real EncoderWatch::beyond_held_Nm(const Wheel& wheel, Real torque_Nm, Real holds_Nm, Real beside_rad_per_s2,
                                  Real gain_rad_per_s2) const {
    Real least = std::min(Real(0), holds_Nm);
    Real most = std::max(Real(0), holds_Nm);
    if (std::abs(torque_Nm) < kNearlyAllTorque * settings_.torque_limit_Nm) {
        const Real slope_Nm = -wheel.before.unexplained_rad_per_s2 / gain_rad_per_s2;
        const Real lately_Nm = -wheel.lately.unexplained_rad_per_s2 / gain_rad_per_s2;
        const Real beside_Nm = std::abs(beside_rad_per_s2) / gain_rad_per_s2;  // a camber's is the other way
        least = std::min({least, slope_Nm, lately_Nm, -beside_Nm});
        most = std::max({most, slope_Nm, lately_Nm, beside_Nm});
    }
    return torque_Nm - std::clamp(torque_Nm, least - settings_.held_Nm, most + settings_.held_Nm);
}

// A cycle of a wheel that nothing but friction holds, by its torque, and by what it gets through mass and
// inertia from the other wheel. `gain_rad_per_s`: of speed, by a newton metre.
void EncoderWatch::push_on(Range& speed_rad_per_s, const Pushed& pushed, Real coupling,
                           Real gain_rad_per_s) const {
    const Real a_Nm = pushed.torque_Nm + coupling * pushed.other_Nm.least;
    const Real b_Nm = pushed.torque_Nm + coupling * pushed.other_Nm.most;
    const Real least_Nm = std::min(a_Nm, b_Nm) - std::max(Real(0), pushed.holds_Nm);
    const Real most_Nm = std::max(a_Nm, b_Nm) - std::min(Real(0), pushed.holds_Nm);
    const auto next = [gain_rad_per_s](Real speed, Real push_Nm, Real ahead_Nm, Real back_Nm) {
        return std::max(std::max(speed, Real(0)) + gain_rad_per_s * (push_Nm - ahead_Nm), Real(0)) +
               std::min(std::min(speed, Real(0)) + gain_rad_per_s * (push_Nm + back_Nm), Real(0));
    };
    const Real most_friction_Nm = settings_.held_Nm;
    const Real least_friction_Nm = most_friction_Nm / (kFrictionGrows * kFrictionGrows);
    speed_rad_per_s.least = next(speed_rad_per_s.least, least_Nm, most_friction_Nm, least_friction_Nm);
    speed_rad_per_s.most = next(speed_rad_per_s.most, most_Nm, least_friction_Nm, most_friction_Nm);
}

// Once in each span.
bool EncoderWatch::mirrored(const WheelPair<Real>& speed_rad_per_s, const PlantModel<Real>& plant) {
    span_cycles_ = cycles_;
    cycles_ = 0;
    const auto& k = plant.dynamics;
    full_rad_per_s_ =
        std::max(k.k7_per_kg_m, k.k8_per_kg_m2 * plant.geometry.track_m / 2) * settings_.full_impulse_Ns;
    newest_ = (newest_ + 1) % kInstants;
    instants_[newest_] = {speed_rad_per_s, expected_rad_per_s_};
    instants_known_ = std::min(instants_known_ + 1, int(kInstants));
    if (instants_known_ <= kSpans) return false;
    const Instant& now = instants_[newest_];
    const Instant& last = instants_[(newest_ - 1) % kInstants];
    const WheelPair<Real> expected{now.expected_rad_per_s.left - last.expected_rad_per_s.left,
                                   now.expected_rad_per_s.right - last.expected_rad_per_s.right};
    const WheelPair<Real> told{now.speed_rad_per_s.left - last.speed_rad_per_s.left,
                               now.speed_rad_per_s.right - last.speed_rad_per_s.right};
    // By the wheel that is more as expected, as the other one may lie.
    const Real left_off = std::abs(told.left - expected.left);
    const Real right_off = std::abs(told.right - expected.right);
    const Real unexpected = std::min(left_off, right_off);
    const Real most_off = std::max(left_off, right_off);
    spans_averaged_ = std::min(spans_averaged_ + 1, kAveraged);
    unexpected_rad_per_s_ += (unexpected - unexpected_rad_per_s_) / Real(spans_averaged_);

    const Instant& from = instants_[(newest_ - kSpans) % kInstants];
    const Lie lie = turned_round(from, now);
    const bool turned = lie != Lie::none && lie == turned_round(from, last);
    const Real body_rad_per_s = knows_body(k) ? 0 : by_unknown_body(speed_rad_per_s, plant.geometry);
    const Real least =
        std::max(kGainShare * full_rad_per_s_, kGainBeyondNoise * (unexpected_rad_per_s_ + body_rad_per_s));
    const bool left = against(0, expected, told, least);
    const bool right = against(1, {expected.right, expected.left}, {told.right, told.left}, least);
    const bool exchanged = settings_.known_friction_Nm > 0
                               ? against_push(speed_rad_per_s, told, plant)
                               : gains_against(from, now, most_off, body_rad_per_s);
    const bool is_scaled = leapt_.spans != 0 && scaled(expected);
    const bool leaps = most_off >= full_rad_per_s_;
    if (leaps_ && !leaps && leapt_.spans == 0) leap();
    leaps_ = leaps;
    return turned || left || right || exchanged || is_scaled;
}

// Whether a wheel's speed has leapt to a part of itself while the other wheel did as expected, and has since
// gained the same part of what it should. What truly slows one wheel pulls at the other one too, and lets it
// gain as before, or less by another part. `expected`: gains in the last span.
bool EncoderWatch::scaled(const WheelPair<Real>& expected) {
    const auto of = [this](const WheelPair<Real>& pair) { return leapt_.right ? pair.right : pair.left; };
    const Real now = of(instants_[newest_].speed_rad_per_s);
    leapt_.should_rad_per_s += of(expected);
    if (++leapt_.spans <= kSettled) {
        leapt_.from_rad_per_s = leapt_.should_rad_per_s;
        leapt_.told_rad_per_s = now;
        return false;
    }
    const Real share = leapt_.told_rad_per_s / leapt_.from_rad_per_s;
    const Real gained = leapt_.should_rad_per_s - leapt_.from_rad_per_s;
    // So far apart are the speeds that a scale and a push foretell.
    const Real apart = std::abs((1 - share) * gained);
    const Real noise = kBeyondNoise * unexpected_rad_per_s_;
    if (apart >= full_rad_per_s_ && apart * apart >= Real(leapt_.spans) * noise * noise) {
        const Real off = now - leapt_.told_rad_per_s - share * gained;
        if (!(std::abs(off) <= kScaleDoubt * apart)) {
            leapt_ = {};
            return false;
        }
        // one that is nearly as foretold counts twice
        leapt_.scaled_spans += std::abs(off) <= kScaleDoubt / 2 * apart ? 2 : 1;
        if (leapt_.scaled_spans >= int(kInstants)) return true;
    }
    const bool a_part = share >= kLeastShare && share <= 1 - kLeastShare;
    if (!a_part || leapt_.spans >= kMostSpansAfterLeap) leapt_ = {};
    return false;
}

// A leap has ended: whether it was one wheel's speed, by more than any torque or brake makes.
void EncoderWatch::leap() {
    if (instants_known_ < int(kInstants)) return;
    const Instant& now = instants_[newest_];
    const Instant& from = instants_[(newest_ - kLeapSpans) % kInstants];
    const auto should = [&](Real WheelPair<Real>::*wheel) {
        return from.speed_rad_per_s.*wheel + (now.expected_rad_per_s.*wheel - from.expected_rad_per_s.*wheel);
    };
    const Real left = std::abs(now.speed_rad_per_s.left - should(&WheelPair<Real>::left));
    const Real right = std::abs(now.speed_rad_per_s.right - should(&WheelPair<Real>::right));
    const bool by_much = std::max(left, right) > Real(kLeapSpans) * full_rad_per_s_;
    if (!by_much || std::min(left, right) > kLeaptAlone * std::max(left, right)) return;
    leapt_.right = right > left;
    leapt_.should_rad_per_s = should(leapt_.right ? &WheelPair<Real>::right : &WheelPair<Real>::left);
    leapt_.spans = 1;
}

// What a body that turns may make of a wheel's speed in the last span, where nobody knows K5 and K6 yet: it
// may have its mass half a track away from the axle.
Real EncoderWatch::by_unknown_body(const WheelPair<Real>& speed_rad_per_s,
                                   const model::Geometry<Real>& g) const {
    const auto body = model::twist_from_wheel_speeds(g, speed_rad_per_s);
    const Real turning = std::abs(body.omega_rad_per_s);
    return Real(span_cycles_ * kObserverCycle_s) * turning *
           (g.track_m / 2 * turning + std::abs(body.v_m_per_s)) /
           std::min(g.wheel_radius_m.left, g.wheel_radius_m.right);
}

// Whether a wheel's speed is the mirror image of what torque and inertia have made of it, or the other
// wheel's. What truly turns it round in this time is twice as strong as full torque, and pushes the other
// wheel too; and a wall gives back less than half.
EncoderWatch::Lie EncoderWatch::turned_round(const Instant& from, const Instant& to) const {
    const Real least = std::max(
        {kSpans * full_rad_per_s_, kBeyondNoise * unexpected_rad_per_s_, settings_.creeping_rad_per_s});
    const Real left = from.speed_rad_per_s.left + (to.expected_rad_per_s.left - from.expected_rad_per_s.left);
    const Real right =
        from.speed_rad_per_s.right + (to.expected_rad_per_s.right - from.expected_rad_per_s.right);
    const WheelPair<Real>& told = to.speed_rad_per_s;
    const auto is = [](Real a, Real b, Real speed) { return std::abs(a - b) <= kLikeness * speed; };
    const Real left_size = std::abs(left);
    const Real right_size = std::abs(right);
    if (left_size >= least && is(told.left, -left, left_size) && is(told.right, right, left_size))
        return Lie::left;
    if (right_size >= least && is(told.right, -right, right_size) && is(told.left, left, right_size))
        return Lie::right;
    const Real apart = std::abs(left - right);
    if (apart >= 2 * least && is(told.left, right, apart / 2) && is(told.right, left, apart / 2))
        return Lie::swapped;
    return Lie::none;
}

// Whether the robot has long gained yaw rate against what is expected, by the same amount, or speed, as it
// does where the encoders are exchanged: their signs may be as well, where the drives are mounted as mirror
// images. What turns or pulls it against its torques does so until the loop has met it. `off_rad_per_s`: by
// how much a wheel has gained otherwise than expected in the last span, the larger of the two.
bool EncoderWatch::gains_against(const Instant& from, const Instant& to, Real off_rad_per_s,
                                 Real body_rad_per_s) {
    if (off_rad_per_s < kTurnShare * full_rad_per_s_) {
        turns_against_spans_ = goes_against_spans_ = 0;
        return false;
    }
    const auto gained = [](const WheelPair<Real>& a, const WheelPair<Real>& b) {
        return WheelPair<Real>{b.left - a.left, b.right - a.right};
    };
    const WheelPair<Real> expected = gained(from.expected_rad_per_s, to.expected_rad_per_s);
    const WheelPair<Real> told = gained(from.speed_rad_per_s, to.speed_rad_per_s);
    const auto against = [](int& spans, Real should, Real is, Real at_least) {
        const Real size = std::abs(should);
        spans = size >= at_least && std::abs(is + should) <= kLikeness * size ? spans + 1 : 0;
        return spans >= kAgainstSpans;
    };
    const bool turns =
        against(turns_against_spans_, expected.difference(), told.difference(),
                std::max(kTurnShare * 2 * kSpans * full_rad_per_s_,
                         kGainBeyondNoise * (unexpected_rad_per_s_ + kSpans * body_rad_per_s)));
    const bool goes =
        against(goes_against_spans_, expected.sum(), told.sum(), kGainShare * 2 * kSpans * full_rad_per_s_);
    return turns || goes;
}

// Whether a wheel has long gained speed against what is expected of it, by the same amount, while the other
// one does what is expected. `expected`, `told`: this wheel's gain in the last span first.
bool EncoderWatch::against(std::size_t wheel, const WheelPair<Real>& expected, const WheelPair<Real>& told,
                           Real least_rad_per_s) {
    const Real size = std::abs(expected.left);
    int& cycles = against_cycles_[wheel];
    if (size < least_rad_per_s) return false;  // tells nothing
    if (std::abs(told.left - expected.left) <= kLikeness * size) {
        cycles = 0;
    } else if (std::abs(told.left + expected.left) <= kLikeness * size &&
               std::abs(told.right - expected.right) <= kLikeness * size) {
        cycles += span_cycles_;
    }
    return cycles >= kAgainstCycles;
}

// What the torques alone make of the speeds, in a span.
void EncoderWatch::push(Real elapsed_s, const WheelPair<Real>& torque_Nm, const PlantModel<Real>& plant) {
    const auto& g = plant.geometry;
    const Real forward = plant.dynamics.k7_per_kg_m * torque_Nm.sum();
    const Real turning = plant.dynamics.k8_per_kg_m2 * torque_Nm.difference() * g.track_m / 2;
    if (cycles_ == 0) {
        push_rad_per_s_ = {};
        push_s_ = 0;
    }
    push_s_ += elapsed_s;
    push_rad_per_s_.left += elapsed_s * (forward - turning) / g.wheel_radius_m.left;
    push_rad_per_s_.right += elapsed_s * (forward + turning) / g.wheel_radius_m.right;
}

// Whether torques beyond friction have long made a wheel go their way and the other one go against it, or
// both against it in turning: then they are exchanged. A slope moves both wheels one way; a body that turns
// moves them too, if by less than the torques, whichever wheel tells the truth.
bool EncoderWatch::against_push(const WheelPair<Real>& speed_rad_per_s, const WheelPair<Real>& told,
                                const PlantModel<Real>& plant) {
    const WheelPair<Real>& push = push_rad_per_s_;
    const auto& g = plant.geometry;
    const auto turned_by_body = [&](Real left_rad_per_s) {
        const WheelPair<Real> speed{left_rad_per_s, speed_rad_per_s.right};
        if (!knows_body(plant.dynamics)) return by_unknown_body(speed, g);
        const auto rate =
            model::acceleration(plant.dynamics, model::twist_from_wheel_speeds(g, speed), WheelPair<Real>{});
        return push_s_ * (std::abs(rate.v_m_per_s2) + std::abs(rate.omega_rad_per_s2) * g.track_m / 2) /
               std::min(g.wheel_radius_m.left, g.wheel_radius_m.right);
    };
    const Real body_rad_per_s =
        std::max(turned_by_body(speed_rad_per_s.left), turned_by_body(-speed_rad_per_s.left));
    // What friction may make of a wheel's speed: its own and, where mass and inertia couple them, the
    // other's.
    const Real held_m_per_s =
        2 * push_s_ * settings_.known_friction_Nm *
        std::max(plant.dynamics.k7_per_kg_m, plant.dynamics.k8_per_kg_m2 * g.track_m / 2);
    const Real size = std::min(std::abs(push.left) - held_m_per_s / g.wheel_radius_m.left,
                               std::abs(push.right) - held_m_per_s / g.wheel_radius_m.right);
    if (size < kGainBeyondNoise * (unexpected_rad_per_s_ + body_rad_per_s)) return false;  // tells nothing
    const Real left = told.left / push.left;
    const Real right = told.right / push.right;
    const bool turning = std::signbit(push.left) != std::signbit(push.right);
    const auto lies = [this, turning](int& cycles, Real share, Real other) {
        if (share >= kGainOfPush) cycles = 0;
        if (share <= -kGainOfPush && (turning ? std::abs(other) : other) >= kGainOfPush)
            cycles += span_cycles_;
        return cycles >= kAgainstPushCycles;
    };
    const bool left_lies = lies(against_push_cycles_[0], left, right);
    const bool right_lies = lies(against_push_cycles_[1], right, left);
    return left_lies || right_lies;
}

}  // namespace wheelwright::control
