// Functions whose last bit differs between machines' mathematical libraries, written with plain arithmetic:
// the simulation gives the same bits wherever IEEE 754 holds. (sim_hal is compiled without contraction of
// products and sums for the same reason.)
#pragma once

#include <array>
#include <cstddef>

#include "firmware/model/sine_cosine.hpp"

namespace wheelwright::sim {

// exp(-x) for x >= 0; within 1e-15.
inline double exp_minus(double x) {
    if (!(x < 700)) return 0;
    int halvings = 0;
    for (; x > 0.25; x /= 2) ++halvings;
    double sum = 1;  // Horner's scheme of the series to x^12
    for (int k = 12; k > 0; --k) sum = 1 - sum * x / k;
    for (; halvings > 0; --halvings) sum *= sum;
    return sum;
}

// (1 - exp(-x)) / x for x >= 0: the mean of exp(-t) over 0..x. Within 1e-15. Called in each step of each
// wheel's torque, hence without divisions: 50 instructions for x to 1.
inline double mean_exp_minus(double x) {
    if (x > 4) return (1 - exp_minus(x)) / x;
    int halvings = 0;
    for (; x > 1; x /= 2) ++halvings;
    constexpr std::array<double, 18> series = [] {  // (-1)^k / (k + 1)!
        std::array<double, 18> c{};
        double term = 1;
        for (std::size_t k = 0; k < c.size(); ++k) {
            c[k] = term;
            term /= -static_cast<double>(k + 2);
        }
        return c;
    }();
    double mean = series.back();
    for (std::size_t k = series.size() - 1; k-- > 0;) mean = mean * x + series[k];
    // over twice the time: the first half's mean, and the second's, smaller by exp(-x) = 1 - x mean
    for (; halvings > 0; --halvings, x *= 2) mean *= 1 - x * mean / 2;
    return mean;
}

using model::sine_cosine;
using SineCosine = model::SineCosine<double>;

}  // namespace wheelwright::sim
