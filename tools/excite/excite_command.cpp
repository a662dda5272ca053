// `wheelwright excite`: drives the motion that `wheelwright gap` has advised, through the firmware.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <stdexcept>

#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/report.hpp"
#include "tools/cli/robots.hpp"
#include "tools/ctl/link.hpp"
#include "tools/excite/excitation.hpp"
#include "tools/sim/experiments.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    std::string advice, robot = example_robot("default.toml"), plant, log, interface, json;
    std::uint64_t seed = 1;
    std::size_t which = 1;
    int rounds = excite::kUsualRounds;
    std::string key;
    bool yes = false;
};

int complain(int status, const std::string& text) {
    std::fprintf(stderr, "wheelwright excite: %s\n", text.c_str());
    return status;
}

void describe(const excite::Advice& advice, const excite::Excitation& e, Report& report) {
    report.section("motion", "To tell " + advice.tell + " from " + advice.from);
    report.add("name", "motion", std::string(e.motion->name), "", std::string(e.motion->words));
    report.add("torque_Nm", "size", e.size_Nm, "Nm",
               e.size_Nm < advice.torque_Nm
                   ? "advised " + number_text(advice.torque_Nm, 3) + "; the robot's limits ask for less"
                   : "");
    report.add("rounds", "rounds", std::int64_t{e.rounds}, "", "each other one with opposite torques");
    report.add("duration_s", "time", e.duration_s(), "s");
    report.add("largest_torque_Nm", "largest torque", e.torque_Nm, "Nm");
    report.add("speed_m_per_s", "largest speed, by the model", e.speed_m_per_s, "m/s");
    report.add("yaw_rate_rad_per_s", "largest yaw rate, by the model", e.yaw_rate_rad_per_s, "rad/s");
    report.add("farthest_m", "room needed around the start, by the model", e.farthest_m, "m");
}

int simulate(const Options& options, const task::RobotFile& robot, const excite::Excitation& e) {
    const task::RobotFile plant = load_robot(options.plant);
    SimulationOptions settings;
    settings.seed = options.seed;
    settings.world = world_options(plant.simulation, options.seed);
    settings.log_path = options.log;
    Simulation sim(robot.parameters, plant.parameters, settings);
    if (sim.log_failed()) return complain(kMachineLacks, "cannot write " + options.log);
    sim.run_for(0.5);
    const std::string stopped = excite::drive_excitation(sim, e);
    if (sim.log_failed()) return complain(kMachineLacks, options.log + " could not be written whole");
    if (!stopped.empty()) return complain(kAimMissed, stopped);
    std::printf("\nDriven; the bus is in %s.\n", options.log.c_str());
    return kDone;
}

// Set-points of one round; kDone when it was driven to its end.
int drive_round(Link& link, const excite::Excitation& e, int round) {
    protocol::TorqueCommand setpoint;
    if (const int status = link.send(command_of(setpoint)); status != kDone) return status;
    link.forget_received();
    if (const int status = link.ask(protocol::Mode::torque); status != kDone) return status;
    ModeWatch watch(protocol::Mode::torque, can_now_ns());
    const auto period_ns = static_cast<std::int64_t>(1e9 * excite::kSetpointPeriod_s);
    std::int64_t due_ns = can_now_ns();
    for (int i = 0; i < std::lround(excite::kMotion_s / excite::kSetpointPeriod_s);) {
        const WheelPair<double> torque =
            watch.entered() ? e.torque_at(round, i++ * excite::kSetpointPeriod_s) : WheelPair<double>{};
        setpoint.left_torque_Nm = torque.left;
        setpoint.right_torque_Nm = torque.right;
        if (const int status = link.send(command_of(setpoint)); status != kDone) return status;
        due_ns = std::max(due_ns + period_ns, can_now_ns());
        if (!watch.follow(link, due_ns) || interrupted()) break;
        if (e.too_fast({link.body().forward_speed_m_per_s, link.body().yaw_rate_rad_per_s})) break;
    }
    return watch.result(link);
}

int halt(Link& link) {
    if (const int status = link.send(command_of(protocol::VelocityCommand{})); status != kDone) return status;
    if (const int status = link.ask(protocol::Mode::velocity); status != kDone) return status;
    const std::int64_t end_ns = can_now_ns() + static_cast<std::int64_t>(1e9 * excite::kHalt_s);
    while (can_now_ns() < end_ns && !interrupted()) {
        if (const int status = link.send(command_of(protocol::VelocityCommand{})); status != kDone)
            return status;
        sleep_until(can_now_ns() + static_cast<std::int64_t>(1e9 * excite::kSetpointPeriod_s));
    }
    return kDone;
}

int drive(const Options& options, const excite::Excitation& e) {
    if (!options.yes) {
        std::printf("\nThe robot will drive this now. Is there room? [y/N] ");
        std::fflush(stdout);
        if (const int answer = std::getchar(); answer != 'y' && answer != 'Y') {
            return complain(kAimMissed, "not driven");
        }
    }
    const LinkOptions to{options.interface, -1, options.key, "wheelwright excite"};
    catch_interrupt();
    Link link(to);
    if (const int status = link.open(); status != kDone) return status;
    int status = kDone;
    for (int round = 0; round < e.rounds && status == kDone && !interrupted(); ++round) {
        status = drive_round(link, e, round);
        if (status == kDone) status = halt(link);
    }
    const int idle = link.ask(protocol::Mode::idle);
    Link::leave_slot();
    if (interrupted()) return complain(kAimMissed, "interrupted");
    if (status == kDone) std::printf("\nDriven.\n");
    return status != kDone ? status : idle;
}

int excite(const Options& options) {
    const excite::AdviceFile file = excite::read_advice(options.advice);
    if (!file.problem.empty()) return complain(kBadInput, file.problem);
    if (options.which < 1 || options.which > file.advice.size()) {
        return complain(kUsage, "--which: there are " + std::to_string(file.advice.size()) + " advices");
    }
    const bool simulated = !options.plant.empty();
    if (simulated != options.interface.empty()) {
        return complain(kUsage, "either --plant FILE (with --log FILE) or --can NAME says what to drive");
    }
    if (simulated && options.log.empty()) return complain(kUsage, "--plant needs --log FILE");
    try {
        const task::RobotFile robot = load_robot(options.robot);
        if (!(robot.parameters.dynamics.k7_per_kg_m > 0) || !(robot.parameters.dynamics.k8_per_kg_m2 > 0)) {
            return complain(kUsage,
                            options.robot + " holds no K7 and K8: nothing foretells where the motion leads");
        }
        const excite::Advice& advice = file.advice[options.which - 1];
        const excite::Excitation e = excite::plan_excitation(advice, robot.parameters, options.rounds);
        Report report("excite");
        describe(advice, e, report);
        if (!report.publish(options.json)) return kMachineLacks;
        return simulated ? simulate(options, robot, e) : drive(options, e);
    } catch (const std::runtime_error& error) {
        std::fputs(error.what(), stderr);
        return kUsage;
    }
}

}  // namespace

void add_excite(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command =
        program.add_subcommand("excite", "Drive the motion that `gap` has advised, to tell rivals apart");
    command.footer(
        "With --plant in virtual time, on a simulated robot; with --can on a robot, whose bus\n"
        "`wheelwright record` writes down meanwhile. Then give `wheelwright gap` both logs.\n"
        "Exit status 3: the robot left the motion, and why.");
    command.add_option("--advice", options->advice, "gap.json of `wheelwright gap`").required();
    command.add_option("--which", options->which, "Number of the advice in it").show_default();
    command.add_option("--robot", options->robot, "Robot file of the firmware: limits and model")
        .show_default();
    command.add_option("--rounds", options->rounds, "How often the motion is driven, 1 to 100")
        .check(from_to("1", "100"))
        .show_default();
    command.add_option("--plant", options->plant, "Robot file of a simulated robot's truth");
    command.add_option("--log", options->log, "With --plant: the bus, as candump -L writes it");
    command.add_option("--seed", options->seed, "With --plant: seed of noise and phases").show_default();
    command.add_option("--can", options->interface, "CAN interface of the robot");
    command.add_option("--key", options->key,
                       "With --can: key file, if the robot asks for it before it arms");
    command.add_flag("--yes", options->yes, "With --can: do not ask before driving");
    command.add_option("--json", options->json, "Also write the figures to this file");
    command.callback([options, &run] { run = [options] { return excite(*options); }; });
}

}  // namespace wheelwright::tools
