// The outcome of blind trials as text, JSON and page.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "tools/cli/report.hpp"
#include "tools/gap_trials/judge.hpp"

namespace wheelwright::tools {

struct TrialsRun {
    std::string what;  // "sample of 30" or "campaign"
    std::uint64_t seed = 0;
    std::size_t listed = 0;  // trials of the list; fewer may be done
};

// Each plant's trials by themselves, where there are several plants.
using PlantSummaries = std::map<std::string, Summary>;

Report trials_report(const Summary& summary, const TrialsRun& run, const PlantSummaries& by_plant = {});

// One self-contained HTML file. Throws std::runtime_error when it cannot be written.
void write_trials_page(const Summary& summary, const TrialsRun& run, const std::string& path);

// Every measure that could be taken is at its accept level, no effect has more than 15 % of its cases
// excluded, and every trial was answered.
bool all_accepted(const Summary& summary);

}  // namespace wheelwright::tools
