// Probabilities of the search's tests.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace wheelwright::gap {

// Student's t, two-sided.
double t_probability(double t, double degrees);

// Standard errors to either side of a 95 % interval of a normal distribution.
inline constexpr double kNormalQuantile = 1.96;
// The same of Student's t, for a fit to so many blocks.
double interval_quantile(double blocks);

// One-sided Wilcoxon signed-rank probability that the values are not above zero, exact.
double signed_rank_probability(std::vector<double> values);

// The same of their sum: of what is as often less than nothing as more, how often it is as large. Large
// values count as large, so that a few that agree may be sure among many that tell nothing, and one alone
// never is. Of values in thousandths of the sum of their sizes: a thousand operations a value.
double signed_sum_probability(const std::vector<double>& values);

// Hotelling's test that all values are zero, with their covariance from so many blocks and degrees of
// freedom.
double wald_probability(const Eigen::VectorXd& value, const Eigen::MatrixXd& covariance, double degrees);

// More than chance: by rank, which a few values do not lead astray, or by the mean, which counts by how much.
bool surely_positive(const std::vector<double>& values, double significance);

// What one model gains over another in each block (the other's squares less its own), beside the squares by
// which the two predict it to be apart: all of those, give or take, if the one is true, and as much less
// than nothing if the other is. Whether it is surely rather the one: the gain is a third of what is predicted
// at least, and off the other's by more than chance, two-sided at `significance`. Both have one value for a
// block, in units of the rows' noise; `variance` of what neither predicts is the least that is believed.
// Blocks count as far as the two are apart there (Kish's effective number): fewer than two, or models that
// predict the same: no.
bool surely_as_predicted(const std::vector<double>& gain, const std::vector<double>& apart, double variance,
                         double significance);

}  // namespace wheelwright::gap
