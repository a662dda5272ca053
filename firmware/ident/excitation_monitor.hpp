// Persistence of excitation, parameter by parameter.
//
// Keeps the information (inverse of P) that the last `memory` of rows alone would give, by exponential
// forgetting, and compares it with what the estimate already rests on. information(i) = 1 / P_ii counts only
// what the other parameters' columns cannot explain, so a column that never changes, or always changes
// together with another, is seen as unexcited.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

#include "firmware/ident/ud_rls.hpp"

namespace wheelwright::ident {

template <typename Real, int N>
class ExcitationMonitor {
  public:
    using Vector = std::array<Real, N>;

    // lambda: forgetting for each row, 1 - row interval / memory. ceiling: variances at which a parameter
    // counts as not excited at all (> 0; those the estimator started from, or larger).
    void reset(Real lambda, const Vector& ceiling, int size = N) {
        ceiling_ = ceiling;
        window_.reset(Vector{}, ceiling, size);
        window_.set_forgetting(Forgetting::exponential, lambda);
        window_.keep_bounds_apart();
        for (int i = 0; i < size; ++i) window_.set_bounds(i, 0, ceiling[static_cast<std::size_t>(i)]);
    }

    // A row's regressor, scaled as the estimator's. Cost: one covariance update of size N.
    void push(const Vector& phi) {
        Vector unused;
        window_.update_gain(phi, unused);
    }
    // After one or two rows, before the next question. Costs about as much.
    void settle() { window_.keep_bounds(); }

    // Per unit of noise variance; 0 when the window says nothing about parameter i.
    Real information(int i) const {
        return std::max(Real(0), 1 / window_.variance(i) - 1 / ceiling_[static_cast<std::size_t>(i)]);
    }

    // What the window would add to an estimate of variance `held`, over what it holds already: about 1 under
    // steady excitation, 0 without any, large when the estimate knows little.
    Real excitation(int i, Real held) const { return held * information(i); }

  private:
    UdRls<Real, N, true> window_;
    Vector ceiling_{};
};

}  // namespace wheelwright::ident
