// Models beside measured logs: how far free runs over a held-out part get from the measured speeds, and the
// torque that a model misses, by speed.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "tools/gap/model/free_run.hpp"
#include "tools/gap/model/rows.hpp"
#include "tools/logs/measured_log.hpp"

namespace wheelwright::gap {

// Simulated less measured wheel speeds, rad/s RMS: over both wheels, and of their mean, which is how the
// robot goes forward. both^2 = forward^2 + that of half the wheels' difference^2: a model that says nothing
// of turning leaves all of the latter.
struct SpeedError {
    double both = 0, forward = 0;
};

// Free run of the simulated robot over measured torque, against the measured wheel speeds.
struct FreeRun {
    double window_s = 0;  // 0: the whole part
    std::size_t windows = 0;
    std::optional<SpeedError> nominal;  // of the given model
    SpeedError before, after;
};

struct Trace {  // of the left wheel, rad/s
    std::vector<double> t_s, measured, before, after;
};

struct Curve {  // residual as torque, Nm, both wheels' mean, over their mean speed, rad/s, in bins
    std::vector<double> x, before, after;
};

struct Models {
    std::optional<SimulatedRobot> nominal;  // the given one
    SimulatedRobot before, after;           // without and with what was found
};

// With windows of several lengths that the part has room for, the whole part last; each starts at the
// measured speeds. Costs a simulation of the part for each model and length.
std::vector<FreeRun> free_runs(const LogPart& part, const Models& models);

// One free run over the whole part, from its first measured speeds.
void free_run_of(const LogPart& part, const SimulatedRobot& robot, const TakeSpeeds& take);

// The first ten seconds, before and after.
Trace trace_of(const LogPart& part, const Models& models);

// Of the measured speeds, both wheels.
double speed_rms_rad_per_s(const LogPart& part);

// The torque missing forward, as means over 0.1 s, without and with what was found.
Curve torque_missing(std::span<const tools::MeasuredLog> logs, const Models& models);

}  // namespace wheelwright::gap
