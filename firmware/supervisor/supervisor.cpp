#include "firmware/supervisor/supervisor.hpp"

#include <cstddef>
#include <limits>
#include <utility>

namespace wheelwright::supervisor {
namespace {

// Whether a rule's condition holds; without branches, as none does in most cycles.
bool any_holds(const Conditions& now) {
    return [&]<std::size_t... i>(std::index_sequence<i...>) {
        return (0U | ... | unsigned{now.*kFaultRules[i].when == kFaultRules[i].is}) != 0;
    }(std::make_index_sequence<kFaultRules.size()>{});
}

}  // namespace

Verdict Supervisor::step(const Conditions& now, const Requests& asked) {
    if (mode_ == Mode::boot) mode_ = Mode::idle;
    const bool was_armed = wants_armed();
    const bool was_ramping = ramping();
    const bool was_fault = mode_ == Mode::fault;
    Verdict verdict;
    if (asked.clear_fault) {
        const bool clears = clear(now);
        verdict.clear_drive_errors = clears && (was_fault || now.drive_error) && !wants_armed();
    }
    if (asked.mode) {
        blocker_ = refusal(*asked.mode, now);
        if (blocker_ == Blocker::none && config_.arming_needs_proof && !asked.proven && arms(*asked.mode)) {
            blocker_ = Blocker::not_authenticated;
        }
        verdict.refused = blocker_ != Blocker::none;
        if (!verdict.refused) verdict.entry = accept(*asked.mode);
    }
    if (phase_cycles_ < std::numeric_limits<std::int32_t>::max()) ++phase_cycles_;  // 24 days are not the end

    const bool stays_fault = mode_ == Mode::fault;
    verdict.entry = watch(now) ? Entry::none : advance(now, verdict.entry);

    verdict.mode = mode_;
    verdict.owner = owner();
    verdict.armed = wants_armed();
    verdict.begins_braking = ramping() && !was_ramping;
    // A stop goes to drives that are believed idle too.
    const bool stops = mode_ == Mode::fault && (!stays_fault || now.stop_message || now.foreign_control);
    if (verdict.armed && !was_armed) verdict.order = DriveOrder::arm;
    if (!verdict.armed && (was_armed || stops)) verdict.order = DriveOrder::disarm;
    cleared_by_ = mode_ == Mode::fault ? remedy(now) : Remedy::none;
    return verdict;
}

Blocker Supervisor::refusal(Mode wanted, const Conditions& now) const {
    if (unsigned(wanted) >= kModeCount || rule_of(wanted).from == From::nowhere) return Blocker::unknown_mode;
    if (mode_ == Mode::fault) return Blocker::fault_latched;
    const bool from_here = mode_ == Mode::idle || mode_ == wanted || rule_of(wanted).from != From::idle;
    if (!from_here) return Blocker::not_idle;
    const Requirement* rule = unmet(kEntryRules, rule_of(wanted).needs, now);
    return rule == nullptr ? Blocker::none : rule->otherwise;
}

// The drives are idle, or on the way to another mode: what is under way already needs no second leave.
bool Supervisor::arms(Mode wanted) const {
    return drives(wanted) && !drives(mode_) && !(phase_ == Phase::arming && wanted == requested_);
}

// Leaves the fault mode for idle when the fault's cause is gone and the robot stands. Outside it there is
// nothing to clear but the drives' errors.
bool Supervisor::clear(const Conditions& now) {
    if (mode_ != Mode::fault) return true;
    blocker_ = kPhases[unsigned(phase_)].keeps_the_fault;
    const ClearRule* rule = unmet(kClearRules, kNothing, now);
    if (blocker_ == Blocker::none && rule != nullptr) blocker_ = rule->otherwise;
    if (blocker_ != Blocker::none) return false;
    mode_ = requested_ = Mode::idle;
    fault_ = Fault::none;
    return true;
}

Remedy Supervisor::remedy(const Conditions& now) const {
    const ClearRule* rule = unmet(kClearRules, kNothing, now);
    const Remedy remedy = rule == nullptr ? Remedy::clear_fault : rule->remedy;
    return remedy == Remedy::clear_fault && ramping() ? Remedy::standstill : remedy;
}

// Asking again for what is under way does not give it more time.
Entry Supervisor::accept(Mode wanted) {
    const bool goes_on = wanted == mode_ && phase_ == Phase::steady;
    requested_ = wanted;
    if (goes_on) return Entry::none;
    if (!drives(wanted)) {
        // From motion: brake first. Arming is simply given up.
        to(drives(mode_) ? Phase::ramping : Phase::steady);
    } else if (drives(mode_)) {
        enter(wanted);
        return Entry::from_driving;
    } else {
        to(Phase::arming);
    }
    return Entry::none;
}

void Supervisor::to(Phase phase) {
    if (phase_ != phase) phase_cycles_ = 0;
    phase_ = phase;
}

void Supervisor::enter(Mode mode) {
    mode_ = mode;
    to(Phase::steady);
}

// Arming and ramping to idle are watched by the rules of the driving modes, and so is a latched fault: what
// would have coasted ends its ramp. True: a fault was latched in this cycle.
bool Supervisor::watch(const Conditions& now) {
    if (!any_holds(now)) return false;
    const std::uint16_t watched = mode_ == Mode::fault      ? kDriving
                                  : phase_ == Phase::arming ? bit(requested_)
                                                            : bit(mode_);
    const std::uint32_t exempt = kPhases[unsigned(phase_)].exempt;
    const FaultRule* first = nullptr;
    bool ramp = true;
    for (const FaultRule& rule : kFaultRules) {
        if (now.*rule.when != rule.is || (rule.modes & watched) == 0 || (exempt & bit(rule.fault)) != 0) {
            continue;
        }
        if (first == nullptr) first = &rule;
        ramp = ramp && rule.ramps != kCoast && config_.stops.*rule.ramps;
    }
    if (first == nullptr) return false;
    if (mode_ != Mode::fault) {
        stop(first->fault, ramp);
        return true;
    }
    if (first->dominates) fault_ = first->fault;
    if (!ramp) phase_ = Phase::steady;
    return false;
}

Entry Supervisor::advance(const Conditions& now, Entry entry) {
    switch (phase_) {
        case Phase::arming:
            if (now.arming_refused || phase_cycles_ > config_.arming_limit_cycles) {
                const Requirement* why = unmet(kArmingFailures, kDrives, now);
                blocker_ = why == nullptr ? Blocker::drives_not_armed : why->otherwise;
                stop(Fault::arming_refused, false);
            } else if (unmet(kArmedRules, rule_of(requested_).needs, now) == nullptr) {
                // What the request rested on may have changed since.
                blocker_ = refusal(requested_, now);
                if (blocker_ != Blocker::none) {
                    requested_ = Mode::idle;
                    phase_ = Phase::steady;
                } else {
                    enter(requested_);
                    return Entry::from_rest;
                }
            }
            break;
        case Phase::ramping:
            if (!now.rolling || phase_cycles_ > config_.ramp_limit_cycles) {
                phase_ = Phase::steady;
                if (mode_ != Mode::fault) mode_ = Mode::idle;
            }
            break;
        case Phase::steady:
            if (drives(mode_) && entry == Entry::none && now.mode_finished) {
                requested_ = Mode::idle;
                to(Phase::ramping);
            }
            break;
    }
    return entry;
}

void Supervisor::stop(Fault fault, bool ramp) {
    fault_ = fault;
    requested_ = Mode::idle;
    // A ramp makes sense only where a mode was driving.
    to(ramp && drives(mode_) ? Phase::ramping : Phase::steady);
    mode_ = Mode::fault;
}

}  // namespace wheelwright::supervisor
