// Checks for numbers on the command line that say in plain words what is expected. CLI11's own accept NaN and
// print the largest double. CLI11 is slow to compile: for the files that include it already.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <string>
#include <utility>

namespace wheelwright::tools {

template <typename Good>
CLI::Validator number_check(std::string expected, Good good) {
    const auto judge = [expected, good](const std::string& text) {
        char* end = nullptr;
        const double value = std::strtod(text.c_str(), &end);
        if (!text.empty() && *end == '\0' && good(value)) return std::string();
        return "found " + text + ", expected a number " + expected;
    };
    return {judge, ""};
}

// Up to what no clock or robot reaches, so that nothing overflows and infinity is refused.
inline CLI::Validator greater_than_zero() {
    return number_check("greater than 0", [](double value) { return value > 0 && value <= 1e9; });
}

// The bounds are printed as they are written here.
inline CLI::Validator from_to(std::string low, std::string high) {
    const double least = std::stod(low);
    const double most = std::stod(high);
    return number_check("from " + std::move(low) + " to " + std::move(high),
                        [=](double value) { return value >= least && value <= most; });
}

}  // namespace wheelwright::tools
