// Wheels of unequal radii.
#pragma once

#include <algorithm>
#include <cmath>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

// The body moves as the true radii say, and each wheel gives it force by its own. The wheels' rotation is the
// same whatever their radii are. Half of what lies between this and the opposite mismatch: what both have in
// common is of the second order, and looks like another K7.
class RadiusMismatchTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = true;
    RadiusMismatchTerm(const Parameters<double>& p, const Setting& s)
        : is_(model::WheelRadiusMismatch::geometry(p, s.geometry)),
          opposite_(model::WheelRadiusMismatch::geometry<double>({1 / (1 + p[0]) - 1}, s.geometry)) {
        const double turning =
            1 - std::min(model::rotation_share_turning(s.dynamics, s.geometry.track_m), 0.5);
        body_ = {s.dynamics.k5_m / kBodysShare, s.dynamics.k6_per_m / turning,
                 s.dynamics.k7_per_kg_m / kBodysShare, s.dynamics.k8_per_kg_m2 / turning};
    }
    bool slow() const override { return true; }
    WheelPair<double> over(const Interval& i) override {
        const WheelPair<double> is = moves_body(is_, i), opposite = moves_body(opposite_, i);
        return {(opposite.left - is.left) / 2, (opposite.right - is.right) / 2};
    }

  private:
    WheelPair<double> moves_body(const model::Geometry<double>& g, const Interval& i) const {
        const Twist<double> by = change(g, i);
        const WheelPair<double> torque =
            model::inverse_dynamics(body_, model::twist_from_wheel_speeds(g, i.speed()),
                                    TwistRate<double>{by.v_m_per_s / i.dt_s, by.omega_rad_per_s / i.dt_s});
        const double mean = g.mean_radius_m();
        return {torque.left * g.wheel_radius_m.left / mean, torque.right * g.wheel_radius_m.right / mean};
    }
    model::Geometry<double> is_, opposite_;
    model::Dynamics<double> body_;
};

template <>
struct HypothesisOf<model::WheelRadiusMismatch> : Defaults<model::WheelRadiusMismatch> {
    using Columns = RadiusMismatchTerm;
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting&) {
        return {{{0.02}}, alone, scaled, any_size, {0.002}};
    }
    // NOLINTEND(readability-magic-numbers)
    // As the share of the body.
    static Uncertainty uncertainty(const UncertaintyOf& of) {
        return {std::hypot(of.relative, model::kRotationShareError / kBodysShare)};
    }
};

}  // namespace wheelwright::gap
