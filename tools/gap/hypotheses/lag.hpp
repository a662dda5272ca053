// A first-order lag of what is held over each interval.
#pragma once

#include "firmware/model/exponential.hpp"

namespace wheelwright::gap {

// Gives the mean over an interval. What it keeps is computed once for intervals of one length.
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

}  // namespace wheelwright::gap
