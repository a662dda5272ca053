#include "tools/gap/gap_errors.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "tools/gap/gap_points.hpp"
#include "tools/gap/gap_statistics.hpp"

namespace wheelwright::gap {

std::vector<ParameterEstimate> estimates_of(const Way& way, const Eigen::VectorXd& amount,
                                            const Eigen::MatrixXd& cov, const Setting& setting,
                                            std::size_t blocks) {
    const auto& info = model::kEffects[way.effect].parameters;
    const Eigen::Index count = amount.size();
    const double quantile = interval_quantile(double(blocks));
    const auto value_at = [&](const Eigen::VectorXd& a) { return parameters_of(way, a, setting).first; };
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

void widen(const Way& way, const Setting& setting, const std::vector<double>& unmoved,
           std::vector<ParameterEstimate>& parameters) {
    // Two programs that integrate the same robot agree no better.
    constexpr double kIntegration = 0.002;
    // Gravity and the acceleration of what has an offset act on the mass, K7 tells of the mass with the
    // wheels' rotation. A slope knows of it, the others' columns do not.
    constexpr double kBodysShare = 1 - model::kRotationShare;
    // Not moved by the amounts: known as far as the points are apart.
    constexpr double kPointsApart = 0.1;
    // Headings that two programs add up from the same wheel speeds.
    constexpr double kDirection_rad = 0.02;
    // A castor's own inertia and the give of its contact, which the model leaves out; friction of the
    // pivot is seen beside the moment of the wheel's. By how much, development logs of a robot that has both
    // (wheelwright gap-trials) say, and so for directions and products.
    constexpr std::array kCastor{0.01, 0.15, 0.02, 0.04};
    constexpr double kPivotOfWheel = 0.1;
    // Told by a product of the two.
    constexpr double kProductOnly = 0.7;
    const std::string_view name = model::kEffects[way.effect].name;
    for (std::size_t j = 0; j < parameters.size(); ++j) {
        ParameterEstimate& p = parameters[j];
        double unsure = kIntegration;
        double scale = 1;
        const bool with_mass =
            (name == "slope" || name == "cog_lateral" || name == "wheel_radius_mismatch") && j == 0;
        if (with_mass) {
            if (name != "slope") scale = 1 / kBodysShare;
            unsure = std::hypot(unsure, model::kRotationShareError / kBodysShare);
        }
        if (way.kind == Way::Kind::grid && p.standard_error == 0 && name != "torque_ripple") {
            unsure = kPointsApart;
        }
        if (name == "backlash" || name == "wheel_slip") unsure = kProductOnly;
        if (name == "payload_step" && j == 0) {
            const double spacing_s =
                way.kind == Way::Kind::grid ? kEventSpacing * setting.span_s : setting.event_spacing_s;
            unsure = std::max(spacing_s, setting.period_s) / p.value;
        }
        double more = unmoved[j];
        if ((name == "slope" && j == 1) || (name == "torque_ripple" && j >= 2)) {
            more = std::hypot(more, kDirection_rad);
        }
        if (name == "castor_drag") {
            unsure = std::hypot(unsure, kCastor[j]);
            if (j == 1) more = std::hypot(more, kPivotOfWheel * parameters[0].value * parameters[3].value);
        }
        const bool open = way.leaves_open && j == way.hidden;
        if (open) more = std::hypot(more, grid_of(way.effect, setting).likely_move[j]);
        const double quantile =
            p.standard_error > 0 ? (p.interval_95[1] - p.value) / p.standard_error : kNormalQuantile;
        p.value *= scale;
        p.standard_error = std::hypot(scale * p.standard_error, unsure * p.value, more);
        p.known = (p.known || unmoved[j] > 0) && !open;
        const double half = std::max(quantile, kNormalQuantile) * p.standard_error;
        p.interval_95 = {p.value - half, p.value + half};
    }
}

}  // namespace wheelwright::gap
