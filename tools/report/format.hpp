// Numbers as people read them: a true minus, thin spaces, powers of ten. Not finite: "not finite".
#pragma once

#include <string>

namespace wheelwright::report {

std::string fixed(double value, int decimals);       // −14.3839
std::string significant(double value, int digits);   // 0.0431, 7.04 × 10⁻¹² where that is shorter
std::string scientific(double value, int decimals);  // 1.9617 × 10⁻⁶
std::string percent(double share, int decimals);     // of 0.135: 13.5 %
std::string with_unit(const std::string& number, const std::string& unit);  // 13.5 ms, space unbreakable
std::string signed_fixed(double value, int decimals);                       // +0.12, for differences
std::string signed_significant(double value, int digits);                   // likewise

}  // namespace wheelwright::report
