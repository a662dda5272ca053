// Pose goals by the thousand: plant with sticking friction, velocity loop, odometry fused with noisy poses,
// pose controller. The plant runs at 1 ms (its accelerations are held over a step, friction is an impulse),
// speed is measured with noise and the torque acts two cycles late; the pose law runs every 10 ms. Used by
// the tests (a sample) and by the program pose_campaign (all of it).
#pragma once

#include <cstdint>

#include "firmware/model/robot_parameters.hpp"

namespace bench {

struct PoseGoal {
    double x_m, y_m, heading_rad;
    double start_heading_rad;
    wheelwright::model::GoalDirection direction;
};

struct PoseOutcome {
    bool arrived = false;         // within 1 cm and 1 degree, held for 2 s, all before 60 s
    double time_s = 0;            // when the 2 s began
    double position_error_m = 0;  // largest while held
    double heading_error_rad = 0;
    double torque_span_Nm = 0;  // largest less smallest torque of a wheel while held
    double torque_step_Nm = 0;  // largest change from cycle to cycle while held
    double wrong_way_m = 0;     // way driven against the direction asked for, more than 5 cm from the goal
};

PoseOutcome run_pose_goal(const PoseGoal& goal, std::uint64_t seed, double pose_noise_m);

struct CampaignResult {
    int goals = 0;
    int arrived = 0;
    double slowest_s = 0;
    double mean_s = 0;
    double worst_position_m = 0;
    double worst_heading_rad = 0;
    double worst_span_Nm = 0;
    double worst_step_Nm = 0;
    double worst_wrong_way_m = 0;
    std::uint64_t first_failure = 0;
};

// `goals` starts and goals spread evenly at random over 20 m x 20 m.
CampaignResult run_pose_campaign(wheelwright::model::GoalDirection direction, int goals, std::uint64_t seed);

}  // namespace bench
