// How far what a model cannot be moves its estimates. Of a right model, any weighting of the rows finds the
// same, and so it does beside a shape that is not there. Where the friction is by another law, the sensors
// are late or something is missing, they differ, and by as much nobody knows the parameters, however little
// the pieces of the log disagree.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <span>

#include "tools/gap/inference/search.hpp"
#include "tools/gap/model/rows.hpp"

namespace wheelwright::gap {

// The covariance that it makes beside the spread between blocks: the sum over the other estimates of the
// square of what they differ by. `shapes`: columns that are free, each for itself, in one of them. So are
// `frictions` that are not in the fit, too small to be of interest, if they brake. The blocks are those that
// `fit` was fitted to.
Eigen::MatrixXd misfit_covariance(const BlockSet& set, const Colour& colour, const Fit& fit,
                                  std::span<const int> shapes, std::span<const Amount> frictions);

// A member of `found` that is not sure any more, over the catalogue, with that, nor sure in each of the other
// estimates by itself: how much of it there seems to be hangs on how the rows are weighed. One that is
// `doubted` for another reason must be sure in both ways. The least sure one. Not the usual friction, nor
// what comes late.
std::optional<std::size_t> unsure_by_misfit(const Search& found, const Setting& setting, const BlockSet& set,
                                            const Colour& colour, std::span<const int> shapes,
                                            std::span<const std::size_t> doubted);

}  // namespace wheelwright::gap
