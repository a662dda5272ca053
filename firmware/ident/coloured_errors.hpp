// Standard errors of a least-squares estimate whose residuals are coloured.
//
// Differencing makes sensor noise negatively correlated: a slow regressor then sees far less noise than the
// residual's variance suggests, a fast one more. Lag windows (Newey-West) blur exactly the spectral null that
// matters and over-cover. Here the colour is known up to two numbers, so it is used:
//
//   residual = (difference of order 0, 1 or 2 of white sensor noise, variance s)
//            + (white noise that acted on the plant, variance a, through the rows' own averaging weight)
//
// Summing by parts, the error of the estimate is P * sum(n_k psi_k) with psi the same difference taken of the
// regressors, hence
//
//   cov(theta) = P (s sum psi psi^T + a sum alpha alpha^T) P,          a sandwich, never negative.
//
// s and a come from two powers of the residual: that of single rows (mostly s), and that of sums over 32
// rows, in which the sensor noise telescopes away (mostly a). Rows that were masked count as regressors of
// zero.
//
// With exponential forgetting, the estimate weighs row t with lambda^(n-t) and its covariance with the
// square: pass lambda to reset() (the noise powers are kept eight times longer). For directional forgetting
// no such sum exists; use bound_on_row_variance() with P.
//
// Cost: about N^2 + 4 N multiply-adds a row; covariance() about N^2. Fixed size, no allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace wheelwright::ident {

template <typename Real, int N>
class ColouredErrors {
  public:
    using Vector = std::array<Real, N>;
    static constexpr int kSumRows = 32;

    // order: how often the sensor's noise is differenced in y: 0, 1 (speed quotients) or 2 (angles, as the
    // rows of RegressionFilter).
    void reset(int order, int size = N, Real lambda = 1) {
        *this = ColouredErrors{};
        order_ = order;
        size_ = size;
        lambda_ = lambda;
        // the noise is the sensor's and the floor's: it changes slower than what is estimated
        power_keep_ = 1 - (1 - lambda) / 8;
        sum_keep_ = power_keep_;
        for (int i = 1; i < kSumRows; i *= 2) sum_keep_ *= sum_keep_;
    }

    // A row that took part in the estimate, with its innovation or residual. The first `kSettle` rows, whose
    // innovations still hold the error of the estimate, do not enter the noise powers.
    void push(const Vector& phi, Real residual) {
        push_regressor(phi);
        if (seen_ < kSettle * static_cast<std::uint32_t>(size_)) {
            ++seen_;
            return;
        }
        decay(rows_, 1);
        decay(power_, residual * residual);
        run_sum_ += residual;
        if (++run_ == kSumRows) {
            sums_ = sums_ * sum_keep_ + 1;
            sum_power_ = sum_power_ * sum_keep_ + run_sum_ * run_sum_;
            run_ = 0;
            run_sum_ = 0;
        }
    }

    // A row that was masked.
    void skip() {
        push_regressor(Vector{});
        run_ = 0;
        run_sum_ = 0;
    }

    // Variances of the sensor's noise (as it stands in y before differencing) and of the plant's (in y).
    struct NoiseVariances {
        Real sensor{};
        Real plant{};
    };
    NoiseVariances noise_variances() const {
        if (!(rows_ > 0)) return {};
        const Real row = power_ / rows_;
        const Shape& shape = kShape[static_cast<std::size_t>(order_)];
        if (order_ == 0) return {row, 0};
        if (sums_ < Real(kFewSums))
            return {0, row / shape.plant_row};  // too little to tell: the careful guess
        const Real sum = sum_power_ / sums_;
        constexpr auto kLength = static_cast<Real>(kSumRows);
        const Real plant = (sum - shape.sensor_sum * row / shape.sensor_row) /
                           (kLength - shape.sensor_sum * shape.plant_row / shape.sensor_row);
        // never smaller than could have been seen: the deviation of the mean of so many squares
        const Real unseen = sum * std::sqrt(2 / sums_) / kLength;
        const Real bounded = std::min(std::max(plant, unseen), row / shape.plant_row);
        return {(row - shape.plant_row * bounded) / shape.sensor_row, bounded};
    }

    // The variance of white rows that would be no more certain than these: for P of estimators whose
    // forgetting is directional. Over-covers where the sensor's noise dominates.
    Real bound_on_row_variance() const {
        if (!(rows_ > 0)) return 0;
        const Real row = power_ / rows_;
        return sums_ > 0 ? std::max(row, sum_power_ / (sums_ * static_cast<Real>(kSumRows))) : row;
    }

    Real residual_variance() const { return rows_ > 0 ? power_ / rows_ : Real(0); }

    // The middle of the sandwich, times a vector: S x.
    Vector apply(const NoiseVariances& noise, const Vector& x) const {
        Vector result{};
        for (int i = 0; i < size_; ++i) {
            Real sum = 0;
            for (int j = 0; j < size_; ++j) {
                const std::size_t k = packed(std::max(i, j), std::min(i, j));
                sum += (noise.sensor * sensor_[k] + noise.plant * plant_[k]) * x[index(j)];
            }
            result[index(i)] = sum;
        }
        // noise whose differences end with the last rows: for slow regressors the larger part
        if (order_ == 1) add_edge(result, x, noise.sensor, 1, 0);
        if (order_ == 2) {
            add_edge(result, x, noise.sensor, -2 * lambda_, lambda_ * lambda_);
            add_edge(result, x, noise.sensor, 1, 0);
            add_edge(result, x, noise.plant, 4 * lambda_ / 6, lambda_ * lambda_ / 6);
            add_edge(result, x, noise.plant, lambda_ / 6, 0);
        }
        return result;
    }

    // Covariance of two linear combinations a^T theta and b^T theta, given Pa and Pb.
    Real covariance(const NoiseVariances& noise, const Vector& p_a, const Vector& p_b) const {
        const Vector s = apply(noise, p_b);
        Real sum = 0;
        for (int i = 0; i < size_; ++i) sum += p_a[index(i)] * s[index(i)];
        return sum;
    }

  private:
    static constexpr std::uint32_t kSettle = 8;  // rows for each parameter
    static constexpr int kFewSums = 6;

    // What a unit of each noise gives: power of a row, and of a sum over kSumRows rows.
    struct Shape {
        Real sensor_row, sensor_sum, plant_row;
    };
    // Order 2: rows weigh the plant's noise with a quadratic B-spline; the power of that is the quintic
    // B-spline's middle value, 66/120. Order 1: one row, one interval.
    static constexpr std::array<Shape, 3> kShape{{{1, kSumRows, 1}, {2, 2, 1}, {6, 4, Real(0.55)}}};

    static constexpr std::size_t index(int i) { return static_cast<std::size_t>(i); }
    static constexpr std::size_t packed(int i, int j) { return index(i * (i + 1) / 2 + j); }  // i >= j

    void decay(Real& sum, Real more) { sum = sum * power_keep_ + more; }
    // Adds strength * v v^T x, v = newest * (last row) + older * (the one before).
    void add_edge(Vector& result, const Vector& x, Real strength, Real newest, Real older) const {
        Real along = 0;
        for (int i = 0; i < size_; ++i)
            along += (newest * before_[index(i)] + older * earlier_[index(i)]) * x[index(i)];
        for (int i = 0; i < size_; ++i)
            result[index(i)] += strength * along * (newest * before_[index(i)] + older * earlier_[index(i)]);
    }

    void push_regressor(const Vector& phi) {
        // psi and alpha are complete one row (order 2) late; order 1 and 0 need no more than one row
        Vector psi{};
        Vector alpha{};
        for (int i = 0; i < size_; ++i) {
            const Real now = phi[index(i)];
            const Real before = before_[index(i)];
            const Real earlier = earlier_[index(i)];
            // older rows weigh less
            const Real double_before = 2 * lambda_ * before;
            const Real earlier_share = lambda_ * lambda_ * earlier;
            if (order_ == 2) {
                psi[index(i)] = now - double_before + earlier_share;
                alpha[index(i)] = (now + 2 * double_before + earlier_share) / 6;
            } else {
                psi[index(i)] = order_ == 1 ? now - lambda_ * before : now;
                alpha[index(i)] = now;
            }
        }
        const Real keep = lambda_ * lambda_;
        for (int i = 0; i < size_; ++i)
            for (int j = 0; j <= i; ++j) {
                Real& s = sensor_[packed(i, j)];
                Real& p = plant_[packed(i, j)];
                s = s * keep + psi[index(i)] * psi[index(j)];
                p = p * keep + alpha[index(i)] * alpha[index(j)];
            }
        earlier_ = before_;
        before_ = phi;
    }

    static constexpr std::size_t kPacked = static_cast<std::size_t>(N * (N + 1) / 2);
    std::array<Real, kPacked> sensor_{}, plant_{};
    Vector before_{}, earlier_{};
    Real lambda_ = 1;
    Real power_keep_ = 1, sum_keep_ = 1;
    Real rows_ = 0, power_ = 0;
    Real sums_ = 0, sum_power_ = 0, run_sum_ = 0;
    int run_ = 0;
    int order_ = 0;
    int size_ = N;
    std::uint32_t seen_ = 0;
};

}  // namespace wheelwright::ident
