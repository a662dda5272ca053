// A drive log as evenly sampled torques and wheel speeds, for whatever compares them with a model: the gap
// analysis and the checks of CSV logs know nothing of drives.
//
// A sample's speed is the mean over one sampling period around it, from angles alone. The torque from it to
// the next sample is the commands' mean with the weight (a triangle) that makes
//     speed difference = period x K x torque
// exact for these speeds; commands count from when they act (Arrival).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "firmware/ident/regression_filter.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "tools/ident/drive_log.hpp"
#include "tools/logs/log_reading.hpp"
#include "tools/logs/measured_log.hpp"

namespace wheelwright::tools {

// The rows that the estimators make of a drive log.
ident::RegressionFilterOptions<double> filter_options(const model::RobotParameters& robot);

// Mean squares over the usable cycles: of the angles' noise, and of the way in `spacing` cycles.
struct AngleNoise {
    double noise_rad2 = 0, moved_rad2 = 0;
};
AngleNoise angle_noise(const DriveLog& log, std::ptrdiff_t spacing);

// When a told torque acts: by the log, where that tells and is within a cycle of the robot file's delay. What
// is further off is a missing effect.
struct Arrival {
    double delay_s = 0;  // from a cycle's start to the centroid of the response to its torque
    double lag_s = 0;    // the part of it that is a first-order lag
    bool by_log = false;
};
Arrival arrival_of(const DriveLog& log, const model::RobotParameters& robot);

// One log for each stretch of at least a second in which every cycle is usable; times count from the log's
// first frame, headings from the first stretch's.
std::vector<MeasuredLog> even_samples(const DriveLog& log, const model::RobotParameters& robot,
                                      const Arrival& arrival);

// A log of any form. `logs`: the stretches of a candump log, or the segments of a measured one.
struct SampledLog {
    std::vector<MeasuredLog> logs;
    std::vector<std::string> notes;     // "file:line: what was left out, repaired or assumed"
    std::vector<std::string> problems;  // set: unusable
};
// A candump log needs the robot: nodes, signs, gears and delays stand in its file.
SampledLog read_sampled_log(const std::string& path, const std::optional<model::RobotParameters>& robot,
                            const LogReading& reading = {});

}  // namespace wheelwright::tools
