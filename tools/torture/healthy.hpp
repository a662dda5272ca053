// Normal driving, for hours: nothing is wrong, nothing may trip, and no robot may run away from its limits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace wheelwright::tools {

struct HealthyResult {
    std::uint64_t seed = 0;
    std::string robot;
    double driven_s = 0;
    std::size_t drives = 0;          // modes entered
    std::size_t refused = 0;         // modes that were not entered
    std::vector<std::string> trips;  // "1234.5 s, velocity: over_speed"
    // True speed or yaw rate over its limit, where the model is known; less what the whole torque adds within
    // the way from torque to motion, which no loop can take back.
    double fastest = 0;
    // True motion beside the set-point in velocity mode, in shares of the limits.
    double astray = 0;
    // "1234.5 s, velocity: 1.31 of its limits": the first time beyond the bounds below
    std::string strays;
};

// One robot, identified well, for a time: idle, velocities, goals, paths, adaptation and identification in
// turn, with the noise of its file and a loss of one frame in a thousand.
// `rough`: on rough ground, too. Slopes that come and go, bumps under one wheel, obstacles that it hits, and
// for each second robot tyres that slip.
HealthyResult drive_healthy(std::uint64_t seed, double duration_s, bool rough = false,
                            int report_period_ms = 1);

inline constexpr std::size_t kHealthyRobots = 20;
inline constexpr double kHealthyLoss = 0.001;  // of the frames
// Of its limits; not on rough ground.
inline constexpr double kHealthySpeed = 1.05, kHealthyAstray = 0.05;

}  // namespace wheelwright::tools
