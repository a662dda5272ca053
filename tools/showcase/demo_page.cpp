#include "tools/showcase/demo_page.hpp"

#include <cmath>
#include <cstdio>

#include "tools/report/column.hpp"

namespace wheelwright::tools {
namespace {

using report::Chart;
using report::column;
using report::Section;
using report::Tone;

std::string text(const char* format, auto... values) {
    char buffer[256];
    std::snprintf(buffer, sizeof buffer, format, values...);
    return buffer;
}

Chart estimate_chart(const MainJob& job, const char* name, const char* unit, double real,
                     double (*pick)(const model::Dynamics<double>&)) {
    const IdentificationResult& id = job.identification;
    const auto value = column(id.value, pick);
    const auto error = column(id.standard_error, pick);
    report::Band band{"95 % interval", id.time_s, value, value, 0};
    for (std::size_t i = 0; i < value.size(); ++i) {
        // Before anything is known the interval would fill the picture.
        const double half = std::min(1.96 * error[i], 2 * std::abs(real));
        band.low[i] = value[i] - half;
        band.high[i] = value[i] + half;
    }
    Chart chart;
    chart.title = name;
    chart.x = {"time / s"};
    chart.y = {std::string(name) + " / " + unit};
    chart.y.minimum = real - 0.3 * std::abs(real);
    chart.y.maximum = real + 0.3 * std::abs(real);
    chart.series = {{"estimate", id.time_s, value}};
    chart.bands = {band};
    chart.levels = {{"truth", real}};
    chart.summary = text("%s converges to %.5g; the truth is %.5g %s.", name,
                         value.empty() ? std::nan("") : value.back(), real, unit);
    return chart;
}

void identification(report::Page& page, const MainJob& job) {
    Section& s = page.section("Identification");
    s.text(
        "A pseudo-random torque shakes each wheel by itself, within limits of speed, yaw rate and distance. "
        "After the delay from command to torque has been measured, recursive least squares estimates the "
        "four "
        "parameters of `v' = K5 w^2 + K7 (right + left)` and `w' = K6 v w + K8 (right - left)`, together "
        "with "
        "the friction of each wheel. It stops when the standard errors are small enough.");
    s.charts({estimate_chart(job, "K7", "1/(kg m)", job.truth.k7_per_kg_m,
                             [](const model::Dynamics<double>& k) { return k.k7_per_kg_m; }),
              estimate_chart(job, "K8", "1/(kg m^2)", job.truth.k8_per_kg_m2,
                             [](const model::Dynamics<double>& k) { return k.k8_per_kg_m2; })});
    s.charts({estimate_chart(job, "K5", "m", job.truth.k5_m,
                             [](const model::Dynamics<double>& k) { return k.k5_m; }),
              estimate_chart(job, "K6", "1/m", job.truth.k6_per_m,
                             [](const model::Dynamics<double>& k) { return k.k6_per_m; })});
    report::Table table;
    table.caption = "Identified parameters beside the simulated robot's truth";
    table.columns = {
        {"parameter"}, {"truth", true}, {"identified", true}, {"standard error", true}, {"error / %", true}};
    const auto& e = job.identification.estimate;
    const auto row = [&table](const std::string& name, double real, double value, double error) {
        table.rows.push_back({name, text("%.5g", real), text("%.5g", value), text("%.2g", error),
                              text("%+.2f", 100 * (value / real - 1))});
    };
    row("K5 / m", job.truth.k5_m, e.dynamics.k5_m, e.standard_error.k5_m);
    row("K6 / (1/m)", job.truth.k6_per_m, e.dynamics.k6_per_m, e.standard_error.k6_per_m);
    row("K7 / (1/(kg m))", job.truth.k7_per_kg_m, e.dynamics.k7_per_kg_m, e.standard_error.k7_per_kg_m);
    row("K8 / (1/(kg m^2))", job.truth.k8_per_kg_m2, e.dynamics.k8_per_kg_m2, e.standard_error.k8_per_kg_m2);
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (!e.effects.active[i] || !job.true_effects.active[i]) continue;
        for (std::size_t j = 0; j < model::kEffects[i].parameters.size(); ++j) {
            row(std::string(model::kEffects[i].name) + " " +
                    std::string(model::kEffects[i].parameters[j].name),
                job.true_effects.parameter[i][j], e.effects.parameter[i][j],
                e.effects_standard_error.parameter[i][j]);
        }
    }
    s.table(table);
}

Chart step_chart(const char* title, const char* label, const StepResponse& step, const std::vector<double>& y,
                 double wanted) {
    Chart chart;
    chart.title = title;
    chart.x = {"time / s"};
    chart.x.maximum = 0.15;
    chart.y = {label};
    chart.series = {{"true speed", step.time_s, y}};
    chart.levels = {{"set-point", wanted}, {"-1 %", 0.99 * wanted}, {"+1 %", 1.01 * wanted}};
    chart.marks = {{"settled", step.settling_s}};
    chart.summary = text("The true speed settles to 1 %% of %.3g within %.0f ms, overshoot %.2f %%.", wanted,
                         1e3 * step.settling_s, 100 * step.overshoot);
    return chart;
}

void tuning(report::Page& page, const MainJob& job) {
    Section& s = page.section("Tuning");
    s.text(
        text("The velocity loops are designed on the delayed, sampled plant from what was identified: "
             "gain %.1f per second, phase margin %.0f degrees, peak of the sensitivity %.2f.",
             job.design.gains.kp_per_s, job.design.phase_margin_deg, job.design.sensitivity_peak));
    s.charts({step_chart("Step of speed", "speed / (m/s)", job.speed_step, job.speed_step.v_m_per_s,
                         job.speed_step_m_per_s),
              step_chart("Step of yaw rate", "yaw rate / (rad/s)", job.yaw_step, job.yaw_step.omega_rad_per_s,
                         job.yaw_step_rad_per_s)});
}

void path_charts(Section& s, const TrackingResult& drive, const char* title) {
    const auto x = [](Pose<double> PathSample::*pose) {
        return [pose](const PathSample& p) { return (p.*pose).x_m; };
    };
    const auto y = [](Pose<double> PathSample::*pose) {
        return [pose](const PathSample& p) { return (p.*pose).y_m; };
    };
    Chart path;
    path.title = title;
    path.x = {"x / m"};
    path.y = {"y / m"};
    path.equal_aspect = true;
    path.series = {
        {"reference", column(drive.samples, x(&PathSample::reference)),
         column(drive.samples, y(&PathSample::reference)), report::Draw::line, true},
        {"true path", column(drive.samples, x(&PathSample::truth)),
         column(drive.samples, y(&PathSample::truth))},
        {"wheels alone", column(drive.samples, x(&PathSample::bare_odometry)),
         column(drive.samples, y(&PathSample::bare_odometry))},
    };
    path.summary =
        text("The robot joins the figure-8 and stays within %.1f mm of the moving reference point.",
             1e3 * drive.peak_m);
    Chart error;
    error.title = "Distance from the reference point at that time";
    error.x = {"time / s"};
    error.y = {"error / mm", true};
    error.series = {{"error", column(drive.samples, [](const PathSample& p) { return p.time_s; }),
                     column(drive.samples, [](const PathSample& p) { return 1e3 * p.error_m; })}};
    error.marks = {{"judged from here", 12}};
    error.levels = {{"15 mm", 15}};
    error.summary =
        text("From 12 s on %.2f mm RMS and %.2f mm at worst.", 1e3 * drive.rms_m, 1e3 * drive.peak_m);
    s.charts({path, error});
}

void driving(report::Page& page, const MainJob& job) {
    Section& s = page.section("Figure-8");
    s.text(
        "The robot starts one metre beside the path. It knows its place from its wheels and from an external "
        "pose, twenty times a second with 2 mm of noise. The error is judged by the simulated robot's true "
        "pose "
        "against the reference point at the same instant.");
    path_charts(s, job.figure_eight, "Figure-8 from one metre off the path");
}

void adaptation(report::Page& page, const MainJob& job) {
    Section& s = page.section("Adaptation");
    s.text(
        text("At %.0f s mass and inertia grow by %.0f %%. The estimator notices, doubts what it knew and "
             "follows; the controller's model follows the estimate at a limited rate.",
             job.payload_time_s, 100 * job.payload_share));
    const auto chart = [&](const char* name, const char* label,
                           double (*pick)(const model::Dynamics<double>&)) {
        Chart c;
        c.title = name;
        c.x = {"time / s"};
        c.y = {label};
        c.series = {
            {"truth", job.adaptation_time_s, column(job.true_dynamics, pick), report::Draw::line, true},
            {"estimate", job.adaptation_time_s, column(job.adapted, pick)}};
        c.marks = {{"payload", job.payload_time_s}};
        c.summary = text("%s follows the change of the robot.", name);
        return c;
    };
    s.charts(
        {chart("K7", "K7 / (1/(kg m))", [](const model::Dynamics<double>& k) { return k.k7_per_kg_m; }),
         chart("K8", "K8 / (1/(kg m^2))", [](const model::Dynamics<double>& k) { return k.k8_per_kg_m2; })});
    path_charts(s, job.adaptive, "The same figure-8 while the payload comes");
}

void missing(report::Page& page, const HiddenEffect& hidden) {
    Section& s = page.section("What the model lacks");
    const gap::Findings& f = hidden.findings;
    s.text(
        "Another simulated robot, in virtual time, hides an effect that the firmware's model lacks, drawn at "
        "random. It was driven for " +
        text("%.0f s", hidden.driven_s) +
        ", and `wheelwright gap` got the log of the bus and the firmware's robot file, nothing else. The "
        "whole story "
        "is in `gap/report.html` beside this page.");
    if (!hidden.problem.empty() || !f.closed_loop) {
        s.note(Tone::bad, hidden.problem);
        return;
    }
    report::Table table;
    table.caption = "Hidden, and found";
    table.columns = {{"parameter"}, {"truth", true}, {"found", true}, {"standard error", true}};
    for (std::size_t j = 0; j < model::kEffects[hidden.effect].parameters.size(); ++j) {
        std::vector<report::Cell> row{
            hidden.name() + " " + std::string(model::kEffects[hidden.effect].parameters[j].name),
            text("%.4g", hidden.parameters[j])};
        if (hidden.found()) {
            const gap::ParameterEstimate& p = f.effects[0].parameters[j];
            row.emplace_back(text("%.4g", p.value));
            row.emplace_back(text("%.2g", p.standard_error));
        }
        table.rows.push_back(row);
    }
    s.table(table);
    if (!hidden.found()) {
        s.note(Tone::bad, "It was not found: " + f.conclusion.reason + ".");
    }
    const gap::ClosedLoop& loop = *f.closed_loop;
    report::Table drives;
    drives.caption = "The figure-8 of that robot, with an exact external pose, from 12 s on";
    drives.columns = {{"controller believes"}, {"RMS / mm", true}, {"at worst / mm", true}};
    const auto row = [&](const char* name, const gap::FigureEight& drive) {
        drives.rows.push_back({name, text("%.2f", 1e3 * drive.rms_m), text("%.2f", 1e3 * drive.peak_m)});
    };
    if (loop.nominal) row("before: the firmware's robot file", *loop.nominal);
    row("K5..K8 fitted anew", loop.before);
    row("after: with what was found", loop.after);
    if (loop.truth) row("the truth itself", *loop.truth);
    s.table(drives);
    Chart chart;
    chart.title = "Distance from the reference point";
    chart.x = {"time / s"};
    chart.y = {"error / mm"};
    chart.y.maximum = 5;
    const auto series = [&](const char* name, const gap::FigureEight& drive) {
        chart.series.push_back({name, drive.t_s, column(drive.error_m, [](double e) { return 1e3 * e; })});
    };
    if (loop.nominal) series("before", *loop.nominal);
    series("after", loop.after);
    chart.marks = {{"judged from here", 12}};
    chart.summary = text("Tracking error before (%.2f mm RMS) and after (%.2f mm RMS).",
                         1e3 * (loop.nominal ? *loop.nominal : loop.before).rms_m, 1e3 * loop.after.rms_m);
    s.chart(chart);
}

}  // namespace

report::Page demo_page(const MainJob& job, const HiddenEffect* hidden, const std::string& interface) {
    report::Page page("A robot learned, tuned and driven",
                      "What `wheelwright demo` did: the firmware met a simulated robot on a CAN bus, found "
                      "out how it moves, "
                      "designed its controllers from that, followed a figure-8 and adapted to a payload.");
    const auto tone = [](bool good) { return good ? Tone::good : Tone::bad; };
    const auto& e = job.identification.estimate;
    page.figures(
        {{"K7 identified", text("%+.2f %%", 100 * (e.dynamics.k7_per_kg_m / job.truth.k7_per_kg_m - 1)),
          "against the truth", tone(job.identification.succeeded)},
         {"settling time", text("%.0f ms", 1e3 * job.speed_step.settling_s), "step of 0.15 m/s",
          tone(job.settles_in_time())},
         {"figure-8", text("%.1f mm", 1e3 * job.figure_eight.rms_m),
          text("RMS; at worst %.1f mm", 1e3 * job.figure_eight.peak_m),
          tone(job.figure_eight.rms_m <= 0.005 && job.figure_eight.peak_m <= 0.015)},
         {"payload", text("%.1f %%", 100 * std::max(std::abs(job.k7_error), std::abs(job.k8_error))),
          "error of K7 and K8, 3 s after", tone(std::abs(job.k7_error) <= 0.05)}});
    identification(page, job);
    if (job.identification.succeeded) {
        tuning(page, job);
        driving(page, job);
        adaptation(page, job);
    }
    if (hidden != nullptr) missing(page, *hidden);
    page.footer(interface.empty() ? "Made by `wheelwright demo` in virtual time on an in-process CAN bus."
                                  : "Made by `wheelwright demo --can " + interface + "` in real time.");
    return page;
}

}  // namespace wheelwright::tools
