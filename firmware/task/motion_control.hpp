// The laws of the driving modes joined: from set-points and the measured motion to wheel torques. Each mode
// starts from the motion and the torque that it finds, so that switching between modes makes no bump.
//
// Threads: the cycle's. No call allocates, blocks or throws. One call of torque() runs one mode's law.
#pragma once

#include <cstdint>

#include "firmware/control/dither.hpp"
#include "firmware/control/feedback_linearisation.hpp"
#include "firmware/control/limits.hpp"
#include "firmware/control/loop_design.hpp"
#include "firmware/control/path_pace.hpp"
#include "firmware/control/pose_control.hpp"
#include "firmware/control/tracking.hpp"
#include "firmware/control/trajectory.hpp"
#include "firmware/control/velocity_loop.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"
#include "firmware/supervisor/modes.hpp"
#include "firmware/task/host_link.hpp"
#include "firmware/task/senses.hpp"

namespace wheelwright::task {

struct MotionOutput {
    WheelPair<Real> torque_Nm;
    Twist<Real> reference;
    Pose<Real> tracking_error;  // reference less robot, in the robot's frame: along, across, heading
    control::LimiterFlags limits;
    bool goal_reached = false;
    bool finite = true;
};

// Nothing that is not a number, and nothing over the limit: what of an output may leave the firmware.
MotionOutput guarded(const MotionOutput& wanted, double torque_limit_Nm);

class MotionControl {
  public:
    // Takes the robot file's numbers. The velocity loops' design begins anew when what it depends on has
    // changed; until it is accepted the former gains stay.
    void configure(const model::RobotParameters& parameters);

    // Completes what configure() began, the loops' design and the path's pace; start-up only.
    void finish_design();
    // One bounded piece of them.
    void step_design();
    bool design_accepted() const { return design_accepted_; }
    const control::LoopDesign<Real>& design() const { return design_; }

    // The controller's model. change_model() keeps the torque where it is; which effects are active stays.
    const control::PlantModel<Real>& plant() const { return plant_; }
    void change_model(const model::Dynamics<Real>& dynamics, const model::EffectSet<Real>& effects,
                      const model::Motion<Real>& measured);

    // What the trajectory modes follow, from when they are entered; some tens of cycles after this call the
    // path's pace is known. Where the mode comes before that, the robot goes on as it moves until then. Not
    // for while they drive.
    void select_trajectory(const protocol::TrajectoryCommand& command);
    // Of the selected path, as far as its pace is known; 0: it is streamed.
    double lap_s() const { return streamed() ? 0 : pace_.period_s(); }
    // When the path began that is driven now; 0: not yet.
    std::int64_t trajectory_start_ns() const { return trajectory_start_ns_; }
    bool streamed() const { return command_.shape == protocol::TrajectoryShape::streamed; }
    // The selected path's pace. Its path() is what is driven, but for the place where it begins.
    const control::PathPace<Real>& pace() const { return pace_; }
    protocol::TrajectoryPace told_pace() const;

    // Of the adaptive mode, where a path is driven.
    control::Dither<Real>& dither() { return dither_; }

    // Call in the cycle that enters a mode, before torque().
    void enter(supervisor::Law law, const Observed& now);

    // By the law of a mode; host holds the set-points. Zero without a law, and for excitation.
    MotionOutput torque(const supervisor::ModeRule& mode, const Observed& now, const HostLink& host);

    // Brakes to rest; begin_braking() once before.
    void begin_braking(const Observed& now);
    MotionOutput brake(const Observed& now);

    // Nothing drives: the loops forget.
    void release();

  private:
    MotionOutput open_loop(const WheelPair<Real>& wanted_Nm) const;
    // Towards the reference, as far as the robot can be held there.
    void drive(const Observed& now, control::VelocityReference<Real> reference, MotionOutput& out);
    MotionOutput drive_to(const Observed& now, const HostLink& host);
    bool runs_away(const Twist<Real>& target, const Twist<Real>& measured) const;
    MotionOutput follow(const Observed& now, const Twist<Real>& wanted);
    MotionOutput track(const Observed& now, const HostLink& host, bool dither);
    void begin_path(const Observed& now);
    void step_pace();
    void use_gains();
    void take_over(const Observed& now);

    model::RobotParameters parameters_;
    control::PlantModel<Real> plant_;
    control::LoopDesign<Real> design_;
    control::LoopDesignRequest<Real> request_;
    control::LoopGains<Real> gains_;
    bool design_accepted_ = false;
    control::VelocityLoop<Real> loop_;
    bool loops_drive_ = false;  // they gave the last cycle's torque
    control::Dither<Real> dither_;
    control::TwistRateLimiter<Real> limiter_;
    Real waiting_share_ = 1;  // of its accelerations, where the torque is short
    control::PoseController<Real> pose_;
    control::TrajectoryTracker<Real> tracker_;
    control::StreamedReference<Real> streamed_;
    std::int64_t streamed_time_ns_ = 0;
    protocol::TrajectoryCommand command_;
    control::PathPace<Real> pace_;
    control::PaceLimits<Real> pace_limits_;
    control::PathSettings<Real> path_;  // driven
    std::int64_t trajectory_start_ns_ = 0;
};

}  // namespace wheelwright::task
