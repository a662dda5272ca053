// The measures that further analyses (further.hpp) are counted by.
//
// D3: two logs of one robot are answered alike when the verdict is the same and, where names are given, these
//   are the same set. Counted are trials of which the oracle says that each of the two logs can tell; how it
//   is with all stands in the remark.
#pragma once

#include <vector>

#include "tools/gap_trials/judge.hpp"

namespace wheelwright::tools {

std::vector<Measure> further_measures(const std::vector<Outcome>& outcomes);

}  // namespace wheelwright::tools
