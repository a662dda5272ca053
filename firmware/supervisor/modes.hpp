// The modes, the faults and the tables that say who may drive the wheels now. Data only; supervisor.hpp runs
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
using protocol::Remedy;  // what lets a latched fault be left
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
    bool supply_low = false;             // a drive reports a supply below its limit,
    bool supply_high = false;            // or above it,
    bool drive_overheated = false;       // or an inverter or motor that is too hot
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

// From where a mode may be asked for; and in itself.
enum class From : std::uint8_t { nowhere, idle, idle_or_driving };

// What gives the torque while a mode drives.
enum class Law : std::uint8_t { none, torque, excitation, velocity, pose, path };

// The set-point that must go on coming, once it has begun. In every mode that drives somebody must be there
// besides: a host of which anything comes.
enum class Setpoint : std::uint8_t {
    none,
    torque,
    velocity,
    goal,
    stream  // where the path is one
};

// What must be true to enter a mode: bits for kEntryRules and kArmedRules.
using Needs = std::uint8_t;
inline constexpr Needs kNothing = 0, kAlways = 0, kDrives = 1, kRest = 2, kLoops = 4, kTrust = 8, kPath = 16;

struct ModeRule {
    Mode mode;
    From from;
    Needs needs;
    Law law;
    Setpoint setpoint;
    bool learns;  // the model is adapted beside the law
};

// A mode is its row.
inline constexpr std::array kModes{
    ModeRule{Mode::boot, From::nowhere, kNothing, Law::none, Setpoint::none, false},
    ModeRule{Mode::idle, From::idle_or_driving, kNothing, Law::none, Setpoint::none, false},
    ModeRule{Mode::torque, From::idle_or_driving, kDrives, Law::torque, Setpoint::torque, false},
    ModeRule{Mode::ident, From::idle, kDrives | kRest, Law::excitation, Setpoint::none, false},
    ModeRule{Mode::velocity, From::idle_or_driving, kDrives | kLoops, Law::velocity, Setpoint::velocity,
             false},
    ModeRule{Mode::pose, From::idle_or_driving, kDrives | kLoops, Law::pose, Setpoint::goal, false},
    ModeRule{Mode::trajectory, From::idle_or_driving, kDrives | kLoops | kPath, Law::path, Setpoint::stream,
             false},
    ModeRule{Mode::adaptive, From::idle_or_driving, kDrives | kLoops | kPath | kTrust, Law::path,
             Setpoint::stream, true},
    ModeRule{Mode::fault, From::nowhere, kNothing, Law::none, Setpoint::none, false},
};
static_assert([] {
    for (std::size_t i = 0; i < kModes.size(); ++i) {
        if (std::size_t(kModes[i].mode) != i) return false;
    }
    return kModes.size() == kModeCount;
}());

inline constexpr const ModeRule& rule_of(Mode mode) { return kModes[std::size_t(mode)]; }
inline constexpr bool drives(Mode mode) { return rule_of(mode).law != Law::none; }

inline constexpr std::uint16_t bit(Mode mode) { return static_cast<std::uint16_t>(1U << unsigned(mode)); }
template <typename Which>
constexpr std::uint16_t modes_where(Which which) {
    std::uint16_t modes = 0;
    for (const ModeRule& rule : kModes) modes |= which(rule) ? bit(rule.mode) : std::uint16_t{0};
    return modes;
}
inline constexpr std::uint16_t kIdle = bit(Mode::idle);
inline constexpr std::uint16_t kDriving = modes_where([](const ModeRule& m) { return m.law != Law::none; });

// Whether a stop brakes to rest first, as the robot file's [safety] says.
struct StopChoices {
    bool stale_command_ramps = false;
    bool over_speed_ramps = false;
    bool emergency_stop_ramps = false;
    bool overrun_ramps = false;
    bool terminate_ramps = true;
    bool drive_limits_ramp = false;
};
inline constexpr bool StopChoices::*kCoast = nullptr;  // where speed is not known or torque not obeyed

// One row: in these modes, this condition becomes this fault. The first row that holds names the fault, which
// is latched until it is cleared. Braking needs the leave of all rows that hold, and goes on only as long as
// it has it: of two reactions the stricter one is taken.
struct FaultRule {
    bool Conditions::*when;
    bool is;
    std::uint16_t modes;
    Fault fault;
    bool StopChoices::*ramps;
    bool dominates = false;  // takes the name of a fault that is latched already
};

inline constexpr std::array kFaultRules{
    FaultRule{&Conditions::stop_line_active, true, kDriving, Fault::emergency_stop_line,
              &StopChoices::emergency_stop_ramps, true},
    FaultRule{&Conditions::stop_message, true, kDriving | kIdle, Fault::emergency_stop_message,
              &StopChoices::emergency_stop_ramps, true},
    FaultRule{&Conditions::not_finite, true, kDriving, Fault::internal_error, kCoast},
    FaultRule{&Conditions::bus_down, true, kDriving, Fault::bus_down, kCoast},
    // After a stall of this computer all else is old, and the drives have stopped by themselves.
    FaultRule{&Conditions::overrun, true, kDriving, Fault::cycle_overrun, &StopChoices::overrun_ramps},
    FaultRule{&Conditions::foreign_control, true, kDriving | kIdle, Fault::foreign_control, kCoast},
    FaultRule{&Conditions::drive_enable_failed, true, kDriving, Fault::drive_enable_failed, kCoast},
    FaultRule{&Conditions::torque_not_followed, true, kDriving, Fault::torque_not_followed, kCoast},
    FaultRule{&Conditions::drive_error, true, kDriving, Fault::drive_error, kCoast},
    FaultRule{&Conditions::drive_silent, true, kDriving, Fault::drive_silent, kCoast},
    FaultRule{&Conditions::drive_disarmed_itself, true, kDriving, Fault::drive_left_armed_state, kCoast},
    FaultRule{&Conditions::drives_armed, false, kDriving, Fault::drive_left_armed_state, kCoast},
    FaultRule{&Conditions::feedback_stale, true, kDriving, Fault::stale_feedback, kCoast},
    FaultRule{&Conditions::encoder_implausible, true, kDriving, Fault::encoder_implausible, kCoast},
    FaultRule{&Conditions::over_speed, true, kDriving, Fault::over_speed, &StopChoices::over_speed_ramps},
    FaultRule{&Conditions::supply_low, true, kDriving, Fault::drive_voltage_out_of_range,
              &StopChoices::drive_limits_ramp},
    // Braking would raise it further.
    FaultRule{&Conditions::supply_high, true, kDriving, Fault::drive_voltage_out_of_range, kCoast},
    FaultRule{&Conditions::drive_overheated, true, kDriving, Fault::drive_overheated,
              &StopChoices::drive_limits_ramp},
    FaultRule{&Conditions::command_stale, true, kDriving, Fault::stale_command,
              &StopChoices::stale_command_ramps},
    FaultRule{&Conditions::terminate, true, kDriving, Fault::terminated, &StopChoices::terminate_ramps},
};

// What the supervisor is doing inside a mode.
enum class Phase : std::uint8_t {
    steady,   // the mode's own law drives, if it has one
    arming,   // idle, on the way to the requested mode: the drives are being armed
    ramping,  // braking to rest under the velocity loop, then torque zero
};

// Who may give the wheels torque.
enum class Owner : std::uint8_t { nobody, law, brake };

inline constexpr std::uint32_t bit(Fault fault) { return 1U << unsigned(fault); }

struct PhaseRule {
    Owner owner;              // nobody where the mode has no law
    bool arms;                // the drives are armed, or being armed, whatever the mode
    std::uint32_t exempt;     // faults that are not looked for
    Blocker keeps_the_fault;  // why it cannot be cleared
};

inline constexpr std::array kPhases{
    /* steady  */ PhaseRule{Owner::law, false, 0, Blocker::none},
    // No set-point yet, no armed drive that could leave that state, and a drive's error shows as a refusal.
    /* arming  */
    PhaseRule{Owner::nobody, true,
              bit(Fault::stale_command) | bit(Fault::drive_left_armed_state) | bit(Fault::drive_error),
              Blocker::none},
    // Braking to rest needs no set-point.
    /* ramping */ PhaseRule{Owner::brake, true, bit(Fault::stale_command), Blocker::robot_moving},
};

// One requirement: the condition must have this value, or the blocker is named. The first one names it.
struct Requirement {
    Needs of;  // a mode with this need, or kAlways
    bool Conditions::*what;
    bool must_be;
    Blocker otherwise;
};

// Looked at when a mode is asked for: all must hold or the request is rejected and nothing changes. And again
// when it is entered after arming.
inline constexpr std::array kEntryRules{
    Requirement{kDrives, &Conditions::stop_line_active, false, Blocker::stop_line_active},
    Requirement{kDrives, &Conditions::terminate, false, Blocker::fault_latched},
    Requirement{kDrives, &Conditions::drive_silent, false, Blocker::drives_not_armed},
    Requirement{kDrives, &Conditions::drive_error, false, Blocker::drive_error},
    Requirement{kDrives, &Conditions::supply_low, false, Blocker::drive_out_of_limits},
    Requirement{kDrives, &Conditions::supply_high, false, Blocker::drive_out_of_limits},
    Requirement{kDrives, &Conditions::drive_overheated, false, Blocker::drive_out_of_limits},
    Requirement{kRest, &Conditions::moving, false, Blocker::robot_moving},
    Requirement{kLoops, &Conditions::model_known, true, Blocker::not_identified},
    Requirement{kLoops, &Conditions::velocity_design_accepted, true, Blocker::design_refused},
    Requirement{kTrust, &Conditions::model_trusted, true, Blocker::model_not_trusted},
};

// What arming waits for.
inline constexpr std::array kArmedRules{
    Requirement{kDrives, &Conditions::drives_armed, true, Blocker::drives_not_armed},
    Requirement{kDrives, &Conditions::drive_error, false, Blocker::drive_error},
    Requirement{kDrives, &Conditions::drive_disarmed_itself, false, Blocker::drives_not_armed},
    Requirement{kPath, &Conditions::path_known, true, Blocker::none},
};

// Why drives would not arm; else drives_not_armed.
inline constexpr std::array kArmingFailures{
    Requirement{kDrives, &Conditions::watchdog_confirmed, true, Blocker::watchdog_not_confirmed},
    Requirement{kDrives, &Conditions::control_mode_confirmed, true, Blocker::control_mode_not_confirmed},
    Requirement{kDrives, &Conditions::drive_error, false, Blocker::drive_error},
};

// What must be so before a fault can be cleared; else what has to happen first.
struct ClearRule : Requirement {
    Remedy remedy;
};
inline constexpr std::array kClearRules{
    ClearRule{{kAlways, &Conditions::terminate, false, Blocker::fault_latched}, Remedy::restart},
    ClearRule{{kAlways, &Conditions::moving, false, Blocker::robot_moving}, Remedy::standstill},
    ClearRule{{kAlways, &Conditions::stop_line_active, false, Blocker::stop_line_active},
              Remedy::release_stop_line},
    ClearRule{{kAlways, &Conditions::bus_down, false, Blocker::fault_latched}, Remedy::restore_bus},
    ClearRule{{kAlways, &Conditions::stop_message, false, Blocker::fault_latched}, Remedy::clear_fault},
};

// The first of the rules that is not met; null: all are.
template <typename Rules>
constexpr auto unmet(const Rules& rules, Needs needs, const Conditions& now) {
    const typename Rules::value_type* found = nullptr;
    for (const auto& rule : rules) {
        if ((rule.of == kAlways || (rule.of & needs) != 0) && now.*rule.what != rule.must_be) {
            found = &rule;
            break;
        }
    }
    return found;
}

}  // namespace wheelwright::supervisor
