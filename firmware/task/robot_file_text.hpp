// How the diagnostics of a robot file word numbers, ranges and choices. Used by robot_file*.cpp.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "firmware/model/robot_parameters.hpp"

namespace wheelwright::task {

struct NumberRange {
    double minimum, maximum;
    std::string_view unit;   // "" for none
    bool whole = false;      // no fractions
    bool automatic = false;  // "auto" too
};
NumberRange range_of(const model::ParameterInfo& info);

// For people: no ".0" behind whole numbers. shortest_number() is the text for a file.
std::string plain_number(double value);

// "0.5 m"; the number alone without a unit.
std::string quantity_text(double value, std::string_view unit);

// "a number from 0.01 to 5 m"
std::string range_text(const NumberRange& range);

// "\"one\" or \"other\""
std::string choices_text(std::span<const std::string_view> choices);

// A clause for a number that would be in range in another unit ("; 80 mm would be 0.08"), or "".
std::string range_hint(double value, const NumberRange& range);

}  // namespace wheelwright::task
