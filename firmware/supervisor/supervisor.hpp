// Decides which mode drives the wheels. Runs the table of modes.hpp; knows nothing of control, CAN or drives.
// Permission to drive is off at start, lost at once, and regained only by a deliberate act.
//
// Threads: the cycle's. Cost: a fixed pass over the tables, no loops that depend on data.
#pragma once

#include <cstdint>

#include "firmware/supervisor/modes.hpp"

namespace wheelwright::supervisor {

// What the supervisor is doing inside a mode.
enum class Phase : std::uint8_t {
    steady,   // the mode's own law drives
    arming,   // idle, on the way to `requested`: the drives are being armed
    ramping,  // braking to rest under the velocity loop, then torque zero
};

struct StopChoices {
    bool stale_command_ramps = false;
    bool over_speed_ramps = false;
    bool emergency_stop_ramps = false;
    bool overrun_ramps = false;
    bool terminate_ramps = true;
};

struct SupervisorConfig {
    StopChoices stops;
    std::int32_t arming_limit_cycles = 2000;
    std::int32_t ramp_limit_cycles = 1000;
};

class Supervisor {
  public:
    explicit Supervisor(const SupervisorConfig& config) : config_(config) {}

    // Leaves boot for idle; called once, when the first cycle's inputs are in place.
    void start() {
        if (mode_ == Mode::boot) mode_ = Mode::idle;
    }

    // Asks for a mode. Returns none when the request stands (the mode may then be entered some cycles later,
    // once the drives are armed); otherwise the reason, and nothing has changed.
    Blocker request(Mode wanted, const Conditions& now);

    // Leaves the fault mode for idle when the fault's cause is gone and the robot stands; otherwise the
    // reason.
    Blocker clear_fault(const Conditions& now);

    // How long the robot may brake before it coasts; in force at once.
    void set_ramp_limit(std::int32_t cycles) { config_.ramp_limit_cycles = cycles; }

    // One cycle. Call after the requests of this cycle.
    void step(const Conditions& now);

    Mode mode() const { return mode_; }
    Phase phase() const { return phase_; }
    Mode requested() const { return requested_; }
    Fault fault() const { return fault_; }
    Blocker blocker() const {
        return blocker_;
    }  // why the last request was rejected; none after one that stood

    // The drives shall be armed (or stay so), or shall be idle.
    bool wants_armed() const { return phase_ != Phase::steady || (bit(mode_) & kDriving) != 0; }
    // The active mode's law may command torque.
    bool may_drive() const { return phase_ == Phase::steady && (bit(mode_) & kDriving) != 0; }
    // The velocity loop shall brake to rest.
    bool ramping() const { return phase_ == Phase::ramping; }
    // In this cycle the mode's law starts anew.
    bool entered() const { return entered_; }

  private:
    Blocker blocker_into(Mode wanted, const Conditions& now) const;
    void enter(Mode mode);
    void stop(Fault fault, bool ramp);
    bool ramps(StopBy stop) const;
    bool exempt(Fault fault) const;

    SupervisorConfig config_;
    Mode mode_ = Mode::boot;
    Mode requested_ = Mode::idle;
    Phase phase_ = Phase::steady;
    Fault fault_ = Fault::none;
    Blocker blocker_ = Blocker::none;
    std::int32_t phase_cycles_ = 0;
    bool entered_ = false;
    bool entry_pending_ = false;  // request() changed the driving mode; the next step() announces it
};

}  // namespace wheelwright::supervisor
