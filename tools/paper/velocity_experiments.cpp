#include "tools/paper/velocity_experiments.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "firmware/control/loop_design.hpp"
#include "firmware/model/robot_parameters.hpp"

namespace wheelwright::paper {
namespace {

constexpr double kLength_s = 0.15;
constexpr double kCycle_s = 0.001;

void judge(StepResponse& response) {
    double last_outside_s = 0;
    for (std::size_t i = 0; i < response.speed.size(); ++i) {
        response.overshoot = std::max(response.overshoot, response.speed[i] - 1);
        if (std::abs(response.speed[i] - 1) > 0.01) last_outside_s = response.time_s[i];
    }
    response.settling_s = last_outside_s;
}

}  // namespace

StepResponse continuous_step(bool with_zero) {
    StepResponse response;
    constexpr double kStep_s = 1e-5;
    for (double t = 0; t <= kLength_s; t += kStep_s) {
        const double x = kPaperOmega_rad_per_s * t;
        response.time_s.push_back(t);
        response.speed.push_back(1 + (with_zero ? x - 1 : -x - 1) * std::exp(-x));
    }
    judge(response);
    return response;
}

StepResponse sampled_step(const SampledLoop& loop) {
    StepResponse response;
    const double cycles = loop.delay_s / kCycle_s;
    const auto whole = static_cast<std::size_t>(cycles + 1e-9);
    const double fraction = std::max(0.0, cycles - static_cast<double>(whole));
    std::vector<double> sent(whole + 2, 0.0);  // before the step nothing was asked for
    double speed = 0;
    double integral = 0;
    for (int n = 0; n <= static_cast<int>(kLength_s / kCycle_s); ++n) {
        response.time_s.push_back(n * kCycle_s);
        response.speed.push_back(speed);
        sent.push_back(loop.kp_per_s * (loop.setpoint_weight - speed) + integral);
        integral += kCycle_s * loop.ki_per_s2 * (1 - speed);
        const double late = sent[sent.size() - 1 - whole];
        const double later = sent[sent.size() - 2 - whole];
        speed += kCycle_s * (1 + loop.gain_error) * ((1 - fraction) * late + fraction * later);
    }
    judge(response);
    return response;
}

OurDesign our_design(double delay_s) {
    const model::RobotParameters parameters = model::default_parameters();
    control::LoopDesignRequest<double> request = control::loop_design_request<double>(parameters, kCycle_s);
    request.method = model::LoopDesignMethod::delayed_plant;
    request.settling_time_s = kPaperSettling_s;
    request.actuation_delay_s = delay_s;
    control::LoopDesign<double> design;
    OurDesign out;
    out.delay_s = delay_s;
    out.accepted = design.run(request) == control::DesignStatus::accepted;
    out.kp_per_s = design.result().gains.kp_per_s;
    out.ki_per_s2 = design.result().gains.ki_per_s2;
    out.setpoint_weight = design.result().gains.setpoint_weight;
    out.phase_margin_deg = design.result().phase_margin_deg;
    out.sensitivity_peak = design.result().sensitivity_peak;
    return out;
}

}  // namespace wheelwright::paper
