// A motor drive as the cycle sees it: torque at the wheel in, wheel angle, speed and torque out. Each dialect
// of drive (ODrive CANSimple today) implements it. Gear ratio, sign and torque constant are applied inside,
// so everything here is at the wheel and positive drives the robot forward.
//
// A driver does no input or output of its own: the cycle hands it received frames, and it writes the frames
// it wants sent into a FrameSink. It is therefore a pure function of (state, frames in, time). No call
// allocates, blocks or throws.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string_view>

#include "hal/can_bus.hpp"

namespace wheelwright::drivers {

enum class Wheel : std::uint8_t { left, right };

enum class DriveState : std::uint8_t {
    silent,            // nothing heard within the heartbeat time-out
    idle,              // alive, delivers no torque
    arming,            // on the way from idle to armed, or back
    armed,             // follows torque commands
    fault,             // reports an error or has left the armed state by itself
    other_generation,  // its frames have the form of another generation than the robot file says
};

enum class ArmRefusal : std::uint8_t {
    none,
    silent,
    drive_error,
    watchdog_not_confirmed,  // the drive's own command watchdog is not known to be on, or too slow
    mode_not_confirmed,      // the drive says that it is not in torque mode
    timed_out,
    other_generation,
};

// Why a drive is, or was last, in the state fault or silent.
enum class DriveFault : std::uint8_t {
    none,
    silent,               // went silent while armed or arming
    error,                // reports error bits
    left_armed,           // ended the armed state by itself, with no error to show
    disarm_failed,        // stays armed although it was told to go idle
    armed_unasked,        // is armed, and not by this driver
    torque_not_followed,  // reports another set-point than it was given: in another mode, say
};

// Monotonic counters.
struct DriveCounters {
    std::uint32_t wrong_length = 0;        // received frames too short or too long
    std::uint32_t not_finite = 0;          // received frames with a NaN or infinite number
    std::uint32_t command_not_finite = 0;  // torques asked for that were no numbers
    std::uint32_t foreign_commands = 0;    // somebody else on the bus speaks to this drive,
    std::uint32_t foreign_control = 0;     // and so that it may move: arms it, or gives it set-points
};

// A frame that the drive and this driver exchange in every period, as the bus-load computation needs it.
struct DriveFrame {
    std::string_view name;  // as in the drive's protocol
    std::uint32_t id = 0;
    std::uint8_t length = 0;
    bool extended = false;
    bool to_drive = false;
    double period_s = 0;
};

// The latest feedback. Times are the frames' receive timestamps; 0 means never.
struct DriveFeedback {
    double position_rad = 0;     // wheel angle since power-on, unwrapped
    double speed_rad_per_s = 0;  // wheel speed as the drive estimates it
    double torque_Nm = 0;        // torque the drive reports, at the wheel
    double bus_voltage_V = 0;
    // NaN: this one is not measured.
    double inverter_temperature_degC = std::numeric_limits<double>::quiet_NaN();
    double motor_temperature_degC = std::numeric_limits<double>::quiet_NaN();
    std::int64_t encoder_time_ns = 0;
    std::int64_t torque_time_ns = 0;
    std::int64_t supply_time_ns = 0;
    std::int64_t temperature_time_ns = 0;
    std::int64_t heartbeat_time_ns = 0;
    std::uint32_t error_bits = 0;  // in the drive's own encoding
};

// What is alike in all drives of the dialect, whatever their size.
struct DriveRatings {
    // Beyond these none works in health.
    double least_supply_V = 0;
    double most_supply_V = 0;
    double most_temperature_degC = 0;  // of inverter and motor
    // Period in which it computes the loop that follows the encoder (encoder_loop.hpp).
    double encoder_loop_period_s = 0;
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

    // Commands wheel torque; pushes one frame. Ignored (nothing pushed) unless armed: while arming, update()
    // itself sends zero torque. A torque that is no finite number is sent as zero and counted.
    virtual void command_torque(double torque_Nm, FrameSink& out) = 0;

    // The bus did not take a frame that this driver has pushed in this cycle. True: it was one of this
    // drive's. What must arrive is pushed again by the next update().
    virtual bool refused(const hal::CanFrame& frame) = 0;

    // For who reads a log: somebody sent this frame to the drive. Needed where it changes what accept() makes
    // of the frames that follow.
    virtual void was_sent(const hal::CanFrame& frame) = 0;

    // Wheel torque delivered per wheel torque the drive believes in, as calibrated; > 0.
    virtual void set_torque_scale(double scale) = 0;

    virtual DriveState state() const = 0;
    virtual DriveFault fault() const = 0;
    virtual ArmRefusal refusal() const = 0;  // why the last arming did not succeed
    virtual const DriveFeedback& feedback() const = 0;
    virtual const DriveCounters& counters() const = 0;

    // Pushes what makes this drive idle, whatever it does and is believed to do. The one call for any thread.
    virtual void push_idle(FrameSink& out) const = 0;

    virtual const DriveRatings& ratings() const = 0;

    // The periodic frames of this drive. Constant after construction.
    virtual std::span<const DriveFrame> frames() const = 0;

    // The name of one of feedback().error_bits; "unknown" for a bit without one.
    virtual std::string_view error_name(std::uint32_t bit) const = 0;

    // All that this driver remembers, as hal::plain_memory() has it.
    virtual std::span<std::byte> memory() = 0;
};

constexpr std::string_view to_string_view(DriveState state) {
    switch (state) {
        case DriveState::silent:
            return "silent";
        case DriveState::idle:
            return "idle";
        case DriveState::arming:
            return "arming";
        case DriveState::armed:
            return "armed";
        case DriveState::fault:
            return "fault";
        case DriveState::other_generation:
            return "other_generation";
    }
    return "unknown";
}

constexpr std::string_view to_string_view(ArmRefusal refusal) {
    switch (refusal) {
        case ArmRefusal::none:
            return "none";
        case ArmRefusal::silent:
            return "silent";
        case ArmRefusal::drive_error:
            return "drive_error";
        case ArmRefusal::watchdog_not_confirmed:
            return "watchdog_not_confirmed";
        case ArmRefusal::mode_not_confirmed:
            return "mode_not_confirmed";
        case ArmRefusal::timed_out:
            return "timed_out";
        case ArmRefusal::other_generation:
            return "other_generation";
    }
    return "unknown";
}

constexpr std::string_view to_string_view(DriveFault fault) {
    switch (fault) {
        case DriveFault::none:
            return "none";
        case DriveFault::silent:
            return "silent";
        case DriveFault::error:
            return "error";
        case DriveFault::left_armed:
            return "left_armed";
        case DriveFault::disarm_failed:
            return "disarm_failed";
        case DriveFault::armed_unasked:
            return "armed_unasked";
        case DriveFault::torque_not_followed:
            return "torque_not_followed";
    }
    return "unknown";
}

}  // namespace wheelwright::drivers
