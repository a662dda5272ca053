// What somebody probably meant by a key the robot file does not know. Used by robot_file.cpp.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "firmware/task/robot_file_keys.hpp"

namespace wheelwright::task {

// One clause without a full stop ("did you mean ...?"), or "" when nothing is near. `value` is the number
// given.
std::string hint_for_unknown(std::string_view path, std::optional<double> value,
                             std::span<const KnownKey> known);

// Number of single-character changes between two words, swaps of neighbours counted as one.
unsigned edit_distance(std::string_view a, std::string_view b);

}  // namespace wheelwright::task
