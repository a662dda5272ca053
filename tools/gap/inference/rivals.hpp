// What would tell named effects from their rivals: a motion, or another measurement.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "tools/gap/inference/search.hpp"
#include "tools/gap/inference/separating_motion.hpp"

namespace wheelwright::gap {

// The effects with their rivals by what was not measured (Hypothesis::unless_measured), in the place of what
// the search says of these, unless they are `excluded` or speeds would have to be reported later than they
// may.
std::vector<NamedEffect> with_unmeasured_rivals(std::vector<NamedEffect> effects,
                                                std::span<const std::size_t> excluded,
                                                double most_report_lag_s);

// The effects with the motion of each rival that a motion may separate. `robot`: as found; its effect and
// rival are not used. Costs a simulation of every motion for each of them.
std::vector<NamedEffect> with_motions(std::vector<NamedEffect> effects, Confusion robot);

}  // namespace wheelwright::gap
