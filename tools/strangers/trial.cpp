#include "tools/strangers/trial.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <stdexcept>

#include "firmware/protocol/wheelwright_messages.hpp"

namespace wheelwright::tools {
namespace {

constexpr double kStepShare = 0.3;         // of the speed gained in the settling time at full torque
constexpr double kStepShareOfLimit = 0.5;  // and of the speed limit at most
constexpr double kSettledWithin = 0.01;
constexpr double kRippleInBand = 4;
constexpr double kKnownError = 0.025;  // a standard error from which on K7 or K8 counts as known
constexpr double kAdaptation_s = 5;    // after a load comes or goes, at least; and half a lap

FourValues four(const model::Dynamics<double>& k) {
    return {k.k5_m, k.k6_per_m, k.k7_per_kg_m, k.k8_per_kg_m2};
}

// Faults that no file can say.
void apply_fault(Simulation& sim, const DrawnRobot& robot) {
    if (robot.fault == RobotFault::encoder_against_torque)
        sim.world().drive(robot.fault_side).reverse_encoder();
    if (robot.fault != RobotFault::wheel_in_air) return;
    sim::PlantParameters p = sim.world().plant().parameters();
    (robot.fault_side == 0 ? p.lifted.left : p.lifted.right) = true;
    p.wheel_inertia_kg_m2 = robot.truth.mass->wheel_inertia_kg_m2;
    sim.world().plant().set_parameters(p);
}

void identify_robot(Simulation& sim, RobotResult& result) {
    const IdentificationResult found = identify(sim);
    result.end = end_of(sim);
    result.identified = found.succeeded;
    result.duration_s = found.duration_s;
    result.farthest_m = found.farthest_m;
    result.fastest_m_per_s = found.fastest_m_per_s;
    result.fastest = found.fastest;
    result.probe_s = found.probe_s;
    result.clipped_s = found.clipped_s;
    result.delay_s = found.delay_s;
    result.truth = four(seen_truth(result.robot, sim.world().plant().actual()));
    result.estimate = four(found.estimate.dynamics);
    result.standard_error = four(found.estimate.standard_error);
}

// What both drives can do beyond dry friction, as accelerations.
TwistRate<double> peak_acceleration(const DrawnRobot& robot) {
    const model::RobotParameters& truth = robot.truth.parameters;
    const auto& dry = truth.effects.parameter[model::find_effect("coulomb_friction")];
    const double gain = std::min(truth.drive.left.torque_scale, truth.drive.right.torque_scale);
    const double wheel_Nm =
        gain * robot.torque_share * robot.believed.parameters.limits.torque_Nm - std::max(dry[0], dry[1]);
    return {2 * wheel_Nm * truth.dynamics.k7_per_kg_m, 2 * wheel_Nm * truth.dynamics.k8_per_kg_m2};
}

StepJudged judged_step(Simulation& sim, double v_m_per_s, double omega_rad_per_s, double hold_s) {
    const StepResponse response = velocity_step(sim, {v_m_per_s, omega_rad_per_s}, hold_s);
    const std::vector<double>& y = v_m_per_s != 0 ? response.v_m_per_s : response.omega_rad_per_s;
    StepJudged judged;
    judged.step = v_m_per_s + omega_rad_per_s;
    double squares = 0;
    for (std::size_t i = y.size() / 2; i < y.size(); ++i) squares += std::pow(y[i] / judged.step - 1, 2);
    judged.ripple =
        std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, y.size() - y.size() / 2)));
    // The encoder's noise that the loop hands on is no part of settling: it is judged by itself.
    const double band = kSettledWithin + kRippleInBand * judged.ripple;
    for (std::size_t i = 0; i < y.size(); ++i) {
        const double error = y[i] / judged.step - 1;
        if (std::abs(error) > band) judged.settling_s = response.time_s[i];
        judged.overshoot = std::max(judged.overshoot, error - kRippleInBand * judged.ripple);
    }
    return judged;
}

void drive_steps(Simulation& sim, const DrawnRobot& robot, Driving& driving) {
    const double time_s = driving.settling_aim_s;
    const TwistRate<double> peak = peak_acceleration(robot);
    const auto& limits = sim.parameters().limits;
    using Command = protocol::VelocityCommand;
    // A whole number of the frame's steps: what the robot is asked for is what it is judged by.
    const auto size = [&](double acceleration, double limit, double frame_step) {
        const double wanted = std::min(kStepShare * acceleration * time_s, kStepShareOfLimit * limit);
        return frame_step * std::max(1.0, std::round(wanted / frame_step));
    };
    const double v = size(peak.v_m_per_s2, limits.speed_m_per_s, Command::forward_speed_m_per_s_step);
    const double omega =
        size(peak.omega_rad_per_s2, limits.yaw_rate_rad_per_s, Command::yaw_rate_rad_per_s_step);
    driving.forward = judged_step(sim, v, 0, 10 * time_s);
    driving.turning = judged_step(sim, 0, omega, 10 * time_s);
}

TrackingOptions figure_eight(Simulation& sim, protocol::Mode mode, const DrawnRobot& robot) {
    TrackingOptions options;
    options.mode = mode;
    options.path = control::standard_figure_eight<double>(sim.parameters());
    options.external_poses = robot.external_pose;
    // beside the path's start, across the way it leads
    sim.world().plant().place({-options.path.length_m / 20, options.path.length_m / 20, 0}, {});
    sim.run_for(0.2);
    return options;
}

void drive_figure_eight(Simulation& sim, const DrawnRobot& robot, Driving& driving) {
    TrackingOptions options = figure_eight(sim, protocol::Mode::trajectory, robot);
    options.judge_from_s = options.path.period_s;
    options.duration_s = 3 * options.path.period_s;
    const TrackingResult result = track(sim, options);
    driving.tracked = result.entered;
    driving.true_rms_share = result.rms_m / options.path.length_m;
    double sum = 0;
    std::size_t judged = 0;
    for (const PathSample& sample : result.samples) {
        if (sample.time_s < options.judge_from_s * result.pace.period_s / options.path.period_s) continue;
        // Wheels alone cannot tell where the robot is, only where they believe it to be.
        const Pose<double>& is = robot.external_pose ? sample.truth : sample.believed;
        const double distance = std::hypot(is.x_m - sample.reference.x_m, is.y_m - sample.reference.y_m);
        sum += distance * distance;
        ++judged;
        driving.peak_share = std::max(driving.peak_share, distance / options.path.length_m);
    }
    if (judged > 0) driving.rms_share = std::sqrt(sum / static_cast<double>(judged)) / options.path.length_m;
}

// What adaptation says of K7 and K8 now.
LoadJudged judged_now(Simulation& sim, const DrawnRobot& robot) {
    LoadJudged judged;
    const task::Learning& learning = sim.cycle().learning();
    const FourValues truth = four(seen_truth(robot, sim.world().plant().actual()));
    const FourValues value = four(learning.estimate().dynamics);
    const FourValues sigma = four(learning.estimate().standard_error);
    for (std::size_t k = 0; k < 4; ++k) {
        judged.error[k] = value[k] / truth[k] - 1;
        judged.sigma[k] = sigma[k] / std::abs(value[k]);
    }
    judged.frozen = learning.adaptation_frozen();
    return judged;
}

// A payload comes and goes. Returns the RMS distance from the reference since it came, over the figure's
// length.
double drive_with_payload(Simulation& sim, const DrawnRobot& robot, protocol::Mode mode, Driving& driving) {
    TrackingOptions options = figure_eight(sim, mode, robot);
    const double wait_s = std::max(kAdaptation_s, options.path.period_s / 2);
    const double load_s = 1.5 * options.path.period_s;
    const bool adaptive = mode == protocol::Mode::adaptive;
    options.duration_s = load_s + 2 * wait_s + 0.1;
    int stage = 0;
    options.event = [&](Simulation& now, double time_s) {
        if (time_s < load_s + stage * wait_s || now.cycle().supervisor().mode() != mode) return;
        sim::Payload load = robot.payload;
        if (stage == 0) now.world().plant().add_payload(load);
        if (stage == 1) {
            if (adaptive) driving.loaded = judged_now(now, robot);
            load.mass_kg *= -1;  // taken off
            load.inertia_kg_m2 *= -1;
            now.world().plant().add_payload(load);
        }
        if (stage == 2 && adaptive) {
            driving.unloaded = judged_now(now, robot);
            driving.adapted = true;
        }
        if (stage < 3) ++stage;
    };
    const TrackingResult result = track(sim, options);
    double sum = 0;
    std::size_t judged = 0;
    for (const PathSample& sample : result.samples) {
        if (sample.time_s < load_s) continue;
        const Pose<double>& is = robot.external_pose ? sample.truth : sample.believed;
        sum += std::pow(is.x_m - sample.reference.x_m, 2) + std::pow(is.y_m - sample.reference.y_m, 2);
        ++judged;
    }
    return judged > 0 ? std::sqrt(sum / static_cast<double>(judged)) / options.path.length_m : NAN;
}

// What the velocity loops are designed for; where nobody has said it, what the design has come to.
double designed_settling_s(const Simulation& sim, const model::RobotParameters& parameters) {
    const double asked_s = parameters.velocity_loop.settling_time_s;
    if (asked_s > 0) return asked_s;
    return sim.cycle().control().design().result().settling_s / control::LoopDesign<double>::kSettlingShare;
}

Driving drive_robot(Simulation& sim, const DrawnRobot& robot) {
    Driving driving;
    sim.host().velocity({});
    if (!enter_mode(sim, protocol::Mode::velocity)) {
        driving.blocker = to_string_view(sim.cycle().supervisor().blocker());
        return driving;
    }
    driving.settling_aim_s = designed_settling_s(sim, sim.parameters());
    drive_steps(sim, robot, driving);
    drive_figure_eight(sim, robot, driving);
    driving.load_rms_share = drive_with_payload(sim, robot, protocol::Mode::trajectory, driving);
    driving.adaptive_rms_share = drive_with_payload(sim, robot, protocol::Mode::adaptive, driving);
    return driving;
}

}  // namespace

double RobotResult::worst_error() const { return std::max(std::abs(error(2)), std::abs(error(3))); }

double LoadJudged::worst_error() const { return std::max(std::abs(error[2]), std::abs(error[3])); }

bool LoadJudged::known() const { return std::max(sigma[2], sigma[3]) <= kKnownError; }

bool LoadJudged::wrong(double most) const {
    return (sigma[2] <= kKnownError && !(std::abs(error[2]) <= most)) ||
           (sigma[3] <= kKnownError && !(std::abs(error[3]) <= most));
}

std::string end_of(const Simulation& sim) {
    const supervisor::Supervisor& supervisor = sim.cycle().supervisor();
    if (supervisor.mode() == protocol::Mode::fault)
        return "fault_" + std::string(to_string_view(supervisor.fault()));
    const ident::IdentificationRun<double>& run = sim.cycle().learning().run();
    if (run.elapsed_s() == 0) return "refused_" + std::string(to_string_view(supervisor.blocker()));
    if (!run.finished()) return "not_finished";
    return std::string(to_string_view(run.cause()));
}

SimulationOptions simulation_options(const DrawnRobot& robot) {
    SimulationOptions options;
    options.seed = robot.simulation_seed;
    options.world = world_options(robot.truth.simulation, options.seed);
    return options;
}

model::Dynamics<double> seen_truth(const DrawnRobot& robot, const sim::PlantParameters& plant) {
    const auto& drive = robot.truth.parameters.drive;
    const model::Geometry<double>& file = robot.believed.parameters.geometry;
    const double half_track = plant.geometry.track_m / 2;
    const double determinant =
        plant.mass_kg * plant.inertia_kg_m2 - plant.mass_coupling_kg_m * plant.mass_coupling_kg_m;
    // Accelerations by force and yaw torque, and as the file's geometry makes them of the wheels'.
    const auto response = [&](double force_N, double yaw_Nm) {
        const Twist<double> truly{
            (plant.inertia_kg_m2 * force_N - plant.mass_coupling_kg_m * yaw_Nm) / determinant,
            (plant.mass_kg * yaw_Nm - plant.mass_coupling_kg_m * force_N) / determinant};
        return model::twist_from_wheel_speeds(file, model::wheel_speeds_from_twist(plant.geometry, truly));
    };
    const auto by_torque = [&](double left_Nm, double right_Nm) {
        const double left_N = drive.left.torque_scale * left_Nm / plant.geometry.wheel_radius_m.left;
        const double right_N = drive.right.torque_scale * right_Nm / plant.geometry.wheel_radius_m.right;
        return response(left_N + right_N, half_track * (right_N - left_N));
    };
    const auto by_motion = [&](const Twist<double>& seen) {
        const Twist<double> truly =
            model::twist_from_wheel_speeds(plant.geometry, model::wheel_speeds_from_twist(file, seen));
        return response(plant.centrifugal_kg_m * truly.omega_rad_per_s * truly.omega_rad_per_s,
                        plant.coriolis_kg_m * truly.v_m_per_s * truly.omega_rad_per_s);
    };
    return {by_motion({0, 1}).v_m_per_s,
            (by_motion({1, 1}).omega_rad_per_s - by_motion({1, -1}).omega_rad_per_s) / 2,
            by_torque(0.5, 0.5).v_m_per_s, by_torque(-0.5, 0.5).omega_rad_per_s};
}

RobotResult run_trial(const DrawnRobot& robot, const TrialOptions& options) {
    RobotResult result;
    result.robot = robot;
    try {
        SimulationOptions settings = simulation_options(robot);
        settings.log_path = options.log_path;
        Simulation sim(robot.believed.parameters, robot.truth.parameters, settings);
        if (sim.log_failed()) throw std::runtime_error("cannot write " + options.log_path);
        apply_fault(sim, robot);
        sim.run_for(0.5);
        identify_robot(sim, result);
        if (result.identified && options.drive) result.driving = drive_robot(sim, robot);
        if (sim.log_failed()) throw std::runtime_error(options.log_path + " could not be written whole");
    } catch (const std::exception& error) {
        result.problem = error.what();
    }
    return result;
}

}  // namespace wheelwright::tools
