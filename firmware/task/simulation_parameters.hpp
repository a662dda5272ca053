// What a simulated robot is besides its model: encoder, drives, bus and the outside pose, with their warts.
// Read from [simulation] of a robot file; names, units, defaults and ranges have their one home in
// simulation_parameters.cpp. The firmware itself never looks at these numbers.
#pragma once

#include <span>
#include <string_view>

#include "firmware/model/types.hpp"

namespace wheelwright::task {

struct SimulationParameters {
    double encoder_counts_per_turn{};  // of the motor; whole
    double encoder_noise_rad{};        // standard deviation, as an angle of the wheel
    double velocity_filter_rad_per_s{};
    double torque_lag_s{};
    double torque_noise_Nm{};
    double torque_ripple_Nm{};
    double current_limit_A{};
    double command_latency_s{};
    double external_pose_rate_Hz{};
    double external_pose_noise_m{};
    double external_heading_noise_rad{};
    double external_pose_delay_s{};
    Pose<double> start;
};

struct SimulationInfo {
    std::string_view key;  // dotted path in the robot file
    std::string_view unit;
    bool whole;
    double standard;  // default
    double minimum, maximum;
    double (*get)(const SimulationParameters&);
    void (*set)(SimulationParameters&, double);
    std::string_view meaning;
};

std::span<const SimulationInfo> simulation_table();

SimulationParameters default_simulation();

}  // namespace wheelwright::task
