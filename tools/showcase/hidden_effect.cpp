#include "tools/showcase/hidden_effect.hpp"

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <stdexcept>
#include <string_view>

#include "tools/gap/report/output.hpp"
#include "tools/gap/report/robot_files.hpp"

namespace wheelwright::tools {
namespace {

// What is drawn: sizes that matter on a robot of this kind, each between the two.
struct Drawable {
    std::string_view name;
    model::Parameters<double> from, to;
};
constexpr std::array kDrawable{
    Drawable{"quadratic_drag", {3}, {6}},
    Drawable{"slope", {0.03, 0.3}, {0.07, 2.8}},
    Drawable{"turning_scrub", {0.2}, {0.5}},
    Drawable{"torque_bias", {0.1, -0.15}, {0.2, -0.08}},
    Drawable{"torque_gain_mismatch", {0.08}, {0.2}},
};

// Between halts of the identification's shaking and these set-points, every effect above shows.
struct Leg {
    Twist<double> twist;
    double time_s;
};
constexpr std::array kLegs{Leg{{0.8, 0}, 1.5},   Leg{{-0.6, 1.5}, 1.5}, Leg{{1.3, -1}, 2},
                           Leg{{0.3, 2}, 1.5},   Leg{{-1.2, 0.5}, 2},   Leg{{0.9, -2}, 1.5},
                           Leg{{-0.3, -1}, 1.5}, Leg{{1.6, 0}, 2},      Leg{{-1.6, 0}, 2}};
constexpr double kAsGoodAsTruth = 1.1;  // figure-8 after, over that of a controller that knows the truth

// left over right
double radius_ratio(const model::Geometry<double>& geometry) {
    return geometry.wheel_radius_m.left / geometry.wheel_radius_m.right;
}

}  // namespace

void HiddenEffect::run(const task::RobotFile& robot, const std::string& robot_path,
                       const task::RobotFile& plant, std::uint64_t seed, const std::string& folder,
                       const Progress& progress) {
    const auto tell = [&](double share) {
        if (progress) progress(share);
    };
    std::mt19937_64 random(0x6A9 + seed);
    std::uniform_real_distribution<double> uniform(0, 1);
    const Drawable& drawn = kDrawable[random() % kDrawable.size()];
    effect = model::find_effect(drawn.name);
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        parameters[i] = drawn.from[i] + (drawn.to[i] - drawn.from[i]) * uniform(random);
    }
    task::RobotFile truth = plant;
    truth.parameters.effects.active[effect] = true;
    truth.parameters.effects.parameter[effect] = parameters;
    if (drawn.name == "torque_gain_mismatch") {
        // What the file's ratio of the wheel radii is off by shows in the wheels' forces, and once more in
        // the speeds that it makes of their turning.
        const double off = radius_ratio(truth.parameters.geometry) / radius_ratio(robot.parameters.geometry);
        parameters[0] = (1 + parameters[0]) * off * off - 1;
    }

    std::error_code failed;
    std::filesystem::create_directories(folder, failed);
    SimulationOptions options;
    options.seed = seed;
    options.world = world_options(plant.simulation, seed);
    options.log_path = folder + "/drive.log";
    {
        Simulation sim(robot.parameters, truth.parameters, options);
        if (sim.log_failed()) throw std::runtime_error(options.log_path + " cannot be written");
        sim.run_for(0.5);
        identify(sim);
        tell(0.4);
        for (const Leg& leg : kLegs) {
            sim.host().velocity(leg.twist);
            if (!enter_mode(sim, protocol::Mode::velocity)) break;
            sim.run_for(leg.time_s);
        }
        sim.host().silence();
        enter_mode(sim, protocol::Mode::idle);
        driven_s = sim.time_s();
    }
    tell(0.6);
    request.logs = {options.log_path};
    request.robot = robot.parameters;
    request.robot_text = gap::text_of_file(robot_path);
    request.geometry = robot.parameters.geometry;
    findings = gap::analyse(request);
    tell(0.8);
    if (!findings.problems.empty()) {
        problem = findings.problems.front();
        return;
    }
    gap::ClosedLoopSetup setup = gap::closed_loop_setup(findings, request);
    gap::set_truth(setup, truth);
    findings.closed_loop = gap::close_loop(setup);
    findings.closed_loop->plant = "the simulated robot that hides " + name();
    std::ofstream json(folder + "/gap.json");
    json << gap::json(findings, request);
    problem = gap::write_robots(findings, folder);
    gap::write_page(findings, request, folder + "/report.html");
    tell(1);
}

std::string HiddenEffect::name() const { return std::string(model::kEffects[effect].name); }

bool HiddenEffect::found() const {
    const gap::Search& s = findings.search;
    return problem.empty() && s.effects.size() == 1 && s.effects[0].effect == effect;
}

bool HiddenEffect::reached_its_aims() const {
    if (!found() || !findings.closed_loop) return false;
    const gap::ClosedLoop& loop = *findings.closed_loop;
    return loop.after.driven && loop.truth && loop.after.rms_m <= kAsGoodAsTruth * loop.truth->rms_m;
}

void HiddenEffect::add_to(Report& report) const {
    report.section("hidden_effect", "What the model lacked: " + name() + ", drawn at random");
    std::string named;
    for (const gap::NamedEffect& e : findings.effects) {
        named += (named.empty() ? "" : ", ") + std::string(model::kEffects[e.effect].name);
    }
    report.add("named", "named from the log alone", named.empty() ? std::string("nothing") : named, "",
               problem.empty() ? gap::verdict_name(findings.conclusion.verdict) : problem);
    if (found()) {
        const gap::NamedEffect& e = findings.effects[0];
        report.table("parameters", {{"name", "parameter"},
                                    {"true_value", "truth"},
                                    {"value", "found"},
                                    {"standard_error", "standard error"}});
        for (std::size_t j = 0; j < e.parameters.size(); ++j) {
            report.row({std::string(model::kEffects[effect].parameters[j].name), parameters[j],
                        e.parameters[j].value, e.parameters[j].standard_error});
        }
    }
    if (!findings.closed_loop) return;
    const gap::ClosedLoop& loop = *findings.closed_loop;
    if (!findings.heldout.empty()) {
        report.add("free_run_before_rad_s", "free run on unseen data, before",
                   findings.heldout.back().before.both, "rad/s");
        report.add("free_run_after_rad_s", "after", findings.heldout.back().after.both, "rad/s");
    }
    const auto mm = [](const gap::FigureEight& drive) { return 1e3 * drive.rms_m; };
    if (loop.nominal)
        report.add("figure_eight_given_mm", "figure-8, controller with the given model", mm(*loop.nominal),
                   "mm");
    report.add("figure_eight_before_mm", "K5..K8 fitted anew", mm(loop.before), "mm");
    report.add("figure_eight_after_mm", "with what was found", mm(loop.after), "mm");
    if (loop.truth) report.add("figure_eight_truth_mm", "with the truth itself", mm(*loop.truth), "mm");
}

}  // namespace wheelwright::tools
