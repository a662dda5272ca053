// What the robot is driven through: drawn motions, one after the other, as torque commands.
#pragma once

#include <array>
#include <functional>
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

// What else a robot may be driven through: wheel torques that somebody has worked out, one push after the
// other, each followed by a halt.
struct TorqueProgramme {
    struct Push {
        std::function<Pair(double t_s)> torque_Nm;  // t_s from the push's beginning
        double duration_s = 0;
    };
    std::vector<Push> pushes;
    double halt_s = 0;  // brought to rest
    // A push in which the robot gets faster than this ends.
    double fastest_m_per_s = 0;
    double fastest_yaw_rad_per_s = 0;

    double duration_s() const;  // with the rest before it
};

// The driver: knows the robot's nominal mass, sees what the log will hold, commands wheel torques. The first
// three motions are torques with a weak pull towards rest, the others speeds that a small control loop
// follows.
class Driver {
  public:
    // Each motion takes the same time. At least one motion; duration_s > 0. A quick driver's prbs has shorter
    // bits, for lags and delays of milliseconds.
    Driver(const Robot& robot, std::vector<Motion> motions, double duration_s, bool quick, Random& random);

    // The command at t_s for the wheel speeds as measured; within the robot's torque limit. Call with growing
    // t_s.
    Pair command(double t_s, const Pair& measured_rad_per_s);

    // The same of a programme instead of the motions, that being what a log then consists of.
    Pair command(const TorqueProgramme& programme, double t_s, const Pair& measured_rad_per_s);

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

    Twist twist(const Pair& measured_rad_per_s) const;
    // Torque of each wheel per forward and per yaw acceleration.
    double torque_per_forward() const { return robot_.effective_mass_kg() * robot_.wheel_radius_m / 2; }
    double torque_per_yaw() const {
        return robot_.effective_inertia_kg_m2() * robot_.wheel_radius_m / robot_.track_m;
    }
    Segment draw(Motion motion, bool quick, Random& random) const;
    Pair from_torques(double forward, double turning) const;
    Twist reference(const Segment& segment, double t_s) const;

    Robot robot_;
    std::vector<Segment> segments_;
    double segment_s_;
    double gain_per_s_;
    std::size_t too_fast_ = 0;  // pushes of a programme up to which the robot was too fast in the last one
};

}  // namespace wheelwright::hidden
