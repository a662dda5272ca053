// The logs of an analysis, before any model: read, repaired, measured as a whole, and parted into what is
// learned from and what it is judged on.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "firmware/model/robot_parameters.hpp"
#include "tools/gap/logs/sensors.hpp"
#include "tools/logs/log_reading.hpp"
#include "tools/logs/measured_log.hpp"

namespace wheelwright::gap {

// A file may hold several stretches, each of which is a log here.
struct Logs {
    std::vector<tools::MeasuredLog> logs;
    std::vector<std::vector<bool>> unusable;  // samples of each log
    std::size_t last_file = 0;                // its first log
    std::vector<LogFault> faults;             // that were repaired or left out
    std::vector<std::string> notes;           // for people: of the faults, and of what was left out
    std::vector<std::string> problems;        // set: not to be used
};
// A candump log needs the robot.
Logs read_logs(const std::vector<std::string>& paths, const std::optional<model::RobotParameters>& robot,
               const tools::LogReading& reading);

// The part of a log: samples from `first` to before `end`.
struct LogPart {
    const tools::MeasuredLog* log = nullptr;
    std::size_t index = 0;
    std::size_t first = 0, end = 0;
    double initial_heading_rad = 0;
    const std::vector<bool>* unusable = nullptr;  // by sample; null: none is
};

// What all logs together show.
struct Overview {
    double duration_s = 0;
    double period_s = 0;                // of the first log
    double speed_rms_rad_per_s = 0;     // of both wheels
    double peak_torque_Nm = 0;          // of either wheel
    double peak_speed_rad_per_s = 0;    // of either wheel
    double span_s = 0;                  // of the longest log
    double turned_rad = 0;              // from the least to the greatest angle of a wheel, at most
    WheelPair<double> noise_rad_per_s;  // standard deviations
    bool driving = true;                // the torques have a sum
    bool turning = false;               // the torques differ, and the robot turns by more than that noise
    std::vector<std::string> problems;  // set: nothing can be learned, and noise and turning are not known
};
// At least one log.
Overview overview_of(std::span<const tools::MeasuredLog> logs, const model::Geometry<double>& geometry);

// Which part of the last file nothing is learned from.
struct HeldOutPart {
    bool whole_file = false;
    std::optional<double> from_s;  // to its end; else its last fifth
};

struct Parts {
    std::vector<LogPart> training;
    // The longest piece behind the cut; none: there is none of three samples.
    std::optional<LogPart> held_out;
};
// The parts point into `logs`.
Parts split(const Logs& logs, const model::Geometry<double>& geometry, const HeldOutPart& held_out);

// The heading at each sample of the part and, one more, behind the last.
std::vector<double> headings_rad(const LogPart& part, const model::Geometry<double>& geometry);

}  // namespace wheelwright::gap
