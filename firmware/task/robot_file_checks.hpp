// What can be said of a robot file only when all of it has been read: its keys together. Used by
// robot_file.cpp, in this order.
#pragma once

#include "firmware/task/robot_file_diagnostics.hpp"

namespace wheelwright::task {

// Sets what the file leaves to follow from other keys: K5..K8 from [mass], or K6 from K5. A problem when half
// of that is missing, when both are given, or when what follows is out of range.
void complete_dynamics(RobotFile& robot, Diagnostics& diagnostics);

// A problem for keys that contradict each other: drives, limits and digital lines.
void find_contradictions(const RobotFile& robot, Diagnostics& diagnostics);

// A note for what is legal but worth a look.
void take_notes(const RobotFile& robot, Diagnostics& diagnostics);

}  // namespace wheelwright::task
