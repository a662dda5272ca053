// Compiles every control template once, under the core's options (no exceptions, no RTTI); with double in
// control_double.cpp.
#include "firmware/control/feedback_linearisation.hpp"
#include "firmware/control/limits.hpp"
#include "firmware/control/loop_design.hpp"
#include "firmware/control/odometry.hpp"
#include "firmware/control/path_pace.hpp"
#include "firmware/control/pose_control.hpp"
#include "firmware/control/tracking.hpp"
#include "firmware/control/trajectory.hpp"
#include "firmware/control/velocity_loop.hpp"
#include "firmware/control/wheel_observer.hpp"

namespace wheelwright::control {

template class TwistRateLimiter<float>;
template class WheelObserver<float>;
template class VelocityLoop<float>;
template class LoopDesign<float>;
template class PathPace<float>;
template class PoseController<float>;
template class StreamedReference<float>;
template class TrajectoryTracker<float>;
template class Odometry<float>;
template ReferencePoint<float> path_point(const PathSettings<float>&, float);
template Twist<float> paper_pose_law(const PoseControlSettings<float>&, const PolarError<float>&, bool);

}  // namespace wheelwright::control
