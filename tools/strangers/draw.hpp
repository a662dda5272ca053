// Robots that nobody tuned for: each drawn from documented distributions (docs/robots.md), as the two files
// that describe it. The firmware gets robot.toml, which a careful builder could have written from
// template.toml; plant.toml is the truth. The same seed and number give the same two files.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "firmware/task/robot_file.hpp"
#include "sim_hal/plant.hpp"

namespace wheelwright::tools {

// What is wrong with a robot on purpose, one thing at a time.
enum class RobotFault : std::uint8_t {
    none,
    clipping,                // the drives give 30 to 50 % of the torque limit that the file says
    swapped_wheels,          // the file's left drive is the right one
    wrong_sign,              // one wheel's direction in the file is wrong
    encoder_against_torque,  // one drive's encoder counts down when its torque pushes up
    wheel_in_air,            // one wheel has no floor below it
    wheel_blocked,           // one wheel does not turn
    too_heavy,               // friction above the torque limit
    no_room,                 // a quick robot that may go no further than 0.1 m
};
inline constexpr std::array<std::string_view, 9> kRobotFaultNames{
    "none",         "clipping",      "swapped_wheels", "wrong_sign", "encoder_against_torque",
    "wheel_in_air", "wheel_blocked", "too_heavy",      "no_room"};

struct DrawnRobot {
    std::int64_t number = 1;
    std::uint64_t simulation_seed = 1;
    RobotFault fault = RobotFault::none;
    std::size_t fault_side = 0;          // 0: left, 1: right
    std::string robot_toml, plant_toml;  // the two files
    task::RobotFile believed, truth;     // the same, read
    double rotor_share = 0;              // of the effective mass
    double friction_share = 0;           // of the torque limit, at the speed limit
    double delay_s = 0;                  // command latency and torque lag
    double torque_share = 1;             // of the limit that the drives can give
    sim::Payload payload;                // put on while it adapts, and taken off
    bool clips = false, weak_wheel = false, torque_feedback = true, external_pose = true;
    bool lists_friction = true;         // in its file
    std::int64_t report_period_ms = 1;  // of its encoders
};

// Throws std::runtime_error when the files would not be read by the firmware.
DrawnRobot draw_robot(std::uint64_t seed, std::int64_t number, RobotFault fault = RobotFault::none);

// safety.stale_feedback_s of drives that report each so many ms: two frames lost in a row are no silence.
inline double stale_feedback_s(std::int64_t report_period_ms) {
    return std::max(0.01, 0.004 * static_cast<double>(report_period_ms));
}

}  // namespace wheelwright::tools
