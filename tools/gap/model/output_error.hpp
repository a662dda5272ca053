// Refinement by output error: the parameters with which free runs over pieces of the measured logs miss the
// measured wheel speeds least. Each piece starts from speeds of its own, which are fitted too (multiple
// shooting), so noise in the measured speeds stands in no regressor; Levenberg-Marquardt, from the weak
// form's fit on. Costs some hundred simulations of the logs' length.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "tools/gap/model/fit.hpp"
#include "tools/gap/model/free_run.hpp"

namespace wheelwright::gap {

// The parts in pieces of about `length_s`, without samples that cannot be used.
std::vector<Stretch> stretches(std::span<const LogPart> parts, double length_s,
                               const model::Geometry<double>& geometry);

struct Refined {
    Fit fit;                // values, and a covariance from the spread between the pieces
    double weak_rad_per_s;  // RMS over the pieces with the fit given
    double rad_per_s;       // and with this one
};

// None where the fit given misses by less than `small_rad_per_s`, where the free run is not better by a
// tenth, or where there is nothing to run.
std::optional<Refined> refine_by_free_run(const Fit& weak, std::span<const Stretch> pieces,
                                          double small_rad_per_s,
                                          const std::function<SimulatedRobot(const Fit&)>& robot_of);

}  // namespace wheelwright::gap
