// Kinds of fault times seeds, some seeds at a time.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "tools/cli/progress_line.hpp"
#include "tools/torture/trial.hpp"

namespace wheelwright::tools {

struct TortureCampaign {
    std::vector<const TortureKind*> kinds;
    std::uint64_t first_seed = 1;
    std::uint64_t seeds = 1;
    TorturedRobots robots = TorturedRobots::both;
    int report_period_ms = 1;  // of their encoders
    std::size_t jobs = 1;
};

struct TortureOutcome {
    std::vector<TortureResult> results;   // by seed, then kind; without their stories
    std::vector<std::string> not_driven;  // seeds whose robot does not drive even untouched, and why
};

// `progress` is called by one thread at a time. Fewer results when `stop` said so.
TortureOutcome run_torture(const TortureCampaign& campaign,
                           const std::function<void(const CampaignProgress&)>& progress,
                           const std::function<bool()>& stop);

// All that is known of one kind.
struct KindSummary {
    const TortureKind* kind = nullptr;
    std::size_t runs = 0, stopped = 0, false_trips = 0, violated = 0;
    double longest_zero_s = 0;
    double largest_deviation_m = 0;     // of those that went on
    std::vector<std::string> examples;  // of each rule: runs by mode, the first of them, up to 20 seeds
};
std::vector<KindSummary> summaries(const std::vector<const TortureKind*>& kinds,
                                   const std::vector<TortureResult>& results);

// Runs work(0) .. work(count - 1), `jobs` at a time.
void in_parallel(std::size_t count, std::size_t jobs, const std::function<bool()>& stop,
                 const std::function<void(std::size_t)>& work);

}  // namespace wheelwright::tools
