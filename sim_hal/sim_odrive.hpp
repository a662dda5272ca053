// A simulated ODrive with its motor, gear and encoder, as the CANSimple protocol describes it (generations
// 0.5 and 0.6). Written from the protocol and shares nothing with the firmware's driver but the codec
// generated from the DBC, so that each checks the other.
//
// What it has, pleasant or not:
// - Axis states idle and closed loop. Closed loop is refused while an error stands, is entered after a short
//   time, and uses whatever controller mode and input torque were set before: hence the arming order.
// - The input "passthrough" or "torque ramp" (taken as passthrough), else no torque. Control mode "torque":
// the
//   motor follows the set-point. "Velocity" and "position", the factory's: it holds still, or where it was
//   armed, with the gains that the factory sets, and the torque set-point is added.
// - The watchdog. 0.5: counts in every state, each frame to the node feeds it, remote requests too. 0.6:
//   counts while armed; set-points and state requests feed it (the stricter reading where the manual is
//   silent). When it runs out the error bit appears and the axis is idle: the wheel coasts.
// - Cyclic messages at whole milliseconds of the drive's own, slightly wrong clock, with a phase of its own.
// - Encoder counts with (uniform, white) noise, read 8000 times a second into the drive's tracking filter
//   (two real poles at the bandwidth, above 4000 rad/s too, where an ODrive refuses); position in revolutions
//   as a float, which loses resolution as it grows.
// - Torque: limited by current, first-order lag, noise held for a millisecond, ripple with the motor angle.
//
// Time is an argument everywhere. Threads: one. No call after the constructor allocates or throws.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "drivers/motor_drive.hpp"
#include "firmware/model/effects.hpp"
#include "hal/can_bus.hpp"
#include "sim_hal/random.hpp"

namespace wheelwright::sim {

struct SimOdriveConfig {
    std::int32_t generation = 6;  // 5: 0.5.x, 6: 0.6.x
    std::int32_t node = 1;
    // Motor and wheel. The wheel's torque is sign * gear_ratio * torque_scale * the motor's.
    std::int32_t sign = 1;
    double gear_ratio = 8;
    double torque_constant_Nm_per_A = 0.0827;
    double torque_scale = 1;  // how wrong the drive's torque constant is; its own reports do not know
    double current_limit_A = 20;
    double torque_lag_s = 0.0005;   // 0: none
    double torque_noise_Nm = 0.02;  // standard deviation at the wheel, while armed
    double torque_ripple_Nm = 0;    // amplitude at the wheel, while armed
    double ripples_per_motor_turn = 7;
    double command_latency_s = 0.0002;  // from a set-point's frame to its effect
    // Encoder, on the motor shaft.
    double counts_per_turn = 8192;      // 0: an ideal encoder
    double encoder_noise_rad = 0.0002;  // standard deviation of each reading, at the wheel
    double filter_bandwidth_rad_per_s = 1000;
    // Its reports only: the effects encoder_quantisation and measurement_lag.
    double report_counts_per_wheel_turn = 0;  // 0: not rounded
    double report_lag_s = 0;                  // of the speed; 0: none
    // Cyclic messages; 0: off.
    std::int32_t heartbeat_period_ms = 100;
    std::int32_t encoder_period_ms = 1;
    std::int32_t torque_period_ms = 10;  // 0.6: Get_Torques; 0.5: Get_Iq
    std::int32_t voltage_period_ms = 0;
    std::int32_t temperature_period_ms = 0;  // 0.6 only
    bool watchdog_enabled = true;
    double watchdog_timeout_s = 0.05;
    // 0.6: the endpoints that tell watchdog_enabled, watchdog_timeout_s, control and input mode; 0: none
    // answers
    std::int32_t watchdog_endpoint = 0;
    std::int32_t watchdog_timeout_endpoint = 0;
    std::int32_t control_mode_endpoint = 0;
    std::int32_t input_mode_endpoint = 0;
    double arming_time_s = 0.003;  // from the request to closed loop
    double bus_voltage_V = 24;
    double temperature_degC = 31.5;  // of inverter and motor
    double clock_error_ppm = 0;      // the drive's milliseconds are longer by this much
    std::int64_t phase_ns = 0;       // of its first millisecond after the start
    std::uint64_t seed = 1;
    std::uint64_t stream = 1;  // distinct for drives of one seed
};

class SimOdrive;

// What can be made to fail. All of them start and end at once.
struct SimOdriveFaults {
    bool mute = false;                   // sends nothing, obeys still
    bool deaf = false;                   // receives nothing
    bool frozen_encoder = false;         // counts do not change
    int flicker_counts = 0;              // but for so many up or down, of a frozen encoder
    double encoder_scale = 1;            // counts for each true one
    double encoder_creep_rad_per_s = 0;  // at the wheel: turns on its shaft
    bool keeps_its_count = false;        // does not know Set_Absolute_Position, Set_Linear_Count
    double told_speed_scale = 1;         // of the speed in its frames
    bool told_position_frozen = false;   // in its frames
    const SimOdrive* told_by = nullptr;  // whose position and speed its frames tell
    bool powered_off = false;            // mute, deaf and without torque; comes back idle, at position 0
    bool wakes_armed = false;            // when switched on again: in closed loop, as it may be configured
    double supply_sags_V = 0;            // below the configured voltage, as it reports it
    double heats_degC = 0;               // above the configured temperature, the same
    bool motor_unplugged = false;  // ODrive#700: closed loop is left, and no error appears in the heartbeat
};

class SimOdrive {
  public:
    SimOdrive(const SimOdriveConfig& config, std::int64_t start_ns);

    // A frame of the bus, at the time it ended on the wire. Frames for others are ignored. Replies go to
    // `out`.
    void receive(const hal::CanFrame& frame, std::int64_t now_ns, drivers::FrameSink& out);

    // When the drive next does something by itself: its millisecond, or a set-point taking effect.
    std::int64_t next_event_ns() const { return next_event_ns_; }

    // The next of those events that needs the wheel's motion.
    std::int64_t next_look_ns() const { return tick_ns_; }

    // Does it. To be called exactly at next_event_ns(), with the wheel's true motion then.
    void run_event(double wheel_angle_rad, double wheel_speed_rad_per_s, drivers::FrameSink& out);

    // How much of a torque error is left over the next `dt_s` on average, and at its end.
    struct LagStep {
        double mean;
        double end;
    };
    static LagStep lag_step(double dt_s, double lag_s);

    // Mean wheel torque over the next step, with no event inside. Moves the lag on. `lag` is that of the step
    // and this drive's torque_lag_s.
    double advance_torque(const LagStep& lag);
    double advance_torque(double dt_s) { return advance_torque(lag_step(dt_s, config_.torque_lag_s)); }

    SimOdriveFaults& faults() { return faults_; }
    void raise_error(std::uint32_t bits);     // as if the drive had found it itself
    void drop_out() { leave_closed_loop(); }  // ends closed loop without any error
    void reverse_encoder();  // counts the other way from where it is; the torque's direction stays
    void zero_position() { set_position(0); }
    void set_position(double motor_turns);  // as Set_Linear_Count and Set_Absolute_Position do
    void clear_errors();                    // as the frame does; 0.5 boards clear both axes

    const SimOdriveConfig& config() const { return config_; }
    bool armed() const { return axis_state_ == kClosedLoop; }
    std::uint32_t axis_state() const { return axis_state_; }
    std::uint32_t error_bits() const { return error_; }
    double torque_target_Nm() const;  // at the wheel: what the last effective set-point asks, limited
    std::uint64_t bad_frames() const { return bad_frames_; }  // wrong length, or not finite

  private:
    static constexpr std::uint32_t kIdle = 1;
    static constexpr std::uint32_t kClosedLoop = 8;
    static constexpr std::size_t kReadingsPerMs = 8;
    static constexpr double kReadingPeriod_s = 1e-3 / kReadingsPerMs;

    struct Pending {
        std::int64_t time_ns = 0;
        double motor_torque_Nm = 0;
    };

    template <typename Message>
    void send(const Message& message, drivers::FrameSink& out) const;
    template <typename Message>
    bool decode(const hal::CanFrame& frame, Message& message);

    void receive_request(std::uint32_t command, drivers::FrameSink& out) const;
    void receive_command(const hal::CanFrame& frame, std::uint32_t command, std::int64_t now_ns,
                         drivers::FrameSink& out);
    void request_state(std::uint32_t state, std::int64_t now_ns);
    void leave_closed_loop();
    void power_cycle();
    void millisecond(double wheel_angle_rad, double wheel_speed_rad_per_s, drivers::FrameSink& out);
    void read_encoder(double wheel_angle_rad, double wheel_speed_rad_per_s);
    void check_watchdog(std::int64_t now_ns);
    void hold();
    void send_cyclic(drivers::FrameSink& out) const;
    void send_heartbeat(drivers::FrameSink& out) const;
    void send_encoder(drivers::FrameSink& out) const;
    void send_torque(drivers::FrameSink& out) const;
    void send_iq(drivers::FrameSink& out) const;
    void send_voltage(drivers::FrameSink& out) const;
    void send_temperature(drivers::FrameSink& out) const;
    double motor_target_Nm() const { return target_Nm_; }
    void retarget();
    void schedule();

    SimOdriveConfig config_;
    SimOdriveFaults faults_;
    Random random_;
    bool was_off_ = false;

    std::uint32_t axis_state_ = kIdle;
    std::uint32_t error_ = 0;
    std::uint32_t control_mode_ = 3;  // position, as the factory sets it
    std::uint32_t input_mode_ = 1;
    std::int64_t arming_done_ns_ = 0;  // 0: not arming
    std::int64_t fed_ns_ = 0;
    std::int64_t watchdog_timeout_ns_ = 0;
    std::uint64_t bad_frames_ = 0;

    // Torque, at the motor.
    double input_torque_Nm_ = 0;
    double hold_Nm_ = 0;  // of the drive's own loops in the modes velocity and position
    double hold_integral_Nm_ = 0;
    double hold_counts_ = 0;      // where it was armed
    double target_Nm_ = 0;        // what input, mode and limit come to; retarget() after each change of them
    double motor_torque_Nm_ = 0;  // behind the lag
    double extra_wheel_Nm_ = 0;   // noise and ripple for this millisecond, at the wheel
    std::array<Pending, 8> pending_{};
    std::size_t pending_first_ = 0;
    std::size_t pending_count_ = 0;
    double wheel_per_motor_torque_ = 1;  // signed

    // Encoder, in counts on the motor shaft.
    double counts_per_rad_ = 0;  // of the wheel, signed
    double kp_ = 0;              // of the encoder's tracking loop, for each reading
    double ki_ = 0;
    bool ideal_encoder_ = false;
    double noise_step_ = 0;
    double last_counts_ = 0;    // true position at the last millisecond, not quantised
    double last_speed_ = 0;     // true speed then, counts per millisecond of the drive
    double origin_counts_ = 0;  // where the drive was switched on
    double frozen_count_ = 0;
    double told_position_ = 0;  // of the last frame whose position was not frozen
    bool was_frozen_ = false;
    double position_estimate_ = 0;
    double velocity_estimate_ = 0;  // counts/s
    bool plain_report_ = true;
    std::int64_t command_latency_ns_ = 0;
    model::MeasurementLag::Memory<double> report_memory_;  // in counts/s as well

    // The drive's clock.
    std::int64_t period_ps_ = 0;
    std::int64_t tick_ns_ = 0;
    std::int64_t tick_ps_ = 0;  // remainder below a nanosecond
    std::uint32_t tick_count_ = 0;
    std::int64_t next_event_ns_ = 0;
    std::uint32_t heartbeat_phase_ = 0;
    std::uint32_t torque_phase_ = 0;
    std::uint32_t voltage_phase_ = 0;
    std::uint32_t temperature_phase_ = 0;
};

}  // namespace wheelwright::sim
