// Speeds that are reported late.
#pragma once

#include "tools/gap/hypotheses/actuator_lag.hpp"
#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

// A first-order lag of the speeds reported is one of all that accelerates them: the torque and the products
// of the speeds as they were, which are those reported and the lag's time of what accelerates these.
class MeasurementLagTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = true;
    MeasurementLagTerm(const Parameters<double>& p, const Setting& s)
        : p_(p), s_(s), torque_(p, s), lagged_(p[0]) {}
    WheelPair<double> over(const Interval& i) override {
        const WheelPair<double> late = torque_.over(i);  // lagged less given
        const auto& k = s_.dynamics;
        const Twist<double> u = model::twist_from_wheel_speeds(s_.geometry, i.speed());
        const double v =
            u.v_m_per_s + p_[0] * (k.k5_m * square_ + k.k7_per_kg_m * (i.torque.sum() + late.sum()));
        const double omega =
            u.omega_rad_per_s +
            p_[0] * (k.k6_per_m * product_ + k.k8_per_kg_m2 * (i.torque.difference() + late.difference()));
        const double square = lagged_(square_, omega * omega, i.dt_s);
        const double product = lagged_(product_, v * omega, i.dt_s);
        const WheelPair<double> products =
            pair_for(s_, k.k5_m * (square - u.omega_rad_per_s * u.omega_rad_per_s),
                     k.k6_per_m * (product - u.v_m_per_s * u.omega_rad_per_s), 1);
        return {late.left + products.left, late.right + products.right};
    }

  private:
    Parameters<double> p_;
    Setting s_;
    ActuatorLagTerm torque_;
    Lag lagged_;
    double square_ = 0, product_ = 0;
};

template <>
struct HypothesisOf<model::MeasurementLag> : Defaults<model::MeasurementLag> {
    using Columns = MeasurementLagTerm;
    static constexpr bool kLate = true;
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting&) {
        return {{{0.01}, {0.025}, {0.06}, {0.15}}, alone, scaled, near_one, {0.001}};
    }
    // NOLINTEND(readability-magic-numbers)
};

}  // namespace wheelwright::gap
