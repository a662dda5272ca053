// Which motion would tell two effects apart that a log does not.
#pragma once

#include <vector>

#include "firmware/model/effects.hpp"
#include "tools/excite/motions.hpp"
#include "tools/gap/model/members.hpp"

namespace wheelwright::gap {

// Two effects that a log does not tell apart, and what is known of the robot.
struct Confusion {
    std::size_t effect = 0, rival = 0;
    Setting setting;
    Points points;                     // of effects that are not linear
    model::EffectSet<double> effects;  // with the one named
    Members members;                   // of that model: whether left and right are one parameter
    double torque_rms_Nm = 0;          // that the robot was driven with, and
    double speed_rms_rad_per_s = 0;    // the wheel speeds it had: no motion goes beyond twice that
    WheelPair<double> noise_rad_per_s;
};
struct Separation {
    const excite::Motion* motion = nullptr;  // null: none of them
    double size_Nm = 0;
};
// The motion that the rival explains worst when the robot is what was named.
Separation separating_motion(const Confusion& confusion);

}  // namespace wheelwright::gap
