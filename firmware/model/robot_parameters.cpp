#include "firmware/model/robot_parameters.hpp"

#include <cmath>

namespace wheelwright::model {
namespace {

using enum ChangeWhen;
using enum ParameterKind;

constexpr std::array<std::string_view, 2> kReactions{"coast", "ramp"};
constexpr std::array<std::string_view, 2> kMethods{"delayed_plant", "paper"};

// NOLINTBEGIN(cppcoreguidelines-macro-usage): a member path is spelled once for both accessors
#define WW_FIELD(path)                                                              \
    [](const RobotParameters& p) -> double { return static_cast<double>(p.path); }, \
        [](RobotParameters& p, double value) {                                      \
            p.path = static_cast<std::remove_cvref_t<decltype(p.path)>>(value);     \
        }
#define WW_REAL(index, key, unit, standard, low, high, when, meaning) \
    ParameterInfo { index, #key, unit, real, standard, low, high, when, {}, WW_FIELD(key), meaning }
#define WW_INTEGER(index, key, unit, standard, low, high, when, meaning) \
    ParameterInfo { index, #key, unit, integer, standard, low, high, when, {}, WW_FIELD(key), meaning }
#define WW_BOOLEAN(index, key, standard, when, meaning) \
    ParameterInfo { index, #key, "", boolean, standard, 0, 1, when, {}, WW_FIELD(key), meaning }
#define WW_CHOICE(index, key, names, standard, when, meaning)                                               \
    ParameterInfo {                                                                                         \
        index, #key, "", choice, standard, 0, double(names.size() - 1), when, names, WW_FIELD(key), meaning \
    }

// clang-format off
// The one home of names, units, defaults and ranges. Indices are stable: never reuse or renumber one.
constexpr auto kTable = std::to_array<ParameterInfo>({
    WW_REAL(0x0001, geometry.wheel_radius_m.left,  "m", 0.075, 0.005, 2.0, start, "rolling radius of the left wheel"),
    WW_REAL(0x0002, geometry.wheel_radius_m.right, "m", 0.075, 0.005, 2.0, start, "rolling radius of the right wheel"),
    WW_REAL(0x0003, geometry.track_m, "m", 0.32, 0.02, 5.0, start, "distance between the wheels' contact points"),

    WW_REAL(0x0010, limits.torque_Nm, "Nm", 5.0, 0.001, 1000.0, idle, "largest torque asked of one wheel"),
    WW_REAL(0x0011, limits.speed_m_per_s, "m/s", 2.5, 0.01, 20.0, idle, "largest forward or reverse speed commanded"),
    WW_REAL(0x0012, limits.yaw_rate_rad_per_s, "rad/s", 6.0, 0.01, 50.0, idle, "largest yaw rate commanded"),
    WW_REAL(0x0013, limits.acceleration_m_per_s2, "m/s^2", 50.0, 0.01, 200.0, idle, "largest rate of change of the commanded speed"),
    WW_REAL(0x0014, limits.yaw_acceleration_rad_per_s2, "rad/s^2", 200.0, 0.01, 2000.0, idle, "largest rate of change of the commanded yaw rate"),

    WW_REAL(0x0020, bus.bit_rate_bit_per_s, "bit/s", 1e6, 1e5, 1e6, start, "bit rate of the drives' bus"),
    WW_REAL(0x0021, bus.host_bit_rate_bit_per_s, "bit/s", 1e6, 1e5, 1e6, start, "bit rate of the host's bus, where it is another one"),
    WW_REAL(0x0022, bus.load_limit, "", 0.8, 0.1, 0.95, start, "worst-case load above which the firmware refuses to start"),

    WW_INTEGER(0x0030, drive.generation, "", 6, 5, 6, start, "CANSimple generation of the drives: 5 for 0.5.x, 6 for 0.6.x"),
    WW_INTEGER(0x0031, drive.heartbeat_period_ms, "ms", 50, 1, 1000, start, "cyclic period of the drives' heartbeat; a drive's error is known so late at most"),
    WW_INTEGER(0x0032, drive.encoder_period_ms, "ms", 1, 1, 10, start, "cyclic period of the drives' encoder estimates"),
    WW_INTEGER(0x0033, drive.torque_period_ms, "ms", 10, 0, 1000, start, "cyclic period of the drives' torque or current report; 0: off"),
    WW_REAL(0x0034, drive.heartbeat_timeout_s, "s", 0.17, 0.01, 5.0, start, "a drive not heard for this long is silent"),
    WW_REAL(0x0035, drive.arming_timeout_s, "s", 2.0, 0.05, 30.0, start, "time a drive may take from idle to armed"),
    WW_REAL(0x0036, drive.watchdog_timeout_s, "s", 0.05, 0.002, 2.0, start, "time after which the drive stops by itself when no command comes"),
    WW_BOOLEAN(0x0037, drive.watchdog_assured, 0, start, "the operator has checked that the drives' watchdog is on; needed where the drive cannot be asked"),
    WW_INTEGER(0x0038, drive.watchdog_endpoint, "", 0, 0, 65535, start, "CANSimple 0.6: endpoint of axis0.config.enable_watchdog; 0: unknown"),
    WW_INTEGER(0x0039, drive.watchdog_timeout_endpoint, "", 0, 0, 65535, start, "CANSimple 0.6: endpoint of axis0.config.watchdog_timeout; 0: unknown"),
    WW_INTEGER(0x003A, drive.control_mode_endpoint, "", 0, 0, 65535, start, "CANSimple 0.6: endpoint of axis0.controller.config.control_mode; 0: unknown"),
    WW_INTEGER(0x003B, drive.input_mode_endpoint, "", 0, 0, 65535, start, "CANSimple 0.6: endpoint of axis0.controller.config.input_mode; 0: unknown"),
    WW_INTEGER(0x003C, drive.supply_period_ms, "ms", 0, 0, 1000, start, "cyclic period of the drives' report of their supply's voltage; 0: off, and it is not watched"),
    WW_INTEGER(0x003D, drive.temperature_period_ms, "ms", 0, 0, 1000, start, "CANSimple 0.6: cyclic period of the drives' temperature report; 0: off, and heat is seen only when a drive stops for it"),

    WW_INTEGER(0x0040, drive.left.node, "", 1, 0, 62, start, "CAN node of the left drive"),
    WW_INTEGER(0x0041, drive.left.sign, "", 1, -1, 1, start, "1 or -1: direction of the left motor"),
    WW_REAL(0x0042, drive.left.gear_ratio, "", 8.0, 0.01, 1000.0, start, "left motor turns per wheel turn"),
    WW_REAL(0x0043, drive.left.torque_constant_Nm_per_A, "Nm/A", 0.0827, 1e-4, 100.0, start, "left motor torque constant"),
    WW_REAL(0x0044, drive.left.torque_scale, "", 1.0, 0.1, 10.0, idle, "left torque delivered over torque asked, as calibrated"),
    WW_REAL(0x0045, drive.left.encoder_lag_s, "s", 0.0, 0.0, 0.02, idle, "1 / bandwidth of the loop in which the left drive follows its encoder; measured in ident mode, 0: not known"),
    WW_INTEGER(0x0048, drive.right.node, "", 2, 0, 62, start, "CAN node of the right drive"),
    WW_INTEGER(0x0049, drive.right.sign, "", 1, -1, 1, start, "1 or -1: direction of the right motor"),
    WW_REAL(0x004A, drive.right.gear_ratio, "", 8.0, 0.01, 1000.0, start, "right motor turns per wheel turn"),
    WW_REAL(0x004B, drive.right.torque_constant_Nm_per_A, "Nm/A", 0.0827, 1e-4, 100.0, start, "right motor torque constant"),
    WW_REAL(0x004C, drive.right.torque_scale, "", 1.0, 0.1, 10.0, idle, "right torque delivered over torque asked, as calibrated"),
    WW_REAL(0x004D, drive.right.encoder_lag_s, "s", 0.0, 0.0, 0.02, idle, "1 / bandwidth of the loop in which the right drive follows its encoder; measured in ident mode, 0: not known"),

    WW_INTEGER(0x0050, realtime.priority, "", 80, 1, 99, start, "SCHED_FIFO priority of the cycle's thread"),
    WW_INTEGER(0x0051, realtime.cpu, "", -1, -1, 1023, start, "processor the cycle's thread is bound to; -1: any"),
    WW_REAL(0x0052, realtime.send_phase_s, "s", 0.0003, 0.0, 0.0009, start, "time in the cycle at which the torques are sent"),
    WW_INTEGER(0x0054, overrun_fault.in_a_row, "", 3, 1, 1000, start, "missed cycles in a row that are a fault"),
    WW_INTEGER(0x0055, overrun_fault.per_second, "", 10, 1, 1000, start, "missed cycles within a second that are a fault"),

    WW_REAL(0x0060, safety.stale_feedback_s, "s", 0.01, 0.002, 1.0, start, "encoder feedback older than this is a fault"),
    WW_REAL(0x0061, safety.stale_command_cycles, "", 3.0, 1.0, 4.9, start, "a set-point not repeated for this many of its cycle times stops the robot"),
    WW_REAL(0x0062, safety.over_speed_m_per_s, "m/s", 3.2, 0.02, 30.0, start, "measured speed that is a fault"),
    WW_REAL(0x0063, safety.over_yaw_rate_rad_per_s, "rad/s", 14.0, 0.02, 80.0, start, "measured yaw rate that is a fault"),
    WW_REAL(0x0064, safety.clear_speed_m_per_s, "m/s", 0.05, 0.001, 1.0, start, "a fault clears only below this measured wheel rim speed"),
    WW_REAL(0x0065, safety.ramp_timeout_s, "s", 0.0, 0.01, 60.0, start, "a braking ramp that takes longer becomes coasting; auto: twice what half of the torque needs from the speed limits, and 0.5 s"),
    WW_REAL(0x0066, safety.host_timeout_s, "s", 0.4, 0.0, 0.49, start, "a robot that drives stops when no frame of the host but ExternalPose came for this long (HostAlive is one that says nothing else); 0: not asked for"),
    WW_CHOICE(0x0068, safety.stale_command_reaction, kReactions, 0, start, "what a stale set-point does"),
    WW_CHOICE(0x0069, safety.over_speed_reaction, kReactions, 0, start, "what excess speed does"),
    WW_CHOICE(0x006A, safety.emergency_stop_reaction, kReactions, 0, start, "what the emergency stop does"),
    WW_CHOICE(0x006B, safety.overrun_reaction, kReactions, 0, start, "what missed cycles do"),
    WW_CHOICE(0x006C, safety.terminate_reaction, kReactions, 1, start, "what SIGTERM does"),
    WW_CHOICE(0x006D, safety.drive_limits_reaction, kReactions, 0, start, "what a supply that is too low and a drive that is too hot do; one that is too high, which braking would raise, always coasts"),
    WW_REAL(0x0070, safety.lowest_supply_V, "V", 0.0, 1.0, 1000.0, start, "a drive's supply below this is a fault; auto: 8 V, where an ODrive of any size stops by itself. Give the battery's"),
    WW_REAL(0x0071, safety.highest_supply_V, "V", 0.0, 1.0, 1000.0, start, "a drive's supply above this is a fault; auto: 60 V, which no ODrive stands. Give the drives'"),
    WW_REAL(0x0072, safety.inverter_temperature_degC, "degC", 0.0, 20.0, 200.0, start, "an inverter hotter than this is a fault; auto: 110 degC, where half of the current is left"),
    WW_REAL(0x0073, safety.motor_temperature_degC, "degC", 0.0, 20.0, 250.0, start, "a motor hotter than this is a fault; auto: the same. Give the motor's"),

    WW_REAL(0x0080, dynamics.k5_m, "m", 0.0, -10.0, 10.0, idle, "K5: centrifugal coupling"),
    WW_REAL(0x0081, dynamics.k6_per_m, "1/m", 0.0, -1000.0, 1000.0, idle, "K6: Coriolis coupling"),
    WW_REAL(0x0082, dynamics.k7_per_kg_m, "1/(kg m)", 1.0, 1e-5, 1e4, idle, "K7: forward acceleration per summed wheel torque"),
    WW_REAL(0x0083, dynamics.k8_per_kg_m2, "1/(kg m^2)", 5.0, 1e-5, 1e5, idle, "K8: yaw acceleration per wheel torque difference"),
    WW_REAL(0x0084, dynamics_standard_error.k5_m, "m", 0.0, 0.0, 1e3, idle, "standard error of K5; all four 0: not identified"),
    WW_REAL(0x0085, dynamics_standard_error.k6_per_m, "1/m", 0.0, 0.0, 1e4, idle, "standard error of K6"),
    WW_REAL(0x0086, dynamics_standard_error.k7_per_kg_m, "1/(kg m)", 0.0, 0.0, 1e4, idle, "standard error of K7"),
    WW_REAL(0x0087, dynamics_standard_error.k8_per_kg_m2, "1/(kg m^2)", 0.0, 0.0, 1e5, idle, "standard error of K8"),

    WW_REAL(0x00A0, ident.amplitude_Nm, "Nm", 0.0, 0.001, 1000.0, idle, "size of the excitation torque on each wheel; auto: as large as torque, speed and room allow"),
    WW_REAL(0x00A1, ident.bit_time_s, "s", 0.0, 0.001, 0.25, idle, "length of one bit of the excitation; auto: so that a bit changes the speed by about half of its limit"),
    WW_REAL(0x00A2, ident.duration_s, "s", 85.0, 1.0, 250.0, idle, "longest time the identification may take, its probe included; it takes 35 % of that at least"),
    WW_REAL(0x00A3, ident.speed_limit_m_per_s, "m/s", 0.0, 0.02, 5.0, idle, "speed the excitation is kept within; auto: crosses the room in some seconds, and can brake in it"),
    WW_REAL(0x00A4, ident.yaw_rate_limit_rad_per_s, "rad/s", 0.0, 0.1, 25.0, idle, "yaw rate the excitation is kept within; auto: wheels as fast as straight on"),
    WW_REAL(0x00A5, ident.distance_limit_m, "m", 1.5, 0.1, 25.0, idle, "distance from the starting point the excitation is kept within"),
    WW_REAL(0x00A6, ident.relative_standard_error, "", 0.005, 1e-4, 0.5, idle, "standard error over value at which K7 and K8 are good enough"),
    WW_REAL(0x00A7, ident.kernel_s, "s", 0.0, 0.002, 0.25, idle, "half width of the averaging kernel of the regression; auto: about one bit, as short as the encoders' noise allows"),
    WW_REAL(0x00A8, ident.delay_phase_s, "s", 1.0, 0.5, 60.0, idle, "least time given to measuring the actuation delay"),
    WW_REAL(0x00AB, ident.coupling_standard_error_m, "m", 0.0, 1e-6, 1.0, idle, "standard error at which K5, and K6 as a length, are good enough; auto: where it no longer matters at the yaw rate limit"),

    WW_CHOICE(0x00C0, velocity_loop.method, kMethods, 0, idle, "how the velocity loops are designed"),
    WW_REAL(0x00C1, velocity_loop.settling_time_s, "s", 0.0, 0.005, 5.0, idle, "wanted settling time to 1 %; auto: what delay, encoders, their loops and torque allow, at least 0.05 s"),
    WW_REAL(0x00C2, velocity_loop.damping, "", 1.0, 0.3, 3.0, idle, "damping ratio of the paper's design"),
    WW_REAL(0x00C3, velocity_loop.setpoint_weight, "", 0.97, 0.5, 0.98, idle, "share of the reference in the proportional term"),
    WW_REAL(0x00C4, velocity_loop.phase_margin_deg, "deg", 45.0, 20.0, 80.0, idle, "designs with less phase margin are refused"),
    WW_REAL(0x00C5, velocity_loop.sensitivity_peak, "", 2.0, 1.1, 4.0, idle, "designs with a larger peak of the sensitivity are refused"),
    WW_REAL(0x00C6, velocity_loop.actuation_delay_s, "s", 0.002, 0.0, 0.02, idle, "delay from the cycle's start to the torque's centroid; measured in ident mode"),
    WW_REAL(0x00C7, velocity_loop.observer_bandwidth_rad_per_s, "rad/s", 0.0, 5.0, 2000.0, idle, "bandwidth of the wheel speed observer; auto: 12.5 over the settling time"),
    WW_REAL(0x00C8, velocity_loop.angle_noise_rad, "rad", 0.0, 0.0, 0.1, idle, "noise of a wheel's angle; measured in ident mode, 0: not known"),

    WW_REAL(0x00D0, pose_control.gamma1, "1/s", 0.0, 0.05, 10.0, idle, "gain on distance, eq (82); auto: a third of gamma2"),
    WW_REAL(0x00D1, pose_control.gamma2, "1/s", 0.0, 0.05, 20.0, idle, "gain on the bearing error, eq (83); auto: a twelfth of the velocity loops' rate, lower where yaw acceleration is scarce"),
    WW_REAL(0x00D2, pose_control.lambda_ratio, "", 3.0, 0.05, 20.0, idle, "lambda3 / lambda2 of eq (83)"),
    WW_REAL(0x00D3, pose_control.speed_m_per_s, "m/s", 0.0, 0.02, 10.0, idle, "cruising speed towards a pose goal; auto: half of limits.speed_m_per_s"),
    WW_REAL(0x00D4, pose_control.yaw_rate_rad_per_s, "rad/s", 0.0, 0.02, 20.0, idle, "largest yaw rate towards a pose goal; auto: a third of limits.yaw_rate_rad_per_s"),
    WW_REAL(0x00D5, pose_control.stop_radius_m, "m", 0.0, 0.0005, 0.1, idle, "distance at which the goal's position is reached; auto: a hundredth of the track, or twice odometry.external_pose_noise_m"),
    WW_REAL(0x00D6, pose_control.rearm_radius_m, "m", 0.0, 0.001, 0.2, idle, "distance at which a reached goal is pursued again; auto: 2.25 times the stop radius"),
    WW_REAL(0x00D7, pose_control.heading_tolerance_rad, "rad", 0.0, 0.0005, 0.2, idle, "heading error at which the goal's heading is reached; auto: 1.25 times odometry.external_heading_noise_rad"),
    WW_REAL(0x00D8, pose_control.acceleration_m_per_s2, "m/s^2", 0.0, 0.01, 200.0, idle, "largest rate of change of the speed towards a pose goal; auto: a quarter of what half of the torque gives"),
    WW_REAL(0x00D9, pose_control.yaw_acceleration_rad_per_s2, "rad/s^2", 0.0, 0.01, 2000.0, idle, "largest rate of change of the yaw rate towards a pose goal; auto: half of what half of the torque gives"),

    WW_REAL(0x00E0, trajectory.along_gain_per_s, "1/s", 0.0, 0.05, 20.0, idle, "gain on the error along the path; auto: as fast as torque and limits can bring the robot back to rest beside the path"),
    WW_REAL(0x00E1, trajectory.across_gain_per_m2, "1/m^2", 0.0, 0.05, 1000.0, idle, "gain on the error across the path, per distance driven; auto: back on the path within some tracks, or what the yaw acceleration allows"),
    WW_REAL(0x00E2, trajectory.heading_gain_per_m, "1/m", 0.0, 0.05, 200.0, idle, "gain on the heading error, per distance driven; auto: 5/3 of the root of the gain across"),
    WW_REAL(0x00E3, trajectory.length_m, "m", 3.0, 0.1, 60.0, idle, "length of the standard figure-8"),
    WW_REAL(0x00E4, trajectory.width_m, "m", 1.5, 0.1, 60.0, idle, "width of the standard figure-8"),
    WW_REAL(0x00E5, trajectory.period_s, "s", 10.0, 1.0, 600.0, idle, "time for one lap of the standard figure-8"),

    WW_REAL(0x00F0, adaptation.memory_s, "s", 4.0, 0.2, 600.0, idle, "time over which old data are forgotten where new data excite, at least; or 0.4 laps"),
    WW_REAL(0x00F1, adaptation.dwell_s, "s", 0.1, 0.001, 60.0, idle, "least time between two changes of the controller's model"),
    WW_REAL(0x00F2, adaptation.rate_per_s, "1/s", 0.5, 0.001, 100.0, idle, "largest relative change of a parameter per second"),
    WW_REAL(0x00F3, adaptation.minimum_excitation, "", 0.05, 0.0, 10.0, idle, "excitation below which a parameter is frozen"),
    WW_REAL(0x00F4, adaptation.slip_yaw_rate_rad_per_s, "rad/s", 0.0, 0.01, 20.0, idle, "disagreement of yaw rates that is taken for slip; auto: beyond the external heading's noise and a 20th of limits.yaw_rate_rad_per_s"),
    WW_REAL(0x00F5, adaptation.trust_relative_error, "", 0.05, 0.001, 1.0, idle, "relative standard error within which a model is trusted"),
    WW_REAL(0x00F6, adaptation.range, "", 3.0, 1.01, 100.0, idle, "factor by which K7 and K8 may leave the robot file's values"),
    WW_REAL(0x00F7, adaptation.dither_error, "", 0.004, 0.0, 0.2, idle, "relative error of K7 and K8 that the dither beside a path is made for; 0: no dither"),

    WW_REAL(0x0100, odometry.external_pose_noise_m, "m", 0.002, 1e-5, 1.0, idle, "standard deviation of an external position"),
    WW_REAL(0x0101, odometry.external_heading_noise_rad, "rad", 0.004, 1e-5, 1.0, idle, "standard deviation of an external heading"),
    WW_REAL(0x0102, odometry.external_pose_delay_s, "s", 0.0, 0.0, 0.5, idle, "age of an external pose when it arrives"),
    WW_REAL(0x0103, odometry.gate_sigma, "", 6.0, 2.0, 100.0, idle, "innovation, in standard deviations, above which an external pose is doubted"),
    WW_REAL(0x0104, odometry.distance_noise_per_m, "", 0.01, 1e-5, 1.0, idle, "odometry error per distance driven"),
    WW_REAL(0x0105, odometry.turn_noise_per_rad, "", 0.01, 1e-5, 1.0, idle, "odometry error per angle turned"),
    WW_BOOLEAN(0x0106, odometry.calibrate, 1, idle, "estimate the odometry's scale errors from external poses"),

    WW_INTEGER(0x0110, lines.emergency_stop, "", -1, -1, 1023, start, "line of the emergency-stop input; -1: none"),
    WW_INTEGER(0x0111, lines.drive_enable, "", -1, -1, 1023, start, "line of the drive-enable output; -1: none"),
    WW_BOOLEAN(0x0112, lines.emergency_stop_active_low, 1, start, "a low level means stop (a broken wire stops the robot)"),
    WW_BOOLEAN(0x0113, lines.drive_enable_active_low, 0, start, "a low level enables the drives"),
});
// clang-format on
#undef WW_CHOICE
#undef WW_BOOLEAN
#undef WW_INTEGER
#undef WW_REAL
#undef WW_FIELD
// NOLINTEND(cppcoreguidelines-macro-usage)

struct EffectSlot {
    std::size_t effect;
    std::size_t slot;
    bool known;
};

EffectSlot effect_slot(std::uint16_t index) {
    if (index < kEffectIndexBase) return {0, 0, false};
    const std::size_t effect = (index - std::size_t{kEffectIndexBase}) / 16;
    const std::size_t slot = (index - std::size_t{kEffectIndexBase}) % 16;
    const bool known =
        effect < kEffectCount && (slot == kEffectActiveSlot || slot < kEffects[effect].parameters.size());
    return {effect, slot, known};
}

}  // namespace

std::span<const ParameterInfo> parameter_table() { return kTable; }

const ParameterInfo* find_parameter(std::uint16_t index) {
    std::size_t low = 0;
    std::size_t high = kTable.size();
    while (low < high) {
        const std::size_t middle = (low + high) / 2;
        if (kTable[middle].index < index) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low < kTable.size() && kTable[low].index == index ? &kTable[low] : nullptr;
}

const ParameterInfo* find_parameter(std::string_view key) {
    for (const ParameterInfo& info : kTable) {
        if (info.key == key) return &info;
    }
    return nullptr;
}

RobotParameters default_parameters() {
    RobotParameters parameters{};
    for (const ParameterInfo& info : kTable) info.set(parameters, info.standard);
    return parameters;
}

ParameterStatus read_parameter(const RobotParameters& from, std::uint16_t index, double& value) {
    if (const ParameterInfo* info = find_parameter(index)) {
        value = info->get(from);
        return ParameterStatus::ok;
    }
    const EffectSlot at = effect_slot(index);
    if (!at.known) return ParameterStatus::unknown_index;
    value = at.slot == kEffectActiveSlot ? (from.effects.active[at.effect] ? 1.0 : 0.0)
                                         : from.effects.parameter[at.effect][at.slot];
    return ParameterStatus::ok;
}

ParameterStatus write_parameter(RobotParameters& to, std::uint16_t index, double value) {
    if (!std::isfinite(value)) return ParameterStatus::not_finite;
    if (const ParameterInfo* info = find_parameter(index)) {
        if (!info->allows(value)) return ParameterStatus::out_of_range;
        if (info->kind != real && value != std::floor(value)) return ParameterStatus::out_of_range;
        info->set(to, value);
        return ParameterStatus::ok;
    }
    const EffectSlot at = effect_slot(index);
    if (!at.known) return ParameterStatus::unknown_index;
    if (at.slot == kEffectActiveSlot) {
        if (value != 0 && value != 1) return ParameterStatus::out_of_range;
        to.effects.active[at.effect] = value != 0;
        return ParameterStatus::ok;
    }
    const EffectParameterInfo& info = kEffects[at.effect].parameters[at.slot];
    if (value < info.minimum || value > info.maximum) return ParameterStatus::out_of_range;
    to.effects.parameter[at.effect][at.slot] = value;
    return ParameterStatus::ok;
}

ChangeWhen changeable(std::uint16_t index) {
    if (const ParameterInfo* info = find_parameter(index)) return info->when;
    return effect_slot(index).known ? idle : start;
}

const OrderRule* broken_order(const RobotParameters& p) {
    for (const OrderRule& rule : kOrderRules) {
        const double larger = find_parameter(rule.larger)->get(p);
        const double smaller = find_parameter(rule.smaller)->get(p);
        if (larger != 0 && smaller != 0 && !(larger > smaller)) return &rule;
    }
    return nullptr;
}

bool dynamics_known(const RobotParameters& p) {
    const Dynamics<double> standard = default_parameters().dynamics;
    return p.dynamics.k7_per_kg_m != standard.k7_per_kg_m ||
           p.dynamics.k8_per_kg_m2 != standard.k8_per_kg_m2 || p.dynamics_standard_error.k7_per_kg_m > 0;
}

}  // namespace wheelwright::model
