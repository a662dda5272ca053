// Decides which mode drives the wheels. Runs the tables of modes.hpp; knows nothing of control, CAN or
// drives. Permission to drive is off at start, lost at once, and regained only by a deliberate act.
//
// One machine with one step: what it decides is a function of (state, requests, conditions). A test visits
// every state with every pair of events.
//
// Threads: the cycle's. Cost: a fixed pass over the tables, no loops that depend on data.
#pragma once

#include <cstdint>
#include <optional>

#include "firmware/supervisor/modes.hpp"

namespace wheelwright::supervisor {

struct SupervisorConfig {
    StopChoices stops;
    std::int32_t arming_limit_cycles = 2000;
    std::int32_t ramp_limit_cycles = 1000;
    bool arming_needs_proof = false;  // a mode that arms the drives is entered only if its request is proven
};

// What the host asks in a cycle. A clearing comes before a mode.
struct Requests {
    bool clear_fault = false;
    std::optional<Mode> mode;
    bool proven = false;  // whoever asks for the mode has shown that he holds the key
};

// In this cycle a mode's law starts anew: with its set-points forgotten, or only those that have stopped
// coming.
enum class Entry : std::uint8_t { none, from_rest, from_driving };

enum class DriveOrder : std::uint8_t { none, arm, disarm };

// What a cycle has decided.
struct Verdict {
    Mode mode = Mode::boot;
    Owner owner = Owner::nobody;
    Entry entry = Entry::none;
    DriveOrder order = DriveOrder::none;
    bool armed = false;           // the drives shall be armed, or shall be idle
    bool begins_braking = false;  // in this cycle
    bool clear_drive_errors = false;
    bool refused = false;  // the mode that was asked for; blocker() says why
};

class Supervisor {
  public:
    explicit Supervisor(const SupervisorConfig& config) : config_(config) {}

    // One cycle. The first one leaves boot for idle. A request stands (the mode may then be entered some
    // cycles later, once the drives are armed), or is refused and has changed nothing but the blocker.
    Verdict step(const Conditions& now, const Requests& asked = {});

    // How long the robot may brake before it coasts; in force at once.
    void set_ramp_limit(std::int32_t cycles) { config_.ramp_limit_cycles = cycles; }

    Mode mode() const { return mode_; }
    Phase phase() const { return phase_; }
    Mode requested() const { return requested_; }
    Fault fault() const { return fault_; }
    // Why the last request, or the arming for it, did not succeed; none after one that stood.
    Blocker blocker() const { return blocker_; }
    // What has to happen for the latched fault to be left; none: there is none.
    Remedy cleared_by() const { return cleared_by_; }

    // The drives shall be armed (or stay so), or shall be idle.
    bool wants_armed() const { return kPhases[unsigned(phase_)].arms || drives(mode_); }
    Owner owner() const {
        const Owner owner = kPhases[unsigned(phase_)].owner;
        return owner == Owner::law && !drives(mode_) ? Owner::nobody : owner;
    }
    bool may_drive() const { return owner() == Owner::law; }
    bool ramping() const { return owner() == Owner::brake; }

  private:
    Blocker refusal(Mode wanted, const Conditions& now) const;
    bool arms(Mode wanted) const;
    bool clear(const Conditions& now);
    Remedy remedy(const Conditions& now) const;
    Entry accept(Mode wanted);
    void enter(Mode mode);
    bool watch(const Conditions& now);
    Entry advance(const Conditions& now, Entry entry);
    void to(Phase phase);
    void stop(Fault fault, bool ramp);

    SupervisorConfig config_;
    Mode mode_ = Mode::boot;
    Mode requested_ = Mode::idle;
    Phase phase_ = Phase::steady;
    Fault fault_ = Fault::none;
    Blocker blocker_ = Blocker::none;
    Remedy cleared_by_ = Remedy::none;
    std::int32_t phase_cycles_ = 0;
};

}  // namespace wheelwright::supervisor
