// Measures the time from a cycle's start to the centroid of the torque that was told in it: bus, drive and
// the drive's lag together, with its fraction of a cycle.
//
// The regressions of dynamics_estimator.hpp are given four torque columns, 2 ms apart, the first at the age
// that the samples are known to have. Over the band that the rows' averaging lets through, four taps
// reproduce any further delay of 0 to 6 ms with a lag, and the centroid of their coefficients is the centroid
// of the torque's response. Both equations are combined by their variances; the standard error knows the
// residuals' colour. One more column has the other torque, the difference in y1 and the sum in y2: of wheels
// that are unlike, and of a centre of gravity beside the middle.
//
// Cost: in one cycle of each row about 600 operations with four effect columns. No allocation. Ident mode
// only.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "firmware/ident/coloured_errors.hpp"
#include "firmware/ident/regression_filter.hpp"
#include "firmware/ident/ud_rls.hpp"

namespace wheelwright::ident {

template <typename Real>
struct DelayEstimate {
    Real delay_s{};  // the samples' age included
    Real standard_error_s{};
    Real lag_s{};        // standard deviation of the torque's response about its centroid
    bool valid = false;  // enough rows, torque seen to act, and 0 .. 8 ms beyond the samples' age
};

template <typename Real>
class DelayEstimator {
  public:
    // options.delay_s and tap_spacing_s are ignored, and rows are not longer than kLongestKernel_s makes
    // them, or half of what noise makes of the others: a delay shows in the fast part of the motion, and
    // short rows survive samples that are missing now and then.
    void configure(RegressionFilterOptions<Real> options) {
        options.kernel_s = std::min(options.kernel_s, std::max(kLongestKernel_s, options.kernel_s / 2));
        first_tap_s_ = static_cast<Real>(options.sample_age_s);
        options.delay_s = options.sample_age_s + kTapSpacing_s * (kTaps - 1) / 2;
        options.tap_spacing_s = kTapSpacing_s;
        filter_.configure(options);
        const int size = kFixed + filter_.columns();
        Vector prior{};
        prior.fill(kPriorVariance);
        for (Equation& equation : equation_) {
            equation.rls.reset(Vector{}, prior, size);
            equation.errors.reset(2, size);
        }
        rows_ = 0;
        turning_pending_ = false;
    }

    void restart() { filter_.restart(); }

    // Once in each cycle.
    void push(const IdentSample<Real>& sample) {
        if (filter_.push(sample)) {
            if (filter_.row().usable) {
                const auto& row = filter_.row();
                update(equation_[0], row.omega_squared, row.v_omega, row.acceleration.v_m_per_s2, sum,
                       difference);
                turning_pending_ = true;
                ++rows_;
            } else {
                for (Equation& equation : equation_) equation.errors.skip();
            }
        } else if (turning_pending_) {
            const auto& row = filter_.row();
            update(equation_[1], row.v_omega, row.v_squared, row.acceleration.omega_rad_per_s2, difference,
                   sum);
            turning_pending_ = false;
        }
    }

    // About 1000 operations: call it when the phase is over, not in each cycle.
    DelayEstimate<Real> estimate() const {
        const Centroid linear = centroid(equation_[0]);
        const Centroid turning = centroid(equation_[1]);
        DelayEstimate<Real> result;
        if (rows_ < kEnoughRows || !linear.known || !turning.known) return result;
        const Real w1 = 1 / linear.variance;
        const Real w2 = 1 / turning.variance;
        const Real further_s = (w1 * linear.value + w2 * turning.value) / (w1 + w2);
        result.delay_s = first_tap_s_ + further_s;
        result.standard_error_s = 1 / std::sqrt(w1 + w2);
        result.lag_s = std::sqrt(std::max(Real(0), (w1 * linear.square + w2 * turning.square) / (w1 + w2)));
        result.valid = further_s >= 0 && further_s <= Real(kLongestFurther_s);
        return result;
    }

  private:
    static constexpr int kTaps = 4;
    static constexpr double kTapSpacing_s = 0.002;
    static constexpr double kLongestFurther_s = 0.008;
    static constexpr double kLongestKernel_s = 0.0285;
    static constexpr int kTap = 2;  // the first, behind the velocity product and the mirrored one
    static constexpr int kCrossTorque = kTap + kTaps;
    static constexpr int kFixed = kCrossTorque + 1;
    static constexpr int kSize = kFixed + static_cast<int>(model::kMaxEstimatedColumns);
    static constexpr Real kPriorVariance = Real(1e6);
    static constexpr std::uint32_t kEnoughRows = 60;
    using Vector = std::array<Real, kSize>;

    struct Equation {
        UdRls<Real, kSize, true> rls;
        ColouredErrors<Real, kSize> errors;
    };
    struct Centroid {
        Real value{}, variance{}, square{};  // square: of the deviation from the value, mean
        bool known = false;
    };

    static Real sum(const WheelPair<Real>& pair) { return pair.sum(); }
    static Real difference(const WheelPair<Real>& pair) { return pair.difference(); }

    template <typename Combine, typename Cross>
    void update(Equation& equation, Real velocity_product, Real mirrored_product, Real y, Combine&& combine,
                Cross&& cross) {
        const RegressionRow<Real, kTaps>& row = filter_.row();
        Vector phi{velocity_product, mirrored_product};
        for (std::size_t k = 0; k < kTaps; ++k) phi[kTap + k] = combine(row.torque_Nm[k]);
        phi[kCrossTorque] = (cross(row.torque_Nm[1]) + cross(row.torque_Nm[2])) / 2;  // in the middle
        for (std::size_t j = 0; j < static_cast<std::size_t>(filter_.columns()); ++j)
            phi[kFixed + j] = combine(row.column[j]);
        // of the noise alone: what is not known yet mispredicts, and one such row would be most of the power
        const auto projection = equation.rls.projection(phi);
        const Real innovation = equation.rls.innovation(phi, y);
        equation.rls.update_projected(projection, innovation);
        equation.errors.push(phi, innovation / std::sqrt(1 + projection.variance));
    }

    // sum(c_k t_k) / sum(c_k), t_k from the first tap on, and its first-order variance.
    Centroid centroid(const Equation& equation) const {
        const auto& theta = equation.rls.theta();
        const int size = kFixed + filter_.columns();
        constexpr auto kSpacing = static_cast<Real>(kTapSpacing_s);
        Real total = 0;
        Real moment = 0;
        Real second = 0;
        for (int k = 0; k < kTaps; ++k) {
            const Real tap = theta[static_cast<std::size_t>(kTap + k)];
            total += tap;
            moment += tap * kSpacing * static_cast<Real>(k);
            second += tap * kSpacing * kSpacing * static_cast<Real>(k * k);
        }
        if (!(total > 0)) return {};
        const Real value = moment / total;
        Vector p{};  // P times the gradient
        for (int i = 0; i < size; ++i)
            for (int k = 0; k < kTaps; ++k)
                p[static_cast<std::size_t>(i)] +=
                    equation.rls.covariance(i, kTap + k) * (kSpacing * static_cast<Real>(k) - value) / total;
        const Real variance = equation.errors.covariance(equation.errors.noise_variances(), p, p);
        return {value, variance, second / total - value * value, variance > 0};
    }

    RegressionFilter<Real, kTaps> filter_;
    std::array<Equation, 2> equation_{};
    Real first_tap_s_{};
    std::uint32_t rows_ = 0;
    bool turning_pending_ = false;
};

}  // namespace wheelwright::ident
