#include "firmware/task/simulation_parameters.hpp"

#include <array>

namespace wheelwright::task {
namespace {

// NOLINTBEGIN(cppcoreguidelines-macro-usage): a member path is spelled once for key and accessors
#define WW_NUMBER(path, unit, whole, standard, low, high, meaning)                 \
    SimulationInfo {                                                               \
        "simulation." #path, unit, whole, standard, low, high,                     \
            [](const SimulationParameters& p) -> double { return p.path; },        \
            [](SimulationParameters& p, double value) { p.path = value; }, meaning \
    }

constexpr double kPi = 3.14159265358979323846;

// clang-format off
const std::array kTable{
    WW_NUMBER(encoder_counts_per_turn, "", true, 8192.0, 16.0, 16777216.0, "encoder counts in a motor turn"),
    WW_NUMBER(encoder_noise_rad, "rad", false, 0.0002, 0.0, 0.1, "standard deviation of an encoder reading, as an angle of the wheel"),
    WW_NUMBER(velocity_filter_rad_per_s, "rad/s", false, 1000.0, 10.0, 20000.0, "bandwidth of the drives' encoder loop, which makes their position and speed"),
    WW_NUMBER(torque_lag_s, "s", false, 0.0005, 0.0, 0.1, "time constant from set-point to torque"),
    WW_NUMBER(torque_noise_Nm, "Nm", false, 0.02, 0.0, 10.0, "standard deviation of the torque's noise at the wheel"),
    WW_NUMBER(torque_ripple_Nm, "Nm", false, 0.0, 0.0, 10.0, "amplitude of the torque's ripple at the wheel"),
    WW_NUMBER(current_limit_A, "A", false, 20.0, 0.1, 1000.0, "current a drive gives at most"),
    WW_NUMBER(command_latency_s, "s", false, 0.0002, 0.0, 0.1, "time inside the drive from a set-point's frame to its effect"),
    WW_NUMBER(external_pose_rate_Hz, "Hz", false, 20.0, 0.0, 1000.0, "external poses a second; 0: none"),
    WW_NUMBER(external_pose_noise_m, "m", false, 0.002, 0.0, 1.0, "standard deviation of each coordinate of an external pose"),
    WW_NUMBER(external_heading_noise_rad, "rad", false, 0.004, 0.0, 1.0, "standard deviation of the heading of an external pose"),
    WW_NUMBER(external_pose_delay_s, "s", false, 0.0, 0.0, 0.5, "age of an external pose when it arrives"),
    WW_NUMBER(start.x_m, "m", false, 0.0, -60.0, 60.0, "where the robot stands at first: x"),
    WW_NUMBER(start.y_m, "m", false, 0.0, -60.0, 60.0, "where the robot stands at first: y"),
    WW_NUMBER(start.heading_rad, "rad", false, 0.0, -kPi, kPi, "where the robot points at first"),
};
// clang-format on
#undef WW_NUMBER
// NOLINTEND(cppcoreguidelines-macro-usage)

}  // namespace

std::span<const SimulationInfo> simulation_table() { return kTable; }

SimulationParameters default_simulation() {
    SimulationParameters parameters;
    for (const SimulationInfo& info : kTable) info.set(parameters, info.standard);
    return parameters;
}

}  // namespace wheelwright::task
