#include "tests/control/pose_campaign.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "firmware/control/odometry.hpp"
#include "firmware/control/pose_control.hpp"
#include "tests/control/inner_loop.hpp"

namespace bench {

using namespace wheelwright;

namespace {

constexpr double kCycle_s = 1e-3;

// The robot in truth; every number differs from the controller's.
struct Coarse {
    static constexpr double radius_left = 0.0752, radius_right = 0.0754, track = 0.318;
    static constexpr double k5 = 0.037, k7 = 1.46, k8 = 6.5, k6 = -k5 * 2 * k8 / (track * k7);
    static constexpr double friction_left = 0.31, friction_right = 0.29;
    double x = 0, y = 0, heading = 0, v = 0, omega = 0;
    double turned_left = 0, turned_right = 0;

    void step(double left_Nm, double right_Nm) {
        constexpr double half = track / 2;
        constexpr double mobility_left = kCycle_s * (k7 + k8 * half) / radius_left;
        constexpr double mobility_right = kCycle_s * (k7 + k8 * half) / radius_right;
        double next_v = v + kCycle_s * (k5 * omega * omega + k7 * (right_Nm + left_Nm));
        double next_w = omega + kCycle_s * (k6 * v * omega + k8 * (right_Nm - left_Nm));
        double used_left = 0, used_right = 0;
        for (int sweep = 0; sweep < 3; ++sweep) {
            const double left = std::clamp(used_left + (next_v - next_w * half) / radius_left / mobility_left,
                                           -friction_left, friction_left);
            next_v -= kCycle_s * k7 * (left - used_left);
            next_w += kCycle_s * k8 * (left - used_left);
            used_left = left;
            const double right =
                std::clamp(used_right + (next_v + next_w * half) / radius_right / mobility_right,
                           -friction_right, friction_right);
            next_v -= kCycle_s * k7 * (right - used_right);
            next_w -= kCycle_s * k8 * (right - used_right);
            used_right = right;
        }
        const double v_mean = (v + next_v) / 2;
        const double w_mean = (omega + next_w) / 2;
        v = next_v;
        omega = next_w;
        const double middle = heading + kCycle_s * w_mean / 2;
        x += kCycle_s * v_mean * std::cos(middle);
        y += kCycle_s * v_mean * std::sin(middle);
        heading += kCycle_s * w_mean;
        turned_left = kCycle_s * (v_mean - w_mean * half) / radius_left;
        turned_right = kCycle_s * (v_mean + w_mean * half) / radius_right;
    }
};

// What every run shares: designed once.
const InnerLoop<double>& designed() {
    static const InnerLoop<double> loop = [] {
        auto p = notes_robot();
        set_coulomb(p, 0.3, 0.3);
        return InnerLoop<double>(p);
    }();
    return loop;
}

}  // namespace

PoseOutcome run_pose_goal(const PoseGoal& goal, std::uint64_t seed, double pose_noise_m) {
    static const model::RobotParameters parameters = [] {
        auto p = notes_robot();
        p.odometry.external_pose_noise_m = 0.001;
        p.odometry.external_heading_noise_rad = 0.002;
        return p;
    }();
    Noise noise(seed);
    Coarse robot;
    robot.heading = goal.start_heading_rad;
    auto loop = designed().loop;
    const auto& plant = designed().model;
    control::PoseController<double> pose;
    pose.configure(control::pose_control_settings<double>(parameters));
    pose.start({});
    pose.set_goal({goal.x_m, goal.y_m, goal.heading_rad}, goal.direction);
    control::Odometry<double> odometry;
    odometry.configure(control::odometry_settings<double>(parameters));
    loop.start(plant, {}, {});

    std::array<WheelPair<double>, 2> late{};
    control::PoseCommand<double> command;
    PoseOutcome out;
    constexpr int kLongest = 62'000;
    int held_since = -1;
    double low = 0, high = 0;
    WheelPair<double> before{};
    for (int k = 0; k < kLongest; ++k) {
        const std::int64_t now_ns = 1'000'000'000 + k * std::int64_t{1'000'000};
        odometry.advance(plant.geometry, {robot.turned_left, robot.turned_right}, now_ns);
        if (k % 50 == 0) {
            odometry.fuse({robot.x + pose_noise_m * noise.gaussian(),
                           robot.y + pose_noise_m * noise.gaussian(),
                           robot.heading + 0.002 * noise.gaussian()});
        }
        if (k % 10 == 0) command = pose.update(odometry.pose(), 10 * kCycle_s);
        model::Motion<double> motion;
        motion.twist = {robot.v + 3e-4 * noise.gaussian(), robot.omega + 2e-3 * noise.gaussian()};
        motion.wheel_speed_rad_per_s = model::wheel_speeds_from_twist(plant.geometry, motion.twist);
        const WheelPair<double> torque = loop.update(plant, motion, command.reference);
        robot.step(late[1].left, late[1].right);
        late = {torque, late[0]};

        const double distance = std::hypot(robot.x - goal.x_m, robot.y - goal.y_m);
        const double heading = std::abs(wrap_angle_rad(robot.heading - goal.heading_rad));
        if (distance > 0.05 && goal.direction != model::GoalDirection::automatic) {
            const double wrong = goal.direction == model::GoalDirection::forward ? -robot.v : robot.v;
            out.wrong_way_m += std::max(wrong, 0.0) * kCycle_s;
        }
        if (command.goal_reached && distance < 0.01 && heading < kPi / 180) {
            if (held_since < 0) {
                held_since = k;
                out.position_error_m = out.heading_error_rad = out.torque_step_Nm = out.torque_span_Nm = 0;
                low = high = torque.left;
                before = torque;
            }
            out.position_error_m = std::max(out.position_error_m, distance);
            out.heading_error_rad = std::max(out.heading_error_rad, heading);
            low = std::min(low, torque.left);
            high = std::max(high, torque.left);
            out.torque_span_Nm = high - low;
            out.torque_step_Nm = std::max({out.torque_step_Nm, std::abs(torque.left - before.left),
                                           std::abs(torque.right - before.right)});
            before = torque;
            if (k - held_since >= 2000) {
                out.time_s = held_since * kCycle_s;
                out.arrived = out.time_s < 60;
                return out;
            }
        } else {
            held_since = -1;
        }
    }
    out.time_s = kLongest * kCycle_s;
    out.position_error_m = std::hypot(robot.x - goal.x_m, robot.y - goal.y_m);
    out.heading_error_rad = std::abs(wrap_angle_rad(robot.heading - goal.heading_rad));
    return out;
}

CampaignResult run_pose_campaign(model::GoalDirection direction, int goals, std::uint64_t seed) {
    CampaignResult all;
    all.goals = goals;
    Noise noise(seed);
    for (int i = 0; i < goals; ++i) {
        const auto side = [&] { return 20 * (noise.uniform() - noise.uniform()); };  // goal less start
        const auto angle = [&] { return kPi * (2 * noise.uniform() - 1); };
        const PoseGoal goal{side(), side(), angle(), angle(), direction};
        const PoseOutcome out = run_pose_goal(goal, seed * 1'000'003 + static_cast<std::uint64_t>(i), 0.001);
        if (!out.arrived) {
            if (all.arrived == i) all.first_failure = static_cast<std::uint64_t>(i);
            continue;
        }
        ++all.arrived;
        all.mean_s += (out.time_s - all.mean_s) / all.arrived;
        all.slowest_s = std::max(all.slowest_s, out.time_s);
        all.worst_position_m = std::max(all.worst_position_m, out.position_error_m);
        all.worst_heading_rad = std::max(all.worst_heading_rad, out.heading_error_rad);
        all.worst_span_Nm = std::max(all.worst_span_Nm, out.torque_span_Nm);
        all.worst_step_Nm = std::max(all.worst_step_Nm, out.torque_step_Nm);
        all.worst_wrong_way_m = std::max(all.worst_wrong_way_m, out.wrong_way_m);
    }
    return all;
}

}  // namespace bench
