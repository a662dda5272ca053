// A robot of the model, driven by a measured log's torque and compared with its measured wheel speeds.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/effects.hpp"
#include "firmware/task/robot_file.hpp"
#include "tools/logs/measured_log.hpp"

namespace wheelwright::gap {

struct SimulatedRobot {
    model::Geometry<double> geometry;
    model::Dynamics<double> dynamics;
    model::EffectSet<double> effects;
    bool turning = true;  // false: it goes straight, and gets the mean of both wheels
    bool driving = true;  // false: K7 is that of a robot whose mass is at its wheels; no torque drove it
};

// The robot of a robot file; none where that has neither K7 nor K8, nor masses.
std::optional<SimulatedRobot> simulated_robot(const task::RobotFile& file);

// Samples first .. end - 1 of a log.
struct Stretch {
    const tools::MeasuredLog* log = nullptr;
    std::size_t first = 0, end = 0;
    double heading_rad = 0;  // at the first
};

using TakeSpeeds = std::function<void(std::size_t sample, const WheelPair<double>& rad_per_s)>;

inline constexpr double kFineStep_s = 0.0005;

// Starts at `start_rad_per_s`, and with what the second of the log before it leaves in a torque path, a
// castor or a gap; holds the torque between samples, and gives `take` the simulated speeds at each sample but
// the first. Sum of the squared differences to the measured ones, both wheels. Steps are not longer than
// `step_s`; samples closer together than that are put together, with their mean torque.
double free_run(const SimulatedRobot& robot, const Stretch& stretch, const WheelPair<double>& start_rad_per_s,
                const TakeSpeeds& take = {}, double step_s = kFineStep_s);

// How many samples are put together.
std::size_t samples_in_step(double period_s, double step_s);

}  // namespace wheelwright::gap
