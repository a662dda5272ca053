#include "tools/gap/inference/statistics.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace wheelwright::gap {

// By the series for whole degrees of freedom.
double t_probability(double t, double degrees) {
    const double angle = std::atan2(std::abs(t), std::sqrt(degrees));
    const auto n = static_cast<int>(degrees);
    double sum = 0;
    if (n % 2 == 1) {
        double term = std::cos(angle);
        for (int k = 1; k <= n - 2; k += 2) {
            sum += term;
            term *= std::cos(angle) * std::cos(angle) * (k + 1) / (k + 2);
        }
        sum = 2 / std::numbers::pi * (angle + (n > 1 ? std::sin(angle) * sum : 0.0));
    } else {
        double term = 1;
        for (int k = 0; k <= n - 2; k += 2) {
            sum += term;
            term *= std::cos(angle) * std::cos(angle) * (k + 1) / (k + 2);
        }
        sum *= std::sin(angle);
    }
    return std::max(0.0, 1 - sum);
}

double interval_quantile(double blocks) {
    const double degrees = std::max(1.0, blocks - 4);
    return kNormalQuantile + 2.4 / degrees + 3.0 / (degrees * degrees);
}

namespace {

// That signs drawn anew for these sizes make the sum of the positive ones as large, exact.
double sign_probability(const std::vector<std::size_t>& sizes, std::size_t positive) {
    const std::size_t most = std::accumulate(sizes.begin(), sizes.end(), std::size_t{0});
    std::vector<double> distribution(most + 1, 0.0);
    distribution[0] = 1;
    for (const std::size_t size : sizes) {
        for (std::size_t s = most + 1; s-- > 0;)
            distribution[s] = (distribution[s] + (s >= size ? distribution[s - size] : 0.0)) / 2;
    }
    return std::accumulate(distribution.begin() + std::ptrdiff_t(positive), distribution.end(), 0.0);
}

}  // namespace

double signed_rank_probability(std::vector<double> values) {
    std::sort(values.begin(), values.end(), [](double a, double b) { return std::abs(a) < std::abs(b); });
    std::vector<std::size_t> ranks(values.size());
    std::iota(ranks.begin(), ranks.end(), std::size_t{1});
    std::size_t positive = 0;
    for (std::size_t i = 0; i < values.size(); ++i) positive += values[i] > 0 ? ranks[i] : 0;
    return sign_probability(ranks, positive);
}

double signed_sum_probability(const std::vector<double>& values) {
    constexpr double kCells = 1000;
    double all = 0;
    for (const double v : values) all += std::abs(v);
    if (!(all > 0)) return 1;
    std::vector<std::size_t> sizes;
    std::size_t positive = 0;
    for (const double v : values) {
        sizes.push_back(static_cast<std::size_t>(std::lround(std::abs(v) / all * kCells)));
        positive += v > 0 ? sizes.back() : 0;
    }
    return sign_probability(sizes, positive);
}

double wald_probability(const Eigen::VectorXd& value, const Eigen::MatrixXd& covariance, double degrees) {
    const Eigen::Index n = value.size();
    if (n == 1) return t_probability(value(0) / std::sqrt(std::max(1e-300, covariance(0, 0))), degrees);
    // scaled to unit variances, for left and right may be known as a sum only
    const Eigen::VectorXd scale = covariance.diagonal().cwiseSqrt().cwiseMax(1e-300).cwiseInverse();
    const Eigen::MatrixXd correlation = scale.asDiagonal() * covariance * scale.asDiagonal();
    const Eigen::VectorXd z = scale.cwiseProduct(value);
    const double square = z.dot((correlation + 1e-9 * Eigen::MatrixXd::Identity(n, n)).ldlt().solve(z));
    // two of them: the F distribution has a closed form; more: as if there were two, times their number
    return std::min(1.0, double(n) / 2 * std::pow(1 + square / degrees, -degrees / 2));
}

bool surely_positive(const std::vector<double>& values, double significance) {
    const auto n = static_cast<double>(values.size());
    const double mean = std::accumulate(values.begin(), values.end(), 0.0) / n;
    if (!(mean > 0) || n < 2) return false;
    double squares = 0;
    for (const double v : values) squares += (v - mean) * (v - mean);
    const double t = mean / std::sqrt(std::max(1e-300, squares / (n - 1) / n));
    return signed_rank_probability(values) <= significance || t_probability(t, n - 1) <= 2 * significance;
}

bool surely_as_predicted(const std::vector<double>& gain, const std::vector<double>& apart, double variance,
                         double significance) {
    constexpr double kLeast = 1.0 / 3;
    const double all_apart = std::accumulate(apart.begin(), apart.end(), 0.0);
    // blocks count as far as they tell: where a few hold all that the two differ by, those have to agree
    const double telling =
        all_apart * all_apart / std::inner_product(apart.begin(), apart.end(), apart.begin(), 0.0);
    if (!(telling >= 2)) return false;
    const double share = std::accumulate(gain.begin(), gain.end(), 0.0) / all_apart;
    double spread = 0;
    for (std::size_t b = 0; b < gain.size(); ++b) spread += std::pow(gain[b] - share * apart[b], 2);
    // chance alone makes a gain as far off as twice the root of what is apart and the variance
    spread = std::max(spread / all_apart * telling / (telling - 1), 4 * variance);
    return share > kLeast &&
           t_probability((share + 1) / std::sqrt(spread / all_apart), telling - 1) <= significance;
}

}  // namespace wheelwright::gap
