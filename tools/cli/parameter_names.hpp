// Names of the indexed parameters, effects included: what people type and read where the bus has numbers.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/model/robot_parameters.hpp"

namespace wheelwright::tools {

struct NamedParameter {
    std::uint16_t index = 0;
    std::string key;  // dotted path in the robot file
    std::string unit;
    double minimum = 0, maximum = 0;
    bool automatic = false;          // "auto" too, which is 0
    std::optional<double> standard;  // effects have none
    model::ChangeWhen when = model::ChangeWhen::start;
    model::ParameterKind kind = model::ParameterKind::real;
    std::vector<std::string> choices;
    std::string meaning;
};

// All parameters by index, the effects' at the end.
std::vector<NamedParameter> all_parameters();

// By dotted key, or by number ("0x0082" or "130"); nothing when there is none.
std::optional<NamedParameter> find_named_parameter(std::string_view key_or_index);
std::optional<NamedParameter> find_named_parameter(std::uint16_t index);

// Reads what somebody typed for this parameter: a number, true or false, or a choice's name. On failure
// returns nothing and `expected` says what would have been right.
std::optional<double> parse_parameter_value(const NamedParameter& parameter, std::string_view text,
                                            std::string& expected);

// The value as people write it: a choice's name, true or false, or a number with a float's digits.
std::string parameter_value_text(const NamedParameter& parameter, float value);

std::string_view change_text(model::ChangeWhen when);  // "start", "idle", "any"

// A whole text as a finite number; nothing otherwise.
std::optional<double> parse_number(std::string_view text);

}  // namespace wheelwright::tools
