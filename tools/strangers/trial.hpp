// One drawn robot, driven through what its owner would do with it, by CAN frames alone, and judged by the
// simulated robot's truth.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>

#include "tools/sim/experiments.hpp"
#include "tools/strangers/draw.hpp"

namespace wheelwright::tools {

// K5..K8 in this order.
using FourValues = std::array<double, 4>;

// A step of the set-point from rest, as large as the robot's torque can do.
struct StepJudged {
    double step = 0;  // m/s or rad/s
    double settling_s = 0;
    double overshoot = 0;  // share of the step
    double ripple = 0;     // standard deviation when it has long settled, share of the step
};

// What the adaptive mode says of the robot's K5..K8, relative. K7 and K8 are judged.
struct LoadJudged {
    FourValues error{};
    FourValues sigma{};   // standard errors that the firmware gives
    bool frozen = false;  // it has stopped adapting
    double worst_error() const;
    bool known() const;             // by its own standard errors
    bool wrong(double most) const;  // says it knows K7 or K8, which is off by more than `most`
};

// What is done with a robot that was identified.
struct Driving {
    std::string blocker;        // why it may not be driven; else empty
    double settling_aim_s = 0;  // what the velocity loops are designed for
    StepJudged forward, turning;
    bool tracked = false;  // the figure-8 was driven
    double rms_share = 0;  // RMS distance from the reference, over the figure's length
    double peak_share = 0;
    double true_rms_share = 0;      // where the robot really is; without an external pose odometry drifts
    bool adapted = false;           // the adaptive mode was driven to the end
    LoadJudged loaded, unloaded;    // some seconds after the payload came, and after it went
    double load_rms_share = 0;      // as rms_share, while the payload comes and goes: trajectory mode
    double adaptive_rms_share = 0;  // the same, adaptive mode
    double adaptation_error() const { return std::max(loaded.worst_error(), unloaded.worst_error()); }
};

struct RobotResult {
    DrawnRobot robot;
    std::string problem;  // why it could not be simulated at all; else empty

    // ---- identification
    std::string end;          // end_of(), when the mode was left
    bool identified = false;  // the firmware says so
    double duration_s = 0;
    double farthest_m = 0;
    double fastest_m_per_s = 0;  // true speed of the quicker wheel's rim
    Twist<double> fastest;       // true speed and yaw rate, each at its highest
    double probe_s = 0;          // when the probe was over
    double clipped_s = 0;        // when the firmware first said that less torque arrives; 0: never
    double delay_s = 0;          // as identified
    FourValues truth{}, estimate{}, standard_error{};

    std::optional<Driving> driving;  // of a robot that was identified

    // Relative, and in standard errors; not numbers where nothing was estimated.
    double error(std::size_t k) const { return estimated() ? estimate[k] / truth[k] - 1 : NAN; }
    double z(std::size_t k) const { return estimated() ? (estimate[k] - truth[k]) / standard_error[k] : NAN; }
    bool estimated() const { return estimate[2] > 0; }
    // The larger of K7's and K8's.
    double worst_error() const;
};

// How the identification of this simulation ended: "identified", the limit that stopped it, the fault, or
// why it never began.
std::string end_of(const Simulation& sim);

// What simulates this robot: its encoders, drives and external pose, with its own seed.
SimulationOptions simulation_options(const DrawnRobot& robot);

// K5..K8 as an observer with the file's geometry sees them: what omega^2, v omega and a torque do in their
// own direction. Exact for unlike wheels and gains, and with a load beside the middle.
model::Dynamics<double> seen_truth(const DrawnRobot& robot, const sim::PlantParameters& plant);

struct TrialOptions {
    std::string log_path;  // "": no log
    bool drive = true;     // what is identified
};

// Throws nothing but std::bad_alloc: what goes wrong is the result's problem.
RobotResult run_trial(const DrawnRobot& robot, const TrialOptions& options);

}  // namespace wheelwright::tools
