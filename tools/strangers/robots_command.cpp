// `wheelwright robots`: strangers' robots, drawn, identified and driven by the firmware as it is.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "firmware/task/write_file.hpp"
#include "tools/cli/can_port.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/strangers/campaign.hpp"
#include "tools/strangers/report.hpp"

namespace wheelwright::tools {
namespace {

namespace fs = std::filesystem;

struct Options {
    std::uint64_t seed = 1;
    std::size_t count = 24;
    std::size_t only = 0;
    std::size_t jobs = 0;
    bool faults = false;
    bool draw_only = false;
    std::string log;
    std::string write;
    std::string page;
    std::string json;
};

// With --faults each fault in turn.
RobotFault fault_of(std::size_t number, bool faults) {
    return faults ? static_cast<RobotFault>(1 + (number - 1) % (kRobotFaultNames.size() - 1))
                  : RobotFault::none;
}

std::vector<DrawnRobot> draw_robots(const Options& options) {
    std::vector<DrawnRobot> robots;
    const std::size_t first = options.only > 0 ? options.only : 1;
    const std::size_t last = options.only > 0 ? options.only : options.count;
    for (std::size_t i = first; i <= last; ++i) {
        robots.push_back(draw_robot(options.seed, static_cast<std::int64_t>(i), fault_of(i, options.faults)));
    }
    return robots;
}

// Each robot's two files, in a folder of its number.
void write_files(const std::vector<DrawnRobot>& robots, const std::string& folder) {
    for (const DrawnRobot& robot : robots) {
        const fs::path of_robot = fs::path(folder) / std::to_string(robot.number);
        fs::create_directories(of_robot);
        for (const auto& [name, text] :
             {std::pair{"robot.toml", &robot.robot_toml}, std::pair{"plant.toml", &robot.plant_toml}}) {
            const std::string failed = task::write_whole_file((of_robot / name).string(), *text);
            if (!failed.empty()) throw std::runtime_error(failed);
        }
    }
}

int run_command(const Options& options) {
    std::vector<DrawnRobot> robots;
    try {
        robots = draw_robots(options);
        if (!options.write.empty()) write_files(robots, options.write);
    } catch (const std::runtime_error& error) {
        std::fprintf(stderr, "wheelwright robots: %s\n", error.what());
        return kMachineLacks;
    }
    if (options.draw_only) return kDone;
    catch_interrupt();
    TrialOptions settings;
    settings.log_path = options.log;
    settings.drive = !options.faults;
    std::vector<RobotResult> results;
    {
        ProgressLine progress;
        results = run_robots(
            robots, options.jobs, settings, [&](const CampaignProgress& now) { progress(now); },
            [] { return interrupted(); });
    }
    if (interrupted()) {
        std::printf("stopped after %zu of %zu\n", results.size(), robots.size());
        return kAimMissed;
    }
    const RobotsRun run{options.seed, options.faults};
    const Report report = options.only > 0 ? robot_report(results.front()) : robots_report(results, run);
    if (!report.publish(options.json)) return kMachineLacks;
    if (!options.page.empty()) {
        try {
            write_robots_page(results, run, options.page);
        } catch (const std::runtime_error& error) {
            std::fprintf(stderr, "wheelwright robots: %s\n", error.what());
            return kMachineLacks;
        }
        std::printf("\npage: %s\n", options.page.c_str());
    }
    return all_reached(aims_of(results, run)) ? kDone : kAimMissed;
}

}  // namespace

void add_robots(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command =
        program.add_subcommand("robots", "Identify and drive strangers' robots, drawn at random");
    command.footer(
        "Draws robots, has the firmware identify each and drive with what it found, and compares with the\n"
        "truth (docs/robots.md). The same seed draws the same robots.\n"
        "Exit status 3: an aim is missed.");
    command.add_option("--seed", options->seed, "Draws robots and noise").show_default();
    command.add_option("--count", options->count, "So many robots")
        .check(from_to("1", "100000"))
        .show_default();
    const Option only = command.add_option("--only", options->only, "Only the robot of this number, from 1")
                            .check(from_to("1", "100000"));
    command.add_flag("--faults", options->faults,
                     "Robots with a fault each, in turn: what the identification says of it");
    command.add_option("--jobs", options->jobs, "Robots at a time; 0: as many as processors")
        .check(from_to("0", "1000"))
        .show_default();
    command.add_option("--log", options->log, "Write its bus's frames to this file, as candump -L does")
        .needs(only);
    const Option write = command.add_option("--write", options->write,
                                            "Write each robot's robot.toml and plant.toml into this folder");
    command.add_flag("--draw-only", options->draw_only, "Write the files and drive nothing").needs(write);
    command.add_option("--page", options->page, "Write a page (HTML) to this file");
    command.add_option("--json", options->json, "Write the figures to this file");
    command.callback([options, &run] {
        if (options->jobs == 0) options->jobs = std::max(1U, std::thread::hardware_concurrency());
        run = [options] { return run_command(*options); };
    });
}

}  // namespace wheelwright::tools
