// report.html of `wheelwright gap`, for readers who do not know the method.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>

#include "tools/cli/report.hpp"
#include "tools/excite/motions.hpp"
#include "tools/gap/report/output.hpp"
#include "tools/report/page.hpp"

namespace wheelwright::gap {
namespace {

using report::Section;
using report::Tone;
using tools::number_text;

constexpr double kSmallest = 1e-6;  // probability that is printed

std::string code(const std::string& text) { return std::string("`").append(text).append("`"); }
std::string percent(double share, int digits = 3) { return number_text(100 * share, digits) + " %"; }
std::string millimetres(double metres) { return number_text(1e3 * metres, 3) + " mm"; }

// The verdict for whoever reads only the first lines.
struct VerdictWords {
    std::string title, lead;
};
VerdictWords words_of(const Findings& f) {
    switch (f.conclusion.verdict) {
        case Verdict::named: {
            std::string names;
            for (std::size_t i = 0; i < f.effects.size(); ++i) {
                const bool last = i + 1 == f.effects.size();
                names += (i == 0 ? "" : last ? " and " : ", ") + name_of(f.effects[i].effect);
            }
            return {"The model lacks " + names,
                    "What is named below explains the difference on parts of the log that were not used to "
                    "find it; what other effects would do in its place stands beside it."};
        }
        case Verdict::nothing_missing:
            return {"The model lacks nothing that this log shows",
                    "With its four motion parameters fitted anew the simulated robot does what the real one "
                    "did, as far as this log can show; further down stands what it could not have shown."};
        case Verdict::cannot_tell:
            return {"Something is missing, and this log cannot tell what",
                    "More than one effect explains the difference equally well. They would predict different "
                    "motions elsewhere, so none is chosen; the motion that would tell them apart is named "
                    "below."};
        case Verdict::unexplained:
            return {"Something is missing that no known effect explains",
                    "Part of the difference is real, that is, it repeats, but no effect of the catalogue "
                    "describes it. The places below say where to look."};
        case Verdict::unusable_log:
            break;
    }
    return {"This log cannot be used", ""};
}

void key_figures(report::Page& page, const Findings& f) {
    std::vector<report::KeyFigure> figures;
    for (const NamedEffect& e : f.effects) {
        figures.push_back(
            {name_of(e.effect), percent(e.closes), "of what a model can explain of the difference"});
    }
    if (!f.heldout.empty()) {
        const FreeRun& all = f.heldout.back();
        // of turning nothing is claimed where none was seen
        const auto of = f.turning ? &SpeedError::both : &SpeedError::forward;
        const bool better = all.after.*of < 0.9 * (all.before.*of);
        const std::string on = f.turning ? "on unseen data" : "forward, on unseen data";
        figures.push_back({"wheel speed error before", number_text(all.before.*of, 3) + " rad/s", on});
        figures.push_back(
            {"and after", number_text(all.after.*of, 3) + " rad/s", on, better ? Tone::good : Tone::plain});
    }
    if (f.closed_loop && f.closed_loop->before.driven && f.closed_loop->after.driven) {
        const ClosedLoop& loop = *f.closed_loop;
        const bool better = loop.after.rms_m < loop.before.rms_m;
        figures.push_back({"figure-8 after", millimetres(loop.after.rms_m),
                           "RMS; before " + millimetres(loop.before.rms_m),
                           better ? Tone::good : Tone::plain});
    }
    page.figures(figures);
}

void measured_against_simulated(report::Page& page, const Findings& f, const Request& request) {
    if (f.heldout.empty()) return;
    Section& s = page.section("Measured against simulated");
    s.text("These " + number_text(f.heldout_s, 3) +
           " s were kept aside: nothing on this page was fitted to them. The simulated robot starts with the "
           "first measured speeds and then gets the logged torques only, so its errors add up as they would "
           "in use. `before`: the model with its motion parameters K5..K8 fitted anew to the rest of the "
           "log. `after`: with what was found beside them. Both are the robots of the files beside this "
           "page, read back; " +
           code("wheelwright free-run " +
                std::filesystem::path(request.heldout_log.empty() ? request.logs.back() : request.heldout_log)
                    .filename()
                    .string() +
                " --robot robot.extended.toml" +
                (request.heldout_log.empty() ? " --from " + number_text(f.heldout_from_s, 15) : "")) +
           " says it again, with " + code("robot.before.toml") + " what was before.");
    const Trace& t = f.trace;
    const auto error = [&](const std::vector<double>& simulated) {
        std::vector<double> e;
        for (std::size_t i = 0; i < std::min(simulated.size(), t.measured.size()); ++i) {
            e.push_back(simulated[i] - t.measured[i]);
        }
        return e;
    };
    s.charts({{.title = "Speed of the left wheel",
               .x = {"time / s"},
               .y = {"wheel speed / (rad/s)"},
               .series = {{"before", t.t_s, t.before},
                          {"after", t.t_s, t.after},
                          {.name = "measured", .x = t.t_s, .y = t.measured, .reference = true}},
               .caption = "The first ten seconds of the part kept aside.",
               .summary = "Speed of the left wheel over time, measured and simulated before and after."},
              {.title = "Simulated less measured",
               .x = {"time / s"},
               .y = {"error / (rad/s)"},
               .series = {{"before", t.t_s, error(t.before)}, {"after", t.t_s, error(t.after)}},
               .levels = {{"no error", 0}},
               .caption = "What is left after is mostly the sensor's noise, where the model is right.",
               .summary = "Error of the left wheel's simulated speed over time, before and after."}});
    const bool nominal = f.heldout.back().nominal.has_value();
    if (!f.turning) {
        s.text(
            "The robot went straight, so nothing is said of how it turns: the second table is of the mean of "
            "both wheels, how it goes forward. The first one holds half the difference of the wheels beside "
            "it, which no model of a robot that goes straight explains.");
    }
    const auto errors = [&](const std::string& title, double SpeedError::*of, double noise_rad_per_s) {
        report::Table table{title, {{"run free for"}}, {}};
        if (nominal) table.columns.push_back({"given model", true});
        for (const char* name : {"before", "after", "sensor noise"}) table.columns.push_back({name, true});
        for (const FreeRun& r : f.heldout) {
            std::vector<report::Cell> row{r.window_s > 0 ? number_text(r.window_s, 3) + " s at a time"
                                                         : "the whole part"};
            if (nominal) row.emplace_back(number_text(r.nominal.value_or(SpeedError{NAN, NAN}).*of, 3));
            for (const double value : {r.before.*of, r.after.*of, noise_rad_per_s})
                row.emplace_back(number_text(value, 3));
            table.rows.push_back(row);
        }
        s.table(table);
    };
    errors("Error of the wheel speeds, RMS over both wheels, in rad/s", &SpeedError::both, f.floor_rad_per_s);
    if (!f.turning) {
        errors("Error of the wheels' mean speed, RMS in rad/s", &SpeedError::forward,
               f.floor_rad_per_s / std::numbers::sqrt2);
    }
}

void missing_torque(Section& s, const Curve& curve) {
    s.text(
        "From each tenth of a second: how much torque would have to be added to the model to make it do what "
        "the robot did, against the wheel speed at that time. A complete model lies on zero. The shape is "
        "what a person looks at first: a step at zero speed is dry friction, a slope is friction that grows "
        "with speed, an offset is a hill or a sensor's zero.");
    s.chart({.title = "Torque that is missing",
             .x = {"mean wheel speed / (rad/s)"},
             .y = {"torque per wheel / Nm"},
             .series = {{"before", curve.x, curve.before}, {"after", curve.x, curve.after}},
             .levels = {{"nothing missing", 0}},
             .caption = "Means in bins of wheel speed, both wheels together.",
             .summary = "Missing torque against wheel speed, before and after, in " +
                        std::to_string(curve.x.size()) + " bins."});
}

void where(report::Page& page, const Findings& f) {
    if (f.against_speed.x.empty() && f.where.empty()) return;
    Section& s = page.section("Where they part");
    if (!f.against_speed.x.empty()) missing_torque(s, f.against_speed);
    if (f.where.empty()) return;
    s.text(
        "Before anything is named, the difference is compared with everything the motion offers. The shares "
        "overlap, as speed, torque and direction go together in most drives.");
    report::Table table{
        "What the difference depends on", {{"place"}, {"share of the difference / %", true}}, {}};
    for (const Place& p : f.where) table.rows.push_back({p.name, number_text(100 * p.explains, 3)});
    s.table(table);
}

void parameters(Section& s, const NamedEffect& e) {
    const model::EffectInfo& info = model::kEffects[e.effect];
    report::Table table{
        "Parameters of " + std::string(info.name),
        {{"parameter"}, {"value", true}, {"standard error", true}, {"95 % interval", true}, {"unit"}},
        {},
        true};
    for (std::size_t j = 0; j < e.parameters.size(); ++j) {
        const ParameterEstimate& p = e.parameters[j];
        table.rows.push_back({std::string(info.parameters[j].name), number_text(p.value, 4),
                              number_text(p.standard_error, 2),
                              number_text(p.interval_95[0], 4) + " .. " + number_text(p.interval_95[1], 4),
                              std::string(info.parameters[j].unit)});
    }
    s.table(table);
}

void evidence(Section& s, const NamedEffect& e) {
    s.list({"It closes " + percent(e.closes) +
                " of the difference that any model could close (the rest is noise that does not repeat).",
            "Its torque is " + percent(e.torque_share) + " of the torque that drove the robot.",
            "Were it not there, an improvement like this on parts of the log that did not choose it would "
            "come about by chance with a probability " +
                (e.probability < kSmallest ? "below " + number_text(kSmallest)
                                           : "of " + number_text(e.probability, 2)) +
                "."});
    const bool any = !e.rivals.empty() || !e.ruled_out.empty();
    if (!any) return;
    report::Table table{"Another effect in its place: what it would keep of the improvement",
                        {{"effect"}, {"keeps / %", true}, {"therefore"}},
                        {},
                        true};
    for (const Rival& r : e.rivals) {
        table.rows.push_back({name_of(r.effect), number_text(100 * r.keeps, 3),
                              r.confounded ? "does the same in every motion of this log" : "not ruled out"});
    }
    std::vector<Rival> out = e.ruled_out;
    std::sort(out.begin(), out.end(), [](const Rival& a, const Rival& b) { return a.keeps > b.keeps; });
    for (const Rival& r : out) {
        table.rows.push_back(
            {name_of(r.effect), number_text(100 * std::max(0.0, r.keeps), 3), {"ruled out", Tone::quiet}});
    }
    s.table(table);
    s.text(
        "An effect that is not listed is in the model already, would need an impossible size, does not show "
        "in this log, or is not searched for.");
    for (const Rival& r : e.rivals) {
        std::string text =
            "What would tell " + code(name_of(e.effect)) + " from " + code(name_of(r.effect)) + ": ";
        if (!r.measurement.empty()) {
            text += std::string(r.measurement) + ".";
        } else if (r.motion == nullptr) {
            text += "another motion.";
        } else {
            text += std::string(r.motion->words) +
                    ". `wheelwright excite --advice gap.json` drives it; give the next `wheelwright gap` "
                    "both logs.";
        }
        s.note(Tone::plain, text);
    }
}

void missing(report::Page& page, const Findings& f) {
    Section& s = page.section("What is missing, and why that");
    if (f.effects.empty()) s.text("No effect is named: " + f.conclusion.reason + ".");
    for (const NamedEffect& e : f.effects) {
        const model::EffectInfo& info = model::kEffects[e.effect];
        s.text(code(std::string(info.name)) + ": " + std::string(info.meaning) +
               ". Where its equation comes from: " + std::string(info.source) + ".");
        parameters(s, e);
        evidence(s, e);
    }
}

void closed_loop(report::Page& page, const ClosedLoop& loop) {
    Section& s = page.section("What it is worth to the controller");
    s.text("The standard figure-8, driven by " + loop.plant +
           ", from one metre beside the path and with an exact external pose; judged by its true pose "
           "against the reference point at that time, from 12 s on.");
    report::Table table{"Distance from the reference point",
                        {{"controller believes"}, {"RMS / mm", true}, {"at worst / mm", true}},
                        {}};
    const auto row = [&](const char* name, const FigureEight& drive) {
        if (drive.driven) {
            table.rows.push_back(
                {name, number_text(1e3 * drive.rms_m, 3), number_text(1e3 * drive.peak_m, 3)});
        } else {
            table.rows.push_back({name, {"stopped " + drive.stopped, Tone::bad}, ""});
        }
    };
    if (loop.nominal) row("the given model", *loop.nominal);
    row("before: K5..K8 fitted anew", loop.before);
    row("after: with what was found", loop.after);
    if (loop.truth) row("the truth itself", *loop.truth);
    s.table(table);
    if (loop.truth) {
        s.text(
            "What is left for a controller that knows the truth comes from elsewhere: wheel radii that are "
            "not quite those believed, the encoders' steps, the bus.");
    }
    if (!loop.before.driven || !loop.after.driven) return;
    const auto mm = [](std::vector<double> values) {
        for (double& v : values) v *= 1e3;
        return values;
    };
    s.charts({{.title = "Path",
               .x = {"x / m"},
               .y = {"y / m"},
               .series = {{"before", loop.before.x_m, loop.before.y_m},
                          {"after", loop.after.x_m, loop.after.y_m},
                          {.name = "reference",
                           .x = loop.after.reference_x_m,
                           .y = loop.after.reference_y_m,
                           .reference = true}},
               .equal_aspect = true,
               .caption = "The true path of the simulated robot.",
               .summary = "Reference and true paths of the figure-8, before and after."},
              {.title = "Distance from the reference point",
               .x = {"time / s"},
               .y = {"error / mm", true},
               .series = {{"before", loop.before.t_s, mm(loop.before.error_m)},
                          {"after", loop.after.t_s, mm(loop.after.error_m)}},
               .marks = {{"judged from here", 12}},
               .caption = "On a logarithmic scale.",
               .summary = "Tracking error over time: " + number_text(1e3 * loop.before.rms_m, 3) +
                          " mm RMS before, " + number_text(1e3 * loop.after.rms_m, 3) + " mm after."}});
}

void unknown(report::Page& page, const Findings& f) {
    Section& s = page.section("What this log could not have shown");
    if (!f.search.unknowable.empty()) {
        std::vector<std::string> names;
        for (const std::string& n : f.search.unknowable) names.push_back(code(n));
        s.text("This log says nothing of " + joined(names) +
               ": the robot did not move in a way in which they matter.");
    }
    s.text(
        "The smallest size of each effect that would have been named four times of five, had it been there, "
        "or would be a rival of what is. Smaller ones may be there unseen; `not in this log` means that no "
        "size would have shown. " +
        code("wheelwright gap --verify-detection") + " puts them to the test.");
    report::Table table{"", {{"effect"}, {"parameter"}, {"smallest size", true}, {"unit"}}, {}};
    for (const Detectable& d : f.search.detectable) {
        const model::EffectInfo& info = model::kEffects[d.effect];
        for (std::size_t j = 0; j < std::min(d.size.size(), info.parameters.size()); ++j) {
            const bool seen = std::isfinite(d.size[j]);
            table.rows.push_back({std::string(info.name), std::string(info.parameters[j].name),
                                  seen ? number_text(d.size[j], 2) : std::string("not in this log"),
                                  seen ? std::string(info.parameters[j].unit) : std::string()});
        }
    }
    s.table(table);
}

void about(report::Page& page, const Findings& f, const Request& request) {
    Section& s = page.section("What was read");
    std::vector<std::string> items;
    for (const std::string& log : request.logs)
        items.push_back(std::filesystem::path(log).filename().string());
    s.list(items);
    s.text(number_text(f.duration_s, 4) + " s at " + number_text(f.rate_Hz, 4) + " Hz, in " +
           std::to_string(f.blocks) + " pieces; noise of the wheel speeds " +
           number_text(f.floor_rad_per_s, 2) + " rad/s. " +
           (f.turning
                ? "Driving and turning were compared."
                : "The robot hardly turned: only driving was compared, and nothing is said of turning."));
    for (const std::string& note : f.notes) s.note(Tone::quiet, note);
}

}  // namespace

void write_page(const Findings& f, const Request& request, const std::string& path) {
    const VerdictWords verdict = words_of(f);
    report::Page page(verdict.title,
                      "A robot was driven and its torques and wheel speeds were logged. A simulated robot "
                      "was given the same torques. This page shows where the two part, and why. " +
                          verdict.lead);
    key_figures(page, f);
    measured_against_simulated(page, f, request);
    where(page, f);
    missing(page, f);
    if (f.closed_loop) closed_loop(page, *f.closed_loop);
    unknown(page, f);
    about(page, f, request);
    page.footer("Made by `wheelwright gap`. The method: docs/gap.md.");
    page.write(path);
}

}  // namespace wheelwright::gap
