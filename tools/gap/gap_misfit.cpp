#include "tools/gap/gap_misfit.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "tools/gap/gap_evidence.hpp"
#include "tools/gap/gap_statistics.hpp"
#include "tools/gap/products.hpp"

namespace wheelwright::gap {
namespace {

// The noise's power as if it grew with the frequency by so many powers more than its colour says. From white
// noise of the speeds to white noise of the accelerations it is two: a colour between them may be off by one.
constexpr double kPowersOff = 1;

// What comes late by another law than a lag's or a delay's has another size at each frequency, and is late.
constexpr std::array kLate{model::find_effect("actuator_lag"), model::find_effect("transport_delay"),
                           model::find_effect("measurement_lag")};

bool is_among(std::span<const std::size_t> effects, std::size_t effect) {
    return std::find(effects.begin(), effects.end(), effect) != effects.end();
}

// All blocks as one, of the columns that a model has.
Block whole(const BlockSet& set, const Colour& colour, const ModelShape& shape, double powers_off) {
    const Eigen::Index y = set.wheel_power.cols();
    std::vector<int> columns{Dictionary::kProduct, Dictionary::kTorque};
    for (const Amount& amount : shape.amounts)
        columns.insert(columns.end(), amount.columns.begin(), amount.columns.end());
    columns.insert(columns.end(), shape.fixed.begin(), shape.fixed.end());
    columns.push_back(static_cast<int>(y));
    std::sort(columns.begin(), columns.end());
    columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
    Block sum;
    for (std::size_t e = 0; e < kEquations; ++e) {
        sum.product[e] = Eigen::MatrixXd::Zero(y + 1, y + 1);
        for (const Block& block : set.blocks) {
            Eigen::MatrixXd rows = block.row[e](Eigen::all, columns);
            for (Eigen::Index k = 0; k < rows.rows(); ++k) {
                const double frequency_Hz = double(k + 1) * block.first_Hz;
                rows.row(k) /= std::sqrt(colour.power(e, frequency_Hz) * std::pow(frequency_Hz, powers_off));
            }
            sum.product[e](columns, columns) += times_itself(rows.transpose());
            sum.rows[e] += block.rows[e];
        }
    }
    sum.period_s = set.blocks.front().period_s;
    return sum;
}

}  // namespace

Eigen::MatrixXd misfit_covariance(const BlockSet& set, const Colour& colour, const Fit& found,
                                  std::span<const int> shapes) {
    const auto estimate = [&](const ModelShape& shape, double powers_off) {
        const Block block = whole(set, colour, shape, powers_off);
        return Eigen::VectorXd(fit({&block}, shape, Spread::left_out).value.head(found.value.size()));
    };
    const Eigen::VectorXd usual = estimate(found.shape, 0);
    std::vector<Eigen::VectorXd> others{estimate(found.shape, kPowersOff),
                                        estimate(found.shape, -kPowersOff)};
    for (const int column : shapes) {
        ModelShape more = found.shape;
        more.amounts.push_back({{column}});
        others.push_back(estimate(more, 0));
    }
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(usual.size(), usual.size());
    for (const Eigen::VectorXd& other : others) covariance += (other - usual) * (other - usual).transpose();
    return covariance;
}

std::optional<std::size_t> unsure_by_misfit(const Search& found, const BlockSet& set, const Colour& colour,
                                            std::span<const int> shapes) {
    double most = kSignificance / double(model::kEffectCount);
    std::optional<std::size_t> least_sure;
    Eigen::Index at = kFirstAmount + 1;  // after the timing
    for (std::size_t i = 0; i < found.members.size(); ++i) {
        const Way& way = found.members[i];
        const auto first = at;
        const auto had = static_cast<std::ptrdiff_t>(way.amounts.size());
        at += had;
        if (i < found.base_members || is_among(kFrictions, way.effect) || is_among(kLate, way.effect))
            continue;
        // one at a point is taken as a whole for it
        const std::vector<Amount> whole = directions(way);
        ModelShape shape = found.after.shape;
        const auto begin = shape.amounts.begin() + (first - kFirstAmount);
        shape.amounts.insert(shape.amounts.erase(begin, begin + had), whole.begin(), whole.end());
        for (const int c : way.fixed) shape.fixed.erase(std::find(shape.fixed.begin(), shape.fixed.end(), c));
        const Fit f = fit(pointers(set), shape);
        const Eigen::MatrixXd covariance = f.covariance + misfit_covariance(set, colour, f, shapes);
        const auto n = static_cast<Eigen::Index>(whole.size());
        const double degrees = std::max(1.0, double(set.blocks.size()) - 4 - double(n));
        const double probability =
            wald_probability(f.value.segment(first, n), covariance.block(first, first, n, n), degrees);
        if (!(probability > most)) continue;
        most = probability;
        least_sure = way.effect;
    }
    return least_sure;
}

}  // namespace wheelwright::gap
