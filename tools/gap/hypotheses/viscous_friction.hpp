// Drag in proportion to speed.
#pragma once

#include <array>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

template <>
struct HypothesisOf<model::ViscousFriction> : Defaults<model::ViscousFriction> {
    static constexpr bool kInEveryDriveTrain = true;
    // What a torque column holds that was made from the motors' voltage, their back-EMF not taken off: more
    // than friction could be.
    static constexpr std::array kUnlessMeasured{Confounder{
        "back_emf_limit", 0.5,
        "torque from the motors' currents: this one may be made from voltage, back-EMF not taken off"}};
};

}  // namespace wheelwright::gap
