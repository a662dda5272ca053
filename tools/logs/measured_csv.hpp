// Reader of measured logs in CSV form, sampled at 20 Hz to 2 kHz. The first line names the columns:
//   t_s, tau_left_Nm, tau_right_Nm, omega_left_rad_s, omega_right_rad_s     needed
//   gyro_z_rad_s (positive counter-clockwise), accel_x_m_s2 (forward)       used where present
// or others, with the mapping of `reading`. Columns that nobody names are ignored. A cell that is no number
// is a problem that names its line and column, and then there is no log: an answer from half a log would look
// like one from a whole. A cell that is empty or nan is a row that is missing.
#pragma once

#include <iosfwd>
#include <string>

#include "tools/logs/log_reading.hpp"
#include "tools/logs/measured_log.hpp"

namespace wheelwright::tools {

MeasuredLogs read_measured_csv(std::istream& in, const LogReading& reading = {});

}  // namespace wheelwright::tools
