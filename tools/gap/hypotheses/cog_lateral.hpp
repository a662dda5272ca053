// A centre of gravity beside the middle.
#pragma once

#include <cmath>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

class CogLateralTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = true;
    CogLateralTerm(const Parameters<double>& p, const Setting& s) : p_(p), s_(s) {}
    bool slow() const override { return true; }
    WheelPair<double> over(const Interval& i) override {
        const Twist<double> d = change(s_.geometry, i);
        return model::wheel_torque_Nm(
            s_.geometry, model::CogLateral::push(p_, s_.geometry, s_.dynamics,
                                                 {d.v_m_per_s / i.dt_s, d.omega_rad_per_s / i.dt_s}));
    }

  private:
    Parameters<double> p_;
    Setting s_;
};

template <>
struct HypothesisOf<model::CogLateral> : Defaults<model::CogLateral> {
    using Columns = CogLateralTerm;
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting&) {
        return {{{1}}, alone, scaled, any_size, {0.001}};
    }
    // NOLINTEND(readability-magic-numbers)
    // The acceleration of what has an offset acts on the mass, K7 tells of the mass with the wheels'
    // rotation. The columns do not know of it.
    static Uncertainty uncertainty(const UncertaintyOf& of) {
        return {std::hypot(of.relative, model::kRotationShareError / kBodysShare), 0, 1 / kBodysShare};
    }
};

}  // namespace wheelwright::gap
