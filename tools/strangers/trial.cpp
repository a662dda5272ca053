#include "tools/strangers/trial.hpp"

#include <algorithm>
#include <cmath>
#include <exception>

#include "firmware/protocol/wheelwright_messages.hpp"

namespace wheelwright::tools {
namespace {

FourValues four(const model::Dynamics<double>& k) {
    return {k.k5_m, k.k6_per_m, k.k7_per_kg_m, k.k8_per_kg_m2};
}

void identify_robot(Simulation& sim, RobotResult& result) {
    const IdentificationResult found = identify(sim);
    result.end = end_of(sim);
    result.identified = found.succeeded;
    result.duration_s = found.duration_s;
    result.farthest_m = found.farthest_m;
    result.fastest_m_per_s = found.fastest_m_per_s;
    result.delay_s = found.delay_s;
    result.truth = four(seen_truth(result.robot));
    result.estimate = four(found.estimate.dynamics);
    result.standard_error = four(found.estimate.standard_error);
}

}  // namespace

double RobotResult::worst_error() const { return std::max(std::abs(error(2)), std::abs(error(3))); }

std::string end_of(const Simulation& sim) {
    const supervisor::Supervisor& supervisor = sim.cycle().supervisor();
    if (supervisor.mode() == protocol::Mode::fault)
        return "fault_" + std::string(to_string_view(supervisor.fault()));
    const ident::IdentificationRun<double>& run = sim.cycle().learning().run();
    if (run.elapsed_s() == 0) return "refused_" + std::string(to_string_view(supervisor.blocker()));
    if (run.state() == ident::IdentState::done) return "identified";
    switch (run.limit()) {
        case ident::IdentLimit::none:
            return "not_finished";
        case ident::IdentLimit::time:
            return "time";
        case ident::IdentLimit::distance:
            return "distance";
        case ident::IdentLimit::speed:
            return "speed";
        case ident::IdentLimit::delay:
            return "delay";
    }
    return "unknown";
}

model::Dynamics<double> seen_truth(const DrawnRobot& robot) {
    const model::RobotParameters& truth = robot.truth.parameters;
    model::Dynamics<double> k =
        as_seen_with(truth.dynamics, truth.geometry, robot.believed.parameters.geometry);
    const double gain = (truth.drive.left.torque_scale + truth.drive.right.torque_scale) / 2;
    k.k7_per_kg_m *= gain;
    k.k8_per_kg_m2 *= gain;
    return k;
}

RobotResult run_trial(const DrawnRobot& robot, const TrialOptions& options) {
    RobotResult result;
    result.robot = robot;
    try {
        SimulationOptions settings;
        settings.seed = robot.simulation_seed;
        settings.world = world_options(robot.truth.simulation, settings.seed);
        settings.log_path = options.log_path;
        Simulation sim(robot.believed.parameters, robot.truth.parameters, settings);
        if (sim.log_failed()) throw std::runtime_error("cannot write " + options.log_path);
        sim.run_for(0.5);
        identify_robot(sim, result);
    } catch (const std::exception& error) {
        result.problem = error.what();
    }
    return result;
}

}  // namespace wheelwright::tools
