// From the amounts of a fit to the parameters of the catalogue, and how far these can be trusted.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "tools/gap/model/columns.hpp"

namespace wheelwright::gap {

struct ParameterEstimate {
    double value = 0, standard_error = 0;  // in the catalogue's unit
    std::array<double, 2> interval_95{};
    bool known = true;
};

// The parameters that a candidate's amounts stand for, in the catalogue's order, with errors from the
// amounts' covariance (delta method) and Student's interval for a fit to so many blocks.
std::vector<ParameterEstimate> estimates_of(const Candidate& candidate, const Eigen::VectorXd& amounts,
                                            const Eigen::MatrixXd& covariance, const Setting& setting,
                                            std::size_t blocks);

// Adds what the spread between blocks does not show: `unmoved`, a standard error for each parameter of what
// the fit does not move, and what the model of this effect is known to leave out. Scales those that need
// the body's mass, for which K7 stands with the wheels' rotation.
void widen(const Candidate& candidate, const Setting& setting, const std::vector<double>& unmoved,
           std::vector<ParameterEstimate>& parameters);

}  // namespace wheelwright::gap
