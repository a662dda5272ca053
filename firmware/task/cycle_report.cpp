// What a cycle tells: the parts of its report, from where their values are kept.
#include <algorithm>
#include <cmath>

#include "firmware/task/cycle.hpp"
#include "firmware/task/ident_quantities.hpp"

namespace wheelwright::task {
namespace {

using drivers::DriveState;

static_assert(unsigned(protocol::DriveState::silent) == unsigned(DriveState::silent) &&
              unsigned(protocol::DriveState::idle) == unsigned(DriveState::idle) &&
              unsigned(protocol::DriveState::arming) == unsigned(DriveState::arming) &&
              unsigned(protocol::DriveState::armed) == unsigned(DriveState::armed) &&
              unsigned(protocol::DriveState::fault) == unsigned(DriveState::fault));

double microseconds(std::int64_t ns) { return 1e-3 * static_cast<double>(ns); }

std::uint16_t narrow(std::uint64_t value) {
    return static_cast<std::uint16_t>(std::min<std::uint64_t>(value, 0xFFFF));
}

}  // namespace

CycleReport Cycle::report() const {
    CycleReport report;
    for (std::size_t part = 0; part < kReportParts; ++part) fill(static_cast<ReportPart>(part), report);
    return report;
}

void Cycle::fill(ReportPart part, CycleReport& r) const {
    const ident::DynamicsEstimate<Real>& estimate = learning_.estimate();
    switch (part) {
        case ReportPart::status:
            fill_status(r.status);
            break;
        case ReportPart::motion: {
            const model::Motion<Real>& motion = senses_.observer().motion();
            r.wheel_speed_rad_per_s = motion.wheel_speed_rad_per_s;
            r.torque_Nm = output_.torque_Nm;
            r.pose = senses_.odometry().pose();
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
        case ReportPart::drive_health:
            r.drive_health = {drive_limits_.health(0), drive_limits_.health(1)};
            r.drive_health_told = drive_limits_.told();
            break;
        case ReportPart::pace:
            r.pace = control_.told_pace();
            r.pace_known = model_known_ && conditions_.path_known;
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
    const supervisor::ModeRule& mode = supervisor::rule_of(supervisor_.mode());
    s.state = mode.mode;
    s.requested = supervisor_.requested();
    s.fault = supervisor_.fault();
    s.blocker = supervisor_.blocker();
    s.cleared_by = supervisor_.cleared_by();
    const double torque_limit = parameters_.limits.torque_Nm * (1 - 1e-9);
    s.limit_torque_left = std::abs(output_.torque_Nm.left) >= torque_limit;
    s.limit_torque_right = std::abs(output_.torque_Nm.right) >= torque_limit;
    s.limit_speed = limits.has(control::Limiter::speed);
    s.limit_yaw_rate = limits.has(control::Limiter::yaw_rate);
    s.limit_acceleration =
        limits.has(control::Limiter::acceleration) || limits.has(control::Limiter::yaw_acceleration);
    if (mode.law == supervisor::Law::excitation) {
        const auto& overrides = learning_.run().excitation().overrides();
        s.limit_speed = overrides.speed;
        s.limit_yaw_rate = overrides.yaw_rate;
        s.limit_area = overrides.distance;
        s.limit_torque_left = s.limit_torque_right = false;  // its torque is meant to be at the limit
    } else {
        s.limit_area = false;
    }
    s.limit_adaptation_frozen =
        mode.learns && (learning_.adaptation_frozen() || senses_.slipping(time_.scheduled_ns));
    s.limit_drives = drive_limits_.verdict().near;
    s.drive_left = static_cast<protocol::DriveState>(ports_.left.state());
    s.drive_right = static_cast<protocol::DriveState>(ports_.right.state());
    s.progress_percent = 100 * learning_.progress();
    s.model_trusted = conditions_.model_trusted;
    s.excited = learning_.excited();
    s.pose_fixed = senses_.odometry().localised();
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
    put(Cause::stale_feedback_cycles, judge_.stale_feedback_cycles());
    put(Cause::foreign_control, judge_.foreign_control());
}

}  // namespace wheelwright::task
