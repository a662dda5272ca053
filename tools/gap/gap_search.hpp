// The search: which effects of the catalogue, if any, explain where measurement
// and model part. docs/gap.md says how; the thresholds are here and nowhere
// else.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "firmware/model/effects.hpp"
#include "tools/gap/gap_errors.hpp"
#include "tools/gap/gap_fit.hpp"

namespace wheelwright::gap {

// Thresholds. Shares are of 1.
inline constexpr double kSignificance = 0.01;         // of each test, after Holm over the catalogue,
inline constexpr double kSignificanceAlone = 0.02;    // and of the first effect
inline constexpr double kLeastShareOfClosable = 0.2;  // of the closable gap that is left
inline constexpr double kLeastShareOfAll = 0.001;     // of the closable gap at first
inline constexpr double kSizeOfInterest = 0.01;       // RMS of an effect's torque over RMS of the torque,
inline constexpr double kSizeOfInterestAlone = kSizeOfInterest / 3;  // where nothing else is found
inline constexpr double kSmallGap = 0.01;   // closable gap as a share of what torque does
inline constexpr double kLargeGap = 0.03;   // left over: unexplained
inline constexpr double kShareLeft = 0.10;  // of the closable torque, beside what was named: unexplained too
// What depends on a place is unexplained from these shares of the torque on, where nothing or something was
// named; in the latter case also of what all that explains. Columns that know nothing of an effect show part
// of it only.
inline constexpr double kShown = kSizeOfInterestAlone;
inline constexpr double kShownBeside = kSizeOfInterest / 2;
inline constexpr double kShareShownBeside = 0.2;
inline constexpr double kAlike = 0.999;  // likeness in this log above which no log like it separates
inline constexpr double kTied = 0.05;    // share of its gain that a rival may lose and still be tied
// A rival's loss below these shares of the gain is none: no model of a robot is so exact; where it is what
// both foretell, piece by piece, it is more surely the rival's.
inline constexpr double kTrifleOfGain = 0.0005;
inline constexpr double kTrifleOfGainForetold = 0.0001;
inline constexpr std::size_t kMostEffects = 4;

enum class Verdict { named, nothing_missing, cannot_tell, unexplained, unusable_log };
const char* verdict_name(Verdict verdict);

struct Motion;

struct Rival {
    std::size_t effect = 0;
    bool alike = false;   // no motion in this log tells them apart
    bool richer = false;  // has more to choose, and is not surely better for it: the simpler one is named
    bool coarse = false;  // judged at the first look's points only, and may do better between them
    double keeps = 0;     // share of the gain that it keeps in the winner's place
    // A drag that a torque column made from voltage would show; the motors' currents would tell.
    bool torque_is_voltage = false;
    // Driven with this size it tells them apart best (motions.hpp); null: none is known.
    const Motion* motion = nullptr;
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
};

struct Place {
    std::string name;
    double explains = 0;  // share of what is missing beside the base
};

struct Detectable {
    std::size_t effect = 0;
    std::vector<double> size;  // by parameter, or by coordinate where those
                               // differ; infinite: not in this log
};

struct SearchOptions {
    const Dictionary* dictionary = nullptr;  // that the blocks were made with
    model::EffectSet<double> base;           // effects that the model has already; refitted
    Points given;                            // effects that are known otherwise, and are not refitted
    std::vector<std::size_t> excluded;       // known not to be there
    double large_gap = kLargeGap;            // more left than this is not explained
    bool white_noise = true;                 // the sensors' noise is, so that more than it is something
    std::vector<std::size_t> confirmed;      // found by an earlier look, whose confirming blocks agreed
    bool turning = true;
};

struct Search {
    Verdict verdict = Verdict::unexplained;
    std::string reason;  // of the verdict, one sentence
    std::vector<NamedEffect> effects;
    std::vector<std::string> unknowable;
    std::vector<Place> where;  // the analysis' own (gap_places.hpp), not the search's
    std::vector<Detectable> detectable;
    std::vector<Way> members;  // of `after`, in its order: first those of the base
    std::size_t base_members = 0;
    std::size_t blocks = 0;  // that it was fitted to
    Fit base;                // without the named effects
    Fit after;               // with them
    // Where nothing could be named, yet much is missing: with the two effects that gain most, surely there or
    // not. Its K5..K8 are likelier than the base's.
    std::optional<Fit> guess;
    Points points;  // where the effects that are not linear fit best, for a dictionary with a closer look
    double gap_refit = 0, floor = 0,
           gap_after = 0;  // mean squared whitened residual
    double closable_torque_share = 0, left_torque_share = 0;
    double closable_share =
        0;  // of the closable gap, closed, on blocks that took no part; NaN: only sensors err
    double timing_samples = 0, timing_error = 0;  // torque acts later than logged
};

// `train` selects and confirms, `report` (may be empty) only tells how it
// turned out.
Search search(const BlockSet& train, const std::vector<Block>& report, const SearchOptions& options);

// The effects of a fit with these members.
model::EffectSet<double> effects_of(const std::vector<Way>& members, const Fit& fit, const Setting& setting);

// K5..K8 that a fit does not know.
std::vector<std::string> unknowable(const Fit& fit, bool turning);

// Takes the named effects' parameters and intervals from `after` anew, once that has been refined.
void take_refined(Search& search, const Setting& setting);

// The columns that an effect's presence is told by.
std::vector<Amount> directions(const Way& way);

}  // namespace wheelwright::gap
