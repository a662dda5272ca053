// Rows of the two regressions, paper eq (50)-(55), from logs of wheel speeds and torques at 20 Hz to 2 kHz.
//
// RegressionFilter (firmware/ident) makes its rows from wheel angles at 1 kHz. Logs hold speeds instead, at
// any rate, so here a row is an integral over speeds. Between samples speed runs straight (but for a bend
// where the torque steps, known from the first estimate); in the interval from sample 0 to sample 1
//   mean acceleration = (w1 - w0) / dt
//   mean of a b       = (2 a0 b0 + a0 b1 + a1 b0 + 2 a1 b1) / 6
//   mean sign         with the zero crossing interpolated
//   mean torque       of the torque `delay_s` ago, each sample held until the next. With half a sample less
//                     delay that is the mean of both samples: what a torque measured at its sample needs.
// A row averages everything with the same triangle, 2 m - 1 intervals wide (m = 1: one interval), so both
// sides stay equal, and sensor noise enters as the first difference of means over m samples.
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
#include "tools/logs/measured_log.hpp"

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
    // What is believed of K7 and K8: where the torque steps between two samples, speed has a bend there.
    double k7_per_kg_m = 0, k8_per_kg_m2 = 0;
};

// Both equations' rows: phi = [velocity product, torque, d torque / d delay, columns of the effects ...].
struct SpeedRows {
    Rows linear, turning;
    std::size_t masked = 0;  // rows that were left out
};
enum SpeedColumn : Eigen::Index { kVelocityProduct, kTorque, kSlip, kFirstEffect };

SpeedRows make_speed_rows(std::span<const SpeedRun> runs, const SpeedRowOptions& options);

}  // namespace wheelwright::tools
