#include "firmware/task/motion_control.hpp"

#include <algorithm>
#include <cmath>

#include "firmware/task/cycle_schedule.hpp"

namespace wheelwright::task {
namespace {

using supervisor::Law;

bool same_request(const control::LoopDesignRequest<Real>& a, const control::LoopDesignRequest<Real>& b) {
    return a.method == b.method && a.settling_time_s == b.settling_time_s && a.damping == b.damping &&
           a.setpoint_weight == b.setpoint_weight && a.phase_margin_deg == b.phase_margin_deg &&
           a.sensitivity_peak == b.sensitivity_peak && a.cycle_s == b.cycle_s &&
           a.actuation_delay_s == b.actuation_delay_s &&
           a.observer_bandwidth_rad_per_s == b.observer_bandwidth_rad_per_s &&
           a.encoder_period_s == b.encoder_period_s;
}

// Paths that start at rest get up to pace over this share of their period. What that asks for is looked at
// with the rest of the path.
constexpr double kRampShare = 0.25;
// Points of a path whose pace is looked at in one cycle.
constexpr int kPacePoints = 2;

}  // namespace

MotionOutput guarded(const MotionOutput& wanted, double torque_limit_Nm) {
    MotionOutput output = wanted;
    WheelPair<Real>& torque = output.torque_Nm;
    output.finite = std::isfinite(torque.left) && std::isfinite(torque.right);
    if (!output.finite) torque = {};
    const Real limit = Real(torque_limit_Nm);
    torque.left = std::clamp(torque.left, -limit, limit);
    torque.right = std::clamp(torque.right, -limit, limit);
    return output;
}

void MotionControl::configure(const model::RobotParameters& parameters) {
    parameters_ = parameters;
    plant_ = control::plant_model<Real>(parameters);
    limiter_.configure(Real(parameters.limits.acceleration_m_per_s2),
                       Real(parameters.limits.yaw_acceleration_rad_per_s2));
    const auto [usual, usual_yaw] = control::usual_acceleration(parameters);
    waiting_share_ = Real(std::min(usual / parameters.limits.acceleration_m_per_s2,
                                   usual_yaw / parameters.limits.yaw_acceleration_rad_per_s2));
    pose_.configure(control::pose_control_settings<Real>(parameters));
    pace_limits_ = control::pace_limits<Real>(parameters);
    tracker_.configure(pace_limits_.tracking);
    select_trajectory(command_);
    const auto request = control::loop_design_request<Real>(parameters, Real(kCyclePeriod_s));
    if (!same_request(request, request_) || design_.status() == control::DesignStatus::none) {
        request_ = request;
        design_.begin(request);
        design_accepted_ = false;
    }
    use_gains();
}

void MotionControl::use_gains() {
    loop_.configure({gains_, Real(parameters_.limits.torque_Nm), Real(kCyclePeriod_s)});
}

void MotionControl::finish_design() {
    for (int i = 0;
         i < control::LoopDesign<Real>::kMostSteps && design_.status() == control::DesignStatus::running;
         ++i) {
        step_design();
    }
    while (pace_.running()) step_pace();
}

void MotionControl::step_pace() { pace_.step(plant_, pace_limits_); }

void MotionControl::step_design() {
    if (design_.status() != control::DesignStatus::running) {
        for (int i = 0; i < kPacePoints && pace_.running(); ++i) step_pace();
        return;
    }
    design_.step();
    if (design_.accepted()) {
        gains_ = design_.result().gains;
        design_accepted_ = true;
        use_gains();
    }
}

void MotionControl::change_model(const model::Dynamics<Real>& dynamics, const model::EffectSet<Real>& effects,
                                 const model::Motion<Real>& measured) {
    loop_.change_model(plant_, measured, [&](control::PlantModel<Real>& plant) {
        plant.dynamics = dynamics;
        model::for_each_active_index(
            plant.effects.active, [&](std::size_t i) { plant.effects.parameter[i] = effects.parameter[i]; });
    });
}

void MotionControl::select_trajectory(const protocol::TrajectoryCommand& command) {
    command_ = command;
    control::PathSettings<Real> path = control::standard_figure_eight<Real>(parameters_);
    if (!streamed()) path.kind = static_cast<control::PathKind>(command.shape);
    if (command.length_m != 0) path.length_m = Real(command.length_m);
    if (command.width_m != 0) path.width_m = Real(command.width_m);
    if (command.period_s != 0) path.period_s = Real(command.period_s);
    if (path.kind != control::PathKind::figure_eight) path.ramp_s = Real(kRampShare) * path.period_s;
    pace_.begin(path);
}

protocol::TrajectoryPace MotionControl::told_pace() const {
    protocol::TrajectoryPace told;
    told.shape = command_.shape;
    if (streamed()) return told;
    told.limited_by = static_cast<protocol::PaceLimit>(pace_.limited_by());
    told.asked_period_s = pace_.asked().period_s;
    told.period_s = pace_.period_s();
    return told;
}

// The figure-8 lies in the fixed frame, as in Fig. 20; the other paths begin where the robot stands.
void MotionControl::begin_path(const Observed& now) {
    path_ = pace_.path();
    if (path_.kind != control::PathKind::figure_eight) path_.origin = now.pose;
    trajectory_start_ns_ = now.now_ns;
}

// The loops take over from whatever drove last; where they drove themselves, they simply go on.
void MotionControl::take_over(const Observed& now) {
    if (!loops_drive_) loop_.start(plant_, now.motion, now.last_torque_Nm);
}

void MotionControl::enter(Law law, const Observed& now) {
    take_over(now);
    switch (law) {
        case Law::velocity:
            limiter_.reset(now.motion.twist);
            break;
        case Law::pose:
            pose_.start(now.motion.twist);
            break;
        case Law::path:
            tracker_.start(now.motion.twist);
            limiter_.reset(now.motion.twist);
            trajectory_start_ns_ = 0;
            streamed_.reset();
            streamed_time_ns_ = 0;
            break;
        case Law::none:
        case Law::torque:
        case Law::excitation:
            break;
    }
}

MotionOutput MotionControl::open_loop(const WheelPair<Real>& wanted_Nm) const {
    MotionOutput out;
    const Real limit = Real(parameters_.limits.torque_Nm);
    out.torque_Nm = {std::clamp(wanted_Nm.left, -limit, limit), std::clamp(wanted_Nm.right, -limit, limit)};
    if (out.torque_Nm.left != wanted_Nm.left || out.torque_Nm.right != wanted_Nm.right) {
        out.limits.set(control::Limiter::torque_sum);
    }
    return out;
}

void MotionControl::drive(const Observed& now, control::VelocityReference<Real> reference,
                          MotionOutput& out) {
    Real& omega = reference.twist.omega_rad_per_s;
    omega = control::hold_yaw_rate(omega, now.motion.twist.v_m_per_s, plant_.dynamics,
                                   Real(parameters_.limits.torque_Nm), out.limits);
    loops_drive_ = true;
    out.torque_Nm = loop_.update(plant_, now.motion, reference);
    out.reference = reference.twist;
    out.limits.add(loop_.flags());
}

// Whether the torque is at its limit and the reference leaves the robot behind. It waits then, so that the
// robot stays on its way to a target of the same curvature; but not for ever, for one axis may need the other
// to move.
bool MotionControl::runs_away(const Twist<Real>& target, const Twist<Real>& measured) const {
    const control::LimiterFlags limited = loop_.flags();
    const Twist<Real>& reference = limiter_.now();
    const auto ahead = [](Real to, Real from, Real robot) { return (to - from) * (from - robot) > 0; };
    return (limited.has(control::Limiter::torque_sum) &&
            ahead(target.v_m_per_s, reference.v_m_per_s, measured.v_m_per_s)) ||
           (limited.has(control::Limiter::torque_difference) &&
            ahead(target.omega_rad_per_s, reference.omega_rad_per_s, measured.omega_rad_per_s));
}

MotionOutput MotionControl::follow(const Observed& now, const Twist<Real>& wanted) {
    MotionOutput out;
    const Twist<Real> allowed =
        control::scale_jointly(wanted, Real(parameters_.limits.speed_m_per_s),
                               Real(parameters_.limits.yaw_rate_rad_per_s), out.limits);
    const Twist<Real> scaled =
        control::hold_curve(allowed, plant_.dynamics, Real(parameters_.limits.torque_Nm), out.limits);
    const Real step_s = runs_away(scaled, now.motion.twist) ? waiting_share_ * now.elapsed_s : now.elapsed_s;
    drive(now, {limiter_.step(scaled, step_s, out.limits), {}}, out);
    return out;
}

MotionOutput MotionControl::track(const Observed& now, const HostLink& host, bool dither) {
    MotionOutput out;
    control::ReferencePoint<Real> point;
    if (streamed()) {
        if (host.streamed.received && host.streamed.time_ns != streamed_time_ns_) {
            streamed_time_ns_ = host.streamed.time_ns;
            streamed_.push(host.streamed.value.pose, host.streamed.value.twist, streamed_time_ns_);
        }
        if (!streamed_.valid()) return follow(now, {});
        point = streamed_.at(now.now_ns);
    } else {
        if (trajectory_start_ns_ == 0) {
            if (pace_.running()) return follow(now, limiter_.now());
            begin_path(now);
        }
        point =
            control::path_point(path_, Real(1e-9 * static_cast<double>(now.now_ns - trajectory_start_ns_)));
    }
    auto command = tracker_.update(point, now.pose, now.elapsed_s);
    if (dither) dither_.step(command.reference);
    out.tracking_error = {command.along_m, command.across_m, command.heading_rad};
    out.limits = command.flags;
    drive(now, command.reference, out);
    return out;
}

MotionOutput MotionControl::drive_to(const Observed& now, const HostLink& host) {
    if (host.goal.received) pose_.set_goal(host.goal.value.pose, host.goal.value.direction);
    const auto command = pose_.update(now.pose, now.elapsed_s);
    MotionOutput out;
    out.tracking_error = {command.distance_m, 0, -command.heading_error_rad};
    out.limits = command.flags;
    out.goal_reached = command.goal_reached;
    drive(now, command.reference, out);
    return out;
}

MotionOutput MotionControl::torque(const supervisor::ModeRule& mode, const Observed& now,
                                   const HostLink& host) {
    switch (mode.law) {
        case Law::torque:
            loops_drive_ = false;
            return open_loop(host.torque_Nm.received ? host.torque_Nm.value : WheelPair<Real>{});
        case Law::velocity: {
            const bool told = mode.setpoint == supervisor::Setpoint::velocity && host.velocity.received;
            return follow(now, told ? host.velocity.value : Twist<Real>{});
        }
        case Law::pose:
            return drive_to(now, host);
        case Law::path:
            return track(now, host, mode.learns);
        case Law::none:
        case Law::excitation:
            break;
    }
    return {};
}

void MotionControl::begin_braking(const Observed& now) {
    take_over(now);
    limiter_.reset(now.motion.twist);
}

MotionOutput MotionControl::brake(const Observed& now) {
    if (!design_accepted_) return {};  // without loops that are known to be stable: coast
    return follow(now, {});
}

void MotionControl::release() {
    loop_.stop();
    loops_drive_ = false;
}

}  // namespace wheelwright::task
