#include "tools/gap/gap_fit.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace wheelwright::gap {
namespace {

constexpr Eigen::Index kK5 = 0, kK6 = 1, kK7 = 2, kK8 = 3, kFirstAmount = 4;
constexpr int kIterations = 6;
constexpr double kOut = 1e20;
// The torque may be logged as late or early as this: which instant of the
// sample it belongs to is seldom said. More would be an effect, and on a ramp
// of torque it looks like friction.
constexpr double kTimingRange_samples = 1.5;

Eigen::Index width() { return static_cast<Eigen::Index>(columns().size()); }

std::array<Eigen::MatrixXd, kEquations> sum_of(const Blocks& blocks) {
    std::array<Eigen::MatrixXd, kEquations> sum;
    for (std::size_t e = 0; e < kEquations; ++e) {
        sum[e] = Eigen::MatrixXd::Zero(width() + 1, width() + 1);
        for (const Block* block : blocks) sum[e] += block->product[e];
    }
    return sum;
}

// Coefficients of the columns with -1 for y, and their derivatives.
struct Coefficients {
    std::array<Eigen::VectorXd, kEquations> value;
    std::array<Eigen::MatrixXd, kEquations> slope;
};

Coefficients coefficients(const ModelShape& shape, const Eigen::VectorXd& p, bool slopes) {
    Coefficients c;
    for (std::size_t e = 0; e < kEquations; ++e) {
        const Eigen::Index product = e == kLinear ? kK5 : kK6;
        const Eigen::Index gain = e == kLinear ? kK7 : kK8;
        Eigen::VectorXd& value = c.value[e];
        value = Eigen::VectorXd::Zero(width() + 1);
        value(width()) = -1;
        value(kProduct) = p(product);
        value(kTorque) = p(gain);
        for (std::size_t i = 0; i < shape.amounts.size(); ++i) {
            for (const int column : shape.amounts[i].columns) {
                value(column) += p(gain) * p(kFirstAmount + Eigen::Index(i));
            }
        }
        if (!slopes) continue;
        Eigen::MatrixXd& slope = c.slope[e];
        slope = Eigen::MatrixXd::Zero(width() + 1, p.size());
        slope(kProduct, product) = 1;
        slope(kTorque, gain) = 1;
        for (std::size_t i = 0; i < shape.amounts.size(); ++i) {
            const Eigen::Index at = kFirstAmount + Eigen::Index(i);
            for (const int column : shape.amounts[i].columns) {
                slope(column, gain) += p(at);
                slope(column, at) += p(gain);
            }
        }
    }
    return c;
}

// What nothing tells stays near zero: variances of priors, so wide that no log
// notices them.
Eigen::VectorXd prior_precision(const ModelShape& shape, const std::array<Eigen::MatrixXd, kEquations>& sum) {
    Eigen::VectorXd precision(kFirstAmount + Eigen::Index(shape.amounts.size()));
    precision(kK5) = 1 / (0.5 * 0.5);
    precision(kK6) = 1 / (50.0 * 50.0);
    precision(kK7) = precision(kK8) = 1e-9;
    for (std::size_t i = 0; i < shape.amounts.size(); ++i) {
        // ten times the torque that was commanded
        double column = 0;
        for (const int c : shape.amounts[i].columns) {
            for (std::size_t e = 0; e < kEquations; ++e) column += sum[e](c, c);
        }
        const double torque = sum[kLinear](kTorque, kTorque) + sum[kTurning](kTorque, kTorque);
        if (shape.amounts[i].columns.front() == kTiming) {
            precision(kFirstAmount + Eigen::Index(i)) = 1 / (kTimingRange_samples * kTimingRange_samples);
            continue;
        }
        precision(kFirstAmount + Eigen::Index(i)) = 1e-9 + (torque > 0 ? 1e-2 * column / torque : 0.0);
    }
    return precision;
}

// Each equation by itself is linear in its coefficients: with them the
// iteration starts near its end.
void start(const std::array<Eigen::MatrixXd, kEquations>& sum, const ModelShape& shape, Eigen::VectorXd& p) {
    const auto count = Eigen::Index(shape.amounts.size());
    Eigen::VectorXd weight = Eigen::VectorXd::Zero(count);
    for (std::size_t e = 0; e < (shape.turning ? kEquations : kTurning); ++e) {
        Eigen::MatrixXd pick = Eigen::MatrixXd::Zero(width(), 2 + count);
        pick(kProduct, 0) = 1;
        pick(kTorque, 1) = 1;
        for (Eigen::Index i = 0; i < count; ++i) {
            for (const int column : shape.amounts[std::size_t(i)].columns) pick(column, 2 + i) = 1;
        }
        const Eigen::MatrixXd all = sum[e].topLeftCorner(width(), width());
        Eigen::MatrixXd normal = pick.transpose() * all * pick;
        const Eigen::VectorXd own = normal.diagonal();
        for (Eigen::Index i = 0; i < own.size(); ++i) normal(i, i) += 1e-7 * own(i) + 1e-12;
        const Eigen::VectorXd c = normal.ldlt().solve(pick.transpose() * sum[e].col(width()).head(width()));
        p(e == kLinear ? kK5 : kK6) = c(0);
        p(e == kLinear ? kK7 : kK8) = c(1);
        if (!(c(1) > 0)) continue;
        for (Eigen::Index i = 0; i < count; ++i) {
            const double w = c(1) * c(1) * own(2 + i);
            p(kFirstAmount + i) += w * c(2 + i) / c(1);
            weight(i) += w;
        }
    }
    for (Eigen::Index i = 0; i < count; ++i) {
        if (weight(i) > 0) p(kFirstAmount + i) /= weight(i);
    }
}

double square_of(const Eigen::MatrixXd& product, const Eigen::VectorXd& c) { return c.dot(product * c); }

}  // namespace

double row_count(const Blocks& blocks, const ModelShape& shape) {
    double rows = 0;
    for (const Block* block : blocks) {
        rows += block->rows[kLinear];
        if (shape.turning) rows += block->rows[kTurning];
    }
    return rows;
}

Fit fit(const Blocks& blocks, const ModelShape& shape) {
    Fit result;
    result.shape = shape;
    const Eigen::Index size = kFirstAmount + Eigen::Index(shape.amounts.size());
    Eigen::VectorXd& p = result.value;
    p = Eigen::VectorXd::Zero(size);
    const auto sum = sum_of(blocks);
    const std::size_t equations = shape.turning ? kEquations : kTurning;
    start(sum, shape, p);
    Eigen::VectorXd prior = prior_precision(shape, sum);
    if (!shape.turning) prior(kK5) = kOut;  // a yaw rate that is noise alone tells nothing of it
    Eigen::VectorXd centre = Eigen::VectorXd::Zero(size);
    Eigen::MatrixXd normal;
    for (int iteration = 0; iteration < kIterations; ++iteration) {
        const Coefficients c = coefficients(shape, p, true);
        normal = prior.asDiagonal();
        Eigen::VectorXd gradient = prior.cwiseProduct(centre - p);
        for (std::size_t e = 0; e < equations; ++e) {
            const Eigen::MatrixXd weighted = sum[e] * c.slope[e];
            normal += c.slope[e].transpose() * weighted;
            gradient -= weighted.transpose() * c.value[e];
        }
        p += normal.ldlt().solve(gradient);
        for (std::size_t i = 0; i < shape.amounts.size(); ++i) {
            const Eigen::Index at = kFirstAmount + Eigen::Index(i);
            if (shape.amounts[i].columns.front() != kTiming || std::abs(p(at)) <= kTimingRange_samples)
                continue;
            centre(at) = p(at) = std::copysign(kTimingRange_samples, p(at));
            prior(at) = kOut;
        }
    }
    const Coefficients c = coefficients(shape, p, true);
    Eigen::MatrixXd meat = Eigen::MatrixXd::Zero(size, size);
    for (const Block* block : blocks) {
        Eigen::VectorXd score = Eigen::VectorXd::Zero(size);
        for (std::size_t e = 0; e < equations; ++e) {
            score -= c.slope[e].transpose() * (block->product[e] * c.value[e]);
        }
        meat += score * score.transpose();
    }
    const Eigen::MatrixXd inverse = normal.ldlt().solve(Eigen::MatrixXd::Identity(size, size));
    const double n = double(blocks.size());
    const double small_sample = n > 2 ? n / (n - 1) : 2.0;
    result.squares = squares(blocks, result);
    result.rows = row_count(blocks, shape);
    result.covariance = small_sample * inverse * meat * inverse;
    // never below what the noise alone, at the level of the residual, would give
    const double level = std::max(0.0, result.squares / std::max(1.0, result.rows - double(size)));
    for (Eigen::Index i = 0; i < size; ++i) {
        const double least = inverse(i, i) * std::min(1.0, level);
        if (result.covariance(i, i) < least) result.covariance(i, i) = least;
    }
    return result;
}

double squares(const Block& block, const Fit& fit) {
    const Coefficients c = coefficients(fit.shape, fit.value, false);
    double total = square_of(block.product[kLinear], c.value[kLinear]);
    if (fit.shape.turning) total += square_of(block.product[kTurning], c.value[kTurning]);
    return total;
}

double squares(const Blocks& blocks, const Fit& fit) {
    const Coefficients c = coefficients(fit.shape, fit.value, false);
    double total = 0;
    for (const Block* block : blocks) {
        total += square_of(block->product[kLinear], c.value[kLinear]);
        if (fit.shape.turning) total += square_of(block->product[kTurning], c.value[kTurning]);
    }
    return total;
}

double torque_squares(const Blocks& blocks, const Fit& fit) {
    double total = 0;
    for (const Block* block : blocks) {
        total += fit.value(kK7) * fit.value(kK7) * block->product[kLinear](kTorque, kTorque);
        if (fit.shape.turning) {
            total += fit.value(kK8) * fit.value(kK8) * block->product[kTurning](kTorque, kTorque);
        }
    }
    return total;
}

double reachable_squares(const Blocks& blocks, const ModelShape& shape, const std::vector<int>& extra) {
    std::vector<int> used{kProduct, kTorque};
    for (const Amount& amount : shape.amounts) {
        used.insert(used.end(), amount.columns.begin(), amount.columns.end());
    }
    used.insert(used.end(), extra.begin(), extra.end());
    std::sort(used.begin(), used.end());
    used.erase(std::unique(used.begin(), used.end()), used.end());
    constexpr std::size_t kFolds = 5;
    const std::size_t equations = shape.turning ? kEquations : kTurning;
    double total = 0;
    for (std::size_t e = 0; e < equations; ++e) {
        const auto y = Eigen::Index(used.size());
        const auto reduced = [&](const Eigen::MatrixXd& product) {
            std::vector<int> with_y = used;
            with_y.push_back(static_cast<int>(width()));
            return Eigen::MatrixXd(product(with_y, with_y));
        };
        std::vector<Eigen::MatrixXd> each;
        Eigen::MatrixXd all = Eigen::MatrixXd::Zero(y + 1, y + 1);
        for (const Block* block : blocks) {
            each.push_back(reduced(block->product[e]));
            all += each.back();
        }
        for (std::size_t fold = 0; fold < std::min(kFolds, each.size()); ++fold) {
            Eigen::MatrixXd rest = all;
            for (std::size_t b = fold; b < each.size(); b += kFolds) rest -= each[b];
            Eigen::MatrixXd normal = rest.topLeftCorner(y, y);
            for (Eigen::Index i = 0; i < y; ++i) normal(i, i) += 1e-6 * normal(i, i) + 1e-12;
            Eigen::VectorXd c(y + 1);
            c.head(y) = normal.ldlt().solve(rest.col(y).head(y));
            c(y) = -1;
            for (std::size_t b = fold; b < each.size(); b += kFolds) total += square_of(each[b], c);
        }
    }
    return total;
}

double likeness(const Blocks& blocks, const Fit& base, const std::vector<Amount>& wanted,
                const std::vector<Amount>& rival) {
    const auto sum = sum_of(blocks);
    const std::size_t equations = base.shape.turning ? kEquations : kTurning;
    const Coefficients c = coefficients(base.shape, base.value, true);
    // Directions in the space of columns: what `base` can do already, the rival,
    // and what is wanted.
    const auto direction = [&](const Amount& amount, std::size_t e) {
        Eigen::VectorXd d = Eigen::VectorXd::Zero(width() + 1);
        for (const int column : amount.columns) d(column) = base.value(e == kLinear ? kK7 : kK8);
        return d;
    };
    const Eigen::Index have = base.value.size();
    const auto more = Eigen::Index(rival.size());
    const auto goal = Eigen::Index(wanted.size());
    const Eigen::Index all = have + more + goal;
    Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(all, all);
    for (std::size_t e = 0; e < equations; ++e) {
        Eigen::MatrixXd d(width() + 1, all);
        d.leftCols(have) = c.slope[e];
        for (Eigen::Index i = 0; i < more; ++i) d.col(have + i) = direction(rival[std::size_t(i)], e);
        for (Eigen::Index i = 0; i < goal; ++i) d.col(have + more + i) = direction(wanted[std::size_t(i)], e);
        gram += d.transpose() * sum[e] * d;
    }
    const auto left_over = [&](Eigen::Index known) {
        Eigen::MatrixXd inner = gram.topLeftCorner(known, known);
        for (Eigen::Index i = 0; i < known; ++i) inner(i, i) += 1e-9 * inner(i, i) + 1e-12;
        const Eigen::MatrixXd cross = gram.block(0, have + more, known, goal);
        const Eigen::MatrixXd rest =
            gram.block(have + more, have + more, goal, goal) - cross.transpose() * inner.ldlt().solve(cross);
        return rest.trace();
    };
    const double before = left_over(have);
    return before > 0 ? 1 - std::max(0.0, left_over(have + more)) / before : 1.0;
}

}  // namespace wheelwright::gap
