// K5..K8 and the effects' parameters of a robot that is driving and may change: a payload, a wheel, the
// floor.
//
// A recursive Gauss-Newton step (a U-D least-squares update with the model's gradient) over
//     theta = (K5, K7, K8, p_1 .. p_n)
// with each effect's parameter in its own unit, so that a change of mass does not move friction, and with K6
// tied to the others by coupled_k6(): both rows feed the same parameters.
//
// Directional forgetting with the memory `memory_s`; a parameter whose excitation (excitation_monitor.hpp)
// lies below `minimum_excitation` is held; rows with slip, saturation in the drive, or a standing wheel are
// masked.
//
// Change detection: an innovation beyond `gate_sigma` of its own deviation stops the use of rows until the
// averaging window has passed the event; then K7 and K8 are doubted by `doubt` (relative), and the rows that
// follow settle them. A jolt thus costs a fresh look, never a wrong row.
//
// Standard errors: sqrt(P_ii), P in units of the residual's own variance, raised where slow residuals are
// larger than white ones would be. They over-cover where sensor noise dominates (coloured_errors.hpp says
// why).
//
// push() spreads a row's work over the five cycles after it: at most about 1 700 instructions in one. No
// allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "firmware/ident/dynamics_estimate.hpp"
#include "firmware/ident/excitation_monitor.hpp"
#include "firmware/ident/regression_filter.hpp"
#include "firmware/ident/ud_rls.hpp"

namespace wheelwright::ident {

template <typename Real>
struct AdaptiveEstimatorOptions {
    RegressionFilterOptions<Real> filter;  // kernel_s: see kAdaptiveKernel_s
    model::Dynamics<Real> dynamics;        // where to start, with its standard error (k6: not used)
    model::Dynamics<Real> standard_error;
    model::EffectSet<Real> effects;  // start values
    model::EffectSet<Real> effects_standard_error;
    Real memory_s = 4;
    Real minimum_excitation = Real(0.05);
    Real trust_relative_error = Real(0.05);
    Real range = 3;                     // factor by which K7 and K8 may leave the start values
    Real angle_noise_rad = Real(3e-4);  // deviation of a wheel angle, for the rows' nominal noise
    Real gate_sigma = 6;
    Real doubt = Real(0.3);
};

// Driving excites slowly; a longer averaging weight than the ident mode's takes the encoder's noise away.
inline constexpr double kAdaptiveKernel_s = 0.05;

template <typename Real>
class AdaptiveEstimator {
  public:
    void configure(const AdaptiveEstimatorOptions<Real>& options) {
        options_ = options;
        filter_.configure(options.filter);
        columns_ = column_places(filter_.estimated(), places_);
        size_ = kFixed + columns_;
        const auto dt = static_cast<Real>(options.filter.sample_time_s);
        const auto m = static_cast<Real>(filter_.block_samples());
        interval_s_ = m * dt;

        // angle noise of a block's mean, differenced twice: variance 6
        const Real wheel = options.angle_noise_rad * std::sqrt(6 / m) / (interval_s_ * interval_s_);
        const auto left = static_cast<Real>(options.filter.geometry.wheel_radius_m.left) * wheel;
        const auto right = static_cast<Real>(options.filter.geometry.wheel_radius_m.right) * wheel;
        track_m_ = static_cast<Real>(options.filter.geometry.track_m);
        const Real both = std::sqrt(left * left + right * right);
        row_[0].inverse_sigma = 2 / both;
        row_[1].inverse_sigma = track_m_ / both;

        Vector theta{options.dynamics.k5_m, options.dynamics.k7_per_kg_m, options.dynamics.k8_per_kg_m2};
        Vector error{std::max({options.standard_error.k5_m, std::abs(theta[0]) / 5, Real(0.002)}),
                     std::max(options.standard_error.k7_per_kg_m, kLeastError * theta[1]),
                     std::max(options.standard_error.k8_per_kg_m2, kLeastError * theta[2])};
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j) {
            const ColumnPlace p = places_[j];
            const model::EffectParameterInfo& info = model::kEffects[p.effect].parameters[p.parameter];
            low_[kFixed + j] = static_cast<Real>(info.minimum);
            high_[kFixed + j] = static_cast<Real>(info.maximum);
            theta[kFixed + j] = options.effects.parameter[p.effect][p.parameter];
            error[kFixed + j] = std::max(options.effects_standard_error.parameter[p.effect][p.parameter],
                                         kLeastEffectError * std::abs(theta[kFixed + j]));
        }
        low_[0] = theta[0] - kRangeOfK5_m;
        high_[0] = theta[0] + kRangeOfK5_m;
        for (std::size_t i = 1; i < kFixed; ++i) {
            low_[i] = theta[i] / options.range;
            high_[i] = theta[i] * options.range;
        }

        Vector variance{};
        Vector ceiling{};
        for (std::size_t i = 0; i < static_cast<std::size_t>(size_); ++i) {
            variance[i] = std::max(error[i] * error[i], kTinyVariance);
            const Real widest = i == 1 || i == 2 ? std::max(error[i], theta[i] / 2) : 3 * error[i];
            ceiling[i] = std::max(widest * widest, kTinyVariance);
        }
        rls_.reset(theta, variance, size_);
        const Real lambda = 1 - std::min(Real(0.5), interval_s_ / options.memory_s);
        rls_.set_forgetting(Forgetting::directional, lambda);
        for (std::size_t i = 0; i < static_cast<std::size_t>(size_); ++i) {
            const Real least = i == 1 || i == 2 ? kAlertness * theta[i] : Real(0);
            rls_.set_bounds(static_cast<int>(i), least * least, ceiling[i]);
        }
        monitor_.reset(lambda, ceiling, size_);
        for (Row& row : row_) {
            row.power = 1;
            row.slow_power = 1;
            row.run = 0;
            row.run_sum = 0;
        }
        hold_rows_ = 0;
        excited_.fill(false);
        estimate_ = {};
        estimate_.effects.active = filter_.estimated();
        work_ = Work::none;
        publish();
    }

    void set_delay(double delay_s) { filter_.set_delay(delay_s); }

    // After a gap in the samples. What was learned stays.
    void restart() { filter_.restart(); }

    // Once in each cycle. True when estimate() has become new. `busy`: the cycle has other work to do, so a
    // row's may wait, for one cycle at a time.
    bool push(const IdentSample<Real>& sample, bool busy = false) {
        if (filter_.push(sample)) {
            begin_row();
            return false;
        }
        waited_ = busy && !waited_;
        if (waited_) return false;
        switch (work_) {
            case Work::none:
                return false;
            case Work::linear:
                linear_gradient();
                learn(row_[0], filter_.row().acceleration.v_m_per_s2);
                work_ = Work::turning;
                return false;
            case Work::turning:
                turning_gradient();
                learn(row_[1], filter_.row().acceleration.omega_rad_per_s2);
                ++estimate_.rows;
                work_ = Work::monitor_linear;
                return false;
            case Work::monitor_linear:
                monitor_.push(row_[0].phi);
                work_ = Work::monitor_turning;
                return false;
            case Work::monitor_turning:
                monitor_.push(row_[1].phi);
                work_ = Work::publish;
                return false;
            case Work::publish:
                publish();
                work_ = Work::none;
                return true;
        }
        return false;
    }

    const DynamicsEstimate<Real>& estimate() const { return estimate_; }

    // Whether parameter K5, K7, K8 is held for lack of excitation.
    struct Frozen {
        bool k5, k7, k8;
    };
    Frozen frozen() const { return {!excited_[0], !excited_[1], !excited_[2]}; }

    // Rows still to pass before the doubt after a detected change is applied; 0 otherwise.
    int rows_held() const { return hold_rows_; }

    const RegressionFilter<Real>& filter() const { return filter_; }

  private:
    static constexpr std::size_t kFixed = 3;
    static constexpr int kSize = static_cast<int>(kFixed + model::kMaxEstimatedColumns);
    static constexpr int kWindowRows = 3;  // rows that one event can touch
    static constexpr int kRunRows = 16;
    static constexpr Real kLeastError = Real(0.01);        // relative, of K7 and K8 at the start
    static constexpr Real kLeastEffectError = Real(0.05);  // relative, of the effects' parameters
    static constexpr Real kAlertness = Real(5e-4);         // relative error that is never undercut
    static constexpr Real kRangeOfK5_m = Real(0.2);
    static constexpr Real kTinyVariance = Real(1e-12);
    static constexpr Real kPowerMemory_s = 10;
    using Vector = std::array<Real, kSize>;
    enum class Work : std::uint8_t { none, linear, turning, monitor_linear, monitor_turning, publish };

    struct Row {
        Vector phi{};          // gradient over the row's deviation
        Real inverse_sigma{};  // nominal deviation
        Real prediction{};
        Real power = 1;       // of the innovation over the nominal variance, at least 1
        Real slow_power = 1;  // the same of sums over kRunRows rows
        Real run_sum = 0;
        int run = 0;
    };

    void begin_row() {
        if (!filter_.row().usable) {
            ++estimate_.masked_rows;
            work_ = Work::none;
            return;
        }
        if (hold_rows_ > 0) {
            ++estimate_.masked_rows;
            if (--hold_rows_ == 0) doubt();
            work_ = Work::none;
            return;
        }
        work_ = Work::linear;
    }

    // A change of the robot: what it was before counts no more.
    void doubt() {
        ++estimate_.changes;
        for (int i = 1; i <= 2; ++i) {
            const Real error = options_.doubt * rls_.theta()[static_cast<std::size_t>(i)];
            const Real add = error * error - rls_.variance(i);
            if (add > 0) rls_.add_variance(i, add);
        }
        for (Row& row : row_) {
            row.run = 0;
            row.run_sum = 0;
        }
    }

    void linear_gradient() {
        const RegressionRow<Real>& r = filter_.row();
        const Vector& t = rls_.theta();
        Row& row = row_[0];
        Real torque = r.torque_Nm[0].sum();
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j) {
            const Real column = r.column[j].sum();
            torque += t[kFixed + j] * column;
            row.phi[kFixed + j] = t[1] * column;
        }
        row.phi[0] = r.omega_squared;
        row.phi[1] = torque;
        row.phi[2] = 0;
        row.prediction = t[0] * r.omega_squared + t[1] * torque;
    }

    void turning_gradient() {
        const RegressionRow<Real>& r = filter_.row();
        const Vector& t = rls_.theta();
        Row& row = row_[1];
        Real torque = r.torque_Nm[0].difference();
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j) {
            const Real column = r.column[j].difference();
            torque += t[kFixed + j] * column;
            row.phi[kFixed + j] = t[2] * column;
        }
        const Real per_k5 = -2 * t[2] / (track_m_ * t[1]);  // K6 = per_k5 * K5
        const Real coriolis = t[0] * per_k5 * r.v_omega;
        row.phi[0] = per_k5 * r.v_omega;
        row.phi[1] = -coriolis / t[1];
        row.phi[2] = coriolis / t[2] + torque;
        row.prediction = coriolis + t[2] * torque;
    }

    void learn(Row& row, Real y) {
        const Real weight = row.inverse_sigma / std::sqrt(row.power);
        const Real innovation = (y - row.prediction) * weight;
        for (std::size_t i = 0; i < static_cast<std::size_t>(size_); ++i) row.phi[i] *= weight;
        if (hold_rows_ > 0) return;  // the other equation has just found a change
        const auto projection = rls_.projection(row.phi);
        const Real deviation = 1 + projection.variance;
        const Real square = innovation * innovation / deviation;
        if (square > options_.gate_sigma * options_.gate_sigma) {
            hold_rows_ = kWindowRows;
            return;
        }
        watch_noise(row, innovation, square);
        bool any = false;
        for (std::size_t i = 0; i < static_cast<std::size_t>(size_); ++i) any = any || excited_[i];
        if (!any) return;
        Vector gain;
        const Real scale = rls_.update_gain(projection, gain) * innovation;
        for (std::size_t i = 0; i < static_cast<std::size_t>(size_); ++i) {
            if (!excited_[i]) continue;
            rls_.set_theta(static_cast<int>(i),
                           std::clamp(rls_.theta()[i] + gain[i] * scale, low_[i], high_[i]));
        }
    }

    void watch_noise(Row& row, Real innovation, Real square) {
        const Real share = interval_s_ / kPowerMemory_s;
        row.power = std::max(Real(1), row.power * (1 + share * (square - 1)));
        row.run_sum += innovation;
        if (++row.run < kRunRows) return;
        const Real slow = row.run_sum * row.run_sum / kRunRows;
        row.slow_power += std::min(Real(1), kRunRows * share) * (slow - row.slow_power);
        row.run = 0;
        row.run_sum = 0;
    }

    void publish() {
        const Vector& t = rls_.theta();
        const Real colour = std::max({Real(1), row_[0].slow_power, row_[1].slow_power});
        std::array<Real, kSize> held{};
        for (std::size_t i = 0; i < static_cast<std::size_t>(size_); ++i) {
            held[i] = rls_.variance(static_cast<int>(i));
            const Real excitation = monitor_.excitation(static_cast<int>(i), held[i]);
            excited_[i] = excitation >= options_.minimum_excitation;
            set_excitation(i, excitation);
        }
        const auto error = [&](std::size_t i) { return std::sqrt(held[i] * colour); };
        const Real k6 = model::coupled_k6(t[0], t[1], t[2], track_m_);
        const Real to_k6 = 2 * t[2] / (track_m_ * t[1]);
        estimate_.dynamics = {t[0], k6, t[1], t[2]};
        estimate_.covariance_diagonal = {held[0], to_k6 * to_k6 * held[0], held[1], held[2]};
        estimate_.standard_error = {error(0), to_k6 * error(0), error(1), error(2)};
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j) {
            const ColumnPlace p = places_[j];
            estimate_.effects.parameter[p.effect][p.parameter] = t[kFixed + j];
            estimate_.effects_standard_error.parameter[p.effect][p.parameter] = error(kFixed + j);
        }
        estimate_.good_enough = error(1) <= options_.trust_relative_error * t[1] &&
                                error(2) <= options_.trust_relative_error * t[2];
    }

    void set_excitation(std::size_t i, Real value) {
        model::Dynamics<Real>& e = estimate_.excitation;
        if (i == 0) e.k5_m = e.k6_per_m = value;
        if (i == 1) e.k7_per_kg_m = value;
        if (i == 2) e.k8_per_kg_m2 = value;
    }

    AdaptiveEstimatorOptions<Real> options_{};
    RegressionFilter<Real> filter_;
    UdRls<Real, kSize, true> rls_;
    ExcitationMonitor<Real, kSize> monitor_;
    std::array<Row, 2> row_{};
    std::array<ColumnPlace, model::kMaxEstimatedColumns> places_{};
    Vector low_{}, high_{};
    std::array<bool, kSize> excited_{};
    Real interval_s_{}, track_m_{};
    int columns_ = 0;
    int size_ = static_cast<int>(kFixed);
    int hold_rows_ = 0;
    Work work_ = Work::none;
    bool waited_ = false;
    DynamicsEstimate<Real> estimate_{};
};

}  // namespace wheelwright::ident
