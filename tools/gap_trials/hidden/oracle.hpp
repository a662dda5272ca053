// Whether a trial can be told at all: decided from noise-free data, before any analysis, by formulas of its
// own.
//
// For a trial the plant's noise-free speeds and the commanded torques are explained by the base model (K5..K8
// refitted) together with one effect after the other, its parameters refitted too: linear ones by least
// squares with the signs and cross-axis ratios that physics demands, others by search. What an effect leaves
// unexplained is measured in variances of the log's noise (of the speeds, counts included, and of the gyro
// where the log has one): over windows of at most 2 s, the speeds at whose beginning are free,
//   lambda = sum over samples of (speed - predicted speed)^2 / sigma^2.
// With lambda_true left by the hidden effect itself (true nonlinear parameters), lambda_none by the base
// model alone, a trial is identifiable when
//   lambda_none - lambda_true >= 50,  and for every other effect
//   lambda_rival - lambda_true >= 50  and  >= 0.0005 (lambda_none - lambda_true).
// 50 is what a test on half of the data needs for a 1 % level over the library. The share says that two
// explanations that differ by less of the gap are one to whoever does not have the exact model. With two
// effects hidden: each left out, and each replaced by every other one, must obey the same,
// with the gap that the effect in question closes. A rival that
// holds the truth as a special case is none: stribeck_friction beside coulomb_friction.
// encoder_quantisation is always identifiable: every speed of the log lies on the grid. With nothing hidden
// there is nothing to tell. What it leaves out: windows end where a wheel stands still, so sticking tells
// nothing here; a rival's search is on a grid with refinement, not exhaustive; two effects as rivals of one
// are not tried.
#pragma once

#include "tools/gap_trials/hidden/trial.hpp"

namespace wheelwright::hidden {

OracleVerdict ask_oracle(const Trial& trial);

}  // namespace wheelwright::hidden
