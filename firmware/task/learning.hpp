// The estimators in the cycle: the ident mode's run, and adaptation while a trajectory is driven. Decides
// nothing about modes; says what was learned.
//
// Threads: the cycle's. No call allocates, blocks or throws.
#pragma once

#include <array>
#include <cstdint>

#include "firmware/control/encoder_loop.hpp"
#include "firmware/control/feedback_linearisation.hpp"
#include "firmware/ident/adaptive_estimator.hpp"
#include "firmware/ident/identification_run.hpp"
#include "firmware/ident/model_guard.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"
#include "firmware/task/cycle_schedule.hpp"
#include "firmware/task/motion_control.hpp"
#include "firmware/task/parameter_service.hpp"

namespace wheelwright::task {

// How samples of this robot become rows. The delay: of the whole way from a cycle's start to its torque, by
// the file.
template <typename Scalar>
ident::RegressionFilterOptions<Scalar> regression_filter_options(const model::RobotParameters& p,
                                                                 double kernel_s) {
    ident::RegressionFilterOptions<Scalar> options;
    options.geometry = model::actual_geometry(p.effects, p.geometry);
    options.effects = model::EffectSet<Scalar>(p.effects);
    options.dynamics = model::Dynamics<Scalar>(p.dynamics);
    options.sample_time_s = kCyclePeriod_s;
    options.kernel_s = kernel_s;
    options.sample_age_s = Senses::sample_age_s(p);
    options.delay_s =
        p.velocity_loop.actuation_delay_s + model::effects_delay_s(p.effects) + options.sample_age_s;
    return options;
}

class Learning {
  public:
    // Settings of zero mean the robot file's value.
    void start_identification(const model::RobotParameters& parameters,
                              const protocol::IdentSettings& settings, double encoder_loop_period_s,
                              const Observed& now);
    // The excitation's torque. `feedback`: of both drives, left and right.
    WheelPair<Real> identify(const Observed& seen,
                             const std::array<const drivers::DriveFeedback*, 2>& feedback);
    // 1 / b of the drives' encoder loops, as far as their reports have told it by now; before, by the file.
    WheelPair<double> encoder_lag_s() const;
    bool identification_finished() const { return run_.finished(); }
    // K7 and K8 are known. K5 and K6 too: identification().coupling_known().
    bool identification_succeeded() const { return run_.state() == ident::IdentState::done; }
    // Ends it because the mode was left.
    void interrupt_identification() { run_.interrupt(); }
    // K7 and K8 as the probe has found them, K5 and K6 zero; before, a model that predicts nothing.
    model::Dynamics<Real> probed_dynamics() const;
    bool probed() const { return run_.findings().k8_per_kg_m2 > 0; }

    // Writes what the run found to the live parameters; they are then the controllers' model.
    void record(ParameterService& service, model::RobotParameters& live) const;

    // In the cycle that enters a mode that learns, after MotionControl::enter(); sets its dither.
    void start_adaptation(const model::RobotParameters& parameters, MotionControl& control);
    // One cycle of such a mode: learns from what was seen, hands the model on to `control` and sets its
    // dither. `saturated`: the torque was at its limit, from which nothing is learned. True: the cycle was
    // long, what can wait shall.
    bool adapt(const Observed& seen, bool saturated, MotionControl& control);
    bool adaptation_frozen() const;
    // The estimate of whichever ran last.
    const ident::DynamicsEstimate<Real>& estimate() const {
        return adapting_ ? adaptive_.estimate() : run_.estimate();
    }
    const ident::IdentificationRun<Real>& run() const { return run_; }
    protocol::IdentStatus status() const;
    double progress() const;  // 0..1
    bool excited() const;

  private:
    model::Dynamics<Real> adapted_dynamics() const;  // as beside the guard's effects in a robot file
    WheelPair<Real> dither_m_per_s2() const;         // amplitudes at a wheel's rim, forward and turning
    model::Dynamics<double> record_asymmetry(const ident::Asymmetry& found, ParameterService& service,
                                             model::RobotParameters& live) const;

    ident::IdentificationRun<Real> run_;
    ident::AdaptiveEstimator<Real> adaptive_;
    ident::ModelGuard<Real> guard_;
    Real track_m_ = 1;
    Real dither_period_s_ = 1, dither_over_noise_ = 0;
    Real torque_limit_Nm_ = 0;
    double sample_age_s_ = 0;
    double duration_s_ = 1;
    double relative_standard_error_ = 1;
    double minimum_excitation_ = 0;
    bool started_ = false;
    bool adapting_ = false;
    bool was_long_ = false;
    int adapted_since_ = 0;  // cycles that a new model waits for the controllers; 0: none does
    std::array<std::int64_t, 2> report_ns_{};  // of the drives' newest torque reports
    std::array<control::EncoderLoopLag, 2> encoder_lag_;
    WheelPair<double> filed_encoder_lag_s_;
    double encoder_period_s_ = 0, encoder_loop_period_s_ = 0;
};

}  // namespace wheelwright::task
