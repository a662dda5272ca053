// `wheelwright check`: is this robot file good, and what follows from it?
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>

#include "firmware/control/path_pace.hpp"
#include "firmware/control/pose_control.hpp"
#include "firmware/ident/sizing.hpp"
#include "firmware/task/bus_plan.hpp"
#include "firmware/task/robot_file.hpp"
#include "firmware/task/slip_watch.hpp"
#include "tools/check/parameter_reference.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/message_text.hpp"
#include "tools/cli/report.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    std::string file;
    std::string json;
    bool explain = false;
};

std::string_view origin(const task::RobotFile& robot) {
    if (robot.is_given("dynamics.k7_per_kg_m")) return "given";
    return robot.mass.has_value() ? "from [mass]" : "not given: defaults";
}

void report_model(const task::RobotFile& robot, Report& report) {
    const model::RobotParameters& p = robot.parameters;
    const model::Dynamics<double>& k = p.dynamics;
    const model::Dynamics<double>& error = p.dynamics_standard_error;
    const double radius = p.geometry.mean_radius_m();
    const double m_eff = 1 / (k.k7_per_kg_m * radius);
    const double i_eff = p.geometry.track_m / (2 * radius * k.k8_per_kg_m2);
    const auto with_error = [](double value) {
        return value > 0 ? "standard error " + number_text(value, 3) : std::string();
    };
    report.section("model", "Model (" + std::string(origin(robot)) + ")");
    report.add("k5_m", "K5", k.k5_m, "m", with_error(error.k5_m));
    report.add("k6_per_m", "K6", k.k6_per_m, "1/m",
               robot.is_given("dynamics.k6_per_m") ? with_error(error.k6_per_m) : "follows from the others");
    report.add("k7_per_kg_m", "K7", k.k7_per_kg_m, "1/(kg m)", with_error(error.k7_per_kg_m));
    report.add("k8_per_kg_m2", "K8", k.k8_per_kg_m2, "1/(kg m^2)", with_error(error.k8_per_kg_m2));
    report.add("effective_mass_kg", "effective mass", m_eff, "kg", "1 / (K7 r), wheels' inertia included");
    report.add("effective_yaw_inertia_kg_m2", "effective yaw inertia", i_eff, "kg m^2", "b / (2 r K8)");
    report.add("first_moment_kg_m", "centre of gravity times mass", k.k5_m * m_eff, "kg m",
               "ahead of the axle");
    // v omega^2 (m_eff K5 + I_eff K6) is power from nowhere; 0 where K5 and K6 belong together.
    const double first = m_eff * k.k5_m;
    const double second = i_eff * k.k6_per_m;
    const double scale = std::max(std::abs(first), std::abs(second));
    const double imbalance = scale > 0 ? (first + second) / scale : 0.0;
    report.add("energy_imbalance", "energy made by K5 with K6", imbalance, "",
               std::abs(imbalance) < 0.05 ? "none" : "they do not belong together: 0 would be right");
    report.add("fastest_start_m_per_s2", "acceleration at full torque",
               2 * k.k7_per_kg_m * p.limits.torque_Nm, "m/s^2");
    report.add("fastest_spin_rad_per_s2", "yaw acceleration at full torque",
               2 * k.k8_per_kg_m2 * p.limits.torque_Nm, "rad/s^2");
}

// What the ident mode will do, as far as it follows from the file; the rest follows from what its probe
// finds.
void report_ident(const task::RobotFile& robot, Report& report) {
    const model::RobotParameters& p = robot.parameters;
    ident::SizingRequest request;
    request.speed_limit_m_per_s = p.ident.speed_limit_m_per_s;
    request.yaw_rate_limit_rad_per_s = p.ident.yaw_rate_limit_rad_per_s;
    request.track_m = p.geometry.track_m;
    request.distance_limit_m = p.ident.distance_limit_m;
    request.robot_speed_limit_m_per_s = p.limits.speed_m_per_s;
    request.robot_yaw_rate_limit_rad_per_s = p.limits.yaw_rate_rad_per_s;
    const double speed = ident::speed_limit_m_per_s(request);
    const auto given_or = [](double value, const char* otherwise) { return value > 0 ? "given" : otherwise; };
    report.section("ident", "Identification");
    report.add("distance_limit_m", "room around the start", p.ident.distance_limit_m, "m",
               "distance_limit_m");
    report.add("duration_s", "longest time", p.ident.duration_s, "s", "duration_s");
    report.add("speed_limit_m_per_s", "speed limit", speed, "m/s",
               given_or(p.ident.speed_limit_m_per_s,
                        "auto: from the room and limits.speed_m_per_s; less where the robot brakes slowly"));
    report.add("yaw_rate_limit_rad_per_s", "yaw rate limit", ident::yaw_rate_limit_rad_per_s(request, speed),
               "rad/s",
               given_or(p.ident.yaw_rate_limit_rad_per_s,
                        "auto: wheels as fast as straight on, within limits.yaw_rate_rad_per_s"));
    const Twist<double> either = ident::within_either(
        Twist<double>{speed, ident::yaw_rate_limit_rad_per_s(request, speed)}, p.geometry.track_m / 2);
    report.add("unknown_signs_speed_m_per_s", "until the signs are known", either.v_m_per_s, "m/s",
               "one wheel may go backwards, and forward be turning: both limits hold all the same");
    report.add("unknown_signs_yaw_rate_rad_per_s", "", either.omega_rad_per_s, "rad/s");
    const auto left_to_probe = [&](const char* key, const char* label, double value, const char* unit,
                                   const char* from) {
        if (value > 0) return report.add(key, label, value, unit, "given");
        report.add(key, label, std::string("auto"), "", from);
    };
    const std::string most = "the probe finds it: at most limits.torque_Nm, " +
                             number_text(p.limits.torque_Nm) + " Nm, and what the drives deliver";
    left_to_probe("amplitude_Nm", "torque", p.ident.amplitude_Nm, "Nm", most.c_str());
    left_to_probe("bit_time_s", "bit", p.ident.bit_time_s, "s", "from the acceleration that the probe finds");
    left_to_probe("kernel_s", "averaging kernel", p.ident.kernel_s, "s", "from the bit");
    left_to_probe("coupling_standard_error_m", "wanted error of K5", p.ident.coupling_standard_error_m, "m",
                  "from acceleration and yaw rate limit");
    report.add("relative_standard_error_percent", "wanted error of K7, K8",
               100 * p.ident.relative_standard_error, "%");
}

// What driving comes to with the model of the file.
void report_driving(const model::RobotParameters& p, Report& report) {
    report.section("driving", "Driving");
    if (!model::dynamics_known(p)) {
        report.add("model", "K7, K8", std::string("not known"), "",
                   "identify first; what follows from them is not known either");
        return;
    }
    control::PathPace<double> pace;
    pace.begin(control::standard_figure_eight<double>(p));
    const auto plant = control::plant_model<double>(p);
    const auto limits = control::pace_limits<double>(p);
    while (pace.running()) pace.step(plant, limits);
    protocol::TrajectoryPace said;
    said.limited_by = static_cast<protocol::PaceLimit>(pace.limited_by());
    said.asked_period_s = pace.asked().period_s;
    said.period_s = pace.path().period_s;
    report.add("figure_eight_period_s", "standard figure-8, a lap", said.period_s, "s", pace_sentence(said));
    const auto from = [](double given) { return given > 0 ? "given" : "auto"; };
    const control::TrackingSettings<double>& t = limits.tracking;
    report.add("along_gain_per_s", "path, gain along", t.along_gain_per_s, "1/s",
               from(p.trajectory.along_gain_per_s));
    report.add("across_gain_per_m2", "path, gain across", t.across_gain_per_m2, "1/m^2",
               from(p.trajectory.across_gain_per_m2));
    report.add("heading_gain_per_m", "path, gain on the heading", t.heading_gain_per_m, "1/m",
               from(p.trajectory.heading_gain_per_m));
    const auto pose = control::pose_control_settings<double>(p);
    const auto& given = p.pose_control;
    report.add("gamma1_per_s", "pose goal, gamma1", pose.gamma1, "1/s", from(given.gamma1));
    report.add("gamma2_per_s", "pose goal, gamma2", pose.gamma2, "1/s", from(given.gamma2));
    report.add("pose_speed_m_per_s", "pose goal, speed", pose.speed_m_per_s, "m/s",
               from(given.speed_m_per_s));
    report.add("pose_yaw_rate_rad_per_s", "pose goal, yaw rate", pose.yaw_rate_rad_per_s, "rad/s",
               from(given.yaw_rate_rad_per_s));
    report.add("pose_acceleration_m_per_s2", "pose goal, acceleration", pose.acceleration_m_per_s2, "m/s^2",
               from(given.acceleration_m_per_s2));
    report.add("pose_yaw_acceleration_rad_per_s2", "pose goal, yaw acceleration",
               pose.yaw_acceleration_rad_per_s2, "rad/s^2", from(given.yaw_acceleration_rad_per_s2));
    report.add("stop_radius_m", "pose goal, reached within", pose.stop_radius_m, "m",
               from(given.stop_radius_m));
    report.add("slip_yaw_rate_rad_per_s", "slip beyond", task::SlipWatch::limit_rad_per_s(p), "rad/s",
               from(p.adaptation.slip_yaw_rate_rad_per_s));
}

void report_effects(const task::RobotFile& robot, Report& report) {
    const model::RobotParameters& p = robot.parameters;
    bool any = false;
    for (const bool active : p.effects.active) any = any || active;
    if (!any) return;
    report.section("effects", "Effects");
    report.table("parameters", {{"effect", "effect"},
                                {"parameter", "parameter"},
                                {"value", "value"},
                                {"standard_error", "standard error"},
                                {"unit", "unit"},
                                {"log", "from"}});
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (!p.effects.active[i]) continue;
        const model::EffectInfo& info = model::kEffects[i];
        const task::Provenance& from = robot.effect_provenance[i];
        for (std::size_t j = 0; j < info.parameters.size(); ++j) {
            report.row({std::string(info.name), std::string(info.parameters[j].name),
                        p.effects.parameter[i][j], p.effects_standard_error.parameter[i][j],
                        std::string(info.parameters[j].unit),
                        from.log + (from.date.empty() ? "" : " " + from.date)});
        }
    }
}

void report_bus(const task::RobotFile& robot, Report& report) {
    const model::RobotParameters& p = robot.parameters;
    report.section("bus", "Bus, worst case");
    const task::BusPlan plan = task::bus_plan(p);
    const double limit = p.bus.load_limit;
    const auto verdict = [&](double load) { return load > limit ? "too much" : "fits"; };
    report.add("shared_load_percent", "drives and host on one bus", plan.shared_load * 100, "%",
               verdict(plan.shared_load));
    report.add("drive_load_percent", "drives on a bus of their own", plan.drive_load * 100, "%",
               verdict(plan.drive_load));
    report.add("host_load_percent", "host on a bus of its own", plan.host_load * 100, "%",
               verdict(plan.host_load));
    report.add("load_limit_percent", "limit", limit * 100, "%");
    report.table("largest",
                 {{"message", "largest messages"}, {"period_ms", "period, ms"}, {"load_percent", "load, %"}});
    for (std::size_t i = 0; i < plan.frames.size() && i < 6; ++i) {
        report.row({plan.frames[i].name, plan.frames[i].period_s * 1e3, plan.frames[i].load * 100});
    }
}

int check(const Options& options) {
    if (options.explain) {
        std::fputs(parameter_reference().c_str(), stdout);
        if (options.file.empty()) return kDone;
    } else if (options.file.empty()) {
        std::fprintf(stderr, "wheelwright check: name a robot file, or ask for --explain\n");
        return kUsage;
    }
    const task::RobotFileResult result = task::read_robot_file(options.file);
    for (const task::Diagnostic& problem : result.problems) {
        std::fprintf(stderr, "%s\n", task::to_text(problem).c_str());
    }
    if (!result.robot.has_value()) return kUsage;
    const task::RobotFile& robot = *result.robot;
    Report report("check");
    report.section("robot", "");
    report.add("file", "file", options.file);
    report.add("name", "name", robot.name);
    report.add("keys_given", "keys given", static_cast<std::int64_t>(robot.given.size()), "",
               "the others have their defaults");
    report_model(robot, report);
    report_ident(robot, report);
    report_driving(robot.parameters, report);
    report_effects(robot, report);
    report_bus(robot, report);
    report.section("notes", result.notes.empty() ? "" : "Worth a look");
    report.table("list", {{"key", "key"}, {"note", "note"}});
    for (const task::Diagnostic& note : result.notes) report.row({note.key, note.message});
    return report.publish(options.json) ? kDone : kUsage;
}

}  // namespace

void add_check(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command =
        program.add_subcommand("check", "Check a robot file and print what follows from it");
    command.footer(
        "Every problem is printed as file:line:column: key: what was found, what was expected.\n"
        "Exit status 0: the file is good (notes are not errors); 1: it is not.");
    command.add_option("FILE", options->file, "Robot file (TOML)");
    command.add_flag("--explain", options->explain, "Print the reference of all keys in Markdown");
    command.add_option("--json", options->json, "Write the figures to this file too");
    command.callback([options, &run] { run = [options] { return check(*options); }; });
}

}  // namespace wheelwright::tools
