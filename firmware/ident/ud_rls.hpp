// Recursive least squares for y = phi^T theta, with the covariance kept as P = U D U^T (U unit upper
// triangular, D diagonal), which cannot lose its positiveness to rounding: paper eq (29)-(31) in the
// factorisation of Bierman (1977). Knows nothing of wheels.
//
// Noise is taken to have unit variance: P is the covariance of theta per unit of noise variance. For noise
// that is coloured see coloured_errors.hpp.
//
// Forgetting:
//   none          every sample counts for ever
//   exponential   all information fades: P / lambda after each sample
//   directional   information fades only along the direction phi that the sample renews (Kulhavy 1987):
//                 inverse(P) gains eps phi phi^T with eps = lambda - (1 - lambda) / (phi^T P phi), and
//                 nothing where that is negative: noise in a direction that nothing excites would else let
//                 its variance grow until the noise is believed
//
// Cost: about 1.5 N^2 + 6 N multiply-adds and N divisions a sample; no allocation. Not thread-safe.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>

namespace wheelwright::ident {

enum class Forgetting : std::uint8_t { none, exponential, directional };

// N is the number of parameters; with kVariableSize the first size() <= N of them are in use.
template <typename Real, int N, bool kVariableSize = false>
class UdRls {
  public:
    using Vector = std::array<Real, N>;
    static constexpr Real kUnbounded = std::numeric_limits<Real>::max();

    // Starts from `theta` with independent variances `variance` (>= 0; P(-1) = c I of Algorithm 1 is
    // fill(c)). Bounds and forgetting stay as they are.
    void reset(const Vector& theta, const Vector& variance, int size = N) {
        size_ = size;
        theta_ = theta;
        d_ = variance;
        u_ = {};
    }

    // 0 < lambda <= 1. Ignored by Forgetting::none.
    void set_forgetting(Forgetting forgetting, Real lambda) {
        forgetting_ = forgetting;
        lambda_ = lambda;
        inverse_lambda_ = 1 / lambda;
    }

    // Keeps lower <= variance(i) <= upper from the next update on. The upper bound enters as a measurement
    // "theta_i is what it is", the lower one through D; both keep P factorised and positive.
    void set_bounds(int i, Real lower, Real upper = kUnbounded) {
        lower_[index(i)] = lower;
        upper_[index(i)] = upper;
        bounded_ = true;
    }

    // Leaves keep_bounds() to the caller, who may do it in another cycle: it costs about as much as an
    // update.
    void keep_bounds_apart() { bounds_apart_ = true; }
    void keep_bounds() {
        for (int i = 0; i < size(); ++i) d_[index(i)] = std::max(d_[index(i)], lower_[index(i)]);
        for (int i = 0; i < size(); ++i) {
            if (upper_[index(i)] == kUnbounded) continue;
            const Real now = variance(i);
            if (now > upper_[index(i)]) [[unlikely]]
                pull_down(i, now);
        }
    }

    // Eq (32)-(35). Returns the innovation y - phi^T theta.
    Real update(const Vector& phi, Real y) {
        const Real unexplained = innovation(phi, y);
        update_with_innovation(phi, unexplained);
        return unexplained;
    }
    // y - phi^T theta, in y's unit; changes nothing.
    Real innovation(const Vector& phi, Real y) const {
        for (int i = 0; i < size(); ++i) y -= phi[index(i)] * theta_[index(i)];
        return y;
    }

    // The same for a model that is not linear: phi is the gradient of the prediction, `innovation` what was
    // measured less what was predicted (recursive Gauss-Newton).
    void update_with_innovation(const Vector& phi, Real innovation) {
        Vector gain;
        const Real scale = update_gain(phi, gain);
        for (int i = 0; i < size(); ++i) theta_[index(i)] += gain[index(i)] * (scale * innovation);
    }

    // The covariance's half of an update. theta would move by gain * (returned scale) * innovation; the
    // caller may apply only part of it (frozen parameters).
    Real update_gain(const Vector& phi, Vector& gain) { return update_gain(projection(phi), gain); }

    // What a regressor is to the covariance as it stands: valid until the next change of it.
    struct Projection {
        Vector f;       // U^T phi
        Vector v;       // D f
        Real variance;  // phi^T P phi, of the prediction
    };
    Projection projection(const Vector& phi) const {
        Projection p;
        p.variance = project(phi, p.f, p.v);
        return p;
    }

    Real update_gain(const Projection& p, Vector& gain) {
        const Real zeta = p.variance;
        Real weight = 1;
        Real denominator = 1 + zeta;
        Real grow = 1;
        if (forgetting_ == Forgetting::exponential) {
            weight = inverse_lambda_;
            denominator = lambda_ + zeta;
            grow = inverse_lambda_;
        } else if (forgetting_ == Forgetting::directional) {
            // phi that tells less than would be forgotten for it renews nothing
            weight = zeta > kNoPower ? std::max(Real(0), lambda_ - (1 - lambda_) / zeta) : Real(0);
        }
        rank_one(p.f, p.v, weight, grow, gain);
        if (bounded_ && !bounds_apart_) keep_bounds();
        return 1 / denominator;
    }

    // The whole update, of a regressor that has been projected.
    void update_projected(const Projection& p, Real innovation) {
        Vector gain;
        const Real scale = update_gain(p, gain);
        for (int i = 0; i < size(); ++i) theta_[index(i)] += gain[index(i)] * (scale * innovation);
    }

    // Adds to the variance of parameter i (process noise, or doubt after a detected change).
    void add_variance(int parameter, Real amount) {
        Vector a{};
        a[index(parameter)] = 1;
        Real c = amount;
        for (int j = parameter; j >= 0; --j) {  // Agee and Turner (1972)
            const Real aj = a[index(j)];
            const Real old = d_[index(j)];
            const Real now = old + c * aj * aj;
            if (!(now > 0)) continue;
            const Real b = c * aj / now;
            d_[index(j)] = now;
            c *= old / now;
            for (int k = 0; k < j; ++k) {
                Real& u = at(k, j);
                a[index(k)] -= aj * u;
                u += b * a[index(k)];
            }
        }
    }

    constexpr int size() const {
        if constexpr (kVariableSize) {
            return size_;
        } else {
            return N;
        }
    }
    const Vector& theta() const { return theta_; }
    void set_theta(int i, Real value) { theta_[index(i)] = value; }

    // P_ij. Cost: up to N multiply-adds.
    Real covariance(int i, int j) const {
        const int first = std::max(i, j);
        Real sum = 0;
        for (int k = first; k < size(); ++k) sum += factor(i, k) * d_[index(k)] * factor(j, k);
        return sum;
    }
    Real variance(int i) const {
        Real sum = d_[index(i)];
        for (int k = i + 1; k < size(); ++k) sum += at(i, k) * at(i, k) * d_[index(k)];
        return sum;
    }

  private:
    static constexpr Real kNoPower = std::numeric_limits<Real>::min() * Real(1e6);

    static constexpr std::size_t index(int i) { return static_cast<std::size_t>(i); }
    // Strictly upper triangle by columns: column j starts at j (j - 1) / 2.
    Real& at(int i, int j) { return u_[index(j * (j - 1) / 2 + i)]; }
    const Real& at(int i, int j) const { return u_[index(j * (j - 1) / 2 + i)]; }
    Real factor(int i, int k) const { return i == k ? Real(1) : at(i, k); }

    // f = U^T phi, v = D f; returns phi^T P phi.
    Real project(const Vector& phi, Vector& f, Vector& v) const {
        Real zeta = 0;
        for (int j = 0; j < size(); ++j) {
            Real sum = phi[index(j)];
            for (int i = 0; i < j; ++i) sum += at(i, j) * phi[index(i)];
            f[index(j)] = sum;
            v[index(j)] = d_[index(j)] * sum;
            zeta += sum * v[index(j)];
        }
        return zeta;
    }

    // P becomes grow * (P - weight / (1 + weight zeta) b b^T), b = P phi, returned in `b`.
    void rank_one(const Vector& f, const Vector& v, Real weight, Real grow, Vector& b) {
        Real alpha = 1;
        Real inverse = 1;
        for (int j = 0; j < size(); ++j) {
            const Real previous = alpha;
            const Real p = -weight * f[index(j)] * inverse;
            alpha += weight * f[index(j)] * v[index(j)];
            inverse = 1 / alpha;
            d_[index(j)] *= previous * inverse * grow;
            for (int i = 0; i < j; ++i) {
                const Real u = at(i, j);
                at(i, j) = u + b[index(i)] * p;
                b[index(i)] += u * v[index(j)];
            }
            b[index(j)] = v[index(j)];
        }
    }

    // A measurement of parameter i that leaves it the variance upper_[i] and does not move theta.
    void pull_down(int i, Real now) {
        Vector phi{};
        phi[index(i)] = 1;
        Vector f;
        Vector v;
        Vector unused;
        project(phi, f, v);
        rank_one(f, v, (now - upper_[index(i)]) / (now * upper_[index(i)]), 1, unused);
    }

    static constexpr Vector filled(Real value) {
        Vector v{};
        for (Real& x : v) x = value;
        return v;
    }

    Vector theta_{};
    Vector d_{};
    std::array<Real, N*(N - 1) / 2 + (N == 1)> u_{};
    Vector lower_{};
    Vector upper_ = filled(kUnbounded);
    Real lambda_ = 1;
    Real inverse_lambda_ = 1;
    int size_ = N;
    Forgetting forgetting_ = Forgetting::none;
    bool bounded_ = false;
    bool bounds_apart_ = false;
};

}  // namespace wheelwright::ident
