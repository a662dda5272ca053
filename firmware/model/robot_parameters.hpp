// Every number the firmware can be told: the one struct that the robot file fills and that the indexed
// parameters on CAN read and write. Names, units, defaults and ranges have one home, the table in
// robot_parameters.cpp; the struct itself has none. Core code: no allocation, no exceptions.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/effects.hpp"

namespace wheelwright::model {

enum class StopReaction : std::uint8_t {
    coast,  // torque to zero at once
    ramp,   // the velocity loop brakes to rest first, then torque to zero
};

enum class LoopDesignMethod : std::uint8_t {
    delayed_plant,  // on the delayed, sampled plant, with set-point weight
    paper,          // eq (69)-(72): Kp = 2 xi omega_n, Ki = omega_n^2, omega_n = -ln 0.01 / (xi T_s)
};

enum class GoalDirection : std::uint8_t { forward, reverse, automatic };

struct DriveParameters {
    std::int32_t node{};
    std::int32_t sign{};  // +1 or -1: the motor's positive direction drives the robot forward or back
    double gear_ratio{};  // motor turns per wheel turn
    double torque_constant_Nm_per_A{};
    double torque_scale{};   // wheel torque delivered per wheel torque asked
    double encoder_lag_s{};  // encoder_loop.hpp
};

struct RobotParameters {
    Geometry<double> geometry;
    struct {
        double torque_Nm, speed_m_per_s, yaw_rate_rad_per_s, acceleration_m_per_s2,
            yaw_acceleration_rad_per_s2;
    } limits{};
    struct {
        double bit_rate_bit_per_s, host_bit_rate_bit_per_s, load_limit;
    } bus{};
    struct {
        std::int32_t generation;  // 5: 0.5.x, 6: 0.6.x
        std::int32_t heartbeat_period_ms, encoder_period_ms, torque_period_ms, supply_period_ms,
            temperature_period_ms;
        double heartbeat_timeout_s, arming_timeout_s, watchdog_timeout_s;
        bool watchdog_assured;  // the operator vouches for the watchdog (generation 0.5 cannot be asked)
        // 0.6: endpoints of axis0.config.enable_watchdog, .watchdog_timeout,
        // axis0.controller.config.control_mode, .input_mode; 0: unknown
        std::int32_t watchdog_endpoint, watchdog_timeout_endpoint, control_mode_endpoint, input_mode_endpoint;
        DriveParameters left, right;
    } drive{};
    struct {
        std::int32_t priority, cpu;
        double send_phase_s;
    } realtime{};
    struct {
        std::int32_t in_a_row, per_second;
    } overrun_fault{};
    struct {
        double stale_feedback_s, stale_command_cycles, host_timeout_s, over_speed_m_per_s,
            over_yaw_rate_rad_per_s;
        double clear_speed_m_per_s, ramp_timeout_s;
        double lowest_supply_V, highest_supply_V, inverter_temperature_degC, motor_temperature_degC;
        StopReaction stale_command_reaction, over_speed_reaction, emergency_stop_reaction, overrun_reaction,
            terminate_reaction, drive_limits_reaction;
    } safety{};
    Dynamics<double> dynamics;
    Dynamics<double> dynamics_standard_error;
    EffectSet<double> effects;
    EffectSet<double> effects_standard_error;  // `active` unused
    struct {
        double amplitude_Nm, bit_time_s, duration_s, speed_limit_m_per_s, yaw_rate_limit_rad_per_s,
            distance_limit_m, relative_standard_error, coupling_standard_error_m, kernel_s, delay_phase_s;
    } ident{};
    struct {
        LoopDesignMethod method;
        double settling_time_s, damping, setpoint_weight, phase_margin_deg, sensitivity_peak,
            actuation_delay_s, observer_bandwidth_rad_per_s, angle_noise_rad;
    } velocity_loop{};
    struct {
        double gamma1, gamma2, lambda_ratio, speed_m_per_s, yaw_rate_rad_per_s, stop_radius_m, rearm_radius_m,
            heading_tolerance_rad, acceleration_m_per_s2, yaw_acceleration_rad_per_s2;
    } pose_control{};
    struct {
        double along_gain_per_s, across_gain_per_m2, heading_gain_per_m, length_m, width_m, period_s;
    } trajectory{};
    struct {
        double memory_s, dwell_s, rate_per_s, minimum_excitation, slip_yaw_rate_rad_per_s,
            trust_relative_error, range, dither_error;
    } adaptation{};
    struct {
        double external_pose_noise_m, external_heading_noise_rad, external_pose_delay_s, gate_sigma,
            distance_noise_per_m, turn_noise_per_rad;
        bool calibrate;
    } odometry{};
    struct {
        std::int32_t emergency_stop, drive_enable;  // line offsets on the chip; -1: not connected
        bool emergency_stop_active_low, drive_enable_active_low;
    } lines{};
};

enum class ParameterKind : std::uint8_t { real, integer, boolean, choice };

// When a parameter may change once the firmware runs.
enum class ChangeWhen : std::uint8_t {
    start,  // robot file only
    idle,   // over CAN, in the idle mode; takes effect on commit
    any,    // over CAN, in every mode; takes effect on commit
};

struct ParameterInfo {
    std::uint16_t index;   // on CAN; stable for ever
    std::string_view key;  // dotted path in the robot file
    Words unit;            // "" for none
    ParameterKind kind;
    double standard;          // default
    double minimum, maximum;  // beside these, 0 where automatic()
    ChangeWhen when;
    std::span<const std::string_view> choices;  // names of a choice's values, in order of value
    double (*get)(const RobotParameters&);
    void (*set)(RobotParameters&, double);
    Words meaning;

    // 0 stands for "auto", which is the default: the firmware finds the value itself.
    constexpr bool automatic() const { return standard == 0 && minimum > 0; }
    constexpr bool allows(double value) const {
        return (value >= minimum && value <= maximum) || (automatic() && value == 0);
    }
};

// The table, ordered by index. The effects' parameters are not in it: see effect_index().
std::span<const ParameterInfo> parameter_table();

// nullptr when unknown. Cost: a binary search / a linear one.
const ParameterInfo* find_parameter(std::uint16_t index);
const ParameterInfo* find_parameter(std::string_view key);

// What must be larger than something else, where neither is automatic.
struct OrderRule {
    std::string_view larger, smaller;
};
inline constexpr auto kOrderRules = std::to_array<OrderRule>({
    OrderRule{"safety.over_speed_m_per_s", "limits.speed_m_per_s"},
    OrderRule{"safety.over_yaw_rate_rad_per_s", "limits.yaw_rate_rad_per_s"},
    OrderRule{"safety.over_speed_m_per_s", "ident.speed_limit_m_per_s"},
    OrderRule{"safety.over_yaw_rate_rad_per_s", "ident.yaw_rate_limit_rad_per_s"},
    OrderRule{"safety.highest_supply_V", "safety.lowest_supply_V"},
    OrderRule{"pose_control.rearm_radius_m", "pose_control.stop_radius_m"},
});
// The first that does not hold; nullptr: all do.
const OrderRule* broken_order(const RobotParameters& parameters);

// All parameters at their defaults, no effects active.
RobotParameters default_parameters();

// False: K7 and K8 are the table's defaults; nobody has given, measured or weighed them.
bool dynamics_known(const RobotParameters& parameters);

// Effects on CAN: 0x4000 + 16 * effect + parameter, and slot 15 for `active` (0 or 1).
inline constexpr std::uint16_t kEffectIndexBase = 0x4000;
inline constexpr std::uint16_t kEffectActiveSlot = 15;
constexpr std::uint16_t effect_index(std::size_t effect, std::size_t parameter) {
    return static_cast<std::uint16_t>(kEffectIndexBase + 16 * effect + parameter);
}

enum class ParameterStatus : std::uint8_t { ok, unknown_index, out_of_range, not_finite };

// Reads or writes one value by CAN index, effects included. A write checks finiteness, range and, for
// integers, booleans and choices, that the value is whole; on any status but ok nothing changes.
ParameterStatus read_parameter(const RobotParameters& from, std::uint16_t index, double& value);
ParameterStatus write_parameter(RobotParameters& to, std::uint16_t index, double value);

// ChangeWhen of an index; `start` when unknown.
ChangeWhen changeable(std::uint16_t index);

}  // namespace wheelwright::model
