// Tyres that slip as they push.
#pragma once

#include <cmath>

#include "tools/gap/hypotheses/hypothesis.hpp"
#include "tools/gap/hypotheses/tyre_slip.hpp"

namespace wheelwright::gap {

// p[2], which the catalogue does not have: by how much the share of the wheels' rotation is larger than the
// usual one.
class SlipTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = true;
    SlipTerm(const Parameters<double>& p, const Setting& s)
        : s_(s), slip_(p, s.geometry, s.dynamics, model::kRotationShare + p[2]), rolls_(p[3] > 0) {}
    WheelPair<double> over(const Interval& i) override {
        if (rolls_) return as_it_rolls(i);
        // at the very first it has settled
        if (first_) slip_.advance(i.torque, i.dt_s);
        first_ = false;
        const double mean = slip_.mean_m_per_s();
        const double difference = slip_.difference_m_per_s();
        slip_.advance(i.torque, i.dt_s);
        const double forward = slip_.of_mean().bodys_share * (slip_.mean_m_per_s() - mean);
        const double turning = slip_.of_difference().bodys_share * (slip_.difference_m_per_s() - difference);
        // the body's speeds, not the wheels', make the products of speeds
        const Twist<double> wheels = model::twist_from_wheel_speeds(s_.geometry, i.speed());
        const double v = wheels.v_m_per_s - (mean + slip_.mean_m_per_s()) / 2;
        const double omega =
            wheels.omega_rad_per_s - (difference + slip_.difference_m_per_s()) / 2 / s_.geometry.track_m;
        const double square = omega * omega - wheels.omega_rad_per_s * wheels.omega_rad_per_s;
        const double product = v * omega - wheels.v_m_per_s * wheels.omega_rad_per_s;
        return pair_for(s_, forward + i.dt_s * s_.dynamics.k5_m * square,
                        turning / s_.geometry.track_m + i.dt_s * s_.dynamics.k6_per_m * product, i.dt_s);
    }

  private:
    // Slip in proportion to force and speed, settled. It has the size of the other law at half of the
    // largest speed.
    WheelPair<double> as_it_rolls(const Interval& i) const {
        const double usual_rad_per_s = s_.peak_speed_rad_per_s / 2;
        const auto changed = [&](double WheelPair<double>::*side) {
            return (std::abs(i.after.*side) * (i.torque.*side) -
                    std::abs(i.before.*side) * (i.torque_before.*side)) /
                   (s_.geometry.wheel_radius_m.*side * usual_rad_per_s);
        };
        const double left = changed(&WheelPair<double>::left);
        const double right = changed(&WheelPair<double>::right);
        const auto per_force = [](const TyreSlip::Settling& of) {
            return of.bodys_share * of.slip_per_force;
        };
        return pair_for(s_, per_force(slip_.of_mean()) * (left + right) / 2,
                        per_force(slip_.of_difference()) * (right - left) / s_.geometry.track_m, i.dt_s);
    }

    Setting s_;
    TyreSlip slip_;
    bool rolls_;
    bool first_ = true;
};

// Slip speed of the effect, with a coefficient of 1, for a slip of 1 m/s per Nm and rad/s of a rolling wheel.
inline double slip_speed_per(const Setting& s) {
    const Parameters<double> unit{1, 1};
    const auto settled = model::WheelSlip::forward(unit, s.geometry, s.dynamics);
    return s.geometry.mean_radius_m() * s.peak_speed_rad_per_s / 2 /
           (settled.bodys_share * settled.slip_per_force);
}

template <>
struct HypothesisOf<model::WheelSlip> : Defaults<model::WheelSlip> {
    using Columns = SlipTerm;
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting&) {
        // how much force is the limit does not show where none is reached
        return {{{1, 0.3}},
                alone,
                [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                    return Parameters<double>{at[0], at[1] * a(0)};
                },
                [](const Eigen::VectorXd& a) { return a(0) > 0; },
                {0, 0.005},
                {0, 0, 0.01},
                model::kRotationShareError};
    }
    // NOLINTEND(readability-magic-numbers)
    // A log tells the product of the force's limit and the slip speed.
    static Uncertainty uncertainty(const UncertaintyOf&) { return {kProductOnly}; }
};

}  // namespace wheelwright::gap
