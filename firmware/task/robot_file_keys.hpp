// The keys that a robot file may have. Used by robot_file*.cpp.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "firmware/task/robot_file.hpp"

namespace wheelwright::task {

// An effect's parameters stand in [effects.NAME], each with its standard error beside it.
inline constexpr std::string_view kEffectsTable = "effects";
inline constexpr std::string_view kErrorSuffix = "_standard_error";

struct KnownKey {
    std::string path;
    std::string_view unit;
};

// Every key a robot file may have.
std::vector<KnownKey> known_keys();

// Names of what a known table ("" is the root) may hold, with commas; "" when no known key lies below `path`.
std::string names_below(const std::string& path);

// nullptr when unknown.
const SimulationInfo* find_simulation(std::string_view key);
const MassInfo* find_mass(std::string_view key);

// Of text_table().
bool is_text_key(std::string_view key);

}  // namespace wheelwright::task
