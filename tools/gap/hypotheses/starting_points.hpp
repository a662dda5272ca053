// At which values of its nonlinear parameters an effect is tried, and what a fit with the columns there says
// of its parameters.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <functional>
#include <vector>

#include "tools/gap/hypotheses/contribution.hpp"

namespace wheelwright::gap {

// How far apart the first look tries the time of an event, as a share of the log.
inline constexpr double kEventSpacing = 1 / 18.0;

// Points at which an effect is tried; none for one that is linear.
struct Grid {
    std::vector<model::Parameters<double>> points;
    // At a point: parameters whose contributions are the columns; what the point's amounts multiply.
    std::function<std::vector<model::Parameters<double>>(const model::Parameters<double>&)> units;
    std::function<model::Parameters<double>(const model::Parameters<double>&, const Eigen::VectorXd&)>
        parameters;
    std::function<bool(const Eigen::VectorXd&)> plausible;
    std::array<double, model::kMaxEffectParameters> step{};  // for slopes at a focus; 0: this one is not free
    // At a focus: a change of what is no parameter of the effect, but unknown too, and how many of it may be
    // expected; 0: nothing is.
    model::Parameters<double> beside{};
    double expected = 0;
    // The parameter that a log may not show: at a point one amount stands for all then, at a focus it stays.
    std::size_t hidden = model::kMaxEffectParameters;
    // What a log does not show stays near: the size that a point's amounts may be expected to have, and how
    // far from a focus each parameter may be; 0: nothing is known.
    double likely_amount = 0;
    std::array<double, model::kMaxEffectParameters> likely_move{};
    // Foci around what was found, that itself last: for a parameter that slopes are too short-sighted for.
    std::function<std::vector<model::Parameters<double>>(const model::Parameters<double>&)> closer = {};
    // At a focus: still this effect, and not the special case of it that another one is.
    std::function<bool(const model::Parameters<double>&)> itself = [](const model::Parameters<double>&) {
        return true;
    };
    // The parameter whose 0 is a case by itself: no slope is taken there.
    std::size_t apart_at_zero = model::kMaxEffectParameters;
};

Grid grid_of(std::size_t effect, const Setting& setting);

}  // namespace wheelwright::gap
