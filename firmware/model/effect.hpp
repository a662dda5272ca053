// What an effect of the catalogue is made of. An effect is a stateless type with static members; effects.hpp
// lists them. One equation serves simulation, identification and compensation:
//
//   torque that accelerates = applied torque + sum over the effect's coordinates c_k of  c_k * column_k
//
// where a column is what one unit of the coordinate does, as a pair of wheel torques or as a force on the
// body (which is the pair of wheel torques that does the same work, wheel_torque_Nm()).
//
// An effect provides:
//   static constexpr EffectInfo info;                                    name, meaning, parameters
//   and one of
//   static Push column(unsigned k, const EffectContext<Real>&);          smooth: what one unit does
//   static WheelPair<Real> each_wheel(const EffectContext<Real>&);       smooth, two parameters, left and
//       right: what one unit of each does to its own wheel, and nothing to the other
//   static Push dry_direction<Real>(unsigned j);                         dry: with d its wheel torques, the
//       sliding speed is s = d.left * speed.left + d.right * speed.right, and the friction torque is -lambda
//       * d with lambda = p_j sign(s) while sliding, |lambda| <= p_j while sticking.
//   static WheelPair<Real> torque(const Parameters<Real>&, const EffectContext<Real>&);
//       smooth and linear in nothing
// where Push is WheelPair<Real> or BodyForce<Real>. The coordinates are the parameters, unless it provides
//   static constexpr std::size_t coordinate_count;
//   static Parameters<Real> coordinates(const Parameters<Real>&);        in which it is linear; and
//   static Parameters<Real> from_coordinates(const Parameters<Real>&);   back
// An effect on the torque's way to the wheel, whose columns depend on the applied torque, also provides
//   static WheelPair<Real> asked(const Parameters<Real>&, const WheelPair<Real>& delivered_Nm);
//       what to apply for a wanted torque: the controllers' compensation. Several act in catalogue order.
//
// An effect on the torque's way to the wheel that is told by what it makes of each wheel's torque provides
//   static constexpr int path_place;                                     order on the way
//   struct Memory<Real>;                      what it remembers of one wheel: fixed size, begins as made
//   static Real deliver(const Parameters<Real>&, Memory<Real>&, const PathInstant<Real>&);
//       the mean torque that arrives over the step that begins now; advances the memory. torque_path.hpp puts
//       them one behind the other.
// An effect on what a drive or sensor reports provides
//   static Real report_speed(const Parameters<Real>&, Memory<Real>&, Real speed_rad_per_s, Real step_s);
//   or static Real report_yaw_rate(const Parameters<Real>&, Real yaw_rate_rad_per_s);
// Effects that are none of these say in their own file what they change and with which functions.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string_view>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/types.hpp"

namespace wheelwright::model {

// A text for people. A bare target has nobody to read it, and does not carry it.
// NOLINTBEGIN(google-explicit-constructor): a literal becomes one
struct NoText {
    constexpr NoText(const char*) {}
};
struct Words : std::conditional_t<kBare, NoText, std::string_view> {
    consteval Words(const char* text = "") : std::conditional_t<kBare, NoText, std::string_view>(text) {}
};
// NOLINTEND(google-explicit-constructor)

struct EffectParameterInfo {
    std::string_view name;  // with its unit, as in the robot file
    Words unit;
    double minimum;
    double maximum;
    Words meaning;
};

struct EffectInfo {
    std::string_view name;  // canonical: the robot file's and every report's
    Words meaning;
    Words source;  // where the equation comes from
    std::span<const EffectParameterInfo> parameters;
    // One of the two: what the controllers do about it, or why they do nothing.
    Words compensation{};
    Words uncompensated_because{};
};

inline constexpr std::size_t kMaxEffectParameters = 4;

// Values of an effect's parameters, or of its coordinates; those it does not have are 0.
template <typename Real>
using Parameters = std::array<Real, kMaxEffectParameters>;

template <typename Real>
struct Motion {
    WheelPair<Real> wheel_speed_rad_per_s;
    WheelPair<Real> wheel_angle_rad;
    Twist<Real> twist;
    Real heading_rad{};
};

// What the effects may depend on. Refers to what it is made of.
template <typename Real>
struct EffectContext {
    const Motion<Real>& motion;
    WheelPair<Real> applied_torque_Nm;  // used by effects on the torque's way only
    const Geometry<Real>& geometry;
    const Dynamics<Real>& dynamics;
};

// One wheel's torque on its way, over a step.
template <typename Real>
struct PathInstant {
    Real torque_Nm{};  // as it comes from the stage before, held over the step
    Real speed_rad_per_s{};
    Real angle_rad{};  // of the wheel when the step begins, as is the speed
    Real time_s{};     // since the beginning of the run
    Real step_s{};     // > 0
    Real span_s = 60;  // length of the whole run
    bool right = false;
};

// On the body, at the middle of the axle.
template <typename Real>
struct BodyForce {
    Real force_N{};  // forward
    Real yaw_torque_Nm{};
};

// The wheel torques that do the same work: tau_L w_L + tau_R w_R = F v + N omega for every motion.
template <typename Real>
constexpr WheelPair<Real> wheel_torque_Nm(const Geometry<Real>& g, const BodyForce<Real>& push) {
    const Real half = push.force_N / 2;
    const Real couple = push.yaw_torque_Nm / g.track_m;
    return {g.wheel_radius_m.left * (half - couple), g.wheel_radius_m.right * (half + couple)};
}
template <typename Real>
constexpr WheelPair<Real> wheel_torque_Nm(const Geometry<Real>&, const WheelPair<Real>& torque_Nm) {
    return torque_Nm;
}

}  // namespace wheelwright::model
