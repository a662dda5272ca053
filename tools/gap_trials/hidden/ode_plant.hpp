// The robot on the Open Dynamics Engine: bodies, wheels on hinges, castor, contacts, slip, slope, payload and
// centre of gravity are the engine's own, and so are the frictions, as joint motors and joint torques.
#pragma once

#include <memory>

#include "tools/gap_trials/hidden/effects.hpp"
#include "tools/gap_trials/hidden/plant.hpp"
#include "tools/gap_trials/hidden/robot.hpp"

namespace wheelwright::hidden {

// Stands at rest at the origin, heading along x. Steps up to 0.5 ms. Several may live in several threads. A
// plant's motion depends on its arguments alone. `hidden` must live longer than the plant.
//
//   viscous_friction       joint torque -c speed
//   coulomb_friction       joint motor with wanted speed 0 and that largest torque
//   stribeck_friction      the same, the largest torque coulomb + (static - coulomb) exp(-(speed /
//   stribeck)^2) quadratic_drag         force -drag v |v| on the middle of the axle turning_scrub          a
//   dry joint between body and ground about the vertical castor_drag            a castor on a swivel arm_m
//   ahead of the axle, its wheel trail_m behind the swivel; the
//                          wheel rolls with the dry drag rolling_N, the swivel turns with the dry torque
//                          swivel_Nm. Every other robot has a castor without any friction there.
//   slope                  gravity tilted by angle_rad, uphill towards uphill_rad (from the first heading,
//                          counter-clockwise)
//   cog_lateral            the body's centre of gravity moved so that the robot's is offset_m to the left
//   wheel_radius_mismatch  right radius over left is 1 + relative, their mean the robot's
//   wheel_slip             tyre force = friction_coefficient * load * slip / slip_speed, at most
//                          friction_coefficient * load
//   payload_step           at time_s a body of this mass and yaw inertia is fixed over the centre of gravity
//   backlash               takes the motor's inertia from the wheel
std::unique_ptr<Plant> make_ode_plant(const Robot& robot, const HiddenSet& hidden);

}  // namespace wheelwright::hidden
