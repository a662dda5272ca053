#include "tools/gap/report/closed_loop.hpp"

#include <stdexcept>

#include "tools/gap/report/robot_files.hpp"
#include "tools/sim/experiments.hpp"

namespace wheelwright::gap {
namespace {

constexpr std::size_t kKeepEvery = 10;  // of the hundred samples a second

FigureEight figure_eight(const ClosedLoopSetup& setup, const model::RobotParameters& believed) {
    tools::SimulationOptions options;
    options.seed = setup.seed;
    options.world = tools::world_options(setup.plant.simulation, setup.seed);
    // With the default noise of 2 mm the pose sensor's error would hide the controller's.
    options.world.external_pose_noise_m = 0;
    options.world.external_heading_noise_rad = 0;
    tools::Simulation sim(believed, setup.plant.parameters, options);
    sim.run_for(0.5);
    // one metre beside the path's start, as everywhere
    sim.world().plant().place({0, 1, 0}, {});
    sim.run_for(0.2);
    tools::TrackingOptions path;
    path.path = control::standard_figure_eight<double>(sim.parameters());
    const tools::TrackingResult drive = tools::track(sim, path);
    FigureEight result;
    result.driven = drive.entered;
    const protocol::Fault fault = sim.cycle().supervisor().fault();
    if (fault != protocol::Fault::none) result.stopped = std::string(to_string_view(fault));
    result.driven = result.driven && result.stopped.empty();
    result.rms_m = drive.rms_m;
    result.peak_m = drive.peak_m;
    for (std::size_t i = 0; i < drive.samples.size(); i += kKeepEvery) {
        const tools::PathSample& s = drive.samples[i];
        result.t_s.push_back(s.time_s);
        result.error_m.push_back(s.error_m);
        result.x_m.push_back(s.truth.x_m);
        result.y_m.push_back(s.truth.y_m);
        result.reference_x_m.push_back(s.reference.x_m);
        result.reference_y_m.push_back(s.reference.y_m);
    }
    return result;
}

}  // namespace

ClosedLoopSetup closed_loop_setup(const Findings& f, const Request& request) {
    ClosedLoopSetup setup;
    setup.nominal = request.robot;
    const auto believing = [](const std::string& text) {
        const ReadBack back = read_back(text, "");
        if (!back.file) throw std::runtime_error(back.problem);
        return back.file->parameters;
    };
    setup.before = believing(f.before_file);
    setup.after = believing(f.extended_file);
    setup.plant.parameters = setup.after;
    setup.plant.simulation = task::default_simulation();
    return setup;
}

void set_truth(ClosedLoopSetup& setup, const task::RobotFile& plant) {
    setup.plant = plant;
    setup.truth = setup.after;
    setup.truth->dynamics =
        tools::as_seen_with(plant.parameters.dynamics, plant.parameters.geometry, setup.after.geometry);
    setup.truth->effects = plant.parameters.effects;
}

ClosedLoop close_loop(const ClosedLoopSetup& setup) {
    ClosedLoop loop;
    setup.progress("figure-8 before and after");
    if (setup.nominal) loop.nominal = figure_eight(setup, *setup.nominal);
    loop.before = figure_eight(setup, setup.before);
    loop.after = figure_eight(setup, setup.after);
    loop.truth_known = setup.truth.has_value();
    if (setup.truth) loop.truth = figure_eight(setup, *setup.truth);
    return loop;
}

}  // namespace wheelwright::gap
