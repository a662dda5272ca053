#include "tools/gap/inference/estimates.hpp"

#include <algorithm>
#include <cmath>

#include "tools/gap/hypotheses/hypotheses.hpp"
#include "tools/gap/inference/statistics.hpp"

namespace wheelwright::gap {

std::vector<ParameterEstimate> estimates_of(const Candidate& candidate, const Eigen::VectorXd& amount,
                                            const Eigen::MatrixXd& cov, const Setting& setting,
                                            std::size_t blocks) {
    const auto& info = model::kEffects[candidate.effect].parameters;
    const Eigen::Index count = amount.size();
    const double quantile = interval_quantile(double(blocks));
    const auto value_at = [&](const Eigen::VectorXd& a) {
        return parameters_of(candidate, a, setting).first;
    };
    const model::Parameters<double> p = value_at(amount);
    std::vector<ParameterEstimate> estimates;
    for (std::size_t j = 0; j < info.size(); ++j) {
        Eigen::VectorXd slope(count);
        for (Eigen::Index k = 0; k < count; ++k) {
            Eigen::VectorXd moved = amount;
            const double step = 1e-4 * std::max(1e-9, std::sqrt(cov(k, k)));
            moved(k) += step;
            slope(k) = (value_at(moved)[j] - p[j]) / step;
        }
        ParameterEstimate e;
        e.value = std::clamp(p[j], info[j].minimum, info[j].maximum);
        e.standard_error = std::sqrt(std::max(0.0, slope.dot(cov * slope)));
        e.known = e.standard_error > 0;  // a direction that the log does not show moves nothing
        e.interval_95 = {p[j] - quantile * e.standard_error, p[j] + quantile * e.standard_error};
        estimates.push_back(e);
    }
    return estimates;
}

void widen(const Candidate& candidate, const Setting& setting, const std::vector<double>& unmoved,
           std::vector<ParameterEstimate>& parameters) {
    // Not moved by the amounts: known as far as the points are apart.
    constexpr double kPointsApart = 0.1;
    const Hypothesis& hypothesis = hypothesis_of(candidate.effect);
    const bool at_start = candidate.kind == Candidate::Kind::start;
    model::Parameters<double> at{};
    for (std::size_t j = 0; j < parameters.size(); ++j) at[j] = parameters[j].value;
    for (std::size_t j = 0; j < parameters.size(); ++j) {
        ParameterEstimate& p = parameters[j];
        const double usual = at_start && p.standard_error == 0 ? kPointsApart : kIntegration;
        const Uncertainty beside = hypothesis.uncertainty({j, at, setting, at_start, usual});
        double more = std::hypot(unmoved[j], beside.absolute);
        const bool open = candidate.leaves_open && j == candidate.hidden;
        if (open) more = std::hypot(more, hypothesis.starting_points(setting).likely_move[j]);
        const double quantile =
            p.standard_error > 0 ? (p.interval_95[1] - p.value) / p.standard_error : kNormalQuantile;
        p.value *= beside.scale;
        p.standard_error = std::hypot(beside.scale * p.standard_error, beside.relative * p.value, more);
        p.known = (p.known || unmoved[j] > 0) && !open;
        const double half = std::max(quantile, kNormalQuantile) * p.standard_error;
        p.interval_95 = {p.value - half, p.value + half};
    }
}

}  // namespace wheelwright::gap
