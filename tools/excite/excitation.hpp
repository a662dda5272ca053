// A motion that `wheelwright gap` has advised (gap.json), made fit for a robot's limits and driven.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "firmware/model/robot_parameters.hpp"
#include "tools/excite/motions.hpp"
#include "tools/sim/simulation.hpp"

namespace wheelwright::excite {

struct Advice {
    std::string tell, from;  // effects
    const Motion* motion = nullptr;
    double torque_Nm = 0;
};

struct AdviceFile {
    std::vector<Advice> advice;
    std::string problem;  // set: unusable
};
AdviceFile read_advice(const std::string& path);

inline constexpr int kUsualRounds = 4;

// The motion in rounds, each other one with the opposite torques, with a halt between; so the robot ends not
// far from where it began. What the robot file's model says of it stands beside.
struct Excitation {
    const Motion* motion = nullptr;
    double size_Nm = 0;  // smaller than advised, where a limit asks for it
    int rounds = kUsualRounds;
    double speed_m_per_s = 0, yaw_rate_rad_per_s = 0, torque_Nm = 0;  // largest
    double farthest_m = 0;                                            // from the start
    // Beyond these a round ends early: a model that lacks something may foretell too little.
    double speed_limit_m_per_s = 0, yaw_rate_limit_rad_per_s = 0;

    WheelPair<double> torque_at(int round, double t_s) const;
    double duration_s() const;
    bool too_fast(const Twist<double>& u) const;
};
inline constexpr double kHalt_s = 1.5;  // between rounds, in mode velocity
inline constexpr double kSetpointPeriod_s = 0.01;

Excitation plan_excitation(const Advice& advice, const model::RobotParameters& robot, int rounds);

// In virtual time. "" or why the robot left the motion.
std::string drive_excitation(tools::Simulation& sim, const Excitation& excitation,
                             const std::function<void(double share)>& progress = {});

}  // namespace wheelwright::excite
