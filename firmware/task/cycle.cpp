#include "firmware/task/cycle.hpp"

#include <algorithm>
#include <cmath>

#include "firmware/task/ident_quantities.hpp"

namespace wheelwright::task {
namespace {

using drivers::DriveState;
using protocol::Mode;

static_assert(unsigned(protocol::DriveState::silent) == unsigned(DriveState::silent) &&
              unsigned(protocol::DriveState::idle) == unsigned(DriveState::idle) &&
              unsigned(protocol::DriveState::arming) == unsigned(DriveState::arming) &&
              unsigned(protocol::DriveState::armed) == unsigned(DriveState::armed) &&
              unsigned(protocol::DriveState::fault) == unsigned(DriveState::fault));

// A torque frame that the bus would not take for this many cycles in a row: the bus counts as down.
constexpr int kRefusedTorquesUntilDown = 5;
// A robot stands when no rim has been faster than this share of safety.clear_speed_m_per_s for so long.
constexpr double kStandingShare = 0.1;
constexpr int kStandingCycles = 20;
constexpr double kSlowGain =
    1.0 / 50;  // a cycle: what moves on or has stopped is known within a tenth of a second
// After a request to end: how long the drives may take to confirm that they are idle.
constexpr int kEndingCycles = 500;

supervisor::SupervisorConfig supervisor_config(const model::RobotParameters& p) {
    const auto ramps = [](model::StopReaction reaction) { return reaction == model::StopReaction::ramp; };
    supervisor::SupervisorConfig config;
    config.stops = {ramps(p.safety.stale_command_reaction), ramps(p.safety.over_speed_reaction),
                    ramps(p.safety.emergency_stop_reaction), ramps(p.safety.overrun_reaction),
                    ramps(p.safety.terminate_reaction)};
    // The drives report their own time-out first; this is the limit if they report nothing.
    config.arming_limit_cycles = static_cast<std::int32_t>(1.5 * p.drive.arming_timeout_s / kCyclePeriod_s);
    return config;
}

std::int32_t ramp_limit_cycles(const model::RobotParameters& p) {
    const double auto_s = std::min(2 * control::braking_time_s(p) + 0.5, 60.0);
    const double limit_s = p.safety.ramp_timeout_s > 0 ? p.safety.ramp_timeout_s : auto_s;
    return static_cast<std::int32_t>(limit_s / kCyclePeriod_s);
}

// An active effect of 0 +- 0 has never been measured. Beside one, adaptation would lay its torque on K7 and
// K8. Where the parameters are not amounts (a phase), one of them may well be 0.
bool effects_measured(const model::RobotParameters& p) {
    bool measured = true;
    model::for_each_active_index(p.effects.active, [&](std::size_t i) {
        std::size_t unknown = 0;
        const std::size_t count = model::kEffects[i].parameters.size();
        for (std::size_t j = 0; j < count; ++j) {
            if (p.effects.parameter[i][j] == 0 && p.effects_standard_error.parameter[i][j] == 0) ++unknown;
        }
        measured = measured && unknown < (model::kLinearInParameters[i] ? 1 : count);
    });
    return measured;
}

double microseconds(std::int64_t ns) { return 1e-3 * static_cast<double>(ns); }

std::uint16_t narrow(std::uint64_t value) {
    return static_cast<std::uint16_t>(std::min<std::uint64_t>(value, 0xFFFF));
}

}  // namespace

Cycle::Cycle(model::RobotParameters& parameters, SaveMailbox& mailbox, const CyclePorts& ports)
    : parameters_(parameters),
      ports_(ports),
      service_(parameters, mailbox),
      mailbox_(mailbox),
      supervisor_(supervisor_config(parameters)),
      overrun_(parameters.overrun_fault.in_a_row, parameters.overrun_fault.per_second),
      drive_meter_(parameters.bus.bit_rate_bit_per_s),
      host_meter_(parameters.bus.host_bit_rate_bit_per_s),
      send_phase_ns_(static_cast<std::int64_t>(parameters.realtime.send_phase_s * 1e9)) {
    configure();
    control_.finish_design();
}

// Hands the live parameters to everybody who works with them.
void Cycle::configure() {
    control_.configure(parameters_);
    rough_model_ = false;
    observer_.configure(control::wheel_observer_settings<double>(parameters_, kCyclePeriod_s));
    encoder_watch_.configure(control::encoder_watch_settings(parameters_));
    odometry_.configure(control::odometry_settings<double>(parameters_));
    effects_measured_ = effects_measured(parameters_);
    slip_limit_rad_per_s_ = SlipWatch::limit_rad_per_s(parameters_);
    supervisor_.set_ramp_limit(ramp_limit_cycles(parameters_));
    conditions_.model_known = model::dynamics_known(parameters_);
    sample_age_ns_ = static_cast<std::int64_t>(Learning::sample_age_s(parameters_) * 1e9);
    ports_.left.set_torque_scale(parameters_.drive.left.torque_scale);
    ports_.right.set_torque_scale(parameters_.drive.right.torque_scale);
}

void Cycle::think(const CycleTime& time) {
    elapsed_s_ = static_cast<double>(1 + time.missed) * kCyclePeriod_s;
    time_ = time;
    ++cycle_;
    overran_ = overrun_.step(time.missed);
    outbox_.clear();
    host_.begin_cycle();

    receive();
    ports_.left.update(time.scheduled_ns, outbox_);
    ports_.right.update(time.scheduled_ns, outbox_);
    observe();
    judge_conditions();
    obey();
    serve_parameters();
    decide();
    learn();
    guard_torque();
    note_times();
}

void Cycle::receive() {
    drain(ports_.drive_bus, ports_.host_bus == nullptr, true);
    if (ports_.host_bus != nullptr) drain(*ports_.host_bus, true, false);
}

void Cycle::drain(hal::CanBus& bus, bool from_host, bool from_drives) {
    BusMeter& meter = from_drives ? drive_meter_ : host_meter_;
    hal::ReceivedFrame received;
    for (int i = 0; i < kMostFramesPerCycle; ++i) {
        const hal::CanStatus status = bus.receive(received);
        if (status != hal::CanStatus::ok) {
            if (from_drives) bus_lost_ = status == hal::CanStatus::bus_down;
            return;
        }
        meter.count(received.frame);
        if (received.frame.error) continue;
        if (from_drives && (ports_.left.accept(received) || ports_.right.accept(received))) continue;
        if (from_host) {
            host_.accept(received);
        } else {
            host_.accept_anywhere(received.frame);
        }
    }
}

void Cycle::observe() {
    const auto sample = [](const drivers::DriveFeedback& f) {
        return control::EncoderSample{f.position_rad, f.speed_rad_per_s, f.encoder_time_ns};
    };
    observer_.update(time_.scheduled_ns, sample(ports_.left.feedback()), sample(ports_.right.feedback()),
                     control_.plant());
    odometry_.advance(control_.plant().geometry, observer_.turned_rad(), time_.scheduled_ns);
    if (host_.events().external_pose) {
        odometry_.fuse(host_.external_pose.value);
        slip_.compare(host_.external_pose.value.heading_rad, odometry_.bare_pose().heading_rad,
                      time_.scheduled_ns, slip_limit_rad_per_s_);
    }

    angles_known_ =
        observer_.angles_at(time_.scheduled_ns - sample_age_ns_, sample_.angle_rad) && time_.missed == 0;
    sample_.usable = angles_known_ && !slip_.slipping(time_.scheduled_ns);
    sample_.last_torque_Nm = sent_torque_Nm_;
    sample_.heading_rad = odometry_.pose().heading_rad;
    observer_.set_heading(sample_.heading_rad);
}

bool Cycle::stale(std::int64_t time_ns, double limit_s) const {
    return time_ns == 0 || 1e-9 * static_cast<double>(time_.scheduled_ns - time_ns) > limit_s;
}

template <typename Setpoint>
bool Cycle::late(const Setpoint& setpoint, std::uint16_t cycle_time_ms) const {
    return setpoint.received &&
           stale(setpoint.time_ns, 1e-3 * cycle_time_ms * parameters_.safety.stale_command_cycles);
}

// Between driving modes: what has stopped coming does not act in the next mode, not for one cycle.
void Cycle::forget_late_setpoints() {
    const auto forget = [this](auto& setpoint, std::uint16_t cycle_time_ms) {
        if (late(setpoint, cycle_time_ms)) setpoint.received = false;
    };
    forget(host_.torque_Nm, protocol::TorqueCommand::cycle_time_ms);
    forget(host_.velocity, protocol::VelocityCommand::cycle_time_ms);
    forget(host_.goal, protocol::PoseGoal::cycle_time_ms);
    forget(host_.streamed, protocol::StreamedPose::cycle_time_ms);
}

// Where no set-point is asked for, somebody must be there all the same.
bool Cycle::host_gone() const {
    const double limit_s = parameters_.safety.host_timeout_s;
    return limit_s > 0 && stale(host_.heard_ns(), limit_s);
}

// A set-point that has begun to come must go on coming.
bool Cycle::setpoint_stale() const {
    switch (supervisor_.mode()) {
        case Mode::torque:
            return late(host_.torque_Nm, protocol::TorqueCommand::cycle_time_ms);
        case Mode::velocity:
            return late(host_.velocity, protocol::VelocityCommand::cycle_time_ms);
        case Mode::pose:
            return late(host_.goal, protocol::PoseGoal::cycle_time_ms);
        case Mode::trajectory:
        case Mode::adaptive:
            return control_.streamed() ? late(host_.streamed, protocol::StreamedPose::cycle_time_ms)
                                       : host_gone();
        case Mode::ident:
            return host_gone();
        default:
            return false;
    }
}

// The probe, which asks the wheels one by one whether they turn at all, says better why one does not.
bool Cycle::encoder_implausible() {
    const drivers::DriveFeedback& left = ports_.left.feedback();
    const drivers::DriveFeedback& right = ports_.right.feedback();
    const WheelPair<double> angle_rad{left.position_rad, right.position_rad};
    const bool probing = identifying_ && learning_.run().state() == ident::IdentState::probing;
    if (!supervisor_.may_drive() && !supervisor_.ramping()) {
        encoder_watch_.rest(angle_rad);
        return false;
    }
    if (probing) return encoder_watch_.update_alone(angle_rad, sent_torque_Nm_);
    return encoder_watch_.update(elapsed_s_, angle_rad, {left.encoder_time_ns, right.encoder_time_ns},
                                 observer_.motion().wheel_speed_rad_per_s, sent_torque_Nm_,
                                 control_.plant().geometry, observer_.unexplained_acceleration(),
                                 may_brake() ? &control_.plant().dynamics : nullptr);
}

void Cycle::judge_conditions() {
    const drivers::MotorDrive& left = ports_.left;
    const drivers::MotorDrive& right = ports_.right;
    const DriveState left_state = left.state();
    const DriveState right_state = right.state();
    const auto either = [&](DriveState state) { return left_state == state || right_state == state; };
    const drivers::ArmRefusal left_refusal = left.refusal();
    const drivers::ArmRefusal right_refusal = right.refusal();
    const model::Motion<double>& motion = observer_.motion();
    const auto& safety = parameters_.safety;
    supervisor::Conditions& c = conditions_;

    c.feedback_stale = stale(left.feedback().encoder_time_ns, safety.stale_feedback_s) ||
                       stale(right.feedback().encoder_time_ns, safety.stale_feedback_s);
    if (c.feedback_stale) ++stale_feedback_cycles_;
    c.encoder_implausible = encoder_implausible();
    c.command_stale = setpoint_stale();
    const drivers::DriveFault left_fault = left.fault();
    const drivers::DriveFault right_fault = right.fault();
    const auto either_failed = [&](drivers::DriveFault fault) {
        return left_fault == fault || right_fault == fault;
    };
    const bool left_by_itself = either_failed(drivers::DriveFault::left_armed);
    const std::uint32_t foreign = left.counters().foreign_control + right.counters().foreign_control +
                                  host_.counter(HostLink::Cause::foreign_control);
    c.foreign_control = foreign != foreign_control_;
    foreign_control_ = foreign;
    const bool other_torque = either_failed(drivers::DriveFault::torque_not_followed);
    c.torque_not_followed = other_torque && was_armed_;
    c.drive_enable_failed = enable_failed_;
    c.drive_error = either(DriveState::fault) && !left_by_itself && !other_torque;
    c.drive_silent = either(DriveState::silent);
    c.path_known = !control_.pace().running();
    c.drives_armed = left_state == DriveState::armed && right_state == DriveState::armed;
    c.drive_disarmed_itself = left_by_itself || (was_armed_ && drives_wanted_ && !c.drives_armed);
    was_armed_ = c.drives_armed;
    c.arming_refused = drives_wanted_ && (left_refusal != drivers::ArmRefusal::none ||
                                          right_refusal != drivers::ArmRefusal::none);
    const auto unguarded = drivers::ArmRefusal::watchdog_not_confirmed;
    c.watchdog_confirmed = left_refusal != unguarded && right_refusal != unguarded;
    const auto other_mode = drivers::ArmRefusal::mode_not_confirmed;
    c.control_mode_confirmed = left_refusal != other_mode && right_refusal != other_mode;
    // Written so that what is no number counts as dangerous.
    c.over_speed = !(std::abs(motion.twist.v_m_per_s) <= safety.over_speed_m_per_s &&
                     std::abs(motion.twist.omega_rad_per_s) <= safety.over_yaw_rate_rad_per_s);
    c.stop_line_active =
        ports_.emergency_stop != nullptr && ports_.emergency_stop->read() != hal::LineLevel::inactive;
    c.stop_message = host_.events().stop;
    c.overrun = overran_;
    c.bus_down = bus_lost_ || refused_torques_ >= kRefusedTorquesUntilDown;
    c.terminate = terminate_.load(std::memory_order_relaxed);
    const auto& radius = control_.plant().geometry.wheel_radius_m;
    const auto rims_within = [&radius](const WheelPair<double>& speed_rad_per_s, double limit_m_per_s) {
        return std::abs(radius.left * speed_rad_per_s.left) <= limit_m_per_s &&
               std::abs(radius.right * speed_rad_per_s.right) <= limit_m_per_s;
    };
    // the encoders' noise at rest, which has no mean, is no motion
    slow_wheels_.left += kSlowGain * (motion.wheel_speed_rad_per_s.left - slow_wheels_.left);
    slow_wheels_.right += kSlowGain * (motion.wheel_speed_rad_per_s.right - slow_wheels_.right);
    c.moving = !rims_within(slow_wheels_, safety.clear_speed_m_per_s);
    c.rolling = true;
    if (supervisor_.ramping()) {
        const bool stands =
            rims_within(motion.wheel_speed_rad_per_s, kStandingShare * safety.clear_speed_m_per_s);
        resting_cycles_ = stands ? resting_cycles_ + 1 : 0;
        c.rolling = resting_cycles_ < kStandingCycles;
    }
    c.velocity_design_accepted = control_.design_accepted();
    const auto& k = parameters_.dynamics;
    const auto& e = parameters_.dynamics_standard_error;
    const double trust = parameters_.adaptation.trust_relative_error;
    c.model_trusted = effects_measured_ && e.k7_per_kg_m > 0 && e.k8_per_kg_m2 > 0 &&
                      e.k7_per_kg_m <= trust * k.k7_per_kg_m && e.k8_per_kg_m2 <= trust * k.k8_per_kg_m2;
    c.mode_finished =
        supervisor_.mode() == Mode::ident && identifying_ && learning_.identification_finished();
}

// Requests of the host, then the supervisor, then what its verdict asks of the drives.
void Cycle::obey() {
    supervisor_.start();
    const HostEvents& events = host_.events();
    if (events.ident) ident_settings_ = *events.ident;
    const bool on_path = supervisor_.mode() == Mode::trajectory || supervisor_.mode() == Mode::adaptive;
    if (events.trajectory && !on_path) control_.select_trajectory(*events.trajectory);
    const Mode before_requests = supervisor_.mode();
    const bool to_clear = before_requests == Mode::fault || conditions_.drive_error;
    if (events.clear_fault && supervisor_.clear_fault(conditions_) == supervisor::Blocker::none && to_clear &&
        !supervisor_.wants_armed()) {
        ports_.left.request_clear_errors();
        ports_.right.request_clear_errors();
    }
    if (events.mode && !conditions_.terminate &&
        supervisor_.request(*events.mode, conditions_) != supervisor::Blocker::none) {
        host_.count(HostLink::Cause::rejected_mode_not_allowed);
    }
    const Mode before = supervisor_.mode();
    supervisor_.step(conditions_);
    // A stop goes to drives that are believed idle too.
    const bool stops = supervisor_.mode() == Mode::fault &&
                       (before != Mode::fault || conditions_.stop_message || conditions_.foreign_control);
    if (identifying_ && (supervisor_.mode() != Mode::ident || supervisor_.ramping())) {
        finish_identification();
    }

    const bool wanted = supervisor_.wants_armed();
    if (wanted && !drives_wanted_) {
        ports_.left.request_arm();
        ports_.right.request_arm();
    } else if (!wanted && (drives_wanted_ || stops)) {
        ports_.left.request_disarm();
        ports_.right.request_disarm();
    }
    drives_wanted_ = wanted;
    enable_failed_ = ports_.drive_enable != nullptr && !ports_.drive_enable->write(wanted);

    const MotionInputs now = motion_inputs();
    if (supervisor_.entered()) {
        if (supervisor_.mode() != before) {
            host_.forget_setpoints();
        } else if (supervisor_.mode() != before_requests) {
            forget_late_setpoints();
        }
        control_.enter(supervisor_.mode(), now);
        if (supervisor_.mode() == Mode::ident) {
            learning_.start_identification(parameters_, ident_settings_, now);
            identifying_ = true;
            if (!conditions_.model_known) use_rough_model();
        } else if (supervisor_.mode() == Mode::adaptive) {
            learning_.start_adaptation(parameters_, control_.plant(), control_.lap_s());
            control_.dither().configure(learning_.dither_period_s(), kCyclePeriod_s,
                                        control_.plant().geometry.track_m);
        }
    }
    if (supervisor_.ramping() && !was_ramping_) {
        control_.begin_braking(now);
        resting_cycles_ = 0;
    }
    was_ramping_ = supervisor_.ramping();

    if (conditions_.terminate && !wanted) {
        const auto asleep = [](const drivers::MotorDrive& drive) {
            return drive.state() != DriveState::armed && drive.state() != DriveState::arming;
        };
        ++ending_cycles_;
        const bool quiet = asleep(ports_.left) && asleep(ports_.right) && ending_cycles_ > 3;
        finished_ = quiet || ending_cycles_ > kEndingCycles;
    }
}

void Cycle::finish_identification() {
    identifying_ = false;
    learning_.interrupt_identification();
    if (!learning_.identification_succeeded()) return;
    learning_.record(service_, parameters_);
    configure();
}

// Where none is known, the observer and the brakes work with what the probe has found so far.
void Cycle::use_rough_model() {
    control_.change_model(learning_.probed_dynamics(), control_.plant().effects, observer_.motion());
    rough_model_ = learning_.probed();
}

void Cycle::serve_parameters() {
    const HostEvents& events = host_.events();
    for (std::size_t i = 0; i < events.parameter_count; ++i) {
        const protocol::ParameterRequest& request = events.parameters[i];
        protocol::ParameterReply reply;
        reply.operation = request.operation;
        reply.index = request.index;
        reply.value = request.value;
        switch (request.operation) {
            case protocol::ParameterOperation::read: {
                double value = 0;
                reply.result = service_.read(request.index, value);
                reply.value = static_cast<float>(value);
                break;
            }
            case protocol::ParameterOperation::write:
                reply.result = service_.stage(request.index, static_cast<double>(request.value));
                break;
            case protocol::ParameterOperation::commit:
                reply.result =
                    service_.commit(supervisor_.mode() == Mode::idle && !supervisor_.wants_armed());
                break;
            case protocol::ParameterOperation::discard:
                reply.result = service_.discard();
                break;
            case protocol::ParameterOperation::save:
                reply.result = service_.save();
                reply.value = static_cast<float>(mailbox_.offered());
                break;
        }
        if (reply.result == protocol::ParameterResult::unknown_index) {
            host_.count(HostLink::Cause::unknown_parameter);
        }
        telemetry_.reply(reply);
    }
    if (const auto outcome = mailbox_.outcome(); outcome != SaveMailbox::Outcome::none) {
        protocol::ParameterReply reply;
        reply.operation = protocol::ParameterOperation::save;
        reply.value = static_cast<float>(mailbox_.offered());
        reply.result = outcome == SaveMailbox::Outcome::saved ? protocol::ParameterResult::ok
                                                              : protocol::ParameterResult::save_failed;
        telemetry_.reply(reply);
    }
    if (service_.changed()) configure();
    control_.step_design();
}

MotionInputs Cycle::motion_inputs() const {
    return {time_.scheduled_ns, elapsed_s_, observer_.motion(), odometry_.pose(), sent_torque_Nm_};
}

void Cycle::decide() {
    output_ = {};
    const MotionInputs now = motion_inputs();
    if (supervisor_.may_drive()) {
        if (supervisor_.mode() == Mode::ident) {
            output_.torque_Nm = identify(now);
        } else {
            output_ = control_.torque(supervisor_.mode(), now, host_);
        }
    } else if (supervisor_.ramping()) {
        if (may_brake()) output_ = control_.brake(now);  // a loop on a guessed model would be worse than none
    } else {
        control_.release();
    }
}

WheelPair<double> Cycle::identify(const MotionInputs& now) {
    ident::ProbeSample senses;
    senses.angle_rad = sample_.angle_rad;
    senses.usable = angles_known_;  // swapped wheels look like slip; the probe tells them apart
    const std::array<const drivers::DriveFeedback*, 2> feedback{&ports_.left.feedback(),
                                                                &ports_.right.feedback()};
    senses.reported_Nm = {feedback[0]->torque_Nm, feedback[1]->torque_Nm};
    for (std::size_t i = 0; i < 2; ++i) {
        senses.report_is_new[i] = feedback[i]->torque_time_ns != report_ns_[i];
        report_ns_[i] = feedback[i]->torque_time_ns;
    }
    senses.pose_is_new = host_.events().external_pose;
    senses.pose = host_.external_pose.value;
    const WheelPair<double> torque = learning_.identify(sample_, now.pose, now.motion.twist, senses);
    if (!conditions_.model_known && !rough_model_ && learning_.probed()) use_rough_model();
    return torque;
}

void Cycle::learn() {
    const bool waited = adapted_since_ > 0;
    const bool was_long = long_cycle_;
    long_cycle_ = false;
    if (supervisor_.mode() != Mode::adaptive || !supervisor_.may_drive()) {
        adapted_since_ = 0;
        return;
    }
    const bool saturated = output_.limits.has(control::Limiter::torque_sum) ||
                           output_.limits.has(control::Limiter::torque_difference);
    // Fusing a pose, learning and handing over are all long: the model follows some cycles later.
    const bool busy = host_.events().external_pose;
    if (waited && (!busy || ++adapted_since_ > 3)) {
        control_.change_model(learning_.adapted_dynamics(), learning_.adapted_effects(), observer_.motion());
        adapted_since_ = 0;
    }
    const bool may_adapt = !saturated && !slip_.slipping(time_.scheduled_ns);
    if (learning_.adapt(sample_, may_adapt, busy) && adapted_since_ == 0) adapted_since_ = 1;
    if (learning_.estimate_is_new()) {
        const WheelPair<double> rim = learning_.dither_m_per_s2();
        control_.dither().set_amplitudes(rim.left, rim.right);
    }
    // telemetry waits a cycle; not for poses that come in every one
    long_cycle_ = waited || adapted_since_ == 1 || (busy && !was_long);
}

// Nothing that is not a number, and nothing over the limit, leaves this function.
void Cycle::guard_torque() {
    WheelPair<double>& torque = output_.torque_Nm;
    conditions_.not_finite = !(std::isfinite(torque.left) && std::isfinite(torque.right));
    if (conditions_.not_finite) torque = {};
    const double limit = parameters_.limits.torque_Nm;
    torque.left = std::clamp(torque.left, -limit, limit);
    torque.right = std::clamp(torque.right, -limit, limit);
}

void Cycle::send(std::int64_t) {
    torques_.clear();
    ports_.left.command_torque(output_.torque_Nm.left, torques_);
    ports_.right.command_torque(output_.torque_Nm.right, torques_);
    sent_torque_Nm_ = output_.torque_Nm;
    observer_.torque_sent(sent_torque_Nm_);
    const std::uint32_t refused = send_refused_;
    for (const hal::CanFrame& frame : torques_.frames()) {
        // On a jammed bus one torque for each drive may grow old, not a queue of them.
        if (ports_.drive_bus.waits(frame.id)) {
            ++send_refused_;
        } else {
            transmit(ports_.drive_bus, frame, drive_meter_);
        }
    }
    refused_torques_ = send_refused_ == refused ? 0 : refused_torques_ + 1;
    for (const hal::CanFrame& frame : outbox_.frames()) {
        if (transmit(ports_.drive_bus, frame, drive_meter_)) continue;
        if (!ports_.left.refused(frame)) ports_.right.refused(frame);
    }

    const bool jammed = refused_torques_ > 0 && ports_.host_bus == nullptr;
    const Telemetry::Turn turn = long_cycle_ || jammed ? Telemetry::Turn{} : telemetry_.next(cycle_);
    if (turn.due && !turn.reply) fill(turn.part, report_);
    hal::CanFrame frame;
    if (telemetry_.build(turn, report_, frame)) {
        if (ports_.host_bus != nullptr) {
            transmit(*ports_.host_bus, frame, host_meter_);
        } else {
            transmit(ports_.drive_bus, frame, drive_meter_);
        }
        if (frame.id == protocol::Timing::id) longest_wake_ns_ = longest_execution_ns_ = 0;
    }
    drive_meter_.step(elapsed_s_);
    host_meter_.step(elapsed_s_);
}

bool Cycle::transmit(hal::CanBus& bus, const hal::CanFrame& frame, BusMeter& meter) {
    const bool taken = bus.send(frame) == hal::CanStatus::ok;
    if (taken) {
        meter.count(frame);
    } else {
        ++send_refused_;
    }
    return taken;
}

void Cycle::note_times() {
    longest_wake_ns_ = std::max(longest_wake_ns_, time_.wake_latency_ns());
    longest_execution_ns_ = std::max(longest_execution_ns_, time_.last_execution_ns);
}

CycleReport Cycle::report() const {
    CycleReport report;
    for (std::size_t part = 0; part < kReportParts; ++part) fill(static_cast<ReportPart>(part), report);
    return report;
}

void Cycle::fill(ReportPart part, CycleReport& r) const {
    const ident::DynamicsEstimate<double>& estimate = learning_.estimate();
    switch (part) {
        case ReportPart::status:
            fill_status(r.status);
            break;
        case ReportPart::motion: {
            const model::Motion<double>& motion = observer_.motion();
            r.wheel_speed_rad_per_s = motion.wheel_speed_rad_per_s;
            r.torque_Nm = output_.torque_Nm;
            r.pose = odometry_.pose();
            r.twist = motion.twist;
            r.reference = output_.reference;
            r.tracking_error = output_.tracking_error;
            break;
        }
        case ReportPart::estimate:
            r.estimate = estimate.dynamics;
            r.standard_error = estimate.standard_error;
            r.covariance = estimate.covariance_diagonal;
            break;
        case ReportPart::effects:
            r.effect_count = 0;
            model::for_each_active_index(estimate.effects.active, [&](std::size_t i) {
                for (std::size_t j = 0; j < model::kEffects[i].parameters.size(); ++j) {
                    r.effects[r.effect_count++] = {model::effect_index(i, j),
                                                   estimate.effects.parameter[i][j],
                                                   estimate.effects_standard_error.parameter[i][j]};
                }
            });
            break;
        case ReportPart::ident:
            r.ident = learning_.status();
            break;
        case ReportPart::ident_sizing:
            r.ident_quantities = ident_quantities(learning_.run().sizing(), learning_.run().findings());
            break;
        case ReportPart::drives:
            r.drive_generation = static_cast<std::uint8_t>(parameters_.drive.generation);
            r.drive_error_bits = {ports_.left.feedback().error_bits, ports_.right.feedback().error_bits};
            break;
        case ReportPart::pace:
            r.pace = control_.told_pace();
            r.pace_known = conditions_.model_known && conditions_.path_known;
            break;
        case ReportPart::timing:
            r.timing.wake_latency_last_us = microseconds(time_.wake_latency_ns());
            r.timing.wake_latency_max_us = microseconds(longest_wake_ns_);
            r.timing.execution_max_us = microseconds(longest_execution_ns_);
            r.timing.missed_cycles = narrow(overrun_.total());
            break;
        case ReportPart::bus_load:
            r.bus_load.drive_bus_load_percent = 100 * drive_meter_.load();
            r.bus_load.host_bus_load_percent = 100 * host_meter_.load();
            r.bus_load.telemetry_deferred = narrow(telemetry_.deferred());
            r.bus_load.receive_overflow = narrow(ports_.drive_bus.statistics().receive_overflow);
            r.bus_load.send_refused = narrow(send_refused_);
            break;
        case ReportPart::design: {
            const auto& design = control_.design().result();
            r.design.proportional_gain_per_s = design.gains.kp_per_s;
            r.design.integral_gain_per_s2 = design.gains.ki_per_s2;
            r.design.phase_margin_deg = design.phase_margin_deg;
            r.design.sensitivity_peak = design.sensitivity_peak;
            break;
        }
        case ReportPart::counters:
            fill_counters(r);
            break;
    }
}

void Cycle::fill_status(protocol::Status& s) const {
    const control::LimiterFlags& limits = output_.limits;
    s.state = supervisor_.mode();
    s.requested = supervisor_.requested();
    s.fault = supervisor_.fault();
    s.blocker = supervisor_.blocker();
    const double torque_limit = parameters_.limits.torque_Nm * (1 - 1e-9);
    s.limit_torque_left = std::abs(output_.torque_Nm.left) >= torque_limit;
    s.limit_torque_right = std::abs(output_.torque_Nm.right) >= torque_limit;
    s.limit_speed = limits.has(control::Limiter::speed);
    s.limit_yaw_rate = limits.has(control::Limiter::yaw_rate);
    s.limit_acceleration =
        limits.has(control::Limiter::acceleration) || limits.has(control::Limiter::yaw_acceleration);
    if (supervisor_.mode() == Mode::ident) {
        const auto& overrides = learning_.run().excitation().overrides();
        s.limit_speed = overrides.speed;
        s.limit_yaw_rate = overrides.yaw_rate;
        s.limit_area = overrides.distance;
        s.limit_torque_left = s.limit_torque_right = false;  // its torque is meant to be at the limit
    } else {
        s.limit_area = false;
    }
    s.limit_adaptation_frozen = supervisor_.mode() == Mode::adaptive &&
                                (learning_.adaptation_frozen() || slip_.slipping(time_.scheduled_ns));
    s.drive_left = static_cast<protocol::DriveState>(ports_.left.state());
    s.drive_right = static_cast<protocol::DriveState>(ports_.right.state());
    s.progress_percent = 100 * learning_.progress();
    s.model_trusted = conditions_.model_trusted;
    s.excited = learning_.excited();
    s.pose_fixed = odometry_.localised();
    s.goal_reached = output_.goal_reached;
}

// The host's commands count on their own; the rest is counted elsewhere.
void Cycle::fill_counters(CycleReport& r) const {
    using Cause = HostLink::Cause;
    for (std::size_t i = 0; i < r.counters.size(); ++i) r.counters[i] = host_.counter(static_cast<Cause>(i));
    const hal::CanStatistics statistics = ports_.drive_bus.statistics();
    const auto put = [&r](Cause cause, std::uint64_t value) {
        r.counters[std::size_t(cause)] = static_cast<std::uint32_t>(value);
    };
    put(Cause::missed_cycles, overrun_.total());
    put(Cause::telemetry_deferred, telemetry_.deferred());
    put(Cause::send_refused, send_refused_ + outbox_.lost() + torques_.lost() + telemetry_.replies_lost());
    put(Cause::receive_overflow, statistics.receive_overflow + host_.counter(Cause::receive_overflow));
    put(Cause::bus_error_frames, statistics.error_frames);
    put(Cause::bus_off, statistics.bus_off);
    put(Cause::stale_feedback_cycles, stale_feedback_cycles_);
    put(Cause::foreign_control, foreign_control_);
}

}  // namespace wheelwright::task
