// What `wheelwright gap` says: words, gap.json (docs/gap.md), report.html. The robot files are
// robot_files.hpp's.
#pragma once

#include <span>
#include <string>

#include "tools/gap/analysis.hpp"

namespace wheelwright::gap {

std::string name_of(std::size_t effect);
// With commas between.
std::string joined(std::span<const std::string> names);
template <typename Effects>
std::string names_of(const Effects& effects) {
    std::vector<std::string> names;
    for (const std::size_t effect : effects) names.push_back(name_of(effect));
    return joined(names);
}

std::string words(const Findings& findings);
std::string json(const Findings& findings, const Request& request);

// Throws std::runtime_error as report::Page::write().
void write_page(const Findings& findings, const Request& request, const std::string& path);

}  // namespace wheelwright::gap
