// The ident mode from start to finish: probe, lay the excitation out, measure the delay, estimate until the
// standard errors are small enough and no longer fall quickly, or time is up. A pure function of what it is
// handed; one step() in each cycle.
//
//   probing -> measuring_delay -> estimating -> done
//       |            |                |
//       +------------+----------------+-> stopped_by_limit
//
// Until the probe or the mirror test has shown that not one wheel alone goes backwards, limits of
// speed, yaw rate and distance hold for the robot's mirror image too.
//
// cause() names why it ended, in done too: good_enough; direction_unverified when time was up and only that
// had not been shown; or coupling_not_known when time was up with K7 and K8 known but K5 and K6 not yet. In
// done and stopped_by_limit the torque is zero; bringing the robot to rest is the mode's business.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <variant>

#include "firmware/ident/delay_estimator.hpp"
#include "firmware/ident/dynamics_estimator.hpp"
#include "firmware/ident/excitation.hpp"
#include "firmware/ident/mirror_test.hpp"
#include "firmware/ident/probe.hpp"
#include "firmware/ident/sizing.hpp"

namespace wheelwright::ident {

enum class IdentState : std::uint8_t { measuring_delay, estimating, done, stopped_by_limit, probing };

template <typename Real>
struct IdentificationOptions {
    // With a probe, its amplitude, bit time and limits, the estimator's kernel, standing speed and coupling
    // error are those that size_identification() finds; friction may be estimated beside the listed effects.
    ExcitationOptions<Real> excitation;
    DynamicsEstimatorOptions<Real> estimator;  // estimator.filter.delay_s: used when delay_phase_s is 0
    double delay_phase_s{};  // at least; goes on, up to kLongestDelayPhase, until it is sure
    double duration_s{};
    bool run_full_time = false;  // do not stop when the errors are small enough
    bool probe = false;
    ProbeOptions probing;
    SizingRequest sizing;
    Real overshoot = Real(1.3);  // of a limit at which the run stops
};

template <typename Real>
class IdentificationRun {
  public:
    // Geometry, limits and times are taken as given; the robot should be at rest.
    void start(const IdentificationOptions<Real>& options, const Pose<Real>& pose, std::uint32_t seed) {
        options_ = options;
        seed_ = seed;
        start_ = pose;
        cycles_ = 0;
        cause_ = IdentCause::none;
        delay_ = {};
        sizing_ = {};
        watch_ = {};
        signs_agree_ = false;
        signs_known_ = !options.probe;
        mirrored_ = pose;
        full_limits_ = limits();
        lowered_ = 0;
        options_.excitation.half_track_m = half_track_m();
        confine();
        const double dt = options.excitation.sample_time_s;
        last_cycle_ = static_cast<std::uint32_t>(options.duration_s / dt);
        excitation_.start(options_.excitation, pose, seed);
        found_ = {};
        nothing_known_ = nothing_known<Real>(options.estimator.filter.effects.active);
        if (options.probe) {
            stage_.template emplace<Probe>().start(options.probing);
            state_ = IdentState::probing;
        } else {
            excite();
        }
    }

    // The torque for this cycle. `sample` is the cycle's, with the torque that was told in the cycle before
    // (the one returned here, unless something saturated it). `senses`: what only the probe looks at.
    WheelPair<Real> step(const IdentSample<Real>& sample, const Pose<Real>& pose, const Twist<Real>& velocity,
                         const ProbeSample& senses = {}) {
        if (finished()) return {};
        ++cycles_;
        if (!signs_known_) follow_mirrored(velocity);
        if (state_ == IdentState::probing) return step_probe(pose, velocity, senses);
        watch_reports(sample.last_torque_Nm, senses);
        if (finished()) return {};
        if (state_ == IdentState::measuring_delay) {
            auto& delay_estimator = *std::get_if<DelayEstimator<Real>>(&stage_);
            delay_estimator.push(sample);
            ++delay_cycles_;
            if (delay_cycles_ >= next_look_) look_at_delay(delay_estimator);
        } else if (auto& estimator = *std::get_if<DynamicsEstimator<Real>>(&stage_);
                   choose_level(estimator), estimator.push(sample)) {
            if (errors_known()) look_at_signs(estimator.coupling_terms());
            if (!finished()) look_at_wheels(estimator);
            if (!finished() && look_at_gains()) return {};
            if (!finished() && estimate().good_enough && signs_known_ && elapsed_s() >= shortest_s() &&
                !options_.run_full_time)
                succeed_with_all();
        }
        if (!finished()) check_limits(pose, velocity);
        if (finished()) return {};
        return excitation_.step(pose, velocity, signs_known_ ? nullptr : &mirrored_);
    }

    IdentState state() const { return state_; }
    IdentCause cause() const { return cause_; }
    bool finished() const { return state_ == IdentState::done || state_ == IdentState::stopped_by_limit; }
    // K5 and K6 as well, not only K7 and K8.
    bool coupling_known() const {
        return cause_ == IdentCause::good_enough || cause_ == IdentCause::direction_unverified;
    }
    // Of a run that is done.
    Asymmetry asymmetry() const {
        const model::Dynamics<Real>& k = estimate().dynamics;
        const model::Dynamics<double> seen{static_cast<double>(k.k5_m), static_cast<double>(k.k6_per_m),
                                           static_cast<double>(k.k7_per_kg_m),
                                           static_cast<double>(k.k8_per_kg_m2)};
        if (estimator() == nullptr) return {};
        return ident::asymmetry(seen, estimator()->cross_gains(), options_.estimator.filter.geometry.track_m);
    }
    // Of a run that is done: as they stand beside this in a robot file.
    model::EffectSet<Real> effects_beside(const Asymmetry& beside) const {
        return estimator() != nullptr ? estimator()->effects_beside(beside) : estimate().effects;
    }
    // Nothing is known before `estimating`.
    const DynamicsEstimate<Real>& estimate() const {
        return estimator() != nullptr ? estimator()->estimate() : nothing_known_;
    }
    const DelayEstimate<Real>& delay() const { return delay_; }
    const Excitation<Real>& excitation() const { return excitation_; }
    // nullptr before `estimating`.
    const DynamicsEstimator<Real>* estimator() const { return std::get_if<DynamicsEstimator<Real>>(&stage_); }
    // Of K5, and of K6 as a length.
    Real coupling_error_m() const {
        return estimator() != nullptr ? std::max(estimator()->k5_error_m(), estimator()->k6_error_m())
                                      : static_cast<Real>(kUnknownError);
    }
    const ProbeFindings& findings() const {
        const Probe* probe = std::get_if<Probe>(&stage_);
        return probe != nullptr ? probe->findings() : found_;
    }
    const Sizing& sizing() const { return sizing_; }
    const IdentificationOptions<Real>& options() const { return options_; }
    double elapsed_s() const { return cycles_ * options_.excitation.sample_time_s; }
    // So long it goes on although it is good enough, for it still gets better.
    double shortest_s() const { return kWorthItsTime * options_.duration_s; }

    // Share of the slow acceleration, RMS, that the model does not explain.
    Real unexplained() const {
        if (estimator() == nullptr) return 0;
        const WheelPair<Real> share = estimator()->unexplained();
        return std::max(share.left, share.right);
    }
    // The model leaves more of the slow acceleration unexplained than an encoder's noise would.
    bool model_incomplete() const { return unexplained() > kUnexplained; }

    // The coupling of forward and turning shows that not one wheel alone goes backwards.
    bool signs_agree() const { return signs_agree_ || found_.signs_agree; }

    // That, or an external pose: the file's limits are in force.
    bool signs_known() const { return signs_known_; }

    // Ends it from outside.
    void interrupt() {
        if (!finished()) stop(IdentCause::interrupted);
    }

  private:
    // Of the duration. Errors fall with the square root of time: until here each second lessens them by more
    // than a sixtieth, and what all the rest of the time could take from them is four tenths.
    static constexpr double kWorthItsTime = 0.35;
    static constexpr double kLongestDelayPhase = 0.2;   // of the duration
    static constexpr Real kSureDelay_s = Real(5e-5);    // a twentieth of a cycle
    static constexpr Real kUsableDelay_s = Real(1e-3);  // a cycle: the estimator's timing columns do the rest
    // When time is up, this times the wanted standard errors of K7 and K8 will do: an error of two per cent,
    // with which loops still settle as designed, is then two and a half of theirs.
    static constexpr Real kStillGood = Real(1.6);
    static constexpr Real kStillGoodCoupling = 5;  // and this those of K5 and K6, or this as a share
    static constexpr Real kStillGoodCouplingShare = 3;
    // Of the slow acceleration, RMS (`wheelwright sim` prints it). What a model misses is seen here before it
    // is seen in K7 and K8, of which it moves a tenth (kShareInGain): 5 % are half a per cent of them, the
    // wanted standard error, and 15 % are what errors of a per cent and a half rest on. No sharp limits: a
    // coarse encoder can leave more than the first.
    static constexpr Real kUnexplained = Real(0.05);
    static constexpr Real kTooMuchUnexplained = Real(0.15);
    static constexpr Real kSureOfLess = 4;      // standard errors
    static constexpr int kMostLowered = 3;      // drives that deliver less and less get too hot
    static constexpr double kSureOfWheels = 6;  // standard errors
    static constexpr double kFollowed = 0.95;   // of a torque that was asked, so that it shows at once
    // Now and then the torque is a little less, for as long as its rows outnumber those that hold both: an
    // eighth of the time, which costs the standard errors a hundredth of themselves.
    static constexpr Real kLessTorque = Real(0.9);
    static constexpr std::uint32_t kLessTorqueBits = 30, kLevelsBits = 240;
    static constexpr int kReportsToJudge = 25;

    // How well the drives' reports have lately agreed with what they were told.
    struct Watch {
        WheelPair<double> told;
        std::array<std::uint32_t, 2> steady_cycles{};
        std::array<double, 2> ratio{1, 1};
        std::array<int, 2> reports{};
    };

    void stop(IdentCause cause) {
        cause_ = cause;
        state_ = IdentState::stopped_by_limit;
    }
    // Unless so much is left unexplained that no number of the model should be trusted.
    void succeed(IdentCause cause) {
        if (unexplained() > kTooMuchUnexplained) return stop(IdentCause::model_incomplete);
        cause_ = cause;
        state_ = IdentState::done;
    }
    void succeed_with_all() {
        succeed(signs_known_ ? IdentCause::good_enough : IdentCause::direction_unverified);
    }

    WheelPair<Real> step_probe(const Pose<Real>& pose, const Twist<Real>& velocity,
                               const ProbeSample& senses) {
        Probe& probe = *std::get_if<Probe>(&stage_);
        const WheelPair<double> torque = probe.step(senses);
        if (findings().signs_known()) know_signs();
        check_limits(pose, velocity);
        if (finished()) return {};
        if (probe.finished()) {
            if (findings().fault != IdentCause::none) {
                stop(findings().fault);
                return {};
            }
            found_ = probe.findings();
            apply_sizing();
            return {};
        }
        return {static_cast<Real>(torque.left), static_cast<Real>(torque.right)};
    }

    void apply_sizing() {
        sizing_ = size_identification(options_.sizing, found_);
        if (sizing_.obstacle != IdentCause::none) {
            stop(sizing_.obstacle);
            return;
        }
        full_limits_ = {static_cast<Real>(sizing_.speed_limit_m_per_s),
                        static_cast<Real>(sizing_.yaw_rate_limit_rad_per_s)};
        set_limits(full_limits_);
        confine();
        ExcitationOptions<Real>& excitation = options_.excitation;
        excitation.amplitude_Nm = static_cast<Real>(sizing_.amplitude_Nm);
        excitation.bit_time_s = sizing_.bit_time_s;
        add_friction(options_.estimator.filter.effects, sizing_.dry_share,
                     static_cast<double>(options_.estimator.relative_standard_error));
        options_.estimator.filter.kernel_s = sizing_.kernel_s;
        options_.estimator.filter.standing_speed_rad_per_s =
            static_cast<Real>(sizing_.standing_speed_rad_per_s);
        options_.estimator.filter.standing_samples = sizing_.standing_samples;
        options_.estimator.filter.speed_span = sizing_.speed_span;
        options_.estimator.dry_share = static_cast<Real>(sizing_.dry_share);
        options_.estimator.coupling_standard_error_m = static_cast<Real>(sizing_.coupling_standard_error_m);
        nothing_known_.effects.active = options_.estimator.filter.effects.active;
        excitation_.start(excitation, start_, seed_);
        excite();
    }

    void excite() {
        const double dt = options_.excitation.sample_time_s;
        delay_cycles_ = 0;
        if (options_.delay_phase_s > 0) {
            next_look_ = static_cast<std::uint32_t>(options_.delay_phase_s / dt);
            last_delay_cycle_ = std::max(
                next_look_, static_cast<std::uint32_t>(kLongestDelayPhase * options_.duration_s / dt));
            stage_.template emplace<DelayEstimator<Real>>().configure(options_.estimator.filter);
            state_ = IdentState::measuring_delay;
        } else {
            delay_.delay_s = static_cast<Real>(options_.estimator.filter.delay_s);
            estimate_from_here();
        }
    }
    void estimate_from_here() {
        options_.estimator.filter.delay_s = static_cast<double>(delay_.delay_s);
        options_.estimator.lag_s = delay_.lag_s;
        options_.estimator.bit_time_s = static_cast<Real>(options_.excitation.bit_time_s);
        level_cycles_ = 0;
        bit_cycles_ = static_cast<std::uint32_t>(
            std::lround(options_.excitation.bit_time_s / options_.excitation.sample_time_s));
        stage_.template emplace<DynamicsEstimator<Real>>().configure(options_.estimator);
        state_ = IdentState::estimating;
    }

    void choose_level(DynamicsEstimator<Real>& estimator) {
        if (!options_.probe) return;
        if (++level_cycles_ > kLevelsBits * bit_cycles_) level_cycles_ = 0;
        const bool less = level_cycles_ > (kLevelsBits - kLessTorqueBits) * bit_cycles_;
        excitation_.set_level(less ? kLessTorque : Real(1));
        estimator.set_less_torque(less);
    }

    // Errors from the first rows are no errors.
    bool errors_known() const {
        return estimate().standard_error.k7_per_kg_m < static_cast<Real>(kUnknownError);
    }

    // Without a look from outside one wrong sign shows in how forward and turning are coupled.
    void look_at_signs(const CouplingTerms<Real>& terms) {
        const Mirror seen = judge_mirror(terms, half_track_m());
        signs_agree_ = seen == Mirror::as_filed;
        if (seen == Mirror::mirrored && !found_.pose_seen) return stop(IdentCause::one_sign_wrong);
        if (signs_agree_) know_signs();
    }
    void know_signs() {
        if (signs_known_) return;
        signs_known_ = true;
        set_limits(full_limits_);
        excitation_.set_limits(full_limits_);
    }

    Real half_track_m() const { return static_cast<Real>(options_.estimator.filter.geometry.track_m / 2); }
    Twist<Real> limits() const {
        return {options_.excitation.speed_limit_m_per_s, options_.excitation.yaw_rate_limit_rad_per_s};
    }
    void set_limits(const Twist<Real>& limits) {
        options_.excitation.speed_limit_m_per_s = limits.v_m_per_s;
        options_.excitation.yaw_rate_limit_rad_per_s = limits.omega_rad_per_s;
    }
    // To what holds for the mirror image too, while the robot may be that.
    void confine() {
        if (!signs_known_) set_limits(within_either(limits(), half_track_m()));
    }
    void follow_mirrored(const Twist<Real>& velocity) {
        const auto dt = static_cast<Real>(options_.excitation.sample_time_s);
        const Twist<Real> image = mirrored(velocity, half_track_m());
        mirrored_ = model::advance_along_arc(mirrored_, dt * image.v_m_per_s, dt * image.omega_rad_per_s);
    }

    // A lifted wheel that the probe's pushes did not show.
    void look_at_wheels(const DynamicsEstimator<Real>& estimator) {
        const DynamicsEstimate<Real>& now = estimator.estimate();
        const double h = options_.estimator.filter.geometry.track_m / 2;
        const double k7 = now.dynamics.k7_per_kg_m;
        const double k8 = h * now.dynamics.k8_per_kg_m2;
        const auto error = static_cast<double>(now.standard_error.k7_per_kg_m) +
                           h * static_cast<double>(now.standard_error.k8_per_kg_m2);
        const double x7 = estimator.cross_gains()[0].value;
        const double x8 = h * estimator.cross_gains()[1].value;
        const WheelAnswers answers{{k7 + k8 - x7 - x8, k7 + k8 + x7 + x8},
                                   {k7 - k8 + x7 - x8, k7 - k8 - x7 + x8}};
        // a wheel in the air knows nothing of K5 omega^2
        const bool on_floor =
            found_.on_floor ||
            std::abs(now.dynamics.k5_m) > static_cast<Real>(kSureOfWheels) * now.standard_error.k5_m;
        const IdentCause lifted =
            wheel_off_ground(answers, kSureOfWheels * error, kSureOfWheels * error, !on_floor);
        if (lifted != IdentCause::none) stop(lifted);
    }

    // Less torque arrives than was told where the run finds less of both K7 and K8 than the probe's gentle
    // pushes, which are never too large by more than a few per cent, and where a Nm of less torque does more
    // than one of the whole. True: it begins anew with less.
    bool look_at_gains() {
        if (!options_.probe) return false;
        const DynamicsEstimate<Real>& now = estimate();
        const auto share = [](Real k, Real error, double probed) {
            return static_cast<double>(k + kSureOfLess * error) / probed;
        };
        const ProbeFindings& found = found_;
        double delivered =
            std::max(share(now.dynamics.k7_per_kg_m, now.standard_error.k7_per_kg_m, found.k7_per_kg_m),
                     share(now.dynamics.k8_per_kg_m2, now.standard_error.k8_per_kg_m2, found.k8_per_kg_m2));
        if (!(delivered < kFollowed)) {
            const auto excess = estimator()->excess_of_less_torque();
            const Real matters = options_.estimator.relative_standard_error;
            if (!(excess.share > std::max(matters, kSureOfLess * excess.standard_error))) return false;
            delivered = 1 / (1 + static_cast<double>(excess.share));
        }
        excite_with(delivered);
        return true;
    }

    // Of the amplitude only this share arrives: once more, with less than that.
    void excite_with(double delivered_share) {
        const ProbeFindings& found = found_;
        Real& amplitude_Nm = options_.excitation.amplitude_Nm;
        const double delivered_Nm = delivered_share * static_cast<double>(amplitude_Nm);
        if (++lowered_ > kMostLowered || !(kBelowSeen * delivered_Nm > kMovesEnough * found.friction_Nm))
            return stop(IdentCause::torque_not_followed);
        found_.clipped = true;
        found_.torque_limit_Nm = std::min(found_.torque_limit_Nm, delivered_Nm);
        amplitude_Nm = static_cast<Real>(kBelowSeen * delivered_Nm);
        options_.estimator.dry_share = static_cast<Real>(found.friction_Nm) / amplitude_Nm;
        watch_ = {};
        excitation_.start(options_.excitation, start_, seed_);
        if (delay_.valid && state_ == IdentState::estimating)
            estimate_from_here();
        else
            excite();
    }

    void look_at_delay(const DelayEstimator<Real>& estimator) {
        delay_ = estimator.estimate();
        const bool sure = delay_.valid && delay_.standard_error_s <= kSureDelay_s;
        if (!sure && delay_cycles_ < last_delay_cycle_) {
            next_look_ = delay_cycles_ + kLookAgainCycles;
            return;
        }
        if (!delay_.valid || (options_.probe && delay_.standard_error_s > kUsableDelay_s)) {
            stop(IdentCause::delay_not_found);
            return;
        }
        estimate_from_here();
    }
    static constexpr std::uint32_t kLookAgainCycles = 250;

    void watch_reports(const WheelPair<Real>& told, const ProbeSample& senses) {
        if (!options_.probe || !found_.reports) return;
        const std::array<double, 2> now{static_cast<double>(told.left), static_cast<double>(told.right)};
        const std::array<double, 2> before{watch_.told.left, watch_.told.right};
        const std::array<double, 2> got{senses.reported_Nm.left, senses.reported_Nm.right};
        const auto settled = static_cast<std::uint32_t>(0.008 / options_.excitation.sample_time_s);
        for (std::size_t i = 0; i < 2; ++i) {
            watch_.steady_cycles[i] = now[i] == before[i] ? watch_.steady_cycles[i] + 1 : 0;
            if (!senses.report_is_new[i] || now[i] == 0 || watch_.steady_cycles[i] < settled) continue;
            const double ratio = got[i] / (now[i] * found_.report_ratio);
            watch_.ratio[i] += (ratio - watch_.ratio[i]) / kReportsToJudge;
            if (++watch_.reports[i] > kReportsToJudge && watch_.ratio[i] < kFollowed)
                return excite_with(watch_.ratio[i]);
        }
        watch_.told = {now[0], now[1]};
    }

    bool still_good() const {
        const auto& k = estimate().dynamics;
        const auto& e = estimate().standard_error;
        const Real share = kStillGood * options_.estimator.relative_standard_error;
        return k.k7_per_kg_m > 0 && k.k8_per_kg_m2 > 0 && e.k7_per_kg_m <= share * k.k7_per_kg_m &&
               e.k8_per_kg_m2 <= share * k.k8_per_kg_m2;
    }

    bool coupling_still_good() const {
        const DynamicsEstimatorOptions<Real>& wanted = options_.estimator;
        const Real by_itself =
            kStillGoodCouplingShare * wanted.relative_standard_error * std::abs(estimate().dynamics.k5_m);
        return coupling_error_m() <=
               std::max(kStillGoodCoupling * wanted.coupling_standard_error_m, by_itself);
    }

    void check_limits(const Pose<Real>& pose, const Twist<Real>& velocity) {
        const ExcitationOptions<Real>& limits = options_.excitation;
        const bool probing = state_ == IdentState::probing;
        const auto lifted_or = [&](IdentCause otherwise) {
            const Probe* probe = std::get_if<Probe>(&stage_);
            const IdentCause lifted = probe != nullptr ? probe->wheel_running_free() : IdentCause::none;
            return lifted != IdentCause::none ? lifted : otherwise;
        };
        if (cycles_ >= last_cycle_) {
            // run to the end on purpose, with errors small enough: that is done, not a limit
            if (estimate().good_enough ||
                (state_ == IdentState::estimating && still_good() && coupling_still_good())) {
                succeed_with_all();
            } else if (state_ == IdentState::estimating && still_good() && signs_known_) {
                succeed(IdentCause::coupling_not_known);
            } else {
                stop(unexplained() > kTooMuchUnexplained ? IdentCause::model_incomplete
                                                         : IdentCause::time_over);
            }
        } else if (!(excitation_.distance_m(pose) <= limits.distance_limit_m) ||
                   (!signs_known_ && !(excitation_.distance_m(mirrored_) <= limits.distance_limit_m))) {
            stop(lifted_or(probing ? IdentCause::no_room : IdentCause::area_left));
        } else if (!(std::abs(velocity.v_m_per_s) <= options_.overshoot * limits.speed_limit_m_per_s) ||
                   !(std::abs(velocity.omega_rad_per_s) <=
                     options_.overshoot * limits.yaw_rate_limit_rad_per_s)) {
            // so gently as the probe drives, only a limit that a small room has set can be crossed
            const bool by_room =
                options_.probe &&
                limits.speed_limit_m_per_s < static_cast<Real>(options_.sizing.robot_speed_limit_m_per_s);
            stop(lifted_or(probing && by_room ? IdentCause::no_room : IdentCause::too_fast));
        }
    }

    IdentificationOptions<Real> options_{};
    // One after another, in the same memory.
    std::variant<Probe, DelayEstimator<Real>, DynamicsEstimator<Real>> stage_;
    ProbeFindings found_;
    DynamicsEstimate<Real> nothing_known_{};
    Sizing sizing_{};
    Excitation<Real> excitation_;
    DelayEstimate<Real> delay_{};
    Watch watch_{};
    Pose<Real> start_{}, mirrored_{};
    Twist<Real> full_limits_{};  // once the signs are known
    std::uint32_t seed_ = 0;
    std::uint32_t cycles_ = 0;
    std::uint32_t delay_cycles_ = 0;
    std::uint32_t next_look_ = 0;
    std::uint32_t last_delay_cycle_ = 0;
    std::uint32_t last_cycle_ = 0;
    std::uint32_t bit_cycles_ = 0, level_cycles_ = 0;
    bool signs_agree_ = false, signs_known_ = false;
    int lowered_ = 0;
    IdentState state_ = IdentState::done;
    IdentCause cause_ = IdentCause::none;
};

}  // namespace wheelwright::ident
