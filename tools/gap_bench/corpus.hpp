// A folder of robots: robots.json, and beside it a folder for each robot with one log per run.
//   robots.json: {"NAME": {"wheel_radius_m": 0.0762, "track_m": 0.6, "Nm_per_V": 1, "heldout_rms_rad_s": {
//                    "RUN": {"signal": .., "torque_only": .., "sysid_regression": ..}}}}
//   NAME/RUN.csv, or NAME/*.json of WPILib SysId with one run for each test
// Nm_per_V, what a volt of such a file counts as, heldout_rms_rad_s and each figure in it may be missing;
// other keys are ignored.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "firmware/model/dynamics.hpp"
#include "tools/logs/log_reading.hpp"
#include "tools/logs/measured_log.hpp"

namespace wheelwright::bench {

// Held-out errors of a run as they were published.
struct Published {
    std::optional<double> signal, torque_alone, sysid;
};

struct CorpusRun {
    std::string name;
    std::string path;  // as `gap` takes it
    std::vector<tools::MeasuredLog> segments;
    std::string unusable;  // why, else empty
    bool forward = false;  // goes forward more than it turns: the others say nothing of going forward
    Published published;
};

struct CorpusRobot {
    std::string name;
    model::Geometry<double> geometry;
    std::optional<double> torque_per_volt_Nm;  // where runs are in volts, and robots.json says it
    std::vector<CorpusRun> runs;               // by name
};

struct Corpus {
    std::vector<CorpusRobot> robots;    // by name
    std::vector<std::string> problems;  // "file: what is wrong"; then there are no robots
};

// `only`: these robots; none: all. `reading`: of all logs, but for what robots.json says.
Corpus read_corpus(const std::string& folder, const std::vector<std::string>& only,
                   const tools::LogReading& reading);

// The runs of one log: one, or a SysId file's. Published figures are not set.
std::vector<CorpusRun> read_runs(const std::string& path, const tools::LogReading& reading);

}  // namespace wheelwright::bench
