#include "tools/report/format.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string_view>

namespace wheelwright::report {
namespace {

constexpr std::string_view kMinus = "\u2212";
constexpr std::string_view kNarrowSpace = "\u202f";  // narrow, does not break

std::string printed(const char* format, int digits, double value) {
    std::array<char, 400> text{};
    std::snprintf(text.data(), text.size(), format, digits, value);
    return text.data();
}

bool all_zero(const std::string& digits) { return digits.find_first_of("123456789") == std::string::npos; }

std::string with_minus(std::string text) {
    if (text.empty() || text[0] != '-') return text;
    text.erase(0, 1);
    return all_zero(text) ? text : std::string(kMinus) + text;
}

std::string superscript(int number) {
    constexpr std::array<std::string_view, 10> kDigits{"\u2070", "\u00b9", "\u00b2", "\u00b3", "\u2074",
                                                       "\u2075", "\u2076", "\u2077", "\u2078", "\u2079"};
    std::string text = number < 0 ? "\u207b" : "";
    for (const char digit : std::to_string(std::abs(number)))
        text += kDigits[static_cast<std::size_t>(digit - '0')];
    return text;
}

}  // namespace

std::string fixed(double value, int decimals) {
    if (!std::isfinite(value)) return "not finite";
    return with_minus(printed("%.*f", decimals, value));
}

std::string signed_fixed(double value, int decimals) {
    const std::string text = fixed(value, decimals);
    return value > 0 && !all_zero(text) ? "+" + text : text;
}

std::string scientific(double value, int decimals) {
    if (!std::isfinite(value)) return "not finite";
    if (value == 0) return "0";
    const std::string text = printed("%.*e", decimals, value);
    const std::size_t e = text.find('e');
    return with_minus(text.substr(0, e)) + std::string(kNarrowSpace) + "\u00d7" + std::string(kNarrowSpace) +
           "10" + superscript(std::atoi(text.c_str() + e + 1));
}

std::string significant(double value, int digits) {
    if (!std::isfinite(value)) return "not finite";
    if (value == 0) return "0";
    // the exponent after rounding: 0.09996 to three digits is 0.100
    const std::string text = printed("%.*e", digits - 1, value);
    const int exponent = std::atoi(text.c_str() + text.find('e') + 1);
    if (exponent < -4 || exponent > 6) return scientific(value, digits - 1);
    const int decimals = digits - 1 - exponent;
    return fixed(std::strtod(text.c_str(), nullptr), decimals > 0 ? decimals : 0);
}

std::string signed_significant(double value, int digits) {
    const std::string text = significant(value, digits);
    return value > 0 && std::isfinite(value) ? "+" + text : text;
}

std::string percent(double share, int decimals) { return with_unit(fixed(100 * share, decimals), "%"); }

std::string with_unit(const std::string& number, const std::string& unit) {
    return unit.empty() ? number : number + std::string(kNarrowSpace) + unit;
}

}  // namespace wheelwright::report
