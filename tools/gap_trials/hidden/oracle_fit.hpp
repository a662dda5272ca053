// What a set of effects leaves unexplained of a log, their linear parameters and the base model's fitted.
#pragma once

#include <vector>

#include "tools/gap_trials/hidden/oracle_views.hpp"

namespace wheelwright::hidden {

// In variances of the log's noise, over windows of at most 2 s at the beginning of which the speeds are free.
// Windows end where a wheel stands. Without candidates: by the base model alone,
//   v' = K5 w^2 + K7 (right + left),  w' = K6 v w + K8 (right - left).
// Costs a pass over the log for each axis, and a few small systems of equations.
double unexplained(const CleanLog& log, const std::vector<Candidate>& candidates);

}  // namespace wheelwright::hidden
