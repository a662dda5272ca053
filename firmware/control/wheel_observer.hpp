// Speed and angle of both wheels at the cycle's instant, from encoder positions that arrive at each drive's
// own phase.
//
// Per wheel a third-order filter of position (angle, speed, acceleration error). Between measurements it
// moves by the model's acceleration from the torque that acts *now*, that is the torque sent one actuation
// delay ago. With a right model it therefore lags behind nothing; a wrong model is corrected with the
// filter's bandwidth, and constant errors (friction, a slope) leave no bias. An error of K is not constant:
// it lasts as long as an acceleration does, and would make the estimate swing over afterwards. So the
// acceleration error is learned slowly, and hardly at all during accelerations beyond calm_acceleration. The
// acceleration that counts is what friction leaves: one with a mean goes with the noise of the innovations,
// and such a weight would shift the speed (by 4 % on a slow robot with coarse encoders).
//
// Each sample is compared with the state moved back to the sample's own time, so the drives' phases may
// differ and drift. Time stamps are smoothed, for a drive samples on its own regular clock, and frames
// arrive irregularly (arbitration).
//
// A drive may tell nonsense for one frame, or count anew from another origin. A sample that lies further from
// the one before than a wheel can have gone, as far as the samples before have shown this encoder, is not
// taken; four in a row that agree with each other are taken, and the angle goes on from where it was. A state
// that is no number begins anew with the next sample.
//
// One thread; no allocation. update(): about 570 instructions.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <limits>

#include "firmware/control/encoder_loop.hpp"
#include "firmware/control/feedback_linearisation.hpp"
#include "firmware/control/velocity_loop_speed.hpp"
#include "firmware/model/types.hpp"

namespace wheelwright::control {

// Gains on the innovation. The filter x' = x + T v + T^2/2 a, v' = v + T a, a' = a with corrections g e, h e
// / T, k e / T^2 has the characteristic polynomial
//   z^3 - (3 - g - h - k/2) z^2 + (3 - 2g - h + k/2) z - (1 - g),
// here with poles p, p, s; p = exp(-bandwidth T), s = exp(-kErrorShare bandwidth T).
template <typename Real>
struct ObserverGains {
    Real angle{};
    Real speed_per_s{};
    Real error_per_s2{};
    Real error_pole{};  // 1 - s
};

inline constexpr double kErrorShare = 0.15;

template <typename Real>
ObserverGains<Real> observer_gains(Real bandwidth_rad_per_s, Real period_s) {
    const Real p = std::exp(-bandwidth_rad_per_s * period_s);
    const Real s = std::exp(-Real(kErrorShare) * bandwidth_rad_per_s * period_s);
    const Real g = 1 - p * p * s;
    const Real k = (1 - p) * (1 - p) * (1 - s);
    const Real h = 3 - g - k / 2 - (2 * p + s);
    return {g, h / period_s, k / (period_s * period_s), 1 - s};
}

template <typename Real>
struct WheelObserverSettings {
    Real cycle_s{};
    Real encoder_period_s{};  // nominal period of the drives' encoder frames
    Real bandwidth_rad_per_s{};
    Real actuation_delay_s{};  // from a cycle's start to the centroid of its torque; at most 21 cycles
    Real calm_acceleration_rad_per_s2{};  // of a wheel, > 0
    // A gap in the samples after which the filter starts anew; older ones are not taken: a filter that is
    // corrected for the same thing by each of many late samples goes astray.
    Real restart_after_s = Real(0.02);
    Real fastest_rad_per_s{};                          // of a wheel at the speeds that are faults
    Real coarsest_step_rad = Real(kCoarsestStep_rad);  // by which an angle may leap at most
};

template <typename Real>
class WheelObserver {
  public:
    static constexpr std::size_t kTorqueMemory = 24;
    static constexpr std::size_t kSampleMemory = 8;  // power of two
    static constexpr int kNewOriginSamples = 4;      // that agree with each other are taken again

    void configure(const WheelObserverSettings<Real>& settings) {
        // of the fastest speed: by more a wheel's is not taken to change from one sample to the next
        constexpr Real kKick = Real(0.5);
        settings_ = settings;
        most_kick_rad_per_s_ = kKick * settings.fastest_rad_per_s;
        for (Wheel& wheel : wheels_) wheel.step = wheel.trusted > 0 ? settings.coarsest_step_rad : kAnywhere;
        gains_ = observer_gains(settings.bandwidth_rad_per_s, settings.encoder_period_s);
        period_ns_ = std::max<std::int64_t>(
            static_cast<std::int64_t>(std::lround(settings.encoder_period_s * Real(1e9))), 1);
        strange_after_ns_ = period_ns_ * 9 / 20;
        restart_after_ns_ = static_cast<std::int64_t>(std::lround(settings.restart_after_s * Real(1e9)));
        const Real cycles = settings.actuation_delay_s / settings.cycle_s;
        const Real whole = std::min(std::floor(cycles), Real(kTorqueMemory - 3));
        delay_cycles_ = static_cast<std::size_t>(std::max(whole, Real(0)));
        delay_fraction_ = std::clamp(cycles - whole, Real(0), Real(1));
    }

    void reset() {
        for (Wheel& wheel : wheels_) wheel = {};
        torque_ = {};
        turned_ = expected_ = {};
        motion_ = {};
        last_ns_ = 0;
    }

    // Advances to now_ns, the cycle's instant. Call once in each cycle, before torque_sent(). Samples not
    // newer than the last are ignored; of their speeds only the first is used.
    void update(std::int64_t now_ns, const EncoderSample& left, const EncoderSample& right,
                const PlantModel<Real>& plant) {
        const Real dt = last_ns_ == 0 ? settings_.cycle_s : seconds(now_ns - last_ns_);
        if (dt > Real(1.5) * settings_.cycle_s) {  // missed cycles: their torque was the last one
            const Real missed = std::min(std::round(dt / settings_.cycle_s) - 1, Real(kTorqueMemory));
            for (auto n = static_cast<std::size_t>(missed); n > 0; --n) torque_sent(torque_[newest_torque_]);
        }
        last_ns_ = now_ns;
        const WheelPair<Real> predicted = predict_acceleration(plant, dt);
        expected_ = {predicted.left - wheels_[0].error, predicted.right - wheels_[1].error};
        const WheelPair<Real> before{wheels_[0].angle, wheels_[1].angle};
        wheels_[0].advance(predicted.left, dt);
        wheels_[1].advance(predicted.right, dt);
        const bool had = valid();
        take(wheels_[0], left, now_ns, predicted.left);
        take(wheels_[1], right, now_ns, predicted.right);
        for (Wheel& wheel : wheels_) wheel.begin_anew_unless_finite();
        turned_ = had ? WheelPair<Real>{wheels_[0].angle - before.left, wheels_[1].angle - before.right}
                      : WheelPair<Real>{};
        for (Wheel& wheel : wheels_) wheel.rebase();
        motion_.wheel_speed_rad_per_s = {wheels_[0].speed, wheels_[1].speed};
        motion_.wheel_angle_rad = {Real(wheels_[0].base), Real(wheels_[1].base)};
        motion_.twist = model::twist_from_wheel_speeds(plant.geometry, motion_.wheel_speed_rad_per_s);
    }

    // The torque sent in this cycle (after every limit; what the drive was really told).
    void torque_sent(const WheelPair<Real>& torque_Nm) {
        newest_torque_ = newest_torque_ == 0 ? kTorqueMemory - 1 : newest_torque_ - 1;
        torque_[newest_torque_] = torque_Nm;
    }

    // Samples come by another clock from now on.
    void begin_new_clock() {
        for (Wheel& wheel : wheels_) wheel.new_clock = true;
    }

    // True once each wheel has been heard.
    bool valid() const { return wheels_[0].heard && wheels_[1].heard; }

    // Speeds, angles and twist at the last update's instant, and the heading that was set.
    const model::Motion<Real>& motion() const { return motion_; }

    // The encoders do not know it; effects may depend on it.
    void set_heading(Real heading_rad) { motion_.heading_rad = heading_rad; }

    // How far each wheel turned between the last two updates. Sums of it follow the encoders without drift.
    const WheelPair<Real>& turned_rad() const { return turned_; }

    // The torque in effect during the cycle that ended at the last update.
    WheelPair<Real> acting_torque_Nm() const {
        const WheelPair<Real>& late = torque_[(newest_torque_ + delay_cycles_) % kTorqueMemory];
        const WheelPair<Real>& early = torque_[(newest_torque_ + delay_cycles_ + 1) % kTorqueMemory];
        return {late.left + delay_fraction_ * (early.left - late.left),
                late.right + delay_fraction_ * (early.right - late.right)};
    }

    // Receive times of the newest samples that were taken; 0: none yet.
    std::array<std::int64_t, 2> taken_ns() const {
        return {wheels_[0].taken.time_ns, wheels_[1].taken.time_ns};
    }

    // Their angles, in which a drive's new origin has no part.
    WheelPair<double> taken_rad() const {
        return {wheels_[0].samples[wheels_[0].newest].position,
                wheels_[1].samples[wheels_[1].newest].position};
    }

    // Both wheels' samples are refused, again and again, at one time: no drive's new origin does that.
    bool both_leap() const { return wheels_[0].refused_alike > 1 && wheels_[1].refused_alike > 1; }

    // What the model alone expects of the wheels in the cycle that ended at the last update, rad/s^2.
    const WheelPair<Real>& expected_acceleration() const { return expected_; }

    // Acceleration the model did not explain, at the wheels, rad/s^2.
    WheelPair<Real> unexplained_acceleration() const { return {wheels_[0].error, wheels_[1].error}; }

    // Both wheels' angles at one instant, from the encoders alone (no model): the parabola through the three
    // nearest samples. False when the instant is not between stored samples (ask for 2 to 5 periods ago).
    bool angles_at(std::int64_t instant_ns, WheelPair<double>& angles_rad) const {
        return wheels_[0].angle_at(instant_ns, angles_rad.left) &&
               wheels_[1].angle_at(instant_ns, angles_rad.right);
    }

  private:
    static constexpr Real kAnywhere = std::numeric_limits<Real>::infinity();
    static constexpr double kWay_rad = 2 * kCoarsestStep_rad;

    struct Sample {
        std::int64_t time_ns = 0;
        double position = 0;
    };

    struct Wheel {
        double base =
            0;  // angle at the last update; `angle` counts from here, so that float keeps its digits
        Real angle{};
        Real speed{};
        Real error{};                  // acceleration error
        std::int64_t heard_ns = 0;     // receive time of the newest sample
        std::int64_t smoothed_ns = 0;  // its smoothed time
        std::int64_t off_sum_ns = 0;
        int smoothed_samples = 0;
        int strange_samples = 0;
        std::array<Sample, kSampleMemory> samples;
        std::size_t newest = 0;
        std::size_t count = 0;
        Sample taken;    // the newest that was, with the drive's origin
        Sample refused;  // the newest that was not
        Real refused_slope{};
        int refused_alike = 0;        // in a row
        Real step = kAnywhere;        // by which an angle may leap
        Real most_off = 0;            // a sample from where the wheel was expected, since
        double way_from = kAnywhere;  // this position
        int trusted = 0;              // samples, up to kSampleMemory: the origin is the wheel's own
        double origin = 0;            // added to what the drive says
        bool heard = false;
        bool lost = true;         // begins anew with the next sample
        bool began_anew = false;  // with the speed that this sample shows
        bool stuck = false;       // by dry friction, as predicted
        bool new_clock = false;

        void advance(Real acceleration, Real dt) {
            angle += dt * (speed + acceleration * dt / 2);
            speed += dt * acceleration;
        }

        void rebase() {
            base += double(angle);
            angle = 0;
        }

        void begin_anew_unless_finite() {
            if (std::isfinite(angle) && std::isfinite(speed) && std::isfinite(error)) return;
            angle = speed = error = 0;
            lost = true;
        }

        bool angle_at(std::int64_t instant_ns, double& out) const {
            if (count < 3) return false;
            for (std::size_t back = 1; back < count; ++back) {
                const Sample& older = samples[(newest + kSampleMemory - back) % kSampleMemory];
                if (older.time_ns > instant_ns) continue;
                const Sample& newer = samples[(newest + kSampleMemory - back + 1) % kSampleMemory];
                if (newer.time_ns < instant_ns) return false;
                const std::size_t third = back >= 2 ? back - 2 : back + 1;
                const Sample& beside = samples[(newest + kSampleMemory - third) % kSampleMemory];
                const auto at = [&](const Sample& s) {
                    return 1e-9 * static_cast<double>(s.time_ns - instant_ns);
                };
                const double a = at(older);
                const double b = at(newer);
                const double c = at(beside);
                // Newton's divided differences, evaluated at 0
                const double ab = (newer.position - older.position) / (b - a);
                const double bc = (beside.position - newer.position) / (c - b);
                out = older.position - a * (ab - b * (bc - ab) / (c - a));
                return true;
            }
            return false;
        }
    };

    static Real seconds(std::int64_t ns) { return Real(1e-9) * static_cast<Real>(ns); }

    // Accelerations of the wheels by the model, the acceleration error included. Dry friction is an impulse
    // that may stop a wheel within the step but never turns it back, so a stuck wheel is predicted at rest.
    WheelPair<Real> predict_acceleration(const PlantModel<Real>& plant, Real dt) {
        return plant.rare_effects ? predict_with_all(plant, dt)
                                  : predict_with<model::kCommonEffects>(plant, dt);
    }
    [[gnu::noinline]] WheelPair<Real> predict_with_all(const PlantModel<Real>& plant, Real dt) {
        return predict_with<model::kEffectCount>(plant, dt);
    }
    template <std::size_t kUpTo>
    WheelPair<Real> predict_with(const PlantModel<Real>& plant, Real dt) {
        const auto& g = plant.geometry;
        const auto& k = plant.dynamics;
        const model::EffectContext<Real> context{motion_, acting_torque_Nm(), g, k};
        WheelPair<Real> net = model::delivered_torque_Nm<kUpTo>(plant.effects, context);
        const WheelPair<Real> smooth = model::smooth_effect_torque_Nm<false, kUpTo>(plant.effects, context);
        net.left += smooth.left;
        net.right += smooth.right;
        const TwistRate<Real> body = coupled_acceleration(plant, model::acceleration(k, motion_.twist, net));
        WheelPair<Real> a =
            model::wheel_speeds_from_twist(g, Twist<Real>{body.v_m_per_s2, body.omega_rad_per_s2});
        for (Wheel& wheel : wheels_) wheel.stuck = false;
        a.left += wheels_[0].error;
        a.right += wheels_[1].error;
        model::for_each_dry<kUpTo>(
            plant.effects, g, motion_.wheel_speed_rad_per_s,
            [&](std::size_t, unsigned, const WheelPair<Real>& d, Real friction) {
                const TwistRate<Real> answer = coupled_acceleration(
                    plant, TwistRate<Real>{k.k7_per_kg_m * d.sum(), k.k8_per_kg_m2 * d.difference()});
                const WheelPair<Real> per_Nm = model::wheel_speeds_from_twist(
                    g, Twist<Real>{answer.v_m_per_s2, answer.omega_rad_per_s2});
                const Real mobility = d.left * per_Nm.left + d.right * per_Nm.right;
                if (!(mobility > 0)) return;
                const Real stop = (model::sliding_speed(d, motion_.wheel_speed_rad_per_s) / dt +
                                   model::sliding_speed(d, a)) /
                                  mobility;
                const Real lambda = std::clamp(stop, -friction, friction);
                if (lambda == stop) {
                    wheels_[0].stuck = wheels_[0].stuck || d.left != 0;
                    wheels_[1].stuck = wheels_[1].stuck || d.right != 0;
                }
                a.left -= lambda * per_Nm.left;
                a.right -= lambda * per_Nm.right;
            });
        return a;
    }

    // The farthest that a wheel can be from where it was expected after this time.
    Real reach(const Wheel& wheel, Real dt) const { return most_kick_rad_per_s_ * dt + wheel.step; }

    // Whether a sample is one of this wheel's angle. After some that agree with each other but not with what
    // was before, the origin moves so that the angle goes on.
    bool trust(Wheel& wheel, const EncoderSample& sample) {
        const Real dt = seconds(sample.time_ns - wheel.taken.time_ns);
        const Real off = Real(sample.position_rad - wheel.taken.position) - wheel.speed * dt;
        if (wheel.refused_alike > 0 || !(std::abs(off) <= reach(wheel, dt)))
            return trust_again(wheel, sample, dt, off);
        wheel.taken = {sample.time_ns, sample.position_rad};
        wheel.most_off = std::max(wheel.most_off, std::abs(off));
        if (!(std::abs(sample.position_rad - wheel.way_from) < kWay_rad)) learn_step(wheel);
        return true;
    }

    // At the end of a way on which even the coarsest encoder has leapt. The first samples say nothing: the
    // filter has only begun.
    [[gnu::noinline]] void learn_step(Wheel& wheel) const {
        constexpr Real kTimes = 3;  // a way is not all ways, and an encoder's lines are not all alike
        const bool at_first = wheel.trusted < int(kSampleMemory);
        wheel.trusted += at_first;
        wheel.step = at_first ? settings_.coarsest_step_rad
                              : std::min(kTimes * wheel.most_off, settings_.coarsest_step_rad);
        wheel.most_off = 0;
        if (!at_first) wheel.way_from = wheel.taken.position;
    }

    // What was refused as too far away is no nearer for having had more time since the last that was taken.
    // One that is near the sample before that says that the last one was wild.
    [[gnu::noinline]] bool trust_again(Wheel& wheel, const EncoderSample& sample, Real since_taken,
                                       Real off) {
        constexpr int kAlike = kNewOriginSamples - 1;  // two slopes that agree
        if (sample.time_ns <= wheel.refused.time_ns) return false;
        const Real dt = seconds(sample.time_ns - wheel.refused.time_ns);
        const Sample& before = wheel.samples[(wheel.newest + kSampleMemory - 1) % kSampleMemory];
        const Real off_before = Real(sample.position_rad + wheel.origin - before.position) -
                                wheel.speed * seconds(sample.time_ns - before.time_ns);
        const bool near_again = wheel.refused_alike > 0 && std::abs(off) <= reach(wheel, dt);
        const bool last_was_wild =
            wheel.refused_alike == 0 && wheel.count > 1 && std::abs(off_before) <= reach(wheel, since_taken);
        if (near_again || last_was_wild) {
            wheel.refused_alike = 0;
            wheel.taken = {sample.time_ns, sample.position_rad};
            return true;
        }
        const Real slope = Real(sample.position_rad - wheel.refused.position) / dt;
        const bool first = wheel.refused_alike == 0;
        const bool second = wheel.refused_alike == 1;
        const bool alike =
            second ? std::isfinite(slope) : std::abs(slope - wheel.refused_slope) * dt <= reach(wheel, dt);
        wheel.refused_alike = first || !alike ? 1 : wheel.refused_alike + 1;
        wheel.refused = {sample.time_ns, sample.position_rad};
        wheel.refused_slope = slope;
        if (wheel.refused_alike <= kAlike) return false;
        // A wheel that is faster than the filter thinks: begin anew with its speed.
        if (!(std::abs(slope - wheel.speed) * dt <= reach(wheel, dt))) {
            wheel.speed = slope;
            wheel.lost = wheel.began_anew = true;
        }
        if (wheel.trusted < int(kSampleMemory)) {  // the first ones were the strange ones
            wheel.origin = 0;
            wheel.base = sample.position_rad - double(wheel.angle);
            wheel.count = 0;
        } else {
            wheel.origin += wheel.taken.position + double(wheel.speed * since_taken) - sample.position_rad;
        }
        wheel.refused_alike = 0;
        wheel.taken = {sample.time_ns, sample.position_rad};
        return true;
    }

    void take(Wheel& wheel, const EncoderSample& sample, std::int64_t now_ns, Real acceleration) {
        if (sample.time_ns <= wheel.heard_ns || now_ns - sample.time_ns > restart_after_ns_ ||
            !trust(wheel, sample))
            return;
        const double position_rad = sample.position_rad + wheel.origin;
        const bool restart = wheel.lost || sample.time_ns - wheel.heard_ns > restart_after_ns_;
        smooth_time(wheel, sample.time_ns, restart);
        wheel.newest = (wheel.newest + 1) % kSampleMemory;
        wheel.samples[wheel.newest] = {wheel.smoothed_ns, position_rad};
        const Real age = seconds(now_ns - wheel.smoothed_ns);
        wheel.count = std::min(wheel.count + 1, kSampleMemory);
        if (restart) {
            const Real speed = Real(sample.speed_rad_per_s);
            if (!wheel.began_anew)
                wheel.speed = std::abs(speed) <= 2 * settings_.fastest_rad_per_s ? speed : Real(0);
            wheel.heard = true;
            wheel.lost = wheel.began_anew = false;
            wheel.error = 0;
            wheel.angle = Real(position_rad - wheel.base) + wheel.speed * age;
            return;
        }
        const Real then = wheel.angle - age * (wheel.speed - acceleration * age / 2);
        const Real innovation = Real(position_rad - wheel.base) - then;
        wheel.angle += gains_.angle * innovation;
        wheel.speed += gains_.speed_per_s * innovation;
        // A wheel that friction holds tells nothing of the error, and most of one is friction's own: it turns
        // with the next motion.
        if (wheel.stuck) {
            wheel.error -= gains_.error_pole * wheel.error;
            return;
        }
        // With the learned error or without: a wrong one must not keep itself.
        const Real least = std::min(std::abs(acceleration), std::abs(acceleration - wheel.error));
        const Real calm = least / settings_.calm_acceleration_rad_per_s2;
        wheel.error += gains_.error_per_s2 * innovation / (1 + calm * calm);
    }

    // Integers throughout: cheap, and the same on every machine.
    // A regular clock through queueing: a frame may wait for others on the bus, and as the drives' clocks
    // drift against ours it does so for seconds on end. Time follows slowly in both directions, for a
    // sample's time that moves by 0.1 ms at once is an acceleration that never was; a constant or slowly
    // moving offset is none.
    void smooth_time(Wheel& wheel, std::int64_t time_ns, bool restart) {
        constexpr std::int64_t quick = 16;  // of 1/n of the difference a sample, at first
        constexpr std::int64_t slow = 1024;
        constexpr int quick_samples = 200;
        constexpr int lost_samples = 50;  // in a row that lie elsewhere: the drive's clock has leapt
        // Frames are late by up to three others' lengths far more often than they are lost. Since they came
        // earlier than their smoothed time, one that is lost shows by the time since the last one.
        const std::int64_t since = time_ns - wheel.smoothed_ns;
        const std::int64_t longest = std::max(since, time_ns - wheel.heard_ns);
        wheel.heard_ns = time_ns;
        const std::int64_t periods = std::max<std::int64_t>((longest + period_ns_ / 4) / period_ns_, 1);
        const std::int64_t off = since - periods * period_ns_;
        wheel.strange_samples = std::abs(off) > strange_after_ns_ ? wheel.strange_samples + 1 : 0;
        if (restart || wheel.new_clock || wheel.strange_samples > lost_samples) {
            wheel.new_clock = false;
            wheel.smoothed_ns = time_ns;
            wheel.count = 0;  // the samples before bear another clock's times
            wheel.off_sum_ns = 0;
            wheel.smoothed_samples = 0;
            wheel.strange_samples = 0;
            return;
        }
        const std::int64_t divisor = wheel.smoothed_samples < quick_samples ? quick : slow;
        if (wheel.smoothed_samples < quick_samples) ++wheel.smoothed_samples;
        wheel.off_sum_ns += off;
        const std::int64_t step = wheel.off_sum_ns / divisor;
        wheel.off_sum_ns -= step * divisor;  // what is left counts on: no rounding dead band
        wheel.smoothed_ns += periods * period_ns_ + step;
    }

    WheelObserverSettings<Real> settings_;
    Real most_kick_rad_per_s_{};
    ObserverGains<Real> gains_;
    std::int64_t period_ns_ = 1'000'000, strange_after_ns_ = 450'000, restart_after_ns_ = 0;
    std::size_t delay_cycles_ = 0;
    Real delay_fraction_{};
    std::array<Wheel, 2> wheels_;
    std::array<WheelPair<Real>, kTorqueMemory> torque_{};
    std::size_t newest_torque_ = 0;
    std::int64_t last_ns_ = 0;
    WheelPair<Real> turned_;
    WheelPair<Real> expected_;
    model::Motion<Real> motion_;
};

// Of a wheel where speed and yaw rate both are at the limits that are faults.
inline double fastest_wheel_rad_per_s(const model::RobotParameters& from) {
    const auto& radius = from.geometry.wheel_radius_m;
    return (from.safety.over_speed_m_per_s +
            from.safety.over_yaw_rate_rad_per_s * from.geometry.track_m / 2) /
           std::min(radius.left, radius.right);
}

// By which a wheel's angle may leap as it turns, for its encoder is coarse. Where the encoders' noise was
// measured: a step leaves a twelfth root of it as noise, half of which a drive's own estimator takes away
// where it is not undone; and three times as much, as the noise is the mean of two.
inline double encoder_step_rad(const model::RobotParameters& from) {
    constexpr double kMostLeapPerNoise = 20;
    const double noise_rad = from.velocity_loop.angle_noise_rad;
    return noise_rad > 0 ? std::min(kMostLeapPerNoise * noise_rad, kCoarsestStep_rad) : kCoarsestStep_rad;
}

template <typename Real>
WheelObserverSettings<Real> wheel_observer_settings(const model::RobotParameters& from, Real cycle_s) {
    constexpr Real kLongestGap = 4;  // periods of the encoders
    WheelObserverSettings<Real> to;
    to.cycle_s = cycle_s;
    to.encoder_period_s = Real(from.drive.encoder_period_ms) / 1000;
    to.bandwidth_rad_per_s = Real(velocity_loop_speed(from, double(cycle_s)).observer_bandwidth_rad_per_s);
    to.actuation_delay_s = Real(from.velocity_loop.actuation_delay_s + model::effects_delay_s(from.effects));
    to.restart_after_s = std::max(to.restart_after_s, kLongestGap * to.encoder_period_s);
    to.fastest_rad_per_s = Real(fastest_wheel_rad_per_s(from));
    to.coarsest_step_rad = Real(encoder_step_rad(from));
    // a tenth of what the torque limit can give
    to.calm_acceleration_rad_per_s2 =
        Real(0.1 * 2 * from.limits.torque_Nm * from.dynamics.k7_per_kg_m / from.geometry.mean_radius_m());
    return to;
}

}  // namespace wheelwright::control
