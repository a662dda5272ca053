// Reads a measured log of any form but candump: CSV, or WPILib SysId's JSON, told apart by the first
// character.
#pragma once

#include <optional>
#include <string>

#include "tools/logs/log_reading.hpp"
#include "tools/logs/measured_log.hpp"

namespace wheelwright::tools {

// FILE, or FILE.json:RUN for one test of a SysId file.
struct LogPath {
    std::string file, run;
};
LogPath log_path(const std::string& path);

enum class LogForm { candump, csv, sysid_json };
// Nothing if it cannot be opened (errno says why).
std::optional<LogForm> log_form(const std::string& path);

// A file that cannot be opened is a problem of line 0.
MeasuredLogs read_measured_log(const std::string& path, const LogReading& reading = {});

}  // namespace wheelwright::tools
