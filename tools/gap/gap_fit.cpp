#include "tools/gap/gap_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace wheelwright::gap {
namespace {

constexpr Eigen::Index kK5 = 0, kK6 = 1, kK7 = 2, kK8 = 3;
constexpr int kIterations = 8;
constexpr double kOut = 1e20;

Eigen::Index width(const Blocks& blocks) {
    return blocks.empty() ? 0 : blocks.front()->product[kLinear].rows() - 1;
}

// The columns that a model needs, y last, and where each of its amounts' stand among them.
struct Used {
    std::vector<int> column;
    std::vector<std::vector<Eigen::Index>> amount;
    std::vector<Eigen::Index> fixed;
    Eigen::Index product = 0, torque = 1, y = 0;
};

Eigen::Index place(std::vector<int>& columns, int column) {
    const auto found = std::find(columns.begin(), columns.end(), column);
    if (found != columns.end()) return found - columns.begin();
    columns.push_back(column);
    return static_cast<Eigen::Index>(columns.size()) - 1;
}

Used used_by(const Blocks& blocks, const ModelShape& shape) {
    Used used;
    used.column = {Dictionary::kProduct, Dictionary::kTorque};
    for (const Amount& amount : shape.amounts) {
        used.amount.emplace_back();
        for (const int c : amount.columns) used.amount.back().push_back(place(used.column, c));
    }
    for (const int c : shape.fixed) used.fixed.push_back(place(used.column, c));
    used.y = place(used.column, static_cast<int>(width(blocks)));
    return used;
}

using Products = std::array<Eigen::MatrixXd, kEquations>;

Eigen::MatrixXd picked(const Eigen::MatrixXd& product, const std::vector<int>& columns) {
    return product(columns, columns);
}

Products sum_of(const Blocks& blocks, const Used& used) {
    Products sum;
    const auto size = static_cast<Eigen::Index>(used.column.size());
    for (std::size_t e = 0; e < kEquations; ++e) {
        sum[e] = Eigen::MatrixXd::Zero(size, size);
        for (const Block* block : blocks) sum[e] += picked(block->product[e], used.column);
    }
    return sum;
}

// Coefficients of the columns with -1 for y, and their derivatives.
struct Coefficients {
    std::array<Eigen::VectorXd, kEquations> value;
    std::array<Eigen::MatrixXd, kEquations> slope;
};

Coefficients coefficients(const Used& used, const Eigen::VectorXd& p, bool slopes) {
    Coefficients c;
    const auto size = static_cast<Eigen::Index>(used.column.size());
    for (std::size_t e = 0; e < kEquations; ++e) {
        const Eigen::Index product = e == kLinear ? kK5 : kK6;
        const Eigen::Index gain = e == kLinear ? kK7 : kK8;
        Eigen::VectorXd& value = c.value[e];
        value = Eigen::VectorXd::Zero(size);
        value(used.y) = -1;
        value(used.product) = p(product);
        value(used.torque) = p(gain);
        for (std::size_t i = 0; i < used.amount.size(); ++i) {
            for (const Eigen::Index column : used.amount[i]) {
                value(column) += p(gain) * p(kFirstAmount + Eigen::Index(i));
            }
        }
        for (const Eigen::Index column : used.fixed) value(column) += p(gain);
        if (!slopes) continue;
        Eigen::MatrixXd& slope = c.slope[e];
        slope = Eigen::MatrixXd::Zero(size, p.size());
        slope(used.product, product) = 1;
        slope(used.torque, gain) = 1;
        for (std::size_t i = 0; i < used.amount.size(); ++i) {
            const Eigen::Index at = kFirstAmount + Eigen::Index(i);
            for (const Eigen::Index column : used.amount[i]) {
                slope(column, gain) += p(at);
                slope(column, at) += p(gain);
            }
        }
        for (const Eigen::Index column : used.fixed) slope(column, gain) += 1;
    }
    return c;
}

// What nothing tells stays near zero: variances of priors, so wide that no log
// notices them.
Eigen::VectorXd prior_precision(const Used& used, const ModelShape& shape, const Products& sum,
                                double timing_range) {
    Eigen::VectorXd precision(kFirstAmount + Eigen::Index(shape.amounts.size()));
    precision(kK5) = 1 / (0.5 * 0.5);
    precision(kK6) = 1 / (50.0 * 50.0);
    precision(kK7) = precision(kK8) = 1e-9;
    for (std::size_t i = 0; i < shape.amounts.size(); ++i) {
        if (shape.amounts[i].columns.front() == Dictionary::kTiming) {
            precision(kFirstAmount + Eigen::Index(i)) = 1 / (timing_range * timing_range);
            continue;
        }
        if (shape.amounts[i].expected > 0) {
            precision(kFirstAmount + Eigen::Index(i)) = std::pow(shape.amounts[i].expected, -2);
            continue;
        }
        // ten times the torque that was commanded
        double column = 0;
        for (const Eigen::Index c : used.amount[i]) {
            for (std::size_t e = 0; e < kEquations; ++e) column += sum[e](c, c);
        }
        const double torque =
            sum[kLinear](used.torque, used.torque) + sum[kTurning](used.torque, used.torque);
        precision(kFirstAmount + Eigen::Index(i)) = 1e-9 + (torque > 0 ? 1e-2 * column / torque : 0.0);
    }
    return precision;
}

// Each equation by itself is linear in its coefficients: with them the
// iteration starts near its end.
void start(const Products& sum, const Used& used, const ModelShape& shape, Eigen::VectorXd& p) {
    const auto count = Eigen::Index(shape.amounts.size());
    const auto size = static_cast<Eigen::Index>(used.column.size());
    Eigen::VectorXd weight = Eigen::VectorXd::Zero(count);
    for (std::size_t e = 0; e < (shape.turning ? kEquations : kTurning); ++e) {
        Eigen::MatrixXd pick = Eigen::MatrixXd::Zero(size, 2 + count);
        pick(used.product, 0) = 1;
        pick(used.torque, 1) = 1;
        for (const Eigen::Index column : used.fixed) pick(column, 1) = 1;
        for (Eigen::Index i = 0; i < count; ++i) {
            for (const Eigen::Index column : used.amount[std::size_t(i)]) pick(column, 2 + i) = 1;
        }
        Eigen::MatrixXd normal = pick.transpose() * sum[e] * pick;
        const Eigen::VectorXd own = normal.diagonal();
        // what the torque itself tells is not put into an amount: each equation would share it out
        // differently
        for (Eigen::Index i = 0; i < own.size(); ++i) normal(i, i) += (i < 2 ? 1e-7 : 1e-3) * own(i) + 1e-12;
        const Eigen::VectorXd c = normal.ldlt().solve(pick.transpose() * sum[e].col(used.y));
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

// Covariance from the blocks' scores, as they are or each set right for what it has pulled the fit to itself:
// "CR2" of Bell and McCaffrey, Survey Methodology 28 (2002), in coordinates in which the normal matrix is
// one.
Eigen::MatrixXd covariance_of_blocks(const Blocks& blocks, const Used& used, const Coefficients& c,
                                     const Eigen::MatrixXd& normal, std::size_t equations, bool set_right) {
    constexpr double kAlone = 1e-3;  // share of what is known of a direction that the others must tell
    const Eigen::VectorXd scale = normal.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::LLT<Eigen::MatrixXd> root(scale.asDiagonal() * normal * scale.asDiagonal());
    const auto size = normal.rows();
    Eigen::MatrixXd meat = Eigen::MatrixXd::Zero(size, size);
    for (const Block* block : blocks) {
        Eigen::VectorXd score = Eigen::VectorXd::Zero(size);
        Eigen::MatrixXd own = Eigen::MatrixXd::Zero(size, size);
        for (std::size_t e = 0; e < equations; ++e) {
            const Eigen::MatrixXd weighted = picked(block->product[e], used.column) * c.slope[e];
            score -= weighted.transpose() * c.value[e];
            own += c.slope[e].transpose() * weighted;
        }
        score = root.matrixL().solve(scale.cwiseProduct(score));
        if (!set_right) {
            const double n = double(blocks.size());
            meat += (n > 2 ? n / (n - 1) : 2.0) * score * score.transpose();
            continue;
        }
        own = root.matrixL().solve(scale.asDiagonal() * own * scale.asDiagonal());
        own = root.matrixL().solve(own.transpose()).eval();
        const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> parts(own);
        const Eigen::VectorXd others = (1 - parts.eigenvalues().array()).max(kAlone).rsqrt();
        const Eigen::VectorXd right =
            parts.eigenvectors() * others.cwiseProduct(parts.eigenvectors().transpose() * score);
        meat += right * right.transpose();
    }
    const Eigen::MatrixXd out = root.matrixU().solve(Eigen::MatrixXd::Identity(size, size));
    return scale.asDiagonal() * (out * meat * out.transpose()) * scale.asDiagonal();
}

}  // namespace

double timing_range_samples(double period_s) {
    constexpr double kSlow_s = 1 / 90.0;
    return period_s > kSlow_s ? 1.5 : 0.1;
}

double row_count(const Blocks& blocks, const ModelShape& shape) {
    double rows = 0;
    for (const Block* block : blocks) {
        rows += block->rows[kLinear];
        if (shape.turning) rows += block->rows[kTurning];
    }
    return rows;
}

Fit fit(const Blocks& blocks, const ModelShape& shape, Spread spread) {
    Fit result;
    result.shape = shape;
    const Eigen::Index size = kFirstAmount + Eigen::Index(shape.amounts.size());
    Eigen::VectorXd& p = result.value;
    p = Eigen::VectorXd::Zero(size);
    const Used used = used_by(blocks, shape);
    const Products sum = sum_of(blocks, used);
    const std::size_t equations = shape.turning ? kEquations : kTurning;
    const double timing_range = timing_range_samples(blocks.front()->period_s);
    start(sum, used, shape, p);
    Eigen::VectorXd prior = prior_precision(used, shape, sum, timing_range);
    if (!shape.turning) prior(kK5) = kOut;  // a yaw rate that is noise alone tells nothing of it
    Eigen::VectorXd centre = Eigen::VectorXd::Zero(size);
    Eigen::MatrixXd normal;
    const auto missed = [&](const Eigen::VectorXd& at) {
        const Coefficients c = coefficients(used, at, false);
        double total = prior.dot((at - centre).cwiseAbs2());
        for (std::size_t e = 0; e < equations; ++e) total += square_of(sum[e], c.value[e]);
        return total;
    };
    constexpr double kSettled = 1e-6;  // of a variance of the noise
    // K8 times a bias tells neither where no torque turns the robot: whole steps may lead away for good, and
    // so do halved ones get there slowly. So whole ones first.
    const auto iterate = [&](int halvings) {
        Eigen::VectorXd best = p;
        double least = missed(p);
        for (int iteration = 0; iteration < kIterations; ++iteration) {
            const Coefficients c = coefficients(used, p, true);
            normal = prior.asDiagonal();
            Eigen::VectorXd gradient = prior.cwiseProduct(centre - p);
            for (std::size_t e = 0; e < equations; ++e) {
                const Eigen::MatrixXd weighted = sum[e] * c.slope[e];
                normal += c.slope[e].transpose() * weighted;
                gradient -= weighted.transpose() * c.value[e];
            }
            const double before = missed(p);
            Eigen::VectorXd step = normal.ldlt().solve(gradient);
            const Eigen::VectorXd from = p;
            p += step;
            double after = missed(p);
            for (int half = 0; half < halvings && !(after <= before); ++half) {
                step /= 2;
                p = from + step;
                after = missed(p);
            }
            bool held = false;
            for (std::size_t i = 0; i < shape.amounts.size(); ++i) {
                const Eigen::Index at = kFirstAmount + Eigen::Index(i);
                if (shape.amounts[i].columns.front() != Dictionary::kTiming ||
                    std::abs(p(at)) <= timing_range)
                    continue;
                centre(at) = p(at) = std::copysign(timing_range, p(at));
                held = held || prior(at) != kOut;
                prior(at) = kOut;
            }
            if (held) least = after = missed(p);
            if (held || after < least) {
                least = after;
                best = p;
            }
            if (!held && std::abs(before - after) < kSettled * (1 + kSettled * before)) return true;
        }
        p = best;
        return false;
    };
    constexpr int kHalvings = 12;
    if (!iterate(0)) iterate(kHalvings);
    result.squares = squares(blocks, result);
    result.rows = row_count(blocks, shape);
    if (spread == Spread::left_out) return result;
    const bool plain = spread == Spread::plain;
    result.covariance =
        covariance_of_blocks(blocks, used, coefficients(used, p, true), normal, equations, !plain);
    // Never below what independent rows of the residual's level would give: what one block alone tells has
    // no spread between blocks.
    const double level = std::max(0.0, result.squares / std::max(1.0, result.rows - double(size)));
    const Eigen::MatrixXd inverse = normal.ldlt().solve(Eigen::MatrixXd::Identity(size, size));
    for (Eigen::Index i = 0; i < size; ++i) {
        const double least = inverse(i, i) * (plain ? std::min(1.0, level) : level);
        result.covariance(i, i) = std::max(result.covariance(i, i), least);
    }
    return result;
}

double squares(const Block& block, const Fit& fit) { return squares(Blocks{&block}, fit); }

double squares(const Blocks& blocks, const Fit& fit) {
    if (blocks.empty()) return 0;
    const Used used = used_by(blocks, fit.shape);
    const Coefficients c = coefficients(used, fit.value, false);
    double total = 0;
    for (const Block* block : blocks) {
        total += square_of(picked(block->product[kLinear], used.column), c.value[kLinear]);
        if (fit.shape.turning) {
            total += square_of(picked(block->product[kTurning], used.column), c.value[kTurning]);
        }
    }
    return total;
}

double squares_apart(const Block& block, const Fit& a, const Fit& b) {
    const Blocks one{&block};
    Used used = used_by(one, a.shape);
    const Used other = used_by(one, b.shape);
    const Coefficients first = coefficients(used, a.value, false);
    const Coefficients second = coefficients(other, b.value, false);
    // columns of both side by side; what was measured is in both, and goes out
    used.column.insert(used.column.end(), other.column.begin(), other.column.end());
    double total = 0;
    for (std::size_t e = 0; e < (a.shape.turning ? kEquations : kTurning); ++e) {
        Eigen::VectorXd difference(first.value[e].size() + second.value[e].size());
        difference << first.value[e], -second.value[e];
        total += square_of(picked(block.product[e], used.column), difference);
    }
    return total;
}

double torque_squares(const Blocks& blocks, const Fit& fit) {
    double total = 0;
    for (const Block* block : blocks) {
        total += fit.value(kK7) * fit.value(kK7) *
                 block->product[kLinear](Dictionary::kTorque, Dictionary::kTorque);
        if (fit.shape.turning) {
            total += fit.value(kK8) * fit.value(kK8) *
                     block->product[kTurning](Dictionary::kTorque, Dictionary::kTorque);
        }
    }
    return total;
}

double beyond_noise_share(const Blocks& blocks, const Fit& fit) {
    const Used used = used_by(blocks, fit.shape);
    const Coefficients c = coefficients(used, fit.value, false);
    double left = 0;
    double torque = 0;
    for (const Block* block : blocks) {
        for (std::size_t e = 0; e < (fit.shape.turning ? kEquations : kTurning); ++e) {
            left += (block->row[e](Eigen::all, used.column) * c.value[e]).squaredNorm() - block->rows[e];
            const double gain = fit.value(e == kLinear ? kK7 : kK8);
            torque += gain * gain * block->row[e].col(Dictionary::kTorque).squaredNorm();
        }
    }
    return torque > 0 ? std::sqrt(std::max(0.0, left) / torque) : 0.0;
}

double reachable_squares(const Blocks& blocks, const ModelShape& shape, const std::vector<int>& extra) {
    std::vector<int> used{Dictionary::kProduct, Dictionary::kTorque};
    for (const Amount& amount : shape.amounts) {
        used.insert(used.end(), amount.columns.begin(), amount.columns.end());
    }
    used.insert(used.end(), shape.fixed.begin(), shape.fixed.end());
    used.insert(used.end(), extra.begin(), extra.end());
    std::sort(used.begin(), used.end());
    used.erase(std::unique(used.begin(), used.end()), used.end());
    const std::size_t equations = shape.turning ? kEquations : kTurning;
    double total = 0;
    for (std::size_t e = 0; e < equations; ++e) {
        const auto y = Eigen::Index(used.size());
        const auto reduced = [&](const Eigen::MatrixXd& product) {
            std::vector<int> with_y = used;
            with_y.push_back(static_cast<int>(width(blocks)));
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

std::vector<double> gain_beside(const Blocks& blocks, const Fit& model, const std::vector<int>& columns) {
    constexpr double kExpected = 0.1;  // squares of what a column does over those of the torque
    Used used = used_by(blocks, model.shape);
    std::vector<Eigen::Index> extra;
    for (const int c : columns) extra.push_back(place(used.column, c));
    const Coefficients c = coefficients(used, model.value, true);
    const std::size_t equations = model.shape.turning ? kEquations : kTurning;
    const Eigen::Index own = model.value.size();
    const auto more = static_cast<Eigen::Index>(extra.size());
    const Eigen::Index size = own + more * static_cast<Eigen::Index>(equations);
    std::array<Eigen::MatrixXd, kEquations> direction;
    for (std::size_t e = 0; e < equations; ++e) {
        direction[e] = Eigen::MatrixXd::Zero(c.slope[e].rows(), size);
        direction[e].leftCols(own) = c.slope[e];
        for (Eigen::Index i = 0; i < more; ++i)
            direction[e](extra[std::size_t(i)], own + Eigen::Index(e) * more + i) = 1;
    }
    struct Quadratic {
        Eigen::MatrixXd normal;
        Eigen::VectorXd gradient;
        double at(const Eigen::VectorXd& step) const {
            const auto n = step.size();
            return step.dot(normal.topLeftCorner(n, n) * step) - 2 * step.dot(gradient.head(n));
        }
    };
    std::vector<Quadratic> each;
    Quadratic all{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size)};
    for (const Block* block : blocks) {
        Quadratic q{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size)};
        for (std::size_t e = 0; e < equations; ++e) {
            const Eigen::MatrixXd weighted = picked(block->product[e], used.column) * direction[e];
            q.normal += direction[e].transpose() * weighted;
            q.gradient -= weighted.transpose() * c.value[e];
        }
        all.normal += q.normal;
        all.gradient += q.gradient;
        each.push_back(std::move(q));
    }
    // the model's own priors, about where it is
    Eigen::VectorXd prior = Eigen::VectorXd::Zero(size);
    prior.head(own) = prior_precision(used, model.shape, sum_of(blocks, used),
                                      timing_range_samples(blocks.front()->period_s));
    // a timing beyond the one that a log may have is no part of the model
    for (std::size_t i = 0; i < model.shape.amounts.size(); ++i) {
        if (model.shape.amounts[i].columns.front() == Dictionary::kTiming)
            prior(kFirstAmount + Eigen::Index(i)) = kOut;
    }
    const double torque = torque_squares(blocks, model);
    for (Eigen::Index i = own; i < size; ++i)
        prior(i) = 1e-12 + (torque > 0 ? all.normal(i, i) / (kExpected * torque) : 0.0);
    std::vector<double> gain(blocks.size());
    for (std::size_t fold = 0; fold < std::min(kFolds, blocks.size()); ++fold) {
        Quadratic rest = all;
        for (std::size_t b = fold; b < each.size(); b += kFolds) {
            rest.normal -= each[b].normal;
            rest.gradient -= each[b].gradient;
        }
        rest.normal += prior.asDiagonal();
        const Eigen::VectorXd without =
            rest.normal.topLeftCorner(own, own).ldlt().solve(rest.gradient.head(own));
        const Eigen::VectorXd with = rest.normal.ldlt().solve(rest.gradient);
        for (std::size_t b = fold; b < each.size(); b += kFolds)
            gain[b] = each[b].at(without) - each[b].at(with);
    }
    return gain;
}

double likeness(const Blocks& blocks, const Fit& base, const std::vector<Amount>& wanted,
                const std::vector<Amount>& rival) {
    // Directions in the space of columns: what `base` can do already, the rival, and what is wanted.
    ModelShape all_of_them = base.shape;
    for (const auto* more : {&rival, &wanted}) {
        all_of_them.amounts.insert(all_of_them.amounts.end(), more->begin(), more->end());
    }
    const Used used = used_by(blocks, all_of_them);
    const Products sum = sum_of(blocks, used);
    const auto more = Eigen::Index(rival.size());
    const auto goal = Eigen::Index(wanted.size());
    const Eigen::Index have = base.value.size();
    const Eigen::Index all = have + more + goal;
    Eigen::VectorXd at = Eigen::VectorXd::Zero(all);
    at.head(have) = base.value;
    const Coefficients c = coefficients(used, at, true);
    Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(all, all);
    for (std::size_t e = 0; e < (base.shape.turning ? kEquations : kTurning); ++e) {
        gram += c.slope[e].transpose() * sum[e] * c.slope[e];
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
