// What came of the drawn robots, as text, JSON and page, and the aims.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/cli/report.hpp"
#include "tools/strangers/trial.hpp"

namespace wheelwright::tools {

// One thing that is asked of all robots together.
struct Aim {
    std::string key, label;
    double value = 0;
    double least = 0, most = 0;  // the aim: between these, the ends included; both infinite: none
    std::string unit, remark;
    bool reached() const { return value >= least && value <= most; }
    std::string asked() const;  // "at most 2"; "-"
};

struct RobotsRun {
    std::uint64_t seed = 1;
    bool faults = false;  // the robots have faults on purpose
};

// The demanded shares and bounds have their one home in report.cpp.
std::vector<Aim> aims_of(const std::vector<RobotResult>& results, const RobotsRun& run);
bool all_reached(const std::vector<Aim>& aims);

Report robots_report(const std::vector<RobotResult>& results, const RobotsRun& run);

// Everything about one of them.
Report robot_report(const RobotResult& result);

// One self-contained HTML file. Throws std::runtime_error when it cannot be written.
void write_robots_page(const std::vector<RobotResult>& results, const RobotsRun& run,
                       const std::string& path);

}  // namespace wheelwright::tools
