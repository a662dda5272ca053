// The search: which effects of the catalogue, if any, explain where measurement
// and model part. docs/gap.md says how.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "firmware/model/effects.hpp"
#include "tools/gap/gap_errors.hpp"
#include "tools/gap/gap_fit.hpp"
#include "tools/gap/gap_thresholds.hpp"

namespace wheelwright::excite {
struct Motion;
}

namespace wheelwright::gap {

enum class Verdict { named, nothing_missing, cannot_tell, unexplained, unusable_log };
const char* verdict_name(Verdict verdict);

struct Rival {
    std::size_t effect = 0;
    bool alike = false;   // no motion in this log tells them apart
    bool richer = false;  // has more to choose, and is not surely better for it: the simpler one is named
    bool coarse = false;  // judged at the first look's points only, and may do better between them
    double keeps = 0;     // share of the gain that it keeps in the winner's place
    std::string_view measurement;  // that would tell it, where no motion does; empty: none is known
    // Driven with this size it tells them apart best (motions.hpp); null: none is known.
    const excite::Motion* motion = nullptr;
    double motion_size_Nm = 0;
};

struct NamedEffect {
    std::size_t effect = 0;
    std::vector<ParameterEstimate> parameters;  // the catalogue's
    double closes = 0;                          // share of the closable gap
    double torque_share = 0;                    // RMS of its torque over RMS of the commanded
    double probability = 1;                     // that nothing is there, by the held-out blocks
    // By parameter, the standard error of what the fit does not move: the difference that one amount for both
    // wheels hides, the time of an event.
    std::vector<double> unmoved;
    std::vector<Rival> rivals;
    std::vector<Rival> ruled_out;  // that did worse in its place
    bool in_file = true;           // false: its law is another than the catalogue's
};

struct Place {
    std::string name;
    double explains = 0;  // share of what is missing beside the base
};

struct Detectable {
    std::size_t effect = 0;
    std::vector<double> size;  // by parameter; infinite: not in this log
    // The effect at so many times that size; each coordinate that the log shows by itself.
    std::function<std::vector<model::Parameters<double>>(double factor)> parameters;
};

// An effect at the best of its points, in all pieces, whether it is named or not: twice the logarithm of the
// likelihood ratio, which is as large as `unknowns` by chance if every row is one by itself.
struct Tried {
    std::size_t effect = 0, unknowns = 0;
    double beside_friction = 0;  // found
    double beside_found = 0;     // beside all that was found
};

struct SearchOptions {
    const Dictionary* dictionary = nullptr;  // that the blocks were made with
    model::EffectSet<double> base;           // effects that the model has already; refitted
    Points given;                            // effects that are known otherwise, and are not refitted
    std::vector<std::size_t> excluded;       // known not to be there
    std::vector<std::size_t> rivals_only;    // not named
    std::vector<std::size_t> shown;          // surely there, whatever the rows say
    double large_gap = kLargeGap;            // more left than this is not explained
    bool white_noise = true;                 // the sensors' noise is, so that more than it is something
    std::vector<std::size_t> confirmed;      // found by an earlier look, whose confirming blocks agreed
    bool turning = true;
    std::optional<double>
        k7_per_kg_m;  // held: nothing drives the robot forward, and the log does not tell it
};

struct Search {
    Verdict verdict = Verdict::unexplained;
    std::string reason;  // of the verdict, one sentence
    std::vector<NamedEffect> effects;
    std::vector<std::string> unknowable;
    std::vector<Place> where;  // the analysis' own (gap_places.hpp), not the search's
    std::vector<Detectable> detectable;
    std::vector<Tried> tried;  // those in range that the log holds something of
    std::vector<Way> members;  // of `after`, in its order: first those of the base
    std::size_t base_members = 0;
    std::vector<std::size_t> shown;  // of the members, surely there by what is no row
    std::vector<Way> friction;       // that the log could show, whether it is there or not
    std::size_t blocks = 0;          // that it was fitted to
    Fit base;                        // without the named effects
    Fit after;                       // with them
    // By how much each rival, in the place of what it is a rival of, moves what else `after` has: as likely
    // as not the truth.
    std::vector<Eigen::VectorXd> moved_by_rivals;
    // Where nothing could be named, yet much is missing: with the two effects that gain most, surely there or
    // not. Its K5..K8 are likelier than the base's.
    std::optional<Fit> guess;
    Points points;  // where the effects that are not linear fit best, for a dictionary with a closer look
    double gap_refit = 0, floor = 0,
           gap_after = 0;  // mean squared whitened residual
    double closable_torque_share = 0, left_torque_share = 0;
    // Of the closable gap, closed, by closed_share() (outcome.hpp): the analysis' own, not the search's.
    // NaN: only sensors err.
    double closable_share = 0;
    double timing_samples = 0, timing_error = 0;  // torque acts later than logged
};

// `train` selects and confirms.
Search search(const BlockSet& train, const SearchOptions& options);

// The effects of a fit with these members.
model::EffectSet<double> effects_of(const std::vector<Way>& members, const Fit& fit, const Setting& setting);

// K5..K8 that a fit does not know.
std::vector<std::string> unknowable(const Fit& fit, bool turning);

// Takes the named effects' parameters and intervals from `after` anew, once that has been refined.
void take_refined(Search& search, const Setting& setting);

// The columns that an effect's presence is told by.
std::vector<Amount> directions(const Way& way);

}  // namespace wheelwright::gap
