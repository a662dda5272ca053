#include "tools/gap_trials/hidden/electronics.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace wheelwright::hidden {

TorquePath::TorquePath(const HiddenSet& hidden, double duration_s)
    : delay_(hidden.find("transport_delay")),
      dead_zone_(hidden.find("dead_zone")),
      mismatch_(hidden.find("torque_gain_mismatch")),
      drift_(hidden.find("gain_drift")),
      bias_(hidden.find("torque_bias")),
      saturation_(hidden.find("torque_saturation")),
      back_emf_(hidden.find("back_emf_limit")),
      lag_(hidden.find("actuator_lag")),
      ripple_(hidden.find("torque_ripple")),
      backlash_(hidden.find("backlash")),
      duration_s_(duration_s),
      commands_{{-1e9, {}}} {}

void TorquePath::command(double t_s, const Pair& torque_Nm) {
    commands_.push_back({t_s, torque_Nm});
    const double oldest_s = t_s - (delay_ != nullptr ? (*delay_)["delay_s"] : 0);
    while (commands_.size() > 1 && commands_[1].t_s <= oldest_s) commands_.pop_front();
}

// Mean of the delayed command over the step, so that a delay need not be a multiple of the step.
double TorquePath::held(double t_s, double step_s, bool right) {
    const double shift = delay_ != nullptr ? (*delay_)["delay_s"] : 0;
    const double from = t_s - shift;
    const double to = from + step_s;
    double impulse = 0;
    for (std::size_t i = 0; i < commands_.size(); ++i) {
        const double begin = std::max(from, commands_[i].t_s);
        const double end = i + 1 < commands_.size() ? std::min(to, commands_[i + 1].t_s) : to;
        const Pair& torque = commands_[i].torque_Nm;
        if (end > begin) impulse += (end - begin) * (right ? torque.right : torque.left);
    }
    return impulse / step_s;
}

Pair TorquePath::shaft_torque_Nm(double t_s, double step_s, const PlantState& wheels) {
    return {one_wheel(held(t_s, step_s, false), t_s, step_s, wheels.wheel_speed_rad_per_s.left,
                      wheels.wheel_angle_rad.left, false),
            one_wheel(held(t_s, step_s, true), t_s, step_s, wheels.wheel_speed_rad_per_s.right,
                      wheels.wheel_angle_rad.right, true)};
}

double TorquePath::effect_rms_Nm(std::string_view effect) const {
    double squares = 0;
    if (effect == "torque_bias") squares = bias_squares_;
    if (effect == "back_emf_limit") squares = back_emf_squares_;
    if (effect == "torque_ripple") squares = ripple_squares_;
    return std::sqrt(squares / std::max(wheel_steps_, 1.0));
}

double TorquePath::one_wheel(double u, double t_s, double step_s, double speed, double angle, bool right) {
    ++wheel_steps_;
    if (dead_zone_ != nullptr) u = std::copysign(std::max(std::abs(u) - (*dead_zone_)["width_Nm"], 0.0), u);
    if (mismatch_ != nullptr) {
        const double root = std::sqrt(1 + (*mismatch_)["relative"]);
        u = right ? u * root : u / root;
    }
    if (drift_ != nullptr) {
        const double time_constant_s = (*drift_)["time_constant_s"];
        const double share = time_constant_s > 0 ? -std::expm1(-t_s / time_constant_s) : t_s / duration_s_;
        u *= 1 - (*drift_)["loss"] * share;
    }
    if (bias_ != nullptr) {
        const double bias = (*bias_)[right ? "right_Nm" : "left_Nm"];
        u += bias;
        bias_squares_ += bias * bias;
    }
    if (saturation_ != nullptr) {
        const double limit = (*saturation_)["limit_Nm"];
        u = std::clamp(u, -limit, limit);
    }
    if (back_emf_ != nullptr) {
        const double stall = (*back_emf_)["stall_Nm"];
        const double share = speed / (*back_emf_)["no_load_rad_per_s"];
        const double wanted = u;
        u = std::clamp(u, std::min(0.0, -stall * (1 + share)), std::max(0.0, stall * (1 - share)));
        back_emf_squares_ += (u - wanted) * (u - wanted);
    }
    if (lag_ != nullptr) {
        double& state = motor_[right ? 1 : 0].lagged_Nm;
        const double time_constant_s = (*lag_)["time_constant_s"];
        const double before = state;
        state += (u - state) * -std::expm1(-step_s / time_constant_s);
        // mean over the step, from the same equation
        u -= time_constant_s * (state - before) / step_s;
    }
    if (ripple_ != nullptr) {
        const double ripple =
            (*ripple_)["amplitude_Nm"] * std::sin((*ripple_)["order"] * angle + (*ripple_)["phase_rad"]);
        u += ripple;
        ripple_squares_ += ripple * ripple;
    }
    if (backlash_ != nullptr) u = through_gap(u, step_s, speed, angle, right);
    return u;
}

double TorquePath::through_gap(double u, double step_s, double speed, double angle, bool right) {
    // As stiff as lets a blow of the motor, some rad/s, not lift the robot's wheels: some 2 Nm.
    constexpr double kStiffness_Nm_per_rad = 100;
    constexpr int kSteps = 16;
    Motor& motor = motor_[right ? 1 : 0];
    const double gap = (*backlash_)["half_gap_rad"];
    const double inertia = (*backlash_)["motor_inertia_kg_m2"];
    const double damping = 0.7 * std::sqrt(kStiffness_Nm_per_rad * inertia);
    const double h = step_s / kSteps;
    double impulse = 0;
    for (int i = 0; i < kSteps; ++i) {
        const double ahead = motor.angle_rad - (angle + speed * h * i);
        double push = 0;
        if (std::abs(ahead) > gap) {
            push = kStiffness_Nm_per_rad * (ahead - std::copysign(gap, ahead)) +
                   damping * (motor.speed_rad_per_s - speed);
            if (push * ahead < 0) push = 0;  // teeth do not pull
        }
        impulse += push * h;
        motor.speed_rad_per_s += (u - push) / inertia * h;
        motor.angle_rad += motor.speed_rad_per_s * h;
    }
    return impulse / step_s;
}

void SpeedReport::advance(double step_s, const Pair& speed) {
    if (lag_ == nullptr) return;
    const double share = -std::expm1(-step_s / (*lag_)["time_constant_s"]);
    reported_.left += (speed.left - reported_.left) * share;
    reported_.right += (speed.right - reported_.right) * share;
}

double speed_step_rad_per_s(double counts_per_turn) {
    return 2 * std::numbers::pi / (counts_per_turn * kCountingTime_s);
}

}  // namespace wheelwright::hidden
