// K5..K8 and the effects' parameters of a robot that is driving and may change: a payload, a wheel, the
// floor.
//
// A load beside the middle line couples forward motion and turning, and so do drives that are unlike; a drawn
// figure excites both together, so K7 and K8 can be told from it only beside this coupling. With the
// offset y (m) of the centre of gravity to the left and the drives' gain mismatch g,
//
//     a = K5 omega^2  + K7 (S + g D)         S, D: sum and difference of the wheels' torque,
//     c = K6 v omega  + K8 (D + g S)               less what the effects take
//     v' = a + y c
//     omega' = c + y 2 K8 / (b K7) a
//
// which is the inverse of the mass matrix of a body about a point beside its centre of gravity
// (Newton-Euler; effects/cog_lateral.hpp): K7 and K8 are what a torque does in its own direction, and y seems
// smaller than it is by the share that the wheels' rotation has in the mass, as K5 does.
//
// A recursive Gauss-Newton step (a U-D least-squares update with the model's gradient) over
//     theta = (K5, K7, K8, y, g, p_1 .. p_n)
// with each effect's parameter in its own unit, so that a change of mass does not move friction, and with K6
// tied to the others by coupled_k6(): both rows feed the same parameters.
//
// Directional forgetting with the memory `memory_s`; a parameter whose excitation (excitation_monitor.hpp)
// lies below `minimum_excitation` is held; rows with slip, saturation in the drive, or a standing wheel are
// masked.
//
// Noise: how much of it rows have differs by many powers of ten between robots, so it is measured. The
// differences of neighbouring innovations give it, in which an error of the model, slow beside the rows,
// cancels. The first rows only measure.
//
// Change detection: an innovation beyond `gate_sigma` of its own deviation, or a sum of innovations beyond
// that of the sum, stops the use of rows until the averaging window has passed the event. What a load can
// change is then doubted: K7 and K8 by `doubt` (relative), K5 and y by what a load of that share shifts at
// the track's edge; the rows that follow settle them. A jolt thus costs a fresh look, never a wrong row.
//
// Standard errors: sqrt(P_ii), P in units of the residual's own variance, raised where slow residuals are
// larger than white ones would be. They over-cover where sensor noise dominates (coloured_errors.hpp says
// why).
//
// push() spreads a row's work over the eight cycles after it: at most about 1 700 instructions in one. No
// allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

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
    Real angle_noise_rad = Real(3e-4);  // unit of the rows' noise: where its measurement begins
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
        Vector error{std::max({options.standard_error.k5_m, std::abs(theta[0]) / 5, kLeastError * track_m_}),
                     std::max(options.standard_error.k7_per_kg_m, kLeastError * theta[1]),
                     std::max(options.standard_error.k8_per_kg_m2, kLeastError * theta[2]),
                     kOffsetError * track_m_, kMismatchError};
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j) {
            const ColumnPlace p = places_[j];
            const model::EffectParameterInfo& info = model::kEffects[p.effect].parameters[p.parameter];
            low_[kFixed + j] = static_cast<Real>(info.minimum);
            high_[kFixed + j] = static_cast<Real>(info.maximum);
            theta[kFixed + j] = options.effects.parameter[p.effect][p.parameter];
            error[kFixed + j] = std::max(options.effects_standard_error.parameter[p.effect][p.parameter],
                                         kLeastEffectError * std::abs(theta[kFixed + j]));
        }
        for (const std::size_t i : {std::size_t{0}, kOffset}) {
            low_[i] = theta[i] - track_m_;
            high_[i] = theta[i] + track_m_;
        }
        for (std::size_t i = 1; i <= 2; ++i) {
            low_[i] = theta[i] / options.range;
            high_[i] = theta[i] * options.range;
        }
        low_[kMismatch] = -kMostMismatch;
        high_[kMismatch] = kMostMismatch;

        Vector variance{};
        Vector ceiling{};
        for (std::size_t i = 0; i < static_cast<std::size_t>(size_); ++i) {
            variance[i] = std::max(error[i] * error[i], kTinyVariance);
            Real widest = 3 * error[i];
            if (i == 1 || i == 2) widest = std::max(error[i], theta[i] / 2);
            if (i == 0 || i == kOffset) widest = std::max(widest, track_m_ / 2);
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
            const Real sigma = row.inverse_sigma;
            row = {};
            row.inverse_sigma = sigma;
        }
        hold_rows_ = 0;
        doubtful_ = 0;
        excited_.fill(false);
        estimate_ = {};
        estimate_.effects.active = filter_.estimated();
        work_ = Work::none;
        watch_excitation();
        excited_.fill(false);
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
            case Work::doubt:
                doubt(doubtful_++);
                work_ = doubtful_ < kDoubted.size() ? Work::doubt : Work::none;
                return false;
            case Work::linear:
                linear_gradient();
                work_ = judge(row_[0], filter_.row().acceleration.v_m_per_s2) ? Work::learn_linear
                                                                              : Work::turning;
                return false;
            case Work::learn_linear:
                learn(row_[0]);
                work_ = Work::turning;
                return false;
            case Work::turning:
                turning_gradient();
                ++estimate_.rows;
                work_ = judge(row_[1], filter_.row().acceleration.omega_rad_per_s2) ? Work::learn_turning
                                                                                    : Work::monitor_linear;
                return false;
            case Work::learn_turning:
                learn(row_[1]);
                work_ = Work::monitor_linear;
                return false;
            case Work::monitor_linear:
                monitor_.push(row_[0].phi);
                work_ = Work::monitor_turning;
                return false;
            case Work::monitor_turning:
                monitor_.push(row_[1].phi);
                work_ = Work::watch;
                return false;
            case Work::watch:
                watch_excitation();
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
    static constexpr std::size_t kOffset = 3;
    static constexpr std::size_t kMismatch = 4;
    static constexpr std::size_t kFixed = 5;
    static constexpr std::array<std::size_t, 4> kDoubted{0, 1, 2, kOffset};
    static constexpr int kSize = static_cast<int>(kFixed + model::kMaxEstimatedColumns);
    static constexpr int kWindowRows = 3;  // rows that one event can touch
    static constexpr int kRunRows = 16;
    static constexpr Real kSumGateShare = Real(0.45);  // of the rows' gate squared: sums are fewer, hence 4 sigma of 6
    static constexpr int kNoiseRows = 300;                 // over which the noise is averaged
    static constexpr Real kLeastError = Real(0.01);        // relative, of K7 and K8 at the start
    static constexpr Real kLeastEffectError = Real(0.05);  // relative, of the effects' parameters
    static constexpr Real kAlertness = Real(5e-4);         // relative error that is never undercut
    static constexpr Real kOffsetError = Real(0.05);       // of the track: batteries, a motor on one side
    static constexpr Real kMismatchError = Real(0.1);      // motor constants of one kind, and a weak drive
    static constexpr Real kMostMismatch = Real(0.5);       // one drive three times as strong as the other
    static constexpr Real kTinyVariance = Real(1e-12);
    static constexpr Real kTinyPower = Real(1e-8);  // keeps float from trouble where there is no noise
    using Vector = std::array<Real, kSize>;
    using Rls = UdRls<Real, kSize, true>;
    enum class Work : std::uint8_t {
        none,
        doubt,
        linear,
        learn_linear,
        turning,
        learn_turning,
        monitor_linear,
        monitor_turning,
        watch,
        publish
    };

    struct Row {
        Vector phi{};          // gradient over the row's deviation
        Real inverse_sigma{};  // nominal deviation
        Real prediction{};
        Real innovation{};
        typename Rls::Projection projection{};
        Real before{};        // innovation of the row before, in nominal deviations
        bool follows = false;  // `before` is of the row just before
        int seen = 0;         // rows whose noise was measured, up to kNoiseRows
        Real power = 1;       // of the rows' noise over the nominal variance
        Real level = 1;       // of the innovation over its variance, with all that the model does not explain
        Real slow_power = 1;  // the same of sums over kRunRows rows
        Real run_sum = 0;
        int run = 0;
    };

    void begin_row() {
        if (!filter_.row().usable) {
            ++estimate_.masked_rows;
            work_ = Work::none;
            for (Row& row : row_) row.follows = false;
            return;
        }
        if (hold_rows_ > 0) {
            ++estimate_.masked_rows;
            work_ = Work::none;
            if (--hold_rows_ == 0) begin_doubt();
            return;
        }
        work_ = Work::linear;
    }

    // A change of the robot: what it was before counts no more.
    void begin_doubt() {
        ++estimate_.changes;
        doubtful_ = 0;
        work_ = Work::doubt;
        for (Row& row : row_) {
            row.run = 0;
            row.run_sum = 0;
            row.follows = false;
        }
    }

    // A load of the share `doubt`, put on over one wheel, moves the centre of gravity by that share of half
    // the track.
    void doubt(std::size_t which) {
        const std::size_t i = kDoubted[which];
        const Real error = options_.doubt * (i == 1 || i == 2 ? rls_.theta()[i] : track_m_ / 2);
        const Real add = error * error - rls_.variance(static_cast<int>(i));
        if (add > 0) rls_.add_variance(static_cast<int>(i), add);
    }

    // The accelerations that forward and turning torque would make alone, and their gradients.
    struct Alone {
        Real value;
        Vector gradient;
    };

    Alone forward_alone() const {
        const RegressionRow<Real>& r = filter_.row();
        const Vector& t = rls_.theta();
        Alone a{};
        Real torque = r.torque_Nm[0].sum() + t[kMismatch] * r.torque_Nm[0].difference();
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j) {
            const Real column = r.column[j].sum();
            torque += t[kFixed + j] * column;
            a.gradient[kFixed + j] = t[1] * column;
        }
        a.gradient[0] = r.omega_squared;
        a.gradient[1] = torque;
        a.gradient[kMismatch] = t[1] * r.torque_Nm[0].difference();
        a.value = t[0] * r.omega_squared + t[1] * torque;
        return a;
    }

    Alone turning_alone(Real per_k5) const {
        const RegressionRow<Real>& r = filter_.row();
        const Vector& t = rls_.theta();
        Alone a{};
        Real torque = r.torque_Nm[0].difference() + t[kMismatch] * r.torque_Nm[0].sum();
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j) {
            const Real column = r.column[j].difference();
            torque += t[kFixed + j] * column;
            a.gradient[kFixed + j] = t[2] * column;
        }
        const Real coriolis = t[0] * per_k5 * r.v_omega;
        a.gradient[0] = per_k5 * r.v_omega;
        a.gradient[1] = -coriolis / t[1];
        a.gradient[2] = coriolis / t[2] + torque;
        a.gradient[kMismatch] = t[2] * r.torque_Nm[0].sum();
        a.value = coriolis + t[2] * torque;
        return a;
    }

    // K6 = this * K5; the mass over the inertia is its negative.
    Real k6_per_k5() const {
        const Vector& t = rls_.theta();
        return -2 * t[2] / (track_m_ * t[1]);
    }

    void linear_gradient() {
        const Real y = rls_.theta()[kOffset];
        const Alone forward = forward_alone();
        const Alone turning = turning_alone(k6_per_k5());
        Row& row = row_[0];
        for (std::size_t i = 0; i < static_cast<std::size_t>(size_); ++i)
            row.phi[i] = forward.gradient[i] + y * turning.gradient[i];
        row.phi[kOffset] = turning.value;
        row.prediction = forward.value + y * turning.value;
    }

    void turning_gradient() {
        const Vector& t = rls_.theta();
        const Real per_k5 = k6_per_k5();
        const Real back = -t[kOffset] * per_k5;
        const Alone forward = forward_alone();
        const Alone turning = turning_alone(per_k5);
        Row& row = row_[1];
        for (std::size_t i = 0; i < static_cast<std::size_t>(size_); ++i)
            row.phi[i] = turning.gradient[i] + back * forward.gradient[i];
        row.phi[1] -= back * forward.value / t[1];
        row.phi[2] += back * forward.value / t[2];
        row.phi[kOffset] = -per_k5 * forward.value;
        row.prediction = turning.value + back * forward.value;
    }

    // Whether the row may teach. It is then weighed and projected.
    bool judge(Row& row, Real y) {
        const Real nominal = (y - row.prediction) * row.inverse_sigma;
        measure_noise(row, nominal);
        const Real root = 1 / std::sqrt(row.power);
        const Real weight = row.inverse_sigma * root;
        row.innovation = nominal * root;
        for (std::size_t i = 0; i < static_cast<std::size_t>(size_); ++i) row.phi[i] *= weight;
        if (row.seen < kRunRows || hold_rows_ > 0) return false;  // the other equation has just found a change
        row.projection = rls_.projection(row.phi);
        if (changed(row)) {
            hold_rows_ = kWindowRows;
            return false;
        }
        bool any = false;
        for (std::size_t i = 0; i < static_cast<std::size_t>(size_); ++i) any = any || excited_[i];
        return any;
    }

    // White noise of unit variance makes differences of variance 2.
    void measure_noise(Row& row, Real nominal) {
        const Real difference = nominal - row.before;
        row.before = nominal;
        if (std::exchange(row.follows, true)) {
            if (row.seen < kNoiseRows) ++row.seen;
            const Real limit = 2 * options_.gate_sigma * options_.gate_sigma * row.power;
            const Real square = row.seen > kRunRows ? std::min(difference * difference, limit) : difference * difference;
            row.power += (square / 2 - row.power) / static_cast<Real>(row.seen);
            row.power = std::max(row.power, kTinyPower);
        }
    }

    // Also keeps the powers of what the model does not explain.
    bool changed(Row& row) {
        const Real gate = options_.gate_sigma * options_.gate_sigma;
        const Real deviation = 1 + row.projection.variance;
        const Real square = row.innovation * row.innovation / deviation;
        const Real limit = gate * std::max(Real(1), row.level);
        row.level += (std::min(square, limit) - row.level) / kNoiseRows;
        if (square > limit) return true;
        row.run_sum += row.innovation / std::sqrt(deviation);
        if (++row.run < kRunRows) return false;
        const Real slow = row.run_sum * row.run_sum / kRunRows;
        const Real slow_limit = kSumGateShare * gate * std::max(Real(1), row.slow_power);
        row.slow_power += (std::min(slow, slow_limit) - row.slow_power) * kRunRows / kNoiseRows;
        row.run = 0;
        row.run_sum = 0;
        return slow > slow_limit;
    }

    void learn(Row& row) {
        Vector gain;
        const Real scale = rls_.update_gain(row.projection, gain) * row.innovation;
        for (std::size_t i = 0; i < static_cast<std::size_t>(size_); ++i) {
            if (!excited_[i]) continue;
            rls_.set_theta(static_cast<int>(i),
                           std::clamp(rls_.theta()[i] + gain[i] * scale, low_[i], high_[i]));
        }
    }

    void watch_excitation() {
        for (std::size_t i = 0; i < static_cast<std::size_t>(size_); ++i) {
            held_[i] = rls_.variance(static_cast<int>(i));
            const Real excitation = monitor_.excitation(static_cast<int>(i), held_[i]);
            excited_[i] = excitation >= options_.minimum_excitation;
            set_excitation(i, excitation);
        }
    }

    void publish() {
        const Vector& t = rls_.theta();
        const Real colour = std::max({Real(1), row_[0].slow_power, row_[1].slow_power});
        const auto error = [&](std::size_t i) { return std::sqrt(held_[i] * colour); };
        const Real k6 = model::coupled_k6(t[0], t[1], t[2], track_m_);
        const Real to_k6 = 2 * t[2] / (track_m_ * t[1]);
        estimate_.dynamics = {t[0], k6, t[1], t[2]};
        estimate_.covariance_diagonal = {held_[0], to_k6 * to_k6 * held_[0], held_[1], held_[2]};
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
    Rls rls_;
    ExcitationMonitor<Real, kSize> monitor_;
    std::array<Row, 2> row_{};
    std::array<ColumnPlace, model::kMaxEstimatedColumns> places_{};
    Vector low_{}, high_{}, held_{};
    std::array<bool, kSize> excited_{};
    Real interval_s_{}, track_m_{};
    int columns_ = 0;
    int size_ = static_cast<int>(kFixed);
    int hold_rows_ = 0;
    std::size_t doubtful_ = 0;  // of kDoubted: the next one
    Work work_ = Work::none;
    bool waited_ = false;
    DynamicsEstimate<Real> estimate_{};
};

}  // namespace wheelwright::ident
