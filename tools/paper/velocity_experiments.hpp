// Eq (65)-(72): one velocity loop after linearisation, u' = nu. The paper's gains in continuous time, sampled
// and delayed; and the loop this project designs on the delayed, sampled plant.
#pragma once

#include <cstddef>
#include <vector>

namespace wheelwright::paper {

inline constexpr double kPaperOmega_rad_per_s = 92;  // eq (70)
inline constexpr double kPaperKp_per_s = 184;        // eq (71)
inline constexpr double kPaperKi_per_s2 = 8464;      // eq (72)
inline constexpr double kPaperSettling_s = 0.05;     // what (69) promises

struct StepResponse {
    std::vector<double> time_s;
    std::vector<double> speed;  // share of the step
    double overshoot = 0;       // share of the step
    double settling_s = 0;      // to 1 %, for good
};

// Eq (67) with xi = 1 in closed form, with its zero or (set-point weight 0) without.
StepResponse continuous_step(bool with_zero);

// The same loop at 1 kHz: zero-order hold, Euler's integral, `delay_s` from computing to acting.
// A set-point weight below 1 weakens the zero.
struct SampledLoop {
    double kp_per_s = kPaperKp_per_s;
    double ki_per_s2 = kPaperKi_per_s2;
    double setpoint_weight = 1;
    double delay_s = 0;
    double gain_error = 0;  // the plant answers (1 + gain_error) times as strongly
};
StepResponse sampled_step(const SampledLoop& loop);

// What firmware/control/loop_design.hpp makes of a delay.
struct OurDesign {
    double delay_s = 0;
    bool accepted = false;
    double kp_per_s = 0;
    double ki_per_s2 = 0;
    double setpoint_weight = 0;
    double phase_margin_deg = 0;
    double sensitivity_peak = 0;
};
OurDesign our_design(double delay_s);

}  // namespace wheelwright::paper
