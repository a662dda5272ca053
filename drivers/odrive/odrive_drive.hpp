// Motor drive: ODrive over CANSimple, firmware generations 0.5 and 0.6. One object is one axis.
//
// Arming, one step in each cycle, then zero torque in every cycle until armed (which feeds the watchdog):
// - idle if the axis is not;
// - 0.5: Set_Input_Torque(0) for the heartbeat's time-out, or half of the arming's if that is shorter, and
//   until a younger heartbeat has come. Fed now, the watchdog expires no more; and Clear_Errors, which clears
//   both axes of such a board, finds no error that nobody has seen;
// - Clear_Errors if the watchdog's error is reported;
// - Set_Controller_Mode(torque, passthrough), Set_Input_Torque(0);
// - 0.6: read back what has a known endpoint, one after the other, and go on only with the right answers:
//   enable_watchdog (on), watchdog_timeout (not longer than the robot file says), control_mode and input_mode
//   (as just set; else they are set and read again, until the arming's time-out);
// - where the modes cannot be read (0.5 has no message for them): Set_Controller_Mode once more, in case one
// is lost;
// - Set_Axis_State(closed loop), and a heartbeat younger than that request that shows closed loop, no error.
// Arming is refused at once when the watchdog can neither be read (0.6, endpoint known) nor is vouched for
// (watchdog_assured). Where the drive can be read, its answer decides.
// Arming is refused, and nothing cleared, when the drive reports any other error than the watchdog's: only
// request_clear_errors() clears those. An arming that is asked for while they are being cleared waits for the
// heartbeat that says what is left.
//
// Faults while armed, each latched until the next arming or clearing: an error in the heartbeat, an axis
// state that leaves closed loop even without an error (ODrive#700), no heartbeat, and two torque reports in a
// row whose set-point is not what was asked: so looks a drive in another mode, in both generations, once its
// wheel should turn. Only sizes are compared, as the current of a 0.5 drive has a sign of its own; by a
// factor of two, as nobody has calibrated the constants; and beyond a tenth of the torque limit. The axis is
// then told to go idle, until it says it is. An idle axis whose only error is the expired watchdog counts as
// idle: so looks a 0.5 drive whose watchdog is on and that nobody feeds, and one of 0.6 whose computer has
// died.
//
// An axis that is in closed loop although this driver has not asked for it is a fault, and told to go idle.
// So is somebody else's set-point, or request for another state than idle: counted as foreign_control. Who
// asks for such a state again within a second, or while the axis is armed by this driver, is answered by
// Estop, an error that keeps the axis idle until request_clear_errors().
//
// A drive that has been away may have been switched off, and may be set to come back in closed loop, in a
// mode of its own; its heartbeat says so late. So the first encoder frame after a gap counts: where it does
// not go on from the last one (after power-on a drive counts from 0), a drive that was armed has left that
// state; and one that is not armed is told to go idle at its first report of any kind after two encoder
// periods without an encoder frame, and 5 ms. Its position goes on meanwhile with the speed it had.
//
// Remote requests are never sent: they would feed the watchdog of a 0.5 drive and keep an old torque alive.
//
// Positions are floats in revolutions: after a thousand motor turns they step by 6e-5 turns, and so does all
// that is made of them. Therefore a drive whose position has gone beyond kLargestPosition_rev is told to
// count anew from 0 (0.5: Set_Linear_Count, 0.6: Set_Absolute_Position), also while it is armed: in torque
// control nothing but the estimate depends on it. feedback() goes on from where it was: between the last
// position in the old count and the first in the new one the axis went on with its speed. A drive that does
// not follow is told three times; where it comes back by itself it is where it says.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "drivers/motor_drive.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "hal/plain_memory.hpp"

namespace wheelwright::drivers {

enum class OdriveGeneration : std::uint8_t { v0_5, v0_6 };

// Of the drive's control loop, in which its encoder loop is computed: 8 kHz in both generations.
inline constexpr double kOdriveLoopPeriod_s = 1.0 / 8000;

struct OdriveConfig {
    OdriveGeneration generation = OdriveGeneration::v0_6;
    std::uint32_t node = 0;  // 0..62
    double sign = 1;         // +1 or -1
    double gear_ratio = 1;   // motor turns per wheel turn, > 0
    double torque_constant_Nm_per_A = 1;
    double torque_scale = 1;
    double cycle_period_s = 0.001;  // of command_torque
    double heartbeat_period_s = 0.1;
    double encoder_period_s = 0.001;
    double torque_period_s = 0.01;    // 0: off
    double supply_period_s = 0;       // 0: off
    double temperature_period_s = 0;  // 0: off
    double heartbeat_timeout_s = 0.35;
    double arming_timeout_s = 2;
    bool watchdog_assured = false;
    double watchdog_timeout_s = 0.05;  // the longest that is accepted
    double torque_limit_Nm = 1;        // at the wheel
    // 0: unknown
    std::uint16_t watchdog_endpoint = 0, watchdog_timeout_endpoint = 0, control_mode_endpoint = 0,
                  input_mode_endpoint = 0;
};

// Here a float still tells a count of 8192 a revolution; so does the drive's own, which counts in floats.
inline constexpr double kLargestPosition_rev = 1024;

// The factory's settings, 0.5 and 0.6: below 8 V a drive stops by itself; above 60 V no board of any size is
// whole; from 100 degC on the current is reduced, to nothing at 120 degC: half of it is left at 110.
inline constexpr DriveRatings kOdriveRatings{8, 60, 110, kOdriveLoopPeriod_s};

// What the robot file says about one wheel's drive.
OdriveConfig odrive_config(const model::RobotParameters& parameters, Wheel wheel);

// The name of one axis error bit; "unknown" for a bit without one.
std::string_view odrive_error_name(OdriveGeneration generation, std::uint32_t bit);

class OdriveDrive final : public MotorDrive {
  public:
    explicit OdriveDrive(const OdriveConfig& config);

    bool accept(const hal::ReceivedFrame& received) override;
    void update(std::int64_t now_ns, FrameSink& out) override;
    void request_arm() override { arm_requested_ = true; }
    void request_disarm() override { disarm_requested_ = true; }
    void request_clear_errors() override { clear_requested_ = true; }
    void command_torque(double torque_Nm, FrameSink& out) override;
    void set_torque_scale(double scale) override;
    bool refused(const hal::CanFrame& frame) override;
    void was_sent(const hal::CanFrame& frame) override;
    void push_idle(FrameSink& out) const override;

    DriveState state() const override;
    DriveFault fault() const override;
    ArmRefusal refusal() const override { return refusal_; }
    const DriveFeedback& feedback() const override { return feedback_; }
    const DriveCounters& counters() const override { return counters_; }
    const DriveRatings& ratings() const override { return kOdriveRatings; }
    std::span<const DriveFrame> frames() const override { return {frames_.data(), frame_count_}; }
    std::string_view error_name(std::uint32_t bit) const override {
        return odrive_error_name(config_.generation, bit);
    }
    std::span<std::byte> memory() override { return hal::plain_memory(config_, *this); }

    // The axis state of the last heartbeat, in the drive's numbers.
    std::uint32_t axis_state() const { return axis_state_; }

  private:
    enum class Phase : std::uint8_t { resting, arming, armed };
    // What a step of the arming waits for before the next one may begin.
    enum class Wait : std::uint8_t { next_cycle, idle, fresh_heartbeats, answers, closed_loop };
    // A value of the drive that is read back while arming.
    struct Question {
        std::uint16_t OdriveConfig::*endpoint;
        bool (*right)(const OdriveConfig& config, std::uint32_t value);
        bool is_mode;  // otherwise of the watchdog
    };
    static const std::array<Question, 4> kQuestions;
    struct Step {
        bool (OdriveDrive::*applies)() const;  // null: always
        void (OdriveDrive::*send)(FrameSink&);
        Wait wait;
        bool feed;  // from here on zero torque goes out in every cycle
    };
    static const std::array<Step, 8> kArming;

    template <typename Message>
    bool decode(const hal::CanFrame& frame, Message& message);
    template <typename Message>
    void send(const Message& message, FrameSink& out) const;

    bool is_not_idle() const;
    bool watchdog_counts_while_idle() const { return config_.generation == OdriveGeneration::v0_5; }
    bool reports_error() const { return feedback_.error_bits != 0; }
    bool can_ask(std::uint16_t OdriveConfig::*endpoint) const;
    bool can_ask_anything() const;
    bool cannot_ask_mode() const;
    void next_question();
    void take_answer(std::uint16_t endpoint, std::uint32_t value);
    void judge_torque(double motor_torque_Nm);
    void send_idle(FrameSink& out);
    void send_estop(FrameSink& out);
    void send_clear_errors(FrameSink& out);
    void send_torque_mode(FrameSink& out);
    void send_zero_torque(FrameSink& out);
    void send_question(FrameSink& out);
    void send_closed_loop(FrameSink& out);
    void send_motor_torque(double motor_torque_Nm, FrameSink& out) const;

    void take_temperatures(const hal::CanFrame& frame, std::int64_t time_ns);
    bool begins_anew(double position_rev, double speed_rev_per_s, std::int64_t time_ns) const;
    void take_return(bool anew);
    void take_position(double position_rev, double speed_rev_per_s, std::int64_t time_ns);
    void count_anew(FrameSink& out);
    void take_foreign(const hal::CanFrame& frame, std::int64_t time_ns);
    void take_heartbeat(const hal::CanFrame& frame, std::int64_t time_ns);
    bool is_of_other_generation(const hal::CanFrame& heartbeat) const;
    void take_evidence(bool of_other_generation);
    void note_errors();
    void judge_heartbeat(std::int64_t time_ns);
    void take_requests(FrameSink& out);
    void begin_arming();
    void run_arming(FrameSink& out);
    bool step_is_done() const;
    void end_arming(ArmRefusal why);
    void run_to_idle(FrameSink& out);
    void fail(DriveFault why);
    bool is_silent(std::int64_t now_ns) const;
    bool has_idle_error() const;
    void add_frame(std::string_view name, std::uint32_t command, bool to_drive, double period_s);
    void set_scales();

    // Heartbeat, encoder, torque or current, supply, temperatures; the torque command.
    static constexpr std::size_t kMostFrames = 6;
    std::array<DriveFrame, kMostFrames> frames_{};
    std::size_t frame_count_ = 0;

    OdriveConfig config_;                // from here on memory()
    double motor_per_wheel_torque_ = 1;  // signed
    double wheel_per_motor_torque_ = 1;
    double wheel_rad_per_rev_ = 1;
    std::int64_t heartbeat_timeout_ns_;
    std::int64_t arming_timeout_ns_;
    std::int64_t away_ns_;  // without an encoder frame

    static constexpr std::int64_t kNever_ns = std::numeric_limits<std::int64_t>::max();
    std::int64_t gone_after_ns_ = kNever_ns;  // where no encoder frame comes

    DriveFeedback feedback_;
    DriveCounters counters_;

    static constexpr int kFarFrames = 8;  // one alone may be nonsense
    double position_rev_ = 0;             // as the drive counts
    double speed_rev_per_s_ = 0;
    double origin_rev_ = 0;  // what it has counted before
    double last_far_rev_ = 0;
    std::int64_t last_far_ns_ = 0;
    int far_frames_ = 0;
    int told_to_count_anew_ = 0;
    std::int64_t told_to_count_anew_ns_ = 0;

    std::int64_t now_ns_ = 0;
    Phase phase_ = Phase::resting;
    ArmRefusal refusal_ = ArmRefusal::none;
    DriveFault fault_ = DriveFault::none;
    std::uint32_t axis_state_ = 0;
    std::uint32_t heartbeat_error_ = 0;
    std::uint32_t told_error_ = 0;  // 0.6: in Get_Error, where the drive sends it
    // For frames of a form that the configured generation does not have, against heartbeats that it may have:
    // up by two, down by one.
    int other_generation_ = 0;
    bool asked_by_others_ = false;
    std::int64_t armed_by_others_ns_ = 0;  // somebody's last request for another state than idle
    bool others_insist_ = false;  // there were two within a second, the last of them not answered yet
    bool silent_ = true;

    bool arm_requested_ = false;
    bool disarm_requested_ = false;
    bool clear_requested_ = false;

    std::size_t step_ = 0;
    bool step_sent_ = false;
    bool feeding_ = false;
    std::int64_t arming_since_ns_ = 0;
    std::int64_t step_since_ns_ = 0;
    std::int64_t asked_ns_ = 0;
    std::size_t question_ = 0;   // the next of kQuestions; their number when all are answered
    bool wrong_answer_ = false;  // to it
    // Sizes of the torques asked, at the motor: since the last torque report and between that and the one
    // before.
    struct Asked {
        double least_Nm = 0, most_Nm = 0;
        bool any = false;
    };
    std::array<Asked, 2> asked_{};
    int wrong_torques_ = 0;  // reports in a row
    std::int64_t wrong_since_ns_ = 0;

    bool to_idle_ = false;  // the axis has been told to go idle and has not said that it did
    bool idle_sent_ = false;
    std::int64_t to_idle_since_ns_ = 0;
    std::int64_t idle_sent_ns_ = 0;
    bool clearing_ = false;
    std::int64_t cleared_ns_ = 0;
};

}  // namespace wheelwright::drivers
