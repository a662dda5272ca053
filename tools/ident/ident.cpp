// `wheelwright ident`: K5..K8 and the effects' parameters from logs.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>

#include "firmware/task/robot_file.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/geometry_options.hpp"
#include "tools/cli/log_options.hpp"
#include "tools/cli/report.hpp"
#include "tools/cli/robots.hpp"
#include "tools/ident/findings.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    std::vector<std::string> logs;
    std::string model, write, json;
    GeometryOptions geometry;
    LogOptions reading;
    std::vector<std::string> effects;
    double relative_standard_error = 0;
};

int usage(const std::string& message) {
    std::fprintf(stderr, "wheelwright ident: %s\n", message.c_str());
    return kUsage;
}

bool same_geometry(const model::Geometry<double>& a, const model::Geometry<double>& b) {
    return a.wheel_radius_m.left == b.wheel_radius_m.left &&
           a.wheel_radius_m.right == b.wheel_radius_m.right && a.track_m == b.track_m;
}

// "" or what is wrong. Without names: those active in the robot file that the estimators carry (the others
// are taken as the file says), else the two frictions every robot has.
std::string choose_effects(const Options& options, IdentSetup& setup) {
    if (options.effects.empty()) {
        setup.effects = model::estimated_effects(setup.robot.effects.active);
        bool any = false;
        for (const bool active : setup.effects) any = any || active;
        if (any) return "";
        setup.effects[model::find_effect(model::ViscousFriction::info.name)] = true;
        setup.effects[model::find_effect(model::CoulombFriction::info.name)] = true;
        return "";
    }
    setup.robot.effects.active = {};
    for (const std::string& name : options.effects) {
        if (name == "none") continue;
        const std::size_t i = model::find_effect(name);
        if (i == model::kEffectCount) {
            std::string message = "no effect is called " + name + "; there are:";
            for (const model::EffectInfo& info : model::kEffects) message.append(" ").append(info.name);
            return message;
        }
        setup.effects[i] = true;
    }
    const std::array<bool, model::kEffectCount> estimated = model::estimated_effects(setup.effects);
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (setup.effects[i] == estimated[i]) continue;
        return std::string(model::kEffects[i].name) +
               (model::kLinearInParameters[i]
                    ? " is too much: there is room for " + std::to_string(model::kMaxEstimatedColumns) +
                          " parameters of effects"
                    : " is not linear in its parameters: it cannot be looked for here");
    }
    return "";
}

Cell cell(bool known, double value) { return known ? Cell{value} : Cell{std::string("unknown")}; }

std::string interval_text(const Estimate& e) {
    if (!e.known) return "";
    return number_text(e.value - 1.96 * e.standard_error, 5) + " .. " +
           number_text(e.value + 1.96 * e.standard_error, 5);
}

void report_dynamics(const Findings& f, Report& report) {
    report.section("dynamics", "Dynamics");
    report.table("parameters", {{"parameter", "parameter"},
                                {"value", "value"},
                                {"standard_error", "standard error"},
                                {"relative_percent", "in %"},
                                {"interval_95", "95 % interval"},
                                {"unit", "unit"},
                                {"covariance_diagonal", "bare P"},
                                {"excitation", "excitation"},
                                {"excitation_unit", "in"}});
    const auto percent = [](const Estimate& e) { return 100 * e.standard_error / std::abs(e.value); };
    for (const DynamicsFigure& k : f.k) {
        report.row({std::string(k.label), cell(k.known, k.value), cell(k.known, k.standard_error),
                    cell(k.known, std::round(100 * percent(k)) / 100), interval_text(k), std::string(k.unit),
                    k.covariance_diagonal, k.excitation, std::string(k.excitation_unit)});
    }
    report.section("effects", "Effects");
    report.table("parameters", {{"effect", "effect"},
                                {"parameter", "parameter"},
                                {"value", "value"},
                                {"standard_error", "standard error"},
                                {"interval_95", "95 % interval"},
                                {"unit", "unit"},
                                {"remark", "remark"}});
    for (const EffectFigure& e : f.effects) {
        const model::EffectInfo& info = model::kEffects[e.effect];
        const model::EffectParameterInfo& parameter = info.parameters[e.parameter];
        report.row({std::string(info.name), std::string(parameter.name), cell(e.known, e.value),
                    cell(e.known, e.standard_error), interval_text(e), std::string(parameter.unit),
                    e.known && !e.common && !e.significant() ? "may be zero" : e.reason});
    }
}

void report_derived(const Findings& f, const model::Geometry<double>& geometry, Report& report) {
    const double r = geometry.mean_radius_m();
    report.section("body", "What follows");
    if (f.k7().known) {
        const double mass = 1 / (f.k7().value * r);
        report.add("effective_mass_kg", "effective mass", mass, "kg",
                   "1 / (K7 r), +- " + number_text(mass * f.k7().standard_error / f.k7().value, 2));
    }
    if (f.k8().known) {
        const double inertia = geometry.track_m / (2 * r * f.k8().value);
        report.add("effective_yaw_inertia_kg_m2", "effective yaw inertia", inertia, "kg m^2",
                   "b / (2 r K8), +- " + number_text(inertia * f.k8().standard_error / f.k8().value, 2));
    }
    if (f.k5().known && f.k7().known && f.k8().known) {
        const double follows = model::coupled_k6(f.k5().value, f.k7().value, f.k8().value, geometry.track_m);
        std::string remark = "-K5 2 K8 / (b K7)";
        if (f.k6().known) {
            const double slope = follows / (f.k5().value == 0 ? 1 : f.k5().value);
            const double error = std::hypot(f.k6().standard_error, slope * f.k5().standard_error);
            remark += ": " + number_text(std::abs(f.k6().value - follows) / error, 2) +
                      " standard errors from the K6 above";
        }
        report.add("k6_from_k5_per_m", "K6 that belongs to K5", follows, "1/m", remark);
    }
    report.section("actuation", "Actuation");
    report.add("delay_s", "delay", cell(f.delay_s.known, f.delay_s.value), f.delay_s.known ? "s" : "",
               f.delay_s.known ? f.delay_meaning : f.delay_s.reason);
    report.add("delay_standard_error_s", "standard error", cell(f.delay_s.known, f.delay_s.standard_error),
               f.delay_s.known ? "s" : "");
}

void report_quality(const Findings& f, Report& report) {
    report.section("residuals", "What the model leaves over");
    report.add("linear_rms_m_per_s2", "of dv/dt, rms", f.residual_rms.v_m_per_s2, "m/s^2",
               number_text(100 * f.explained_share.v_m_per_s2, 4) + " % of its power explained");
    report.add("turning_rms_rad_per_s2", "of domega/dt, rms", f.residual_rms.omega_rad_per_s2, "rad/s^2",
               number_text(100 * f.explained_share.omega_rad_per_s2, 4) + " % of its power explained");
    report.add("rows", "rows used", static_cast<std::int64_t>(f.rows), "",
               "each averaged over " + number_text(1e3 * f.averaged_over_s, 3) + " ms");
    report.add("masked_rows", "rows left out", static_cast<std::int64_t>(f.masked_rows), "",
               "a wheel stood still, or something below");
}

void report_limits(const Findings& f, Report& report) {
    bool any = false;
    for (const DynamicsFigure& k : f.k) any = any || !k.known;
    for (const EffectFigure& e : f.effects) any = any || !e.known || e.common;
    report.section("unknown", any ? "What these logs cannot tell" : "");
    report.table("list", {{"parameter", "parameter"}, {"reason", "reason"}});
    for (const DynamicsFigure& k : f.k) {
        if (!k.known) report.row({std::string(k.label), "not identifiable from these logs; " + k.reason});
    }
    for (const EffectFigure& e : f.effects) {
        if (e.known && !e.common) continue;
        report.row({std::string(model::kEffects[e.effect].name) + "." +
                        std::string(model::kEffects[e.effect].parameters[e.parameter].name),
                    e.reason});
    }
    report.section("notes", f.notes.empty() ? "" : "Worth a look");
    report.table("list", {{"note", "note"}});
    for (const std::string& note : f.notes) report.row({note});
}

std::string all_names(const Findings& f) {
    std::string names;
    for (const LogFacts& log : f.logs) {
        const std::size_t slash = log.name.rfind('/');
        names += (names.empty() ? "" : ", ") +
                 (slash == std::string::npos ? log.name : log.name.substr(slash + 1));
    }
    return names;
}

// What is to be written into `target`. A date that is there belongs to another log: it is taken out where
// this one does not tell its own.
std::vector<task::FileChange> file_changes(const Findings& f, bool candump, const task::RobotFile& target) {
    std::vector<task::FileChange> changes;
    const std::string names = all_names(f);
    const std::string date = f.logs.back().date;
    const auto put_date = [&](const std::string& key, const task::Provenance& former) {
        if (date != former.date) changes.push_back({key, date});
    };
    bool any = false;
    for (const DynamicsFigure& k : f.k) {
        if (!k.known) continue;
        any = true;
        changes.push_back({"dynamics." + std::string(k.key), k.value});
        changes.push_back({"dynamics_standard_error." + std::string(k.key), k.standard_error});
    }
    if (any) {
        changes.push_back({"dynamics.log", names});
        put_date("dynamics.date", target.dynamics_provenance);
    }
    for (const EffectFigure& e : f.effects) {
        if (!e.known) continue;
        const model::EffectInfo& info = model::kEffects[e.effect];
        const model::EffectParameterInfo& parameter = info.parameters[e.parameter];
        const std::string table = "effects." + std::string(info.name) + ".";
        changes.push_back(
            {table + std::string(parameter.name), std::clamp(e.value, parameter.minimum, parameter.maximum)});
        changes.push_back({table + "log", names});
        put_date(table + "date", target.effect_provenance[e.effect]);
    }
    // A CSV's delay belongs to whoever logged it; a bus log's is the firmware's own.
    if (candump && f.delay_s.known && f.delay_s.value >= 0) {
        changes.push_back({"velocity_loop.actuation_delay_s", f.delay_s.value});
    }
    return changes;
}

int ident(const Options& options) {
    IdentSetup setup;
    setup.robot = model::default_parameters();
    const std::string model_path = options.model.empty() ? options.write : options.model;
    if (!model_path.empty()) {
        const std::optional<task::RobotFile> robot = read_robot(model_path);
        if (!robot) return kUsage;
        setup.robot = robot->parameters;
    }
    auto& geometry = setup.robot.geometry;
    if (!options.geometry.apply(geometry, !model_path.empty())) return usage(kGeometryMissing);
    if (const std::string wrong = options.reading.apply(setup.reading); !wrong.empty()) return usage(wrong);
    if (const std::string wrong = choose_effects(options, setup); !wrong.empty()) return usage(wrong);
    setup.relative_standard_error = options.relative_standard_error > 0
                                        ? options.relative_standard_error
                                        : setup.robot.ident.relative_standard_error;
    std::optional<task::RobotFile> target;
    if (!options.write.empty()) {
        target = read_robot(options.write);
        if (!target) return kUsage;
        if (!same_geometry(target->parameters.geometry, geometry)) {
            return usage("the geometry differs from that of " + options.write +
                         ": K5..K8 belong to one geometry; change the file first");
        }
    }

    const Findings findings = identify_logs(options.logs, setup);
    if (!findings.problems.empty()) {
        for (const std::string& problem : findings.problems) std::fprintf(stderr, "%s\n", problem.c_str());
        return kBadInput;
    }
    const bool candump = findings.logs.front().form == "candump";
    if (candump && model_path.empty()) {
        return usage("a candump log needs --model ROBOT.toml: nodes, signs and gears stand there");
    }
    Report report("ident");
    report.section("logs", "Logs");
    report.table("list", {{"log", "log"},
                          {"form", "form"},
                          {"date", "date"},
                          {"duration_s", "duration, s"},
                          {"rate_Hz", "rate, Hz"},
                          {"samples", "samples"}});
    for (const LogFacts& log : findings.logs) {
        report.row({log.name, log.form, log.date, log.duration_s, std::round(log.rate_Hz * 100) / 100,
                    static_cast<std::int64_t>(log.samples)});
    }
    report_dynamics(findings, report);
    report_derived(findings, geometry, report);
    report_quality(findings, report);
    report_limits(findings, report);
    const bool good = findings.good_enough(setup.relative_standard_error);
    report.section("verdict", "");
    report.add("good_enough", "good enough", good, "",
               "K7 and K8 known to " + number_text(100 * setup.relative_standard_error, 3) + " % or better" +
                   (good ? "" : " are wanted"));
    if (!report.publish(options.json)) return kUsage;
    if (!options.write.empty()) {
        const std::string failed =
            task::save_robot_file(options.write, file_changes(findings, candump, *target));
        if (!failed.empty()) return usage(failed);
        std::printf("%s now has what is known%s.\n", options.write.c_str(),
                    findings.logs.back().date.empty() ? "; without a date, which the log does not tell" : "");
    }
    return good ? kDone : kAimMissed;
}

}  // namespace

void add_ident(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command = program.add_subcommand("ident", "Identify K5..K8 and friction from logs");
    command.footer(
        "LOG is a candump -L log of the bus with the drives, a CSV with the columns t_s, tau_left_Nm,\n"
        "tau_right_Nm, omega_left_rad_s, omega_right_rad_s[, gyro_z_rad_s] or others (--columns) at 20 Hz "
        "to 2 kHz,\n"
        "or a file of WPILib SysId, whole or as FILE.json:TEST (docs/logs.md). Several logs are one\n"
        "experiment. What the logs cannot tell is said, not guessed.\n"
        "Exit status 0: K7 and K8 are known well enough; 2: a log cannot be used; 3: they are not known, or "
        "not\n"
        "well enough.");
    command.add_option("LOG", options->logs, "Logs, all of one form").required();
    command.add_option("--model", options->model, "Robot file: geometry, drives, effects");
    options->geometry.add_to(command);
    options->reading.add_to(command);
    command
        .add_option("--effects", options->effects,
                    "Effects to look for, by name, with commas; none (default: the robot file's)")
        .delimiter(',');
    command
        .add_option(
            "--relative-standard-error", options->relative_standard_error,
            "Standard error over value at which K7 and K8 are good enough (default: the robot file's)")
        .check(greater_than_zero());
    command.add_option("--json", options->json, "Write the figures to this file too");
    command.add_option("--write", options->write,
                       "Write what is known into this robot file, with log and date");
    command.callback([options, &run] { run = [options] { return ident(*options); }; });
}

}  // namespace wheelwright::tools
