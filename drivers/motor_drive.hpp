// A motor drive as the cycle sees it: torque at the wheel in, wheel angle, speed and torque out. Each dialect
// of drive (ODrive CANSimple today) implements it. Gear ratio, sign and torque constant are applied inside,
// so everything here is at the wheel and positive drives the robot forward.
//
// A driver does no input or output of its own: the cycle hands it received frames, and it writes the frames
// it wants sent into a FrameSink. It is therefore a pure function of (state, frames in, time). No call
// allocates, blocks or throws.
#pragma once

#include <cstdint>

#include "hal/can_bus.hpp"

namespace wheelwright::drivers {

enum class DriveState : std::uint8_t {
    silent,  // nothing heard within the heartbeat time-out
    idle,    // alive, delivers no torque
    arming,  // the arming sequence is under way
    armed,   // follows torque commands
    fault,   // reports an error or has left the armed state by itself
};

enum class ArmRefusal : std::uint8_t {
    none,
    silent,
    drive_error,
    watchdog_not_confirmed,  // the drive's own command watchdog is not known to be on
    timed_out,
};

// The latest feedback. Times are the frames' receive timestamps; 0 means never.
struct DriveFeedback {
    double position_rad = 0;     // wheel angle since power-on, unwrapped
    double speed_rad_per_s = 0;  // wheel speed as the drive estimates it
    double torque_Nm = 0;        // torque the drive reports, at the wheel
    double bus_voltage_V = 0;
    double temperature_degC = 0;
    std::int64_t encoder_time_ns = 0;
    std::int64_t torque_time_ns = 0;
    std::int64_t heartbeat_time_ns = 0;
    std::uint32_t error_bits = 0;  // in the drive's own encoding
};

class FrameSink {
  public:
    virtual ~FrameSink() = default;
    virtual void push(const hal::CanFrame& frame) = 0;
};

class MotorDrive {
  public:
    virtual ~MotorDrive() = default;

    // Offers one received frame; true when it belonged to this drive.
    virtual bool accept(const hal::ReceivedFrame& frame) = 0;

    // Advances time-outs and the arming sequence; may push requests. Called once in each cycle.
    virtual void update(std::int64_t now_ns, FrameSink& out) = 0;

    // Begins arming (allowed in idle or fault; otherwise ignored) or disarming (allowed always).
    virtual void request_arm() = 0;
    virtual void request_disarm() = 0;

    // Clears latched drive errors; the drive ends in idle.
    virtual void request_clear_errors() = 0;

    // Commands wheel torque; pushes one frame. Ignored (nothing pushed) unless armed or arming.
    // Not finite torque is sent as zero and counted.
    virtual void command_torque(double torque_Nm, FrameSink& out) = 0;

    virtual DriveState state() const = 0;
    virtual ArmRefusal refusal() const = 0;  // why the last arming did not succeed
    virtual const DriveFeedback& feedback() const = 0;
};

}  // namespace wheelwright::drivers
