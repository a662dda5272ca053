#include "firmware/supervisor/supervisor.hpp"

#include <limits>

namespace wheelwright::supervisor {

Blocker Supervisor::request(Mode wanted, const Conditions& now) {
    const auto refuse = [this](Blocker why) {
        blocker_ = why;
        return why;
    };
    if (unsigned(wanted) >= kModeCount || kMayEnterFrom[unsigned(wanted)] == 0) {
        return refuse(Blocker::unknown_mode);
    }
    if (mode_ == Mode::fault) return refuse(Blocker::fault_latched);
    if ((kMayEnterFrom[unsigned(wanted)] & bit(mode_)) == 0) return refuse(Blocker::not_idle);
    if (const Blocker why = blocker_into(wanted, now); why != Blocker::none) return refuse(why);
    blocker_ = Blocker::none;
    if (wanted == requested_ && wanted == mode_ && phase_ == Phase::steady) return Blocker::none;

    requested_ = wanted;
    phase_cycles_ = 0;
    if (wanted == Mode::idle) {
        // From motion: brake first. Arming is simply given up.
        phase_ = (bit(mode_) & kDriving) != 0 ? Phase::ramping : Phase::steady;
    } else if ((bit(mode_) & kDriving) != 0 && phase_ != Phase::arming) {
        enter(wanted);
        entry_pending_ = true;
    } else {
        phase_ = Phase::arming;
    }
    return Blocker::none;
}

Blocker Supervisor::blocker_into(Mode wanted, const Conditions& now) const {
    for (const EntryRule& rule : kEntryRules) {
        if ((rule.into & bit(wanted)) != 0 && now.*rule.what != rule.must_be) return rule.otherwise;
    }
    return Blocker::none;
}

Blocker Supervisor::clear_fault(const Conditions& now) {
    if (mode_ != Mode::fault) return blocker_ = Blocker::none;
    if (phase_ == Phase::ramping || now.moving) return blocker_ = Blocker::robot_moving;
    if (now.stop_line_active) return blocker_ = Blocker::stop_line_active;
    if (now.terminate || now.bus_down) return blocker_ = Blocker::fault_latched;
    mode_ = Mode::idle;
    requested_ = Mode::idle;
    fault_ = Fault::none;
    return blocker_ = Blocker::none;
}

void Supervisor::step(const Conditions& now) {
    entered_ = entry_pending_;
    entry_pending_ = false;
    if (phase_cycles_ < std::numeric_limits<std::int32_t>::max()) ++phase_cycles_;  // 24 days are not the end
    if (mode_ == Mode::boot) return;

    // Arming and ramping to idle are watched by the rules of the driving modes.
    const std::uint16_t watched = phase_ == Phase::arming ? bit(requested_) : bit(mode_);
    if (mode_ != Mode::fault) {
        for (const FaultRule& rule : kFaultRules) {
            if ((rule.modes & watched) == 0 || !(now.*rule.when)) continue;
            if (exempt(rule.fault)) continue;
            stop(rule.fault, ramps(rule.stop));
            return;
        }
    } else {
        const bool emergency = now.stop_line_active || now.stop_message;
        if (emergency) {  // remembered, whatever the fault was before
            fault_ = now.stop_line_active ? Fault::emergency_stop_line : Fault::emergency_stop_message;
        }
        // Braking needs feedback, obedient drives and time; without one of them it becomes coasting.
        if (now.feedback_stale || now.encoder_implausible || now.foreign_control || !now.drives_armed ||
            now.drive_error || now.torque_not_followed || now.drive_enable_failed || now.bus_down ||
            now.not_finite || (emergency && !config_.stops.emergency_stop_ramps)) {
            phase_ = Phase::steady;
        }
    }

    switch (phase_) {
        case Phase::arming:
            if (now.arming_refused || phase_cycles_ > config_.arming_limit_cycles) {
                blocker_ = !now.watchdog_confirmed       ? Blocker::watchdog_not_confirmed
                           : !now.control_mode_confirmed ? Blocker::control_mode_not_confirmed
                           : now.drive_error             ? Blocker::drive_error
                                                         : Blocker::drives_not_armed;
                stop(Fault::arming_refused, false);
            } else if (now.drives_armed && !now.drive_error && !now.drive_disarmed_itself &&
                       (now.path_known || (bit(requested_) & kPathModes) == 0)) {
                // What the request rested on may have changed since.
                blocker_ = blocker_into(requested_, now);
                if (blocker_ == Blocker::none) {
                    enter(requested_);
                } else {
                    requested_ = Mode::idle;
                    phase_ = Phase::steady;
                }
            }
            break;
        case Phase::ramping:
            if (!now.rolling || phase_cycles_ > config_.ramp_limit_cycles) {
                phase_ = Phase::steady;
                if (mode_ != Mode::fault) mode_ = Mode::idle;
            }
            break;
        case Phase::steady:
            if ((bit(mode_) & kDriving) != 0 && now.mode_finished) {
                requested_ = Mode::idle;
                phase_ = Phase::ramping;
                phase_cycles_ = 0;
            }
            break;
    }
}

void Supervisor::enter(Mode mode) {
    mode_ = mode;
    phase_ = Phase::steady;
    phase_cycles_ = 0;
    entered_ = true;
}

void Supervisor::stop(Fault fault, bool ramp) {
    fault_ = fault;
    requested_ = Mode::idle;
    // A ramp makes sense only where a mode was driving.
    phase_ = ramp && (bit(mode_) & kDriving) != 0 ? Phase::ramping : Phase::steady;
    phase_cycles_ = 0;
    mode_ = Mode::fault;
    entered_ = false;
    entry_pending_ = false;
}

// While arming there is no set-point yet, no armed drive that could leave that state, and a drive's error
// shows as a refusal. Braking to rest needs no set-point.
bool Supervisor::exempt(Fault fault) const {
    switch (phase_) {
        case Phase::arming:
            return fault == Fault::stale_command || fault == Fault::drive_left_armed_state ||
                   fault == Fault::drive_error;
        case Phase::ramping:
            return fault == Fault::stale_command;
        case Phase::steady:
            return false;
    }
    return false;
}

bool Supervisor::ramps(StopBy stop) const {
    switch (stop) {
        case StopBy::coast:
            return false;
        case StopBy::as_configured_stale_command:
            return config_.stops.stale_command_ramps;
        case StopBy::as_configured_over_speed:
            return config_.stops.over_speed_ramps;
        case StopBy::as_configured_emergency_stop:
            return config_.stops.emergency_stop_ramps;
        case StopBy::as_configured_overrun:
            return config_.stops.overrun_ramps;
        case StopBy::as_configured_terminate:
            return config_.stops.terminate_ramps;
    }
    return false;
}

}  // namespace wheelwright::supervisor
