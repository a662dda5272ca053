// Batch least squares for logs, with standard errors that need no model of the noise's colour, and with an
// answer to what the data cannot tell.
//
// The covariance is the sandwich P (sum over lags of w_l sum phi_t e_t e_t+l phi_t+l^T) P with Bartlett
// weights (Newey and West, Econometrica 55, 1987) and the bandwidth of Andrews (Econometrica 59, 1991), from
// first-order autoregressions of the scores phi e. The recursive estimator's way to the same
// sandwich is firmware/ident/score_errors.hpp, which need not look back. Small samples: times rows / (rows -
// parameters - lags).
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace wheelwright::tools {

struct Rows {
    Eigen::MatrixXd phi;  // a row of the regression in each row
    Eigen::VectorXd y;
    std::vector<std::size_t> place;  // time of a row in units of the rows' spacing; rises; jumps between runs
};

struct Fit {
    Eigen::VectorXd theta;
    Eigen::MatrixXd covariance;       // for coloured residuals
    Eigen::MatrixXd information;      // phi^T phi over the residual's mean square
    Eigen::VectorXd bare_diagonal;    // of the inverse of phi^T phi; infinite where unknown
    Eigen::VectorXd independent_rms;  // of each column, less what the other columns explain
    // Share of a parameter's axis that lies in directions the data says nothing about: 0 known, 1 not at all.
    Eigen::VectorXd unknown_share;
    double residual_power = 0;   // mean square
    double explained_share = 0;  // 1 - residual power / power of y
    std::size_t rows = 0;
    std::size_t lags = 0;

    bool tells(Eigen::Index parameter) const { return unknown_share(parameter) < 1e-6; }
};

Fit least_squares(const Rows& rows);

// The rows as seen through 1 / (1 - colour z^-1): generalised least squares for noise of the form
// n_t - colour n_t-1, which is what a difference quotient makes of sensor noise (colour near 1) together with
// noise that acts on the plant (colour near 0). Each unbroken stretch starts with an unknown state, which is
// projected out; stretches too short for that are dropped. 0 <= colour < 1.
Rows whiten(const Rows& rows, double colour);

// A ratio theta_i / theta_j and its variance to first order.
struct Ratio {
    double value = 0, variance = 0;
};
Ratio ratio(const Fit& fit, Eigen::Index numerator, Eigen::Index denominator);

// Parameters that several equations share: theta_(first + j) / theta_torque of each. One equation may know
// only a sum of two of them and another only their difference; what each knows is added up, so the
// parameters come out where the equations tell them together.
struct Shared {
    Eigen::VectorXd value;
    Eigen::MatrixXd covariance;
    Eigen::VectorXd unknown_share;  // as in Fit

    bool tells(Eigen::Index parameter) const { return unknown_share(parameter) < 1e-6; }
    double error(Eigen::Index parameter) const;  // infinite where nothing is told
    // Standard error of the difference of two of them.
    double error_of_difference(Eigen::Index one, Eigen::Index other) const;
};
Shared combine(const std::vector<const Fit*>& fits, Eigen::Index torque, Eigen::Index first);

}  // namespace wheelwright::tools
