// What an effect of the catalogue is made of. An effect is a stateless type with static members; effects.hpp
// lists them. One equation serves simulation, identification and compensation:
//
//   torque that accelerates = applied torque + sum over parameters j of  p_j * column_j(motion)
//
// where a column is the pair of wheel torques that one unit of the parameter produces.
//
// An effect provides:
//   static constexpr EffectInfo info;                                    name, meaning, parameters
//   and, per parameter j, one of
//   static WheelPair<Real> smooth_column(unsigned j, const Motion<Real>&);   smooth: torque per unit
//   static WheelPair<Real> dry_direction(unsigned j);                        dry: sliding speed is
//       s = d.left * speed.left + d.right * speed.right, and the friction torque is -lambda * d with
//       lambda = p_j sign(s) while sliding, |lambda| <= p_j while sticking.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "firmware/model/types.hpp"

namespace wheelwright::model {

struct EffectParameterInfo {
    std::string_view name;  // with its unit, as in the robot file
    std::string_view unit;
    double minimum;
    double maximum;
    std::string_view meaning;
};

struct EffectInfo {
    std::string_view name;  // canonical: the robot file's and every report's
    std::string_view meaning;
    std::string_view source;  // where the equation comes from
    std::span<const EffectParameterInfo> parameters;
};

inline constexpr std::size_t kMaxEffectParameters = 4;

// What the effects may depend on.
template <typename Real>
struct Motion {
    WheelPair<Real> wheel_speed_rad_per_s;
    WheelPair<Real> wheel_angle_rad;
    Twist<Real> twist;
    Real heading_rad{};
};

}  // namespace wheelwright::model
