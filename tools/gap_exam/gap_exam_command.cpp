// `wheelwright gap-exam`: the model gap on robots by other laws than the catalogue's.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/run_program.hpp"
#include "tools/cli/scratch_folder.hpp"
#include "tools/gap_exam/exam_report.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    std::uint64_t seed = 1;
    std::size_t count = 24, only = 0, jobs = 1;
    std::string analyser, out, json;
};

int gap_exam(const Options& options) {
    try {
        const ScratchFolder scratch;
        exam::ExamOptions settings;
        settings.seed = options.seed;
        for (std::size_t number = 1; number <= options.count; ++number) settings.numbers.push_back(number);
        if (options.only > 0) settings.numbers = {options.only};
        settings.jobs = options.jobs;
        settings.program = options.analyser.empty() ? own_path() : options.analyser;
        settings.out = options.out.empty() ? scratch.path() : options.out;
        if (!run_program({settings.program, "gap", "--help"}, "/dev/null", 60).well()) {
            std::fprintf(stderr, "wheelwright gap-exam: %s gap --help does not end well\n",
                         settings.program.c_str());
            return kUsage;
        }
        ProgressLine line;
        const auto answers = exam::hold_exam(settings, [&](const CampaignProgress& now) { line(now); });
        if (!exam::exam_report(answers).publish(options.json)) return kMachineLacks;
        return bench::all_reached(exam::exam_aims(answers)) ? kDone : kAimMissed;
    } catch (const std::runtime_error& error) {
        std::fprintf(stderr, "wheelwright gap-exam: %s\n", error.what());
        return kMachineLacks;
    }
}

}  // namespace

void add_gap_exam(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command = program.add_subcommand(
        "gap-exam", "Draw robots by other laws than the catalogue's: what gap names, over size");
    command.footer(
        "Each log is a robot of its own, with friction and, in most, one further effect of any size; gap "
        "sees\n"
        "two drives of it and nothing else (docs/gap-exam.md). A log is the same whatever --count is.\n"
        "Exit status 3: an aim is missed, or could not be measured.");
    command.add_option("--seed", options->seed, "Of the draw").show_default();
    command.add_option("--count", options->count, "Logs").check(from_to("1", "100000")).show_default();
    command.add_option("--log", options->only, "Only the log of this number").check(from_to("1", "100000"));
    command.add_option("--jobs", options->jobs, "Analyses at a time; 0: as many as processors")
        .check(from_to("0", "1000"))
        .show_default();
    command.add_option("--analyser", options->analyser,
                       "Another build's wheelwright, whose gap is asked instead of this one's");
    command.add_option("--out", options->out,
                       "Keep logs, truths and what gap writes, in this folder: NUMBER/truth.json and more");
    command.add_option("--json", options->json, "Write the figures to this file");
    command.callback([options, &run] {
        if (options->jobs == 0) options->jobs = std::max(1U, std::thread::hardware_concurrency());
        run = [options] { return gap_exam(*options); };
    });
}

}  // namespace wheelwright::tools
