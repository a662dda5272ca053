// `wheelwright gap-trials`: the gap analysis judged blind, on robots whose hidden effects it cannot know.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "firmware/task/write_file.hpp"
#include "tools/cli/can_port.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/geometry_options.hpp"
#include "tools/cli/run_program.hpp"
#include "tools/gap_trials/campaign.hpp"
#include "tools/gap_trials/stepwise_baseline.hpp"
#include "tools/gap_trials/trials_report.hpp"

namespace wheelwright::tools {
namespace {

namespace fs = std::filesystem;

struct Options {
    std::string out;
    std::string plant = "ode";
    std::size_t sample = 30;
    bool campaign = false;
    bool every_effect = false;
    std::uint64_t seed = 1;
    std::size_t jobs = 1;
    bool resume = false;
    bool merge = false;
    bool list = false;
    bool keep_logs = false;
    long task = -1;
    std::string analyser;
    double time_limit_s = 600;
    double duration_s = 0;
    std::string json;
    std::string stepwise_log;
    GeometryOptions geometry;
    bool no_stepwise = false;
    std::size_t further = 0;
    std::string pysindy;
};

int show(const Options& options, const std::vector<Outcome>& outcomes, const TrialsRun& run) {
    const Summary summary = summarise(outcomes);
    PlantSummaries by_plant;
    if (options.plant == "both") {
        std::map<std::string, std::vector<Outcome>> parts;
        for (const Outcome& outcome : outcomes) parts[outcome.truth.plant].push_back(outcome);
        for (const auto& [plant, part] : parts) by_plant[plant] = summarise(part);
    }
    const bool published = trials_report(summary, run, by_plant).publish(options.json);
    const std::string page = (fs::path(options.out) / "report.html").string();
    write_trials_page(summary, run, page);
    std::printf("\npage: %s\n", page.c_str());
    if (!published) return kMachineLacks;
    const bool accepted =
        all_accepted(summary) && std::all_of(by_plant.begin(), by_plant.end(),
                                             [](const auto& one) { return all_accepted(one.second); });
    return accepted && outcomes.size() == run.listed ? kDone : kAimMissed;
}

// What --stepwise-bic asks for: the answer of the plain regression to one log.
int run_stepwise(const Options& options) {
    model::Geometry<double> geometry;
    if (options.out.empty() || !options.geometry.apply(geometry, false)) {
        std::fputs("wheelwright gap-trials: --stepwise-bic takes --wheel-radius, --track and --out\n",
                   stderr);
        return kUsage;
    }
    const std::string answer = stepwise_baseline_json(options.stepwise_log, geometry);
    fs::create_directories(options.out);
    const std::string failed = task::write_whole_file((fs::path(options.out) / "gap.json").string(), answer);
    if (failed.empty()) return kDone;
    std::fprintf(stderr, "wheelwright gap-trials: %s\n", failed.c_str());
    return kMachineLacks;
}

int run_command(const Options& options) {
    if (!options.stepwise_log.empty()) return run_stepwise(options);
    std::vector<hidden::ListedTrial> trials =
        hidden::all_trials(options.seed, options.plant == "both" ? std::vector<std::string>{"ode", "own"}
                                                                 : std::vector<std::string>{options.plant});
    TrialsRun run{"campaign", options.seed, 0};
    if (options.every_effect) {
        trials = hidden::every_effect_of(std::move(trials), options.seed);
        run.what = "every effect once, and a few of every other kind";
    } else if (!options.campaign) {
        trials = hidden::sample_of(std::move(trials), options.sample, options.seed);
        run.what = "sample of " + std::to_string(trials.size());
    }
    for (hidden::ListedTrial& trial : trials) trial.plan.duration_s = options.duration_s;
    run.listed = trials.size();
    if (options.list) {
        std::printf("%zu\n", trials.size());
        return kDone;
    }
    if (options.out.empty()) {
        std::fputs("wheelwright gap-trials: --out is required: the folder for logs, labels and results\n",
                   stderr);
        return kUsage;
    }
    if (options.task >= static_cast<long>(trials.size())) {
        std::fprintf(stderr, "wheelwright gap-trials: --task %ld: the list has the tasks 0 to %zu\n",
                     options.task, trials.size() - 1);
        return kUsage;
    }
    CampaignOptions settings;
    settings.out = fs::absolute(options.out);
    settings.analyser = options.analyser.empty() ? own_path() : options.analyser;
    const std::string self = own_path();
    if (!options.no_stepwise)
        settings.beside.push_back({std::string(kStepwise), {self, "gap-trials", "--stepwise-bic"}});
    if (!options.pysindy.empty()) {
        settings.beside.push_back(
            {std::string(kPysindy), {WHEELWRIGHT_PYTHON, WHEELWRIGHT_PYSINDY_WEAK, options.pysindy, "gap"}});
    }
    settings.jobs = options.jobs;
    settings.time_limit_s = options.time_limit_s;
    settings.resume = options.resume;
    settings.keep_logs = options.keep_logs;
    settings.further = every_nth(trials, options.further);
    try {
        if (options.merge) {
            const std::vector<Outcome> outcomes = stored_outcomes(trials, settings.out);
            if (outcomes.empty()) {
                std::fprintf(stderr, "wheelwright gap-trials: %s holds no result of this list\n",
                             (settings.out / "results").c_str());
                return kBadInput;
            }
            return show(options, outcomes, run);
        }
        if (!can_analyse(settings.analyser)) {
            std::fprintf(stderr, "wheelwright gap-trials: `%s gap --help` fails, so it cannot analyse\n",
                         settings.analyser.c_str());
            return kMachineLacks;
        }
        if (!options.pysindy.empty() && !ends_well(settings.beside.back().command)) {
            std::fprintf(stderr,
                         "wheelwright gap-trials: --pysindy %s: cannot be imported\n"
                         "It needs python3-numpy, python3-scipy, python3-sklearn. Try: %s %s %s gap\n",
                         options.pysindy.c_str(), WHEELWRIGHT_PYTHON, WHEELWRIGHT_PYSINDY_WEAK,
                         options.pysindy.c_str());
            return kMachineLacks;
        }
        if (options.task >= 0) {
            const hidden::ListedTrial& trial = trials[static_cast<std::size_t>(options.task)];
            std::vector<Outcome> kept;
            if (options.resume) kept = stored_outcomes({trial}, settings.out, settings.further);
            const Outcome outcome = kept.empty() ? run_trial(trial, settings) : std::move(kept.front());
            std::printf("%s %s\n", outcome.truth.id.c_str(), outcome.said.c_str());
            return outcome.finding.verdict == "no_answer" ? kAimMissed : kDone;
        }
        catch_interrupt();
        std::vector<Outcome> outcomes;
        {
            ProgressLine progress;
            outcomes = run_trials(
                trials, settings, [&](const CampaignProgress& now) { progress(now); },
                [] { return interrupted(); });
        }
        if (interrupted()) {
            std::printf("stopped after %zu of %zu; --resume goes on\n", outcomes.size(), trials.size());
            return kAimMissed;
        }
        return show(options, outcomes, run);
    } catch (const fs::filesystem_error& error) {
        std::fprintf(stderr, "wheelwright gap-trials: %s: %s\n", error.path1().c_str(),
                     error.code().message().c_str());
        return kMachineLacks;
    } catch (const std::runtime_error& error) {
        std::fprintf(stderr, "wheelwright gap-trials: %s\n", error.what());
        return kMachineLacks;
    }
}

}  // namespace

void add_gap_trials(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command =
        program.add_subcommand("gap-trials", "Judge the gap analysis blind, on hidden effects");
    command.footer(
        "Draws robots with hidden effects, writes their logs, has each analysed by a process of its own that "
        "sees\n"
        "only the log (`wheelwright gap`), and compares the answers with what was hidden. The same seed "
        "draws the\n"
        "same trials. On several machines: --task I for each I below what --list prints, then --merge.\n"
        "Exit status 3: a measure is below its accept level, or an analysis gave no answer.");
    command.add_option("--out", options->out, "Folder for logs, labels, results and report.html");
    command
        .add_option("--plant", options->plant,
                    "Which robots: ode, on the Open Dynamics Engine, own, our simulated robot, or both")
        .check(one_of({"ode", "own", "both"}))
        .show_default();
    const Option sample = command.add_option("--sample", options->sample, "So many trials, drawn from all")
                              .check(from_to("1", "100000"))
                              .show_default();
    const Option campaign = command.add_flag("--campaign", options->campaign, "All trials").excludes(sample);
    command
        .add_flag("--every-effect", options->every_effect,
                  "Each effect once, medium or strong, and a few of every other kind")
        .excludes(sample)
        .excludes(campaign);
    command.add_option("--seed", options->seed, "Draws trials, robots, motions and noise").show_default();
    command.add_option("--jobs", options->jobs, "Trials at a time; 0: as many as processors")
        .check(from_to("0", "1000"))
        .show_default();
    command.add_flag("--resume", options->resume, "Keep the results that --out holds already");
    command.add_option("--task", options->task, "Only the trial of this number, from 0, and no report")
        .check(from_to("0", "1000000"));
    command.add_flag("--merge", options->merge, "Run nothing: report on the results that --out holds");
    command.add_flag("--list", options->list, "Run nothing: print the number of trials");
    command.add_option("--analyser", options->analyser,
                       "Program to call instead of this one, with the same words");
    command.add_option("--time-limit", options->time_limit_s, "Longest analysis, seconds")
        .check(greater_than_zero())
        .show_default();
    command
        .add_option("--duration", options->duration_s,
                    "Length of the logs, seconds; without: 30, 45 or 60, drawn")
        .check(from_to("2", "3600"));
    command.add_flag("--keep-logs", options->keep_logs, "Keep the logs after their analysis");
    command
        .add_option("--further", options->further,
                    "Analyse every so many-th trial of each kind further (docs/gap-trials.md); 0: none")
        .check(from_to("0", "100000"))
        .show_default();
    command.add_flag("--no-stepwise", options->no_stepwise, "Leave the stepwise regression out");
    command
        .add_option("--pysindy", options->pysindy,
                    "Source tree of PySINDy, whose weak form is given the same logs")
        .check(existing_folder());
    command.add_option("--stepwise-bic", options->stepwise_log,
                       "Only answer this log by stepwise regression, into gap.json in --out");
    options->geometry.add_to(command);
    command.add_option("--json", options->json, "Write the figures to this file");
    command.callback([options, &run] {
        if (options->jobs == 0) options->jobs = std::max(1U, std::thread::hardware_concurrency());
        run = [options] { return run_command(*options); };
    });
}

}  // namespace wheelwright::tools
