// The ident mode from start to finish: excite, measure the delay, estimate until the standard errors are
// small enough or time is up. A pure function of what it is handed; one step() in each cycle.
//
//   measuring_delay -> estimating -> done
//            |              |
//            +--------------+-> stopped_by_limit
//
// In done and stopped_by_limit the torque is zero; bringing the robot to rest is the mode's business.
#pragma once

#include <cstdint>

#include "firmware/ident/delay_estimator.hpp"
#include "firmware/ident/dynamics_estimator.hpp"
#include "firmware/ident/excitation.hpp"

namespace wheelwright::ident {

enum class IdentState : std::uint8_t { measuring_delay, estimating, done, stopped_by_limit };

enum class IdentLimit : std::uint8_t {
    none,
    time,      // duration_s passed before the errors were small enough; estimate() is what is known
    distance,  // the robot left the area although the torque turned it back
    speed,     // the same for speed or yaw rate
    delay,     // no delay could be measured: the torque does not act as the model says
};

template <typename Real>
struct IdentificationOptions {
    ExcitationOptions<Real> excitation;
    DynamicsEstimatorOptions<Real> estimator;  // estimator.filter.delay_s: used when delay_phase_s is 0
    double delay_phase_s{};
    double duration_s{};
    bool run_full_time = false;  // do not stop when the errors are small enough
    Real overshoot = Real(1.3);  // of a limit at which the run stops
};

template <typename Real>
class IdentificationRun {
  public:
    // Geometry, limits and times are taken as given; the robot should be at rest.
    void start(const IdentificationOptions<Real>& options, const Pose<Real>& pose, std::uint32_t seed) {
        options_ = options;
        excitation_.start(options.excitation, pose, seed);
        cycles_ = 0;
        limit_ = IdentLimit::none;
        delay_ = {};
        const double dt = options.excitation.sample_time_s;
        delay_cycles_ = static_cast<std::uint32_t>(options.delay_phase_s / dt);
        last_cycle_ = static_cast<std::uint32_t>(options.duration_s / dt);
        estimator_.configure(options.estimator);
        if (delay_cycles_ > 0) {
            delay_estimator_.configure(options.estimator.filter);
            state_ = IdentState::measuring_delay;
        } else {
            delay_.delay_s = static_cast<Real>(options.estimator.filter.delay_s);
            state_ = IdentState::estimating;
        }
    }

    // The torque for this cycle. `sample` is the cycle's, with the torque that was told in the cycle before
    // (the one returned here, unless something saturated it).
    WheelPair<Real> step(const IdentSample<Real>& sample, const Pose<Real>& pose,
                         const Twist<Real>& velocity) {
        if (finished()) return {};
        ++cycles_;
        if (state_ == IdentState::measuring_delay) {
            delay_estimator_.push(sample);
            if (cycles_ >= delay_cycles_) end_delay_phase();
        } else if (estimator_.push(sample) && estimator_.estimate().good_enough && !options_.run_full_time) {
            state_ = IdentState::done;
        }
        if (!finished()) check_limits(pose, velocity);
        if (finished()) return {};
        return excitation_.step(pose, velocity);
    }

    IdentState state() const { return state_; }
    IdentLimit limit() const { return limit_; }
    bool finished() const { return state_ == IdentState::done || state_ == IdentState::stopped_by_limit; }
    const DynamicsEstimate<Real>& estimate() const { return estimator_.estimate(); }
    const DelayEstimate<Real>& delay() const { return delay_; }
    const Excitation<Real>& excitation() const { return excitation_; }
    const DynamicsEstimator<Real>& estimator() const { return estimator_; }
    double elapsed_s() const { return cycles_ * options_.excitation.sample_time_s; }

  private:
    void stop(IdentLimit limit) {
        limit_ = limit;
        state_ = IdentState::stopped_by_limit;
    }

    void end_delay_phase() {
        delay_ = delay_estimator_.estimate();
        if (!delay_.valid) {
            stop(IdentLimit::delay);
            return;
        }
        estimator_.set_delay(static_cast<double>(delay_.delay_s));
        state_ = IdentState::estimating;
    }

    void check_limits(const Pose<Real>& pose, const Twist<Real>& velocity) {
        const ExcitationOptions<Real>& limits = options_.excitation;
        if (cycles_ >= last_cycle_) {
            // run to the end on purpose, with errors small enough: that is done, not a limit
            if (estimator_.estimate().good_enough) {
                state_ = IdentState::done;
            } else {
                stop(IdentLimit::time);
            }
        } else if (!(excitation_.distance_m(pose) <= limits.distance_limit_m)) {
            stop(IdentLimit::distance);
        } else if (!(std::abs(velocity.v_m_per_s) <= options_.overshoot * limits.speed_limit_m_per_s) ||
                   !(std::abs(velocity.omega_rad_per_s) <=
                     options_.overshoot * limits.yaw_rate_limit_rad_per_s)) {
            stop(IdentLimit::speed);
        }
    }

    IdentificationOptions<Real> options_{};
    Excitation<Real> excitation_;
    DelayEstimator<Real> delay_estimator_;
    DynamicsEstimator<Real> estimator_;
    DelayEstimate<Real> delay_{};
    std::uint32_t cycles_ = 0;
    std::uint32_t delay_cycles_ = 0;
    std::uint32_t last_cycle_ = 0;
    IdentState state_ = IdentState::done;
    IdentLimit limit_ = IdentLimit::none;
};

}  // namespace wheelwright::ident
