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
    const auto& [own, other] = answers;
    const double coupling =
        std::max(std::abs(other.left), std::abs(other.right)) / std::max(own.left, own.right);
    // A drive that gives 0.7 of what it should makes 1.43, and a lifted wheel whose rotor is 0.6 of all that
    // the torque moves 1 / 0.6. A centre of gravity a tenth of the track beside the middle makes up to 1.54
    // with a coupling below 0.05, and 1.7 with more.
    double ratio = kRunsFree;
    if (friction_cancels && coupling < 0.15) ratio = 2.2;
    if (friction_cancels && coupling < 0.05) ratio = 1.55;
    return runs_free({own.left + error, own.right + error}, ratio);
}

}  // namespace wheelwright::ident
