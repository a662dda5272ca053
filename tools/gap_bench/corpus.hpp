// A folder of robots: robots.json, and beside it a folder for each robot with one log per run.
//   robots.json: {"NAME": {"wheel_radius_m": 0.0762, "track_m": 0.6,
//                          "heldout_rms_rad_s": {"RUN": {"signal": .., "torque_only": .., "sysid_regression":
//                          ..}}}}
//   NAME/RUN.csv
// heldout_rms_rad_s, and each figure in it, may be missing; other keys are ignored.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "firmware/model/dynamics.hpp"
#include "tools/logs/measured_csv.hpp"

namespace wheelwright::bench {

// Held-out errors of a run as they were published.
struct Published {
    std::optional<double> signal, torque_alone, sysid;
};

struct CorpusRun {
    std::string name;
    std::string path;
    std::vector<tools::MeasuredLog> segments;
    std::string unusable;  // why, else empty
    bool forward = false;  // goes forward more than it turns: the others say nothing of going forward
    Published published;
};

struct CorpusRobot {
    std::string name;
    model::Geometry<double> geometry;
    std::vector<CorpusRun> runs;  // by name
};

struct Corpus {
    std::vector<CorpusRobot> robots;    // by name
    std::vector<std::string> problems;  // "file: what is wrong"; then there are no robots
};

// `only`: these robots; none: all.
Corpus read_corpus(const std::string& folder, const std::vector<std::string>& only);

// One log; published is not set.
CorpusRun read_run(const std::string& path);

}  // namespace wheelwright::bench
