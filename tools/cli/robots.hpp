// The robot files that commands read.
#pragma once

#include <optional>
#include <string>

#include "firmware/task/robot_file.hpp"

namespace wheelwright::tools {

// Where an example robot lies ("default.toml", "simulated.toml", ...): beside an installed program
// (share/wheelwright/robots), else in the source tree. May not exist: whoever reads it says so.
std::string example_robot(const std::string& name);

// Nothing after what is wrong with the file has been said on standard error, a line each.
std::optional<task::RobotFile> read_robot(const std::string& path);

}  // namespace wheelwright::tools
