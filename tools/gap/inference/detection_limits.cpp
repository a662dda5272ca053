#include "tools/gap/inference/detection_limits.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "tools/gap/model/columns.hpp"
#include "tools/gap/model/directions.hpp"

namespace wheelwright::gap {
namespace {

using model::Parameters;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Standard errors. Three blocks of four choose, so theirs are larger; after Holm over the catalogue an amount
// is clear of zero from so many on; and four of five draws exceed their mean less so many.
constexpr double kOfChoosing = 1.155;
constexpr double kClearOfZero = 3.6;
constexpr double kExceeded = 0.84;
// What is of interest is asked of the blocks that choose and of all, and has to be so in both: by
// --verify-detection the share called of interest is passed four times of five from here on.
constexpr double kOfInterestTwice = 1.15;

bool in_range(std::size_t effect, const Parameters<double>& p) {
    const auto& info = model::kEffects[effect].parameters;
    for (std::size_t j = 0; j < info.size(); ++j) {
        if (!(p[j] >= info[j].minimum && p[j] <= info[j].maximum)) return false;
    }
    return true;
}

// The least amounts of one candidate beside what was found.
class Least {
  public:
    Least(const Evidence& evidence, const Members& found)
        : evidence_(evidence), found_(found), without_it_(evidence.fit(evidence.all(), found, Spread::none)) {
        for (const Candidate& candidate : found) {
            if (contains(evidence.base(), candidate.effect)) continue;
            const std::vector<Amount> its = directions(candidate);
            found_amounts_.insert(found_amounts_.end(), its.begin(), its.end());
        }
    }

    // Infinite: not in this log, or the same as something that was found.
    Eigen::VectorXd of(const Candidate& candidate) const {
        Candidate shown = candidate;  // with the amounts that the log shows
        shown.amounts.clear();
        std::vector<std::size_t> which;
        for (std::size_t k = 0; k < candidate.amounts.size(); ++k) {
            if (!shows(candidate.amounts[k])) continue;
            shown.amounts.push_back(candidate.amounts[k]);
            which.push_back(k);
        }
        Eigen::VectorXd least = Eigen::VectorXd::Constant(Eigen::Index(candidate.amounts.size()), kInfinity);
        if (which.empty()) return least;
        const Members more = with(found_, shown);
        const Fit f = evidence_.fit(evidence_.all(), more, Spread::plain);  // as the acceptance asks
        Eigen::Index at = first_amount_of(more, more.size() - 1);
        for (const std::size_t k : which) {
            const double error = kOfChoosing * f.error(at++);
            const double interest = kOfInterestTwice * least_share(more, candidate) *
                                    evidence_.set().torque_rms_Nm / std::sqrt(power(candidate.amounts[k]));
            least(Eigen::Index(k)) =
                std::max(interest + kExceeded * error, (kClearOfZero + kExceeded) * error);
        }
        return least;
    }

  private:
    double power(const Amount& amount) const {
        double sum = 0;
        for (const int a : amount.columns) {
            for (const int b : amount.columns) sum += evidence_.set().wheel_power(a, b);
        }
        return sum;
    }
    bool shows(const Amount& amount) const {
        const Blocks& blocks = evidence_.all().blocks;
        return power(amount) > 0 && likeness(blocks, without_it_, {amount}, {}) < 1 &&
               (found_amounts_.empty() ||
                likeness(blocks, evidence_.base_fit(), {amount}, found_amounts_) < kConfounded);
    }

    const Evidence& evidence_;
    const Members& found_;
    Fit without_it_;
    std::vector<Amount> found_amounts_;
};

using Sizes = std::function<std::vector<Parameters<double>>(double factor)>;

// Each coordinate alone.
Sizes of_coordinates(const Candidate& candidate, const Eigen::VectorXd& least, const Setting& setting) {
    return [=](double factor) {
        std::vector<Parameters<double>> made;
        for (Eigen::Index k = 0; k < least.size(); ++k) {
            if (!std::isfinite(least(k))) continue;
            Eigen::VectorXd one = Eigen::VectorXd::Zero(least.size());
            one(k) = factor * least(k);
            made.push_back(parameters_of(candidate, one, setting).first);
        }
        return made;
    };
}

// At a point whose amounts are sizes; what does the same as something found is not there.
Sizes of_amounts(const Candidate& candidate, Eigen::VectorXd least, const Setting& setting) {
    if (!least.array().isFinite().any()) return [](double) { return std::vector<Parameters<double>>{}; };
    least = least.array().isFinite().select(least, 0.0);
    return [=](double factor) {
        return std::vector<Parameters<double>>{parameters_of(candidate, factor * least, setting).first};
    };
}

// Of points that are sizes themselves and whose amounts are near one; `strength` is how many times they are
// what they have to be.
struct Point {
    Candidate candidate;
    double strength = 0;
};

// The weakest point that is strong enough.
Sizes of_points(std::vector<Point> points) {
    std::sort(points.begin(), points.end(),
              [](const Point& a, const Point& b) { return a.strength < b.strength; });
    return [=](double factor) {
        std::vector<Parameters<double>> made;
        const auto at_least = [&](double strength) {
            return std::find_if(points.begin(), points.end(),
                                [&](const Point& p) { return p.strength >= strength; });
        };
        const auto limit = at_least(1);
        if (limit == points.end()) return made;
        const auto weakest = at_least(factor * limit->strength);
        if (weakest != points.end()) made.push_back(weakest->candidate.at);
        return made;
    };
}

// The smallest amount that is still this effect, at the weakest point where that is enough.
Sizes near_points(const std::vector<Point>& points, const Setting& setting) {
    constexpr std::array kAmounts{0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0};
    const Candidate* best = nullptr;
    double amount = 0;
    double least = kInfinity;
    for (const Point& p : points) {
        for (const double a : kAmounts) {
            const double strength = p.strength * a;
            if (strength < 1 || strength >= least) continue;
            if (!parameters_of(p.candidate, Eigen::VectorXd::Constant(1, a), setting).second) continue;
            least = strength;
            best = &p.candidate;
            amount = a;
        }
    }
    if (best == nullptr) return [](double) { return std::vector<Parameters<double>>{}; };
    return [candidate = *best, amount, setting](double factor) {
        return std::vector<Parameters<double>>{
            parameters_of(candidate, Eigen::VectorXd::Constant(1, factor * amount), setting).first};
    };
}

bool moved_by_amounts(const Candidate& candidate, const Setting& setting) {
    const Eigen::VectorXd one = Eigen::VectorXd::Ones(Eigen::Index(candidate.amounts.size()));
    return parameters_of(candidate, one, setting).first != parameters_of(candidate, 2 * one, setting).first;
}

// Amounts may have any size, and are not near one.
bool is_size(const Candidate& candidate, const Setting& setting) {
    constexpr double kSmall = 1e-3;
    const Eigen::VectorXd small = Eigen::VectorXd::Constant(Eigen::Index(candidate.amounts.size()), kSmall);
    return parameters_of(candidate, small, setting).second;
}

}  // namespace

std::vector<Detectable> detectable(const Evidence& evidence, const Members& found) {
    const Setting& setting = evidence.dictionary().setting();
    const Least least(evidence, found);
    std::vector<Detectable> all_effects;
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        const std::vector<Candidate> all = evidence.candidates(i);
        if (all.empty() || contains(found, i)) continue;
        const Candidate& middle = all[all.size() / 2];
        if (middle.kind == Candidate::Kind::linearised) continue;  // its starting points have shown
        Detectable d;
        d.effect = i;
        d.size.assign(model::kEffects[i].parameters.size(), kInfinity);
        if (middle.kind == Candidate::Kind::linear) {
            const Candidate& candidate = all.front();
            const Eigen::VectorXd size = least.of(candidate);
            d.parameters = of_coordinates(candidate, size, setting);
            for (std::size_t k = 0; k < candidate.amounts.size(); ++k) {
                const std::size_t at = candidate.coordinate[k];
                if (model::kLinearInParameters[i]) d.size[at] = size(Eigen::Index(k));
            }
            if (candidate.together) d.size.assign(d.size.size(), size(0));
            if (!model::kLinearInParameters[i]) {  // the parameters of the coordinate that needs most
                Parameters<double> most{};
                for (const auto& p : d.parameters(1)) most = std::abs(p[0]) > std::abs(most[0]) ? p : most;
                if (most[0] != 0) d.size.assign(most.begin(), most.begin() + std::ptrdiff_t(d.size.size()));
            }
        } else {
            if (is_size(middle, setting)) {
                d.parameters = of_amounts(middle, least.of(middle), setting);
            } else {
                std::vector<Point> points;
                for (const Candidate& candidate : all)
                    points.push_back({candidate, 1 / least.of(candidate)(0)});
                d.parameters = moved_by_amounts(middle, setting) ? near_points(points, setting)
                                                                 : of_points(std::move(points));
            }
            if (const auto at = d.parameters(1); !at.empty())
                d.size.assign(at[0].begin(), at[0].begin() + std::ptrdiff_t(d.size.size()));
        }
        // no size that a robot may have would show
        const std::vector<Parameters<double>> sizes = d.parameters(1);
        if (std::any_of(sizes.begin(), sizes.end(), [&](const auto& p) { return !in_range(i, p); })) {
            d.size.assign(d.size.size(), kInfinity);
            d.parameters = nullptr;
        }
        all_effects.push_back(d);
    }
    return all_effects;
}

}  // namespace wheelwright::gap
