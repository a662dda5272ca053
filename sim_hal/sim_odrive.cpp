#include "sim_hal/sim_odrive.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "drivers/odrive/odrive_0_5_messages.hpp"
#include "drivers/odrive/odrive_0_6_messages.hpp"
#include "sim_hal/plain_math.hpp"

namespace wheelwright::sim {
namespace {

namespace gen5 = drivers::odrive_0_5;
namespace gen6 = drivers::odrive_0_6;

constexpr std::uint32_t kTorqueControl = 1;
constexpr std::uint32_t kPositionControl = 3;
// The factory's gains of ODrive 0.5 and 0.6: pos_gain, vel_gain, vel_integrator_gain.
constexpr double kHoldPosition_per_s = 20;
constexpr double kHoldVelocity_Nm_s_per_rev = 1.0 / 6;
constexpr double kHoldIntegral_Nm_per_rev = 1.0 / 3;
constexpr std::uint32_t kPassthrough = 1;
constexpr std::uint32_t kTorqueRamp = 6;
constexpr double kTwoPi = 6.283185307179586;

double floor_of(double x) {  // of numbers below 2^63
    const auto whole = static_cast<double>(static_cast<std::int64_t>(x));
    return whole > x ? whole - 1 : whole;
}

// Where in its period a message of `period` ms is sent.
std::uint32_t random_phase(Random& random, std::int32_t period) {
    return period > 0 ? static_cast<std::uint32_t>(random.bits() % static_cast<std::uint32_t>(period)) : 0;
}

bool is_due(std::uint32_t tick, std::int32_t period, std::uint32_t phase) {
    return period > 0 && tick % static_cast<std::uint32_t>(period) == phase;
}

std::int64_t to_ns(double seconds) { return std::llround(seconds * 1e9); }

}  // namespace

SimOdrive::SimOdrive(const SimOdriveConfig& config, std::int64_t start_ns)
    : config_(config), random_(config.seed, config.stream) {
    ideal_encoder_ = config.counts_per_turn <= 0;
    command_latency_ns_ = to_ns(config.command_latency_s);
    plain_report_ = config.report_counts_per_wheel_turn <= 0 && config.report_lag_s <= 0;
    watchdog_timeout_ns_ = static_cast<std::int64_t>(1e9 * config_.watchdog_timeout_s);
    if (ideal_encoder_) config_.counts_per_turn = 1;
    counts_per_rad_ = config.sign * config.gear_ratio * config_.counts_per_turn / kTwoPi;
    // A 16-bit uniform number has the standard deviation sqrt((65536^2 - 1) / 12).
    noise_step_ = config.encoder_noise_rad * std::abs(counts_per_rad_) / 18918.613618860346;
    wheel_per_motor_torque_ = config.sign * config.gear_ratio * config.torque_scale;
    period_ps_ = 1'000'000'000 + static_cast<std::int64_t>(config.clock_error_ppm * 1000);
    tick_ns_ = start_ns + config.phase_ns;
    fed_ns_ = start_ns;
    kp_ = 2 * config.filter_bandwidth_rad_per_s * kReadingPeriod_s;
    ki_ = config.filter_bandwidth_rad_per_s * config.filter_bandwidth_rad_per_s * kReadingPeriod_s;
    // An ODrive refuses such gains, which swing up; a quicker drive has the same two poles.
    if (kp_ > 1) {
        const double pole = exp_minus(config.filter_bandwidth_rad_per_s * kReadingPeriod_s);
        kp_ = 1 - pole * pole;
        ki_ = (1 - pole) * (1 - pole) / kReadingPeriod_s;
    }
    heartbeat_phase_ = random_phase(random_, config.heartbeat_period_ms);
    torque_phase_ = random_phase(random_, config.torque_period_ms);
    voltage_phase_ = random_phase(random_, config.voltage_period_ms);
    temperature_phase_ = random_phase(random_, config.temperature_period_ms);
    schedule();
}

void SimOdrive::schedule() {
    next_event_ns_ = tick_ns_;
    if (pending_count_ > 0) next_event_ns_ = std::min(next_event_ns_, pending_[pending_first_].time_ns);
}

template <typename Message>
void SimOdrive::send(const Message& message, drivers::FrameSink& out) const {
    if (faults_.mute || faults_.powered_off) return;
    hal::CanFrame frame;
    frame.id = static_cast<std::uint32_t>(config_.node) << 5U | Message::command;
    frame.length = Message::length;
    if (message.encode(frame.data) == protocol::CodecStatus::ok) out.push(frame);
}

template <typename Message>
bool SimOdrive::decode(const hal::CanFrame& frame, Message& message) {
    if (Message::decode({frame.data.data(), frame.length}, message) == protocol::CodecStatus::ok) return true;
    ++bad_frames_;
    return false;
}

void SimOdrive::receive(const hal::CanFrame& frame, std::int64_t now_ns, drivers::FrameSink& out) {
    if (frame.extended || frame.fd || frame.error) return;
    if (frame.id >> 5U != static_cast<std::uint32_t>(config_.node)) return;
    if (faults_.deaf || faults_.powered_off) return;
    if (config_.generation == 5) fed_ns_ = now_ns;
    const std::uint32_t command = frame.id & 0x1FU;
    if (frame.remote) {
        receive_request(command, out);
    } else {
        receive_command(frame, command, now_ns, out);
        retarget();
    }
}

void SimOdrive::receive_request(std::uint32_t command, drivers::FrameSink& out) const {
    const bool is_gen6 = config_.generation == 6;
    switch (command) {
        case gen6::GetVersion::command:
            if (is_gen6) {
                gen6::GetVersion version;
                version.protocol_version = 2;
                version.hw_version_major = 4;
                version.fw_version_minor = 6;
                version.fw_version_revision = 10;
                send(version, out);
            }
            break;
        case gen6::GetError::command:  // and Get_Motor_Error
            if (is_gen6) {
                gen6::GetError answer;
                answer.active_errors = error_;
                answer.disarm_reason = error_;
                send(answer, out);
            } else {
                send(gen5::GetMotorError{}, out);
            }
            break;
        case gen6::GetEncoderEstimates::command:
            send_encoder(out);
            break;
        case gen6::GetIq::command:
            send_iq(out);
            break;
        case gen6::GetTemperature::command:
            if (is_gen6) send_temperature(out);
            break;
        case gen6::GetBusVoltageCurrent::command:
            send_voltage(out);
            break;
        case gen6::GetTorques::command:
            if (is_gen6) send_torque(out);
            break;
        default:
            break;
    }
}

void SimOdrive::receive_command(const hal::CanFrame& frame, std::uint32_t command, std::int64_t now_ns,
                                drivers::FrameSink& out) {
    switch (command) {
        case gen6::Estop::command:
            raise_error(config_.generation == 5 ? 0x4000U : 0x0200'0000U);
            break;
        case gen6::RxSdo::command: {
            if (config_.generation != 6) break;
            gen6::RxSdo request;
            if (!decode(frame, request)) break;
            const auto is = [&](std::int32_t endpoint) {
                return endpoint != 0 && request.endpoint_id == endpoint;
            };
            gen6::TxSdo answer;
            answer.endpoint_id = request.endpoint_id;
            if (is(config_.watchdog_endpoint)) {
                if (request.opcode == gen6::SdoOpcode::write) {
                    config_.watchdog_enabled = (request.value & 0xFFU) != 0;
                    break;
                }
                answer.value = config_.watchdog_enabled ? 1 : 0;
            } else if (is(config_.watchdog_timeout_endpoint)) {
                answer.value = std::bit_cast<std::uint32_t>(static_cast<float>(config_.watchdog_timeout_s));
            } else if (is(config_.control_mode_endpoint)) {
                answer.value = control_mode_;
            } else if (is(config_.input_mode_endpoint)) {
                answer.value = input_mode_;
            } else {
                break;
            }
            send(answer, out);
            break;
        }
        case gen6::SetAxisState::command: {
            gen6::SetAxisState request;
            if (decode(frame, request))
                request_state(static_cast<std::uint32_t>(request.axis_requested_state), now_ns);
            break;
        }
        case gen6::SetControllerMode::command: {
            gen6::SetControllerMode request;
            if (!decode(frame, request)) break;
            control_mode_ = static_cast<std::uint32_t>(request.control_mode);
            input_mode_ = static_cast<std::uint32_t>(request.input_mode);
            if (control_mode_ == kTorqueControl) hold_Nm_ = 0;
            break;
        }
        case gen6::SetInputVel::command: {
            gen6::SetInputVel request;
            if (decode(frame, request)) fed_ns_ = now_ns;
            break;
        }
        case gen6::SetInputTorque::command: {
            gen6::SetInputTorque request;
            if (!decode(frame, request)) break;
            fed_ns_ = now_ns;
            if (pending_count_ == pending_.size()) {  // a flood: the oldest takes effect early
                input_torque_Nm_ = pending_[pending_first_].motor_torque_Nm;
                pending_first_ = (pending_first_ + 1) % pending_.size();
                --pending_count_;
            }
            pending_[(pending_first_ + pending_count_++) % pending_.size()] = {
                now_ns + command_latency_ns_, double{request.input_torque_Nm}};
            schedule();
            break;
        }
        case gen6::ClearErrors::command:
            clear_errors();
            break;
        case gen6::SetAbsolutePosition::command:
            if (faults_.keeps_its_count) break;
            if (config_.generation == 6) {
                gen6::SetAbsolutePosition request;
                if (decode(frame, request)) set_position(double{request.position_rev});
            } else {
                gen5::SetLinearCount request;
                if (decode(frame, request)) set_position(request.count / config_.counts_per_turn);
            }
            break;
        default:
            break;
    }
}

void SimOdrive::request_state(std::uint32_t state, std::int64_t now_ns) {
    fed_ns_ = now_ns;
    if (state == kIdle) {
        leave_closed_loop();
    } else if (state == kClosedLoop) {
        if (error_ == 0 && axis_state_ == kIdle && arming_done_ns_ == 0) {
            arming_done_ns_ = now_ns + to_ns(config_.arming_time_s);
        }
    } else if (config_.generation == 5) {
        raise_error(0x1);  // this motor has no other states
    }
}

void SimOdrive::leave_closed_loop() {
    axis_state_ = kIdle;
    arming_done_ns_ = 0;
    motor_torque_Nm_ = 0;
    extra_wheel_Nm_ = 0;
    retarget();
}

void SimOdrive::raise_error(std::uint32_t bits) {
    error_ |= bits;
    leave_closed_loop();
}

void SimOdrive::clear_errors() { error_ = 0; }

void SimOdrive::power_cycle() {
    leave_closed_loop();
    error_ = 0;
    control_mode_ = 3;
    input_mode_ = 1;
    input_torque_Nm_ = 0;
    pending_count_ = 0;
    fed_ns_ = tick_ns_;
    set_position(0);
    velocity_estimate_ = 0;
}

void SimOdrive::run_event(double wheel_angle_rad, double wheel_speed_rad_per_s, drivers::FrameSink& out) {
    const std::int64_t now_ns = next_event_ns_;
    while (pending_count_ > 0 && pending_[pending_first_].time_ns <= now_ns) {
        input_torque_Nm_ = pending_[pending_first_].motor_torque_Nm;
        pending_first_ = (pending_first_ + 1) % pending_.size();
        --pending_count_;
    }
    if (tick_ns_ <= now_ns) {
        millisecond(wheel_angle_rad, wheel_speed_rad_per_s, out);
        ++tick_count_;
        tick_ps_ += period_ps_;
        const std::int64_t whole_ns = tick_ps_ / 1000;
        tick_ns_ += whole_ns;
        tick_ps_ -= whole_ns * 1000;
    }
    retarget();
    schedule();
}

void SimOdrive::millisecond(double wheel_angle_rad, double wheel_speed_rad_per_s, drivers::FrameSink& out) {
    const std::int64_t now_ns = tick_ns_;
    read_encoder(wheel_angle_rad, wheel_speed_rad_per_s);
    if (faults_.powered_off) {
        leave_closed_loop();
        was_off_ = true;
        return;
    }
    if (was_off_) {
        power_cycle();
        if (faults_.wakes_armed) arming_done_ns_ = now_ns;
    }
    was_off_ = false;
    if (faults_.motor_unplugged) leave_closed_loop();
    if (arming_done_ns_ != 0 && now_ns >= arming_done_ns_) {
        axis_state_ = kClosedLoop;
        arming_done_ns_ = 0;
        hold_counts_ = position_estimate_;
        hold_integral_Nm_ = 0;
    }
    if (!plain_report_) {
        model::MeasurementLag::report_speed({config_.report_lag_s}, report_memory_, velocity_estimate_,
                                            static_cast<double>(period_ps_) * 1e-12);
    }
    check_watchdog(now_ns);
    if (armed()) {
        if (control_mode_ != kTorqueControl) hold();
        extra_wheel_Nm_ = config_.torque_noise_Nm * random_.gaussian_fast();
        if (config_.torque_ripple_Nm != 0) {
            const double motor_turns = last_counts_ / config_.counts_per_turn;
            extra_wheel_Nm_ += config_.torque_ripple_Nm *
                               sine_cosine(motor_turns * config_.ripples_per_motor_turn * kTwoPi).sine;
        }
    }
    send_cyclic(out);
}

void SimOdrive::check_watchdog(std::int64_t now_ns) {
    if (!config_.watchdog_enabled) return;
    if (config_.generation == 6 && !armed()) return;
    if (now_ns - fed_ns_ <= watchdog_timeout_ns_) return;
    raise_error(config_.generation == 5 ? 0x800U : 0x0100'0000U);
}

// The drive's position and velocity loops, in its milliseconds.
void SimOdrive::hold() {
    const double off_rev = (hold_counts_ - position_estimate_) / config_.counts_per_turn;
    const double wanted = control_mode_ == kPositionControl ? kHoldPosition_per_s * off_rev : 0;
    const double error = wanted - velocity_estimate_ / config_.counts_per_turn;
    hold_Nm_ = kHoldVelocity_Nm_s_per_rev * error + hold_integral_Nm_;
    hold_integral_Nm_ += 1e-3 * kHoldIntegral_Nm_per_rev * error;
}

void SimOdrive::reverse_encoder() {
    counts_per_rad_ = -counts_per_rad_;
    origin_counts_ -= 2 * last_counts_;
    last_counts_ = -last_counts_;
    last_speed_ = -last_speed_;
}

void SimOdrive::set_position(double motor_turns) {
    position_estimate_ = told_position_ = motor_turns * config_.counts_per_turn;
    origin_counts_ = last_counts_ - position_estimate_;
}

// The eight readings since the last millisecond. The wheel's path between the two known ends is the cubic
// with the right speeds there: wrong by less than 1e-5 rad even across a torque step, a tenth of a count.
void SimOdrive::read_encoder(double wheel_angle_rad, double wheel_speed_rad_per_s) {
    constexpr double kStep = 1.0 / kReadingsPerMs;
    const double counts = wheel_angle_rad * counts_per_rad_;
    const double speed = wheel_speed_rad_per_s * counts_per_rad_ * (static_cast<double>(period_ps_) * 1e-12);
    const double moved = counts - last_counts_;
    const double c2 = 3 * moved - 2 * last_speed_ - speed;
    const double c3 = last_speed_ + speed - 2 * moved;
    const double start = last_counts_ - origin_counts_;

    std::array<double, kReadingsPerMs> readings;
    std::uint64_t bits = 0;
    for (std::size_t i = 0; i < kReadingsPerMs; ++i) {
        if (i % 4 == 0) bits = random_.bits();
        const double noise = noise_step_ * (static_cast<double>(bits & 0xFFFFU) - 32767.5);
        bits >>= 16U;
        const double s = static_cast<double>(i + 1) * kStep;
        readings[i] = start + s * (last_speed_ + s * (c2 + s * c3)) + noise;
    }
    if (faults_.encoder_scale != 1 || faults_.encoder_creep_rad_per_s != 0) {
        const double crept = faults_.encoder_creep_rad_per_s * counts_per_rad_ * 1e-3;
        for (std::size_t i = 0; i < kReadingsPerMs; ++i) {
            const double s = static_cast<double>(i + 1) * kStep;
            readings[i] = start + faults_.encoder_scale * (readings[i] - start) + s * crept;
        }
        origin_counts_ += (1 - faults_.encoder_scale) * moved - crept;
    }
    if (faults_.frozen_encoder) {
        if (!was_frozen_) frozen_count_ = readings.back();
        readings.fill(frozen_count_);
        if (faults_.flicker_counts > 0) {
            const auto steps = static_cast<std::uint64_t>(2 * faults_.flicker_counts + 1);
            for (double& reading : readings) {
                reading += static_cast<double>(random_.bits() % steps) - faults_.flicker_counts;
            }
        }
    }
    was_frozen_ = faults_.frozen_encoder;

    double position = position_estimate_;
    double velocity = velocity_estimate_;
    if (ideal_encoder_) {
        for (const double reading : readings) {
            position += kReadingPeriod_s * velocity;
            const double error = reading - position;
            position += kp_ * error;
            velocity += ki_ * error;
        }
    } else {
        for (const double reading : readings) {
            position += kReadingPeriod_s * velocity;
            const double error = floor_of(reading) - floor_of(position);
            position += kp_ * error;
            velocity += ki_ * error;
            // Less than half the smallest change: standing still.
            if (std::abs(velocity) < 0.5 * ki_) velocity = 0;
        }
    }
    position_estimate_ = position;
    velocity_estimate_ = velocity;
    last_counts_ = counts;
    last_speed_ = speed;
    if (!faults_.told_position_frozen) told_position_ = position;
}

void SimOdrive::retarget() {
    const bool passes = input_mode_ == kPassthrough || input_mode_ == kTorqueRamp;
    const double limit = config_.current_limit_A * config_.torque_constant_Nm_per_A;
    target_Nm_ = armed() && passes ? std::clamp(input_torque_Nm_ + hold_Nm_, -limit, limit) : 0;
}

double SimOdrive::torque_target_Nm() const { return wheel_per_motor_torque_ * motor_target_Nm(); }

SimOdrive::LagStep SimOdrive::lag_step(double dt_s, double lag_s) {
    if (lag_s <= 0) return {0, 0};
    const double x = dt_s / lag_s;
    const double mean = mean_exp_minus(x);
    return {mean, 1 - x * mean};
}

double SimOdrive::advance_torque(const LagStep& lag) {
    if (!armed()) return 0;
    const double lacking = motor_torque_Nm_ - target_Nm_;
    motor_torque_Nm_ = target_Nm_ + lacking * lag.end;
    return wheel_per_motor_torque_ * (target_Nm_ + lacking * lag.mean) + extra_wheel_Nm_;
}

void SimOdrive::send_cyclic(drivers::FrameSink& out) const {
    if (is_due(tick_count_, config_.encoder_period_ms, 0)) send_encoder(out);
    if (is_due(tick_count_, config_.heartbeat_period_ms, heartbeat_phase_)) send_heartbeat(out);
    if (is_due(tick_count_, config_.torque_period_ms, torque_phase_)) {
        if (config_.generation == 6) {
            send_torque(out);
        } else {
            send_iq(out);
        }
    }
    if (is_due(tick_count_, config_.voltage_period_ms, voltage_phase_)) send_voltage(out);
    if (config_.generation == 6 && is_due(tick_count_, config_.temperature_period_ms, temperature_phase_))
        send_temperature(out);
}

void SimOdrive::send_heartbeat(drivers::FrameSink& out) const {
    if (config_.generation == 6) {
        gen6::Heartbeat heartbeat;
        heartbeat.axis_error = error_;
        heartbeat.axis_state = static_cast<gen6::AxisState>(axis_state_);
        send(heartbeat, out);
    } else {
        gen5::Heartbeat heartbeat;
        heartbeat.axis_error = error_;
        heartbeat.axis_state = static_cast<gen5::AxisState>(axis_state_);
        heartbeat.motor_error_flag = (error_ & gen5::AxisError::motor_failed) != 0;
        heartbeat.encoder_error_flag = (error_ & gen5::AxisError::encoder_failed) != 0;
        heartbeat.controller_error_flag = (error_ & gen5::AxisError::controller_failed) != 0;
        heartbeat.trajectory_done_flag = true;  // as from power-on on, while nobody asks for a trajectory
        send(heartbeat, out);
    }
}

void SimOdrive::send_encoder(drivers::FrameSink& out) const {
    gen6::GetEncoderEstimates estimates;  // the same in both generations
    const SimOdrive& tells = faults_.told_by != nullptr ? *faults_.told_by : *this;
    double turns = tells.told_position_ / config_.counts_per_turn;
    double turns_per_s = faults_.told_speed_scale * tells.velocity_estimate_ / config_.counts_per_turn;
    if (!plain_report_) {
        if (config_.report_lag_s > 0)
            turns_per_s = report_memory_.reported_rad_per_s / config_.counts_per_turn;
        if (config_.report_counts_per_wheel_turn > 0) {
            const double counts = config_.report_counts_per_wheel_turn / config_.gear_ratio;
            turns = floor_of(turns * counts) / counts;
            model::EncoderQuantisation::Memory<double> none;
            turns_per_s =
                model::EncoderQuantisation::report_speed({counts}, none, kTwoPi * turns_per_s, 1e-3) / kTwoPi;
        }
    }
    estimates.pos_estimate_rev = static_cast<float>(turns);
    estimates.vel_estimate_rev_per_s = static_cast<float>(turns_per_s);
    send(estimates, out);
}

void SimOdrive::send_torque(drivers::FrameSink& out) const {
    gen6::GetTorques torques;
    torques.torque_target_Nm = static_cast<float>(motor_target_Nm());
    torques.torque_estimate_Nm = static_cast<float>(motor_torque_Nm_);
    send(torques, out);
}

void SimOdrive::send_iq(drivers::FrameSink& out) const {
    gen6::GetIq iq;  // the same in both generations
    iq.iq_setpoint_A = static_cast<float>(motor_target_Nm() / config_.torque_constant_Nm_per_A);
    iq.iq_measured_A = static_cast<float>(motor_torque_Nm_ / config_.torque_constant_Nm_per_A);
    send(iq, out);
}

void SimOdrive::send_voltage(drivers::FrameSink& out) const {
    gen6::GetBusVoltageCurrent supply;  // the same in both generations
    supply.bus_voltage_V = static_cast<float>(config_.bus_voltage_V - faults_.supply_sags_V);
    send(supply, out);
}

void SimOdrive::send_temperature(drivers::FrameSink& out) const {
    gen6::GetTemperature temperature;
    temperature.fet_temperature_degC = temperature.motor_temperature_degC =
        static_cast<float>(config_.temperature_degC + faults_.heats_degC);
    send(temperature, out);
}

}  // namespace wheelwright::sim
