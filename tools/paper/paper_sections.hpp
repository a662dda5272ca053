// The page's parts, and what they have in common.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "tools/paper/reproduction.hpp"
#include "tools/report/format.hpp"
#include "tools/report/page.hpp"

namespace wheelwright::paper {

void add_table1(report::Page& page, const Reproduction& from);  // Figs 10-17 too
void add_identification(report::Page& page, const Reproduction& from);
void add_velocity(report::Page& page, const Reproduction& from);
void add_pose(report::Page& page, const Reproduction& from);
void add_figure_eight(report::Page& page, const Reproduction& from);  // Figs 20, 21
void add_adaptation(report::Page& page, const Reproduction& from);    // Fig 22

inline constexpr std::array<const char*, 4> kNames{"K5", "K6", "K7", "K8"};
inline constexpr const char* kThroughCan = "through CAN";
inline constexpr const char* kModel = "model";

inline std::string ms(double seconds, int decimals) {
    return report::with_unit(report::fixed(1000 * seconds, decimals), "ms");
}
inline std::string mm(double metres, int decimals) {
    return report::with_unit(report::fixed(1000 * metres, decimals), "mm");
}

inline std::vector<double> scaled(std::vector<double> values, double factor) {
    for (double& value : values) value *= factor;
    return values;
}

}  // namespace wheelwright::paper
