// The list of trials: fixed by the seed, so that any part of it can be run anywhere and merged by name.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tools/gap_trials/hidden/trial.hpp"

namespace wheelwright::hidden {

struct ListedTrial {
    TrialPlan plan;
    std::string plant;
};

// For each plant: all effects x 3 sizes x 3 noise levels x 5 robots, 16 pairs x 10, 300 with nothing hidden,
// the two faults of logs x 3 x 3 x 5, and 12 effects under motions that hardly show them x 10. Names are
// drawn, so that a name tells nothing.
std::vector<ListedTrial> all_trials(std::uint64_t seed, const std::vector<std::string>& plants);

// `count` of them, drawn by the seed; all when there are not more. Every kind is in it as often as in the
// whole.
std::vector<ListedTrial> sample_of(std::vector<ListedTrial> trials, std::size_t count, std::uint64_t seed);

// A small sample in which no effect is missing: each one once, medium or strong at middle noise; 4 different
// pairs, 4 times nothing hidden, both faults of logs, 4 different effects under motions that hardly show
// them. Which ones, the seed draws, for each plant of `trials`, which is what all_trials gives.
std::vector<ListedTrial> every_effect_of(std::vector<ListedTrial> trials, std::uint64_t seed);

// The pairs that are tried.
std::span<const std::pair<std::string_view, std::string_view>> tried_pairs();

}  // namespace wheelwright::hidden
