// Speeds that are reported late.
#pragma once

#include <array>

#include "tools/gap/hypotheses/actuator_lag.hpp"
#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

// With F a lag of the first order by the time T, the speeds reported are y = F[v]: they accelerate by what F
// makes of the torque and of the products of the speeds as they are, v = y + T dy/dt. As F undoes 1 + T d/dt,
// F[v w] is the product of the speeds reported and F[T dy/dt T dz/dt]; and T dy/dt is, that much later,
// y - F[y].
class MeasurementLagTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = true;
    MeasurementLagTerm(const Parameters<double>& p, const Setting& s) : s_(s), torque_(p, s), lagged_(p[0]) {}
    WheelPair<double> over(const Interval& i) override {
        const WheelPair<double> late = torque_.over(i);  // lagged less given
        const Twist<double> u = model::twist_from_wheel_speeds(s_.geometry, i.speed());
        const double v = u.v_m_per_s - lagged_(v_m_per_s_, u.v_m_per_s, i.dt_s);
        const double omega = u.omega_rad_per_s - lagged_(omega_rad_per_s_, u.omega_rad_per_s, i.dt_s);
        const WheelPair<double> products =
            pair_for(s_, s_.dynamics.k5_m * omega * omega, s_.dynamics.k6_per_m * v * omega, 1);
        return {late.left + products.left, late.right + products.right};
    }

  private:
    Setting s_;
    ActuatorLagTerm torque_;
    Lag lagged_;
    double v_m_per_s_ = 0, omega_rad_per_s_ = 0;
};

template <>
struct HypothesisOf<model::MeasurementLag> : Defaults<model::MeasurementLag> {
    using Columns = MeasurementLagTerm;
    static constexpr bool kLate = true;
    // A filter behind the wheels does the same to what they report as one in the torque's way.
    static constexpr std::array kUnlessMeasured{
        Confounder{"actuator_lag", 0,
                   "a gyro or an accelerometer: the torque may come late, as late as the speeds seem"}};
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting&) {
        return {{{0.01}, {0.025}, {0.06}, {0.15}}, alone, scaled, near_one, {0.001}};
    }
    // NOLINTEND(readability-magic-numbers)
};

}  // namespace wheelwright::gap
