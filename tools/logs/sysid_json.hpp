// Reader of the logs that WPILib's characterisation tools write:
//   frc-characterization (2020)  rows of 10: time, battery V, commanded share, left V, right V, left
//   position, right
//                                position, left rate, right rate, gyro angle
//   SysId (2021 to 2023)         rows of 9: time, left V, right V, left position, right position, left rate,
//   right
//                                rate, gyro angle, gyro rate
// in arrays named after their test: slow-forward, slow-backward, fast-forward, fast-backward, track-width.
// Positions are in rotations and "unitsPerRotation" and "units" say how far one goes; without these they are
// metres. Sources: wpilibsuite/frc-characterization, drive_characterization; wpilibsuite/sysid,
// AnalysisManager.cpp and JSONConverter.cpp.
#pragma once

#include <string>

#include "tools/logs/log_reading.hpp"
#include "tools/logs/measured_log.hpp"

namespace wheelwright::tools {

// `run`: this test alone, as its key or with _ for -; "": all. Every test is a run. Problems' lines are rows
// of the test that they name.
MeasuredLogs read_sysid_json(const std::string& text, const LogReading& reading, const std::string& run = "");

}  // namespace wheelwright::tools
