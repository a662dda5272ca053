#include "tools/gap/model/fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace wheelwright::gap {
namespace {

constexpr Eigen::Index kK5 = product_of(kLinear), kK6 = product_of(kTurning);
constexpr Eigen::Index kK7 = gain_of(kLinear), kK8 = gain_of(kTurning);
constexpr int kIterations = 8;
constexpr double kOut = 1e20;

Eigen::Index measured_column(const Blocks& blocks) {
    return blocks.empty() ? 0 : blocks.front()->product[kLinear].rows() - 1;
}

using Products = std::array<Eigen::MatrixXd, kEquations>;  // by direction
using Tangents = std::array<Tangent, kEquations>;

Products sum_of(const Blocks& blocks, const Directions& directions) {
    return {by_direction(blocks, kLinear, directions), by_direction(blocks, kTurning, directions)};
}

Tangents tangents(const Directions& directions) {
    return {Tangent(directions, kLinear), Tangent(directions, kTurning)};
}

// The rows of a fit's equations, in its columns.
std::array<Combination, kEquations> rows_of(const Fit& fit, Eigen::Index measured) {
    const Directions directions(fit.shape, measured);
    std::array<Combination, kEquations> rows;
    for (std::size_t e = 0; e < fit.shape.equations(); ++e) {
        Tangent tangent(directions, e);
        tangent.move(fit.value);
        rows[e] = directions.combination(tangent.row());
    }
    return rows;
}

// What nothing tells stays near zero: variances of priors, so wide that no log
// notices them.
Eigen::VectorXd prior_precision(const Blocks& blocks, const ModelShape& shape, const Directions& directions,
                                const Products& sum) {
    Eigen::VectorXd precision(kFirstAmount + Eigen::Index(shape.amounts.size()));
    precision(kK5) = 1 / (0.5 * 0.5);
    precision(kK6) = 1 / (50.0 * 50.0);
    precision(kK7) = precision(kK8) = 1e-9;
    const double torque = sum[kLinear](Directions::kTorque, Directions::kTorque) +
                          sum[kTurning](Directions::kTorque, Directions::kTorque);
    for (Eigen::Index i = 0; i < directions.amounts(); ++i) {
        const Amount& amount = shape.amounts[std::size_t(i)];
        if (amount.columns.front() == Dictionary::kTiming) {
            precision(kFirstAmount + i) = 1 / (kTimingRange_samples * kTimingRange_samples);
            continue;
        }
        if (amount.expected > 0) {
            precision(kFirstAmount + i) = std::pow(amount.expected, -2);
            continue;
        }
        // ten times the torque that was commanded
        double column = 0;
        for (const Block* block : blocks) {
            for (const Eigen::MatrixXd& product : block->product) column += directions.power(product, i);
        }
        precision(kFirstAmount + i) = 1e-9 + (torque > 0 ? 1e-2 * column / torque : 0.0);
    }
    return precision;
}

// Each equation by itself is linear in its coefficients: with them the
// iteration starts near its end.
Eigen::VectorXd start(const Products& sum, const ModelShape& shape, const Directions& directions) {
    const Eigen::Index count = directions.amounts();
    Eigen::VectorXd p = Eigen::VectorXd::Zero(kFirstAmount + count);
    Eigen::VectorXd weight = Eigen::VectorXd::Zero(count);
    constexpr Eigen::Index kTorque = Directions::kTorque;
    const Eigen::Index fixed = directions.fixed();
    for (std::size_t e = 0; e < shape.equations(); ++e) {
        // what is fixed goes with the torque
        Eigen::MatrixXd normal = sum[e].topLeftCorner(fixed, fixed);
        Eigen::VectorXd seen = sum[e].col(directions.y()).head(fixed);
        normal.col(kTorque) += sum[e].col(fixed).head(fixed);
        normal.row(kTorque) = normal.col(kTorque).transpose();
        normal(kTorque, kTorque) += sum[e](kTorque, fixed) + sum[e](fixed, fixed);
        seen(kTorque) += sum[e](fixed, directions.y());
        const Eigen::VectorXd own = normal.diagonal();
        // what the torque itself tells is not put into an amount: each equation would share it out
        // differently
        for (Eigen::Index i = 0; i < fixed; ++i)
            normal(i, i) += (i < Directions::kAmounts ? 1e-7 : 1e-3) * own(i) + 1e-12;
        const Eigen::VectorXd c = normal.ldlt().solve(seen);
        const double gain = c(kTorque);
        p(product_of(e)) = c(Directions::kProduct);
        p(gain_of(e)) = gain;
        if (!(gain > 0)) continue;
        for (Eigen::Index i = 0; i < count; ++i) {
            const double w = gain * gain * own(Directions::kAmounts + i);
            p(kFirstAmount + i) += w * c(Directions::kAmounts + i) / gain;
            weight(i) += w;
        }
    }
    for (Eigen::Index i = 0; i < count; ++i) {
        if (weight(i) > 0) p(kFirstAmount + i) /= weight(i);
    }
    return p;
}

// Covariance from the blocks' scores, as they are or each set right for what it has pulled the fit to itself:
// "CR2" of Bell and McCaffrey, Survey Methodology 28 (2002), in coordinates in which the normal matrix is
// one. Then also Fit::telling: Satterthwaite's number, which Bell and McCaffrey take for the degrees of
// freedom.
Eigen::MatrixXd covariance_of_blocks(const Blocks& blocks, const Directions& directions, Tangents& tangent,
                                     const Eigen::MatrixXd& normal, std::size_t equations, bool set_right,
                                     Eigen::VectorXd& telling) {
    constexpr double kAlone = 1e-3;  // share of what is known of a direction that the others must tell
    const Eigen::VectorXd scale = normal.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::LLT<Eigen::MatrixXd> root(scale.asDiagonal() * normal * scale.asDiagonal());
    const auto size = normal.rows();
    const Eigen::MatrixXd out = root.matrixU().solve(Eigen::MatrixXd::Identity(size, size));
    const Eigen::MatrixXd each = out.rowwise().normalized();  // value's direction
    Eigen::VectorXd shares = Eigen::VectorXd::Zero(size);
    Eigen::MatrixXd meat = Eigen::MatrixXd::Zero(size, size);
    for (const Block* block : blocks) {
        Eigen::VectorXd score = Eigen::VectorXd::Zero(size);
        Eigen::MatrixXd own = Eigen::MatrixXd::Zero(size, size);
        for (std::size_t e = 0; e < equations; ++e)
            tangent[e].add(by_direction(block->product[e], directions), own, score);
        own.triangularView<Eigen::StrictlyUpper>() = own.transpose();
        score = root.matrixL().solve(scale.cwiseProduct(score));
        if (!set_right) {
            const double n = double(blocks.size());
            meat += (n > 2 ? n / (n - 1) : 2.0) * score * score.transpose();
            continue;
        }
        own = root.matrixL().solve(scale.asDiagonal() * own * scale.asDiagonal());
        own = root.matrixL().solve(own.transpose()).eval();
        shares += (each * own).cwiseProduct(each).rowwise().sum().cwiseAbs2();
        const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> parts(own);
        const Eigen::VectorXd others = (1 - parts.eigenvalues().array()).max(kAlone).rsqrt();
        const Eigen::VectorXd right =
            parts.eigenvectors() * others.cwiseProduct(parts.eigenvectors().transpose() * score);
        meat += right * right.transpose();
    }
    if (set_right) telling = shares.cwiseMax(1e-12).cwiseInverse();
    return scale.asDiagonal() * (out * meat * out.transpose()) * scale.asDiagonal();
}

}  // namespace

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
    const Directions directions(shape, measured_column(blocks));
    const Products sum = sum_of(blocks, directions);
    const std::size_t equations = shape.equations();
    const Eigen::Index size = kFirstAmount + directions.amounts();
    Eigen::VectorXd& p = result.value;
    p = start(sum, shape, directions);
    Eigen::VectorXd prior = prior_precision(blocks, shape, directions, sum);
    if (!shape.turning) prior(kK5) = kOut;  // a yaw rate that is noise alone tells nothing of it
    Eigen::VectorXd centre = Eigen::VectorXd::Zero(size);
    for (std::size_t e = 0; e < equations; ++e) {
        if (!shape.held_gain[e]) continue;
        p(gain_of(e)) = centre(gain_of(e)) = *shape.held_gain[e];
        prior(gain_of(e)) = kOut;
    }
    Eigen::MatrixXd normal(size, size);
    Eigen::VectorXd gradient(size);
    Eigen::LDLT<Eigen::MatrixXd> solver(size);
    Tangents tangent = tangents(directions);
    const auto squares_at = [&](const Eigen::VectorXd& at) {
        double total = 0;
        for (std::size_t e = 0; e < equations; ++e) {
            tangent[e].move(at);
            total += tangent[e].squares(sum[e]);
        }
        return total;
    };
    const auto missed = [&](const Eigen::VectorXd& at) {
        return prior.dot((at - centre).cwiseAbs2()) + squares_at(at);
    };
    constexpr double kSettled = 1e-6;  // of a variance of the noise
    // K8 times a bias tells neither where no torque turns the robot: whole steps may lead away for good, and
    // so do halved ones get there slowly. So whole ones first.
    const auto iterate = [&](int halvings) {
        Eigen::VectorXd best = p;
        double now = missed(p);
        double least = now;
        for (int iteration = 0; iteration < kIterations; ++iteration) {
            const double before = now;
            normal = prior.asDiagonal();
            gradient = prior.cwiseProduct(centre - p);
            for (std::size_t e = 0; e < equations; ++e) {
                tangent[e].move(p);
                tangent[e].add(sum[e], normal, gradient);
            }
            solver.compute(normal);
            Eigen::VectorXd step = solver.solve(gradient);
            const Eigen::VectorXd from = p;
            p += step;
            now = missed(p);
            for (int half = 0; half < halvings && !(now <= before); ++half) {
                step /= 2;
                p = from + step;
                now = missed(p);
            }
            bool held = false;
            for (std::size_t i = 0; i < shape.amounts.size(); ++i) {
                const Eigen::Index at = kFirstAmount + Eigen::Index(i);
                if (shape.amounts[i].columns.front() != Dictionary::kTiming ||
                    std::abs(p(at)) <= kTimingRange_samples)
                    continue;
                centre(at) = p(at) = std::copysign(kTimingRange_samples, p(at));
                held = held || prior(at) != kOut;
                prior(at) = kOut;
            }
            if (held) least = now = missed(p);
            if (held || now < least) {
                least = now;
                best = p;
            }
            if (!held && std::abs(before - now) < kSettled * (1 + kSettled * before)) return true;
        }
        p = best;
        return false;
    };
    constexpr int kHalvings = 12;
    if (!iterate(0)) iterate(kHalvings);
    result.squares = squares_at(p);
    result.rows = row_count(blocks, shape);
    if (spread == Spread::none) return result;
    const bool plain = spread == Spread::plain;
    result.covariance =
        covariance_of_blocks(blocks, directions, tangent, normal, equations, !plain, result.telling);
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

std::array<double, kEquations> largest_fold_shares(const Blocks& blocks, const Fit& fit) {
    const Directions directions(fit.shape, measured_column(blocks));
    Tangents tangent = tangents(directions);
    const Eigen::Index size = fit.value.size();
    std::vector<Eigen::MatrixXd> each;
    Eigen::MatrixXd all = Eigen::MatrixXd::Zero(size, size);
    for (Tangent& t : tangent) t.move(fit.value);
    for (const Block* block : blocks) {
        Eigen::MatrixXd own = Eigen::MatrixXd::Zero(size, size);
        Eigen::VectorXd gradient = Eigen::VectorXd::Zero(size);
        for (std::size_t e = 0; e < fit.shape.equations(); ++e)
            tangent[e].add(by_direction(block->product[e], directions), own, gradient);
        own.triangularView<Eigen::StrictlyUpper>() = own.transpose();
        all += own;
        each.push_back(std::move(own));
    }
    all.diagonal() *= 1 + 1e-9;
    all.diagonal().array() += 1e-12;
    std::array<double, kEquations> most{};
    for (std::size_t e = 0; e < fit.shape.equations(); ++e) {
        const Eigen::VectorXd gain = all.ldlt().solve(Eigen::VectorXd::Unit(size, gain_of(e)));
        for (std::size_t fold = 0; fold < std::min(kFolds, each.size()); ++fold) {
            double own = 0;
            for (std::size_t b = fold; b < each.size(); b += kFolds) own += gain.dot(each[b] * gain);
            most[e] = std::max(most[e], own / gain(gain_of(e)));
        }
    }
    return most;
}

double squares(const Block& block, const Fit& fit) { return squares(Blocks{&block}, fit); }

double squares(const Blocks& blocks, const Fit& fit) {
    const auto rows = rows_of(fit, measured_column(blocks));
    double total = 0;
    for (const Block* block : blocks) {
        for (std::size_t e = 0; e < fit.shape.equations(); ++e) total += rows[e].squares(block->product[e]);
    }
    return total;
}

double squares_apart(const Block& block, const Fit& a, const Fit& b) {
    const Eigen::Index measured = measured_column({&block});
    auto difference = rows_of(a, measured);
    const auto other = rows_of(b, measured);
    double total = 0;
    for (std::size_t e = 0; e < a.shape.equations(); ++e) {
        // what was measured is in both, and goes out
        Combination& d = difference[e];
        d.column.insert(d.column.end(), other[e].column.begin(), other[e].column.end());
        for (const double w : other[e].weight) d.weight.push_back(-w);
        total += d.squares(block.product[e]);
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

BeyondNoise beyond_noise(const Blocks& blocks, const Fit& fit) {
    const auto rows = rows_of(fit, measured_column(blocks));
    BeyondNoise left;
    for (const Block* block : blocks) {
        double& squares = left.squares.emplace_back(0);
        for (std::size_t e = 0; e < fit.shape.equations(); ++e) {
            const Eigen::Map<const Eigen::VectorXd> weight(rows[e].weight.data(),
                                                           Eigen::Index(rows[e].weight.size()));
            squares += (block->row[e](Eigen::all, rows[e].column) * weight).squaredNorm() - block->rows[e];
            const double gain = fit.value(gain_of(e));
            left.torque_squares += gain * gain * block->row[e].col(Dictionary::kTorque).squaredNorm();
        }
    }
    return left;
}

double BeyondNoise::share_of_torque() const {
    const double all = std::accumulate(squares.begin(), squares.end(), 0.0);
    return torque_squares > 0 ? std::sqrt(std::max(0.0, all) / torque_squares) : 0.0;
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
    const std::size_t equations = shape.equations();
    double total = 0;
    for (std::size_t e = 0; e < equations; ++e) {
        const auto y = Eigen::Index(used.size());
        const auto reduced = [&](const Eigen::MatrixXd& product) {
            std::vector<int> with_y = used;
            with_y.push_back(static_cast<int>(measured_column(blocks)));
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
            for (std::size_t b = fold; b < each.size(); b += kFolds) total += c.dot(each[b] * c);
        }
    }
    return total;
}

std::vector<double> gain_beside(const Blocks& blocks, const Fit& model, const std::vector<int>& columns) {
    constexpr double kExpected = 0.1;  // squares of what a column does over those of the torque
    const Directions directions(model.shape, measured_column(blocks), columns);
    Tangents tangent = tangents(directions);
    for (Tangent& t : tangent) t.move(model.value);
    const std::size_t equations = model.shape.equations();
    const Eigen::Index own = model.value.size();
    const auto more = static_cast<Eigen::Index>(columns.size());
    const Eigen::Index size = own + more * static_cast<Eigen::Index>(equations);
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
            tangent[e].add_with_more(by_direction(block->product[e], directions),
                                     own + Eigen::Index(e) * more, q.normal, q.gradient);
        }
        q.normal.triangularView<Eigen::StrictlyUpper>() = q.normal.transpose();
        all.normal += q.normal;
        all.gradient += q.gradient;
        each.push_back(std::move(q));
    }
    // the model's own priors, about where it is
    Eigen::VectorXd prior = Eigen::VectorXd::Zero(size);
    prior.head(own) = prior_precision(blocks, model.shape, directions, sum_of(blocks, directions));
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
    const Directions directions(all_of_them, measured_column(blocks));
    const auto more = Eigen::Index(rival.size());
    const auto goal = Eigen::Index(wanted.size());
    const Eigen::Index have = base.value.size();
    const Eigen::Index all = have + more + goal;
    Eigen::VectorXd at = Eigen::VectorXd::Zero(all);
    at.head(have) = base.value;
    Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(all, all);
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(all);
    for (std::size_t e = 0; e < base.shape.equations(); ++e) {
        Tangent tangent(directions, e);
        tangent.move(at);
        tangent.add(by_direction(blocks, e, directions), gram, gradient);
    }
    gram.triangularView<Eigen::StrictlyUpper>() = gram.transpose();
    // what of it is in the log is no more than roundings: an inertia's, where nothing turns
    constexpr double kRoundings = 1e-20;
    const double torque = at(kK7) * at(kK7) * gram(kK7, kK7) + at(kK8) * at(kK8) * gram(kK8, kK8);
    if (!(gram.diagonal().tail(goal).sum() > kRoundings * torque)) return 1.0;
    const auto unexplained = [&](Eigen::Index known) {
        Eigen::MatrixXd inner = gram.topLeftCorner(known, known);
        for (Eigen::Index i = 0; i < known; ++i) inner(i, i) += 1e-9 * inner(i, i) + 1e-12;
        const Eigen::MatrixXd cross = gram.block(0, have + more, known, goal);
        const Eigen::MatrixXd rest =
            gram.block(have + more, have + more, goal, goal) - cross.transpose() * inner.ldlt().solve(cross);
        return rest.trace();
    };
    const double before = unexplained(have);
    return before > 0 ? 1 - std::max(0.0, unexplained(have + more)) / before : 1.0;
}

}  // namespace wheelwright::gap
