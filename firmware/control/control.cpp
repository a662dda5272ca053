// Compiles every control template for both scalars, under the core's options (no exceptions, no RTTI).
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
template class TwistRateLimiter<double>;
template class WheelObserver<float>;
template class WheelObserver<double>;
template class VelocityLoop<float>;
template class VelocityLoop<double>;
template class LoopDesign<float>;
template class LoopDesign<double>;
template class PathPace<float>;
template class PathPace<double>;
template class PoseController<float>;
template class PoseController<double>;
template class StreamedReference<float>;
template class StreamedReference<double>;
template class TrajectoryTracker<float>;
template class TrajectoryTracker<double>;
template class Odometry<float>;
template class Odometry<double>;
template ReferencePoint<float> path_point(const PathSettings<float>&, float);
template ReferencePoint<double> path_point(const PathSettings<double>&, double);
template Twist<float> paper_pose_law(const PoseControlSettings<float>&, const PolarError<float>&, bool);
template Twist<double> paper_pose_law(const PoseControlSettings<double>&, const PolarError<double>&, bool);

}  // namespace wheelwright::control
