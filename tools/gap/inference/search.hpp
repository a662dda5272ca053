// The search: which effects of the catalogue, if any, explain where measurement
// and model part. docs/gap.md says how.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "firmware/model/effects.hpp"
#include "tools/gap/inference/policy.hpp"
#include "tools/gap/inference/verdict.hpp"
#include "tools/gap/model/members.hpp"

namespace wheelwright::gap {

struct SearchOptions {
    const Dictionary* dictionary = nullptr;  // that the blocks were made with
    model::EffectSet<double> base;           // effects that the model has already; refitted
    Points given;                            // effects that are known otherwise, and are not refitted
    std::vector<std::size_t> excluded;       // known not to be there
    std::vector<std::size_t> rivals_only;    // not named
    std::vector<std::size_t> shown;          // surely there, whatever the rows say
    double large_gap = kPolicy.gap;          // more left than this is not explained
    double most_report_lag_s = std::numeric_limits<double>::infinity();  // that the gyro allows
    bool white_noise = true;  // the sensors' noise is, so that more than it is something
    bool turning = true;
    std::optional<double>
        k7_per_kg_m;  // held: nothing drives the robot forward, and the log does not tell it
};

struct Search {
    Conclusion conclusion;  // from the wheels' accelerations alone
    std::vector<NamedEffect> effects;
    std::vector<std::string> unknowable;
    std::vector<Detectable> detectable;
    std::vector<Tried> tried;        // those in range that the log holds something of
    std::vector<Candidate> members;  // of `after`, in its order: first those of the base
    std::size_t base_members = 0;
    std::vector<std::size_t> shown;   // of the members, surely there by what is no row
    std::vector<Candidate> friction;  // that the log could show, whether it is there or not
    std::size_t blocks = 0;           // that it was fitted to
    Fit base;                         // without the named effects
    Fit after;                        // with them
    // By how much each rival, in the place of what it is a rival of, moves what else `after` has: as likely
    // as not the truth.
    std::vector<Eigen::VectorXd> moved_by_rivals;
    Points points;  // where the effects that are not linear fit best, for columns that are linearised there
    double gap_refit = 0, floor = 0,
           gap_after = 0;  // mean squared whitened residual
    double closable_torque_share = 0, residual_torque_share = 0;
    double timing_samples = 0, timing_error = 0;  // torque acts later than logged

    bool is_shown(std::size_t effect) const {
        return std::find(shown.begin(), shown.end(), effect) != shown.end();
    }
    // Not the usual friction, nor what comes late, nor what a sensor shows.
    bool may_be_denied(std::size_t effect) const;
};

// In `train`.
Search search(const BlockSet& train, const SearchOptions& options);

// K5..K8 that a fit does not know.
std::vector<std::string> unknowable(const Fit& fit, bool turning);

}  // namespace wheelwright::gap
