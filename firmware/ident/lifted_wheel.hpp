// A wheel in the air turns without taking the other one, or the robot, with it. A few operations, no
// allocation.
#pragma once

#include <algorithm>
#include <cmath>

#include "firmware/model/types.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"

namespace wheelwright::ident {

// What torques do to the wheels' rims [m/s^2 per Nm]: each wheel's own, and the other one's.
struct WheelAnswers {
    WheelPair<double> own, other;
};

// By so much that no drives, frictions and lateral centre of gravity do it.
inline constexpr double kRunsFree = 3.5;

// The wheel that moves `ratio` times as much as the other one, or more.
inline protocol::IdentCause runs_free(const WheelPair<double>& motion, double ratio = kRunsFree) {
    using protocol::IdentCause;
    if (motion.left > ratio * motion.right) return IdentCause::left_wheel_off_ground;
    return motion.right > ratio * motion.left ? IdentCause::right_wheel_off_ground : IdentCause::none;
}

// `error`: of the answers. Where friction does not cancel in them (pushes so gentle that a wheel hangs in it
// for part of the time), only runs_free() is sure.
inline protocol::IdentCause wheel_off_ground(const WheelAnswers& answers, double error,
                                             bool friction_cancels = true) {
    constexpr double kApart =
        0.15;  // of its own push: less than that a wheel on the ground drags the other with
    // And its own push moves it by so much more than the other one: between a drive that gives 0.7 of what it
    // should (1.43) and a lifted wheel whose rotor is 0.6 of all that the torque moves (1 / 0.6).
    constexpr double kFreeRatio = 1.55;
    const auto& [own, other] = answers;
    const bool apart =
        std::max(std::abs(other.left), std::abs(other.right)) < kApart * std::max(own.left, own.right);
    return runs_free({own.left + error, own.right + error},
                     apart && friction_cancels ? kFreeRatio : kRunsFree);
}

}  // namespace wheelwright::ident
