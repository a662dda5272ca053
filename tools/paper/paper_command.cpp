// wheelwright paper: the paper's results run again, as a page.
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/paper/paper_page.hpp"
#include "tools/paper/reproduction.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    std::string out;
    std::string json;
    bool quick = false;
    std::uint64_t seed = 1;
};

int run_paper(const Options& options) {
    paper::ReproductionOptions how;
    how.quick = options.quick;
    how.seed = options.seed;
    how.progress = [](const std::string& stage) { std::fprintf(stderr, "%s\n", stage.c_str()); };
    const paper::Reproduction result = paper::reproduce(how);
    const std::filesystem::path page = std::filesystem::path(options.out) / "index.html";
    paper::page_of(result).write(page);  // throws what main() says
    if (!paper::report_of(result).publish(options.json)) return kMachineLacks;
    std::printf("\nThe page: %s\n", page.string().c_str());
    if (result.all_met()) return kDone;
    for (const paper::Row& row : result.rows) {
        if (!row.met)
            std::fprintf(stderr, "missed: %s: %s; measured: %s\n", row.id.c_str(), row.aim.c_str(),
                         row.measured.c_str());
    }
    return kAimMissed;
}

}  // namespace

void add_paper(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command = program.add_subcommand(
        "paper", "Run the source paper's results again and write them as a page, ours beside the paper's.");
    command.add_option("--out", options->out, "Folder for index.html; made where needed").required();
    command.add_option("--json", options->json, "Write the figures to this file");
    command.add_flag("--quick", options->quick, "Fewer seeds and goals, for a look");
    command.add_option("--seed", options->seed, "Seed of all that is random").show_default();
    command.callback([options, &run] { run = [options] { return run_paper(*options); }; });
}

}  // namespace wheelwright::tools
