// `wheelwright free-run`: a robot file, in the simulator, driven by a log's torques.
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "firmware/task/robot_file.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/log_options.hpp"
#include "tools/cli/report.hpp"
#include "tools/gap/logs/experiment.hpp"
#include "tools/gap/report/held_out.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    std::string robot, log, json, csv;
    LogOptions reading;
    std::vector<double> from_s;  // none or one
};

int complain(int status, const std::string& text) {
    std::fprintf(stderr, "wheelwright free-run: %s\n", text.c_str());
    return status;
}

bool write_csv(const std::string& path, const gap::LogPart& part, const gap::SimulatedRobot& robot) {
    std::FILE* file = std::fopen(path.c_str(), "w");
    if (file == nullptr) return false;
    std::fputs("t_s,measured_left_rad_s,measured_right_rad_s,simulated_left_rad_s,simulated_right_rad_s\n",
               file);
    gap::free_run_of(part, robot, [&](std::size_t i, const WheelPair<double>& simulated) {
        const MeasuredSample& s = part.log->samples[i];
        std::fprintf(file, "%.9g,%.12g,%.12g,%.12g,%.12g\n", s.t_s, s.speed_rad_per_s.left,
                     s.speed_rad_per_s.right, simulated.left, simulated.right);
    });
    return std::fclose(file) == 0;
}

int free_run(const Options& options) {
    const task::RobotFileResult read = task::read_robot_file(options.robot);
    if (!read.robot) return complain(kUsage, task::to_text(read.problems.front()));
    const std::optional<gap::SimulatedRobot> known = gap::simulated_robot(*read.robot);
    if (!known) return complain(kUsage, options.robot + ": neither K7 nor K8 is known, nor masses");
    const gap::SimulatedRobot& robot = *known;
    LogReading reading;
    const std::string wrong = options.reading.apply(reading);
    if (!wrong.empty()) return complain(kUsage, wrong);
    reading.wheel_radius_m = robot.geometry.wheel_radius_m;
    const gap::Logs logs = gap::read_logs({options.log}, read.robot->parameters, reading);
    if (!logs.problems.empty()) return complain(kBadInput, logs.problems.front());
    gap::HeldOutPart wanted{options.from_s.empty(), {}};
    if (!options.from_s.empty()) wanted.from_s = options.from_s.front();
    const gap::Parts parts = gap::split(logs, robot.geometry, wanted);
    if (!parts.held_out) return complain(kBadInput, options.log + ": nothing is left to run over");
    const gap::LogPart& part = *parts.held_out;

    Report report("free-run");
    report.section("run", "Free run");
    for (const std::string& note : logs.notes) report.add("note", "note", note);
    report.add("robot", "robot", options.robot);
    report.add("log", "driven by the torques of", options.log);
    const auto& samples = part.log->samples;
    report.add("from_s", "from", samples[part.first].t_s, "s");
    report.add("duration_s", "for", part.log->period_s * double(part.end - part.first - 1), "s");
    report.add("k7_known", "K7 is known", robot.driving, "",
               robot.driving ? "" : "as if the mass were at the wheels: good for turning on the spot only");
    report.add("k8_known", "K8 is known", robot.turning, "",
               robot.turning ? "" : "the robot goes straight, and gets the mean of both wheels");
    report.add("signal_rms_rad_s", "measured wheel speeds, RMS", gap::speed_rms_rad_per_s(part), "rad/s");
    report.table("windows", {{"window_s", "started anew every (0: never) / s"},
                             {"windows", "runs"},
                             {"wheel_speed_rms_rad_s", "error of the wheel speeds, RMS / (rad/s)"},
                             {"forward_rms_rad_s", "of their mean"}});
    for (const gap::FreeRun& run : gap::free_runs(part, {std::nullopt, robot, robot}))
        report.row({run.window_s, std::int64_t(run.windows), run.after.both, run.after.forward});
    if (!options.csv.empty() && !write_csv(options.csv, part, robot))
        return complain(kMachineLacks, options.csv + " cannot be written");
    return report.publish(options.json) ? kDone : kMachineLacks;
}

}  // namespace

void add_free_run(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command = program.add_subcommand(
        "free-run",
        "Drive a robot file's robot by a log's torques: how far its wheel speeds get from the log's");
    command.footer(
        "The simulated robot is that of `wheelwright sim`. It begins with the measured speeds and then gets "
        "the\n"
        "logged torques only; with windows it begins anew. So `wheelwright gap` found the figures on its "
        "page:\n"
        "  wheelwright free-run drive.csv --robot gap/robot.extended.toml --from 32\n"
        "says what its page says. \"Runs away\", that is farther off than a robot that stands, has no "
        "figure.");
    command.add_option("LOG", options->log, "A log, as `wheelwright gap` takes it").required();
    command.add_option("--robot", options->robot, "Robot file: geometry, K5..K8, effects").required();
    options->reading.add_to(command);
    command.add_option("--from", options->from_s, "Only from this time of the log on, in seconds")
        .values(1, 1);
    command.add_option("--csv", options->csv, "Also write measured and simulated speeds to this file");
    command.add_option("--json", options->json, "Also write the figures to this file");
    command.callback([options, &run] { run = [options] { return free_run(*options); }; });
}

}  // namespace wheelwright::tools
