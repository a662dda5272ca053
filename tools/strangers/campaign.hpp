// Many drawn robots, each in a simulation of its own, some at a time.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "tools/cli/progress_line.hpp"
#include "tools/strangers/trial.hpp"

namespace wheelwright::tools {

// The results in the order of `robots`; fewer when `stop` said so. `progress` is called by one thread at a
// time.
std::vector<RobotResult> run_robots(const std::vector<DrawnRobot>& robots, std::size_t jobs,
                                    const TrialOptions& options,
                                    const std::function<void(const CampaignProgress&)>& progress,
                                    const std::function<bool()>& stop);

}  // namespace wheelwright::tools
