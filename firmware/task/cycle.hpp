// One cycle of the firmware, from frames to frames. A cycle is a function of (state, frames in, lines in,
// time): a recorded run replays to the same bytes out.
//
// Threads: one thread calls think() and send(), in turn. request_termination() may be called from a signal
// handler. Nothing here allocates, blocks, locks, throws or logs.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>

#include "drivers/motor_drive.hpp"
#include "firmware/control/encoder_watch.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/supervisor/supervisor.hpp"
#include "firmware/task/arming_guard.hpp"
#include "firmware/task/bus_meter.hpp"
#include "firmware/task/cycle_schedule.hpp"
#include "firmware/task/drive_limits.hpp"
#include "firmware/task/host_link.hpp"
#include "firmware/task/judge.hpp"
#include "firmware/task/learning.hpp"
#include "firmware/task/motion_control.hpp"
#include "firmware/task/parameter_service.hpp"
#include "firmware/task/senses.hpp"
#include "firmware/task/telemetry.hpp"
#include "hal/can_bus.hpp"
#include "hal/digital_line.hpp"
#include "hal/plain_memory.hpp"

namespace wheelwright::task {

// What a cycle works on. All of it outlives the Cycle.
struct CyclePorts {
    hal::CanBus& drive_bus;
    hal::CanBus* host_bus = nullptr;  // null: host and drives share a bus
    drivers::MotorDrive& left;
    drivers::MotorDrive& right;
    hal::DigitalInput* emergency_stop = nullptr;  // null: not connected
    hal::DigitalOutput* drive_enable = nullptr;
    ArmingKey arming_key = {};  // none: whoever asks may arm
};

// Frames that wait to be sent.
template <std::size_t kCapacity>
class FrameBox final : public drivers::FrameSink {
  public:
    void push(const hal::CanFrame& frame) override {
        if (count_ < kCapacity) {
            frames_[count_++] = frame;
        } else {
            ++lost_;
        }
    }
    std::span<const hal::CanFrame> frames() const { return {frames_.data(), count_}; }
    void clear() { count_ = 0; }
    std::uint32_t lost() const { return lost_; }
    std::span<std::byte> memory() { return hal::plain_memory(lost_, *this); }  // between cycles it is empty

  private:
    std::array<hal::CanFrame, kCapacity> frames_;
    std::size_t count_ = 0;
    std::uint32_t lost_ = 0;
};

class Cycle {
  public:
    // `parameters` are the live ones: commands over CAN and identification change them. The velocity loops
    // are designed here, so the constructor is not for the cycle's thread while it runs.
    Cycle(model::RobotParameters& parameters, SaveMailbox& mailbox, const CyclePorts& ports);

    // Reads, estimates, decides: everything up to the torques, which wait for send().
    void think(const CycleTime& time);

    // Torques first, then what the drives were asked besides, then at most one telemetry frame.
    void send(std::int64_t now_ns);

    // When, after the scheduled time: a stop does not wait.
    std::int64_t send_phase_ns() const { return stopping_cycles_ > 0 ? 0 : send_phase_ns_; }

    // Ends the firmware: stops as safety.terminate_reaction says, puts the drives to idle; then finished().
    // Async-signal-safe.
    void request_termination() { terminate_.store(true, std::memory_order_relaxed); }
    bool finished() const { return finished_; }

    // Between think() and send(): what the drives will be sent, and, where cycles are run again on a machine
    // that computes in other numbers, what they were sent then, which the recorded motion followed from.
    const MotionOutput& output() const { return output_; }
    void pretend_output(const WheelPair<Real>& torque_Nm) { output_.torque_Nm = torque_Nm; }

    // For tools that run the firmware in process, and for tests. Valid between cycles.
    CycleReport report() const;  // all parts
    const supervisor::Supervisor& supervisor() const { return supervisor_; }
    const MotionControl& control() const { return control_; }
    const Learning& learning() const { return learning_; }
    const control::Odometry<Real>& odometry() const { return senses_.odometry(); }
    const control::WheelObserver<Real>& observer() const { return senses_.observer(); }
    const supervisor::Conditions& conditions() const { return conditions_; }

    // Between cycles: all that cycle, drives and live parameters remember, which is all that the next cycle
    // depends on besides its inputs. Plain values (hal::plain_memory()): what is written back to a cycle that
    // was made with the same parameters makes it go on from there.
    std::array<std::span<std::byte>, 8> memory();

  private:
    static constexpr int kMostFramesPerCycle = 64;  // per bus; what is left waits for the next cycle

    // The steps of a cycle, in order.
    const HostEvents& receive(const CycleTime& time);
    Told told(const HostEvents& events) const;
    supervisor::Conditions judge(const Observed& seen, const HostEvents& events);
    supervisor::Verdict permit(const HostEvents& events);
    void command_drives(const supervisor::Verdict& verdict);
    void enter_mode(const supervisor::Verdict& verdict, const Observed& seen);
    void serve_parameters(const HostEvents& events);
    MotionOutput decide(const supervisor::Verdict& verdict, const Observed& seen);
    bool learn(const supervisor::Verdict& verdict, const Observed& seen, const MotionOutput& output);

    void fill(ReportPart part, CycleReport& report) const;
    void fill_status(protocol::Status& status) const;
    void fill_counters(CycleReport& report) const;

    [[gnu::noinline]] void prove(const HostEvents& events, supervisor::Requests& asked);
    void drain(hal::CanBus& bus, bool from_host, bool from_drives);
    bool transmit(hal::CanBus& bus, const hal::CanFrame& frame, BusMeter& meter);
    void configure();
    void finish_identification();
    [[gnu::noinline]] void use_rough_model();
    bool encoder_implausible(const Observed& seen);
    bool may_brake() const { return model_known_ || rough_model_; }
    bool identifying() const {
        return supervisor_.may_drive() &&
               supervisor::rule_of(supervisor_.mode()).law == supervisor::Law::excitation;
    }
    double elapsed_s() const { return static_cast<double>(1 + time_.missed) * kCyclePeriod_s; }

    model::RobotParameters& parameters_;
    CyclePorts ports_;
    ArmingGuard arming_;
    ParameterService service_;
    Judge judge_;
    FrameBox<4> torques_;  // one for each drive
    FrameBox<24> outbox_;  // what the drives are asked besides
    std::atomic<bool> terminate_{false};

    HostLink host_;  // from here on plain_memory()
    supervisor::Supervisor supervisor_;
    supervisor::Conditions conditions_;
    Senses senses_;
    control::EncoderWatch encoder_watch_;
    DriveLimits drive_limits_;
    MotionControl control_;
    Learning learning_;
    Telemetry telemetry_;
    CycleReport report_;
    bool long_cycle_ = false;  // telemetry waits
    OverrunMonitor overrun_;
    BusMeter drive_meter_;
    BusMeter host_meter_;

    bool finished_ = false;
    int ending_cycles_ = 0;
    bool drives_wanted_ = false;  // armed
    int stopping_cycles_ = 0;     // in which a stop's frames go at once, and on a shared bus alone

    CycleTime time_;
    std::uint64_t cycle_ = 0;
    std::int64_t send_phase_ns_;
    MotionOutput output_;
    bool overran_ = false;
    bool enable_failed_ = false;
    bool model_known_ = false;
    bool rough_model_ = false;  // the controllers' model is the probe's, as none was known
    bool bus_lost_ = false;
    int refused_torques_ = 0;
    bool zero_waits_ = false;  // behind an old torque
    std::uint32_t send_refused_ = 0;
    std::int64_t longest_wake_ns_ = 0;
    std::int64_t longest_execution_ns_ = 0;
    protocol::IdentSettings ident_settings_;
};

}  // namespace wheelwright::task
