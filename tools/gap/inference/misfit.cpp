#include "tools/gap/inference/misfit.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include "tools/gap/hypotheses/hypotheses.hpp"
#include "tools/gap/inference/evidence.hpp"
#include "tools/gap/model/products.hpp"

namespace wheelwright::gap {
namespace {

// The noise's power as if it grew with the frequency by so many powers more than its colour says. From white
// noise of the speeds to white noise of the accelerations it is two: a colour between them may be off by one.
constexpr double kPowersOff = 1;

// A model with the blocks that it is fitted to: these have its columns only.
struct Posed {
    ModelShape shape;
    std::vector<Block> blocks;

    Fit fitted() const {
        Blocks all;
        for (const Block& block : blocks) all.push_back(&block);
        return fit(all, shape);
    }
};

Posed posed(const BlockSet& set, const Colour& colour, const ModelShape& shape, double powers_off) {
    std::vector<int> columns{Dictionary::kProduct, Dictionary::kTorque};
    for (const Amount& amount : shape.amounts)
        columns.insert(columns.end(), amount.columns.begin(), amount.columns.end());
    columns.insert(columns.end(), shape.fixed.begin(), shape.fixed.end());
    columns.push_back(static_cast<int>(set.wheel_power.cols()));  // what was measured
    std::sort(columns.begin(), columns.end());
    columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
    Posed made{shape, {}};
    const auto renumber = [&](std::vector<int>& some) {
        for (int& c : some)
            c = static_cast<int>(std::lower_bound(columns.begin(), columns.end(), c) - columns.begin());
    };
    for (Amount& amount : made.shape.amounts) renumber(amount.columns);
    renumber(made.shape.fixed);
    for (const Block& block : set.blocks) {
        Block& own = made.blocks.emplace_back();
        own.rows = block.rows;
        for (std::size_t e = 0; e < kEquations; ++e) {
            Eigen::MatrixXd rows = block.row[e](Eigen::all, columns);
            for (Eigen::Index k = 0; k < rows.rows(); ++k) {
                const double frequency_Hz = double(k + 1) * block.first_Hz;
                rows.row(k) /= std::sqrt(colour.power(e, frequency_Hz) * std::pow(frequency_Hz, powers_off));
            }
            own.product[e] = times_itself(rows.transpose());
        }
    }
    return made;
}

std::vector<Fit> other_fits(const BlockSet& set, const Colour& colour, const ModelShape& shape,
                            std::span<const int> shapes) {
    std::vector<Fit> fits;
    for (const double off : {kPowersOff, -kPowersOff})
        fits.push_back(posed(set, colour, shape, off).fitted());
    for (const int column : shapes) {
        ModelShape more = shape;
        more.amounts.push_back({{column}});
        fits.push_back(posed(set, colour, more, 0).fitted());
    }
    return fits;
}

// An estimate by rows that tell little of a parameter, of so many times the usual one's standard error, is
// off by chance first: it counts as far as it is off by more.
constexpr double kUnsure = 3;

Eigen::MatrixXd covariance_of(const std::vector<Fit>& others, const Fit& usual) {
    const Eigen::Index n = usual.value.size();
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(n, n);
    for (const Fit& other : others) {
        Eigen::VectorXd moved = other.value.head(n) - usual.value;
        for (Eigen::Index i = 0; i < n; ++i) {
            if (other.error(i) <= kUnsure * usual.error(i)) continue;
            const double chance = other.error(i) / moved(i);
            moved(i) *= std::sqrt(std::max(0.0, 1 - chance * chance));
        }
        covariance += moved * moved.transpose();
    }
    return covariance;
}

}  // namespace

Eigen::MatrixXd misfit_covariance(const BlockSet& set, const Colour& colour, const Fit& found,
                                  std::span<const int> shapes, std::span<const Amount> frictions) {
    const Fit usual = posed(set, colour, found.shape, 0).fitted();
    std::vector<Fit> others = other_fits(set, colour, found.shape, shapes);
    for (const Amount& friction : frictions) {
        ModelShape more = found.shape;
        more.amounts.push_back(friction);
        Fit beside = posed(set, colour, more, 0).fitted();
        if (beside.value(usual.value.size()) > 0) others.push_back(std::move(beside));
    }
    return covariance_of(others, usual);
}

std::optional<std::size_t> unsure_by_misfit(const Search& found, const Setting& setting, const BlockSet& set,
                                            const Colour& colour, std::span<const int> shapes,
                                            std::span<const std::size_t> doubted) {
    constexpr double kMost = kPolicy.false_alarm / double(model::kEffectCount);
    double most = 0;
    std::optional<std::size_t> least_sure;
    Eigen::Index at = kFirstAmount + 1;  // after the timing
    for (std::size_t i = 0; i < found.members.size(); ++i) {
        const Candidate& candidate = found.members[i];
        const auto first = at;
        const auto had = static_cast<std::ptrdiff_t>(candidate.amounts.size());
        at += had;
        if (i < found.base_members || !found.may_be_denied(candidate.effect) ||
            is_usual_friction(candidate.effect))
            continue;
        // one at a point is taken as a whole for it
        const std::vector<Amount> whole = directions(candidate);
        ModelShape shape = found.after.shape;
        const auto begin = shape.amounts.begin() + (first - kFirstAmount);
        shape.amounts.insert(shape.amounts.erase(begin, begin + had), whole.begin(), whole.end());
        for (const int c : candidate.fixed)
            shape.fixed.erase(std::find(shape.fixed.begin(), shape.fixed.end(), c));
        const auto n = static_cast<Eigen::Index>(whole.size());
        const double degrees = std::max(1.0, double(set.blocks.size()) - 4 - double(n));
        const auto probability_of = [&](const Fit& f, const Eigen::MatrixXd& covariance) {
            return probability_of_none(candidate, f.value.segment(first, n),
                                       covariance.block(first, first, n, n), degrees, setting);
        };
        const Fit usual = fit(pointers(set), shape);
        const std::vector<Fit> others = other_fits(set, colour, shape, shapes);
        const double probability = probability_of(usual, usual.covariance + covariance_of(others, usual));
        const bool in_all = std::all_of(others.begin(), others.end(), [&](const Fit& other) {
            return other.value.segment(first, n).dot(usual.value.segment(first, n)) > 0 &&
                   probability_of(other, other.covariance) <= kMost;
        });
        const bool sure = !(probability > kMost);
        const bool is_doubted = std::find(doubted.begin(), doubted.end(), candidate.effect) != doubted.end();
        if ((is_doubted ? sure && in_all : sure || in_all || hypothesis_of(candidate.effect).dry) ||
            probability < most)
            continue;
        most = probability;
        least_sure = candidate.effect;
    }
    return least_sure;
}

}  // namespace wheelwright::gap
