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
        // what loses so many times as much of the largest torque
        const auto limit = [peak = s.peak_torque_Nm](const Parameters<double>& at, const Eigen::VectorXd& a) {
            return Parameters<double>{peak - a(0) * (peak - at[0])};
        };
        StartingPoints from{{}, alone, limit, roughly_one, {0.01 * s.peak_torque_Nm}};
        for (const double share : {0.93, 0.85, 0.72, 0.55, 0.4})
            from.points.push_back({share * s.peak_torque_Nm});
        look_beside(from, s);
        return from;
    }
    // NOLINTEND(readability-magic-numbers)
};

}  // namespace wheelwright::gap
