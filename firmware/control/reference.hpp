// What the control layers hand to each other.
#pragma once

#include "firmware/model/types.hpp"

namespace wheelwright::control {

// What the velocity loops are asked for. `rate` is the reference's own time derivative where it is known
// (trajectories); zero where the reference steps.
template <typename Real>
struct VelocityReference {
    Twist<Real> twist;
    TwistRate<Real> rate;
};

// One instant of a reference path in the fixed frame: where, how fast, and how that changes.
template <typename Real>
struct ReferencePoint {
    Pose<Real> pose;
    Twist<Real> twist;  // along the reference heading
    TwistRate<Real> rate;
};

}  // namespace wheelwright::control
