// K5..K8 and the effects' parameters from a robot that is being excited: the two regressions of paper
// eq (50)-(55), each with a column for each parameter of each active effect.
//
//   y1 = K5 omega^2 + K7 (tau_r + tau_l) + sum K7 p_j (c_j,r + c_j,l)
//   y2 = K6 v omega + K8 (tau_r - tau_l) + sum K8 p_j (c_j,r - c_j,l)
//
// A drive answers with a lag besides its delay. The delay is given; the lag's spread about it is estimated as
// one more column, the torque's second difference over taps on both sides of the delay. Without it, a lag of
// 1 ms under bits of 10 ms makes K7 and K8 one per cent small.
//
// An effect's parameter is the ratio of its coefficient and K7 (or K8); both equations' values are combined
// by their variances. Nothing is forgotten: this is for a robot that does not change meanwhile. For one that
// does, see adaptive_estimator.hpp.
//
// push() does one piece of a row's work in each of the four cycles after it, so no cycle bears all of it. At
// most about 700 operations in a cycle with four columns. No allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "firmware/ident/coloured_errors.hpp"
#include "firmware/ident/dynamics_estimate.hpp"
#include "firmware/ident/excitation_monitor.hpp"
#include "firmware/ident/regression_filter.hpp"
#include "firmware/ident/ud_rls.hpp"

namespace wheelwright::ident {

template <typename Real>
struct DynamicsEstimatorOptions {
    RegressionFilterOptions<Real> filter;
    Real relative_standard_error = Real(0.005);  // of K7 and K8, for estimate().good_enough
    Real coupling_standard_error_m = Real(1e9);  // of K5, and of K6 as a length (it is -K5 * 2 K8 / (b K7))
    Real prior_variance = Real(1e6);             // P(-1) = c I
    Real excitation_memory_s = 2;
};

template <typename Real>
class DynamicsEstimator {
  public:
    static constexpr int kTaps = 3;

    void configure(const DynamicsEstimatorOptions<Real>& options) {
        options_ = options;
        options_.filter.tap_spacing_s = spacing_s(options.filter.delay_s);
        filter_.configure(options_.filter);
        columns_ = column_places(options.filter.effects, places_);
        const int size = kFixed + columns_;
        Vector prior{};
        prior.fill(options.prior_variance);
        const Real interval_s = static_cast<Real>(filter_.block_samples() * options.filter.sample_time_s);
        for (Equation& equation : equation_) {
            equation.rls.reset(Vector{}, prior, size);
            equation.errors.reset(2, size);
            equation.monitor.reset(1 - std::min(Real(0.5), interval_s / options.excitation_memory_s), prior,
                                   size);
        }
        estimate_ = {};
        estimate_.effects.active = options.filter.effects.active;
        const auto unknown = static_cast<Real>(kUnknownError);
        estimate_.standard_error = {unknown, unknown, unknown, unknown};
        work_ = Work::none;
    }

    void set_delay(double delay_s) { filter_.set_delay(delay_s, spacing_s(delay_s)); }

    // After a gap in the samples. What was learned stays.
    void restart() { filter_.restart(); }

    // Once in each cycle. True when estimate() has become new.
    bool push(const IdentSample<Real>& sample) {
        if (filter_.push(sample)) {
            if (filter_.row().usable) {
                work_ = Work::linear;
            } else {
                ++estimate_.masked_rows;
                for (Equation& equation : equation_) equation.errors.skip();
            }
        }
        switch (work_) {
            case Work::none:
                return false;
            case Work::linear:
                update_linear();
                work_ = Work::turning;
                return false;
            case Work::turning:
                update_turning();
                ++estimate_.rows;
                work_ = Work::linear_errors;
                return false;
            case Work::linear_errors:
                refresh(equation_[0]);
                work_ = Work::turning_errors;
                return false;
            case Work::turning_errors:
                refresh(equation_[1]);
                publish();
                work_ = Work::none;
                return true;
        }
        return false;
    }

    const DynamicsEstimate<Real>& estimate() const { return estimate_; }
    const RegressionFilter<Real, kTaps>& filter() const { return filter_; }

    // Of the residuals of y1 and y2 [m/s^2, rad/s^2, squared], for reports.
    TwistRate<Real> residual_variance() const {
        return {equation_[0].errors.residual_variance(), equation_[1].errors.residual_variance()};
    }

  private:
    static constexpr int kFixed = 4;  // velocity product, torque, lag
    static constexpr double kLargestTapSpacing_s = 0.003;
    static constexpr int kSize = kFixed + static_cast<int>(model::kMaxColumns);
    static constexpr std::uint32_t kEnoughRows = 200;
    using Vector = std::array<Real, kSize>;
    enum class Work : std::uint8_t { none, linear, turning, linear_errors, turning_errors };

    struct Ratio {
        Real value{}, variance{};
    };
    struct Equation {
        UdRls<Real, kSize, true> rls;
        ColouredErrors<Real, kSize> errors;
        ExcitationMonitor<Real, kSize> monitor;
        Vector variance{};
        std::array<Ratio, model::kMaxColumns> effect{};
    };

    // So that no tap lies before the torque was told.
    double spacing_s(double delay_s) const {
        return std::min(kLargestTapSpacing_s, delay_s + 1.9 * options_.filter.sample_time_s);
    }

    void update_linear() {
        const RegressionRow<Real, kTaps>& row = filter_.row();
        regress(equation_[0], row.omega_squared, row.acceleration.v_m_per_s2,
                [](const WheelPair<Real>& pair) { return pair.sum(); });
    }
    void update_turning() {
        const RegressionRow<Real, kTaps>& row = filter_.row();
        regress(equation_[1], row.v_omega, row.acceleration.omega_rad_per_s2,
                [](const WheelPair<Real>& pair) { return pair.difference(); });
    }
    template <typename Combine>
    void regress(Equation& equation, Real velocity_product, Real y, Combine&& combine) {
        const RegressionRow<Real, kTaps>& row = filter_.row();
        const Real torque = combine(row.torque_Nm[1]);
        const Real lag = combine(row.torque_Nm[0]) + combine(row.torque_Nm[2]) - 2 * torque;
        const Real slip = combine(row.torque_Nm[2]) - combine(row.torque_Nm[0]);
        Vector phi{velocity_product, torque, lag, slip};
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j)
            phi[kFixed + j] = combine(row.column[j]);
        update(equation, phi, y);
    }
    static void update(Equation& equation, const Vector& phi, Real y) {
        const Real innovation = equation.rls.update(phi, y);
        equation.errors.push(phi, innovation);
        equation.monitor.push(phi);
    }

    // Variances of the coefficients, and the effects' parameters as ratios (first-order error propagation).
    void refresh(Equation& equation) {
        const auto noise = equation.errors.noise_variances();
        const int size = kFixed + columns_;
        Vector to_torque{};  // row of P that belongs to K7 or K8
        for (int k = 0; k < size; ++k) to_torque[static_cast<std::size_t>(k)] = equation.rls.covariance(1, k);
        const Vector middle = equation.errors.apply(noise, to_torque);
        const Real gain = equation.rls.theta()[1];
        for (int i = 0; i < size; ++i) {
            Vector p{};
            Real with_gain = 0;
            for (int k = 0; k < size; ++k) {
                p[static_cast<std::size_t>(k)] = equation.rls.covariance(i, k);
                with_gain += p[static_cast<std::size_t>(k)] * middle[static_cast<std::size_t>(k)];
            }
            const Real variance = equation.errors.covariance(noise, p, p);
            equation.variance[static_cast<std::size_t>(i)] = variance;
            if (i < kFixed) continue;
            const Real ratio = equation.rls.theta()[static_cast<std::size_t>(i)] / gain;
            // variance[1] is up to date: i ascends
            equation.effect[static_cast<std::size_t>(i - kFixed)] = {
                ratio,
                (variance - 2 * ratio * with_gain + ratio * ratio * equation.variance[1]) / (gain * gain)};
        }
    }

    void publish() {
        const Equation& linear = equation_[0];
        const Equation& turning = equation_[1];
        estimate_.dynamics = {linear.rls.theta()[0], turning.rls.theta()[0], linear.rls.theta()[1],
                              turning.rls.theta()[1]};
        estimate_.covariance_diagonal = {linear.rls.variance(0), turning.rls.variance(0),
                                         linear.rls.variance(1), turning.rls.variance(1)};
        estimate_.excitation = {linear.monitor.excitation(0, linear.rls.variance(0)),
                                turning.monitor.excitation(0, turning.rls.variance(0)),
                                linear.monitor.excitation(1, linear.rls.variance(1)),
                                turning.monitor.excitation(1, turning.rls.variance(1))};
        if (estimate_.rows < kEnoughRows) return;  // errors stay unknown
        estimate_.standard_error = {error(linear.variance[0]), error(turning.variance[0]),
                                    error(linear.variance[1]), error(turning.variance[1])};
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j) {
            const Real w1 = weight(linear.effect[j].variance);
            const Real w2 = weight(turning.effect[j].variance);
            const ColumnPlace place = places_[j];
            estimate_.effects.parameter[place.effect][place.parameter] =
                (w1 * linear.effect[j].value + w2 * turning.effect[j].value) / (w1 + w2);
            estimate_.effects_standard_error.parameter[place.effect][place.parameter] =
                1 / std::sqrt(w1 + w2);
        }
        const model::Dynamics<Real>& k = estimate_.dynamics;
        const model::Dynamics<Real>& e = estimate_.standard_error;
        const Real to_length =
            static_cast<Real>(options_.filter.geometry.track_m) * k.k7_per_kg_m / (2 * k.k8_per_kg_m2);
        estimate_.good_enough = k.k7_per_kg_m > 0 && k.k8_per_kg_m2 > 0 &&
                                e.k7_per_kg_m <= options_.relative_standard_error * k.k7_per_kg_m &&
                                e.k8_per_kg_m2 <= options_.relative_standard_error * k.k8_per_kg_m2 &&
                                e.k5_m <= options_.coupling_standard_error_m &&
                                e.k6_per_m * to_length <= options_.coupling_standard_error_m;
    }

    static Real error(Real variance) { return variance > 0 ? std::sqrt(variance) : Real(0); }
    static Real weight(Real variance) {
        constexpr auto kNever = static_cast<Real>(1e-18);  // an equation in which the column is zero
        return variance > kNever ? 1 / variance : (variance > 0 ? 1 / kNever : kNever);
    }

    DynamicsEstimatorOptions<Real> options_{};
    RegressionFilter<Real, kTaps> filter_;
    std::array<Equation, 2> equation_{};
    std::array<ColumnPlace, model::kMaxColumns> places_{};
    int columns_ = 0;
    Work work_ = Work::none;
    DynamicsEstimate<Real> estimate_{};
};

}  // namespace wheelwright::ident
