// A torque gain that goes down over the log.
#pragma once

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

template <>
struct HypothesisOf<model::GainDrift> : Defaults<model::GainDrift> {
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting& s) {
        StartingPoints from{{{0.1, 0}, {0.1, 0.15 * s.span_s}, {0.1, 0.4 * s.span_s}},
                            alone,
                            [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                                return Parameters<double>{at[0] * a(0), at[1]};
                            },
                            [](const Eigen::VectorXd& a) { return a(0) > 0 && a(0) < 9; },
                            {0.01, 0.02 * s.span_s}};
        from.apart_at_zero = 1;
        return from;
    }
    // NOLINTEND(readability-magic-numbers)
};

}  // namespace wheelwright::gap
