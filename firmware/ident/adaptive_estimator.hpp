// K5..K8 and the effects' parameters of a robot that is driving and may change: a payload, a wheel, the
// floor.
//
// A load may lie anywhere, so mass, inertia and both coordinates of the centre of gravity may change; a load
// beside the middle line couples forward motion and turning, and so do drives that are unlike. The torque
// that a motion takes is linear in all of them (Newton-Euler about the middle of the axle):
//
//     S + g D + friction's sum        = A v'     - sx omega^2       - sy omega'
//     D + g S + friction's difference = B omega' + sx (2/b) v omega - sy (2/b) v'
//
// S, D: sum and difference (right - left) of the wheels' torque; A = r m_eff, B = 2 r I_eff / b, (sx, sy): r
// times the mass times its centre's place ahead of the axle and left of the middle; g: the drives' gain
// mismatch. Hence
//
//     K5 = sx / A     K6 = -K5 2 K8 / (b K7)     K7 = 1 / A     K8 = 1 / B
//
// as in a robot file that lists the offset and the mismatch. estimate() gives what a torque does in its own
// direction, as ident mode does (cross_gains.hpp: seen_together).
//
// A recursive least-squares update (U-D) over
//     theta = (A, B, sx, sy, g, p_1 .. p_n)
// to which both rows contribute. Being linear, it finds its way from any doubt: the same regression with
// accelerations predicted from torques is bilinear, and after a large change its first rows settle what they
// should only have narrowed. The price is noise in the regressors v' and omega', which would pull A and B to
// zero where the robot hardly accelerates. So the covariance and the gain see the measured accelerations
// moved towards those that the model expects, by the share that the sensors have in the residual: what is
// left of the sensors' noise in them and what they then have of the torque's disturbance pull by as much,
// against each other. Only the residual has the measured ones (an instrumental variable: Soderstrom and
// Stoica 1983).
//
// What the model lacks, friction above all, changes slowly: residuals resemble the one before. Rows are
// therefore whitened: from each, regressors and torque alike, `colour` times the one before is taken, and
// `colour` is learned so that no likeness is left (Cochrane and Orcutt 1949).
//
// Directional forgetting with the memory `memory_s`. A row that tells less than would be forgotten for it is
// not learned from, and none while neither A nor B is excited: where nothing excites a parameter it stays,
// however long; one held alone would leave the others wrong that go with it. Rows with slip, saturation in
// the drive, or a standing wheel are masked. `minimum_excitation` (excitation_monitor.hpp) is for frozen(),
// and for believing sums of innovations.
//
// Noise: rows are weighed by the power of their own innovations, of single rows or of sums over kRunRows,
// whichever is larger (the second is what a model that is not complete leaves), and at least by kBestModel of
// the torque that accelerates. It is learned from times without a change, so that a change does not hide
// itself.
//
// Change detection: an innovation beyond `gate_sigma` of its own deviation stops the use of rows until the
// averaging window has passed the event. So do sums of innovations that go with the load's regressors, all
// four together, over about the last memory, beyond kSumGate: a smaller change, seen later. What a load can
// change is then doubted: A and B by `doubt` (relative), sx and sy by what a load of that share shifts at the
// track's edge; the rows that follow settle them. A jolt thus costs a fresh look, never a wrong row. A change
// smaller than the memory's rows can show is not seen: see docs/driving.md.
//
// Standard errors: of K7 and K8, what the regression says and what a load that nobody noticed may have left:
// evenly anything up to what the sums of innovations would have shown by now, whatever else it changes. They
// grow while a robot stands. Of the others sqrt(P_ii), in units of that noise.
//
// push() spreads a row's work over the cycles after it: at most about 1 700 instructions in one. No
// allocation.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "firmware/ident/cross_gains.hpp"
#include "firmware/ident/dynamics_estimate.hpp"
#include "firmware/ident/excitation_monitor.hpp"
#include "firmware/ident/regression_filter.hpp"
#include "firmware/ident/ud_rls.hpp"

namespace wheelwright::ident {

template <typename Real>
struct AdaptiveEstimatorOptions {
    RegressionFilterOptions<Real> filter;  // kernel_s: longer than ident mode's, as driving excites slowly
    model::Dynamics<Real> dynamics;        // where to start, with its standard error (k6: not used)
    model::Dynamics<Real> standard_error;
    model::EffectSet<Real> effects;  // start values
    model::EffectSet<Real> effects_standard_error;
    Real memory_s = 4;
    Real minimum_excitation = Real(0.05);
    Real trust_relative_error = Real(0.05);
    Real range = 3;                     // factor by which K7 and K8 may leave the start values
    Real angle_noise_rad = Real(3e-4);  // deviation of a wheel angle: where the rows' noise begins
    Real gate_sigma = 6;
    Real doubt = Real(0.3);
};

template <typename Real>
class AdaptiveEstimator {
  public:
    void configure(const AdaptiveEstimatorOptions<Real>& options) {
        options_ = options;
        filter_.configure(options.filter);
        columns_ = column_places(filter_.estimated(), places_);
        size_ = static_cast<int>(kFixed) + columns_;
        const auto dt = static_cast<Real>(options.filter.sample_time_s);
        const auto m = static_cast<Real>(filter_.block_samples());
        const Real interval_s = m * dt;
        track_m_ = static_cast<Real>(options.filter.geometry.track_m);
        per_track_ = 2 / track_m_;

        const model::Dynamics<Real>& k = options.dynamics;
        const Real a = 1 / k.k7_per_kg_m;
        const Real b = 1 / k.k8_per_kg_m2;
        const Real error7 = std::max(options.standard_error.k7_per_kg_m / k.k7_per_kg_m, kLeastError);
        const Real error8 = std::max(options.standard_error.k8_per_kg_m2 / k.k8_per_kg_m2, kLeastError);
        const Real error5_m =
            std::max({options.standard_error.k5_m, std::abs(k.k5_m) / 5, kLeastError * track_m_});
        lateral_ = options.effects.active[model::kCogLateral];
        listed_mismatch_ = model::listed_mismatch(options.effects);
        Vector theta{a, b, a * k.k5_m};
        if (lateral_) theta[kLeft] = a * options.effects.parameter[model::kCogLateral][0];
        Vector error{a * error7, b * error8, a * error5_m, a * kOffsetError * track_m_, kMismatchError};
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j) {
            const ColumnPlace p = places_[j];
            theta[kFixed + j] = options.effects.parameter[p.effect][p.parameter];
            error[kFixed + j] = std::max(options.effects_standard_error.parameter[p.effect][p.parameter],
                                         kLeastEffectError * std::abs(theta[kFixed + j]));
        }
        least_ = {theta[kMass] / options.range, theta[kInertia] / options.range};

        Vector variance{};
        Vector ceiling{};
        for (std::size_t i = 0; i < size(); ++i) {
            variance[i] = std::max(error[i] * error[i], kTinyVariance);
            Real widest = 3 * error[i];
            if (i == kMass || i == kInertia) widest = std::max(error[i], theta[i] / 2);
            if (i == kAhead || i == kLeft) widest = std::max(widest, a * track_m_ / 2);
            ceiling[i] = std::max(widest * widest, kTinyVariance);
        }
        rls_.reset(theta, variance, size_);
        forgotten_ = std::min(Real(0.5), interval_s / options.memory_s);
        const Real lambda = 1 - forgotten_;
        rls_.set_forgetting(Forgetting::directional, lambda);
        for (const std::size_t i : {kMass, kInertia}) {
            const Real least = kAlertness * theta[i];
            rls_.set_bounds(static_cast<int>(i), least * least);
        }
        monitor_.reset(lambda, ceiling, size_);
        window_rows_ = std::max(2 * kFewestRows, static_cast<int>(options.memory_s / interval_s));

        // angle noise of a block's mean, differenced twice: variance 6
        const Real wheel = options.angle_noise_rad * std::sqrt(6 / m) / (interval_s * interval_s);
        const Real rim = wheel * static_cast<Real>(options.filter.geometry.mean_radius_m());
        row_ = {};
        colour_ = 0;
        to_learn_from_ = false;
        row_[0].power = row_[0].least = std::max(rim * rim / 2 * a * a, kTinyVariance);
        row_[1].power = row_[1].least =
            std::max(rim * rim / 2 * per_track_ * per_track_ * b * b, kTinyVariance);
        was_quiet_ = true;
        window_ = {.keep = 1 - Real(1) / static_cast<Real>(2 * window_rows_)};
        hold_rows_ = 0;
        doubtful_ = 0;
        excited_.fill(false);
        estimate_ = {};
        estimate_.effects.active = filter_.estimated();
        estimate_.effects.active[model::kCogLateral] = lateral_;
        work_ = Work::none;
        held_ = variance;
        watch_excitation();
        excited_.fill(false);
        publish();
    }

    void set_delay(double delay_s) { filter_.set_delay(delay_s); }

    // After a gap in the samples. What was learned stays.
    void restart() { filter_.restart(); }

    // Once in each cycle. True when estimate() has become new. `busy`: the cycle has other work to do, so a
    // row's waits if it will be done before the next row all the same.
    bool push(const IdentSample<Real>& sample, bool busy = false) {
        if (filter_.push(sample)) {
            begin_row();
            cycles_left_ = filter_.block_samples();
            return false;
        }
        --cycles_left_;
        if (work_ == Work::none || (busy && cycles_left_ > kSteps)) return false;
        return work_on_row();
    }

    const DynamicsEstimate<Real>& estimate() const { return estimate_; }

    // Deviation of a row's acceleration, from sensors and from what the model does not know, at a wheel's
    // rim, forward and turning; and the time between rows.
    WheelPair<Real> row_noise_m_per_s2() const {
        return {std::sqrt(noise(row_[0])) / rls_.theta()[kMass],
                std::sqrt(noise(row_[1])) / rls_.theta()[kInertia] * track_m_ / 2};
    }
    Real row_interval_s() const {
        return static_cast<Real>(filter_.block_samples() * options_.filter.sample_time_s);
    }

    // Whether parameter K5, K7, K8 is held for lack of excitation.
    struct Frozen {
        bool k5, k7, k8;
    };
    Frozen frozen() const { return {!excited_[kAhead], !excited_[kMass], !excited_[kInertia]}; }

    // Rows still to pass before the doubt after a detected change is applied; 0 otherwise.
    int rows_held() const { return hold_rows_; }

    const RegressionFilter<Real>& filter() const { return filter_; }

  private:
    // Where what stands in theta; the first kLoad are what a load can change.
    static constexpr std::size_t kMass = 0, kInertia = 1, kAhead = 2, kLeft = 3, kLoad = 4, kMismatch = 4;
    static constexpr std::size_t kWatched = 3;  // the first, whether they are excited
    static constexpr std::size_t kFixed = 5;
    static constexpr int kSize = static_cast<int>(kFixed + model::kMaxEstimatedColumns);
    static constexpr int kSteps = 16;      // cycles that a row's work takes, with a doubt
    static constexpr int kWindowRows = 3;  // rows that one event can touch
    static constexpr int kFewestRows = 4;  // that a change is seen from, unless one alone shows it
    static constexpr int kRunRows = 16;
    static constexpr int kNoiseRows = 300;  // over which the noise is averaged
    // Of sums of innovations over their deviation, squared: of four, chance alone is beyond it as seldom as
    // one is beyond five deviations.
    static constexpr Real kSumGate = Real(34.5);
    static constexpr Real kAlike = Real(1e-6);  // relative: regressors that differ by less are the same
    static constexpr Real kNoiseAtFirst = Real(0.02);      // of the torque, until it is measured
    static constexpr Real kBestModel = Real(0.01);         // of the accelerating torque: no model is better
    static constexpr Real kLeastError = Real(0.01);        // relative, of K7 and K8 at the start
    static constexpr Real kLeastEffectError = Real(0.05);  // relative, of the effects' parameters
    static constexpr Real kAlertness = Real(5e-4);         // relative error that is never undercut
    static constexpr Real kOffsetError = Real(0.05);       // of the track: batteries, a motor on one side
    static constexpr Real kMismatchError = Real(0.1);      // motor constants of one kind, and a weak drive
    static constexpr Real kMostColour = Real(0.95);        // a row's likeness to the one before
    static constexpr Real kTinyVariance = Real(1e-14);
    using Vector = std::array<Real, kSize>;
    using Rls = UdRls<Real, kSize, true>;
    using LoadVector = Eigen::Matrix<Real, static_cast<int>(kLoad), 1>;
    using LoadMatrix = Eigen::Matrix<Real, static_cast<int>(kLoad), static_cast<int>(kLoad)>;
    enum class Work : std::uint8_t {
        none,
        doubt,
        linear_instrument,
        turning_instrument,
        linear,
        learn_linear,
        turning,
        learn_turning,
        monitor_linear,
        monitor_turning,
        monitor_settles,
        compare,
        hold_variances,
        watch,
        doubt_mass,
        doubt_inertia,
        publish
    };

    // Innovations over their deviations, since the last change, or since they were learned from.
    struct Quiet {
        Real squares = 0, slow_squares = 0, sum = 0, last = 0, products = 0;  // of one and the one before
        int rows = 0;
    };
    struct Row {
        std::array<Vector, 2> plain{};  // regressors of this row and the one before, taking turns
        std::array<Real, 2> plain_torque_Nm{};
        Vector phi{};       // regressor, whitened, over the row's deviation
        Real residual{};    // Nm
        Real innovation{};  // over the row's deviation
        typename Rls::Projection projection{};
        Real power{};           // of innovations, Nm^2, less the share that is the estimate's own error
        Real slow_power{};      // the same of sums over kRunRows rows, over their number
        Real moving_power = 0;  // mean square of the accelerating torque, Nm^2
        Real least{};           // by the noise of the angles alone
        int seen = 0;           // rows that told the torque, up to kRunRows
        int measured = 0;       // rows whose noise was learned, up to kNoiseRows
        Quiet quiet;
    };
    // Fading sums over rows: of innovations that go with a parameter's regressor, and the variance that they
    // have by chance.
    struct Window {
        LoadVector score = LoadVector::Zero();
        LoadMatrix noise = LoadMatrix::Zero(), power = LoadMatrix::Zero();
        Real keep{};   // by each row of either equation
        int rows = 0;  // of both equations
    };

    std::size_t size() const { return static_cast<std::size_t>(size_); }

    // One step of the row's work. True: the last one. Apart, so that cycles without work stay short.
    [[gnu::noinline]] bool work_on_row() {
        switch (work_) {
            case Work::none:
                return false;
            case Work::doubt:
                doubt(doubtful_++);
                work_ = doubtful_ < kLoad ? Work::doubt : Work::none;
                return false;
            case Work::linear_instrument:
                linear_row();
                instrument_.v_m_per_s2 = instrument(row_[0], kMass);
                work_ = Work::turning_instrument;
                return false;
            case Work::turning_instrument:
                turning_row();
                instrument_.omega_rad_per_s2 = instrument(row_[1], kInertia);
                work_ = Work::linear;
                return false;
            case Work::linear:
                row_[0].phi[kMass] = instrument_.v_m_per_s2;
                row_[0].phi[kLeft] = -instrument_.omega_rad_per_s2;
                work_ = judge(row_[0]) ? Work::learn_linear : Work::turning;
                return false;
            case Work::learn_linear:
                learn(row_[0]);
                work_ = Work::turning;
                return false;
            case Work::turning:
                turning_row();
                row_[1].phi[kInertia] = instrument_.omega_rad_per_s2;
                row_[1].phi[kLeft] = -per_track_ * instrument_.v_m_per_s2;
                ++estimate_.rows;
                work_ = judge(row_[1]) ? Work::learn_turning : Work::monitor_linear;
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
                work_ = Work::monitor_settles;
                return false;
            case Work::monitor_settles:
                monitor_.settle();
                work_ = Work::compare;
                return false;
            case Work::compare:
                if (hold_rows_ == 0 && window_shows_change())
                    for (Row& row : row_) hold(row);
                was_quiet_ = was_quiet_ && hold_rows_ == 0;
                work_ = Work::hold_variances;
                return false;
            case Work::hold_variances:
                for (std::size_t i = 0; i < size(); ++i) held_[i] = rls_.variance(static_cast<int>(i));
                work_ = Work::watch;
                return false;
            case Work::watch:
                watch_excitation();
                work_ = Work::doubt_mass;
                return false;
            case Work::doubt_mass:
                held_[kMass] += unnoticed(kMass);
                work_ = Work::doubt_inertia;
                return false;
            case Work::doubt_inertia:
                held_[kInertia] += unnoticed(kInertia);
                work_ = Work::publish;
                return false;
            case Work::publish:
                publish();
                work_ = Work::none;
                return true;
        }
        return false;
    }

    void begin_row() {
        work_ = Work::none;
        const bool follows = to_learn_from_;
        to_learn_from_ = filter_.row().usable && hold_rows_ == 0;
        place_ = 1 - place_;
        taken_ = follows ? colour_ : Real(0);
        kept_ = follows ? Real(1) : std::sqrt(1 - colour_ * colour_);  // alone it tells less
        if (!filter_.row().usable) {
            ++estimate_.masked_rows;
        } else if (hold_rows_ > 0) {
            ++estimate_.masked_rows;
            if (--hold_rows_ == 0) begin_doubt();
        } else {
            work_ = Work::linear_instrument;
        }
    }

    // A change of the robot: what it was before counts no more.
    void begin_doubt() {
        ++estimate_.changes;
        doubtful_ = 0;
        work_ = Work::doubt;
        window_ = {.keep = window_.keep};
        for (Row& row : row_) row.quiet = {};
    }

    // A load of the share `doubt`, put on over one wheel, moves the centre of gravity by that share of half
    // the track.
    void doubt(std::size_t i) {
        const Real size = i == kMass || i == kInertia ? rls_.theta()[i] : rls_.theta()[kMass] * track_m_ / 2;
        const Real error = options_.doubt * size;
        const Real add = error * error - rls_.variance(static_cast<int>(i));
        if (add > 0) rls_.add_variance(static_cast<int>(i), add);
    }

    void linear_row() {
        const RegressionRow<Real>& r = filter_.row();
        Row& row = row_[0];
        Vector& phi = row.plain[place_];
        phi = {r.acceleration.v_m_per_s2, 0, -r.omega_squared, -r.acceleration.omega_rad_per_s2,
               -r.torque_Nm[0].difference()};
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j)
            phi[kFixed + j] = -r.column[j].sum();
        take_residual(row, r.torque_Nm[0].sum());
    }

    void turning_row() {
        const RegressionRow<Real>& r = filter_.row();
        Row& row = row_[1];
        Vector& phi = row.plain[place_];
        phi = {0, r.acceleration.omega_rad_per_s2, per_track_ * r.v_omega,
               -per_track_ * r.acceleration.v_m_per_s2, -r.torque_Nm[0].sum()};
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j)
            phi[kFixed + j] = -r.column[j].difference();
        take_residual(row, r.torque_Nm[0].difference());
    }

    // A residual is what the measured acceleration lacks of the expected one, as torque.
    Real instrument(Row& row, std::size_t i) {
        const Real moving = rls_.theta()[i] * row.phi[i];
        row.moving_power += (moving * moving - row.moving_power) / kNoiseRows;
        const Real own_error = rls_.projection(row.phi).variance;  // of the expected torque
        const Real sensors =
            std::min((kept_ * kept_ + taken_ * taken_) * row.least / (noise(row) + own_error), Real(1));
        return row.phi[i] + sensors * row.residual / rls_.theta()[i];
    }

    void take_residual(Row& row, Real torque_Nm) {
        const std::size_t before = 1 - place_;
        row.plain_torque_Nm[place_] = torque_Nm;
        row.residual = kept_ * torque_Nm - taken_ * row.plain_torque_Nm[before];
        for (std::size_t i = 0; i < size(); ++i) {
            row.phi[i] = kept_ * row.plain[place_][i] - taken_ * row.plain[before][i];
            row.residual -= row.phi[i] * rls_.theta()[i];
        }
    }

    // Whether the row may teach. It is then weighed and projected.
    bool judge(Row& row) {
        const Real weight = 1 / std::sqrt(noise(row));
        row.innovation = row.residual * weight;
        for (std::size_t i = 0; i < size(); ++i) row.phi[i] *= weight;
        if (hold_rows_ > 0) return false;  // the other equation has just found a change
        row.projection = rls_.projection(row.phi);
        const Real deviation = 1 + row.projection.variance;
        const Real square = row.innovation * row.innovation / deviation;
        if (row.seen < kRunRows) {
            const WheelPair<Real>& torque = filter_.row().torque_Nm[0];
            const Real largest = torque.left * torque.left + torque.right * torque.right;
            ++row.seen;
            row.power += (kNoiseAtFirst * kNoiseAtFirst * largest - row.power) / static_cast<Real>(row.seen);
            row.power = std::max(row.power, row.least);
            return false;
        }
        const Real gate = options_.gate_sigma * options_.gate_sigma;
        if (square > gate) {
            hold(row);
            was_quiet_ = false;
            return false;
        }
        add_to_window(row);
        if (row.projection.variance > 1) return true;  // shows the estimate's error, not noise
        Quiet& quiet = row.quiet;
        quiet.squares += square;
        const Real standard = row.innovation / std::sqrt(deviation);
        quiet.sum += standard;
        quiet.products += standard * quiet.last;
        quiet.last = standard;
        if (++quiet.rows % kRunRows == 0) {
            quiet.slow_squares += quiet.sum * quiet.sum / kRunRows;
            quiet.sum = 0;
        }
        if (quiet.rows >= (row.measured > 0 ? window_rows_ : kRunRows)) learn_noise(row);
        return row.projection.variance > forgotten_ && (excited_[kMass] || excited_[kInertia]);
    }

    void hold(Row& row) {
        hold_rows_ = kWindowRows;
        // twice, with no quiet window between: rather the noise is larger than it was thought to be
        if (!was_quiet_) row.power = 2 * noise(row);
    }

    void add_to_window(const Row& row) {
        const Eigen::Map<const LoadVector> phi(row.phi.data());
        // Innovations over their own deviation are white, whatever the estimate's error was to begin with.
        const Real standard = row.innovation / std::sqrt(1 + row.projection.variance);
        Window& w = window_;
        w.score = w.keep * w.score + standard * phi;
        const LoadMatrix square = phi * phi.transpose();
        w.noise = w.keep * w.keep * w.noise + square;
        w.power = w.keep * w.power + square;
        ++w.rows;
    }

    // What a load changes, it changes at once: mass, inertia and both coordinates.
    bool window_shows_change() const {
        const Window& w = window_;
        if (w.rows < 2 * kFewestRows || !(excited_[kMass] || excited_[kInertia])) return false;
        LoadMatrix noise = w.noise;
        LoadVector score = w.score;
        for (std::size_t i = 0; i < kWatched; ++i) {
            // Accelerations about as small as the noise go with it, not with the robot.
            if (excited_[i]) continue;
            const auto k = static_cast<int>(i);
            noise.row(k).setZero();
            noise.col(k).setZero();
            score(k) = 0;
        }
        return score.dot(solved(noise, score)) > kSumGate;
    }

    // What has shown nothing keeps a little power, and noise as little: it is then as uncertain as can be.
    static LoadMatrix regular(LoadMatrix matrix) {
        for (int i = 0; i < matrix.rows(); ++i) matrix(i, i) += kAlike * matrix(i, i) + kTinyVariance;
        return matrix;
    }
    static LoadVector solved(const LoadMatrix& matrix, const LoadVector& right) {
        return regular(matrix).llt().solve(right);
    }

    // From a time without a change, so that a change does not hide itself.
    void learn_noise(Row& row) {
        was_quiet_ = true;
        row.measured = std::min(row.measured + row.quiet.rows, kNoiseRows);
        const Real now = noise(row);
        const auto learn = [&](Real& power, Real squares, int count, int rows) {
            if (count == 0) return;
            const Real share = static_cast<Real>(rows) / static_cast<Real>(row.measured);
            power += share * (now * squares / static_cast<Real>(count) - power);
            power = std::max(power, row.least);
        };
        const int runs = row.quiet.rows / kRunRows;
        learn(row.power, row.quiet.squares, row.quiet.rows, row.quiet.rows);
        learn(row.slow_power, row.quiet.slow_squares, runs, runs * kRunRows);
        const Real share = static_cast<Real>(row.quiet.rows) / static_cast<Real>(row.measured);
        if (row.quiet.squares > 0)
            colour_ =
                std::clamp(colour_ + share * row.quiet.products / row.quiet.squares, Real(0), kMostColour);
        row.quiet = {};
    }

    // Variance of a residual, Nm^2.
    static Real noise(const Row& row) {
        return std::max({row.power, row.slow_power, kBestModel * kBestModel * row.moving_power});
    }

    void learn(Row& row) {
        Vector gain;
        const Real scale = rls_.update_gain(row.projection, gain) * row.innovation;
        // No other bounds here: one that cuts a parameter short leaves those that go with it wrong.
        for (std::size_t i = 0; i < size(); ++i) {
            const Real value = rls_.theta()[i] + gain[i] * scale;
            rls_.set_theta(static_cast<int>(i), i < least_.size() ? std::max(value, least_[i]) : value);
        }
    }

    // Variance of what a change that nobody noticed may have left in A or B: evenly anything up to what the
    // sums of innovations would show, and a load's share at most.
    Real unnoticed(std::size_t i) const {
        const Real most = options_.doubt * rls_.theta()[i];
        const LoadVector by_score = solved(window_.power, LoadVector::Unit(static_cast<int>(i)));
        return std::min(most * most, kSumGate * by_score.dot(regular(window_.noise) * by_score)) / 3;
    }

    void watch_excitation() {
        std::array<Real, kWatched> excitation;
        for (std::size_t i = 0; i < kWatched; ++i) {
            excitation[i] = monitor_.excitation(static_cast<int>(i), held_[i]);
            excited_[i] = excitation[i] >= options_.minimum_excitation;
        }
        estimate_.excitation = {excitation[kAhead], excitation[kAhead], excitation[kMass],
                                excitation[kInertia]};
    }

    void publish() {
        const Vector& t = rls_.theta();
        const Real beside = 1 + listed_mismatch_ * t[kMismatch];
        const Real offset_m = t[kLeft] / t[kMass];
        const model::Dynamics<Real> seen =
            seen_together<Real>({t[kAhead] / t[kMass], 0, beside / t[kMass], beside / t[kInertia]},
                                (listed_mismatch_ + t[kMismatch]) / beside, offset_m, track_m_);
        const Real k5 = seen.k5_m, k7 = seen.k7_per_kg_m, k8 = seen.k8_per_kg_m2;
        // to first order, as if sy were known
        const Real to_k7 = k7 / t[kMass];
        const Real to_k8 = k8 / t[kInertia];
        const Real to_k5 = 1 / t[kMass];
        const Real to_k6 = per_track_ * k8 / k7;
        estimate_.dynamics = {k5, model::coupled_k6(k5, k7, k8, track_m_), k7, k8};
        estimate_.covariance_diagonal = {to_k5 * to_k5 * held_[kAhead],
                                         to_k6 * to_k6 * to_k5 * to_k5 * held_[kAhead],
                                         to_k7 * to_k7 * held_[kMass], to_k8 * to_k8 * held_[kInertia]};
        const model::Dynamics<Real>& p = estimate_.covariance_diagonal;
        estimate_.standard_error = {std::sqrt(p.k5_m), std::sqrt(p.k6_per_m), std::sqrt(p.k7_per_kg_m),
                                    std::sqrt(p.k8_per_kg_m2)};
        for (std::size_t j = 0; j < static_cast<std::size_t>(columns_); ++j) {
            const ColumnPlace place = places_[j];
            const model::EffectParameterInfo& info =
                model::kEffects[place.effect].parameters[place.parameter];
            estimate_.effects.parameter[place.effect][place.parameter] =
                std::clamp(t[kFixed + j], static_cast<Real>(info.minimum), static_cast<Real>(info.maximum));
            estimate_.effects_standard_error.parameter[place.effect][place.parameter] =
                std::sqrt(held_[kFixed + j]);
        }
        if (lateral_) {
            estimate_.effects.parameter[model::kCogLateral][0] = offset_m;
            estimate_.effects_standard_error.parameter[model::kCogLateral][0] =
                std::sqrt(held_[kLeft]) / t[kMass];
        }
        const model::Dynamics<Real>& e = estimate_.standard_error;
        estimate_.good_enough = e.k7_per_kg_m <= options_.trust_relative_error * k7 &&
                                e.k8_per_kg_m2 <= options_.trust_relative_error * k8;
    }

    AdaptiveEstimatorOptions<Real> options_{};
    RegressionFilter<Real> filter_;
    Rls rls_;
    ExcitationMonitor<Real, kSize> monitor_;
    std::array<Row, 2> row_{};
    Window window_{};
    TwistRate<Real> instrument_{};  // accelerations of the row under way
    std::array<ColumnPlace, model::kMaxEstimatedColumns> places_{};
    std::array<Real, 2> least_{};  // of A and B, which are divided by
    Vector held_{};
    std::array<bool, kWatched> excited_{};
    Real track_m_{}, per_track_{};
    Real forgotten_{};  // by each row
    int columns_ = 0;
    int size_ = static_cast<int>(kFixed);
    int window_rows_ = 1;  // of each equation
    int hold_rows_ = 0;
    Real listed_mismatch_{};
    bool lateral_ = false;      // the file lists a lateral centre of gravity: it is one of the estimates
    bool was_quiet_ = true;     // a whole window without a change since the last one
    std::size_t doubtful_ = 0;  // of the load's parameters: the next one to be doubted
    Work work_ = Work::none;
    int cycles_left_ = 0;                // until the next row
    std::size_t place_ = 0;              // of this row's plain regressors
    bool to_learn_from_ = false;         // this row
    Real colour_{}, taken_{}, kept_{1};  // whitening: this row times kept_, less the one before times taken_
    DynamicsEstimate<Real> estimate_{};
};

}  // namespace wheelwright::ident
