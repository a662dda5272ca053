// What came of the drawn robots, as text and JSON, and the aims.
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
    double least = 0, most = 0;  // the aim: between these, the ends included
    std::string unit, remark;
    bool reached() const { return value >= least && value <= most; }
};

// The demanded shares and bounds have their one home in report.cpp.
std::vector<Aim> aims_of(const std::vector<RobotResult>& results);
bool all_reached(const std::vector<Aim>& aims);

Report robots_report(const std::vector<RobotResult>& results, std::uint64_t seed);

}  // namespace wheelwright::tools
