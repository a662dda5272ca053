// Torque that is too small to be delivered.
#pragma once

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

template <>
struct HypothesisOf<model::DeadZone> : Defaults<model::DeadZone> {
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting& s) {
        StartingPoints from{{}, alone, scaled, near_one, {0.01 * s.peak_torque_Nm}};
        for (const double share : {0.03, 0.06, 0.12, 0.24}) from.points.push_back({share * s.peak_torque_Nm});
        return from;
    }
    // NOLINTEND(readability-magic-numbers)
};

}  // namespace wheelwright::gap
