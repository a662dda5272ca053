// What was found, given to a robot over CAN: indexed parameters written, committed and saved.
#pragma once

#include <string>
#include <vector>

#include "firmware/task/robot_file.hpp"

namespace wheelwright::gap {

// Those of `changes` that are parameters go to the robot, with the effects they belong to made active; it
// must be in the idle mode. Shows old and new values and asks first, unless `agreed`. Returns the exit
// status.
int write_parameters(const std::vector<task::FileChange>& changes, const std::string& interface, bool agreed);

}  // namespace wheelwright::gap
