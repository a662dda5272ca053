// Wheels of unequal radii.
#pragma once

#include <cmath>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

class RadiusMismatchTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = true;
    RadiusMismatchTerm(const Parameters<double>& p, const Setting& s)
        : s_(s), real_(model::WheelRadiusMismatch::geometry(p, s.geometry)) {}
    bool slow() const override { return true; }
    WheelPair<double> over(const Interval& i) override {
        const Twist<double> seen = model::twist_from_wheel_speeds(s_.geometry, i.speed());
        const Twist<double> is = model::twist_from_wheel_speeds(real_, i.speed());
        const Twist<double> seen_change = change(s_, i);
        Setting real = s_;
        real.geometry = real_;
        const Twist<double> is_change = change(real, i);
        const auto& k = s_.dynamics;
        const double forward =
            k.k5_m * (is.omega_rad_per_s * is.omega_rad_per_s - seen.omega_rad_per_s * seen.omega_rad_per_s);
        const double turning =
            k.k6_per_m * (is.v_m_per_s * is.omega_rad_per_s - seen.v_m_per_s * seen.omega_rad_per_s);
        WheelPair<double> pair =
            pair_for(s_, seen_change.v_m_per_s - is_change.v_m_per_s + i.dt_s * forward,
                     seen_change.omega_rad_per_s - is_change.omega_rad_per_s + i.dt_s * turning, i.dt_s);
        // the smaller wheel pushes harder
        pair.left += i.torque.left * (s_.geometry.wheel_radius_m.left / real_.wheel_radius_m.left - 1);
        pair.right += i.torque.right * (s_.geometry.wheel_radius_m.right / real_.wheel_radius_m.right - 1);
        return pair;
    }

  private:
    Setting s_;
    model::Geometry<double> real_;
};

template <>
struct HypothesisOf<model::WheelRadiusMismatch> : Defaults<model::WheelRadiusMismatch> {
    using Columns = RadiusMismatchTerm;
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting&) {
        return {{{0.02}}, alone, scaled, any_size, {0.002}};
    }
    // NOLINTEND(readability-magic-numbers)
    // The acceleration of what has an offset acts on the mass, K7 tells of the mass with the wheels'
    // rotation. The columns do not know of it.
    static Uncertainty uncertainty(const UncertaintyOf& of) {
        return {std::hypot(of.relative, model::kRotationShareError / kBodysShare), 0, 1 / kBodysShare};
    }
};

}  // namespace wheelwright::gap
