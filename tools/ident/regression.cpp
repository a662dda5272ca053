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

}  // namespace

Fit least_squares(const Rows& rows) {
    const Eigen::Index size = rows.phi.cols();
    const auto n = static_cast<double>(rows.phi.rows());
    Fit fit;
    fit.rows = static_cast<std::size_t>(rows.phi.rows());
    fit.bare_diagonal = Eigen::VectorXd::Constant(size, std::numeric_limits<double>::infinity());
    fit.independent_rms = Eigen::VectorXd::Zero(size);
    fit.unknown_share = Eigen::VectorXd::Ones(size);

    Eigen::VectorXd scale = rows.phi.colwise().norm();
    for (Eigen::Index j = 0; j < size; ++j) {
        if (!(scale(j) > 0)) scale(j) = std::numeric_limits<double>::infinity();  // the column becomes zero
    }
    const Eigen::VectorXd inverse = scale.cwiseInverse();
    const Eigen::MatrixXd scaled = rows.phi * inverse.asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scaled.transpose() * scaled);
    const Eigen::VectorXd& lambda = solver.eigenvalues();
    const Eigen::MatrixXd& v = solver.eigenvectors();
    Eigen::VectorXd kept = Eigen::VectorXd::Zero(size);
    for (Eigen::Index k = 0; k < size; ++k) {
        if (lambda(k) <= kCollinear * lambda(size - 1) || !(lambda(k) > 0)) continue;
        kept(k) = 1 / lambda(k);
        fit.unknown_share -= v.col(k).cwiseAbs2();
    }
    const Eigen::MatrixXd p = v * kept.asDiagonal() * v.transpose();
    const Eigen::VectorXd theta = p * (scaled.transpose() * rows.y);
    const Eigen::VectorXd residual = rows.y - scaled * theta;
    const Eigen::MatrixXd scores = residual.asDiagonal() * scaled;
    fit.lags = lags_for(scores, rows.place);
    // parameters that were fitted, and what Bartlett weights cut off
    const double small = n / std::max(1.0, n - static_cast<double>(size) - static_cast<double>(fit.lags));
    const Eigen::MatrixXd covariance = small * (p * middle(scores, rows.place, fit.lags) * p);

    fit.theta = inverse.asDiagonal() * theta;
    fit.covariance = inverse.asDiagonal() * covariance * inverse.asDiagonal();
    for (Eigen::Index j = 0; j < size; ++j) {
        if (!fit.tells(j)) continue;
        fit.bare_diagonal(j) = p(j, j) * inverse(j) * inverse(j);
        fit.independent_rms(j) = 1 / std::sqrt(fit.bare_diagonal(j) * n);
    }
    const double power = rows.y.squaredNorm();
    fit.residual_power = residual.squaredNorm() / n;
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

Ratio difference_ratio(const Fit& fit, Eigen::Index i, Eigen::Index k, Eigen::Index j) {
    const double value = (fit.theta(i) - fit.theta(k)) / fit.theta(j);
    const Eigen::MatrixXd& c = fit.covariance;
    const double own = c(i, i) - 2 * c(i, k) + c(k, k);
    const double with = c(i, j) - c(k, j);
    const double spread = own - 2 * value * with + value * value * c(j, j);
    return {value, spread / (fit.theta(j) * fit.theta(j))};
}

}  // namespace wheelwright::tools
