// Rows of the two regressions, paper eq (50)-(55), from logs of wheel speeds and torques at 20 Hz to 2 kHz.
//
// RegressionFilter (firmware/ident) makes its rows from wheel angles at 1 kHz. Logs hold speeds instead, at
// any rate, so here a row is an integral over speeds: between samples speed runs straight, hence in the
// interval from i to i+1, exactly,
//     mean acceleration = (w_i+1 - w_i) / dt,    mean of a b = (2 a_i b_i + a_i b_i+1 + a_i+1 b_i + 2 a_i+1
//     b_i+1) / 6,
// the mean sign comes from the interpolated zero crossing, and the mean torque from the integral of the
// straight lines between torque samples, `delay_s` ago. A row averages everything with the same triangle, 2 m
// - 1 intervals wide (m = 1: one interval), so both sides stay equal, nothing is differentiated that was not
// averaged, and sensor noise enters as a first difference of means over m samples.
//
// Intervals in which a wheel stands still are left out: dry friction then holds with a torque nobody knows.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/effects.hpp"
#include "tools/ident/regression.hpp"
#include "tools/logs/measured_csv.hpp"

namespace wheelwright::tools {

// One run, ready for rows.
struct SpeedRun {
    const MeasuredLog* log = nullptr;
    std::vector<bool> left_out;  // by interval: a sensor or a wheel that cannot be believed
};

struct SpeedRowOptions {
    model::Geometry<double> geometry;
    model::EffectSet<double> effects;  // columns are made for the active ones
    std::size_t block = 1;             // m, samples
    double delay_s = 0;                // of the torque; negative: the torque column comes late
};

// Both equations' rows: phi = [velocity product, torque, d torque / d delay, columns of the effects ...].
struct SpeedRows {
    Rows linear, turning;
    std::size_t masked = 0;  // rows that were left out
};
enum SpeedColumn : Eigen::Index { kVelocityProduct, kTorque, kSlip, kFirstEffect };

SpeedRows make_speed_rows(std::span<const SpeedRun> runs, const SpeedRowOptions& options);

}  // namespace wheelwright::tools
