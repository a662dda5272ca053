// The modes, the faults and the table that says who may drive the wheels now. Data only; supervisor.hpp runs
// it. Numbers are the value tables of the DBC (a test compares them).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/protocol/wheelwright_messages.hpp"

namespace wheelwright::supervisor {

// One home for the names and numbers: the value tables of wheelwright.dbc.
using protocol::Blocker;  // why a requested mode is not entered
using protocol::Fault;
using protocol::Mode;
inline constexpr std::size_t kModeCount = protocol::mode_values.size();

// What is true in this cycle. The cycle fills it from measurements; nothing in it is latched.
struct Conditions {
    bool feedback_stale = false;       // encoder feedback of a wheel is older than its limit
    bool encoder_implausible = false;  // a wheel's angle stands still though the wheel must have turned
    bool command_stale = false;  // the active mode's set-point was not repeated in time, or the host is gone
    bool drive_error = false;    // a drive reports an error
    bool torque_not_followed = false;    // a drive reports another torque set-point than it was given
    bool drive_enable_failed = false;    // the drive-enable line cannot be written
    bool foreign_control = false;        // somebody else arms a drive or gives it set-points
    bool drive_silent = false;           // a drive's heartbeat is overdue
    bool drives_armed = false;           // both drives follow torque commands
    bool path_known = true;              // the pace of the path that is to be driven
    bool drive_disarmed_itself = false;  // a drive that was armed has left that state unasked
    bool arming_refused = false;         // a drive would not arm
    bool watchdog_confirmed = false;     // both drives' own watchdogs are known to be on
    bool control_mode_confirmed = true;  // neither drive has said that it is not in torque mode
    bool over_speed = false;
    bool stop_line_active = false;  // also when the line cannot be read
    bool stop_message = false;      // an emergency-stop message came in this cycle
    bool overrun = false;           // too many missed cycles
    bool bus_down = false;
    bool not_finite = false;                // a computed torque or state was not a number
    bool terminate = false;                 // the process was asked to end
    bool moving = false;                    // a wheel's rim is faster than safety.clear_speed_m_per_s
    bool rolling = true;                    // a wheel does not stand yet; looked at while braking
    bool model_known = false;               // K7 and K8 are identified or given, not the defaults
    bool velocity_design_accepted = false;  // the velocity loops have a design with the demanded margins
    bool model_trusted = false;             // K7 and K8 have standard errors within the limit
    bool mode_finished = false;             // the active mode has nothing left to do (identification)
};

inline constexpr std::uint16_t bit(Mode mode) { return static_cast<std::uint16_t>(1U << unsigned(mode)); }
inline constexpr std::uint16_t kDriving = bit(Mode::torque) | bit(Mode::ident) | bit(Mode::velocity) |
                                          bit(Mode::pose) | bit(Mode::trajectory) | bit(Mode::adaptive);
inline constexpr std::uint16_t kIdle = bit(Mode::idle);
inline constexpr std::uint16_t kPathModes = bit(Mode::trajectory) | bit(Mode::adaptive);

// Which stop a fault asks for. `as_configured_*` names a parameter of the robot file's [safety].
enum class StopBy : std::uint8_t {
    coast,  // torque zero at once; the only choice where speed is not known or torque not obeyed
    as_configured_stale_command,
    as_configured_over_speed,
    as_configured_emergency_stop,
    as_configured_overrun,
    as_configured_terminate,
};

// One row: in these modes, this condition becomes this fault. Rows are read in order; the first that holds
// names the fault. A fault is latched until it is cleared.
struct FaultRule {
    bool Conditions::*when;
    std::uint16_t modes;
    Fault fault;
    StopBy stop;
};

inline constexpr std::array kFaultRules{
    FaultRule{&Conditions::not_finite, kDriving, Fault::internal_error, StopBy::coast},
    FaultRule{&Conditions::stop_line_active, kDriving, Fault::emergency_stop_line,
              StopBy::as_configured_emergency_stop},
    FaultRule{&Conditions::stop_message, kDriving | kIdle, Fault::emergency_stop_message,
              StopBy::as_configured_emergency_stop},
    FaultRule{&Conditions::bus_down, kDriving, Fault::bus_down, StopBy::coast},
    // After a stall of this computer all else is old, and the drives have stopped by themselves.
    FaultRule{&Conditions::overrun, kDriving, Fault::cycle_overrun, StopBy::as_configured_overrun},
    FaultRule{&Conditions::foreign_control, kDriving | kIdle, Fault::foreign_control, StopBy::coast},
    FaultRule{&Conditions::drive_enable_failed, kDriving, Fault::drive_enable_failed, StopBy::coast},
    FaultRule{&Conditions::torque_not_followed, kDriving, Fault::torque_not_followed, StopBy::coast},
    FaultRule{&Conditions::drive_error, kDriving, Fault::drive_error, StopBy::coast},
    FaultRule{&Conditions::drive_silent, kDriving, Fault::drive_silent, StopBy::coast},
    FaultRule{&Conditions::drive_disarmed_itself, kDriving, Fault::drive_left_armed_state, StopBy::coast},
    FaultRule{&Conditions::feedback_stale, kDriving, Fault::stale_feedback, StopBy::coast},
    FaultRule{&Conditions::encoder_implausible, kDriving, Fault::encoder_implausible, StopBy::coast},
    FaultRule{&Conditions::over_speed, kDriving, Fault::over_speed, StopBy::as_configured_over_speed},
    FaultRule{&Conditions::command_stale, kDriving, Fault::stale_command,
              StopBy::as_configured_stale_command},
    FaultRule{&Conditions::terminate, kDriving, Fault::terminated, StopBy::as_configured_terminate},
};

// One requirement for entering a mode: the condition must have this value, or the blocker is named.
struct EntryRule {
    std::uint16_t into;
    bool Conditions::*what;
    bool must_be;
    Blocker otherwise;
};

// Checked when a mode is asked for: all must hold or the request is rejected and nothing changes. And again
// when it is entered after arming.
inline constexpr std::array kEntryRules{
    EntryRule{kDriving, &Conditions::stop_line_active, false, Blocker::stop_line_active},
    EntryRule{kDriving, &Conditions::drive_silent, false, Blocker::drives_not_armed},
    EntryRule{kDriving, &Conditions::drive_error, false, Blocker::drive_error},
    EntryRule{bit(Mode::ident), &Conditions::moving, false, Blocker::robot_moving},
    EntryRule{bit(Mode::velocity) | bit(Mode::pose) | bit(Mode::trajectory) | bit(Mode::adaptive),
              &Conditions::model_known, true, Blocker::not_identified},
    EntryRule{bit(Mode::velocity) | bit(Mode::pose) | bit(Mode::trajectory) | bit(Mode::adaptive),
              &Conditions::velocity_design_accepted, true, Blocker::design_refused},
    EntryRule{bit(Mode::adaptive), &Conditions::model_trusted, true, Blocker::model_not_trusted},
};

// From which modes a mode may be asked for. A mode may be asked for again while it is active.
inline constexpr std::array<std::uint16_t, kModeCount> kMayEnterFrom{
    /* boot       */ 0,
    /* idle       */ kIdle | kDriving,
    /* torque     */ kIdle | kDriving,
    /* ident      */ kIdle | bit(Mode::ident),
    /* velocity   */ kIdle | kDriving,
    /* pose       */ kIdle | kDriving,
    /* trajectory */ kIdle | kDriving,
    /* adaptive   */ kIdle | kDriving,
    /* fault      */ 0,
};

}  // namespace wheelwright::supervisor
