// Dry friction.
#pragma once

#include <string_view>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

template <>
struct HypothesisOf<model::CoulombFriction> : Defaults<model::CoulombFriction> {
    static constexpr bool kInEveryDriveTrain = true;
    static constexpr std::string_view kSpecialCaseOf = "stribeck_friction";
};

}  // namespace wheelwright::gap
