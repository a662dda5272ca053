// Runs blind trials: draws a robot, writes its log, lets a separate process analyse it, judges the answer.
//
//   DIR/logs/ID.csv            what the analyst sees; removed after a trial unless kept
//   DIR/analyses/ID/           what the analyst wrote: gap.json, output.txt and more
//   DIR/analyses/ID.NAME-1/    the same of a further analysis
//   DIR/labels/ID.json         the sealed label; written after the analysis, so that nobody can have read it
//   DIR/results/ID.json        the outcome; a trial that has one is not run again when resuming
//
// How a further analysis of a trial is added, further.hpp says.
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "tools/cli/progress_line.hpp"
#include "tools/gap_trials/hidden/plan.hpp"
#include "tools/gap_trials/judge.hpp"

namespace wheelwright::tools {

// Another analysis of the same logs, for comparison.
struct Comparison {
    std::string name;                  // as in the judge's tables
    std::vector<std::string> command;  // called with `LOG --wheel-radius R --track B --out D` behind it
};

struct CampaignOptions {
    std::filesystem::path out;
    std::string analyser;  // program; called as `analyser gap LOG --wheel-radius R --track B --out D`
    std::size_t jobs = 1;
    double time_limit_s = 600;  // of one analysis
    bool resume = false;
    bool keep_logs = false;
    std::vector<Comparison> beside;
    // Names of the trials that get all further analyses; if any do, every advice is followed.
    std::set<std::string> further;
};

// The names of every n-th trial of each kind, from the first one on; n 0: none.
std::set<std::string> every_nth(const std::vector<hidden::ListedTrial>& trials, std::size_t n);

// Whether `analyser gap --help` ends well.
bool can_analyse(const std::string& analyser);
// Whether a program with these words does, within a minute.
bool ends_well(const std::vector<std::string>& words);

// One trial from drawing to outcome. Throws std::runtime_error when the trial cannot be made or a file cannot
// be written; whatever the analyser does is an outcome.
Outcome run_trial(const hidden::ListedTrial& trial, const CampaignOptions& options);

// A trial that cannot be drawn (hidden::CannotDraw) is told to `progress` and left out.
// All trials, on options.jobs threads; `progress` is called from one thread at a time. Outcomes in the list's
// order. Throws the first error when all threads have ended. `stop` is asked between trials: true ends early,
// with the outcomes so far.
std::vector<Outcome> run_trials(const std::vector<hidden::ListedTrial>& trials,
                                const CampaignOptions& options,
                                const std::function<void(const CampaignProgress&)>& progress,
                                const std::function<bool()>& stop);

// The outcomes in DIR/results of those trials of the list that have one; of those in `further`, one with
// further analyses.
std::vector<Outcome> stored_outcomes(const std::vector<hidden::ListedTrial>& trials,
                                     const std::filesystem::path& out,
                                     const std::set<std::string>& further = {});

}  // namespace wheelwright::tools
