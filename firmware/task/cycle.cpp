#include "firmware/task/cycle.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "firmware/task/setpoints.hpp"

namespace wheelwright::task {
namespace {

using drivers::DriveState;
using protocol::Mode;
using supervisor::Law;
using supervisor::Owner;

// A torque frame that the bus would not take for this many cycles in a row: the bus counts as down.
constexpr int kRefusedTorquesUntilDown = 5;
// After a request to end: how long the drives may take to confirm that they are idle.
constexpr int kEndingCycles = 500;
// A stop's frames: torques, then idle in the next cycle.
constexpr int kStoppingCycles = 2;

supervisor::SupervisorConfig supervisor_config(const model::RobotParameters& p, bool has_key) {
    const auto ramps = [](model::StopReaction reaction) { return reaction == model::StopReaction::ramp; };
    supervisor::SupervisorConfig config;
    config.stops = {ramps(p.safety.stale_command_reaction),  ramps(p.safety.over_speed_reaction),
                    ramps(p.safety.emergency_stop_reaction), ramps(p.safety.overrun_reaction),
                    ramps(p.safety.terminate_reaction),      ramps(p.safety.drive_limits_reaction)};
    // The drives report their own time-out first; this is the limit if they report nothing.
    config.arming_limit_cycles = static_cast<std::int32_t>(1.5 * p.drive.arming_timeout_s / kCyclePeriod_s);
    config.arming_needs_proof = has_key;
    return config;
}

std::int32_t ramp_limit_cycles(const model::RobotParameters& p) {
    const double auto_s = std::min(2 * control::braking_time_s(p) + 0.5, 60.0);
    const double limit_s = p.safety.ramp_timeout_s > 0 ? p.safety.ramp_timeout_s : auto_s;
    return static_cast<std::int32_t>(limit_s / kCyclePeriod_s);
}

}  // namespace

Cycle::Cycle(model::RobotParameters& parameters, SaveMailbox& mailbox, const CyclePorts& ports)
    : parameters_(parameters),
      ports_(ports),
      arming_(ports.arming_key),
      service_(parameters, mailbox),
      judge_(parameters),
      supervisor_(supervisor_config(parameters, arming_.has_key())),
      overrun_(parameters.overrun_fault.in_a_row, parameters.overrun_fault.per_second),
      drive_meter_(parameters.bus.bit_rate_bit_per_s),
      host_meter_(parameters.bus.host_bit_rate_bit_per_s),
      send_phase_ns_(static_cast<std::int64_t>(parameters.realtime.send_phase_s * 1e9)) {
    configure();
    control_.finish_design();
}

std::array<std::span<std::byte>, 8> Cycle::memory() {
    return {std::as_writable_bytes(std::span(&parameters_, 1)),
            service_.memory(),
            judge_.memory(),
            torques_.memory(),
            outbox_.memory(),
            hal::plain_memory(host_, *this),
            ports_.left.memory(),
            ports_.right.memory()};
}

// Hands the live parameters to everybody who works with them.
void Cycle::configure() {
    control_.configure(parameters_);
    rough_model_ = false;
    senses_.configure(parameters_, ports_.left.ratings().encoder_loop_period_s);
    drive_limits_.configure(parameters_, ports_.left.ratings());
    judge_.configure();
    supervisor_.set_ramp_limit(ramp_limit_cycles(parameters_));
    model_known_ = model::dynamics_known(parameters_);
    ports_.left.set_torque_scale(parameters_.drive.left.torque_scale);
    ports_.right.set_torque_scale(parameters_.drive.right.torque_scale);
}

void Cycle::think(const CycleTime& time) {
    const HostEvents& events = receive(time);
    const Observed seen = senses_.observe(told(events), control_.plant());
    conditions_ = judge(seen, events);
    const supervisor::Verdict verdict = permit(events);
    command_drives(verdict);
    enter_mode(verdict, seen);
    serve_parameters(events);
    const MotionOutput wanted = decide(verdict, seen);
    long_cycle_ = learn(verdict, seen, wanted);
    if (!long_cycle_ && !encoder_watch_.look(seen.motion.wheel_speed_rad_per_s, control_.plant()))
        senses_.look(ports_.left.feedback(), ports_.right.feedback());
    output_ = guarded(wanted, parameters_.limits.torque_Nm);
}

// What came since the cycle before. The drives' drivers have then had it, and what they ask waits in the
// outbox.
const HostEvents& Cycle::receive(const CycleTime& time) {
    time_ = time;
    ++cycle_;
    longest_wake_ns_ = std::max(longest_wake_ns_, time.wake_latency_ns());
    longest_execution_ns_ = std::max(longest_execution_ns_, time.last_execution_ns);
    overran_ = overrun_.step(time.missed);
    outbox_.clear();
    host_.begin_cycle();
    drain(ports_.drive_bus, ports_.host_bus == nullptr, true);
    if (ports_.host_bus != nullptr) drain(*ports_.host_bus, true, false);
    ports_.left.update(time.scheduled_ns, outbox_);
    ports_.right.update(time.scheduled_ns, outbox_);
    return host_.events();
}

void Cycle::drain(hal::CanBus& bus, bool from_host, bool from_drives) {
    BusMeter& meter = from_drives ? drive_meter_ : host_meter_;
    const std::int64_t latest_ns = std::max(time_.scheduled_ns, time_.woken_ns);
    hal::ReceivedFrame received;
    for (int i = 0; i < kMostFramesPerCycle; ++i) {
        const hal::CanStatus status = bus.receive(received);
        if (status != hal::CanStatus::ok) {
            if (from_drives) bus_lost_ = status == hal::CanStatus::bus_down;
            return;
        }
        meter.count(received.frame);
        if (received.frame.error) continue;
        // By a clock that somebody has set, or a driver's own: no frame is younger than this cycle.
        received.timestamp_ns = std::min(received.timestamp_ns, latest_ns);
        if (from_drives && (ports_.left.accept(received) || ports_.right.accept(received))) continue;
        if (from_host) {
            host_.accept(received);
        } else {
            host_.accept_anywhere(received.frame);
        }
    }
}

Told Cycle::told(const HostEvents& events) const {
    return {time_.scheduled_ns,      Real(elapsed_s()),
            time_.missed == 0,       ports_.left.feedback(),
            ports_.right.feedback(), events.external_pose ? &host_.external_pose.value : nullptr,
            output_.torque_Nm};
}

supervisor::Conditions Cycle::judge(const Observed& seen, const HostEvents& events) {
    const supervisor::ModeRule& mode = supervisor::rule_of(supervisor_.mode());
    supervisor::Conditions told;
    told.encoder_implausible = encoder_implausible(seen);
    const bool own_path = mode.setpoint == supervisor::Setpoint::stream && !control_.streamed();
    const auto& safety = parameters_.safety;
    told.command_stale = host_gone(host_, seen.now_ns, safety.host_timeout_s) ||
                         (!own_path && late(host_, mode.setpoint, seen.now_ns, safety.stale_command_cycles));
    const DriveLimits::Verdict& drives =
        drive_limits_.look(seen.now_ns, ports_.left.feedback(), ports_.right.feedback());
    told.supply_low = drives.supply_low;
    told.supply_high = drives.supply_high;
    told.drive_overheated = drives.overheated;
    told.drive_enable_failed = enable_failed_;
    told.path_known = !control_.pace().running();
    told.stop_line_active =
        ports_.emergency_stop != nullptr && ports_.emergency_stop->read() != hal::LineLevel::inactive;
    told.stop_message = events.stop;
    told.overrun = overran_;
    told.bus_down = bus_lost_ || refused_torques_ >= kRefusedTorquesUntilDown;
    told.not_finite = !output_.finite;
    told.terminate = terminate_.load(std::memory_order_relaxed);
    told.model_known = model_known_;
    told.velocity_design_accepted = control_.design_accepted();
    told.mode_finished = identifying() && learning_.identification_finished();
    return judge_.judge({seen, DriveSight::of(ports_.left), DriveSight::of(ports_.right),
                         control_.plant().geometry.wheel_radius_m, supervisor_.wants_armed(),
                         supervisor_.ramping(), host_.counter(HostLink::Cause::foreign_control), told});
}

// Of a robot that nobody knows yet, the probe says why a wheel does not turn.
bool Cycle::encoder_implausible(const Observed& seen) {
    if (supervisor_.owner() == Owner::nobody) {
        encoder_watch_.rest(*seen.encoder);
        return false;
    }
    if (identifying() && !may_brake()) return false;
    const bool watched = encoder_watch_.update(seen.elapsed_s, *seen.encoder, senses_.observer(),
                                               seen.last_torque_Nm, control_.plant(), may_brake());
    return watched || seen.two_scales;
}

// What the host asks, and who may drive now.
supervisor::Verdict Cycle::permit(const HostEvents& events) {
    if (events.ident) ident_settings_ = *events.ident;
    if (events.trajectory && supervisor::rule_of(supervisor_.mode()).law != Law::path) {
        control_.select_trajectory(*events.trajectory);
    }
    const bool identified = identifying();
    supervisor::Requests asked{events.clear_fault, events.mode};
    if (events.answer) prove(events, asked);
    const supervisor::Verdict verdict = supervisor_.step(conditions_, asked);
    if (verdict.refused) {
        if (supervisor_.blocker() == supervisor::Blocker::not_authenticated) {
            arming_.ask();
        } else {
            host_.count(HostLink::Cause::rejected_mode_not_allowed);
        }
    }
    if (const auto challenge = arming_.challenge(time_.scheduled_ns)) telemetry_.ask(*challenge);
    if (identified && !identifying()) finish_identification();
    return verdict;
}

// A right answer is a request for its mode; idle that is asked for in the same cycle comes before it.
void Cycle::prove(const HostEvents& events, supervisor::Requests& asked) {
    if (!arming_.accept(*events.answer, time_.scheduled_ns)) {
        host_.count(HostLink::Cause::rejected_answer);
    } else if (asked.mode != Mode::idle) {
        asked.mode = events.answer->mode;
        asked.proven = true;
    }
}

void Cycle::command_drives(const supervisor::Verdict& verdict) {
    const auto both = [this](void (drivers::MotorDrive::*request)()) {
        (ports_.left.*request)();
        (ports_.right.*request)();
    };
    if (verdict.clear_drive_errors) both(&drivers::MotorDrive::request_clear_errors);
    if (verdict.order == supervisor::DriveOrder::arm) both(&drivers::MotorDrive::request_arm);
    if (verdict.order == supervisor::DriveOrder::disarm) both(&drivers::MotorDrive::request_disarm);
    const bool stops = drives_wanted_ && !verdict.armed;
    drives_wanted_ = verdict.armed;
    stopping_cycles_ = stops ? kStoppingCycles : std::max(stopping_cycles_ - 1, 0);
    enable_failed_ = ports_.drive_enable != nullptr && !ports_.drive_enable->write(verdict.armed);
    if (!conditions_.terminate || verdict.armed) return;
    const auto asleep = [](const drivers::MotorDrive& drive) {
        return drive.state() != DriveState::armed && drive.state() != DriveState::arming;
    };
    ++ending_cycles_;
    finished_ =
        (asleep(ports_.left) && asleep(ports_.right) && ending_cycles_ > 3) || ending_cycles_ > kEndingCycles;
}

// The law of a mode that is new starts from the motion and the torque that it finds.
void Cycle::enter_mode(const supervisor::Verdict& verdict, const Observed& seen) {
    if (verdict.begins_braking) control_.begin_braking(seen);
    if (verdict.entry == supervisor::Entry::none) return;
    const supervisor::ModeRule& mode = supervisor::rule_of(verdict.mode);
    if (verdict.entry == supervisor::Entry::from_rest) {
        host_.forget_setpoints();
    } else {
        forget_late(host_, seen.now_ns, parameters_.safety.stale_command_cycles);
    }
    encoder_watch_.configure(control::encoder_watch_settings(parameters_, mode.law == Law::excitation));
    control_.enter(mode.law, seen);
    if (mode.law == Law::excitation) {
        learning_.start_identification(parameters_, ident_settings_,
                                       ports_.left.ratings().encoder_loop_period_s, seen);
        if (!model_known_) use_rough_model();
    }
    if (mode.learns) learning_.start_adaptation(parameters_, control_);
}

void Cycle::finish_identification() {
    learning_.interrupt_identification();
    if (!learning_.identification_succeeded()) return;
    learning_.record(service_, parameters_);
    configure();
}

// Where none is known, the observer and the brakes work with what the probe has found so far.
void Cycle::use_rough_model() {
    control_.change_model(learning_.probed_dynamics(), control_.plant().effects, senses_.observer().motion());
    rough_model_ = learning_.probed();
}

void Cycle::serve_parameters(const HostEvents& events) {
    const bool idle = supervisor_.mode() == Mode::idle && !supervisor_.wants_armed();
    for (std::size_t i = 0; i < events.parameter_count; ++i) {
        const protocol::ParameterReply reply = service_.answer(events.parameters[i], idle);
        if (reply.result == protocol::ParameterResult::unknown_index) {
            host_.count(HostLink::Cause::unknown_parameter);
        }
        telemetry_.reply(reply);
    }
    if (const auto reply = service_.saved()) telemetry_.reply(*reply);
    if (service_.changed()) configure();
    control_.step_design();
}

MotionOutput Cycle::decide(const supervisor::Verdict& verdict, const Observed& seen) {
    const supervisor::ModeRule& mode = supervisor::rule_of(verdict.mode);
    MotionOutput output;
    if (verdict.owner == Owner::law && mode.law == Law::excitation) {
        output.torque_Nm = learning_.identify(seen, {&ports_.left.feedback(), &ports_.right.feedback()});
        if (!may_brake() && learning_.probed()) use_rough_model();
        // For some reports no angle is known then: not while the wheels are pushed.
        if (learning_.run().state() == ident::IdentState::probing && output.torque_Nm.is_zero())
            senses_.set_encoder_lag(learning_.encoder_lag_s());
    } else if (verdict.owner == Owner::law) {
        output = control_.torque(mode, seen, host_);
    } else if (verdict.owner == Owner::brake) {
        // A loop on a guess, or over an encoder that may lie, would be worse than none.
        const bool found_a_lie =
            mode.law == Law::excitation && ident::doubts_encoders(learning_.run().cause());
        if (may_brake() && !found_a_lie) output = control_.brake(seen);
    } else {
        control_.release();
    }
    return output;
}

// True: the cycle was long.
bool Cycle::learn(const supervisor::Verdict& verdict, const Observed& seen, const MotionOutput& output) {
    if (verdict.owner != Owner::law || !supervisor::rule_of(verdict.mode).learns) return false;
    return learning_.adapt(seen, output.limits.torque_limited(), control_);
}

void Cycle::send(std::int64_t) {
    torques_.clear();
    ports_.left.command_torque(output_.torque_Nm.left, torques_);
    ports_.right.command_torque(output_.torque_Nm.right, torques_);
    senses_.torque_sent(output_.torque_Nm);
    const std::uint32_t refused = send_refused_;
    // On a jammed bus one torque for each drive may grow old, not a queue of them; one zero may stand behind
    // it, so that a stop is on the wire as soon as what it ends.
    const bool zero_waited = std::exchange(zero_waits_, false);
    for (const hal::CanFrame& frame : torques_.frames()) {
        if (ports_.drive_bus.waits(frame.id)) {
            const bool zero = output_.torque_Nm.is_zero();
            zero_waits_ |= zero || zero_waited;
            if (!zero || zero_waited) {
                ++send_refused_;
                continue;
            }
        }
        transmit(ports_.drive_bus, frame, drive_meter_);
    }
    refused_torques_ = send_refused_ == refused ? 0 : refused_torques_ + 1;
    for (const hal::CanFrame& frame : outbox_.frames()) {
        if (transmit(ports_.drive_bus, frame, drive_meter_)) continue;
        if (!ports_.left.refused(frame)) ports_.right.refused(frame);
    }

    // What leaves last waits in front of the next cycle's torques where others fill the bus.
    const bool urgent = (refused_torques_ > 0 || stopping_cycles_ > 0) && ports_.host_bus == nullptr;
    const Telemetry::Turn turn = long_cycle_ || urgent ? Telemetry::Turn{} : telemetry_.next(cycle_);
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
    drive_meter_.step(elapsed_s());
    if (ports_.host_bus != nullptr) host_meter_.step(elapsed_s());
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

}  // namespace wheelwright::task
