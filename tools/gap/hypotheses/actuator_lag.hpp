// Torque that follows its command in a time.
#pragma once

#include <array>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

// A first-order lag: the mean over an interval in which the input is held. What it keeps is computed once for
// intervals of one length.
class Lag {
  public:
    explicit Lag(double time_s) : time_s_(time_s) {}
    double operator()(double& state, double input, double dt_s) {
        if (!(time_s_ > 0)) return input;
        if (dt_s != dt_s_) {
            dt_s_ = dt_s;
            keeps_ = model::exp_minus(dt_s / time_s_);
            mean_ = model::mean_exp_minus(dt_s / time_s_);
        }
        const double away = state - input;
        state = input + away * keeps_;
        return input + away * mean_;
    }

  private:
    double time_s_;
    double dt_s_ = 0, keeps_ = 1, mean_ = 1;
};

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
