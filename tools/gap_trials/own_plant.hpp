// The project's own simulated robot as a plant of the blind trials. Its mechanics are the firmware's effects;
// the drives' electronics are the trials' own formulas, as for the other plant, so that only the mechanics
// differ.
#pragma once

#include <memory>

#include "tools/gap_trials/hidden/plant.hpp"
#include "tools/gap_trials/hidden/robot.hpp"

namespace wheelwright::tools {

// For hidden::generate. Steps up to 0.5 ms.
std::unique_ptr<hidden::Plant> make_own_plant(const hidden::Robot& robot, const hidden::HiddenSet& hidden);

}  // namespace wheelwright::tools
