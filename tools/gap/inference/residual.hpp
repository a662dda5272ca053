// What a search leaves: whether the rest depends on a place of places.hpp, and what that changes of the
// verdict.
#pragma once

#include <span>

#include "tools/gap/inference/search.hpp"
#include "tools/gap/inference/sensor_evidence.hpp"
#include "tools/gap/model/rows.hpp"

namespace wheelwright::gap {

struct ResidualOptions {
    Setting setting;                 // with K5..K8 as found
    model::EffectSet<double> found;  // `after`, as the search's own dictionary has it
    Known known;
    std::span<const LogPart> training;
    BlockOptions blocks;  // without a dictionary: it has one of its own, without grids
    bool turning = true;
};

// Sets the places. What depends on one, by more than chance and by enough, is not explained by what was
// named: then the verdict is `unexplained`, with the reason. Costs a pass over the training parts.
void judge_residual(Search& search, const ResidualOptions& options);

}  // namespace wheelwright::gap
