#include "tools/sim/experiments.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace wheelwright::tools {
namespace {

constexpr double kLongestEntry_s = 3;

void come_to_rest(Simulation& sim) {
    sim.host().silence();
    enter_mode(sim, protocol::Mode::idle);
    sim.run_for(0.3);
}

// `pose`, had its history begun at `now` instead of at `then`.
Pose<double> moved(const Pose<double>& pose, const Pose<double>& then, const Pose<double>& now) {
    const double turn = now.heading_rad - then.heading_rad;
    const double dx = pose.x_m - then.x_m;
    const double dy = pose.y_m - then.y_m;
    return {now.x_m + std::cos(turn) * dx - std::sin(turn) * dy,
            now.y_m + std::sin(turn) * dx + std::cos(turn) * dy, pose.heading_rad + turn};
}

double distance(const Pose<double>& a, const Pose<double>& b) {
    return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m);
}

double fastest_rim_m_per_s(Simulation& sim) {
    const WheelPair<double>& wheel = sim.world().plant().wheel_speed_rad_per_s();
    const WheelPair<double>& radius = sim.world().plant().actual().geometry.wheel_radius_m;
    return std::max(std::abs(wheel.left * radius.left), std::abs(wheel.right * radius.right));
}

}  // namespace

task::RobotFile load_robot(const std::string& path) {
    task::RobotFileResult result = task::read_robot_file(path);
    if (result.robot) return *result.robot;
    std::string message;
    for (const task::Diagnostic& problem : result.problems) message += task::to_text(problem) + "\n";
    throw std::runtime_error(message);
}

model::Dynamics<double> as_seen_with(const model::Dynamics<double>& truth,
                                     const model::Geometry<double>& true_geometry,
                                     const model::Geometry<double>& believed_geometry) {
    // Believed speeds are v' = p v and omega' = q omega.
    const double p = believed_geometry.mean_radius_m() / true_geometry.mean_radius_m();
    const double q = p * true_geometry.track_m / believed_geometry.track_m;
    return {truth.k5_m * p / (q * q), truth.k6_per_m / p, truth.k7_per_kg_m * p, truth.k8_per_kg_m2 * q};
}

bool enter_mode(Simulation& sim, protocol::Mode mode) {
    sim.host().mode(mode);
    sim.run_until(
        [&] {
            const auto& supervisor = sim.cycle().supervisor();
            return (supervisor.mode() == mode && supervisor.phase() == supervisor::Phase::steady) ||
                   supervisor.mode() == protocol::Mode::fault;
        },
        kLongestEntry_s);
    return sim.cycle().supervisor().mode() == mode;
}

IdentificationResult identify(Simulation& sim, const Progress& progress) {
    IdentificationResult result;
    const Pose<double> start = sim.world().pose();
    if (!enter_mode(sim, protocol::Mode::ident)) return result;
    const double begin_s = sim.time_s();
    std::int64_t cycle = 0;
    const double longest_s = sim.parameters().ident.duration_s + 2;
    sim.run_until([&] { return sim.cycle().supervisor().mode() != protocol::Mode::ident; }, longest_s,
                  [&] {
                      result.farthest_m = std::max(result.farthest_m, distance(sim.world().pose(), start));
                      result.fastest_m_per_s = std::max(result.fastest_m_per_s, fastest_rim_m_per_s(sim));
                      const Twist<double>& truly = sim.world().twist();
                      result.fastest.v_m_per_s =
                          std::max(result.fastest.v_m_per_s, std::abs(truly.v_m_per_s));
                      result.fastest.omega_rad_per_s =
                          std::max(result.fastest.omega_rad_per_s, std::abs(truly.omega_rad_per_s));
                      const auto& run = sim.cycle().learning().run();
                      if (run.state() == ident::IdentState::probing) result.probe_s = sim.time_s() - begin_s;
                      if (result.clipped_s == 0 && run.findings().clipped)
                          result.clipped_s = sim.time_s() - begin_s;
                      if (cycle++ % 100 != 0) return;
                      const auto& estimate = sim.cycle().learning().estimate();
                      result.time_s.push_back(sim.time_s() - begin_s);
                      result.value.push_back(estimate.dynamics);
                      result.standard_error.push_back(estimate.standard_error);
                      if (progress) progress(sim.cycle().learning().progress());
                  });
    result.duration_s = sim.time_s() - begin_s;
    result.succeeded = sim.cycle().learning().identification_succeeded();
    result.estimate = sim.cycle().learning().estimate();
    result.delay_s = sim.parameters().velocity_loop.actuation_delay_s;
    sim.run_for(0.5);  // the loops are designed in slices
    return result;
}

StepResponse velocity_step(Simulation& sim, const Twist<double>& step, double hold_s) {
    StepResponse result;
    sim.host().velocity({});
    if (!enter_mode(sim, protocol::Mode::velocity)) return result;
    sim.run_for(0.2);
    sim.host().velocity(step);
    const double begin_s = sim.cycle_time_s();
    sim.run_for(hold_s, [&] {
        const Twist<double>& u = sim.world().twist();
        result.time_s.push_back(sim.cycle_time_s() - begin_s);
        result.v_m_per_s.push_back(u.v_m_per_s);
        result.omega_rad_per_s.push_back(u.omega_rad_per_s);
    });
    const bool forward = step.v_m_per_s != 0;
    const double wanted = forward ? step.v_m_per_s : step.omega_rad_per_s;
    const std::vector<double>& y = forward ? result.v_m_per_s : result.omega_rad_per_s;
    for (std::size_t i = 0; i < y.size(); ++i) {
        if (std::abs(y[i] / wanted - 1) > 0.01) result.settling_s = result.time_s[i];
        result.overshoot = std::max(result.overshoot, y[i] / wanted - 1);
    }
    come_to_rest(sim);
    return result;
}

TrackingResult track(Simulation& sim, const TrackingOptions& options, const Progress& progress) {
    TrackingResult result;
    // One external pose tells where the robot starts; more of them only where they are asked for.
    sim.host().external_poses(options.external_poses);
    sim.host().external_pose(sim.world().pose());
    sim.run_for(0.1);
    protocol::TrajectoryCommand command;
    command.shape = static_cast<protocol::TrajectoryShape>(options.path.kind);
    command.length_m = options.path.length_m;
    command.width_m = options.path.width_m;
    command.period_s = options.path.period_s;
    sim.host().trajectory(command);
    if (!enter_mode(sim, options.mode)) return result;
    const auto started = [&] { return sim.cycle().control().trajectory_start_ns() != 0; };
    if (!sim.run_until(started, 1)) return result;
    result.entered = true;
    result.pace = sim.cycle().report().pace;
    const double stretch = result.pace.period_s / options.path.period_s;
    control::PathSettings<double> path = options.path;
    path.period_s *= stretch;
    path.ramp_s *= stretch;
    const std::int64_t start_ns = sim.cycle().control().trajectory_start_ns();
    const Pose<double> bare_start = sim.cycle().odometry().bare_pose();
    const Pose<double> true_start = sim.world().pose();
    double sum = 0;
    std::int64_t judged = 0;
    std::int64_t cycle = 0;
    sim.run_for(stretch * options.duration_s, [&] {
        const double time_s = 1e-9 * static_cast<double>(sim.now_ns() - start_ns);
        if (options.event) options.event(sim, time_s);
        // The judge's own lemniscate, not the firmware's generator.
        const double phase = 2 * std::numbers::pi * time_s / path.period_s;
        Pose<double> reference;
        if (path.kind == control::PathKind::figure_eight) {
            const double x_rate = path.length_m / 2 * std::cos(phase);
            const double y_rate = path.width_m * std::cos(2 * phase);
            reference = {path.length_m / 2 * std::sin(phase), path.width_m / 2 * std::sin(2 * phase),
                         std::atan2(y_rate, x_rate)};
        } else {
            reference = control::path_point(path, time_s).pose;
        }
        const double error = distance(sim.world().pose(), reference);
        const auto& torque = sim.cycle().report().torque_Nm;
        result.largest_torque_Nm =
            std::max({result.largest_torque_Nm, std::abs(torque.left), std::abs(torque.right)});
        if (time_s >= stretch * options.judge_from_s) {
            sum += error * error;
            ++judged;
            result.peak_m = std::max(result.peak_m, error);
        }
        if (cycle++ % 10 == 0) {
            result.samples.push_back({time_s, reference, sim.world().pose(), sim.cycle().odometry().pose(),
                                      moved(sim.cycle().odometry().bare_pose(), bare_start, true_start),
                                      error, torque});
            if (progress) progress(time_s / (stretch * options.duration_s));
        }
    });
    result.rms_m = judged > 0 ? std::sqrt(sum / static_cast<double>(judged)) : 0;
    come_to_rest(sim);
    sim.host().external_poses(true);
    return result;
}

GoalResult drive_to(Simulation& sim, const Pose<double>& goal, protocol::PoseDirection direction,
                    double at_most_s, double tolerance_m) {
    GoalResult result;
    sim.host().goal(goal, direction);
    if (!enter_mode(sim, protocol::Mode::pose)) return result;
    const double begin_s = sim.time_s();
    double there_since_s = -1;
    WheelPair<double> last = sim.cycle().report().torque_Nm;
    result.reached = sim.run_until(
        [&] {
            const Pose<double>& pose = sim.world().pose();
            result.distance_m = distance(pose, goal);
            result.heading_error_rad = wrap_angle_rad(pose.heading_rad - goal.heading_rad);
            const WheelPair<double> torque = sim.cycle().report().torque_Nm;
            const double change =
                std::max(std::abs(torque.left - last.left), std::abs(torque.right - last.right));
            last = torque;
            const bool there = result.distance_m <= tolerance_m &&
                               std::abs(result.heading_error_rad) <= std::numbers::pi / 180 &&
                               sim.cycle().report().status.goal_reached;
            if (!there) {
                there_since_s = -1;
                result.quiet_torque_Nm = 0;
                return false;
            }
            if (there_since_s < 0) there_since_s = sim.time_s();
            // The last braking torque fades within some tens of milliseconds.
            if (sim.time_s() - there_since_s > 0.2) {
                result.quiet_torque_Nm = std::max(result.quiet_torque_Nm, change);
            }
            return sim.time_s() - there_since_s >= 2;
        },
        at_most_s + 2);
    result.time_s = (there_since_s < 0 ? sim.time_s() : there_since_s) - begin_s;
    if (result.time_s > at_most_s) result.reached = false;
    return result;
}

void drop_payload(sim::World& world, double share) {
    sim::PlantParameters p = world.plant().parameters();
    p.mass_kg *= 1 + share;
    p.inertia_kg_m2 *= 1 + share;
    p.centrifugal_kg_m *= 1 + share;
    p.coriolis_kg_m *= 1 + share;
    world.plant().set_parameters(p);
}

}  // namespace wheelwright::tools
