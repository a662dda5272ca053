// The main job as data: what `wheelwright demo` runs, and what its table and page show.
#pragma once

#include "tools/cli/report.hpp"
#include "tools/sim/experiments.hpp"

namespace wheelwright::tools {

struct MainJob {
    IdentificationResult identification;
    control::LoopDesignResult<double> design;
    StepResponse speed_step, yaw_step;
    double speed_step_m_per_s = 0.15;
    double yaw_step_rad_per_s = 0.7;
    double settling_aim_s = 0;  // what the robot file asks of the loops
    TrackingResult figure_eight;
    TrackingResult adaptive;
    // Over the adaptive drive, ten a second.
    std::vector<double> adaptation_time_s;
    std::vector<model::Dynamics<double>> adapted, adapted_error, true_dynamics;
    double payload_share = 0.3;
    double payload_time_s = 20;
    double k7_error = 0;  // relative, 3 s after the payload came
    double k8_error = 0;

    // The truth, as the believed geometry makes it look.
    model::Dynamics<double> truth;
    model::EffectSet<double> true_effects;
    model::Geometry<double> true_geometry, believed_geometry;
    double cycles_per_second_of_time = 0;

    void begin(Simulation& sim, const model::RobotParameters& plant);
    void identify(Simulation& sim, const Progress& progress);
    void tune(Simulation& sim);
    void drive(Simulation& sim, const Progress& progress);
    void adapt(Simulation& sim, const Progress& progress);

    Report report() const;
    bool settles_in_time() const;
    bool reached_its_aims() const;
};

}  // namespace wheelwright::tools
