// Logs of torques and wheel speeds, read and looked at before any model: what they say of their sensors, and
// which of their intervals cannot be believed.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "tools/ident/findings.hpp"
#include "tools/ident/speed_rows.hpp"

namespace wheelwright::tools {

struct MeasuredSignals {
    std::vector<MeasuredLog> logs;   // of one rate
    std::vector<std::string> names;  // their files
    std::vector<SpeedRun> runs;      // the logs without wheels that stand, readings that are stuck, reversals
    std::array<double, 2> speed_noise_power{};  // rad^2/s^2, of white noise: left, right
};

// Reads measured logs; each of their segments is a log. `findings` gets the logs' facts, notes of what was
// left out, and problems: where it has any, what is returned is not to be used. The runs point to the logs.
MeasuredSignals look_at_measured_logs(const std::vector<std::string>& paths, const LogReading& reading,
                                      Findings& findings);

}  // namespace wheelwright::tools
