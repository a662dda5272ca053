// `wheelwright gap`.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <optional>
#include <thread>

#include "firmware/model/effects.hpp"
#include "firmware/task/robot_file.hpp"
#include "firmware/task/robot_file_hints.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/geometry_options.hpp"
#include "tools/cli/log_options.hpp"
#include "tools/cli/progress_line.hpp"
#include "tools/cli/report.hpp"
#include "tools/cli/robots.hpp"
#include "tools/gap/report/injection.hpp"
#include "tools/gap/report/output.hpp"
#include "tools/gap/report/robot_files.hpp"
#include "tools/gap/report/write_parameters.hpp"
#include "tools/logs/candump.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    GeometryOptions geometry;
    LogOptions reading;
    std::vector<std::string> logs;
    std::vector<std::string> without;
    std::string model, heldout, out, plant, interface;
    bool close_loop = false;
    bool yes = false;
    std::size_t verify_detection = 0;
    std::vector<std::string> verify_only;
    std::vector<double> verify_sizes{0.3, 1, 2};
    double heldout_from_s = -1;
};

int usage(const std::string& text) {
    std::fprintf(stderr, "wheelwright gap: %s\n", text.c_str());
    return kUsage;
}

// Why an option's effect is none, or "".
std::string no_such_effect(const std::string& option, const std::string& name) {
    if (model::find_effect(name) != model::kEffectCount) return "";
    const auto near = [&](const model::EffectInfo& e) { return task::edit_distance(e.name, name); };
    const auto nearest = std::min_element(model::kEffects.begin(), model::kEffects.end(),
                                          [&](const auto& a, const auto& b) { return near(a) < near(b); });
    std::string problem = option + " " + name + ": no effect has this name";
    if (near(*nearest) <= std::max<std::size_t>(2, name.size() / 3))
        return problem + "; did you mean " + std::string(nearest->name) + "?";
    problem += "\nThe effects are";
    for (const model::EffectInfo& e : model::kEffects) {
        problem += (&e == &model::kEffects.front() ? " " : ", ") + std::string(e.name);
    }
    return problem;
}

// Why these effects cannot be left out of the search, or "".
std::string leave_out(const std::vector<std::string>& names, gap::Request& request) {
    for (const std::string& name : names) {
        const std::string problem = no_such_effect("--without", name);
        if (!problem.empty()) return problem;
        const std::size_t effect = model::find_effect(name);
        if (request.robot && request.robot->effects.active[effect])
            return "--without " + name + ": the model given has it";
        request.without.push_back(effect);
    }
    return "";
}

void close_loop(gap::Findings& findings, const gap::Request& request,
                const std::optional<task::RobotFile>& plant, const std::string& path) {
    gap::ClosedLoopSetup setup = gap::closed_loop_setup(findings, request);
    setup.progress = request.progress;
    if (plant) gap::set_truth(setup, *plant);
    findings.closed_loop = gap::close_loop(setup);
    findings.closed_loop->plant =
        plant ? "the simulated robot of " + std::filesystem::path(path).filename().string()
              : "a simulated robot that is what was found (no truth is known)";
}

void verify_detection(const Options& options, const gap::Request& request, const gap::Findings& findings) {
    gap::DetectionOptions detection;
    detection.repeats = options.verify_detection;
    detection.only = options.verify_only;
    detection.factors = options.verify_sizes;
    detection.jobs = std::max(1U, std::thread::hardware_concurrency());
    std::vector<gap::Detection> all;
    {
        ProgressLine line;
        detection.progress = std::ref(line);
        all = gap::verify_detection(request, findings, detection);
    }
    Report report("gap");
    report.section("detection", "Effects put on the robot found, at multiples of the size called detectable");
    report.table("logs", {{"effect", "effect"},
                          {"factor", "times the size"},
                          {"logs", "logs"},
                          {"named", "named"},
                          {"confounded", "as a rival"},
                          {"elsewhere", "another named"},
                          {"instead", "which"}});
    for (const gap::Detection& d : all) {
        report.row({gap::name_of(d.effect), d.factor, std::int64_t(d.logs), std::int64_t(d.named),
                    std::int64_t(d.confounded), std::int64_t(d.elsewhere), gap::names_of(d.instead)});
    }
    report.publish(options.out + "/detection.json");
}

int write_to_robot(const Options& options, const gap::Findings& findings, const gap::Request& request) {
    const gap::Verdict verdict = findings.conclusion.verdict;
    if (verdict != gap::Verdict::named && verdict != gap::Verdict::nothing_missing) {
        std::fprintf(stderr, "wheelwright gap: nothing is written to the robot: the verdict is %s\n",
                     gap::verdict_name(verdict));
        return kAimMissed;
    }
    return gap::write_parameters(gap::changes(findings, request), options.interface, options.yes);
}

// FILE or FILE.json:TEST. A whole file has all its tests in it; a copy, or another name of the file, is the
// same log.
bool is_part_of(const std::string& log, const std::string& whole) {
    const auto file_of = [](const std::string& name) {
        const std::size_t colon = name.rfind(".json:");
        return colon == std::string::npos ? name : name.substr(0, colon + 5);
    };
    const std::string file = file_of(log);
    const std::string other = file_of(whole);
    const bool other_test =
        other != whole && file != log && log.substr(file.size()) != whole.substr(other.size());
    if (other_test) return false;
    std::error_code failed;
    if (file == other || std::filesystem::equivalent(file, other, failed)) return true;
    const auto size = std::filesystem::file_size(file, failed);
    if (failed || size != std::filesystem::file_size(other, failed) || failed) return false;
    return gap::text_of_file(file) == gap::text_of_file(other);
}

int gap(const Options& options) {
    gap::Request request;
    request.logs = options.logs;
    request.heldout_log = options.heldout;
    if (options.heldout_from_s >= 0) request.heldout_from_s = options.heldout_from_s;
    if (!options.heldout.empty() && options.heldout_from_s >= 0) {
        return usage("--heldout and --heldout-from exclude each other");
    }
    for (const std::string& log : options.logs) {
        if (options.heldout.empty() || !is_part_of(options.heldout, log)) continue;
        return usage("--heldout " + options.heldout + ": the same log is learned from (" + log +
                     "); expected one that is not among LOG");
    }
    if (!options.model.empty()) {
        const std::optional<task::RobotFile> robot = read_robot(options.model);
        if (!robot) return kUsage;
        request.robot = robot->parameters;
        request.robot_text = gap::text_of_file(options.model);
        request.geometry = robot->parameters.geometry;
    }
    for (const std::string& log : options.logs) {
        if (options.model.empty() && is_candump(log).value_or(false)) {
            return usage(
                log + " is a candump log; it needs --model ROBOT.toml: nodes, signs and gears stand there");
        }
    }
    if (!options.geometry.apply(request.geometry, !options.model.empty())) return usage(kGeometryMissing);
    const std::string wrong_reading = options.reading.apply(request.reading);
    if (!wrong_reading.empty()) return usage(wrong_reading);
    request.reading.wheel_radius_m = request.geometry.wheel_radius_m;
    const std::string kept = leave_out(options.without, request);
    if (!kept.empty()) return usage(kept);
    for (const std::string& name : options.verify_only) {
        const std::string problem = no_such_effect("--verify-only", name);
        if (!problem.empty()) return usage(problem);
    }
    std::error_code failed;
    std::filesystem::create_directories(options.out, failed);
    if (!std::filesystem::is_directory(options.out))
        return usage(options.out + " is no folder and cannot be made one");
    request.progress = [](const std::string& what) { std::fprintf(stderr, "%s ...\n", what.c_str()); };
    std::optional<task::RobotFile> plant;
    if (!options.plant.empty()) {
        plant = read_robot(options.plant);
        if (!plant) return kUsage;
    }
    if (!options.close_loop && (plant || !options.interface.empty())) {
        return usage("--plant and --can belong to --close-loop");
    }
    gap::Findings findings = gap::analyse(request);
    if (findings.problems.empty() && findings.file_problem.empty() && options.close_loop)
        close_loop(findings, request, plant, options.plant);

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
    const std::string wrong = gap::write_robots(findings, options.out);
    if (!wrong.empty()) return usage(wrong);
    gap::write_page(findings, request, options.out + "/report.html");
    std::printf("\n%s/gap.json, robot.extended.toml, robot.before.toml and report.html are written.\n",
                options.out.c_str());
    if (options.verify_detection > 0) verify_detection(options, request, findings);
    if (!options.interface.empty()) return write_to_robot(options, findings, request);
    return kDone;
}

}  // namespace

void add_gap(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command = program.add_subcommand(
        "gap", "Find what the model lacks: where simulation and measurement part, and why");
    command.footer(
        "LOG is a candump -L log of the bus with the drives (then --model is needed), a CSV with the "
        "columns\n"
        "t_s, tau_left_Nm, tau_right_Nm, omega_left_rad_s, omega_right_rad_s[, gyro_z_rad_s] or others "
        "(--columns)\n"
        "at 20 Hz to 2 kHz, or a file of WPILib SysId, whole or as FILE.json:TEST (docs/logs.md).\n"
        "Several logs are one experiment. Without --heldout the last fifth of the last log is held out.\n"
        "Exit status 0: there is a verdict; 2: a log cannot be used.");
    command.add_option("LOG", options->logs, "Logs").required();
    command.add_option("--model", options->model, "Robot file: geometry, K5..K8 and effects as believed");
    options->geometry.add_to(command);
    options->reading.add_to(command);
    command
        .add_option("--without", options->without,
                    "Effects known not to be there, by name, with commas between: not looked for")
        .delimiter(',');
    command.add_option("--heldout", options->heldout, "A log that is not learned from, but judged on");
    command
        .add_option("--heldout-from", options->heldout_from_s,
                    "The last log's part from this time on, in seconds")
        .check(from_to("0", "1e9"));
    command.add_option("--out", options->out, "Folder for gap.json, robot.extended.toml, report.html")
        .required();
    command.add_flag("--close-loop", options->close_loop,
                     "Also drive the figure-8 in the simulator, with what was believed before and after");
    command.add_option(
        "--plant", options->plant,
        "With --close-loop: robot file of the simulated robot's truth; else it is what was found");
    command.add_option("--can", options->interface,
                       "With --close-loop: then write what was found to the robot on this interface");
    command.add_flag("--yes", options->yes, "With --can: do not ask before writing");
    command.add_option("--verify-detection", options->verify_detection,
                       "Put each effect that was not found on the robot that was, so many times at each of "
                       "some multiples of\n"
                       "the size called detectable, and count how often it is named; also in detection.json");
    command.add_option("--verify-sizes", options->verify_sizes, "... at these multiples, with commas between")
        .delimiter(',')
        .show_default();
    command.add_option("--verify-only", options->verify_only, "... of these effects, with commas between")
        .delimiter(',');
    command.callback([options, &run] { run = [options] { return gap(*options); }; });
}

}  // namespace wheelwright::tools
