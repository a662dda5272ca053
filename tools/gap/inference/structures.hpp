// What a model leaves that depends on a place (places.hpp).
#pragma once

#include <string_view>
#include <vector>

#include "tools/gap/model/fit.hpp"
#include "tools/gap/model/places.hpp"

namespace wheelwright::gap {

// Something that depends on a place, beside a model.
struct Structure {
    std::string_view place;
    double squares = 0;       // whitened, that it explains of blocks that it was not fitted to
    double torque_share = 0;  // RMS of the torque that would do the same over RMS of the torque
    bool sure = false;        // more than chance, all aspects considered
};
// One for each place, the best of its aspects, by what they explain.
std::vector<Structure> structures_beside(const Fit& model, const Blocks& blocks,
                                         const std::vector<Aspect>& aspects);

}  // namespace wheelwright::gap
