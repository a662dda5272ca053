// `wheelwright gap`.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>

#include "firmware/task/robot_file.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/geometry_options.hpp"
#include "tools/gap/gap_output.hpp"
#include "tools/logs/candump.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    GeometryOptions geometry;
    std::vector<std::string> logs;
    std::string model, heldout, out;
    double heldout_from_s = -1;
};

int usage(const std::string& text) {
    std::fprintf(stderr, "wheelwright gap: %s\n", text.c_str());
    return kUsage;
}

int gap(const Options& options) {
    gap::Request request;
    request.logs = options.logs;
    request.heldout_log = options.heldout;
    if (options.heldout_from_s >= 0) request.heldout_from_s = options.heldout_from_s;
    if (!options.heldout.empty() && options.heldout_from_s >= 0) {
        return usage("--heldout and --heldout-from exclude each other");
    }
    if (!options.model.empty()) {
        const task::RobotFileResult result = task::read_robot_file(options.model);
        for (const task::Diagnostic& problem : result.problems) {
            std::fprintf(stderr, "%s\n", task::to_text(problem).c_str());
        }
        if (!result.robot) return kUsage;
        request.robot = result.robot->parameters;
        request.geometry = result.robot->parameters.geometry;
    }
    for (const std::string& log : options.logs) {
        if (options.model.empty() && is_candump(log).value_or(false)) {
            return usage(
                log + " is a candump log; it needs --model ROBOT.toml: nodes, signs and gears stand there");
        }
    }
    if (!options.geometry.apply(request.geometry, !options.model.empty())) return usage(kGeometryMissing);
    std::error_code failed;
    std::filesystem::create_directories(options.out, failed);
    if (!std::filesystem::is_directory(options.out))
        return usage(options.out + " is no folder and cannot be made one");
    request.progress = [](const std::string& what) { std::fprintf(stderr, "%s ...\n", what.c_str()); };
    const gap::Findings findings = gap::analyse(request);

    const std::string json_path = options.out + "/gap.json";
    std::ofstream json(json_path);
    json << gap::json(findings, request);
    json.close();
    if (!json) return usage(json_path + " cannot be written");
    if (!findings.problems.empty()) {
        for (const std::string& problem : findings.problems) std::fprintf(stderr, "%s\n", problem.c_str());
        return kBadInput;
    }
    std::fputs(gap::words(findings).c_str(), stdout);
    const std::string wrong =
        gap::write_robot(findings, request, options.model, options.out + "/robot.extended.toml");
    if (!wrong.empty()) return usage(wrong);
    gap::write_page(findings, request, options.out + "/report.html");
    std::printf("\n%s/gap.json, robot.extended.toml and report.html are written.\n", options.out.c_str());
    return kDone;
}

}  // namespace

void add_gap(CLI::App& program, Run& run) {
    const auto options = std::make_shared<Options>();
    CLI::App* command = program.add_subcommand("gap",
                                               "Find what the model lacks: where "
                                               "simulation and measurement part, and why");
    command->footer(
        "LOG is a candump -L log of the bus with the drives (then --model is needed), or a CSV with the "
        "columns\n"
        "t_s, tau_left_Nm, tau_right_Nm, omega_left_rad_s, omega_right_rad_s[, gyro_z_rad_s] at 20 Hz to 2 "
        "kHz.\n"
        "Several logs are one experiment. Without --heldout the last fifth of the last log is held out.\n"
        "Exit status 0: there is a verdict; 2: a log cannot be used.");
    command->add_option("LOG", options->logs, "Logs")->required();
    command->add_option("--model", options->model, "Robot file: geometry, K5..K8 and effects as believed");
    options->geometry.add_to(*command);
    command->add_option("--heldout", options->heldout, "A log that is not learned from, but judged on");
    command->add_option("--heldout-from", options->heldout_from_s,
                        "The last log's part from this time on, in seconds");
    command->add_option("--out", options->out, "Folder for gap.json, robot.extended.toml, report.html")
        ->required();
    command->callback([options, &run] { run = [options] { return gap(*options); }; });
}

}  // namespace wheelwright::tools
