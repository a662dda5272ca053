// Standard errors of a least-squares estimate from the scores g_t = phi_t r_t themselves: nothing is assumed
// about the residual's colour, nor that it is the same at all speeds and torques.
//
//   cov(theta) = P S P,   S = rows * (spectral density of g at frequency zero)
//
// (White 1980; Newey and West, Econometrica 55, 1987). The density is the power of g behind a low-pass of
// three equal poles. Its weights on the lags are smooth at lag zero, so it sees the spectral null that
// differencing makes of sensor noise (a lag window with a corner there, as Bartlett's, fills it up), and it
// can not come out negative.
//
// The first rows, whose innovations still hold the error of the estimate, are left out and made up for by
// count. Rows that were masked count as scores of zero. A density of n degrees of freedom is itself
// uncertain: S is larger by n / (n - 2), as the variance of Student's t is, so that two standard errors cover
// what they say.
//
// Cost: N^2 / 2 + 6 N multiply-adds a row; covariance() N^2. Fixed size, no allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace wheelwright::ident {

template <typename Real, int N>
class ScoreErrors {
  public:
    using Vector = std::array<Real, N>;
    static constexpr int kMemoryRows = 5;  // of each pole
    // Rows for each degree of freedom of the density: the sum of the low-pass's squared autocorrelation.
    static constexpr Real kRowsPerFreedom = Real(3.5) * kMemoryRows;

    void reset(int size = N) {
        *this = ScoreErrors{};
        size_ = size;
    }

    // A row that took part in the estimate. `residual`: the innovation over the square root of 1 + phi^T P
    // phi, which has the residual's power from the first row on.
    void push(const Vector& phi, Real residual) {
        ++rows_;
        Vector score{};
        const bool counts = rows_ > settling_rows();
        if (counts) {
            power_ += residual * residual;
            for (int i = 0; i < size_; ++i) score[index(i)] = phi[index(i)] * residual;
        }
        smooth(score, counts ? residual : Real(0));
    }

    // A row that was masked.
    void skip() { smooth({}, 0); }

    // Innovations no longer hold much of the estimate's error.
    bool settled() const { return rows_ > settling_rows(); }

    // Mean square of the residuals.
    Real residual_variance() const { return counted() > 0 ? power_ / counted() : Real(0); }

    // Spectral density of the residual itself at frequency zero. Times P it is the variance of what a slow
    // regressor tells, better known than the sandwich's, which a few strong rows decide; of a fast one it is
    // less than that where noise is differenced.
    Real residual_density() const { return counted() > 0 ? density_ / (counted() * noise_gain()) : Real(0); }

    // Below so many rows there is no covariance.
    std::uint32_t fewest_rows() const {
        return settling_rows() + static_cast<std::uint32_t>(kFewestFreedoms * kRowsPerFreedom) + 1;
    }

    // The middle of the sandwich, times a vector: S x. Zero below fewest_rows().
    Vector apply(const Vector& x) const {
        Vector result{};
        if (rows_ < fewest_rows()) return result;
        const Real freedoms = counted() / kRowsPerFreedom;
        const Real scale = static_cast<Real>(rows_) / (counted() * noise_gain()) * freedoms / (freedoms - 2);
        for (int i = 0; i < size_; ++i) {
            Real sum = 0;
            for (int j = 0; j < size_; ++j)
                sum += middle_[packed(std::max(i, j), std::min(i, j))] * x[index(j)];
            result[index(i)] = scale * sum;
        }
        return result;
    }

    // Covariance of two linear combinations a^T theta and b^T theta, given Pa and Pb.
    Real covariance(const Vector& p_a, const Vector& p_b) const {
        const Vector s = apply(p_b);
        Real sum = 0;
        for (int i = 0; i < size_; ++i) sum += p_a[index(i)] * s[index(i)];
        return sum;
    }

    // What the newest rows move a^T theta by, given Pa: their smoothed scores, whose power is the density.
    Real influence(const Vector& p_a) const {
        Real sum = 0;
        for (int i = 0; i < size_; ++i) sum += p_a[index(i)] * poles_.back()[index(i)];
        return sum;
    }

  private:
    static constexpr std::uint32_t kSettle = 8;  // rows for each parameter
    static constexpr Real kFewestFreedoms = 6;
    static constexpr Real kGain = Real(1) / kMemoryRows;
    static constexpr Real kKeep = 1 - kGain;
    // Sum of the squares of the low-pass's impulse response, kGain^3 (k + 2) (k + 1) / 2 kKeep^k.
    static constexpr Real noise_gain() {
        constexpr Real kFade = kKeep * kKeep;
        Real gain = 1 + 4 * kFade + kFade * kFade;
        for (int i = 0; i < 6; ++i) gain *= kGain;
        for (int i = 0; i < 5; ++i) gain /= 1 - kFade;
        return gain;
    }

    static constexpr std::size_t index(int i) { return static_cast<std::size_t>(i); }
    static constexpr std::size_t packed(int i, int j) { return index(i * (i + 1) / 2 + j); }  // i >= j

    std::uint32_t settling_rows() const { return kSettle * static_cast<std::uint32_t>(size_); }
    Real counted() const {
        return rows_ > settling_rows() ? static_cast<Real>(rows_ - settling_rows()) : Real(0);
    }

    void smooth(const Vector& score, Real residual) {
        for (Real& pole : residual_poles_) {
            pole += kGain * (residual - pole);
            residual = pole;
        }
        density_ += residual * residual;
        for (int i = 0; i < size_; ++i) {
            Real input = score[index(i)];
            for (Vector& pole : poles_) {
                pole[index(i)] += kGain * (input - pole[index(i)]);
                input = pole[index(i)];
            }
        }
        const Vector& smooth = poles_.back();
        for (int i = 0; i < size_; ++i)
            for (int j = 0; j <= i; ++j) middle_[packed(i, j)] += smooth[index(i)] * smooth[index(j)];
    }

    std::array<Real, static_cast<std::size_t>(N*(N + 1) / 2)> middle_{};
    std::array<Vector, 3> poles_{};  // the score behind one, two, three of them
    std::array<Real, 3> residual_poles_{};
    Real power_ = 0, density_ = 0;
    std::uint32_t rows_ = 0;
    int size_ = N;
};

}  // namespace wheelwright::ident
