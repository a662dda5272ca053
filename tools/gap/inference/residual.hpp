// What a search leaves: whether that depends on a place of places.hpp, and what follows for the verdict.
#pragma once

#include <span>
#include <vector>

#include "tools/gap/inference/search.hpp"
#include "tools/gap/inference/sensor_evidence.hpp"
#include "tools/gap/model/rows.hpp"

namespace wheelwright::gap {

struct ResidualOptions {
    Setting setting;                 // with K5..K8 as found
    model::EffectSet<double> found;  // `after`, as the search's own dictionary has it
    Known known;
    std::span<const LogPart> training;
    BlockOptions blocks;  // without a dictionary: it has one of its own, without starting points
    bool turning = true;
};

struct Residual {
    std::vector<Place> where;
    Conclusion conclusion;  // the search's, as the places leave it
};
// Costs a pass over the training parts.
Residual residual_of(const Search& search, const ResidualOptions& options);

}  // namespace wheelwright::gap
