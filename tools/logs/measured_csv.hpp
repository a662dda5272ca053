// Reader of measured logs in CSV form: one contiguous run, evenly sampled at 20 Hz to 2 kHz, columns found by
// name in the first line:
//   t_s, tau_left_Nm, tau_right_Nm, omega_left_rad_s, omega_right_rad_s     needed
//   gyro_z_rad_s (positive counter-clockwise), accel_x_m_s2 (forward)       used where present
// Other columns are ignored. Whatever makes the numbers doubtful is a problem that names its line, and then
// there is no log: an answer from half a log would look like one from a whole.
#pragma once

#include <iosfwd>
#include <optional>
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
    double period_s = 0;  // mean step
    bool has_gyro = false;
    bool has_accel = false;
    double start_heading_rad = 0;  // of the first sample, where something tells
    std::vector<std::string> ignored_columns;
};

struct MeasuredLogResult {
    std::optional<MeasuredLog> log;     // set exactly when there are no problems
    std::vector<LineProblem> problems;  // the first 20
    std::size_t problem_count = 0;
};

MeasuredLogResult read_measured_csv(std::istream& in);

// Opens and reads; a file that cannot be opened is a problem of line 0.
MeasuredLogResult read_measured_csv(const std::string& path);

}  // namespace wheelwright::tools
