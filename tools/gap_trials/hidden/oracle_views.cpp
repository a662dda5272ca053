#include "tools/gap_trials/hidden/oracle_views.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "tools/gap_trials/hidden/electronics.hpp"

namespace wheelwright::hidden {
namespace {

constexpr double kStanding_rad_per_s = 0.03;

// What an effect makes of one wheel's torque. `u_Nm` is changed; `speed_rad_per_s` is that wheel's.
using Passage = void (*)(const Candidate& c, double period_s, const Series& speed_rad_per_s, Series& u_Nm);

// The command of delay_s before; between two samples, each by its share of the period.
void delay(const Candidate& c, double period_s, const Series&, Series& u_Nm) {
    const double shift = c["delay_s"] / period_s;
    const auto whole = static_cast<std::size_t>(shift);
    const double part = shift - static_cast<double>(whole);
    const Series command_Nm = u_Nm;
    for (std::size_t k = 0; k < u_Nm.size(); ++k) {
        const double late = k >= whole ? command_Nm[k - whole] : 0;
        const double later = k >= whole + 1 ? command_Nm[k - whole - 1] : 0;
        u_Nm[k] = (1 - part) * late + part * later;
    }
}

void leave_out_middle(const Candidate& c, double, const Series&, Series& u_Nm) {
    const double width_Nm = c["width_Nm"];
    for (double& u : u_Nm) u -= std::clamp(u, -width_Nm, width_Nm);
}

void saturate(const Candidate& c, double, const Series&, Series& u_Nm) {
    const double limit_Nm = c["limit_Nm"];
    for (double& u : u_Nm) u = std::clamp(u, -limit_Nm, limit_Nm);
}

void limit_by_speed(const Candidate& c, double, const Series& speed_rad_per_s, Series& u_Nm) {
    const double stall_Nm = c["stall_Nm"];
    const double no_load_rad_per_s = c["no_load_rad_per_s"];
    for (std::size_t k = 0; k < u_Nm.size(); ++k) {
        const double share = speed_rad_per_s[k] / no_load_rad_per_s;
        u_Nm[k] = std::clamp(u_Nm[k], std::min(0.0, -stall_Nm * (1 + share)),
                             std::max(0.0, stall_Nm * (1 - share)));
    }
}

// Mean over each period of a first-order lag of the held command.
void lag(const Candidate& c, double period_s, const Series&, Series& u_Nm) {
    const double time_constant_s = c["time_constant_s"];
    const double share = -std::expm1(-period_s / time_constant_s);
    double state = 0;
    for (double& u : u_Nm) {
        const double before = state;
        state += (u - state) * share;
        u -= time_constant_s * (state - before) / period_s;
    }
}

// A motor within its gap, pushing the wheel by a contact as stiff as the hidden one (electronics.cpp).
// Nothing is known of the last sample's period: 0.
void pass_gap(const Candidate& c, double period_s, const Series& speed_rad_per_s, Series& u_Nm) {
    constexpr double kStiffness_Nm_per_rad = 100;
    constexpr double kStep_s = 6e-5;
    const double gap = c["half_gap_rad"];
    const double inertia = c["motor_inertia_kg_m2"];
    const double damping = 0.7 * std::sqrt(kStiffness_Nm_per_rad * inertia);
    const int steps = std::max(1, static_cast<int>(std::lround(period_s / kStep_s)));
    const double h = period_s / steps;
    double motor = 0;
    double motor_speed = 0;
    double wheel = 0;
    for (std::size_t k = 0; k + 1 < u_Nm.size(); ++k) {
        const double u = u_Nm[k];
        const double from = speed_rad_per_s[k];
        const double to = speed_rad_per_s[k + 1];
        const double freely = u / inertia * h;
        double impulse = 0;
        for (int i = 0; i < steps; ++i) {
            const double speed = from + (to - from) * i / steps;
            const double ahead = motor - wheel;
            double push = 0;
            if (std::abs(ahead) > gap) {
                push = kStiffness_Nm_per_rad * (ahead - std::copysign(gap, ahead)) +
                       damping * (motor_speed - speed);
                if (push * ahead < 0) push = 0;  // teeth do not pull
            }
            impulse += push * h;
            motor_speed += push == 0 ? freely : (u - push) / inertia * h;
            motor += motor_speed * h;
            wheel += speed * h;
        }
        u_Nm[k] = impulse / period_s;
    }
    if (!u_Nm.empty()) u_Nm.back() = 0;
}

// From command to shaft, in the order in which they happen.
struct Stage {
    std::string_view effect;
    Passage pass;
};
constexpr std::array kTorquePath{
    Stage{"transport_delay", delay},      Stage{"dead_zone", leave_out_middle},
    Stage{"torque_saturation", saturate}, Stage{"back_emf_limit", limit_by_speed},
    Stage{"actuator_lag", lag},           Stage{"backlash", pass_gap}};

// reported + time_constant reported'. The first and the last sample stay.
void undo_lag(double time_constant_s, double period_s, Series& speed_rad_per_s) {
    const Series reported = speed_rad_per_s;
    for (std::size_t k = 1; k + 1 < reported.size(); ++k) {
        speed_rad_per_s[k] += time_constant_s * (reported[k + 1] - reported[k - 1]) / (2 * period_s);
    }
}

}  // namespace

CleanLog clean_log(const Trial& trial) {
    CleanLog log;
    log.period_s = 1 / trial.rate_Hz;
    log.duration_s = trial.duration_s;
    log.wheel_radius_m = trial.robot.wheel_radius_m;
    log.track_m = trial.robot.track_m;
    log.castor_ahead_m = trial.robot.castor_ahead_m;
    log.wheel_inertia_kg_m2 = trial.robot.wheel_inertia_kg_m2;
    log.peak_torque_Nm = trial.peak_torque_Nm;
    const Noise& noise = kNoises[trial.plan.noise];
    const double step = speed_step_rad_per_s(kUsualCountsPerTurn);
    log.speed_noise_rad_per_s = std::sqrt(noise.speed_rad_per_s * noise.speed_rad_per_s + step * step / 12);
    log.gyro_noise_rad_per_s = noise.gyro_rad_per_s;
    log.gyro = trial.gyro;
    for (const Sample& s : trial.samples) {
        log.torque_Nm.left.push_back(s.torque_Nm.left);
        log.torque_Nm.right.push_back(s.torque_Nm.right);
        log.speed_rad_per_s.left.push_back(s.clean_rad_per_s.left);
        log.speed_rad_per_s.right.push_back(s.clean_rad_per_s.right);
        log.gyro_rad_per_s.push_back(s.clean_gyro_rad_per_s);
        const double left = std::abs(s.clean_rad_per_s.left);
        const double right = std::abs(s.clean_rad_per_s.right);
        log.peak_speed_rad_per_s = std::max({log.peak_speed_rad_per_s, left, right});
        log.standing.push_back(left < kStanding_rad_per_s || right < kStanding_rad_per_s);
    }
    return log;
}

AxisSeries View::sums_of(const WheelSeries& wheels_Nm) const {
    const std::size_t n = wheels_Nm.left.size();
    AxisSeries sums{Series(n), Series(n)};
    for (std::size_t k = 0; k < n; ++k) {
        const double left = wheels_Nm.left[k] / radii.left_m(1);
        const double right = wheels_Nm.right[k] / radii.right_m(1);
        sums.forward[k] = left + right;
        sums.turning[k] = right - left;
    }
    return sums;
}

View view_of(const CleanLog& log, const std::vector<Candidate>& candidates) {
    View view;
    view.speed_rad_per_s = log.speed_rad_per_s;
    view.torque_Nm = log.torque_Nm;
    auto& [left_rad_per_s, right_rad_per_s] = view.speed_rad_per_s;
    for (const Candidate& c : candidates) {
        if (c.name == "wheel_radius_mismatch") view.radii.relative = c["relative"];
        if (c.name == "measurement_lag") {
            undo_lag(c["time_constant_s"], log.period_s, left_rad_per_s);
            undo_lag(c["time_constant_s"], log.period_s, right_rad_per_s);
        }
    }
    const double left_m = view.radii.left_m(log.wheel_radius_m);
    const double right_m = view.radii.right_m(log.wheel_radius_m);
    for (std::size_t k = 0; k < left_rad_per_s.size(); ++k) {
        view.v_m_per_s.push_back((left_m * left_rad_per_s[k] + right_m * right_rad_per_s[k]) / 2);
        view.w_rad_per_s.push_back((right_m * right_rad_per_s[k] - left_m * left_rad_per_s[k]) / log.track_m);
    }
    for (const Stage& stage : kTorquePath) {
        for (const Candidate& c : candidates) {
            if (c.name != stage.effect) continue;
            stage.pass(c, log.period_s, left_rad_per_s, view.torque_Nm.left);
            stage.pass(c, log.period_s, right_rad_per_s, view.torque_Nm.right);
        }
    }
    view.sums_Nm = view.sums_of(view.torque_Nm);
    return view;
}

}  // namespace wheelwright::hidden
