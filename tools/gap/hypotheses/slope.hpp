// A slope: gravity acts on the mass, K7 tells of the mass with the wheels' rotation. The columns know of it.
#pragma once

#include <cmath>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

template <>
struct HypothesisOf<model::Slope> : Defaults<model::Slope> {
    static Uncertainty uncertainty(const UncertaintyOf& of) {
        if (of.parameter == 0) return {std::hypot(of.relative, model::kRotationShareError / kBodysShare)};
        return {of.relative, kDirection_rad};
    }
};

}  // namespace wheelwright::gap
