// What the ident mode does before it excites: finds out gently what robot this is.
//
//   rest       noise of the angles
//   left       torque on the left wheel alone, rising slowly until it moves: sign, breakaway friction
//   right      the same on the right
//   forward    both wheels forward with a moderate torque, then the same torque backwards until it stands
//   turning    the same in place: rough K7 and K8, friction, how the wheels act on each other, and what
//              speed does (speed_witness.hpp)
//   brisk      where that does not tell whether one wheel goes backwards, or whether one that seems to be
//              alone is on the floor: forward and turning once more, as fast as may be
//   pulses     short pulses, half and whole amplitude, forward: does the whole one give twice as much?
//
// A constant torque makes a parabola of the wheel's angle, whatever the noise of single samples; between a
// torque and its opposite friction cancels. No wheel gets faster than kSpeedShare of the speed limit, nor
// near what the yaw rate limit makes of it at the rims: one wheel may go backwards, and forward be turning.
//
// What is wrong with the robot has a name, IdentCause, before anything moves fast: a wheel that goes against
// its torque from rest, one that stands where it has moved before, one that is dragged further than the wheel
// that is pushed, and one that a brake makes quicker.
//
// One call of step() a cycle, less than 300 operations, but for the one that ends a parabola (about 200
// more). No allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "firmware/ident/lifted_wheel.hpp"
#include "firmware/ident/mirror_test.hpp"
#include "firmware/ident/parabola.hpp"
#include "firmware/ident/ramp_answer.hpp"
#include "firmware/ident/side_witness.hpp"
#include "firmware/ident/speed_witness.hpp"
#include "firmware/ident/student.hpp"
#include "firmware/ident/torque_reports.hpp"
#include "firmware/model/dynamics.hpp"
#include "firmware/model/types.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"

namespace wheelwright::ident {

using protocol::IdentCause;

// Of the friction: a torque that moves a robot enough to learn from.
inline constexpr double kMovesEnough = 1.5;

// Ends after which no loop may close over the encoders. A robot that the probe moves so gently is out of its
// room by their leap, if not by somebody's hands.
constexpr bool doubts_encoders(IdentCause cause) {
    using enum protocol::IdentCause;
    return cause == left_wheel_does_not_turn || cause == right_wheel_does_not_turn ||
           cause == left_wheel_against_torque || cause == right_wheel_against_torque || cause == no_room;
}

struct ProbeOptions {
    model::Geometry<double> geometry;
    double sample_time_s{};
    double sample_age_s{};  // of the angles when they are handed over; two cycles where encoders report each
    double report_period_s{};  // of the encoders; 0: each cycle
    double torque_limit_Nm{};
    double amplitude_Nm{};  // torque that the pulses shall try; 0: the torque limit
    double speed_limit_m_per_s{};
    double yaw_rate_limit_rad_per_s{};
    double distance_limit_m{};
    double overshoot = 1.3;                      // of a limit at which the run stops
    double pose_noise_m{}, heading_noise_rad{};  // of the external pose
};

// What a cycle hands over.
struct ProbeSample {
    WheelPair<double> angle_rad;
    bool usable = true;                   // the angles are new
    WheelPair<double> reported_Nm;        // by the drives,
    std::array<bool, 2> report_is_new{};  // in this cycle
    bool pose_is_new = false;             // an external pose came
    Pose<double> pose;
    double encoder_lag_s = 0;  // of the slower drive's encoder loop, as far as it is known
};

struct ProbeFindings {
    IdentCause fault = IdentCause::none;
    double angle_noise_rad{};               // standard deviation of an angle while turning
    double rest_noise_rad{};                // and while nothing moves
    double encoder_lag_s{};                 // of the slower drive's encoder loop
    WheelPair<double> breakaway_Nm;         // torque at which each wheel moved
    double friction_Nm{};                   // of a wheel while sliding, mean
    double k7_per_kg_m{}, k8_per_kg_m2{};   // rough
    WheelPair<double> pushed_m_per_s2_Nm;   // rim acceleration of each wheel by its own torque
    WheelPair<double> dragged_m_per_s2_Nm;  // and by the other one's
    bool on_floor = false;                  // the wheel that moves more; false: not known
    double torque_limit_Nm{};               // what the drives deliver at most, as far as it was tried
    bool clipped = false;                   // less than was asked
    bool clipped_by_report = false;         // the drives' own reports say so; otherwise the motion does
    double report_ratio = 1;                // reported over asked where nothing clips
    bool reports = false;                   // the drives report their torque
    bool pose_seen = false;                 // an external pose has confirmed which wheel is which
    bool signs_agree = false;               // what speed does shows that not one wheel alone goes backwards
    bool signs_known() const { return pose_seen || signs_agree; }
};

class Probe {
  public:
    void start(const ProbeOptions& options) {
        *this = Probe{};
        options_ = options;
        found_.torque_limit_Nm = tried_Nm();
        sides_.start(options.geometry, options.pose_noise_m, options.heading_noise_rad);
        go(Stage::rest);
    }

    // The torque for this cycle; zero when finished.
    WheelPair<double> step(const ProbeSample& sample) {
        if (finished()) return {};
        ++stage_cycles_;
        take(sample);
        if (wheel_standing() != IdentCause::none) end(wheel_standing());
        switch (stage_) {
            case Stage::rest:
                torque_ = {};
                rest();
                break;
            case Stage::left:
            case Stage::right:
                ramp();
                break;
            case Stage::pause:
                torque_ = {};
                pause();
                break;
            case Stage::forward:
            case Stage::turning:
                push();
                break;
            case Stage::pulses:
                pulse();
                break;
            case Stage::done:
                break;
        }
        if (finished()) torque_ = {};
        return torque_;
    }

    bool finished() const { return stage_ == Stage::done; }
    const ProbeFindings& findings() const { return found_; }

    // A wheel that has run away from a push that hardly moved the other one: where that ends the probe, there
    // is likely no floor below it. (A weak drive with a centre of gravity beside the middle may do that as
    // well, so it ends nothing by itself.) none: the robot is pushed as a whole, or not at all.
    IdentCause wheel_running_free() const {
        return ran_free_ != IdentCause::none || leg_ != 0 ? ran_free_ : running_free();
    }

    // A wheel that is pushed stands to the digit, and has since the other one has turned: held fast, or its
    // encoder is.
    IdentCause wheel_standing() const {
        if (std::abs(angle_.right - left_changed_.right) > kMostUnseen_rad) return does_not_turn(false);
        if (std::abs(angle_.left - right_changed_.left) > kMostUnseen_rad) return does_not_turn(true);
        return IdentCause::none;
    }

  private:
    enum class Stage : std::uint8_t { rest, left, right, forward, turning, pulses, pause, done };

    // Seconds below are of a person's patience and of the drives' delay, of which none is longer than 6 ms.
    static constexpr double kRest_s = 0.4;
    static constexpr double kRamp_s = 2.0;  // from zero to the torque limit
    static constexpr double kLongestPush_s = 1.2;
    static constexpr double kShortestPush_s = 0.03;
    static constexpr double kNeverStanding_s = 0.1;  // a robot that may drive at all goes millimetres in it
    static constexpr double kLongestPause_s = 1.5;
    static constexpr double kStill_s = 0.25;     // at rest before the next stage; some external poses come
    static constexpr double kSettle_s = 0.010;   // after a change of torque: delay and lag
    static constexpr double kSpeedShare = 0.3;   // of the speed limit
    static constexpr double kEitherShare = 0.5;  // of what holds in either reading: what a speed that is seen
                                                 // late goes beyond it is less than as much again
    static constexpr double kBriskShare = 0.9;   // of the same, where that is reckoned with,
    static constexpr double kWorthBrisk = 1.25;  // and is more than that: speed's share goes with its square
    static constexpr double kLongestDelay_s = 0.006;
    static constexpr int kQuickCycles = 3;         // by the noise of a speed, seldom that many in a row
    static constexpr double kRoomShare = 0.06;     // of the room, for one push
    static constexpr double kMoved_rad = 0.012;    // two steps of the coarsest encoder, 1000 counts a turn
    static constexpr double kNoises = 8;           // and of the noise
    static constexpr double kFarMore = 5;          // times what a wheel that moves has moved
    static constexpr double kReportAge_s = 0.004;  // about: lag, bus, and the cycle's own age
    static constexpr double kSteadyRamp_s = 0.15;  // then the age is a small share of the ramp
    static constexpr double kUnclipped = 0.97;     // of what was asked
    static constexpr double kSure = 4;             // standard errors
    static constexpr double kMostFriction = 0.8;   // of a torque, that pulses still move against
    static constexpr double kFitShare = 0.9;       // of a pulse; at its end the wheel may stand
    static constexpr double kShortestFit_s = 0.010;
    static constexpr double kLongestPulse_s = 0.25;
    static constexpr double kPulseShare = 0.8;       // of the speed that may be reached: K7 is rough
    static constexpr double kLessTorque = 0.84;      // four such steps are a half
    static constexpr double kPushesRoomShare = 0.2;  // of the room, for all pushes forward
    static constexpr double kLeastPush = 1.1;        // of what has moved the wheels
    static constexpr double kMoves = 0.25;           // of the other wheel's speed
    static constexpr double kStops = 0.1;            // of a wheel's own, seen late
    static constexpr int kFewestPushes = 2;
    static constexpr int kFewestEitherWay = 4;  // two each way have a standard error
    static constexpr int kMostPushes = 8;
    static constexpr int kMostHalvings = 6;
    static constexpr std::size_t kFewestPulses = 3;
    static constexpr std::size_t kMostPulses = 8;
    static constexpr std::size_t kSpeedSpan = 16;
    static constexpr std::size_t kRing = 64;  // three times two reports each 10 ms

    // A wheel while a pause brakes: its speed, smoothed as a single one is noisy, and the least of it.
    struct Braked {
        double speed_m_per_s = -1, slowest_m_per_s = 0;
        bool quicker = false;  // than it was

        void take(double seen_m_per_s, double by_chance_m_per_s) {
            constexpr double kCycles = 8;
            if (speed_m_per_s < 0) speed_m_per_s = slowest_m_per_s = seen_m_per_s;
            speed_m_per_s += (seen_m_per_s - speed_m_per_s) / kCycles;
            slowest_m_per_s = std::min(slowest_m_per_s, speed_m_per_s);
            quicker = quicker || speed_m_per_s > slowest_m_per_s + by_chance_m_per_s;
        }
    };

    // What is seen of encoders that report less often than each cycle is so much older.
    double later_s() const { return std::max(options_.sample_age_s - 2 * options_.sample_time_s, 0.0); }
    double settle_s() const { return kSettle_s + later_s(); }
    // Three reports more.
    double shortest_fit_s() const { return kShortestFit_s + 2 * later_s(); }

    double tried_Nm() const {
        return options_.amplitude_Nm > 0 ? std::min(options_.amplitude_Nm, options_.torque_limit_Nm)
                                         : options_.torque_limit_Nm;
    }

    // Of the rims, straight on and turning. Until it is known that both wheels go the way that the file says,
    // the one may be the other.
    double rim_limit_m_per_s() const {
        const Twist<double> limits{options_.speed_limit_m_per_s, options_.yaw_rate_limit_rad_per_s};
        return found_.signs_known() ? limits.v_m_per_s
                                    : within_either(limits, options_.geometry.track_m / 2).v_m_per_s;
    }
    double fast_m_per_s() const { return std::max(gently_m_per_s(), brisk_m_per_s_); }
    double gently_m_per_s() const {
        return std::min(kSpeedShare * options_.speed_limit_m_per_s, kEitherShare * rim_limit_m_per_s());
    }
    // How long a speed goes on to grow until it is seen and the torque has changed.
    double unseen_s() const {
        return (kSpeedSpan / 2.0 + kQuickCycles) * options_.sample_time_s + kLongestDelay_s + later_s();
    }
    // As the answers to pushes are known: what is seen late still stays within.
    double briskly_m_per_s() const {
        const auto quickest = [](const WheelPair<double>& by_Nm) {
            return std::max(std::abs(by_Nm.left), std::abs(by_Nm.right));
        };
        return kBriskShare * rim_limit_m_per_s() -
               unseen_s() * push_Nm_ *
                   (quickest(found_.pushed_m_per_s2_Nm) + quickest(found_.dragged_m_per_s2_Nm));
    }

    void go(Stage stage) {
        stage_ = stage;
        stage_cycles_ = 0;
        if (stage != Stage::pause) {
            begin_ = angle_;
            begin_rad_per_s_ = speed_;
            cut_short_ = false;
            ramped_ = stage;
        }
        torque_ = {};
        leg_ = 0;
        leg_cycles_ = 0;
    }
    void rest_then(Stage next) {
        next_ = next;
        go(Stage::pause);
        still_cycles_ = 0;
        still_at_ = angle_;
        braked_ = {};
        sides_.forget();
    }
    void end(IdentCause fault) {
        found_.fault = fault;
        go(Stage::done);
    }
    static constexpr IdentCause against_torque(bool right) {
        return right ? IdentCause::right_wheel_against_torque : IdentCause::left_wheel_against_torque;
    }
    static constexpr IdentCause does_not_turn(bool right) {
        return right ? IdentCause::right_wheel_does_not_turn : IdentCause::left_wheel_does_not_turn;
    }
    double stage_s() const { return stage_cycles_ * options_.sample_time_s; }

    void take(const ProbeSample& sample) {
        ++cycle_;
        if (sample.usable) {
            const auto& [oldest, then] = ring_[(ring_at_ - kSpeedSpan) % kRing];
            if (ring_at_ >= kSpeedSpan) {  // longer ago where cycles had no angle
                const double span_s = (cycle_ - then) * options_.sample_time_s;
                speed_ = {(sample.angle_rad.left - oldest.left) / span_s,
                          (sample.angle_rad.right - oldest.right) / span_s};
            }
            ring_[ring_at_ % kRing] = {sample.angle_rad, cycle_};
            ++ring_at_;
            angle_ = sample.angle_rad;
            if (ramped_ == Stage::left) note_ramp(0, angle_.left, oldest.left, begin_.left, speed_.left);
            if (ramped_ == Stage::right) note_ramp(1, angle_.right, oldest.right, begin_.right, speed_.right);
            if (ring_at_ == 1) begin_ = angle_;
            if (torque_.left == 0 || angle_.left != left_changed_.left) left_changed_ = angle_;
            if (torque_.right == 0 || angle_.right != right_changed_.right) right_changed_ = angle_;
        }
        usable_ = sample.usable;
        report_ = sample.reported_Nm;
        report_is_new_ = sample.report_is_new;
        found_.encoder_lag_s = sample.encoder_lag_s;
        if (sample.pose_is_new) sides_.add(sample.pose);
    }

    WheelPair<double> moved() const { return {angle_.left - begin_.left, angle_.right - begin_.right}; }
    WheelPair<double> rim_speed() const {
        return {speed_.left * options_.geometry.wheel_radius_m.left,
                speed_.right * options_.geometry.wheel_radius_m.right};
    }
    double breakaway_Nm() const { return std::max(found_.breakaway_Nm.left, found_.breakaway_Nm.right); }
    double moved_enough() const { return std::max(kMoved_rad, kNoises * rest_noise_rad_); }

    void rest() {
        if (usable_ && stage_s() > kRest_s / 4) {
            rest_fit_.add(stage_s(), angle_.left);
            rest_fit_other_.add(stage_s(), angle_.right);
        }
        if (stage_s() < kRest_s) return;
        rest_noise_rad_ =
            std::sqrt(std::max(rest_fit_.residual_variance(), rest_fit_other_.residual_variance()));
        const WheelPair<double> m = moved();
        if (std::max(std::abs(m.left), std::abs(m.right)) > kFarMore * moved_enough())
            return end(IdentCause::not_at_rest);
        sides_.halt(0, angle_);
        go(Stage::left);
    }

    // One wheel alone.
    void ramp() {
        const bool right = stage_ == Stage::right;
        const WheelPair<double> m = moved();
        const auto [mine, other] = right ? std::pair{m.right, m.left} : std::pair{m.left, m.right};
        double& breakaway = right ? found_.breakaway_Nm.right : found_.breakaway_Nm.left;
        // it goes further than the wheel that it drags
        if (std::abs(other) > std::abs(mine) + kFarMore * moved_enough()) return end(does_not_turn(right));
        const double torque =
            std::min(options_.torque_limit_Nm * stage_s() / kRamp_s, options_.torque_limit_Nm);
        if (std::abs(mine) > moved_enough()) {
            breakaway = torque;
            if (mine < 0) return end(against_torque(right));
            return rest_then(right ? Stage::forward : Stage::right);
        }
        if (stage_s() > kRamp_s + kRest_s) {
            breakaway = 0;
            if (!right) return rest_then(Stage::right);
            return end(found_.breakaway_Nm.left > 0 ? does_not_turn(right) : IdentCause::too_heavy);
        }
        torque_ = right ? WheelPair<double>{0, torque} : WheelPair<double>{torque, 0};
        if (stage_s() > kSteadyRamp_s) compare_report(0);
    }

    // Adds to the power of an angle's noise, and takes its root: third differences over a few samples, or
    // over two reports, for angles nearer to each other may rest on the same one. What is smooth, even a
    // torque's noise, leaves next to nothing in them. `moved_alike_s`: since a torque has changed.
    void measure_noise(double moved_alike_s, Mean& power, double& noise_rad) {
        const double report_samples = 2 * options_.report_period_s / options_.sample_time_s;
        const auto apart = std::max<std::size_t>(4, static_cast<std::size_t>(std::lround(report_samples)));
        const std::size_t span = 3 * apart;
        const double span_s = static_cast<double>(span) * options_.sample_time_s;
        const auto before = [&](std::size_t samples) { return ring_[(ring_at_ - 1 - samples) % kRing]; };
        if (span >= kRing || moved_alike_s <= 2 * settle_s() || moved_alike_s <= 2 * later_s() + span_s ||
            cycle_ - before(span).cycle != span)
            return;
        const auto third = [&](double WheelPair<double>::*side) {
            return before(0).angle.*side - 3 * before(apart).angle.*side + 3 * before(2 * apart).angle.*side -
                   before(span).angle.*side;
        };
        constexpr double kPower = 1 + 9 + 9 + 1;
        const double left = third(&WheelPair<double>::left), right = third(&WheelPair<double>::right);
        power.add((left * left + right * right) / (2 * kPower));
        noise_rad = std::sqrt(power.mean());
    }

    // Until the robot stands for a while.
    void pause() {
        if (stage_ != Stage::pause) return;
        const WheelPair<double> v = rim_speed();
        const auto& r = options_.geometry.wheel_radius_m;
        const double noise_m = std::max(r.left, r.right) * rest_noise_rad_;
        const double slow = 0.02 * options_.speed_limit_m_per_s;
        // In kStill_s it may go no further than slowly, beyond what noise makes of a place.
        const double gone = std::max(r.left * std::abs(angle_.left - still_at_.left),
                                     r.right * std::abs(angle_.right - still_at_.right));
        if (gone > slow * kStill_s + kNoises * noise_m) {
            still_at_ = angle_;
            still_cycles_ = 0;
            sides_.forget();
        }
        // A robot that hardly rubs rolls on: stopped by a torque of its own friction, below what would start
        // it.
        const double fastest = std::max(std::abs(v.left), std::abs(v.right));
        const double by_noise = kSure * noise_m / (kSpeedSpan * options_.sample_time_s);
        // But not where it makes one wheel quicker, whose encoder may tell the wrong way: on a slope both
        // are.
        if (fastest > slow + by_noise && stage_s() > kStill_s) {
            braked_[0].take(std::abs(v.left), slow / 4 + by_noise / 4);
            braked_[1].take(std::abs(v.right), slow / 4 + by_noise / 4);
            if (braked_[0].quicker == braked_[1].quicker)
                torque_ = {-brake_Nm(found_.breakaway_Nm.left, v.left, slow),
                           -brake_Nm(found_.breakaway_Nm.right, v.right, slow)};
        }
        ++still_cycles_;
        // after a push, as a drive's encoder loop is known then or is not, in both
        if (usable_ && (ramped_ == Stage::forward || ramped_ == Stage::turning))
            measure_noise(still_cycles_ * options_.sample_time_s - kStill_s / 2, rest_noise_power_,
                          found_.rest_noise_rad);
        if (still_cycles_ * options_.sample_time_s < kStill_s) {
            if (stage_s() < kLongestPause_s) return;
            if (braked_[0].quicker != braked_[1].quicker && fastest > slow + by_noise)
                return end(against_torque(braked_[1].quicker));
        }
        const Stage next = next_;
        if (next == Stage::forward) {
            if (!(found_.breakaway_Nm.left > 0)) return end(does_not_turn(false));
            if (stage_before_ != Stage::forward) sides_.halt(0, angle_);  // all pushes count; but brisk ones
        }
        if (next == Stage::turning && stage_before_ == Stage::forward) sides_.halt(1, angle_);
        if (next == Stage::pulses && level_Nm_ == 0) {
            sides_.halt(2, angle_);
            if (judge_coupling() || judge_sides() || judge_answers()) return;
            if (!found_.signs_known() && go_briskly()) return;
        }
        if (next == Stage::done) return end(IdentCause::none);
        if ((next == Stage::forward || next == Stage::turning) && next != stage_before_) {
            choose_push();
            pushes_ = 0;
            answered_ = {};
            push_begin_ = angle_;
        }
        stage_before_ = next;
        go(next);
        if (next == Stage::pulses) {
            if (level_Nm_ == 0) {
                level_Nm_ = tried_Nm();
                if (pulse_speed_m_per_s(kSettle_s + kShortestFit_s) >
                    options_.overshoot * options_.speed_limit_m_per_s)
                    return end(IdentCause::no_room);
                // with reports that come seldom pulses are long, and need not be of all the torque
                if (later_s() > 0 || !found_.signs_known()) choose_level();
                found_.torque_limit_Nm = level_Nm_ > 0 ? level_Nm_ : push_Nm_;
                first_level_Nm_ = level_Nm_;
                if (level_Nm_ == 0) return end(IdentCause::none);
            }
            choose_pulse();
        }
    }
    static double brake_Nm(double breakaway_Nm, double speed, double slow) {
        return breakaway_Nm * std::clamp(speed / (2 * slow), -1.0, 1.0);
    }

    bool go_briskly() {
        if (sides_.poses_come() || brisk_m_per_s_ > 0) return false;
        const double brisk = briskly_m_per_s();
        if (!(brisk > kWorthBrisk * gently_m_per_s())) return false;
        brisk_m_per_s_ = brisk;
        slow_witness_ = speed_witness_;
        speed_witness_ = {};
        stage_before_ = Stage::done;
        rest_then(Stage::forward);
        return true;
    }
    Mirror judge_mirror() const {
        return brisk_m_per_s_ > 0 ? speed_witness_.judge_mirror(slow_witness_)
                                  : speed_witness_.judge_mirror();
    }

    // Mean speed and way of the span that speeds are seen in.
    void note_ramp(std::size_t wheel, double angle, double oldest, double begin, double speed) {
        const double way = (angle + oldest) / 2 - begin;
        if (2 * way > moved_enough()) ramps_[wheel].note(speed, way);
    }
    // Of the rims.
    WheelPair<double> ramped_m_per_s2_Nm() const {
        const double rise_Nm_per_s = options_.torque_limit_Nm / kRamp_s;
        const WheelPair<double>& r = options_.geometry.wheel_radius_m;
        return {r.left * ramps_[0].per_Nm(rise_Nm_per_s), r.right * ramps_[1].per_Nm(rise_Nm_per_s)};
    }

    // Well above friction, well below what is fast: also below what would be, until it is seen.
    void choose_push() {
        push_Nm_ = std::clamp(std::max(2 * breakaway_Nm(), 0.15 * options_.torque_limit_Nm), 0.0,
                              options_.torque_limit_Nm);
        const double unseen_m_per_s2 = kEitherShare * rim_limit_m_per_s() / unseen_s();
        const auto& [left, right] = found_.breakaway_Nm;
        const WheelPair<double> answer = ramped_m_per_s2_Nm();
        // a wheel that has not told its answer divides by zero
        const double most =
            std::min(left + unseen_m_per_s2 / answer.left, right + unseen_m_per_s2 / answer.right);
        push_Nm_ = std::max(std::min(push_Nm_, most), std::min(push_Nm_, kLeastPush * breakaway_Nm()));
    }

    // There, then back with the opposite torque.
    void push() {
        const bool turning = stage_ == Stage::turning;
        const WheelPair<double> v = rim_speed();
        const WheelPair<double> m = moved();
        const auto& r = options_.geometry.wheel_radius_m;
        const double sign_left = turning ? -1 : 1;
        const double speed = push_sense() * (v.right + sign_left * v.left) / 2;
        const double way = std::max(std::abs(m.left * r.left), std::abs(m.right * r.right));
        const double fast = fast_m_per_s();
        const double fastest = std::max(std::abs(v.left), std::abs(v.right));
        const double leg_s = ++leg_cycles_ * options_.sample_time_s;
        const double sense = leg_ == 0 ? push_sense() : -push_sense();
        if (const IdentCause stands = standing_against_push(); stands != IdentCause::none) return end(stands);
        // beyond what it rolled before: its own torque is more to a wheel than what the other one's hands on
        // by mass and inertia
        const WheelPair<double> gone{sense * sign_left * m.left, sense * m.right};
        const double rolled =
            leg_s * std::max(std::abs(begin_rad_per_s_.left), std::abs(begin_rad_per_s_.right));
        if (leg_ == 0 && std::min(gone.left, gone.right) < -(moved_enough() + rolled))
            return end(against_torque(gone.right < gone.left));
        follow_until_stopped(v, fastest);
        if (leg_s > settle_s() && usable_) {
            if (rolls_[0]) fit_[leg_][0].add(leg_s, angle_.left);
            if (rolls_[1]) fit_[leg_][1].add(leg_s, angle_.right);
            compare_report(2 * settle_s());
            if (leg_ == 0)  // on its way back a wheel turns round
                measure_noise(leg_s, noise_power_, found_.angle_noise_rad);
        }
        if (leg_ == 0) {
            quick_cycles_ = fastest > fast ? quick_cycles_ + 1 : 0;
            const bool quick = quick_cycles_ >= kQuickCycles;
            if (quick || way > kRoomShare * options_.distance_limit_m || leg_s > kLongestPush_s) {
                ran_free_ = wheel_running_free();
                if (leg_s < kShortestPush_s + later_s()) {  // too quick to be seen: once more, gently
                    if (gentle_ == kMostHalvings)
                        return end(ran_free_ != IdentCause::none ? ran_free_ : IdentCause::no_room);
                    push_Nm_ = std::max(push_Nm_ / 2, kLeastPush * breakaway_Nm());
                    ++gentle_;
                    fit_ = {};
                    rest_then(stage_);
                    cut_short_ = true;
                    return;
                }
                leg_ = 1;
                leg_cycles_ = 0;
                went_s_ = leg_s;
                torque_ = {-sense * sign_left * push_Nm_, -sense * push_Nm_};
                return;
            }
        } else if ((speed <= 0 && leg_s > 2 * settle_s()) ||
                   leg_s > 2 * went_s_ + kShortestPush_s + later_s()) {
            return end_push(turning);
        }
        torque_ = {sense * sign_left * push_Nm_, sense * push_Nm_};
    }

    // More than what has moved it, and it does not move by half of its encoder's step, within which a drive's
    // slow loop may creep. Of two that stand the left one is named.
    IdentCause standing_against_push() {
        const double least_rad = kStepPerNoise / 2 * found_.angle_noise_rad;
        const std::array<double, 2> angle{angle_.left, angle_.right};
        for (std::size_t wheel = 0; wheel < 2; ++wheel) {
            auto& [at_rad, cycles] = stands_[wheel];
            if (leg_ != 0 || leg_cycles_ <= 1 || std::abs(angle[wheel] - at_rad) > least_rad) {
                at_rad = angle[wheel];
                cycles = 0;
            }
            if (cycles++ * options_.sample_time_s > kNeverStanding_s) return does_not_turn(wheel == 1);
        }
        return IdentCause::none;
    }

    // Friction turns round with a wheel. One that has hardly moved, beside a lifted one, tells all the same.
    void follow_until_stopped(const WheelPair<double>& v, double fastest) {
        const std::array<double, 2> speed{v.left, v.right};
        for (std::size_t wheel = 0; wheel < 2; ++wheel) {
            if (leg_ == 0) {
                rolls_[wheel] = true;
                went_m_per_s_[wheel] = std::abs(speed[wheel]) > kMoves * fastest ? speed[wheel] : 0;
            } else if (went_m_per_s_[wheel] != 0) {
                rolls_[wheel] = rolls_[wheel] && speed[wheel] / went_m_per_s_[wheel] > kStops;
            }
        }
    }
    // Without a pose that is to see where they lead, pushes go the other way by turns.
    double push_sense() const { return sides_.poses_come() || pushes_ % 2 == 0 ? 1 : -1; }

    void end_push(bool turning) {
        const auto& r = options_.geometry.wheel_radius_m;
        // per torque, friction cancelled
        const auto response = [&](std::size_t wheel, double radius) {
            return radius * (fit_[0][wheel].acceleration() - fit_[1][wheel].acceleration()) /
                   (2 * push_sense() * push_Nm_);
        };
        const auto sum = [&](std::size_t wheel, double radius) {
            return radius * (fit_[0][wheel].acceleration() + fit_[1][wheel].acceleration()) / 2;
        };
        answered_[0].add(response(0, r.left));
        answered_[1].add(response(1, r.right));
        speed_witness_.add(turning, push_sense() > 0, {sum(0, r.left), sum(1, r.right)});
        fit_ = {};
        if (push_again(turning)) return rest_then(stage_);
        const WheelPair<double> d{answered_[0].mean(), answered_[1].mean()};
        if (!turning) {
            forward_ = d;
            forward_error_ = {answered_[0].error(), answered_[1].error()};
            // what is left beside the torque's share is friction's
            const double both = (d.left + d.right) / 2;
            found_.friction_Nm = both > 0 ? std::max(0.0, speed_witness_.friction_m_per_s2() / both) : 0;
            k7_per_kg_m_ = both / 2;
            pushed_well_ = pushed_well();
        } else {
            pushed_well_ = pushed_well_ && pushed_well();
            const double k8 = (d.right - d.left) / 2 / options_.geometry.track_m;
            found_.pushed_m_per_s2_Nm = {(forward_.left - d.left) / 2, (forward_.right + d.right) / 2};
            own_error_ = {joint(forward_error_.left, answered_[0].error()) / 2,
                          joint(forward_error_.right, answered_[1].error()) / 2};
            found_.dragged_m_per_s2_Nm = {(forward_.left + d.left) / 2, (forward_.right - d.right) / 2};
            // the brakes work with these from now on
            if (k7_per_kg_m_ > 0 && k8 > 0 && answers_stand_out()) {
                found_.k7_per_kg_m = k7_per_kg_m_;
                found_.k8_per_kg_m2 = k8;
            }
        }
        rest_then(turning ? Stage::pulses : Stage::turning);
    }
    // Until wheels that answer unlike do so beyond noise, and an external pose, or else what speed does,
    // tells which way the wheels go.
    bool push_again(bool turning) {
        if (++pushes_ >= kMostPushes || !room_left()) return false;
        if (unlike_by_noise()) return true;
        if (sides_.poses_come()) return pushes_ < kFewestPushes || !sides_.would_tell(stage_way(), turning);
        return pushes_ < kFewestEitherWay || answers_unlike() ||
               (turning && judge_mirror() == Mirror::unknown);
    }
    // One wheel answers so much more than the other that it may be in the air.
    bool answers_unlike() const {
        const double left = std::abs(answered_[0].mean()), right = std::abs(answered_[1].mean());
        return std::max(left, right) > kAlone * std::min(left, right);
    }
    // And with this noise of the answers runs_free() could not say so.
    bool unlike_by_noise() const {
        const double unsure = kSure * std::max(answered_[0].error(), answered_[1].error());
        return answers_unlike() &&
               std::max(std::abs(answered_[0].mean()), std::abs(answered_[1].mean())) < kRunsFree * unsure;
    }
    // How the wheels have gone in this stage.
    SideWitness::Way stage_way() const { return sides_.rolled(push_begin_, angle_); }
    bool room_left() const {
        return std::abs(stage_way().forward_m) < kPushesRoomShare * options_.distance_limit_m;
    }

    double own_error() const { return kSure * std::max(own_error_.left, own_error_.right); }
    bool answers_stand_out() const {
        return std::max(found_.pushed_m_per_s2_Nm.left, found_.pushed_m_per_s2_Nm.right) > own_error();
    }
    bool judge_coupling() {
        if (!answers_stand_out()) return false;
        const WheelPair<double>& own = found_.pushed_m_per_s2_Nm;
        const double apart = std::max(own_error(), kPushedApart * std::max(own.left, own.right));
        const std::size_t quicker = own.right > own.left ? 1 : 0;
        found_.on_floor = speed_witness_.on_floor(quicker) || sides_.rolls(quicker);
        const IdentCause fault =
            wheel_off_ground({own, found_.dragged_m_per_s2_Nm}, own_error(), apart,
                             !found_.on_floor && (pushed_well_ || ran_free_ != IdentCause::none));
        if (fault != IdentCause::none) alone_ = fault;
        const bool sure = runs_free({own.left + own_error(), own.right + own_error()}) != IdentCause::none;
        if (alone_ == IdentCause::none || (found_.on_floor && !sure)) return false;
        // what speed does at more of it may still show the floor
        if (sure || !go_briskly()) end(alone_);
        return true;
    }
    // Of a sum of two, from theirs.
    static double joint(double error, double other) { return std::hypot(Real(error), Real(other)); }
    // Pushes that moved nothing, or nothing that stands out; or that moved a wheel well, until it stood.
    bool judge_answers() {
        const auto& own = found_.pushed_m_per_s2_Nm;
        if (found_.k7_per_kg_m > 0 && own.left > 0 && own.right > 0) return false;
        const bool right = own_error_.right > own_error_.left;
        const double went = right ? forward_.right : forward_.left;
        const double error = kSure * (right ? forward_error_.right : forward_error_.left);
        const bool stood = went > error && 2 * std::max(own_error_.left, own_error_.right) > error;
        end(answers_stand_out() ? does_not_turn(own.left > own.right)
            : stood             ? does_not_turn(right)
                                : IdentCause::no_room);
        return true;
    }
    IdentCause running_free() const {
        const bool pushed = stage_ == Stage::forward || stage_ == Stage::turning || cut_short_;
        if (!pushed) return IdentCause::none;
        const WheelPair<double> m = moved();
        const double unseen = moved_enough() / 2;  // what a wheel may have gone beside what is seen of it
        const WheelPair<double>& r = options_.geometry.wheel_radius_m;
        const IdentCause free =
            runs_free({r.left * (std::abs(m.left) + unseen), r.right * (std::abs(m.right) + unseen)});
        return pushed_well() || free == runs_free(ramped_m_per_s2_Nm()) ? free : IdentCause::none;
    }
    // So much above friction that a wheel does not hang in it for part of the time. With less, the ramps have
    // to say the same, each of which was by its own wheel's friction.
    bool pushed_well() const { return push_Nm_ >= kMovesEnough * breakaway_Nm(); }
    bool judge_sides() {
        IdentCause wrong = sides_.judge();
        found_.pose_seen = sides_.confirmed();
        if (!found_.pose_seen) {
            const Mirror seen = judge_mirror();
            found_.signs_agree = seen == Mirror::as_filed;
            if (wrong == IdentCause::none && seen == Mirror::mirrored) wrong = IdentCause::one_sign_wrong;
        }
        if (wrong != IdentCause::none) end(wrong);
        return wrong != IdentCause::none;
    }

    // ---- pulses

    // Forward and back to rest, backward and back to rest, with the whole amplitude; the same with half of
    // it; and all again. The first pulse of a pair lasts for pulse_s_, the second until friction and torque
    // have stopped the robot: within a pulse no wheel turns round, so friction cancels between the two.
    void choose_pulse() {
        const double shortest_s = shortest_pulse_s(settle_s() + shortest_fit_s());
        const double wanted_s = fast_m_per_s() / (level_Nm_ * quicker());
        pulse_s_ = std::clamp(wanted_s, shortest_s, std::max(shortest_s, kLongestPulse_s));
        begin_pulse();
    }
    // That a fit is made of `seen_s`, settling included, at half amplitude too.
    double shortest_pulse_s(double seen_s) const {
        const double friction = std::min(2 * found_.friction_Nm / level_Nm_, kMostFriction);
        return seen_s / kFitShare * (1 + friction) / (1 - friction);
    }
    // Rim acceleration by a torque on both wheels, of the wheel that has more.
    double quicker() const { return std::max(forward_.left, forward_.right); }
    // What the shortest whole pulse gets to.
    double pulse_speed_m_per_s(double seen_s) const {
        return (level_Nm_ - found_.friction_Nm) * quicker() * shortest_pulse_s(seen_s);
    }
    // As much of the amplitude as gets no faster than either reading allows. If that is less than moves the
    // robot, nothing beyond the pushes is tried.
    void choose_level() {
        while (pulse_speed_m_per_s(settle_s() + shortest_fit_s()) > kPulseShare * rim_limit_m_per_s()) {
            level_Nm_ *= kLessTorque;
            if (level_Nm_ / 2 > kMovesEnough * found_.friction_Nm) continue;
            level_Nm_ = 0;
            return;
        }
    }
    double pulse_Nm() const { return leg_ / 4 % 2 == 0 ? level_Nm_ : level_Nm_ / 2; }
    void begin_pulse() {
        constexpr std::array<double, 4> kSense{1, -1, -1, 1};
        const double friction = std::min(found_.friction_Nm / pulse_Nm(), kMostFriction);
        leg_s_ = leg_ % 2 == 0 ? pulse_s_ : pulse_s_ * (1 - friction) / (1 + friction);
        const double torque = kSense[leg_ % 4] * pulse_Nm();
        torque_ = {torque, torque};
        pulse_fit_ = {};
        leg_cycles_ = 0;
    }
    void pulse() {
        const double at_s = leg_cycles_++ * options_.sample_time_s;
        if (usable_ && at_s > settle_s() &&
            at_s <= std::max(kFitShare * leg_s_, settle_s() + shortest_fit_s())) {
            pulse_fit_[0].add(at_s, angle_.left);
            pulse_fit_[1].add(at_s, angle_.right);
            compare_report(2 * settle_s());
        }
        if (at_s < leg_s_) return;
        for (std::size_t wheel = 0; wheel < 2; ++wheel) {
            quadruple_[wheel] += pulse_fit_[wheel].acceleration() / (torque_.left > 0 ? 4 : -4);
            if (leg_ % 4 != 3) continue;
            answer_[leg_ / 4 % 2][wheel].add(quadruple_[wheel] / pulse_Nm());
            quadruple_[wheel] = 0;
        }
        ++leg_;
        if (leg_ % 8 == 0 && (leg_ >= 8 * kMostPulses || (leg_ >= 8 * kFewestPulses && pulses_tell())))
            return judge_pulses();
        begin_pulse();
    }
    struct Ratio {
        double value, error;
    };
    // Answer to the whole amplitude over that to half of it, per torque. kSure of its errors are sure.
    Ratio ratio_of(std::size_t wheel) const {
        const Mean& whole = answer_[0][wheel];
        const Mean& half = answer_[1][wheel];
        if (!(half.mean() > 0) || !(whole.mean() > 0)) return {1, 1};
        const double ratio = whole.mean() / half.mean();
        const double freedom = whole.count() + half.count() - 2.0;
        return {ratio, error_of_few(kSure, freedom) * ratio *
                           joint(whole.error() / whole.mean(), half.error() / half.mean())};
    }
    bool pulses_tell() const {
        return std::max(ratio_of(0).error, ratio_of(1).error) < (1 - kUnclipped) / kSure;
    }

    // Where the whole amplitude answers with less than twice the half, half of it may be clipped too: once
    // more from there, until a torque is found that nothing clips. The first answer over the last says what
    // arrives.
    void judge_pulses() {
        double ratio = 1, answer = 0;
        for (std::size_t wheel = 0; wheel < 2; ++wheel) {
            const Ratio r = ratio_of(wheel);
            if (r.value < kUnclipped && r.value + kSure * r.error < 1) ratio = std::min(ratio, r.value);
            answer += answer_[0][wheel].mean() / 2;
        }
        if (level_Nm_ == first_level_Nm_) first_answer_ = answer;
        found_.clipped_by_report = reports_.delivered_share() < kUnclipped;
        if (found_.clipped_by_report) {
            found_.clipped = true;
            found_.torque_limit_Nm = reports_.delivered_share() * first_level_Nm_;
        } else if (ratio < 1) {
            found_.clipped = true;
            level_Nm_ /= 2;
            answer_ = {};
            if (!(level_Nm_ / 2 > kMovesEnough * found_.friction_Nm))
                return end(IdentCause::torque_not_followed);
            return rest_then(Stage::pulses);
        } else if (found_.clipped) {
            found_.torque_limit_Nm = first_level_Nm_ * first_answer_ / answer;
        }
        rest_then(Stage::done);
    }

    // What the drives say against what they were told for `since_s` at least; on a ramp, what they were told
    // when they measured.
    void compare_report(double since_s) {
        const WheelPair<double>& told = torque_;
        const bool same = told.left == told_before_.left && told.right == told_before_.right;
        steady_cycles_ = same ? steady_cycles_ + 1 : 0;
        told_before_ = told;
        const bool ramping = stage_ == Stage::left || stage_ == Stage::right;
        if (!ramping && steady_cycles_ * options_.sample_time_s < since_s) return;
        using Level = TorqueReports::Level;
        const Level level = ramping                   ? Level::ramp
                            : stage_ != Stage::pulses ? Level::push
                            : pulse_Nm() < level_Nm_  ? Level::half
                                                      : Level::whole;
        const double then = ramping ? 1 - kReportAge_s / stage_s() : 1;
        if (report_is_new_[0] && told.left != 0) reports_.add(level, report_.left / (then * told.left));
        if (report_is_new_[1] && told.right != 0) reports_.add(level, report_.right / (then * told.right));
        found_.reports = reports_.any();
        found_.report_ratio = reports_.ratio();
    }

    ProbeOptions options_{};
    ProbeFindings found_{};
    Stage stage_ = Stage::done;
    Stage next_ = Stage::done;
    std::uint32_t stage_cycles_ = 0, still_cycles_ = 0, leg_cycles_ = 0, steady_cycles_ = 0;
    std::size_t leg_ = 0;
    WheelPair<double> torque_, told_before_, angle_, begin_, begin_rad_per_s_, still_at_, speed_, report_;
    std::array<bool, 2> report_is_new_{};
    struct Stands {
        double at_rad = 0;
        std::uint32_t cycles = 0;
    };
    std::array<Stands, 2> stands_{};
    bool usable_ = false, pushed_well_ = false;
    bool cut_short_ = false;      // a push was, in this pause
    Stage ramped_ = Stage::done;  // this stage, or the one before the pause
    struct Seen {
        WheelPair<double> angle;
        std::uint32_t cycle = 0;
    };
    std::array<Seen, kRing> ring_{};
    std::size_t ring_at_ = 0;
    std::uint32_t cycle_ = 0;
    Parabola rest_fit_, rest_fit_other_;
    double rest_noise_rad_ = 0;
    std::array<RampAnswer, 2> ramps_{};
    double k7_per_kg_m_ = 0;
    std::array<bool, 2> rolls_{};
    std::array<double, 2> went_m_per_s_{};
    std::array<Braked, 2> braked_{};
    double push_Nm_ = 0, went_s_ = 0, pulse_s_ = 0, leg_s_ = 0;
    std::array<double, 2> quadruple_{};
    std::array<std::array<Parabola, 2>, 2> fit_{};
    std::array<Parabola, 2> pulse_fit_{};
    WheelPair<double> forward_, forward_error_, own_error_;
    std::array<std::array<Mean, 2>, 2> answer_{};  // whole and half, each wheel
    Mean noise_power_, rest_noise_power_;
    WheelPair<double> push_begin_;
    WheelPair<double> left_changed_,
        right_changed_;  // both angles when this wheel's last changed, or was not pushed
    std::array<Mean, 2> answered_{};
    int pushes_ = 0, gentle_ = 0, quick_cycles_ = 0;
    IdentCause ran_free_ = IdentCause::none;  // in a push
    IdentCause alone_ = IdentCause::none;     // by all pushes
    Stage stage_before_ = Stage::done;
    double level_Nm_ = 0;  // of the whole pulses
    double first_level_Nm_ = 0;
    double first_answer_ = 0;  // to those at the torque that was to be tried
    TorqueReports reports_;
    SideWitness sides_;
    SpeedWitness speed_witness_, slow_witness_;
    double brisk_m_per_s_ = 0;
};

}  // namespace wheelwright::ident
