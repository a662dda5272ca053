// What would tell named effects from their rivals: a motion, or another measurement.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "tools/gap/gap_search.hpp"
#include "tools/gap/motions.hpp"

namespace wheelwright::gap {

// Drag in proportion to speed that takes most of the torque is what a torque column holds that was made from
// the motors' voltage: their back-EMF was not taken off. It becomes the drag's rival, in the place of what
// the search says of it, unless it is among `excluded`.
void name_voltage_drag(std::vector<NamedEffect>& effects, std::span<const std::size_t> excluded);

// Sets the motion of each rival that a motion may tell. `robot`: as found; its effect and rival are not
// looked at. Costs a simulation of every motion for each of them.
void advise_motions(std::vector<NamedEffect>& effects, Confusion robot);

}  // namespace wheelwright::gap
