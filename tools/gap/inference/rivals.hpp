// What would tell named effects from their rivals: a motion, or another measurement.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "tools/gap/inference/search.hpp"
#include "tools/gap/inference/separating_motion.hpp"

namespace wheelwright::gap {

// Rivals by what was not measured, in the place of what the search says of them, unless they are `excluded`.
// Drag in proportion to speed that takes most of the torque is what a torque column holds that was made from
// the motors' voltage: their back-EMF was not taken off. And a torque that comes late is what speeds show
// that are told late.
void name_unmeasured(std::vector<NamedEffect>& effects, std::span<const std::size_t> excluded);

// Sets the motion of each rival that a motion may tell. `robot`: as found; its effect and rival are not
// looked at. Costs a simulation of every motion for each of them.
void advise_motions(std::vector<NamedEffect>& effects, Confusion robot);

}  // namespace wheelwright::gap
