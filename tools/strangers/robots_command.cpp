// `wheelwright robots`: strangers' robots, drawn, identified and driven by the firmware as it is.
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "tools/cli/can_port.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/strangers/campaign.hpp"
#include "tools/strangers/report.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    std::uint64_t seed = 1;
    std::size_t count = 24;
    std::size_t only = 0;
    std::size_t jobs = 0;
    std::string log;
    std::string json;
};

// A line that is drawn again on a terminal, and now and then one elsewhere.
class ProgressLine {
  public:
    ProgressLine() : terminal_(::isatty(STDOUT_FILENO) != 0) {}
    ~ProgressLine() {
        if (terminal_ && drawn_) std::printf("\r\033[K");
        std::fflush(stdout);
    }
    ProgressLine(const ProgressLine&) = delete;
    ProgressLine& operator=(const ProgressLine&) = delete;

    void operator()(const CampaignProgress& now) {
        const double left_s =
            now.elapsed_s / static_cast<double>(now.done) * static_cast<double>(now.all - now.done);
        const std::size_t tenth = std::max<std::size_t>(1, now.all / 10);
        if (terminal_) {
            std::printf("\r\033[K  %zu of %zu, %.0f s to go  %s", now.done, now.all, left_s,
                        now.last.c_str());
        } else if (now.done % tenth == 0 || now.done == now.all) {
            std::printf("  %zu of %zu, %.0f s to go\n", now.done, now.all, left_s);
        }
        drawn_ = true;
        std::fflush(stdout);
    }

  private:
    bool terminal_;
    bool drawn_ = false;
};

int run_command(const Options& options) {
    std::vector<DrawnRobot> robots;
    try {
        if (options.only > 0) {
            robots.push_back(draw_robot(options.seed, static_cast<std::int64_t>(options.only)));
        } else {
            for (std::size_t i = 1; i <= options.count; ++i)
                robots.push_back(draw_robot(options.seed, static_cast<std::int64_t>(i)));
        }
    } catch (const std::runtime_error& error) {
        std::fprintf(stderr, "wheelwright robots: %s\n", error.what());
        return kUsage;
    }
    catch_interrupt();
    TrialOptions settings;
    settings.log_path = options.log;
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
    if (!robots_report(results, options.seed).publish(options.json)) return kMachineLacks;
    return all_reached(aims_of(results)) ? kDone : kAimMissed;
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
    command.add_option("--jobs", options->jobs, "Robots at a time; 0: as many as processors")
        .check(from_to("0", "1000"))
        .show_default();
    command.add_option("--log", options->log, "Write its bus's frames to this file, as candump -L does")
        .needs(only);
    command.add_option("--json", options->json, "Write the figures to this file");
    command.callback([options, &run] {
        if (options->jobs == 0) options->jobs = std::max(1U, std::thread::hardware_concurrency());
        run = [options] { return run_command(*options); };
    });
}

}  // namespace wheelwright::tools
