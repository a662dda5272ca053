// Further analyses of a trial: the same analyser is asked again, with other logs of the same robot or with
// further words, after it has answered the log itself. Each is a process of its own that sees only what is
// written for it; the label is still sealed.
//
// To add one: a function `void NAME(const Asked&, Further&)`, its line in kFurther of further.cpp, and the
// measure that counts its answers in further_measures.cpp, by the same name. What it answers is stored with
// the trial's outcome, so that resuming and merging need nothing else.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "tools/gap_trials/hidden/trial.hpp"
#include "tools/gap_trials/judge.hpp"

namespace wheelwright::tools {

// What a further analysis may use.
struct Asked {
    const hidden::Trial& trial;
    const hidden::OracleVerdict& oracle;
    const hidden::PlantMaker& make_plant;
    const Finding& finding;          // what was answered to the trial's log
    std::filesystem::path log;       // the trial's log
    std::filesystem::path analysis;  // the folder with its gap.json
    // Writes a file beside the log, under the trial's name with this ending; removed as the log is.
    std::function<std::filesystem::path(const std::string& ending, const std::string& text)> write;
    // The answer to these logs as one experiment, `words` further words of the command line; what it wrote
    // lies in DIR/analyses/ID.NAME. Throws std::runtime_error when a file cannot be written; whatever the
    // analyser does is an answer.
    std::function<Finding(const std::string& name, const std::vector<std::filesystem::path>& logs,
                          const std::vector<std::string>& words)>
        analyse;
};

// Asks all that apply to this trial, or only whether the advised motions help: few trials end in an advice.
std::map<std::string, Further> ask_further(const Asked& asked, bool all);
// The true robot of a trial as a robot file, by the catalogue's conventions: K5..K8 of its masses, its
// effects.
std::string true_model_toml(const hidden::Trial& trial);

}  // namespace wheelwright::tools
