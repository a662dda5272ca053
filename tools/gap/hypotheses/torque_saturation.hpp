// Torque that has a limit.
#pragma once

#include <string_view>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

template <>
struct HypothesisOf<model::TorqueSaturation> : Defaults<model::TorqueSaturation> {
    static constexpr std::string_view kSpecialCaseOf = "back_emf_limit";
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting& s) {
        StartingPoints from{{}, alone, as_it_is, roughly_one, {0.01 * s.peak_torque_Nm}};
        for (const double share : {0.93, 0.85, 0.72, 0.55, 0.4})
            from.points.push_back({share * s.peak_torque_Nm});
        return from;
    }
    // NOLINTEND(readability-magic-numbers)
};

}  // namespace wheelwright::gap
