// What explains a log linearly: the effects whose size is a factor, as series that a least-squares fit may
// add to the robot's accelerations.
#pragma once

#include <vector>

#include "tools/gap_trials/hidden/oracle_views.hpp"

namespace wheelwright::hidden {

// How a coefficient of the forward equation returns in the yaw equation.
enum class Tie {
    alone,   // one of the equations only: the ratio is not used
    torque,  // a wheel torque: K8 / K7
    force,   // a force and its moment: 2 K8 / (b K7)
};

struct Column {
    Tie tie = Tie::alone;
    bool not_negative = false;  // its coefficient
    bool integrated = true;     // an acceleration; else a part of the speed itself
    bool held = false;          // between samples, as torques are
    Series forward = {};        // empty: none
    Series turning = {};
    Series gyro = {};  // of the yaw equation's coefficient; not integrated
};

// Those of all candidates, in their order. Effects that are not linear in anything have none.
std::vector<Column> columns_of(const CleanLog& log, const View& view,
                               const std::vector<Candidate>& candidates);

// As many columns as two effects can have.
inline constexpr int kMostColumns = 8;

}  // namespace wheelwright::hidden
