// The robot files that an analysis writes: what it found as text. What is said of free runs and of the
// controller is of the robots that are read back from these texts, and from nothing else.
#pragma once

#include <string>
#include <vector>

#include "firmware/task/robot_file.hpp"
#include "tools/gap/analysis.hpp"

namespace wheelwright::gap {

// What was found, as values for a robot file.
std::vector<task::FileChange> changes(const Findings& findings, const Request& request);

// Sets `extended_file` and `before_file`, or `file_problem`, from K5..K8, their errors and the effects.
void make_files(Findings& findings, const Request& request);

// A text made above, read back. `problem`: why it is no robot for the simulator.
struct ReadBack {
    std::optional<task::RobotFile> file;
    std::optional<SimulatedRobot> robot;
    std::string problem;
};
ReadBack read_back(const std::string& text, const std::string& name);

// "" where it cannot be read.
std::string text_of_file(const std::string& path);

// Writes robot.extended.toml and robot.before.toml into a folder. "" or what went wrong.
std::string write_robots(const Findings& findings, const std::string& folder);

struct KFigure {
    const char* key;  // in [dynamics]
    const char* unit;
    double value, error;
};
// Those of K5..K8 that the log shows.
std::vector<KFigure> known_k(const model::Dynamics<double>& value, const model::Dynamics<double>& error,
                             const std::vector<std::string>& unknowable);

}  // namespace wheelwright::gap
