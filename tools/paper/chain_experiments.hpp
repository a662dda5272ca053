// The paper's rows through the whole chain: the firmware under its 1 kHz task, CAN frames, simulated drives
// and robot with a truth of its own. What the firmware says is read from its telemetry frames; the robot's
// truth is read by the judge alone.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "firmware/model/robot_parameters.hpp"
#include "firmware/task/robot_file.hpp"
#include "tools/sim/experiments.hpp"

namespace wheelwright::paper {

struct Robots {
    task::RobotFile believed;  // what the firmware is told
    task::RobotFile truth;     // what the robot is
    std::uint64_t seed = 1;
};

// Telemetry frames of estimates, one entry per frame of K5, K7; arrays in the order K5, K6, K7, K8.
struct EstimateFrames {
    std::vector<double> time_s;
    std::array<std::vector<double>, 4> value, standard_error, covariance_diagonal;
};

// Sect 4: torque mode, the same torque on both wheels.
struct TorqueRun {
    bool entered = false;
    double asked_Nm = 0;
    double acting_Nm = 0;  // mean at the wheels once it has risen
};
TorqueRun torque_over_can(const Robots& robots);

// Sect 5.3: +-5 Nm PRBS, a bit every 10 ms, for `duration_s`; K5..K8 and friction.
struct CanIdentification {
    bool succeeded = false;
    double duration_s = 0;
    double farthest_m = 0;
    double delay_s = 0;
    std::array<double, 4> truth{};  // as a controller of the believed geometry must see it
    std::array<double, 4> estimate{};
    std::array<double, 4> standard_error{};
    double largest_relative_error = 0;
    double largest_z = 0;
    EstimateFrames frames;
    model::RobotParameters identified;  // the believed robot with what was found
};
CanIdentification identify_over_can(const Robots& robots, double duration_s);

// Eq (65)-(72) in velocity mode, on the identified robot: true speed after a step of the set-point, the mean
// of `runs` of different noise.
struct CanStep {
    tools::StepResponse response;
    double step_m_per_s = 0;
    double lowest_overshoot = 0, highest_overshoot = 0;  // of the single runs
    double predicted_overshoot = 0;                      // of the sampled model with the identified delay
};
CanStep step_over_can(const Robots& robots, const model::RobotParameters& identified, bool paper_gains,
                      double step_m_per_s, std::size_t runs = 1);

// Eq (73)-(87) in pose mode: goals around the start, in each direction mode.
struct PoseDrive {
    Pose<double> goal;
    protocol::PoseDirection direction{};
    tools::GoalResult result;
    std::vector<double> x_m, y_m;  // as the firmware reports it
};
std::vector<PoseDrive> poses_over_can(const Robots& robots, const model::RobotParameters& identified,
                                      std::size_t goals_per_direction);

// Figs 20, 21 in trajectory mode, from one metre beside the path.
tools::TrackingResult figure_eight_over_can(const Robots& robots, const model::RobotParameters& identified,
                                            bool external_poses);

// Fig 22 in adaptive mode: the payload (share of mass and inertia) drops on at `payload_at_s`.
struct AdaptationRun {
    tools::TrackingResult tracking;
    double payload_at_s = 0;
    double share = 0;
    EstimateFrames frames;
    std::array<double, 4> truth_before{}, truth_after{};
    std::vector<double> model_time_s, model_k7, model_k8;  // what the controller uses
    double k7_error = 0;  // three seconds after the payload, relative to its new value
    double k8_error = 0;
    double rms_before_m = 0, rms_after_m = 0;
};
AdaptationRun adapt_over_can(const Robots& robots, const model::RobotParameters& identified);

}  // namespace wheelwright::paper
