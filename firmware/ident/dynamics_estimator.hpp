// K5..K8 and the effects' parameters from a robot that is being excited: the two regressions of paper
// eq (50)-(55), each with a column for each parameter of each active effect.
//
//   y1 = K5 omega^2 + K7 (tau_r + tau_l) + sum K7 p_j (c_j,r + c_j,l)
//   y2 = K6 v omega + K8 (tau_r - tau_l) + sum K8 p_j (c_j,r - c_j,l)
//
// What a drive does to the torque on its way is not known to a tenth of a millisecond, does not stay the same
// (frames wait for others on the bus, and the drives' clocks drift against ours), and differs between left
// and right. A tenth of a millisecond under bits of 20 ms leaves residuals three times the sensors' noise,
// coloured like the torque's derivative. So each equation has columns for it:
//   timing, own and cross   the torque's slope: what the delay, and the difference of the wheels' delays, are
//                           off by; both may wander (a random walk, kTimingMemory_s)
//   spread                  the torque's second difference: a lag about the delay, less the drive's filter.
//                           Without it a lag of 1 ms under bits of 10 ms makes K7 and K8 one per cent small
//   cross torque            the difference in y1, the sum in y2: wheels, gears or drives that are not equal
// Two more things are not known well enough:
//   cross products          v omega in y1, omega^2 and v^2 in y2: what K5 and K6 become where the wheels are
//                           not as alike as the geometry says, so that forward motion looks a little like
//                           turning, or where a load lies beside the middle. Without them radii 0.1 % off
//                           leave K6 ten standard errors off. Where one wheel goes backwards, v omega and v^2
//                           take the place of K5 and K6 (mirror_test.hpp)
//   slow torque             a wheel's torque while its sign of sliding is not known for sure, about a
//                           reversal. The friction column is wrong there, for longer after a reversal than
//                           before it: then friction works against the torque. Without this column K7 and K8
//                           are too small by the square of friction over torque, times the share of such time
//
// An effect's parameter is the ratio of its coefficient and K7 (or K8). What both equations know of the
// parameters is added up as information, so they come out where only both together tell them (with wheels
// that never reverse, one knows the sum of two frictions and the other their difference).
//
// Standard errors: score_errors.hpp. What was never excited has the error kUnknownError. Nothing is
// forgotten: this is for a robot that does not change meanwhile. For one that does, see
// adaptive_estimator.hpp.
//
// push() does one piece of a row's work in each of the five cycles that end a row and follow it, so no cycle
// bears all of it. No allocation.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "firmware/ident/cross_gains.hpp"
#include "firmware/ident/dynamics_estimate.hpp"
#include "firmware/ident/excitation_monitor.hpp"
#include "firmware/ident/mirror_test.hpp"
#include "firmware/ident/regression_filter.hpp"
#include "firmware/ident/score_errors.hpp"
#include "firmware/ident/student.hpp"
#include "firmware/ident/ud_rls.hpp"

namespace wheelwright::ident {

template <typename Real>
struct DynamicsEstimatorOptions {
    // filter.kernel_s: its blocks (two thirds of it) should have no common factor with the excitation's bits.
    // Rows locked to the bits see them always at the same phase, and what the taps leave of the drive's
    // response then does not average out: K7 and K8 0.015 % off with 20 ms and 20 ms.
    RegressionFilterOptions<Real> filter;
    Real relative_standard_error = Real(0.005);  // of K7 and K8, for estimate().good_enough
    Real coupling_standard_error_m = Real(1e9);  // of K5, and of K6 as a length (it is -K5 * 2 K8 / (b K7))
    // Dry friction over the excitation's torque. The slow torque's column takes most of what the friction
    // column is wrong by about a reversal. What coarse encoders leave is as large as the whole at most: this
    // share squared, times the share of the torque that is slow. It is part of K7's and K8's standard errors,
    // and what is believed of the slow torque's coefficient before the data tell.
    Real dry_share = 0;
    // The drives' lag about their delay, and the excitation's bit time. What the spread column leaves of a
    // lag is part of K7's and K8's standard errors.
    Real lag_s = 0, bit_time_s = 1;
    Real prior_variance = Real(1e6);  // P(-1) = c I
    Real excitation_memory_s = 2;
};

template <typename Real>
class DynamicsEstimator {
  public:
    static constexpr int kTaps = 3;

    void configure(const DynamicsEstimatorOptions<Real>& options) {
        relative_standard_error_ = options.relative_standard_error;
        coupling_standard_error_m_ = options.coupling_standard_error_m;
        dry_share_ = options.dry_share;
        prior_variance_ = options.prior_variance;
        sample_time_s_ = options.filter.sample_time_s;
        track_m_ = static_cast<Real>(options.filter.geometry.track_m);
        filter_.configure(options.filter);
        set_delay(options.filter.delay_s);
        least_error_share_ =
            std::hypot(kGainHolds, kOfABound * left_of_lag(options.lag_s, options.bit_time_s));
        columns_ = column_places(filter_.estimated(), places_);
        const int size = kFixed + columns_;
        Vector prior{};
        prior.fill(options.prior_variance);
        const Real interval_s = static_cast<Real>(filter_.block_samples() * options.filter.sample_time_s);
        timing_memory_rows_ = std::max(Real(1), static_cast<Real>(kTimingMemory_s) / interval_s);
        for (Equation& equation : equation_) {
            equation = {};
            equation.rls.reset(Vector{}, prior, size);
            equation.errors.reset(size - kTiming);
            equation.monitor.reset(1 - std::min(Real(0.5), interval_s / options.excitation_memory_s), prior,
                                   size);
        }
        influence_ = {};
        estimate_ = nothing_known<Real>(options.filter.effects.active);
        less_torque_ = false;
        rows_at_level_ = 0;
        work_ = Work::none;
    }

    void set_delay(double delay_s) {
        delay_s_ = delay_s;
        filter_.set_delay(delay_s, tap_spacing_s());
    }

    // The excitation tells less torque from now on, or all of it again.
    void set_less_torque(bool less) {
        if (less == less_torque_) return;
        less_torque_ = less;
        rows_at_level_ = 0;
    }

    // By which share of K7 and K8 a Nm of the lesser torque does more than one of the whole: drives that clip
    // deliver less of that. Of both equations, weighted by what each knows.
    struct GainExcess {
        Real share{}, standard_error = static_cast<Real>(kUnknownError);
    };
    GainExcess excess_of_less_torque() const {
        Real sum = 0, information = 0;
        std::uint32_t fewest = ~std::uint32_t{0};
        for (const Equation& equation : equation_) {
            const auto& [whole, less] = equation.level;
            const Real gain = equation.rls.theta()[kTorque];
            fewest = std::min(fewest, std::min(whole.rows, less.rows));
            if (fewest < 2 || !(gain > 0)) return {};
            const Real unlike = kNeighbours * (whole.variance() + less.variance()) / (gain * gain);
            sum += (less.gain - whole.gain) / gain / unlike;
            information += 1 / unlike;
        }
        // two equations' rows, of which each shares half with its neighbours
        constexpr Real kErrors = 4;
        return {sum / information,
                error_of_few(kErrors, static_cast<Real>(fewest - 1)) / std::sqrt(information)};
    }

    // After a gap in the samples. What was learned stays.
    void restart() { filter_.restart(); }

    // Once in each cycle. True when estimate() has become new.
    bool push(const IdentSample<Real>& sample) {
        if (filter_.push(sample)) {
            ++rows_at_level_;
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
                work_ = Work::publishing;
                return false;
            case Work::publishing:
                publish();
                work_ = Work::none;
                return true;
        }
        return false;
    }

    const DynamicsEstimate<Real>& estimate() const { return estimate_; }
    const RegressionFilter<Real, kTaps>& filter() const { return filter_; }

    // Of the torque columns: so that none lies before the torque was told.
    double tap_spacing_s() const { return std::min(kLargestTapSpacing_s, delay_s_ + 1.9 * sample_time_s_); }

    // Standard errors of K5, and of K6 as the length K5 that belongs to it.
    Real k5_error_m() const { return estimate_.standard_error.k5_m; }
    Real k6_error_m() const {
        const model::Dynamics<Real>& k = estimate_.dynamics;
        return estimate_.standard_error.k6_per_m * track_m_ * k.k7_per_kg_m / (2 * k.k8_per_kg_m2);
    }

    // How much of the slow acceleration, over runs of rows in which the sensors' noise cancels, the model
    // leaves unexplained: RMS over RMS, of y1 and y2. 0 until there is enough.
    WheelPair<Real> unexplained() const {
        const auto share = [](const Equation& e) {
            return e.motion_power > 0 ? std::sqrt(e.residual_power / e.motion_power) : Real(0);
        };
        return {share(equation_[0]), share(equation_[1])};
    }

    // For judge_mirror(). Errors are zero as long as there are none.
    CouplingTerms<Real> coupling_terms() const {
        CouplingTerms<Real> terms;
        for (std::size_t i = 0; i < 2; ++i) {
            const auto& theta = equation_[i].rls.theta();
            terms.filed[i] = {theta[kVelocityProduct], equation_[i].velocity_product_error};
            terms.mirrored[i] = {theta[kCrossProduct], equation_[i].mirrored_product_error};
        }
        terms.k7_per_kg_m = estimate_.dynamics.k7_per_kg_m;
        terms.k8_per_kg_m2 = estimate_.dynamics.k8_per_kg_m2;
        return terms;
    }

    // Torque gains beside K7 and K8: of the difference in y1, of the sum in y2. 0 for wheels that are equal.
    std::array<CrossGain, 2> cross_gains() const {
        const auto gain = [](const Equation& e) {
            return CrossGain{static_cast<double>(e.rls.theta()[kCrossTorque]),
                             static_cast<double>(e.cross_torque_error)};
        };
        return {gain(equation_[0]), gain(equation_[1])};
    }

    // The effects' parameters as they stand beside this in a robot file.
    model::EffectSet<Real> effects_beside(const Asymmetry& beside) const {
        model::EffectSet<Real> effects = estimate_.effects;
        const double prior = equation_[0].prior_information + equation_[1].prior_information;
        if (columns_ == 0 || !(prior > 0) || beside.offset_m == 0) return effects;
        const auto k8_over_k7 =
            static_cast<double>(estimate_.dynamics.k8_per_kg_m2 / estimate_.dynamics.k7_per_kg_m);
        std::array<ColumnVector, 2> value{equation_[0].effect, equation_[1].effect};
        for (int j = 0; j < columns_; ++j) {
            const ColumnPlace place = places_[static_cast<std::size_t>(j)];
            const auto seen =
                seen_of_one_wheel(model::side_of(place.effect, place.parameter), k8_over_k7, beside.mismatch,
                                  beside.offset_m, static_cast<double>(track_m_));
            for (std::size_t i = 0; i < 2; ++i) value[i](j) /= seen[i];
        }
        const ColumnVector all = joined(
            inverse(equation_[0].effect_information + equation_[1].effect_information), value[0], value[1]);
        for (int j = 0; j < columns_; ++j) {
            const ColumnPlace place = places_[static_cast<std::size_t>(j)];
            const Real error = estimate_.effects_standard_error.parameter[place.effect][place.parameter];
            if (error < static_cast<Real>(kUnknownError))
                effects.parameter[place.effect][place.parameter] = static_cast<Real>(all(j));
        }
        return effects;
    }

    // Of the residuals of y1 and y2 [m/s^2, rad/s^2, squared], for reports.
    TwistRate<Real> residual_variance() const { return {equation_[0].noise.mean, equation_[1].noise.mean}; }

  private:
    // Where what stands in theta.
    static constexpr int kTiming = 2;  // own and cross
    static constexpr int kVelocityProduct = 2;
    static constexpr int kTorque = 3;
    static constexpr int kCrossTorque = 5;   // behind spread
    static constexpr int kCrossProduct = 6;  // two; the first is a mirrored robot's
    static constexpr int kSlowTorque = 8;
    static constexpr int kFixed = 9;  // from here on the effects' columns
    static constexpr int kSize = kFixed + static_cast<int>(model::kMaxEstimatedColumns);
    static constexpr int kMaxColumns = static_cast<int>(model::kMaxEstimatedColumns);
    static constexpr double kLargestTapSpacing_s = 0.003;
    static constexpr double kTimingMemory_s = 0.8;  // how long the data tell a delay that wanders
    // Standard errors from fewer are too uncertain to stop on.
    static constexpr std::uint32_t kRowsToJudge = 500;
    static constexpr int kRunRows = 16;
    // Of what the model does not explain, how much may go with the torque and so be taken for K7 or K8: the
    // cosine between the two, for effects that the torque does not know of.
    static constexpr Real kShareInGain = Real(0.1);
    // Standard deviation of what may be anything between two bounds, over a bound: 1 / sqrt(3).
    static constexpr Real kOfABound = Real(0.577);
    // What no K7 and K8 are known better than, as a share of themselves: magnets lose a thousandth of their
    // flux a kelvin, and no drive stays the same to a twentieth of one for a minute. And K5, as a share of
    // the track: where a tyre touches the ground moves by more. What laws of friction that are not listed put
    // into the parameters is as large.
    static constexpr Real kGainHolds = Real(5e-5);
    static constexpr Real kContactHolds = Real(1e-4);
    static constexpr Real kNotExcited = Real(0.5);  // of the prior variance, left
    static constexpr int kMixedRows = 7;            // three blocks, the delay and the speeds' span
    // Neighbouring rows share blocks, and so the plant's noise: of variance, what no rows of its own say.
    static constexpr Real kNeighbours = 2;
    using Vector = std::array<Real, kSize>;
    using Errors = ScoreErrors<Real, kSize - kTiming>;
    // The first columns_ rows and columns are in use, the others zero.
    using ColumnVector = Eigen::Matrix<double, kMaxColumns, 1>;
    using ColumnMatrix = Eigen::Matrix<double, kMaxColumns, kMaxColumns>;
    enum class Work : std::uint8_t { none, linear, turning, linear_errors, turning_errors, publishing };

    // The rows' noise is not the same at all times: while the drives' frames queue in front of a torque, its
    // delay jumps, and a row may be ten times as noisy as a second later. So rows are weighed by the noise of
    // those just before them, which knows nothing of their own.
    struct NoisePower {
        static constexpr std::uint32_t kMemory = 10;  // rows
        static constexpr Real kBelief = Real(0.1);    // of the mean, in what is taken for the noise now
        Real now = 0, mean = 0;
        std::uint32_t rows = 0;

        void push(Real power) {
            ++rows;
            mean += (power - mean) / static_cast<Real>(rows);
            now += (power - now) / static_cast<Real>(std::min(rows, kMemory));
        }
        Real weight() const { return mean > 0 ? std::sqrt(mean / (now + kBelief * (mean - now))) : Real(1); }
    };

    // What one level of the torque says of the torque's gain beyond theta: the innovations' regression on the
    // torque, with White's error of what that leaves.
    struct Level {
        Real power = 0, gain = 0, score_power = 0;
        std::uint32_t rows = 0;

        void push(Real torque, Real innovation) {
            if (torque == 0) return;
            ++rows;
            const Real score = torque * (innovation - gain * torque);
            power += torque * torque;
            gain += score / power;
            score_power += score * score;
        }
        Real variance() const { return score_power / (power * power); }
    };

    // Of what two parameters err by.
    struct Together {
        Real product = 0, one = 0, other = 0;

        void push(Real a, Real b) {
            product += a * b;
            one += a * a;
            other += b * b;
        }
        Real correlation() const { return product == 0 ? Real(0) : product / std::sqrt(one * other); }
    };

    struct Equation {
        NoisePower noise;
        std::array<Level, 2> level{};  // whole, less
        UdRls<Real, kSize, true> rls;
        Errors errors;
        ExcitationMonitor<Real, kSize> monitor;
        Real run_residual = 0, run_motion = 0;  // of the last rows
        Real residual_power = 0, motion_power = 0;
        int run = 0;
        std::uint32_t runs = 0;
        Real torque_power = 0,
             slow_power = 0;    // of the torque: sum of squares, and the slow torque's share in it
        Real timing_power = 0;  // mean square of the timing columns
        Real velocity_product_influence{};  // of the newest rows, over the parameter's variance
        Real velocity_product_error{};      // standard errors
        Real mirrored_product_error{};
        Real torque_error{};
        Real cross_torque_error{};
        ColumnVector effect = ColumnVector::Zero();  // the effects' parameters as this equation sees them
        ColumnMatrix effect_covariance = ColumnMatrix::Zero();
        ColumnMatrix effect_information =
            ColumnMatrix::Zero();      // for residuals without colour: how the equations are weighed
        double prior_information = 0;  // the part of it that was there before any data
    };

    void update_linear() {
        const RegressionRow<Real, kTaps>& row = filter_.row();
        regress(equation_[0], 1, row.omega_squared, {row.v_omega, 0}, row.acceleration.v_m_per_s2);
    }
    void update_turning() {
        const RegressionRow<Real, kTaps>& row = filter_.row();
        regress(equation_[1], -1, row.v_omega, {row.v_squared, row.omega_squared},
                row.acceleration.omega_rad_per_s2);
    }
    // `left`: the sign with which the left wheel takes part.
    void regress(Equation& equation, Real left, Real velocity_product,
                 const std::array<Real, 2>& cross_product, Real y) {
        const auto own = [left](const WheelPair<Real>& pair) { return pair.right + left * pair.left; };
        const auto cross = [left](const WheelPair<Real>& pair) { return pair.right - left * pair.left; };
        const RegressionRow<Real, kTaps>& row = filter_.row();
        const auto& [early, torque, late] = row.torque_Nm;
        const Real timing = own(late) - own(early);
        const Real spread = own(early) + own(late) - 2 * own(torque);
        Vector phi{timing,
                   cross(late) - cross(early),
                   velocity_product,
                   own(torque),
                   spread,
                   cross(torque),
                   cross_product[0],
                   cross_product[1],
                   own(row.slow_torque_Nm)};
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j)
            phi[kFixed + j] = own(row.column[j]);
        equation.monitor.push(phi);
        equation.monitor.settle();
        equation.torque_power += phi[kTorque] * phi[kTorque];
        equation.slow_power += phi[kTorque] * phi[kSlowTorque];
        const Real innovation = equation.rls.innovation(phi, y);
        const Real weight = equation.noise.weight();
        let_timing_wander(equation, timing, weight);
        for (Real& x : phi) x *= weight;
        const auto projection = equation.rls.projection(phi);
        equation.rls.update_projected(projection, weight * innovation);
        const Real normal = innovation / std::sqrt(1 + projection.variance);
        typename Errors::Vector shared{};
        std::copy_n(phi.begin() + kTiming, kFixed - kTiming + columns_, shared.begin());
        equation.errors.push(shared, weight * normal);
        if (equation.errors.settled()) {
            equation.noise.push(normal * normal);
            if (rows_at_level_ > kMixedRows)
                equation.level[less_torque_ ? 1U : 0U].push(phi[kTorque], weight * innovation);
        }
        if (equation.noise.rows == NoisePower::kMemory) believe_slow(equation);
        equation.run_residual += normal;  // what parameters not yet known mispredict is nothing missing
        equation.run_motion += y;
        if (++equation.run == kRunRows) {
            if (estimate_.rows > kRowsToJudge / 2) {
                equation.residual_power += equation.run_residual * equation.run_residual;
                equation.motion_power += equation.run_motion * equation.run_motion;
                ++equation.runs;
            }
            equation.run_residual = equation.run_motion = 0;
            equation.run = 0;
        }
    }

    // A random walk so large that the data of kTimingMemory_s tell it: the window over which a parameter with
    // regressor power p and walk q (per row, in units of the noise) is averaged is 1 / sqrt(p q).
    void let_timing_wander(Equation& equation, Real timing, Real weight) {
        const Real share = 1 / static_cast<Real>(estimate_.rows + 1);
        equation.timing_power += share * (timing * timing - equation.timing_power);
        const Real window = timing_memory_rows_ * timing_memory_rows_ * equation.timing_power;
        if (!(window > 0)) return;
        const Real walk = std::min(1 / (window * weight * weight), prior_variance_);
        for (int i = 0; i < kTiming; ++i) equation.rls.add_variance(i, walk);
    }

    // The slow torque's coefficient is K7 (K8) times the square of friction's share at most. As soon as the
    // noise tells what that weighs against the data, this belief joins them as a measurement: where friction
    // is small the column then costs K7 and K8 nothing, where it is large the data decide.
    [[gnu::noinline]] void believe_slow(Equation& equation) {
        const Real size = slow_error_share() * equation.rls.theta()[kTorque];
        if (size == 0) return;
        Vector phi{};
        phi[kSlowTorque] = std::sqrt(equation.noise.mean) / size;
        equation.rls.update_with_innovation(phi, -phi[kSlowTorque] * equation.rls.theta()[kSlowTorque]);
    }

    typename Errors::Vector covariances(const Equation& equation, int parameter) const {
        typename Errors::Vector p{};
        for (int k = kTiming; k < kFixed + columns_; ++k)
            p[static_cast<std::size_t>(k - kTiming)] = equation.rls.covariance(parameter, k);
        return p;
    }

    // Standard errors, and what the equation knows of the effects' parameters (first-order propagation).
    void refresh(Equation& equation) {
        equation.velocity_product_error = slow_error(equation, kVelocityProduct);
        equation.velocity_product_influence =
            equation.errors.influence(covariances(equation, kVelocityProduct)) /
            equation.rls.variance(kVelocityProduct);
        equation.mirrored_product_error = slow_error(equation, kCrossProduct);
        equation.cross_torque_error = slow_error(equation, kCrossTorque);
        std::array<typename Errors::Vector, model::kMaxEstimatedColumns + 1>
            p;  // of the torque, and of each effect
        p[0] = covariances(equation, kTorque);
        for (int j = 0; j < columns_; ++j)
            p[static_cast<std::size_t>(j) + 1] = covariances(equation, kFixed + j);

        const double gain = static_cast<double>(equation.rls.theta()[kTorque]);
        Eigen::Matrix<double, kMaxColumns + 1, kMaxColumns + 1> covariance;
        for (int i = 0; i <= columns_; ++i) {
            const auto middle = equation.errors.apply(p[static_cast<std::size_t>(i)]);
            for (int j = 0; j <= i; ++j) {
                Real sum = 0;
                for (std::size_t k = 0; k < middle.size(); ++k)
                    sum += p[static_cast<std::size_t>(j)][k] * middle[k];
                covariance(i, j) = covariance(j, i) = static_cast<double>(sum);
            }
        }
        equation.torque_error = error(equation, kTorque, static_cast<Real>(covariance(0, 0)));
        if (columns_ == 0 || gain == 0) return;

        ColumnMatrix bare = ColumnMatrix::Zero();
        for (int i = 0; i < columns_; ++i)
            equation.effect(i) =
                static_cast<double>(equation.rls.theta()[static_cast<std::size_t>(kFixed + i)]) / gain;
        for (int i = 0; i < columns_; ++i) {
            for (int j = 0; j < columns_; ++j) {
                const double a = equation.effect(i);
                const double b = equation.effect(j);
                equation.effect_covariance(i, j) = (covariance(i + 1, j + 1) - a * covariance(0, j + 1) -
                                                    b * covariance(0, i + 1) + a * b * covariance(0, 0)) /
                                                   (gain * gain);
                bare(i, j) = static_cast<double>(
                    p[static_cast<std::size_t>(i) + 1][static_cast<std::size_t>(kFixed - kTiming + j)]);
            }
        }
        const double unit = gain * gain / static_cast<double>(equation.errors.residual_variance());
        equation.effect_information = unit * inverse(bare);
        equation.prior_information = unit / static_cast<double>(prior_variance_);
    }

    // Of a symmetric positive matrix whose scales may differ by many powers of ten: Gauss-Jordan, which needs
    // no pivots here, on the matrix scaled to a diagonal of ones.
    [[gnu::noinline]] ColumnMatrix inverse(const ColumnMatrix& matrix) const {
        ColumnVector scale = ColumnVector::Zero();
        for (int i = 0; i < columns_; ++i) scale(i) = 1 / std::sqrt(std::max(matrix(i, i), 1e-300));
        ColumnMatrix work = ColumnMatrix::Zero();
        ColumnMatrix result = ColumnMatrix::Zero();
        for (int i = 0; i < columns_; ++i) {
            for (int j = 0; j < columns_; ++j) work(i, j) = scale(i) * matrix(i, j) * scale(j);
            result(i, i) = 1;
        }
        for (int k = 0; k < columns_; ++k) {
            const double pivot = 1 / std::max(work(k, k), 1e-300);
            for (int j = 0; j < columns_; ++j) {
                work(k, j) *= pivot;
                result(k, j) *= pivot;
            }
            for (int i = 0; i < columns_; ++i) {
                const double factor = work(i, k);
                if (i == k) continue;
                for (int j = 0; j < columns_; ++j) {
                    work(i, j) -= factor * work(k, j);
                    result(i, j) -= factor * result(k, j);
                }
            }
        }
        for (int i = 0; i < columns_; ++i)
            for (int j = 0; j < columns_; ++j) result(i, j) *= scale(i) * scale(j);
        return result;
    }

    // By which share a lag T makes a gain too small: at the frequency w it takes (w T)^2 / 2 - 3/8 (w T)^4 of
    // it, and a second difference of taps d apart w^2 d^2 - w^4 d^4 / 12 times what makes the squares alike.
    Real left_of_lag(Real lag_s, Real bit_time_s) const {
        constexpr Real kFastest = Real(2.3);  // w over the bits' rate: 0.64 of their power is slower
        const Real w = kFastest / bit_time_s;
        const Real lag = w * lag_s;
        const Real taps = w * static_cast<Real>(tap_spacing_s());
        return lag * lag * std::abs(Real(3) / 8 * lag * lag - taps * taps / 24);
    }

    // Standard error of the slow torque's coefficient, over K7 or K8, where the data do not tell it.
    Real slow_error_share() const { return kOfABound * dry_share_ * dry_share_; }

    // What a Nm of less torque does more than one of the whole, beyond chance, over K7 or K8: so much of the
    // whole may not have arrived.
    Real excess_error_share() const {
        const GainExcess excess = excess_of_less_torque();
        return std::max(excess.share - 2 * excess.standard_error, Real(0));
    }

    // The share of the slow acceleration that something missing may stand behind: what is unexplained beyond
    // white noise on the plant (rows average it with a quadratic B-spline, so that of its power 0.55 stands
    // in a row and all of it in long runs) and beyond a standard deviation of what so many runs show of it,
    // and of the rest some, for noise hides as much.
    Real missing_share(const Equation& e) const {
        if (!(e.motion_power > 0)) return 0;
        constexpr Real kInARow = Real(0.55);
        constexpr Real kHidden = Real(0.2);
        const Real white = static_cast<Real>(e.runs) * kRunRows * e.noise.mean / kInARow;
        const Real chance = std::sqrt(2 / static_cast<Real>(e.runs));
        const Real beyond = std::max(e.residual_power - white * (1 + chance), Real(0));
        return std::sqrt((beyond + kHidden * kHidden * (e.residual_power - beyond)) / e.motion_power);
    }

    void publish() {
        const Equation& linear = equation_[0];
        const Equation& turning = equation_[1];
        const auto& a = linear.rls;
        const auto& b = turning.rls;
        estimate_.dynamics = {a.theta()[kVelocityProduct], b.theta()[kVelocityProduct], a.theta()[kTorque],
                              b.theta()[kTorque]};
        estimate_.covariance_diagonal = {a.variance(kVelocityProduct), b.variance(kVelocityProduct),
                                         a.variance(kTorque), b.variance(kTorque)};
        const model::Dynamics<Real>& p = estimate_.covariance_diagonal;
        estimate_.excitation = {linear.monitor.excitation(kVelocityProduct, p.k5_m),
                                turning.monitor.excitation(kVelocityProduct, p.k6_per_m),
                                linear.monitor.excitation(kTorque, p.k7_per_kg_m),
                                turning.monitor.excitation(kTorque, p.k8_per_kg_m2)};
        influence_.push(linear.velocity_product_influence, turning.velocity_product_influence);
        if (estimate_.rows < linear.errors.fewest_rows()) return;  // errors stay unknown
        const Real excess = excess_error_share();
        const auto widened = [&](const Equation& e, Real k) {
            const Real slow = e.torque_power > 0 ? e.slow_power / e.torque_power : Real(0);
            return std::hypot(e.torque_error, k * kOfABound * kShareInGain * missing_share(e),
                              k * std::hypot(slow_error_share() * slow, least_error_share_, excess));
        };
        estimate_.standard_error = {linear.velocity_product_error, turning.velocity_product_error,
                                    widened(linear, estimate_.dynamics.k7_per_kg_m),
                                    widened(turning, estimate_.dynamics.k8_per_kg_m2)};
        join_coupling();
        publish_effects();
        const model::Dynamics<Real>& k = estimate_.dynamics;
        const model::Dynamics<Real>& e = estimate_.standard_error;
        estimate_.good_enough = estimate_.rows >= kRowsToJudge && k.k7_per_kg_m > 0 && k.k8_per_kg_m2 > 0 &&
                                e.k7_per_kg_m <= relative_standard_error_ * k.k7_per_kg_m &&
                                e.k8_per_kg_m2 <= relative_standard_error_ * k.k8_per_kg_m2 &&
                                k5_error_m() <= coupling_standard_error_m_ &&
                                k6_error_m() <= coupling_standard_error_m_;
    }

    // K5 and K6 are one free parameter: K6 = -K5 K8 / (h K7), with half the track h, or the coupling would
    // make power. So each equation measures what the other does, unless they disagree: then something is
    // missing. Of wheels that are unlike by a share r, with a centre of gravity beside the middle, the
    // relation is off by r (x8 / K8 - x7 / K7) with the cross torques' gains x7 and x8; r is not known, but
    // not larger than both. Where one wheel is noisier than the other both equations err together, and their
    // mean is worth less; that they err against each other is not believed, the correlation is too uncertain.
    void join_coupling() {
        constexpr Real kAgree = 3;  // standard errors
        model::Dynamics<Real>& k = estimate_.dynamics;
        model::Dynamics<Real>& e = estimate_.standard_error;
        if (!(k.k7_per_kg_m > 0) || !(k.k8_per_kg_m2 > 0)) return;
        const Real unit_m2 = -track_m_ * k.k7_per_kg_m / (2 * k.k8_per_kg_m2);  // of K6, as a length
        const Real unlike = equation_[0].rls.theta()[kCrossTorque] / k.k7_per_kg_m;
        const Real beside = equation_[1].rls.theta()[kCrossTorque] / k.k8_per_kg_m2;
        const auto square = [](Real value) { return value * value; };
        const Real holds_m = kContactHolds * track_m_;
        e.k5_m = std::hypot(e.k5_m, holds_m);
        e.k6_per_m = std::hypot(e.k6_per_m, holds_m / unit_m2);
        const Real turning_m = unit_m2 * k.k6_per_m;
        const Real apart_m = k.k5_m - turning_m;
        const Real a = square(e.k5_m);
        const Real b = square(unit_m2 * e.k6_per_m);
        const Real relation =
            square(std::max(std::abs(unlike), std::abs(beside)) * (unlike - beside) * k.k5_m);
        const Real shared = std::max(-influence_.correlation(), Real(0)) * std::sqrt(a * b);  // unit_m2 < 0
        const Real all = a + b + relation;
        if (!(a > 0) || !(b > 0) || !(square(apart_m) <= square(kAgree) * all)) return;
        k.k5_m -= apart_m * a / all;
        k.k6_per_m = (turning_m + apart_m * b / all) / unit_m2;
        const Real widened = 1 + 2 * shared / all;
        e.k5_m = std::sqrt(widened * a * (b + relation) / all);
        e.k6_per_m = std::sqrt(widened * b * (a + relation) / all) / std::abs(unit_m2);
    }

    // What both equations know of the effects' parameters, each from what it finds; `spread`: the inverse of
    // the sum of both informations.
    ColumnVector joined(const ColumnMatrix& spread, const ColumnVector& by_linear,
                        const ColumnVector& by_turning) const {
        return spread *
               (equation_[0].effect_information * by_linear + equation_[1].effect_information * by_turning);
    }

    void publish_effects() {
        if (columns_ == 0) return;
        const ColumnMatrix& one = equation_[0].effect_information;
        const ColumnMatrix& other = equation_[1].effect_information;
        const double prior = equation_[0].prior_information + equation_[1].prior_information;
        if (!(prior > 0)) return;
        const ColumnMatrix spread = inverse(one + other);
        const ColumnVector value = joined(spread, equation_[0].effect, equation_[1].effect);
        const ColumnMatrix covariance =
            spread *
            (one * equation_[0].effect_covariance * one + other * equation_[1].effect_covariance * other) *
            spread;
        for (int j = 0; j < columns_; ++j) {
            const ColumnPlace place = places_[static_cast<std::size_t>(j)];
            const bool known = spread(j, j) * prior < static_cast<double>(kNotExcited);
            estimate_.effects.parameter[place.effect][place.parameter] =
                known ? static_cast<Real>(value(j)) : Real(0);
            estimate_.effects_standard_error.parameter[place.effect][place.parameter] =
                known ? static_cast<Real>(std::sqrt(std::max(covariance(j, j), 0.0)))
                      : static_cast<Real>(kUnknownError);
        }
    }

    Real error(const Equation& equation, int parameter, Real variance) const {
        if (equation.rls.variance(parameter) > kNotExcited * prior_variance_)
            return static_cast<Real>(kUnknownError);
        return std::sqrt(std::max(variance, Real(0)));
    }
    // Of a parameter whose regressor is slow, so that a few strong rows decide the sandwich.
    Real slow_error(const Equation& equation, int parameter) const {
        const auto p = covariances(equation, parameter);
        return error(equation, parameter,
                     std::max(equation.errors.covariance(p, p),
                              equation.rls.variance(parameter) * equation.errors.residual_density()));
    }

    Real relative_standard_error_{}, coupling_standard_error_m_{}, dry_share_{}, least_error_share_{},
        prior_variance_{}, track_m_{};
    double sample_time_s_{}, delay_s_{};
    RegressionFilter<Real, kTaps> filter_;
    std::array<Equation, 2> equation_{};
    Together influence_;  // on K5 and K6
    std::array<ColumnPlace, model::kMaxEstimatedColumns> places_{};
    int columns_ = 0;
    Real timing_memory_rows_ = 1;
    bool less_torque_ = false;
    int rows_at_level_ = 0;
    Work work_ = Work::none;
    DynamicsEstimate<Real> estimate_{};
};

}  // namespace wheelwright::ident
