// A plain analysis for comparison: stepwise regression with the Bayesian information criterion, on the
// columns that `wheelwright gap` has too. It knows the effects' formulas, and no tests, rivals, held-out
// parts or sensors.
//
// From K5..K8 and the torque's timing, the way of an effect whose joining lowers
//     n ln(S / n) + p ln n
// most is taken, or the effect whose leaving does, until nothing lowers it; n rows, S their squared residual,
// p coefficients (Schwarz, Annals of Statistics 6 (1978) 461). An effect that is not linear is tried at the
// points of its grid, each linear in an amount; it is not refined.
#pragma once

#include <string>

#include "firmware/model/dynamics.hpp"

namespace wheelwright::tools {

// Reads the log, returns a gap.json: verdict (named, nothing_missing, or unusable_log) and effects by
// importance, with values and no intervals. A few seconds of processor time for a long log.
std::string stepwise_baseline_json(const std::string& log, const model::Geometry<double>& geometry);

}  // namespace wheelwright::tools
