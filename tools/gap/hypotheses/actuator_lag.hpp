// Torque that follows its command in a time.
#pragma once

#include <array>

#include "tools/gap/hypotheses/hypothesis.hpp"
#include "tools/gap/hypotheses/lag.hpp"

namespace wheelwright::gap {

class ActuatorLagTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = false;
    ActuatorLagTerm(const Parameters<double>& p, const Setting&) : lagged_(p[0]) {}
    WheelPair<double> over(const Interval& i) override {
        return {lagged_(state_.left, i.torque.left, i.dt_s) - i.torque.left,
                lagged_(state_.right, i.torque.right, i.dt_s) - i.torque.right};
    }

  private:
    Lag lagged_;
    WheelPair<double> state_;
};

template <>
struct HypothesisOf<model::ActuatorLag> : Defaults<model::ActuatorLag> {
    using Columns = ActuatorLagTerm;
    static constexpr bool kLate = true;
    // A filter in the torque's way does the same to the wheels as one behind them.
    static constexpr std::array kUnlessMeasured{
        Confounder{"measurement_lag", 0,
                   "a gyro or an accelerometer: the speeds may be told late, as late as the torque seems"}};
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting&) {
        return {{{0.006}, {0.012}, {0.025}, {0.05}, {0.1}}, alone, scaled, near_one, {0.0005}};
    }
    // NOLINTEND(readability-magic-numbers)
};

}  // namespace wheelwright::gap
