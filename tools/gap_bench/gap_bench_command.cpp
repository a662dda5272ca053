// `wheelwright gap-bench`: what `wheelwright gap` is worth on measured logs, beside simpler methods.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/geometry_options.hpp"
#include "tools/cli/log_options.hpp"
#include "tools/cli/run_program.hpp"
#include "tools/cli/scratch_folder.hpp"
#include "tools/gap_bench/bench_report.hpp"
#include "tools/gap_bench/splits.hpp"

namespace wheelwright::tools {
namespace {

namespace fs = std::filesystem;

struct Options {
    std::string input;
    std::vector<std::string> robots;
    std::vector<double> split;
    GeometryOptions geometry;
    LogOptions reading;
    std::string analyser, out, json;
    std::size_t jobs = 1;
};

int bad_input(const std::vector<std::string>& problems) {
    for (const std::string& problem : problems) std::fprintf(stderr, "%s\n", problem.c_str());
    return kBadInput;
}

int finish(const Report& report, const std::vector<bench::Aim>& aims, const std::string& json) {
    if (!report.publish(json)) return kMachineLacks;
    return bench::all_reached(aims) ? kDone : kAimMissed;
}

int one_log(const Options& options, LogReading reading, const bench::BenchOptions& settings,
            const bench::Progress& progress) {
    model::Geometry<double> geometry;
    if (!options.geometry.apply(geometry, false)) {
        std::fprintf(stderr, "wheelwright gap-bench: one log needs --wheel-radius and --track in metres\n");
        return kUsage;
    }
    reading.wheel_radius_m = geometry.wheel_radius_m;
    const std::vector<bench::CorpusRun> runs = bench::read_runs(options.input, reading);
    if (!runs.front().unusable.empty()) return bad_input({runs.front().unusable});
    if (runs.size() > 1) {
        return bad_input({options.input + ": holds " + std::to_string(runs.size()) +
                          " runs, expected one: name it, as in " + runs.front().path});
    }
    const auto splits = bench::split_one_log(runs.front(), geometry, options.split, settings, progress);
    return finish(bench::one_log_report(splits), bench::one_log_aims(splits), options.json);
}

int robots(const Options& options, const LogReading& reading, const bench::BenchOptions& settings,
           const bench::Progress& progress) {
    const bench::Corpus corpus = bench::read_corpus(options.input, options.robots, reading);
    if (!corpus.problems.empty()) return bad_input(corpus.problems);
    const auto splits = bench::leave_one_run_out(corpus, settings, progress);
    return finish(bench::corpus_report(splits), bench::corpus_aims(splits), options.json);
}

int gap_bench(const Options& options) {
    LogReading reading;
    if (const std::string wrong = options.reading.apply(reading); !wrong.empty()) {
        std::fprintf(stderr, "wheelwright gap-bench: %s\n", wrong.c_str());
        return kUsage;
    }
    try {
        const ScratchFolder scratch;  // where nothing is to be kept, the analysis writes here
        bench::BenchOptions settings;
        settings.program = options.analyser.empty() ? own_path() : options.analyser;
        settings.jobs = options.jobs;
        settings.reading = options.reading.words();
        settings.out = options.out.empty() ? scratch.path() : options.out;
        if (!run_program({settings.program, "gap", "--help"}, "/dev/null", 60).well()) {
            std::fprintf(stderr, "wheelwright gap-bench: %s gap --help does not end well\n",
                         settings.program.c_str());
            return kUsage;
        }
        ProgressLine line;
        const bench::Progress progress = [&](const CampaignProgress& now) { line(now); };
        return fs::is_directory(options.input) ? robots(options, reading, settings, progress)
                                               : one_log(options, reading, settings, progress);
    } catch (const std::runtime_error& error) {
        std::fprintf(stderr, "wheelwright gap-bench: %s\n", error.what());
        return kMachineLacks;
    }
}

}  // namespace

void add_gap_bench(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    for (double percent = 30; percent <= 70; percent += 5) options->split.push_back(percent);
    const CommandLine command =
        program.add_subcommand("gap-bench", "Hold measured runs out: what gap's models are worth on them");
    command.footer(
        "A folder of robots holds robots.json and NAME/RUN.csv (docs/gap-bench.md). Each run is held out "
        "once, and\n"
        "gap, SysId's regression, plain least squares and the torque alone learn from the robot's others.\n"
        "Of one log, the first 30, 35 .. 70 % are learned from, and the answers compared.\n"
        "Exit status 3: an aim is missed.");
    command.add_option("INPUT", options->input, "Folder of robots, or one log").required();
    command.add_option("--robot", options->robots, "Only these robots of the folder, with commas between")
        .delimiter(',');
    command
        .add_option("--split", options->split,
                    "Of one log: percents that are learned from, with commas between")
        .delimiter(',')
        .check(from_to("1", "99"));
    options->geometry.add_to(command);
    options->reading.add_to(command);
    command.add_option("--analyser", options->analyser,
                       "Another build's wheelwright, whose gap is asked instead of this one's");
    command.add_option("--out", options->out,
                       "Keep what gap writes, in this folder: ROBOT/RUN/gap.json and more");
    command.add_option("--jobs", options->jobs, "Analyses at a time; 0: as many as processors")
        .check(from_to("0", "1000"))
        .show_default();
    command.add_option("--json", options->json, "Write the figures to this file");
    command.callback([options, &run] {
        if (options->jobs == 0) options->jobs = std::max(1U, std::thread::hardware_concurrency());
        run = [options] { return gap_bench(*options); };
    });
}

}  // namespace wheelwright::tools
