// What `wheelwright gap` writes: words, gap.json (docs/gap.md),
// robot.extended.toml, report.html.
#pragma once

#include <string>
#include <vector>

#include "firmware/task/robot_file.hpp"
#include "tools/gap/gap_analysis.hpp"

namespace wheelwright::gap {

std::string words(const Findings& findings);
std::string json(const Findings& findings, const Request& request);

// What was found, as values for a robot file.
std::vector<task::FileChange> changes(const Findings& findings, const Request& request);

// The given robot file, or a new one with the geometry, and in it what was
// found. "" or what went wrong.
std::string write_robot(const Findings& findings, const Request& request, const std::string& model_path,
                        const std::string& path);

// Throws std::runtime_error as report::Page::write().
void write_page(const Findings& findings, const Request& request, const std::string& path);

}  // namespace wheelwright::gap
