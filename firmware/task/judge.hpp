// The second step of a cycle: what has been observed, told and counted becomes conditions, for the supervisor
// to decide on. What it must remember of earlier cycles it keeps here, so that the conditions themselves are
// of this cycle only.
//
// Threads: the cycle's. No call allocates, blocks or throws.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "drivers/motor_drive.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/supervisor/supervisor.hpp"
#include "firmware/task/senses.hpp"
#include "hal/plain_memory.hpp"

namespace wheelwright::task {

// A drive as it is judged.
struct DriveSight {
    drivers::DriveState state{};
    drivers::DriveFault fault{};
    drivers::ArmRefusal refusal{};
    std::int64_t encoder_time_ns = 0;
    std::uint32_t foreign_control = 0;  // counted so far

    static DriveSight of(const drivers::MotorDrive& drive) {
        return {drive.state(), drive.fault(), drive.refusal(), drive.feedback().encoder_time_ns,
                drive.counters().foreign_control};
    }
};

struct Evidence {
    const Observed& seen;
    const DriveSight& left;
    const DriveSight& right;
    const WheelPair<Real>& wheel_radius_m;
    bool wants_armed = false;            // the drives, as the cycle before left it
    bool braking = false;                // the same
    std::uint32_t strangers = 0;         // frames of another firmware, counted so far
    const supervisor::Conditions& told;  // what needs no judging
};

// Older than the limit, or never.
inline bool stale(std::int64_t time_ns, std::int64_t now_ns, double limit_s) {
    return time_ns == 0 || 1e-9 * static_cast<double>(now_ns - time_ns) > limit_s;
}

class Judge {
  public:
    // `parameters` are the live ones.
    explicit Judge(const model::RobotParameters& parameters) : parameters_(parameters) {}

    // After a change of parameters.
    void configure();
    supervisor::Conditions judge(const Evidence& evidence);

    std::uint32_t stale_feedback_cycles() const { return stale_feedback_cycles_; }
    std::uint32_t foreign_control() const {
        return foreign_control_;
    }  // counted by both drives and the host link

    std::span<std::byte> memory() { return hal::plain_memory(effects_measured_, *this); }

  private:
    bool beyond_speed_limits(const Twist<double>& twist, double by_m_per_s) const;
    bool encoders_over_speed(const control::EncoderSpeed& encoders) const;

    const model::RobotParameters& parameters_;
    bool effects_measured_ = false;
    std::uint32_t foreign_control_ = 0;
    std::uint32_t stale_feedback_cycles_ = 0;
    WheelPair<Real> slow_rims_m_per_s_;  // averaged
    bool encoders_over_speed_ = false;
    int resting_cycles_ = 0;
    // Until so long after a torque the averaged speeds may not know yet of what it has begun: those of now
    // count as well.
    static constexpr int kSlowCycles = 100;
    int unpushed_cycles_ = kSlowCycles;
};

}  // namespace wheelwright::task
