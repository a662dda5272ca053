// Motions that tell effects apart: torques over time, from rest. `wheelwright gap` simulates them to advise
// one, `wheelwright excite` drives it.
#pragma once

#include <span>
#include <string_view>

#include "firmware/model/types.hpp"

namespace wheelwright::excite {

struct Motion {
    std::string_view name;   // in gap.json, stable
    std::string_view words;  // for people
    double speed_share;      // of the fastest wheel speed that the robot is to reach
    WheelPair<double> (*torque_Nm)(double t_s, double size_Nm);
};
inline constexpr double kMotion_s = 12;  // of each

std::span<const Motion> motions();
const Motion* find_motion(std::string_view name);  // null: none is called so

}  // namespace wheelwright::excite
