// Torque that comes late.
#pragma once

#include <array>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

template <>
struct HypothesisOf<model::TransportDelay> : Defaults<model::TransportDelay> {
    static constexpr bool kLate = true;
    // Speeds that are reported late look like torque that comes late.
    static constexpr std::array kUnlessMeasured{
        Confounder{"measurement_lag", 0,
                   "a gyro or an accelerometer: the speeds may be told late, as late as the torque seems"}};
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting&) {
        return {{{0.002}, {0.004}, {0.008}, {0.016}, {0.03}}, alone, scaled, near_one, {0.0005}};
    }
    // NOLINTEND(readability-magic-numbers)
};

}  // namespace wheelwright::gap
