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

// A wheel in the air is alone: nothing that the other one does moves it, nor the other way round. On the
// ground that is so only by chance, where the yaw inertia is the one that makes it so. What a wheel does
// alone, and more than the other one by this: between a drive that gives 0.7 of what it should (1.43) and a
// lifted wheel whose rotor is 0.6 of all that the torque moves (1 / 0.6). A centre of gravity a tenth of the
// track beside the middle makes 1.5 at most. One farther out, or one beside a weak drive, makes more; where
// it is by chance, too, that the wheels do nothing to each other, only what speed does tells the floor
// (speed_witness.hpp).
inline constexpr double kAlone = 1.55;
// Of a wheel's own answer: what the probe's pushes leave of friction; where that is more than noise, 0.31 %
// at most on 156 lifted wheels that ran 1.7 to 3.5 times as fast as the other.
inline constexpr double kPushedApart = 0.005;

// `error`: of the answers. `apart`: an answer to the other wheel that counts as none. Where friction does not
// cancel in them (pushes so gentle that a wheel hangs in it for part of the time), and where the
// wheel that moves more is known to be on the floor, `alone_tells` is false: only runs_free() is sure.
inline protocol::IdentCause wheel_off_ground(const WheelAnswers& answers, double error, double apart,
                                             bool alone_tells = true) {
    const auto& [own, other] = answers;
    const bool alone = std::max(std::abs(other.left), std::abs(other.right)) < apart;
    return runs_free({own.left + error, own.right + error}, alone_tells && alone ? kAlone : kRunsFree);
}

}  // namespace wheelwright::ident
