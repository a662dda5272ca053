// Exponentials in plain arithmetic: the same bits on every machine, where mathematical libraries differ in
// the last one. For what simulation and firmware share. In double within 1e-15.
#pragma once

#include <array>
#include <cstddef>

namespace wheelwright::model {

// exp(-x) for x >= 0.
template <typename Real>
constexpr Real exp_minus(Real x) {
    if (!(x < Real(sizeof(Real) > 4 ? 700 : 85))) return 0;
    int halvings = 0;
    for (; x > Real(0.25); x /= 2) ++halvings;
    Real sum = 1;  // Horner's scheme of the series to x^12
    for (int k = 12; k > 0; --k) sum = 1 - sum * x / static_cast<Real>(k);
    for (; halvings > 0; --halvings) sum *= sum;
    return sum;
}

// (1 - exp(-x)) / x for x >= 0: the mean of exp(-t) over 0..x. Without divisions: 50 instructions for x to 1.
template <typename Real>
constexpr Real mean_exp_minus(Real x) {
    if (x > 4) return (1 - exp_minus(x)) / x;
    int halvings = 0;
    for (; x > 1; x /= 2) ++halvings;
    constexpr std::array<Real, 18> series = [] {  // (-1)^k / (k + 1)!
        std::array<Real, 18> c{};
        double term = 1;
        for (std::size_t k = 0; k < c.size(); ++k) {
            c[k] = static_cast<Real>(term);
            term /= -static_cast<double>(k + 2);
        }
        return c;
    }();
    Real mean = series.back();
    for (std::size_t k = series.size() - 1; k-- > 0;) mean = mean * x + series[k];
    // over twice the time: the first half's mean, and the second's, smaller by exp(-x) = 1 - x mean
    for (; halvings > 0; --halvings, x *= 2) mean *= 1 - x * mean / 2;
    return mean;
}

}  // namespace wheelwright::model
