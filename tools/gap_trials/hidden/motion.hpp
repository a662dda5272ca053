// What the robot is driven through: drawn motions, one after the other, as torque commands.
#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "tools/gap_trials/hidden/effects.hpp"
#include "tools/gap_trials/hidden/random.hpp"
#include "tools/gap_trials/hidden/robot.hpp"

namespace wheelwright::hidden {

enum class Motion { prbs, multisine, chirp, figure_eight, reversals, straight, spin };
inline constexpr std::array kMotions{Motion::prbs,         Motion::multisine, Motion::chirp,
                                     Motion::figure_eight, Motion::reversals, Motion::straight,
                                     Motion::spin};
std::string_view name_of(Motion motion);

// The driver: knows the robot's nominal mass, sees what the log will hold, commands wheel torques. The first
// three motions are torques with a weak pull towards rest, the others speeds that a small control loop
// follows.
class Driver {
  public:
    // Each motion takes the same time. At least one motion; duration_s > 0.
    Driver(const Robot& robot, std::vector<Motion> motions, double duration_s, Random& random);

    // The command at t_s for the wheel speeds as measured; within the robot's torque limit. Call with growing
    // t_s.
    Pair command(double t_s, const Pair& measured_rad_per_s);

  private:
    struct Sine {
        double frequency_Hz, amplitude, phase_rad;
    };
    struct Segment {
        Motion motion = Motion::prbs;
        double amplitude = 1;  // share of the torque limit
        double pull_per_s = 0.7;
        double speed_m_per_s = 0;
        double yaw_rate_rad_per_s = 0;
        double period_s = 1;
        double second_period_s = 1;
        double bit_s = 0.1;
        double chirp_from_Hz = 0.1;
        double chirp_to_Hz = 10;
        std::uint64_t bits_seed = 0;
        std::vector<Sine> forward, turning;
    };
    struct Twist {
        double v_m_per_s = 0;
        double yaw_rad_per_s = 0;
    };

    Segment draw(Motion motion, Random& random) const;
    Pair from_torques(double forward, double turning) const;
    Twist reference(const Segment& segment, double t_s) const;

    Robot robot_;
    std::vector<Segment> segments_;
    double segment_s_;
    double gain_per_s_;
};

}  // namespace wheelwright::hidden
