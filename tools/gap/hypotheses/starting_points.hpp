// At which values of its nonlinear parameters an effect is tried first, and what a fit with the columns there
// says of its parameters.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <vector>

#include "tools/gap/hypotheses/contribution.hpp"

namespace wheelwright::gap {

// How far apart the starting points of the time of an event are, as a share of the log.
inline constexpr double kEventSpacing = 1 / 18.0;

// Points at which an effect is tried; none for one that is linear.
struct StartingPoints {
    std::vector<Parameters<double>> points;
    // At a point: parameters whose contributions are the columns; what the point's amounts multiply.
    std::function<std::vector<Parameters<double>>(const Parameters<double>&)> units;
    std::function<Parameters<double>(const Parameters<double>&, const Eigen::VectorXd&)> parameters;
    std::function<bool(const Eigen::VectorXd&)> plausible;
    std::array<double, model::kMaxEffectParameters>
        step{};  // for slopes where linearised; 0: this one is not free
    // Linearised: a change of what is no parameter of the effect, but unknown too, and how many of it may be
    // expected; 0: nothing is.
    Parameters<double> beside{};
    double expected = 0;
    // The parameter that a log may not show: at a point one amount stands for all then, linearised it stays.
    std::size_t hidden = model::kMaxEffectParameters;
    // What a log does not show stays near: the size that a point's amounts may be expected to have, and how
    // far from where it was linearised each parameter may be; 0: nothing is known.
    double likely_amount = 0;
    std::array<double, model::kMaxEffectParameters> likely_move{};
    // Foci around what was found, that itself last: for a parameter that slopes are too short-sighted for.
    std::function<std::vector<Parameters<double>>(const Parameters<double>&)> closer = {};
    // Linearised: still this effect, and not the special case of it that another one is.
    std::function<bool(const Parameters<double>&)> itself = [](const Parameters<double>&) { return true; };
    // The parameter whose 0 is a case by itself: no slope is taken there.
    std::size_t apart_at_zero = model::kMaxEffectParameters;
};

// What many of them have in common. The columns are of the point alone; its parameters stay, or the one
// parameter grows with the amount.
inline std::vector<Parameters<double>> alone(const Parameters<double>& at) { return {at}; }
inline Parameters<double> scaled(const Parameters<double>& at, const Eigen::VectorXd& a) {
    return {at[0] * a(0)};
}
// Foci beside what was found, that itself last: `beside(at, amount)` with amounts about one, closer to it
// from one evaluation to the next. For what has a corner, or minima beside the right one: no slope leads
// over.
template <typename Beside>
void look_beside(StartingPoints& from, const Setting& s, Beside beside) {
    constexpr double kCloserBy = 4, kNear = 0.01;
    if (s.refinements == 0) return;
    const double spread = std::pow(kCloserBy, -s.refinements);
    from.closer = [spread, beside](const Parameters<double>& at) {
        std::vector<Parameters<double>> points;
        if (spread > kNear) {
            for (const double amount : {1 - spread, 1 + spread}) points.push_back(beside(at, amount));
        }
        points.push_back(at);
        return points;
    };
}
inline void look_beside(StartingPoints& from, const Setting& s) {
    look_beside(from, s, [parameters = from.parameters](const Parameters<double>& at, double amount) {
        return parameters(at, Eigen::VectorXd::Constant(1, amount));
    });
}
// Amounts that are still this point's, and not another's.
inline bool any_size(const Eigen::VectorXd&) { return true; }
// NOLINTBEGIN(readability-magic-numbers)
inline bool near_one(const Eigen::VectorXd& a) { return a(0) > 0.45 && a(0) < 2.2; }
inline bool roughly_one(const Eigen::VectorXd& a) { return a(0) > 0.2 && a(0) < 4; }
// NOLINTEND(readability-magic-numbers)

}  // namespace wheelwright::gap
