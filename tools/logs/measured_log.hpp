// Measured logs as the analyses take them: torque and speed of both wheels in SI units, evenly sampled. A
// file becomes one segment or several, wherever rows are missing.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "firmware/model/types.hpp"
#include "tools/logs/candump.hpp"

namespace wheelwright::tools {

struct MeasuredSample {
    double t_s = 0;
    WheelPair<double> torque_Nm;
    WheelPair<double> speed_rad_per_s;
    double gyro_rad_per_s = 0;  // 0 when the log has none
    double accel_m_per_s2 = 0;  // 0 when the log has none
};

struct MeasuredLog {
    std::vector<MeasuredSample> samples;
    double period_s = 0;  // mean step of the file
    bool has_gyro = false;
    bool has_accel = false;
    bool by_angles = false;          // the speeds are an encoder's angles' differences: with its steps
    double start_heading_rad = 0;    // of the first sample, where something tells
    std::string run;                 // of a file that holds several
    std::vector<std::size_t> lines;  // of the file, for each sample; 0: put in, or several in one
};

struct MeasuredLogs {
    std::vector<MeasuredLog> segments;  // none exactly when there are problems
    std::vector<LineProblem> notes;     // what was repaired, left out or assumed
    std::vector<LineProblem> problems;  // the first 20
    std::size_t problem_count = 0;

    void problem(std::size_t line, std::string message);
    void note(std::size_t line, std::string message) { notes.push_back({line, std::move(message)}); }
};

}  // namespace wheelwright::tools
