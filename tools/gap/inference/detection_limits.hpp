// How large an effect would have had to be to be named in a log.
#pragma once

#include <vector>

#include "tools/gap/inference/evidence.hpp"
#include "tools/gap/inference/search.hpp"

namespace wheelwright::gap {

// The smallest size of each effect that is not among `found` and would have been named beside that, four
// times of five: as certain as the acceptance asks, and of interest. detection.hpp puts it to the test.
std::vector<Detectable> detectable(const Evidence& evidence, const Members& found);

}  // namespace wheelwright::gap
