// A gap between motor and wheel.
#pragma once

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

template <>
struct HypothesisOf<model::Backlash> : Defaults<model::Backlash> {
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting& s) {
        const double r = s.geometry.mean_radius_m();
        const double whole = s.effective_mass_kg() * r * r / 2;
        // How long the gap lasts depends on gap times inertia alone; the inertia is a usual one.
        constexpr double kMotorsShare = 0.75 * model::kRotationShare;
        StartingPoints from{{},
                            alone,
                            [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                                return Parameters<double>{at[0] * a(0), at[1]};
                            },
                            roughly_one,
                            {0.001, 0}};
        for (const double gap : {0.006, 0.0085, 0.012, 0.017, 0.024, 0.034, 0.048, 0.068, 0.096})
            from.points.push_back({gap, kMotorsShare * whole});
        look_beside(from, s);
        return from;
    }
    // NOLINTEND(readability-magic-numbers)
    // A log tells the product of gap and inertia.
    static Uncertainty uncertainty(const UncertaintyOf&) { return {kProductOnly}; }
};

}  // namespace wheelwright::gap
