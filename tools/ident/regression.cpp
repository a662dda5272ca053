#include "tools/ident/regression.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

namespace wheelwright::tools {
namespace {

constexpr double kCollinear = 1e-10;  // of the largest eigenvalue of the scaled information matrix
constexpr std::size_t kFewestSums = 40;
constexpr std::size_t kFewestLags = 3;  // rows overlap: their noise is correlated whatever the sensor does

// Andrews' bandwidth for Bartlett weights, from the scores' first autocorrelations.
double bandwidth(const Eigen::MatrixXd& scores, const std::vector<std::size_t>& place) {
    const auto n = static_cast<double>(scores.rows());
    double over = 0;
    double under = 0;
    for (Eigen::Index j = 0; j < scores.cols(); ++j) {
        double same = 0;
        double next = 0;
        for (Eigen::Index t = 0; t + 1 < scores.rows(); ++t) {
            const auto at = static_cast<std::size_t>(t);
            if (place[at + 1] != place[at] + 1) continue;
            same += scores(t, j) * scores(t, j);
            next += scores(t, j) * scores(t + 1, j);
        }
        if (!(same > 0)) continue;
        const double rho = std::clamp(next / same, -0.97, 0.97);
        const double power = std::pow(same / n * (1 - rho * rho), 2);  // of the innovation, squared
        over += 4 * rho * rho * power / (std::pow(1 - rho, 6) * std::pow(1 + rho, 2));
        under += power / std::pow(1 - rho, 4);
    }
    return under > 0 ? 1.1447 * std::cbrt(over / under * n) : 0.0;
}

// Sums of `count` scores each: where fast noise hides a slow one, the sums show it.
double bandwidth_of_sums(const Eigen::MatrixXd& scores, const std::vector<std::size_t>& place,
                         std::size_t count) {
    Eigen::MatrixXd sums(scores.rows(), scores.cols());
    std::vector<std::size_t> places;
    for (std::size_t t = 0; t < place.size(); ++t) {
        const auto from = static_cast<Eigen::Index>(t);
        if (places.empty() || place[t] / count != places.back()) {
            places.push_back(place[t] / count);
            sums.row(static_cast<Eigen::Index>(places.size()) - 1) = scores.row(from);
        } else {
            sums.row(static_cast<Eigen::Index>(places.size()) - 1) += scores.row(from);
        }
    }
    sums.conservativeResize(static_cast<Eigen::Index>(places.size()), Eigen::NoChange);
    return static_cast<double>(count) * bandwidth(sums, places);
}

std::size_t lags_for(const Eigen::MatrixXd& scores, const std::vector<std::size_t>& place) {
    double wanted = static_cast<double>(kFewestLags);
    for (const std::size_t count : {1U, 4U, 16U}) {
        if (place.size() < count * kFewestSums) break;
        wanted = std::max(wanted, bandwidth_of_sums(scores, place, count));
    }
    const std::size_t most = std::max(kFewestLags, place.size() / 8);
    return std::min(static_cast<std::size_t>(std::ceil(wanted)), most);
}

Eigen::MatrixXd middle(const Eigen::MatrixXd& scores, const std::vector<std::size_t>& place,
                       std::size_t lags) {
    const Eigen::Index size = scores.cols();
    Eigen::MatrixXd sum = scores.transpose() * scores;
    for (std::size_t lag = 1; lag <= lags; ++lag) {
        const double weight = 1 - static_cast<double>(lag) / static_cast<double>(lags + 1);
        Eigen::MatrixXd cross = Eigen::MatrixXd::Zero(size, size);
        std::size_t later = 0;
        for (std::size_t t = 0; t < place.size(); ++t) {
            while (later < place.size() && place[later] < place[t] + lag) ++later;
            if (later == place.size()) break;
            if (place[later] != place[t] + lag) continue;
            cross.noalias() += scores.row(static_cast<Eigen::Index>(t)).transpose() *
                               scores.row(static_cast<Eigen::Index>(later));
        }
        sum += weight * (cross + cross.transpose());
    }
    return sum;
}

// Of a positive matrix, after scaling its diagonal to ones; collinear directions are left out.
struct PseudoInverse {
    Eigen::MatrixXd matrix;
    Eigen::VectorXd unknown_share;
};
PseudoInverse pseudo_inverse(const Eigen::MatrixXd& a) {
    const Eigen::Index size = a.rows();
    Eigen::VectorXd inverse = Eigen::VectorXd::Zero(size);
    for (Eigen::Index i = 0; i < size; ++i) {
        if (a(i, i) > 0) inverse(i) = 1 / std::sqrt(a(i, i));
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(inverse.asDiagonal() * a *
                                                                inverse.asDiagonal());
    const Eigen::VectorXd& lambda = solver.eigenvalues();
    PseudoInverse result{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Ones(size)};
    for (Eigen::Index k = 0; k < size; ++k) {
        if (lambda(k) <= kCollinear * lambda(size - 1) || !(lambda(k) > 0)) continue;
        const Eigen::VectorXd v = solver.eigenvectors().col(k);
        result.unknown_share -= v.cwiseAbs2();
        result.matrix += v * v.transpose() / lambda(k);
    }
    result.matrix = inverse.asDiagonal() * result.matrix * inverse.asDiagonal();
    return result;
}

}  // namespace

Fit least_squares(const Rows& rows) {
    const Eigen::Index size = rows.phi.cols();
    const auto n = static_cast<double>(rows.phi.rows());
    Fit fit;
    fit.rows = static_cast<std::size_t>(rows.phi.rows());
    fit.bare_diagonal = Eigen::VectorXd::Constant(size, std::numeric_limits<double>::infinity());
    fit.independent_rms = Eigen::VectorXd::Zero(size);

    const Eigen::MatrixXd gram = rows.phi.transpose() * rows.phi;
    const PseudoInverse inverse = pseudo_inverse(gram);
    const Eigen::MatrixXd& p = inverse.matrix;
    fit.unknown_share = inverse.unknown_share;
    fit.theta = p * (rows.phi.transpose() * rows.y);
    const Eigen::VectorXd residual = rows.y - rows.phi * fit.theta;
    const Eigen::MatrixXd scores = residual.asDiagonal() * rows.phi;
    fit.lags = lags_for(scores, rows.place);
    // parameters that were fitted, and what Bartlett weights cut off
    const double small = n / std::max(1.0, n - static_cast<double>(size) - static_cast<double>(fit.lags));
    fit.covariance = small * (p * middle(scores, rows.place, fit.lags) * p);
    fit.residual_power = residual.squaredNorm() / n;
    fit.information = gram / std::max(fit.residual_power, std::numeric_limits<double>::min());
    for (Eigen::Index j = 0; j < size; ++j) {
        if (!fit.tells(j)) continue;
        fit.bare_diagonal(j) = p(j, j);
        fit.independent_rms(j) = 1 / std::sqrt(fit.bare_diagonal(j) * n);
    }
    const double power = rows.y.squaredNorm();
    fit.explained_share = power > 0 ? 1 - residual.squaredNorm() / power : 0;
    return fit;
}

Rows whiten(const Rows& rows, double colour) {
    if (colour == 0) return rows;
    constexpr std::size_t kShortest = 6;
    Rows out;
    out.phi.resize(rows.phi.rows(), rows.phi.cols());
    out.y.resize(rows.y.size());
    Eigen::Index filled = 0;
    for (std::size_t begin = 0; begin < rows.place.size();) {
        std::size_t end = begin + 1;
        while (end < rows.place.size() && rows.place[end] == rows.place[end - 1] + 1) ++end;
        const auto length = static_cast<Eigen::Index>(end - begin);
        if (end - begin >= kShortest) {
            const auto from = static_cast<Eigen::Index>(begin);
            auto phi = out.phi.middleRows(filled, length);
            auto y = out.y.segment(filled, length);
            phi = rows.phi.middleRows(from, length);
            y = rows.y.segment(from, length);
            Eigen::VectorXd start(length);
            start(0) = 1;
            for (Eigen::Index t = 1; t < length; ++t) {
                phi.row(t) += colour * phi.row(t - 1);
                y(t) += colour * y(t - 1);
                start(t) = colour * start(t - 1);
            }
            start.normalize();
            const Eigen::RowVectorXd along = start.transpose() * phi;
            const double y_along = start.dot(y);
            phi -= start * along;
            y -= start * y_along;
            out.place.insert(out.place.end(), rows.place.begin() + static_cast<std::ptrdiff_t>(begin),
                             rows.place.begin() + static_cast<std::ptrdiff_t>(end));
            filled += length;
        }
        begin = end;
    }
    out.phi.conservativeResize(filled, Eigen::NoChange);
    out.y.conservativeResize(filled);
    return out;
}

Ratio ratio(const Fit& fit, Eigen::Index i, Eigen::Index j) {
    const double value = fit.theta(i) / fit.theta(j);
    const double spread =
        fit.covariance(i, i) - 2 * value * fit.covariance(i, j) + value * value * fit.covariance(j, j);
    return {value, spread / (fit.theta(j) * fit.theta(j))};
}

double Shared::error(Eigen::Index i) const {
    if (!tells(i) || !(covariance(i, i) > 0)) return std::numeric_limits<double>::infinity();
    return std::sqrt(covariance(i, i));
}

double Shared::error_of_difference(Eigen::Index i, Eigen::Index k) const {
    if (!tells(i) || !tells(k)) return std::numeric_limits<double>::infinity();
    return std::sqrt(std::max(0.0, covariance(i, i) - 2 * covariance(i, k) + covariance(k, k)));
}

Shared combine(const std::vector<const Fit*>& fits, Eigen::Index torque, Eigen::Index first) {
    Shared shared;
    if (fits.empty()) return shared;
    const Eigen::Index size = fits.front()->theta.size() - first;
    Eigen::MatrixXd total = Eigen::MatrixXd::Zero(size, size);
    Eigen::VectorXd pull = Eigen::VectorXd::Zero(size);
    Eigen::MatrixXd spread = Eigen::MatrixXd::Zero(size, size);
    for (const Fit* fit : fits) {
        const double gain = fit->theta(torque);
        const Eigen::VectorXd value = fit->theta.tail(size) / gain;
        // to first order, the ratios move with d theta_j - ratio_j d theta_torque
        Eigen::MatrixXd slope = Eigen::MatrixXd::Zero(size, fit->theta.size());
        slope.rightCols(size).setIdentity();
        slope.col(torque) = -value;
        const Eigen::MatrixXd covariance = slope * fit->covariance * slope.transpose() / (gain * gain);
        // what the equation knows of the ratios, whatever its other parameters are
        const Eigen::MatrixXd across = fit->information.block(0, first, first, size);
        const Eigen::MatrixXd known =
            gain * gain *
            (fit->information.bottomRightCorner(size, size) -
             across.transpose() * pseudo_inverse(fit->information.topLeftCorner(first, first)).matrix *
                 across);
        total += known;
        pull += known * value;
        spread += known * covariance * known;
    }
    const PseudoInverse p = pseudo_inverse(total);
    shared.value = p.matrix * pull;
    shared.covariance = p.matrix * spread * p.matrix;
    shared.unknown_share = p.unknown_share;
    return shared;
}

}  // namespace wheelwright::tools
