#include "firmware/task/robot_file_text.hpp"

#include <array>
#include <charconv>
#include <cstdio>

#include "firmware/task/robot_file.hpp"

namespace wheelwright::task {

NumberRange range_of(const model::ParameterInfo& info) {
    return {info.minimum, info.maximum, info.unit, info.kind == model::ParameterKind::integer,
            info.automatic()};
}

std::string plain_number(double value) {
    std::array<char, 40> buffer{};
    const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
    return {buffer.data(), end};
}

std::string shortest_number(double value) {
    std::string text = plain_number(value);
    if (text.find_first_not_of("-0123456789") == std::string::npos) text += ".0";
    return text;
}

std::string quantity_text(double value, std::string_view unit) {
    return unit.empty() ? plain_number(value) : plain_number(value) + " " + std::string(unit);
}

std::string range_text(const NumberRange& range) {
    return std::string(range.whole ? "a whole number from " : "a number from ") +
           plain_number(range.minimum) + " to " + quantity_text(range.maximum, range.unit) +
           (range.automatic ? ", or \"auto\"" : "");
}

std::string choices_text(std::span<const std::string_view> choices) {
    std::string text;
    for (const std::string_view name : choices) {
        if (!text.empty()) text += " or ";
        text.append("\"").append(name).append("\"");
    }
    return text;
}

std::string range_hint(double value, const NumberRange& range) {
    struct Slip {
        std::string_view unit, other;
        double factor;
    };
    constexpr std::array slips{
        Slip{"m", "mm", 1e-3},
        Slip{"s", "ms", 1e-3},
        Slip{"rad", "degrees", 0.017453292519943295},
        Slip{"s", "us", 1e-6},
        Slip{"bit/s", "kbit/s", 1e3},
        Slip{"bit/s", "Mbit/s", 1e6},
        Slip{"m/s", "km/h", 1 / 3.6},
        Slip{"kg", "g", 1e-3},
    };
    for (const Slip& slip : slips) {
        const double converted = value * slip.factor;
        if (slip.unit == range.unit && value != 0 && converted >= range.minimum &&
            converted <= range.maximum) {
            std::array<char, 96> text{};
            std::snprintf(text.data(), text.size(), "; %.12g %.*s would be %.12g", value,
                          static_cast<int>(slip.other.size()), slip.other.data(), converted);
            return text.data();
        }
    }
    return "";
}

}  // namespace wheelwright::task
