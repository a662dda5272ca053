// The control templates with double, for machines that have it.
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

template class TwistRateLimiter<double>;
template class WheelObserver<double>;
template class VelocityLoop<double>;
template class LoopDesign<double>;
template class PathPace<double>;
template class PoseController<double>;
template class StreamedReference<double>;
template class TrajectoryTracker<double>;
template class Odometry<double>;
template ReferencePoint<double> path_point(const PathSettings<double>&, double);
template Twist<double> paper_pose_law(const PoseControlSettings<double>&, const PolarError<double>&, bool);

}  // namespace wheelwright::control
