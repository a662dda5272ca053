// The estimators in the cycle: the ident mode's run, and adaptation while a trajectory is driven. Decides
// nothing about modes; says what was learned.
//
// Threads: the cycle's. No call allocates, blocks or throws.
#pragma once

#include <cstdint>

#include "firmware/control/feedback_linearisation.hpp"
#include "firmware/ident/adaptive_estimator.hpp"
#include "firmware/ident/identification_run.hpp"
#include "firmware/ident/model_guard.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"
#include "firmware/task/motion_control.hpp"
#include "firmware/task/parameter_service.hpp"

namespace wheelwright::task {

class Learning {
  public:
    using Sample = ident::IdentSample<double>;

    // How long before the cycle's instant the angles of a Sample were: the estimators count it as delay.
    static double sample_age_s(const model::RobotParameters& parameters) {
        return 1e-3 * (1 + parameters.drive.encoder_period_ms);
    }

    // Settings of zero mean the robot file's value.
    void start_identification(const model::RobotParameters& parameters,
                              const protocol::IdentSettings& settings, const MotionInputs& now);
    WheelPair<double> identify(const Sample& sample, const Pose<double>& pose, const Twist<double>& twist,
                               const ident::ProbeSample& senses) {
        return run_.step(sample, pose, twist, senses);
    }
    bool identification_finished() const { return run_.finished(); }
    // K7 and K8 are known. K5 and K6 too: identification().coupling_known().
    bool identification_succeeded() const { return run_.state() == ident::IdentState::done; }
    // Ends it because the mode was left.
    void interrupt_identification() { run_.interrupt(); }
    // K7 and K8 as the probe has found them, K5 and K6 zero; before, a model that predicts nothing.
    model::Dynamics<double> probed_dynamics() const;
    bool probed() const { return run_.findings().k8_per_kg_m2 > 0; }

    // Writes what the run found to the live parameters; they are then the controllers' model.
    void record(ParameterService& service, model::RobotParameters& live) const;

    // `lap_s`: the period of what will be driven; 0: not known.
    void start_adaptation(const model::RobotParameters& parameters, const control::PlantModel<double>& plant,
                          double lap_s);
    // True when what is adapted differs from before. `may_adapt`: nothing forbids it (saturation, slip).
    // `busy`: what can wait for a cycle shall.
    bool adapt(const Sample& sample, bool may_adapt, bool busy);
    model::Dynamics<double> adapted_dynamics() const;  // as beside adapted_effects() in a robot file
    const model::EffectSet<double>& adapted_effects() const { return guard_.effects(); }
    bool adaptation_frozen() const;
    bool estimate_is_new() const { return estimate_is_new_; }  // of the last adapt()
    // The motion that adaptation wants beside the path: its period, and the amplitudes at a wheel's rim,
    // forward and turning.
    double dither_period_s() const { return dither_period_s_; }
    WheelPair<double> dither_m_per_s2() const;

    // The estimate of whichever ran last.
    const ident::DynamicsEstimate<double>& estimate() const {
        return adapting_ ? adaptive_.estimate() : run_.estimate();
    }
    const ident::IdentificationRun<double>& run() const { return run_; }
    protocol::IdentStatus status() const;
    double progress() const;  // 0..1
    bool excited() const;

  private:
    model::Dynamics<double> record_asymmetry(ParameterService& service, model::RobotParameters& live) const;

    ident::IdentificationRun<double> run_;
    ident::AdaptiveEstimator<double> adaptive_;
    ident::ModelGuard<double> guard_;
    double track_m_ = 1;
    double dither_period_s_ = 1, dither_over_noise_ = 0;
    double torque_limit_Nm_ = 0;
    double sample_age_s_ = 0;
    double duration_s_ = 1;
    double relative_standard_error_ = 1;
    double minimum_excitation_ = 0;
    bool started_ = false;
    bool adapting_ = false;
    bool estimate_is_new_ = false;
};

}  // namespace wheelwright::task
