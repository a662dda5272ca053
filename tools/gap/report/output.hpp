// What `wheelwright gap` says: words, gap.json (docs/gap.md), report.html. The robot files are
// robot_files.hpp's.
#pragma once

#include <string>

#include "tools/gap/gap_analysis.hpp"

namespace wheelwright::gap {

std::string words(const Findings& findings);
std::string json(const Findings& findings, const Request& request);

// Throws std::runtime_error as report::Page::write().
void write_page(const Findings& findings, const Request& request, const std::string& path);

}  // namespace wheelwright::gap
