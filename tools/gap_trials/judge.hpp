// The judge of the blind trials: what an analysis said of one log against the label, and the measures of all.
// Knows the form of gap.json and of the labels, nothing of how either came about.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tools/gap_trials/measures.hpp"

namespace wheelwright::tools {

// What was hidden, read from a label, and what the oracle says.
struct Truth {
    std::string id;
    std::string plant;
    std::string kind;   // single, pair, nothing, fault, blind
    std::string noise;  // low, middle, high
    std::string motions;
    double rate_Hz = 0;
    bool gyro = false;
    struct Effect {
        std::string name;
        std::string size;  // mild, medium, strong
        std::map<std::string, double> parameters;
        std::map<std::string, bool> linear;
    };
    std::vector<Effect> effects;
    // Whether noise-free data tell the effects from every rival; with nothing hidden, true.
    bool identifiable = true;
    std::string confused_with;  // the nearest rival
};

// What an analysis said.
struct Finding {
    std::string verdict;  // as gap.json has it; "no_answer" when there is no readable gap.json
    struct Parameter {
        std::string name;
        double value = 0;
        std::optional<std::pair<double, double>> interval;
    };
    struct Effect {
        std::string name;
        std::vector<Parameter> parameters;
        std::vector<std::string> rivals;
    };
    std::vector<Effect> effects;
    std::optional<double> closable_share;
    // Free run over the unseen part, base model and extended one.
    std::optional<double> heldout_before_rad_per_s;
    std::optional<double> heldout_after_rad_per_s;
    // The same over windows of 5 s: the extended model, and the given one where one was given.
    std::optional<double> window_after_rad_per_s;
    std::optional<double> window_nominal_rad_per_s;
    std::vector<std::string> faults;  // of the log, as the catalogue of hidden effects calls them
    std::vector<std::string> where;   // places where model and measurement part, the most telling first
    double seconds = 0;
    double memory_bytes = 0;
    std::string problem;                   // why there is no answer
    std::vector<std::string> expressible;  // effects that this analysis knows; empty: all
};

// What the same logs are analysed with for comparison, as the tables call it.
inline constexpr std::string_view kStepwise = "stepwise BIC";
inline constexpr std::string_view kPysindy = "PySINDy, weak form";

// Of one parameter that was hidden and told.
struct ParameterError {
    std::string parameter;  // "effect.parameter"
    bool linear = false;
    double relative = 0;          // error over the true value
    double absolute = 0;          // in the parameter's unit
    std::optional<bool> covered;  // by the 95 % interval
};

// What was answered to a further analysis of the trial (further.hpp).
struct Further {
    std::vector<Finding> answers;  // in the order asked
    bool can_tell = true;          // the oracle: its logs tell what is asked
    // Where motions were driven to tell effects apart (advised.hpp): these, and the motions.
    std::vector<std::string> apart = {};
    std::string driven = {};
};

// How one trial went.
struct Outcome {
    Truth truth;
    Finding finding;
    bool exact = false;              // the named set is the hidden one
    bool contains = false;           // all hidden effects are named
    bool extra = false;              // names beside a right one
    bool confidently_wrong = false;  // named, and a hidden effect is neither named nor listed as a rival
    std::vector<ParameterError> errors;
    std::string said;                       // for the confusion matrix: names joined by "+", or the verdict
    std::map<std::string, Finding> beside;  // of other analyses of the same log, by name
    bool asked_further = false;  // all that apply; else what an advice asks for, where `further` has it
    std::map<std::string, Further> further;  // by name
};

// Throws std::runtime_error with one sentence when the text is no label.
Truth read_label(std::string_view json);

// A text that is not what it should be gives the verdict "no_answer".
Finding read_gap_json(std::string_view json);

Outcome judge(const Truth& truth, const Finding& finding);

// A trial's outcome as JSON and back, for resuming and merging. outcome_from_json throws std::runtime_error.
std::string outcome_json(const Outcome& outcome);
Outcome outcome_from_json(std::string_view json);

struct TrialCell {
    std::string effect, size, noise;
    std::size_t hits = 0;
    std::size_t n = 0;
    std::size_t excluded = 0;
};

struct Confusion {
    std::string hidden, said;
    std::size_t count = 0;
};

// One trial in a table of all.
struct TrialLine {
    std::string id, plant, kind, hidden, conditions, said;
    // "exact", "not named", "one of two", "named its rival, and said so", "a name too many", "wrong name",
    // "false alarm", "no answer"; with "not identifiable" where the oracle says so
    std::string judgement;
    bool sure_and_wrong = false;  // Outcome::confidently_wrong
};

struct Excluded {
    std::string effect;
    std::size_t count = 0;
    std::size_t n = 0;
    std::string rivals;  // with what they are confused
};

struct Share {
    std::size_t hits = 0;
    std::size_t n = 0;
    void add(bool hit) {
        hits += hit ? 1 : 0;
        ++n;
    }
};

// An analysis on the logs of a run; identifiable trials, but for `nothing`.
struct MethodRow {
    std::string name;
    bool measured = false;
    Share single, mild, pairs;  // named exactly; single: medium and strong
    Share expressible;          // of `single` those whose effect kPysindy has terms for
    Share alarms;               // where nothing is hidden
    Share wrong;                // confident wrong names, all trials
    double seconds = 0;         // of processor time, mean
};

// One trial whose effect was held out of the library (A7).
struct HeldOut {
    std::string id, hidden, size, said;
    std::string where;  // the first two places
    std::string judgement;
    bool sure_and_wrong = false;  // Outcome::confidently_wrong
};

struct Summary {
    std::vector<Measure> measures;
    std::vector<TrialCell> cells;       // of single effects
    std::vector<Confusion> confusions;  // of all trials
    std::vector<Excluded> excluded;     // single effects that the oracle calls not identifiable
    std::map<std::string, std::size_t> kinds;
    double seconds = 0;       // mean of an analysis
    double memory_bytes = 0;  // most of one
    std::size_t unanswered = 0;
    std::size_t wrong_names = 0;  // confidently wrong, of all trials
    std::vector<TrialLine> trials;
    std::vector<HeldOut> held_out;
    std::vector<MethodRow> methods;  // the judged analysis, kStepwise, kPysindy
};

Summary summarise(const std::vector<Outcome>& outcomes);

}  // namespace wheelwright::tools
