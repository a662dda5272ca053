// Least-squares parabola through samples (time, value) as they come, and the mean of repeated measurements.
// Fixed size; some 20 operations a sample.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace wheelwright::ident {

class Parabola {
  public:
    // Times of one parabola should stay within a few seconds of each other: sums of their fourth powers are
    // kept.
    void add(double time_s, double value) {
        if (count_ == 0) {
            first_time_s_ = time_s;
            first_value_ = value;
        }
        const double t = time_s - first_time_s_;
        const double y = value - first_value_;
        double power = 1;
        for (double& sum : time_) {
            sum += power;
            power *= t;
        }
        value_[0] += y;
        value_[1] += t * y;
        value_[2] += t * t * y;
        square_ += y * y;
        ++count_;
    }

    std::uint32_t count() const { return count_; }
    // Twice the coefficient of t^2; 0 with fewer than kFewest samples.
    double acceleration() const { return count_ < kFewest ? 0 : 2 * solve()[2]; }
    double residual_variance() const {
        if (count_ < kFewest) return 0;
        const std::array<double, 3> c = solve();
        const double left = square_ - c[0] * value_[0] - c[1] * value_[1] - c[2] * value_[2];
        return left > 0 ? left / (count_ - 3) : 0;
    }

  private:
    static constexpr std::uint32_t kFewest = 6;

    std::array<double, 3> solve() const {  // Cramer's rule on the normal equations
        const auto& s = time_;
        const double a = s[2] * s[4] - s[3] * s[3];
        const double b = s[1] * s[4] - s[2] * s[3];
        const double c = s[1] * s[3] - s[2] * s[2];
        const double d = s[0] * s[4] - s[2] * s[2];
        const double e = s[0] * s[3] - s[1] * s[2];
        const double f = s[0] * s[2] - s[1] * s[1];
        const double determinant = s[0] * a - s[1] * b + s[2] * c;
        if (!(determinant > 0)) return {};
        const auto& y = value_;
        return {(a * y[0] - b * y[1] + c * y[2]) / determinant,
                (-b * y[0] + d * y[1] - e * y[2]) / determinant,
                (c * y[0] - e * y[1] + f * y[2]) / determinant};
    }

    std::array<double, 5> time_{};  // sums of t^0 .. t^4
    std::array<double, 3> value_{};
    double square_ = 0, first_time_s_ = 0, first_value_ = 0;
    std::uint32_t count_ = 0;
};

class Mean {
  public:
    void add(double x) {
        ++count_;
        const double off = x - mean_;
        mean_ += off / count_;
        squares_ += off * (x - mean_);
    }
    std::uint32_t count() const { return count_; }
    double mean() const { return mean_; }
    double error() const {  // standard error of the mean
        return count_ < 2 ? 1e300 : std::sqrt(squares_ / (count_ - 1.0) / count_);
    }

  private:
    double mean_ = 0, squares_ = 0;
    std::uint32_t count_ = 0;
};

}  // namespace wheelwright::ident
