#include "drivers/odrive/odrive_drive.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "drivers/odrive/odrive_0_5_messages.hpp"
#include "drivers/odrive/odrive_0_6_messages.hpp"

namespace wheelwright::drivers {
namespace {

// Messages that both generations share are taken from 0.6.
namespace gen5 = odrive_0_5;
namespace gen6 = odrive_0_6;

constexpr double kTwoPi = 6.283185307179586476925286766559;
constexpr auto kIdle = static_cast<std::uint32_t>(gen6::AxisState::idle);
constexpr auto kClosedLoop = static_cast<std::uint32_t>(gen6::AxisState::closed_loop_control);

// A heartbeat received this soon after a command may have been written before the command was obeyed.
constexpr std::int64_t kSettle_ns = 5'000'000;
constexpr std::int64_t kAskAgain_ns = 20'000'000;
constexpr std::int64_t kIdleAgain_ns = 50'000'000;
// A drive's own set-point against what was asked of it: see the header.
constexpr double kTorqueSlack = 0.1;
constexpr int kWrongTorques = 2;

// Longer than this many encoder periods between two encoder frames: some are missing. And so many, and as no
// drive starts within 5 ms, that it may have been switched on anew.
constexpr double kGap = 1.5;
constexpr double kLongGap = 2, kStarts_s = 5e-3;
// A wheel's turn of which no encoder tells less: see wheel_observer.hpp.
constexpr double kCoarsestStep_turns = 1.0 / 64;
// Frames of another generation's form: doubt, and no doubt.
constexpr int kStrange = 2;
constexpr int kSurelyOther = 3, kMostStrange = 4;
constexpr std::int64_t kInsists_ns = 1'000'000'000;

constexpr std::uint32_t kSetInputPosition = 0x0C;  // never sent by this driver

struct ErrorName {
    std::uint32_t bit;
    std::string_view name;
};

constexpr std::array kErrors5{
    ErrorName{gen5::AxisError::invalid_state, "invalid_state"},
    ErrorName{gen5::AxisError::motor_failed, "motor_failed"},
    ErrorName{gen5::AxisError::sensorless_estimator_failed, "sensorless_estimator_failed"},
    ErrorName{gen5::AxisError::encoder_failed, "encoder_failed"},
    ErrorName{gen5::AxisError::controller_failed, "controller_failed"},
    ErrorName{gen5::AxisError::watchdog_timer_expired, "watchdog_timer_expired"},
    ErrorName{gen5::AxisError::min_endstop_pressed, "min_endstop_pressed"},
    ErrorName{gen5::AxisError::max_endstop_pressed, "max_endstop_pressed"},
    ErrorName{gen5::AxisError::estop_requested, "estop_requested"},
    ErrorName{gen5::AxisError::homing_without_endstop, "homing_without_endstop"},
    ErrorName{gen5::AxisError::over_temp, "over_temp"},
    ErrorName{gen5::AxisError::unknown_position, "unknown_position"},
};

constexpr std::array kErrors6{
    ErrorName{gen6::AxisError::initializing, "initializing"},
    ErrorName{gen6::AxisError::system_level, "system_level"},
    ErrorName{gen6::AxisError::timing_error, "timing_error"},
    ErrorName{gen6::AxisError::missing_estimate, "missing_estimate"},
    ErrorName{gen6::AxisError::bad_config, "bad_config"},
    ErrorName{gen6::AxisError::drv_fault, "drv_fault"},
    ErrorName{gen6::AxisError::missing_input, "missing_input"},
    ErrorName{gen6::AxisError::dc_bus_over_voltage, "dc_bus_over_voltage"},
    ErrorName{gen6::AxisError::dc_bus_under_voltage, "dc_bus_under_voltage"},
    ErrorName{gen6::AxisError::dc_bus_over_current, "dc_bus_over_current"},
    ErrorName{gen6::AxisError::dc_bus_over_regen_current, "dc_bus_over_regen_current"},
    ErrorName{gen6::AxisError::current_limit_violation, "current_limit_violation"},
    ErrorName{gen6::AxisError::motor_over_temp, "motor_over_temp"},
    ErrorName{gen6::AxisError::inverter_over_temp, "inverter_over_temp"},
    ErrorName{gen6::AxisError::velocity_limit_violation, "velocity_limit_violation"},
    ErrorName{gen6::AxisError::position_limit_violation, "position_limit_violation"},
    ErrorName{gen6::AxisError::watchdog_timer_expired, "watchdog_timer_expired"},
    ErrorName{gen6::AxisError::estop_requested, "estop_requested"},
    ErrorName{gen6::AxisError::spinout_detected, "spinout_detected"},
    ErrorName{gen6::AxisError::brake_resistor_disarmed, "brake_resistor_disarmed"},
    ErrorName{gen6::AxisError::thermistor_disconnected, "thermistor_disconnected"},
    ErrorName{gen6::AxisError::calibration_error, "calibration_error"},
};

template <std::size_t n>
constexpr std::string_view name_of(const std::array<ErrorName, n>& names, std::uint32_t bit) {
    for (const ErrorName& each : names) {
        if (each.bit == bit) return each.name;
    }
    return "unknown";
}

std::int64_t to_ns(double seconds) { return std::llround(seconds * 1e9); }

}  // namespace

std::string_view odrive_error_name(OdriveGeneration generation, std::uint32_t bit) {
    return generation == OdriveGeneration::v0_5 ? name_of(kErrors5, bit) : name_of(kErrors6, bit);
}

OdriveConfig odrive_config(const model::RobotParameters& parameters, Wheel wheel) {
    const auto& drive = parameters.drive;
    const model::DriveParameters& mine = wheel == Wheel::left ? drive.left : drive.right;
    OdriveConfig c;
    c.generation = drive.generation == 5 ? OdriveGeneration::v0_5 : OdriveGeneration::v0_6;
    c.node = static_cast<std::uint32_t>(mine.node);
    c.sign = mine.sign < 0 ? -1 : 1;
    c.gear_ratio = mine.gear_ratio;
    c.torque_constant_Nm_per_A = mine.torque_constant_Nm_per_A;
    c.torque_scale = mine.torque_scale;
    c.heartbeat_period_s = drive.heartbeat_period_ms * 1e-3;
    c.encoder_period_s = drive.encoder_period_ms * 1e-3;
    c.torque_period_s = drive.torque_period_ms * 1e-3;
    c.supply_period_s = drive.supply_period_ms * 1e-3;
    c.temperature_period_s = drive.temperature_period_ms * 1e-3;
    c.heartbeat_timeout_s = drive.heartbeat_timeout_s;
    c.arming_timeout_s = drive.arming_timeout_s;
    c.watchdog_assured = drive.watchdog_assured;
    c.watchdog_timeout_s = drive.watchdog_timeout_s;
    c.torque_limit_Nm = parameters.limits.torque_Nm;
    c.watchdog_endpoint = static_cast<std::uint16_t>(drive.watchdog_endpoint);
    c.watchdog_timeout_endpoint = static_cast<std::uint16_t>(drive.watchdog_timeout_endpoint);
    c.control_mode_endpoint = static_cast<std::uint16_t>(drive.control_mode_endpoint);
    c.input_mode_endpoint = static_cast<std::uint16_t>(drive.input_mode_endpoint);
    return c;
}

// The arming sequence.
const std::array<OdriveDrive::Step, 8> OdriveDrive::kArming{{
    {&OdriveDrive::is_not_idle, &OdriveDrive::send_idle, Wait::idle, false},
    {&OdriveDrive::watchdog_counts_while_idle, &OdriveDrive::send_zero_torque, Wait::fresh_heartbeats, true},
    {&OdriveDrive::reports_error, &OdriveDrive::send_clear_errors, Wait::next_cycle, false},
    {nullptr, &OdriveDrive::send_torque_mode, Wait::next_cycle, false},
    {nullptr, &OdriveDrive::send_zero_torque, Wait::next_cycle, true},
    {&OdriveDrive::can_ask_anything, &OdriveDrive::send_question, Wait::answers, true},
    {&OdriveDrive::cannot_ask_mode, &OdriveDrive::send_torque_mode, Wait::next_cycle, true},
    {nullptr, &OdriveDrive::send_closed_loop, Wait::closed_loop, true},
}};

const std::array<OdriveDrive::Question, 4> OdriveDrive::kQuestions{{
    {&OdriveConfig::watchdog_endpoint,
     [](const OdriveConfig&, std::uint32_t value) { return (value & 0xFFU) != 0; }, false},
    {&OdriveConfig::watchdog_timeout_endpoint,
     [](const OdriveConfig& config, std::uint32_t value) {
         const auto timeout_s = double{std::bit_cast<float>(value)};
         return timeout_s > 0 && timeout_s <= config.watchdog_timeout_s * (1 + 1e-6);  // as a float rounds
     },
     false},
    {&OdriveConfig::control_mode_endpoint,
     [](const OdriveConfig&, std::uint32_t value) {
         return (value & 0xFFU) == static_cast<std::uint32_t>(gen6::ControlMode::torque);
     },
     true},
    {&OdriveConfig::input_mode_endpoint,
     [](const OdriveConfig&, std::uint32_t value) {
         return (value & 0xFFU) == static_cast<std::uint32_t>(gen6::InputMode::passthrough);
     },
     true},
}};

OdriveDrive::OdriveDrive(const OdriveConfig& config)
    : config_(config),
      wheel_rad_per_rev_(config.sign * kTwoPi / config.gear_ratio),
      heartbeat_timeout_ns_(to_ns(config.heartbeat_timeout_s)),
      arming_timeout_ns_(to_ns(config.arming_timeout_s)),
      away_ns_(to_ns(std::max(kStarts_s, kLongGap * config.encoder_period_s))) {
    set_scales();
    add_frame(gen6::Heartbeat::name, gen6::Heartbeat::command, false, config.heartbeat_period_s);
    add_frame(gen6::GetEncoderEstimates::name, gen6::GetEncoderEstimates::command, false,
              config.encoder_period_s);
    if (config.torque_period_s > 0) {
        if (config.generation == OdriveGeneration::v0_5) {
            add_frame(gen5::GetIq::name, gen5::GetIq::command, false, config.torque_period_s);
        } else {
            add_frame(gen6::GetTorques::name, gen6::GetTorques::command, false, config.torque_period_s);
        }
    }
    if (config.supply_period_s > 0) {
        add_frame(gen6::GetBusVoltageCurrent::name, gen6::GetBusVoltageCurrent::command, false,
                  config.supply_period_s);
    }
    if (config.temperature_period_s > 0 && config.generation == OdriveGeneration::v0_6) {
        add_frame(gen6::GetTemperature::name, gen6::GetTemperature::command, false,
                  config.temperature_period_s);
    }
    add_frame(gen6::SetInputTorque::name, gen6::SetInputTorque::command, true, config.cycle_period_s);
}

void OdriveDrive::add_frame(std::string_view name, std::uint32_t command, bool to_drive, double period_s) {
    if (frame_count_ == kMostFrames) return;
    frames_[frame_count_++] = {name, config_.node << 5U | command, 8, false, to_drive, period_s};
}

void OdriveDrive::set_scales() {
    wheel_per_motor_torque_ = config_.sign * config_.gear_ratio * config_.torque_scale;
    motor_per_wheel_torque_ = 1 / wheel_per_motor_torque_;
}

void OdriveDrive::set_torque_scale(double scale) {
    config_.torque_scale = scale;
    set_scales();
}

// --- received frames
// -------------------------------------------------------------------------------------------

template <typename Message>
bool OdriveDrive::decode(const hal::CanFrame& frame, Message& message) {
    switch (Message::decode({frame.data.data(), frame.length}, message)) {
        case protocol::CodecStatus::ok:
            return true;
        case protocol::CodecStatus::not_finite:
            ++counters_.not_finite;
            return false;
        default:
            ++counters_.wrong_length;
            return false;
    }
}

bool OdriveDrive::accept(const hal::ReceivedFrame& received) {
    const hal::CanFrame& frame = received.frame;
    if (frame.extended || frame.error || frame.fd || frame.id >> 5U != config_.node) return false;
    if (frame.remote) {  // only hosts send these
        ++counters_.foreign_commands;
        asked_by_others_ = true;
        return true;
    }
    switch (frame.id & 0x1FU) {
        case gen6::Heartbeat::command:
            take_heartbeat(frame, received.timestamp_ns);
            break;
        case gen6::GetError::command: {
            // In 0.5 the answer to somebody's question.
            gen6::GetError errors;
            if (config_.generation == OdriveGeneration::v0_6 && decode(frame, errors)) {
                told_error_ = errors.active_errors | errors.disarm_reason;
                note_errors();
            }
            break;
        }
        case gen6::GetEncoderEstimates::command: {
            gen6::GetEncoderEstimates estimates;
            if (!decode(frame, estimates)) break;
            take_position(double{estimates.pos_estimate_rev}, double{estimates.vel_estimate_rev_per_s},
                          received.timestamp_ns);
            break;
        }
        case gen6::GetIq::command: {
            gen6::GetIq iq;
            if (!decode(frame, iq)) break;
            feedback_.torque_Nm =
                double{iq.iq_measured_A} * config_.torque_constant_Nm_per_A * wheel_per_motor_torque_;
            feedback_.torque_time_ns = received.timestamp_ns;
            judge_torque(double{iq.iq_setpoint_A} * config_.torque_constant_Nm_per_A);
            break;
        }
        case gen6::GetTorques::command: {
            if (config_.generation != OdriveGeneration::v0_6) {
                // In 0.5 this number is the answer to a question, and never comes by itself.
                if (!asked_by_others_) take_evidence(true);
                break;
            }
            gen6::GetTorques torques;
            if (!decode(frame, torques)) break;
            feedback_.torque_Nm = double{torques.torque_estimate_Nm} * wheel_per_motor_torque_;
            feedback_.torque_time_ns = received.timestamp_ns;
            judge_torque(double{torques.torque_target_Nm});
            break;
        }
        case gen6::GetBusVoltageCurrent::command: {
            gen6::GetBusVoltageCurrent supply;
            if (!decode(frame, supply)) break;
            feedback_.bus_voltage_V = double{supply.bus_voltage_V};
            feedback_.supply_time_ns = received.timestamp_ns;
            break;
        }
        case gen6::GetTemperature::command:
            // In 0.5 the sensorless estimates: such a drive tells heat by its error over_temp alone.
            if (config_.generation == OdriveGeneration::v0_6) take_temperatures(frame, received.timestamp_ns);
            break;
        case gen6::TxSdo::command: {
            if (config_.generation != OdriveGeneration::v0_6) break;
            gen6::TxSdo answer;
            if (!decode(frame, answer)) break;
            take_answer(answer.endpoint_id, answer.value);
            return true;
        }
        case gen6::SetAxisState::command:
        case gen6::SetControllerMode::command:
        case kSetInputPosition:
        case gen6::SetInputVel::command:
        case gen6::SetInputTorque::command:
        case gen6::SetLimits::command:
        case gen6::ClearErrors::command:
        case gen6::SetAbsolutePosition::command:
            take_foreign(frame, received.timestamp_ns);
            return true;
        default:
            return true;
    }
    // At its first report, whatever that tells.
    if (received.timestamp_ns > gone_after_ns_) take_return(false);
    return true;
}

// A motor without a thermistor is told as no number.
void OdriveDrive::take_temperatures(const hal::CanFrame& frame, std::int64_t time_ns) {
    if (frame.length != gen6::GetTemperature::length) {
        ++counters_.wrong_length;
        return;
    }
    std::array<float, 2> told_degC{};
    std::memcpy(told_degC.data(), frame.data.data(), sizeof told_degC);
    const auto measured = [](float told) {
        return std::isfinite(told) ? double{told} : std::numeric_limits<double>::quiet_NaN();
    };
    feedback_.inverter_temperature_degC = measured(told_degC[0]);
    feedback_.motor_temperature_degC = measured(told_degC[1]);
    feedback_.temperature_time_ns = time_ns;
}

void OdriveDrive::take_position(double position_rev, double speed_rev_per_s, std::int64_t time_ns) {
    const double before = position_rev_;
    if (feedback_.encoder_time_ns != 0) {
        const double since_s = 1e-9 * static_cast<double>(time_ns - feedback_.encoder_time_ns);
        const bool anew = begins_anew(position_rev, speed_rev_per_s, time_ns);
        if (anew) origin_rev_ += before + speed_rev_per_s_ * since_s - position_rev;
        if (anew || time_ns > gone_after_ns_) take_return(anew);
    }
    gone_after_ns_ = time_ns + away_ns_;
    position_rev_ = position_rev;
    speed_rev_per_s_ = speed_rev_per_s;
    if (std::abs(position_rev) > kLargestPosition_rev &&
        std::abs(position_rev - before) < kLargestPosition_rev / 2) {
        far_frames_ = std::min(far_frames_ + 1, kFarFrames);
        last_far_rev_ = position_rev;
        last_far_ns_ = time_ns;
    } else if (std::abs(position_rev) < kLargestPosition_rev / 2) {
        // From far away at once: one that comes back by itself has not followed.
        const bool leapt = std::abs(position_rev - before) > kLargestPosition_rev / 4;
        if (told_to_count_anew_ > 0 && leapt) {
            const double since_s = 1e-9 * static_cast<double>(time_ns - last_far_ns_);
            origin_rev_ += last_far_rev_ + speed_rev_per_s * since_s - position_rev;
        }
        told_to_count_anew_ = 0;
        far_frames_ = 0;
    }
    feedback_.position_rad = (origin_rev_ + position_rev) * wheel_rad_per_rev_;
    feedback_.speed_rad_per_s = speed_rev_per_s * wheel_rad_per_rev_;
    feedback_.encoder_time_ns = time_ns;
}

// After a gap: whether the drive is in its first turn, in which it begins to count, and cannot have gone
// there from where it was. At twice its speed it may; and a wheel that turned does not stop dead at exactly
// 0.
bool OdriveDrive::begins_anew(double position_rev, double speed_rev_per_s, std::int64_t time_ns) const {
    constexpr double kStops_s = 0.1;  // from a speed that covers the coarsest step in this time
    const double since_s = 1e-9 * static_cast<double>(time_ns - feedback_.encoder_time_ns);
    if (since_s <= kGap * config_.encoder_period_s || told_to_count_anew_ > 0) return false;
    if (std::abs(position_rev) > 1) return false;
    const double step_rev = kCoarsestStep_turns * config_.gear_ratio;
    const double expected_rev = speed_rev_per_s_ * since_s;
    const double off_rev = std::abs(position_rev - position_rev_ - expected_rev);
    const bool stopped_dead = position_rev == 0 && speed_rev_per_s == 0;
    return off_rev > std::abs(expected_rev) + step_rev ||
           (stopped_dead && std::abs(speed_rev_per_s_) * kStops_s > step_rev);
}

void OdriveDrive::take_return(bool anew) {
    gone_after_ns_ = kNever_ns;
    if (phase_ == Phase::resting) {
        to_idle_ = true;
        idle_sent_ = false;
        to_idle_since_ns_ = now_ns_;
    } else if (anew && phase_ == Phase::armed) {
        fail(DriveFault::left_armed);
    } else if (anew) {
        end_arming(ArmRefusal::silent);
    }
}

void OdriveDrive::was_sent(const hal::CanFrame& frame) {
    static_assert(gen5::SetLinearCount::command == gen6::SetAbsolutePosition::command);
    // near its origin an order to count anew is somebody else's, and no matter of the count
    if (far_frames_ > 0 && frame.id == (config_.node << 5U | gen6::SetAbsolutePosition::command))
        ++told_to_count_anew_;
}

void OdriveDrive::count_anew(FrameSink& out) {
    constexpr int kTimes = 3;
    constexpr std::int64_t kPatience_ns = 100'000'000;
    const bool waits = told_to_count_anew_ > 0 && now_ns_ - told_to_count_anew_ns_ < kPatience_ns;
    if (waits || told_to_count_anew_ >= kTimes) return;
    ++told_to_count_anew_;
    told_to_count_anew_ns_ = now_ns_;
    if (config_.generation == OdriveGeneration::v0_5) {
        send(gen5::SetLinearCount{}, out);
    } else {
        send(gen6::SetAbsolutePosition{}, out);
    }
}

void OdriveDrive::take_foreign(const hal::CanFrame& frame, std::int64_t time_ns) {
    ++counters_.foreign_commands;
    switch (frame.id & 0x1FU) {
        case gen6::SetAxisState::command:
            if (frame.length >= 1 && frame.data[0] == static_cast<std::uint8_t>(kIdle)) break;
            ++counters_.foreign_control;
            others_insist_ = phase_ != Phase::resting ||
                             (armed_by_others_ns_ != 0 && time_ns - armed_by_others_ns_ < kInsists_ns);
            armed_by_others_ns_ = time_ns;
            break;
        case gen6::SetControllerMode::command:
        case kSetInputPosition:
        case gen6::SetInputVel::command:
        case gen6::SetInputTorque::command:
            ++counters_.foreign_control;
            break;
        default:
            break;
    }
}

// What the other generation's heartbeats have and the configured one's cannot have. Not every heartbeat
// tells: an idle drive's first five bytes mean the same in both.
bool OdriveDrive::is_of_other_generation(const hal::CanFrame& heartbeat) const {
    constexpr std::uint8_t kFlag = 1;
    if (config_.generation == OdriveGeneration::v0_5) {
        // 0.6: the highest error bits, such as that of an expired watchdog; results of calibrations as a
        // number.
        return heartbeat.data[3] != 0 || heartbeat.data[5] > kFlag;
    }
    return heartbeat.data[7] != 0;  // 0.5: "trajectory done", set from power-on in torque control
}

void OdriveDrive::take_heartbeat(const hal::CanFrame& frame, std::int64_t time_ns) {
    if (config_.generation == OdriveGeneration::v0_5) {
        gen5::Heartbeat heartbeat;
        if (!decode(frame, heartbeat)) return;
        using gen5::AxisError;
        heartbeat_error_ = heartbeat.axis_error | (heartbeat.motor_error_flag ? AxisError::motor_failed : 0) |
                           (heartbeat.encoder_error_flag ? AxisError::encoder_failed : 0) |
                           (heartbeat.controller_error_flag ? AxisError::controller_failed : 0);
        axis_state_ = static_cast<std::uint32_t>(heartbeat.axis_state);
    } else {
        gen6::Heartbeat heartbeat;
        if (!decode(frame, heartbeat)) return;
        heartbeat_error_ = heartbeat.axis_error;
        axis_state_ = static_cast<std::uint32_t>(heartbeat.axis_state);
    }
    note_errors();
    take_evidence(is_of_other_generation(frame));
    feedback_.heartbeat_time_ns = time_ns;
    silent_ = false;
    judge_heartbeat(time_ns);
}

// One frame alone, which anybody may have sent, is no evidence; and what a drive really sends comes again.
void OdriveDrive::take_evidence(bool of_other_generation) {
    const int step = of_other_generation ? kStrange : -1;
    other_generation_ = std::clamp(other_generation_ + step, 0, kMostStrange);
}

void OdriveDrive::note_errors() { feedback_.error_bits = heartbeat_error_ | told_error_; }

void OdriveDrive::judge_heartbeat(std::int64_t time_ns) {
    const bool has_error = heartbeat_error_ != 0;
    if (phase_ == Phase::armed) {
        if (has_error) {
            fail(DriveFault::error);
        } else if (axis_state_ != kClosedLoop) {
            fail(DriveFault::left_armed);
        }
        return;
    }
    if (phase_ == Phase::arming) {
        if (has_idle_error() && kArming[step_].wait != Wait::closed_loop) end_arming(ArmRefusal::drive_error);
        if (kArming[step_].wait != Wait::closed_loop || !step_sent_ || time_ns <= step_since_ns_) return;
        if (has_error) {
            if (time_ns > step_since_ns_ + kSettle_ns) end_arming(ArmRefusal::drive_error);
        } else if (axis_state_ == kClosedLoop) {
            phase_ = Phase::armed;
            asked_ = {};
            wrong_torques_ = 0;
        }
        return;
    }
    if (to_idle_ && idle_sent_ && time_ns > idle_sent_ns_ && axis_state_ != kClosedLoop) to_idle_ = false;
    if (clearing_ && time_ns > cleared_ns_ + kSettle_ns) {
        clearing_ = false;
        if (!has_idle_error()) fault_ = DriveFault::none;
    }
    if (!to_idle_ && axis_state_ == kClosedLoop) {
        ++counters_.foreign_control;
        fail(DriveFault::armed_unasked);
    }
}

// --- the cycle
// -------------------------------------------------------------------------------------------------

void OdriveDrive::update(std::int64_t now_ns, FrameSink& out) {
    now_ns_ = now_ns;
    silent_ = is_silent(now_ns);
    if (silent_) {
        if (phase_ == Phase::armed) fail(DriveFault::silent);
        if (phase_ == Phase::arming) {
            end_arming(ArmRefusal::silent);
            fault_ = DriveFault::silent;
        }
    }
    if (others_insist_) send_estop(out);
    take_requests(out);
    if (phase_ == Phase::arming) run_arming(out);
    if (phase_ == Phase::resting && to_idle_) run_to_idle(out);
    if (far_frames_ >= kFarFrames && phase_ != Phase::arming && !silent_) count_anew(out);
}

bool OdriveDrive::is_silent(std::int64_t now_ns) const {
    return feedback_.heartbeat_time_ns == 0 || now_ns - feedback_.heartbeat_time_ns > heartbeat_timeout_ns_;
}

void OdriveDrive::take_requests(FrameSink& out) {
    const bool arm = arm_requested_;
    const bool disarm = disarm_requested_;
    const bool clear = clear_requested_;
    arm_requested_ = disarm_requested_ = clear_requested_ = false;
    if (disarm || clear) {
        if (phase_ != Phase::resting || axis_state_ == kClosedLoop) {
            phase_ = Phase::resting;
            to_idle_ = true;
            idle_sent_ = false;
            to_idle_since_ns_ = now_ns_;
        } else if (disarm) {
            send_idle(out);  // somebody may have armed it since it was last told
        }
        if (clear) {
            send_clear_errors(out);
            clearing_ = true;
            cleared_ns_ = now_ns_;
        }
        arm_requested_ = arm && !disarm;  // stopping wins over arming, clearing comes before it
        return;
    }
    if (!arm || phase_ != Phase::resting) return;
    refusal_ = ArmRefusal::none;
    // Until a heartbeat tells what is left, or of which generation it is.
    const bool waits = clearing_ || (other_generation_ > 0 && other_generation_ < kSurelyOther && !silent_);
    arm_requested_ = waits;
    if (!waits) begin_arming();
}

void OdriveDrive::begin_arming() {
    if (silent_) {
        refusal_ = ArmRefusal::silent;
        return;
    }
    if (other_generation_ >= kSurelyOther) {
        refusal_ = ArmRefusal::other_generation;
        return;
    }
    if (has_idle_error()) {
        refusal_ = ArmRefusal::drive_error;
        return;
    }
    if (!config_.watchdog_assured && !can_ask(&OdriveConfig::watchdog_endpoint)) {
        refusal_ = ArmRefusal::watchdog_not_confirmed;
        return;
    }
    phase_ = Phase::arming;
    fault_ = DriveFault::none;
    to_idle_ = false;
    step_ = 0;
    step_sent_ = false;
    feeding_ = false;
    question_ = 0;
    wrong_answer_ = false;
    next_question();
    arming_since_ns_ = now_ns_;
}

// At most one step in a cycle.
void OdriveDrive::run_arming(FrameSink& out) {
    if (now_ns_ - arming_since_ns_ > arming_timeout_ns_) {
        const bool unanswered = kArming[step_].wait == Wait::answers && can_ask_anything();
        end_arming(!unanswered                     ? ArmRefusal::timed_out
                   : kQuestions[question_].is_mode ? ArmRefusal::mode_not_confirmed
                                                   : ArmRefusal::watchdog_not_confirmed);
        return;
    }
    if (wrong_answer_ && !kQuestions[question_].is_mode) {
        end_arming(ArmRefusal::watchdog_not_confirmed);
        return;
    }
    if (step_sent_ && step_is_done()) {
        ++step_;
        step_sent_ = false;
    }
    if (!step_sent_) {
        while (kArming[step_].applies != nullptr && !(this->*kArming[step_].applies)()) ++step_;
        (this->*kArming[step_].send)(out);
        step_sent_ = true;
        step_since_ns_ = now_ns_;
        const bool sent_torque = kArming[step_].send == &OdriveDrive::send_zero_torque;
        if (feeding_ && !sent_torque) send_zero_torque(out);
        feeding_ = kArming[step_].feed;
        return;
    }
    if (kArming[step_].wait == Wait::answers && (asked_ns_ == 0 || now_ns_ - asked_ns_ > kAskAgain_ns)) {
        if (wrong_answer_) send_torque_mode(out);
        send_question(out);
    }
    // A drive that says 50 ms later that it is idle has not heard it.
    const bool unheard = kArming[step_].wait == Wait::closed_loop && axis_state_ == kIdle &&
                         feedback_.heartbeat_time_ns > step_since_ns_ + kIdleAgain_ns;
    if (unheard) step_sent_ = false;  // once more in the next cycle
    if (feeding_) send_zero_torque(out);
}

bool OdriveDrive::step_is_done() const {
    switch (kArming[step_].wait) {
        case Wait::next_cycle:
            return true;
        case Wait::idle:
            return feedback_.heartbeat_time_ns > step_since_ns_ && axis_state_ == kIdle;
        case Wait::fresh_heartbeats:
            return feedback_.heartbeat_time_ns > step_since_ns_ + kSettle_ns &&
                   now_ns_ > step_since_ns_ + std::min(heartbeat_timeout_ns_, arming_timeout_ns_ / 2);
        case Wait::answers:
            return question_ == kQuestions.size();
        case Wait::closed_loop:
            return false;  // the heartbeat itself ends the arming
    }
    return false;
}

void OdriveDrive::end_arming(ArmRefusal why) {
    refusal_ = why;
    phase_ = Phase::resting;
    // The request for closed loop may be obeyed yet.
    to_idle_ = kArming[step_].wait == Wait::closed_loop || axis_state_ == kClosedLoop;
    idle_sent_ = false;
    to_idle_since_ns_ = now_ns_;
}

void OdriveDrive::fail(DriveFault why) {
    fault_ = why;
    phase_ = Phase::resting;
    to_idle_ = true;
    idle_sent_ = false;
    to_idle_since_ns_ = now_ns_;
}

void OdriveDrive::run_to_idle(FrameSink& out) {
    if (!idle_sent_) {
        send_zero_torque(out);  // in case the next frame is lost
        send_idle(out);
        return;
    }
    if (silent_) return;  // its watchdog must do it; polling would only feed that
    if (now_ns_ - to_idle_since_ns_ > arming_timeout_ns_) {
        if (fault_ == DriveFault::none) fault_ = DriveFault::disarm_failed;
    }
    if (now_ns_ - idle_sent_ns_ > kIdleAgain_ns && feedback_.heartbeat_time_ns > idle_sent_ns_)
        send_idle(out);
}

bool OdriveDrive::refused(const hal::CanFrame& frame) {
    if (frame.id >> 5U != config_.node) return false;
    if (phase_ == Phase::arming) {
        step_sent_ = false;
    } else if (phase_ == Phase::resting && (frame.id & 0x1FU) == gen6::SetAxisState::command) {
        to_idle_ = true;
        idle_sent_ = false;
    } else if ((frame.id & 0x1FU) == gen6::ClearErrors::command) {
        clear_requested_ = true;
    }
    return true;
}

void OdriveDrive::command_torque(double torque_Nm, FrameSink& out) {
    if (phase_ != Phase::armed) return;
    double motor_Nm = torque_Nm * motor_per_wheel_torque_;
    if (!std::isfinite(static_cast<float>(motor_Nm))) {
        ++counters_.command_not_finite;
        motor_Nm = 0;
    }
    Asked& now = asked_[0];
    const double size_Nm = std::abs(motor_Nm);
    now.most_Nm = std::max(now.most_Nm, size_Nm);
    now.least_Nm = now.any ? std::min(now.least_Nm, size_Nm) : size_Nm;
    now.any = true;
    send_motor_torque(motor_Nm, out);
}

// Against all that was asked since the report before the last one: some of it has not been obeyed by this
// report. A drive that has stopped gives less, and says why in its next heartbeat: that is waited for.
void OdriveDrive::judge_torque(double motor_torque_Nm) {
    if (phase_ != Phase::armed) return;
    const Asked now = asked_[0];
    const Asked before = asked_[1];
    asked_ = {Asked{}, now};
    if (!now.any || !before.any) return;
    const double slack_Nm = std::abs(kTorqueSlack * config_.torque_limit_Nm * motor_per_wheel_torque_);
    const double size_Nm = std::abs(motor_torque_Nm);
    const bool more = size_Nm > 2 * std::max(now.most_Nm, before.most_Nm) + slack_Nm;
    const bool less = std::min(now.least_Nm, before.least_Nm) > 2 * slack_Nm && size_Nm < slack_Nm;
    if (wrong_torques_ == 0) wrong_since_ns_ = now_ns_;
    wrong_torques_ = more || less ? wrong_torques_ + 1 : 0;
    const bool goes_on = more || feedback_.heartbeat_time_ns > wrong_since_ns_;
    if (wrong_torques_ >= kWrongTorques && goes_on) fail(DriveFault::torque_not_followed);
}

// --- state
// -----------------------------------------------------------------------------------------------------

DriveState OdriveDrive::state() const {
    if (silent_) return DriveState::silent;
    if (phase_ == Phase::armed) return DriveState::armed;
    if (phase_ == Phase::arming) return DriveState::arming;
    if (other_generation_ >= kSurelyOther) return DriveState::other_generation;
    if (clearing_) return DriveState::arming;
    if (fault_ != DriveFault::none || has_idle_error()) return DriveState::fault;
    if (to_idle_) return DriveState::arming;
    return DriveState::idle;
}

DriveFault OdriveDrive::fault() const {
    if (fault_ != DriveFault::none) return fault_;
    return phase_ == Phase::resting && has_idle_error() ? DriveFault::error : DriveFault::none;
}

bool OdriveDrive::has_idle_error() const {
    const std::uint32_t watchdog = config_.generation == OdriveGeneration::v0_5
                                       ? gen5::AxisError::watchdog_timer_expired
                                       : gen6::AxisError::watchdog_timer_expired;
    return (feedback_.error_bits & ~watchdog) != 0;
}

bool OdriveDrive::is_not_idle() const { return axis_state_ != kIdle; }

bool OdriveDrive::can_ask(std::uint16_t OdriveConfig::*endpoint) const {
    return config_.generation == OdriveGeneration::v0_6 && config_.*endpoint != 0;
}

bool OdriveDrive::can_ask_anything() const { return question_ < kQuestions.size(); }

bool OdriveDrive::cannot_ask_mode() const { return !can_ask(&OdriveConfig::control_mode_endpoint); }

// Leaves out what cannot be asked.
void OdriveDrive::next_question() {
    while (question_ < kQuestions.size() && !can_ask(kQuestions[question_].endpoint)) ++question_;
    asked_ns_ = 0;
}

void OdriveDrive::take_answer(std::uint16_t endpoint, std::uint32_t value) {
    if (phase_ != Phase::arming || asked_ns_ == 0 || question_ == kQuestions.size()) return;
    const Question& question = kQuestions[question_];
    if (endpoint != config_.*question.endpoint) return;
    wrong_answer_ = !question.right(config_, value);
    if (wrong_answer_) return;
    ++question_;
    next_question();
}

// --- frames to the drive
// ---------------------------------------------------------------------------------------

template <typename Message>
void OdriveDrive::send(const Message& message, FrameSink& out) const {
    hal::CanFrame frame;
    frame.id = config_.node << 5U | Message::command;
    frame.length = Message::length;
    if (message.encode(frame.data) == protocol::CodecStatus::ok) out.push(frame);
}

void OdriveDrive::push_idle(FrameSink& out) const {
    send_motor_torque(0, out);  // in case the next frame is lost
    gen6::SetAxisState request;
    request.axis_requested_state = gen6::AxisState::idle;
    send(request, out);
}

void OdriveDrive::send_idle(FrameSink& out) {
    gen6::SetAxisState request;
    request.axis_requested_state = gen6::AxisState::idle;
    send(request, out);
    idle_sent_ = true;
    idle_sent_ns_ = now_ns_;
}

// Of a drive's identifiers only the heartbeat's goes first: it leaves on a bus that somebody floods.
void OdriveDrive::send_estop(FrameSink& out) {
    send(gen6::Estop{}, out);
    others_insist_ = false;
}

void OdriveDrive::send_clear_errors(FrameSink& out) {
    told_error_ = 0;
    if (config_.generation == OdriveGeneration::v0_5) {
        send(gen5::ClearErrors{}, out);
    } else {
        send(gen6::ClearErrors{}, out);
    }
}

void OdriveDrive::send_torque_mode(FrameSink& out) {
    gen6::SetControllerMode mode;
    mode.control_mode = gen6::ControlMode::torque;
    mode.input_mode = gen6::InputMode::passthrough;
    send(mode, out);
}

void OdriveDrive::send_zero_torque(FrameSink& out) { send_motor_torque(0, out); }

void OdriveDrive::send_motor_torque(double motor_torque_Nm, FrameSink& out) const {
    gen6::SetInputTorque torque;
    torque.input_torque_Nm = static_cast<float>(motor_torque_Nm);
    send(torque, out);
}

void OdriveDrive::send_question(FrameSink& out) {
    gen6::RxSdo question;
    question.opcode = gen6::SdoOpcode::read;
    question.endpoint_id = config_.*kQuestions[question_].endpoint;
    send(question, out);
    asked_ns_ = now_ns_;
    wrong_answer_ = false;
}

void OdriveDrive::send_closed_loop(FrameSink& out) {
    gen6::SetAxisState request;
    request.axis_requested_state = gen6::AxisState::closed_loop_control;
    send(request, out);
}

}  // namespace wheelwright::drivers
