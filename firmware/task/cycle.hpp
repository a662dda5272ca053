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
#include "firmware/control/odometry.hpp"
#include "firmware/control/wheel_observer.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/supervisor/supervisor.hpp"
#include "firmware/task/bus_meter.hpp"
#include "firmware/task/cycle_schedule.hpp"
#include "firmware/task/host_link.hpp"
#include "firmware/task/learning.hpp"
#include "firmware/task/motion_control.hpp"
#include "firmware/task/parameter_service.hpp"
#include "firmware/task/slip_watch.hpp"
#include "firmware/task/telemetry.hpp"
#include "hal/can_bus.hpp"
#include "hal/digital_line.hpp"

namespace wheelwright::task {

// What a cycle works on. All of it outlives the Cycle.
struct CyclePorts {
    hal::CanBus& drive_bus;
    hal::CanBus* host_bus = nullptr;  // null: host and drives share a bus
    drivers::MotorDrive& left;
    drivers::MotorDrive& right;
    hal::DigitalInput* emergency_stop = nullptr;  // null: not connected
    hal::DigitalOutput* drive_enable = nullptr;
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

    std::int64_t send_phase_ns() const { return send_phase_ns_; }

    // Ends the firmware: stops as safety.terminate_reaction says, puts the drives to idle; then finished().
    // Async-signal-safe.
    void request_termination() { terminate_.store(true, std::memory_order_relaxed); }
    bool finished() const { return finished_; }

    // For tools that run the firmware in process, and for tests. Valid between cycles.
    CycleReport report() const;  // all parts
    const supervisor::Supervisor& supervisor() const { return supervisor_; }
    const MotionControl& control() const { return control_; }
    const Learning& learning() const { return learning_; }
    const control::Odometry<double>& odometry() const { return odometry_; }
    const control::WheelObserver<double>& observer() const { return observer_; }
    const supervisor::Conditions& conditions() const { return conditions_; }

  private:
    static constexpr int kMostFramesPerCycle = 64;  // per bus; what is left waits for the next cycle

    // The steps of a cycle, in order.
    void receive();
    void observe();
    void judge_conditions();
    void obey();
    void serve_parameters();
    void decide();
    void learn();
    void guard_torque();
    void note_times();

    void fill(ReportPart part, CycleReport& report) const;
    void fill_status(protocol::Status& status) const;
    void fill_counters(CycleReport& report) const;

    void drain(hal::CanBus& bus, bool from_host, bool from_drives);
    bool transmit(hal::CanBus& bus, const hal::CanFrame& frame, BusMeter& meter);
    void configure();
    void finish_identification();
    [[gnu::noinline]] void use_rough_model();
    template <typename Setpoint>
    bool late(const Setpoint& setpoint, std::uint16_t cycle_time_ms) const;
    bool setpoint_stale() const;
    bool host_gone() const;
    void forget_late_setpoints();
    bool stale(std::int64_t time_ns, double limit_s) const;
    MotionInputs motion_inputs() const;
    [[gnu::noinline]] WheelPair<double> identify(const MotionInputs& now);
    bool encoder_implausible();
    bool may_brake() const { return conditions_.model_known || rough_model_; }

    model::RobotParameters& parameters_;
    CyclePorts ports_;
    HostLink host_;
    ParameterService service_;
    SaveMailbox& mailbox_;
    supervisor::Supervisor supervisor_;
    supervisor::Conditions conditions_;
    control::WheelObserver<double> observer_;
    control::EncoderWatch encoder_watch_;
    control::Odometry<double> odometry_;
    MotionControl control_;
    Learning learning_;
    SlipWatch slip_;
    Learning::Sample sample_;
    Telemetry telemetry_;
    CycleReport report_;
    bool long_cycle_ = false;  // telemetry waits
    int adapted_since_ = 0;    // cycles that a new model waits for the controllers; 0: none does
    OverrunMonitor overrun_;
    BusMeter drive_meter_;
    BusMeter host_meter_;
    FrameBox<4> torques_;  // one for each drive
    FrameBox<24> outbox_;  // what the drives are asked besides

    std::atomic<bool> terminate_{false};
    bool finished_ = false;
    int ending_cycles_ = 0;

    CycleTime time_;
    std::uint64_t cycle_ = 0;
    std::int64_t send_phase_ns_;
    double elapsed_s_ = kCyclePeriod_s;
    MotionOutput output_;
    WheelPair<double> sent_torque_Nm_;
    bool effects_measured_ = false;
    double slip_limit_rad_per_s_ = 0;
    bool angles_known_ = false;
    std::int64_t sample_age_ns_ = 0;
    std::uint32_t foreign_control_ = 0;  // of both drives, by the end of the cycle before
    bool was_armed_ = false;
    bool was_ramping_ = false;
    bool drives_wanted_ = false;
    bool overran_ = false;
    bool enable_failed_ = false;
    bool identifying_ = false;
    bool rough_model_ = false;  // the controllers' model is the probe's, as none was known
    int resting_cycles_ = 0;
    WheelPair<double> slow_wheels_;            // speeds, averaged
    std::array<std::int64_t, 2> report_ns_{};  // of the drives' newest torque reports
    bool bus_lost_ = false;
    int refused_torques_ = 0;
    std::uint32_t send_refused_ = 0;
    std::uint32_t stale_feedback_cycles_ = 0;
    std::int64_t longest_wake_ns_ = 0;
    std::int64_t longest_execution_ns_ = 0;
    protocol::IdentSettings ident_settings_;
};

}  // namespace wheelwright::task
