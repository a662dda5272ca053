// `wheelwright demo`: the main job from start to finish, on a simulated robot whose numbers the firmware does
// not know. Prints progress, then a table, and leaves a page with the plots.
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "hal/linux/realtime.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/report.hpp"
#include "tools/cli/robots.hpp"
#include "tools/showcase/demo_page.hpp"
#include "tools/showcase/hidden_effect.hpp"
#include "tools/showcase/main_job.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    std::string robot = example_robot("default.toml");
    std::string plant = example_robot("simulated.toml");
    std::string interface;
    std::string out = "build/demo";
    std::string json;
    std::uint64_t seed = 1;
    std::int64_t rest_us = 50;
};

// One line that grows while a stage works; on a terminal it is drawn again and again.
class ProgressLine {
  public:
    ProgressLine(int number, std::string name)
        : number_(number), name_(std::move(name)), terminal_(isatty(STDOUT_FILENO) != 0) {
        if (!terminal_) std::printf("  %d  %s\n", number_, name_.c_str());
        draw(0);
    }
    void operator()(double share) {
        const int now = static_cast<int>(share * kWidth);
        if (now != last_) draw(share);
        last_ = now;
    }
    void done(const std::string& outcome) {
        if (terminal_) std::printf("\r\033[K");
        if (terminal_) std::printf("  %d  %s\n", number_, name_.c_str());
        std::printf("     %s\n", outcome.c_str());
        std::fflush(stdout);
    }

  private:
    static constexpr int kWidth = 30;
    void draw(double share) const {
        if (!terminal_) return;
        const int full = std::clamp(static_cast<int>(share * kWidth), 0, kWidth);
        std::printf("\r\033[K  %d  %-46s [%s%s]", number_, name_.c_str(), std::string(full, '=').c_str(),
                    std::string(kWidth - full, ' ').c_str());
        std::fflush(stdout);
    }
    int number_;
    std::string name_;
    bool terminal_;
    int last_ = -1;
};

std::string text(const char* format, auto... values) {
    char buffer[256];
    std::snprintf(buffer, sizeof buffer, format, values...);
    return buffer;
}

// The words given, unless a fault stopped the robot.
std::string outcome(const Simulation& sim, const std::string& words) {
    const protocol::Fault fault = sim.cycle().supervisor().fault();
    if (fault == protocol::Fault::none) return words;
    return "stopped by the fault " + std::string(to_string_view(fault));
}

int demo(const Options& options) {
    task::RobotFile robot;
    task::RobotFile plant;
    try {
        robot = load_robot(options.robot);
        plant = load_robot(options.plant);
    } catch (const std::runtime_error& error) {
        std::fputs(error.what(), stderr);
        return kUsage;
    }
    SimulationOptions settings;
    settings.seed = options.seed;
    settings.world = world_options(plant.simulation, options.seed);
    settings.can_interface = options.interface;
    settings.rest_ns = 1000 * options.rest_us;

    std::printf(
        "The firmware drives a simulated robot whose mass, inertia, friction and delays it does not know: "
        "its\n"
        "robot file differs from the truth in every measured number. Between the two there are CAN frames "
        "only,\n"
        "on %s.\n\n",
        options.interface.empty() ? "an in-process bus, in virtual time"
                                  : (options.interface + ", in real time").c_str());

    const bool real_time = !options.interface.empty();
    if (real_time) {
        hal::RealtimeOptions realtime;
        realtime.priority = robot.parameters.realtime.priority;
        // It runs without, but a busy machine is then too late for some cycles.
        for (const hal::Refusal& refusal : hal::become_realtime(realtime)) {
            std::fprintf(stderr, "wheelwright demo: %s\n", refusal.sentence().c_str());
        }
    }

    MainJob job;
    std::int64_t missed_cycles = 0;
    try {
        Simulation sim(robot.parameters, plant.parameters, settings);
        sim.run_for(0.5);
        job.begin(sim, plant.parameters);
        {
            ProgressLine line(1, "Identify: excite the wheels, estimate K5..K8");
            job.identify(sim, std::ref(line));
            line.done(job.identification.succeeded
                          ? text("%.0f s of driving within %.2f m of the start; delay %.2f ms",
                                 job.identification.duration_s, job.identification.farthest_m,
                                 1e3 * job.identification.delay_s)
                          : outcome(sim, "stopped before the standard errors were small enough"));
        }
        if (job.identification.succeeded) {
            ProgressLine tune(2, "Tune: velocity loops from the identified model");
            job.tune(sim);
            tune.done(outcome(
                sim, text("steps settle in %.0f ms (speed) and %.0f ms (yaw rate); phase margin %.0f deg",
                          1e3 * job.speed_step.settling_s, 1e3 * job.yaw_step.settling_s,
                          job.design.phase_margin_deg)));
            ProgressLine path(3, "Drive: figure-8 from a start one metre off the path");
            job.drive(sim, std::ref(path));
            path.done(outcome(sim, text("three laps within %.1f mm RMS, %.1f mm at worst",
                                        1e3 * job.figure_eight.rms_m, 1e3 * job.figure_eight.peak_m)));
            ProgressLine load(4, "Adapt: a payload of +30 % is dropped on the robot");
            job.adapt(sim, std::ref(load));
            load.done(outcome(sim, text("3 s later K7 is known to %.1f %%, K8 to %.1f %%",
                                        100 * std::abs(job.k7_error), 100 * std::abs(job.k8_error))));
        }
        missed_cycles = sim.missed_cycles();
    } catch (const std::runtime_error& error) {
        std::fprintf(stderr, "wheelwright demo: %s\n", error.what());
        return kMachineLacks;
    }

    std::optional<HiddenEffect> hidden;
    if (job.identification.succeeded) {
        ProgressLine find(5, "Find what the model lacks: a robot that hides an effect");
        hidden.emplace();
        try {
            hidden->run(robot, options.robot, plant, options.seed, options.out + "/gap", std::ref(find));
        } catch (const std::runtime_error& error) {
            std::fprintf(stderr, "wheelwright demo: %s\n", error.what());
            return kMachineLacks;
        }
        find.done(hidden->found() ? hidden->name() + ", named from " + text("%.0f s", hidden->driven_s) +
                                        " of its bus's log" +
                                        (hidden->findings.closed_loop
                                             ? text("; figure-8 then within %.2f mm RMS",
                                                    1e3 * hidden->findings.closed_loop->after.rms_m)
                                             : std::string())
                                  : hidden->name() + " was hidden, and not found");
    }

    Report report = job.report();
    if (hidden) hidden->add_to(report);
    if (real_time) {
        report.section("real_time", "Real time on " + options.interface);
        report.add("missed_cycles", "cycles for which this machine was too late", missed_cycles);
    }
    std::printf("\n");
    if (!report.publish(options.json)) return kMachineLacks;
    try {
        const std::string file = options.out + "/index.html";
        demo_page(job, hidden ? &*hidden : nullptr, options.interface).write(file);
        std::printf("\nReport with the plots: %s\n", file.c_str());
    } catch (const std::runtime_error& error) {
        std::fprintf(stderr, "wheelwright demo: %s\n", error.what());
        return kMachineLacks;
    }
    if (!job.reached_its_aims() || (hidden && !hidden->reached_its_aims())) {
        std::printf("Not every aim was reached; the table says which.\n");
        return kAimMissed;
    }
    return kDone;
}

}  // namespace

void add_demo(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command = program.add_subcommand(
        "demo", "Identify, tune, drive and adapt a simulated robot, find what its model lacks, and report");
    command.footer(
        "Virtual time unless --can names an interface. Same seed, same figures. Exit status 3: an aim was "
        "missed.");
    command.add_option("--can", options->interface, "Run in real time on this CAN interface");
    command.add_option("--robot", options->robot, "Robot file of the firmware").show_default();
    command.add_option("--plant", options->plant, "Robot file of the simulated robot's truth").show_default();
    command.add_option("--seed", options->seed, "Seed of noise and phases").show_default();
    command.add_option("--out", options->out, "Folder of the report").show_default();
    command
        .add_option("--rest", options->rest_us,
                    "With --can: microseconds between two looks of the robot at the bus; more of them spare "
                    "a slow machine")
        .check(from_to("0", "10000"))
        .show_default();
    command.add_option("--json", options->json, "Also write the figures to this file");
    command.callback([options, &run] { run = [options] { return demo(*options); }; });
}

}  // namespace wheelwright::tools
