#include "tools/paper/paper_sections.hpp"

#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "tools/report/column.hpp"
#include "tools/report/format.hpp"

namespace wheelwright::paper {
namespace {

using report::Chart;
using report::column;
using report::Draw;
using report::fixed;
using report::percent;
using report::Section;
using report::Series;
using report::signed_fixed;
using report::significant;
using report::Table;
using report::Tone;
using report::with_unit;

// An angle over time without its jumps of a whole turn.
std::vector<double> unwrapped(std::vector<double> angles_rad) {
    for (std::size_t i = 1; i < angles_rad.size(); ++i)
        angles_rad[i] = angles_rad[i - 1] + wrap_angle_rad(angles_rad[i] - angles_rad[i - 1]);
    return angles_rad;
}

// Moves a whole curve by turns so that it begins near another one.
std::vector<double> beside(std::vector<double> angles_rad, double start_rad) {
    angles_rad = unwrapped(std::move(angles_rad));
    if (angles_rad.empty()) return angles_rad;
    const double shift = start_rad + wrap_angle_rad(angles_rad.front() - start_rad) - angles_rad.front();
    for (double& angle : angles_rad) angle += shift;
    return angles_rad;
}

// One lap of them: a dashed line drawn over itself would be solid.
template <typename Sample>
std::vector<Sample> one_lap(const std::vector<Sample>& samples, double from_s, double period_s) {
    std::vector<Sample> out;
    for (const Sample& sample : samples)
        if (sample.time_s >= from_s && sample.time_s <= from_s + period_s) out.push_back(sample);
    return out;
}

Series path_of(std::string name, const std::vector<DrivenSample>& samples,
               const Pose<double> DrivenSample::*pose, bool reference = false) {
    return {std::move(name), column(samples, [pose](const DrivenSample& s) { return (s.*pose).x_m; }),
            column(samples, [pose](const DrivenSample& s) { return (s.*pose).y_m; }), Draw::line, reference};
}

Series path_of(std::string name, const std::vector<tools::PathSample>& samples,
               Pose<double> tools::PathSample::*pose, bool reference = false) {
    return {std::move(name), column(samples, [pose](const tools::PathSample& s) { return (s.*pose).x_m; }),
            column(samples, [pose](const tools::PathSample& s) { return (s.*pose).y_m; }), Draw::line,
            reference};
}

}  // namespace

void add_pose(report::Page& page, const Reproduction& from) {
    Section& section = page.section("Pose control: eq (73)–(87)");
    section.text(
        "The printed law measures e and ψ from the goal to the robot, so α = 0 faces away from the goal and "
        "the "
        "robot backs in. Mirrored, it drives forward. The firmware offers both and an automatic choice, "
        "wraps α, "
        "bounds speed and acceleration, and finishes: stop inside a few millimetres, turn onto the heading, "
        "hold.");
    std::vector<Chart> row;
    for (const auto& [direction, name] : {std::pair{protocol::PoseDirection::forward, "forward"},
                                          {protocol::PoseDirection::reverse, "in reverse"}}) {
        Series paths{"paths driven", {}, {}};
        Series goals{"goals", {}, {}, Draw::points};
        Series headings{"heading at the goal", {}, {}};
        for (const PoseDrive& drive : from.poses) {
            if (drive.direction != direction) continue;
            const double gap = std::numeric_limits<double>::quiet_NaN();
            paths.x.insert(paths.x.end(), drive.x_m.begin(), drive.x_m.end());
            paths.y.insert(paths.y.end(), drive.y_m.begin(), drive.y_m.end());
            paths.x.push_back(gap);
            paths.y.push_back(gap);
            goals.x.push_back(drive.goal.x_m);
            goals.y.push_back(drive.goal.y_m);
            headings.x.insert(headings.x.end(),
                              {drive.goal.x_m, drive.goal.x_m + 0.3 * std::cos(drive.goal.heading_rad), gap});
            headings.y.insert(headings.y.end(),
                              {drive.goal.y_m, drive.goal.y_m + 0.3 * std::sin(drive.goal.heading_rad), gap});
        }
        row.push_back(
            {.title = std::string("Eight ways to a pose, ") + name,
             .x = {"x / m"},
             .y = {"y / m"},
             .series = {std::move(paths), std::move(goals), std::move(headings)},
             .equal_aspect = true,
             .caption = "From the middle, facing right, to goals on a circle of 2 m.",
             .summary = std::string("Paths from the origin to goals on a circle of two metres, driven ") +
                        name + "; each ends at its goal.",
             .origin = kThroughCan});
        if (from.quick) row.back().title = std::string("Ways to a pose, ") + name;
    }
    section.charts(std::move(row));
}

void add_figure_eight(report::Page& page, const Reproduction& from) {
    Section& section = page.section("Figures 20 and 21: the figure-8");
    const PaperLaps& fast = from.paper_laps.front();
    const PaperLaps& slow = from.paper_laps.back();
    section.text("The reference is a figure-8 of " + with_unit(fixed(from.path.length_m, 1), "m") + " × " +
                 with_unit(fixed(from.path.width_m, 1), "m") +
                 " that starts at (0, 0); the robot starts at (0, 1, 0), one "
                 "metre beside it. The paper gives neither its size nor its pace nor γ1, γ2, λ3/λ2 (here 1, "
                 "3, 3). Errors "
                 "are distances of the true robot to the reference point at that time, from 12 s on.");
    Table table{.caption = "Error against the moving reference",
                .columns = {{"controller"},
                            {"pose from"},
                            {"lap", true},
                            {"RMS", true},
                            {"peak", true},
                            {"driven in reverse", true},
                            {"evidence"}},
                .rows = {}};
    const auto lap = [](double period_s) { return with_unit(fixed(period_s, 0), "s"); };
    table.rows.push_back({"ours",
                          "odometry and external pose",
                          lap(from.path.period_s),
                          mm(from.tracking.rms_m, 1),
                          mm(from.tracking.peak_m, 1),
                          percent(0, 0),
                          {kThroughCan, Tone::quiet}});
    table.rows.push_back({"ours",
                          "odometry alone",
                          lap(from.path.period_s),
                          mm(from.tracking_odometry.rms_m, 1),
                          mm(from.tracking_odometry.peak_m, 1),
                          percent(0, 0),
                          {kThroughCan, Tone::quiet}});
    for (const PaperLaps* laps : {&fast, &slow}) {
        table.rows.push_back({"paper’s law, as printed",
                              "odometry alone",
                              lap(laps->period_s),
                              mm(laps->literal.rms_m, 0),
                              mm(laps->literal.peak_m, 0),
                              percent(laps->literal.reverse_share, 0),
                              {kModel, Tone::quiet}});
        table.rows.push_back({"paper’s law, mirrored",
                              "odometry alone",
                              lap(laps->period_s),
                              mm(laps->mirrored.rms_m, 0),
                              mm(laps->mirrored.peak_m, 0),
                              percent(laps->mirrored.reverse_share, 0),
                              {kModel, Tone::quiet}});
    }
    section.table(std::move(table));
    section.chart(
        {.title = "Fig. 20, ours: the path in the plane",
         .x = {"x / m"},
         .y = {"y / m"},
         .series = {path_of("true path", from.tracking.samples, &tools::PathSample::truth),
                    path_of("odometry alone would say", from.tracking.samples,
                            &tools::PathSample::bare_odometry),
                    path_of("reference", one_lap(from.tracking.samples, 0, from.path.period_s),
                            &tools::PathSample::reference, true)},
         .equal_aspect = true,
         .caption = "The paper’s robot joins the path from one metre beside it and follows what its "
                    "odometry says, which drifts away. Ours joins it too, feeds the reference’s velocity "
                    "forward and corrects its odometry by an external pose at 20 Hz: " +
                    mm(from.tracking.rms_m, 1) + " RMS.",
         .summary = "The true path joins the figure-8 from one metre above its middle and then lies on "
                    "it; bare odometry drifts away visibly.",
         .origin = kThroughCan});
    section.chart(
        {.title = "Fig. 20, the paper’s law at a slow " + lap(slow.period_s) + " a lap",
         .x = {"x / m"},
         .y = {"y / m"},
         .series = {path_of("true path, as printed", slow.literal.samples, &DrivenSample::truth),
                    path_of("its odometry, last lap",
                            one_lap(slow.literal.samples, 12 + 2 * slow.period_s, slow.period_s),
                            &DrivenSample::believed),
                    path_of("true path, mirrored law", slow.mirrored.samples, &DrivenSample::truth),
                    path_of("reference", one_lap(slow.literal.samples, 0, slow.period_s),
                            &DrivenSample::reference, true)},
         .equal_aspect = true,
         .caption =
             "A law for a goal at rest must lag to move at all: behind a reference moving straight "
             "on at 0.3 m/s it settles " +
             with_unit(fixed(from.lag_literal.behind_m, 2), "m") + " behind and " +
             with_unit(fixed(from.lag_literal.aside_m, 2), "m") + " aside of it, in reverse; mirrored, " +
             with_unit(fixed(from.lag_mirrored.behind_m, 2), "m") + " behind and " +
             with_unit(fixed(from.lag_mirrored.aside_m, 2), "m") + " aside. Odometry drifts as in the paper.",
         .summary = "The paper's law cuts the curves of the figure-8, as it lags behind the reference.",
         .origin = kModel});
    section.chart(
        {.title = "Fig. 20, the paper’s law at " + lap(fast.period_s) + " a lap",
         .x = {"x / m"},
         .y = {"y / m"},
         .series = {path_of("true path, as printed", fast.literal.samples, &DrivenSample::truth),
                    path_of("true path, mirrored law", fast.mirrored.samples, &DrivenSample::truth),
                    path_of("reference", one_lap(fast.literal.samples, 0, fast.period_s),
                            &DrivenSample::reference, true)},
         .equal_aspect = true,
         .caption = "At the pace ours is asked for, the law no longer draws a figure-8.",
         .summary = "At ten seconds a lap the paper's law is about a metre away from the reference.",
         .origin = kModel});
    const auto time_s = column(from.tracking.samples, [](const tools::PathSample& s) { return s.time_s; });
    const auto heading = [&](Pose<double> tools::PathSample::*pose) {
        return column(from.tracking.samples,
                      [pose](const tools::PathSample& s) { return (s.*pose).heading_rad; });
    };
    const std::vector<double> reference = unwrapped(heading(&tools::PathSample::reference));
    const double begin = reference.empty() ? 0.0 : reference.front();
    const auto slow_time_s = column(slow.literal.samples, [](const DrivenSample& s) { return s.time_s; });
    const std::vector<double> slow_reference = unwrapped(
        column(slow.literal.samples, [](const DrivenSample& s) { return s.reference.heading_rad; }));
    const double slow_begin = slow_reference.empty() ? 0.0 : slow_reference.front();
    section.charts(
        {{.title = "Fig. 21, ours: orientation",
          .x = {"time / s"},
          .y = {"heading / rad"},
          .series = {{"true", time_s, beside(heading(&tools::PathSample::truth), begin)},
                     {"odometry alone", time_s, beside(heading(&tools::PathSample::bare_odometry), begin)},
                     {"reference", time_s, reference, Draw::line, true}},
          .caption = "The orientation follows the reference’s after the first seconds.",
          .summary = "The heading joins the reference's within two seconds and stays with it.",
          .origin = kThroughCan},
         {.title = "Fig. 21, the paper’s law at " + lap(slow.period_s) + " a lap",
          .x = {"time / s"},
          .y = {"heading / rad"},
          .series = {{"true, as printed", slow_time_s,
                      beside(column(slow.literal.samples,
                                    [](const DrivenSample& s) { return s.truth.heading_rad; }),
                             slow_begin)},
                     {"true, mirrored law", slow_time_s,
                      beside(column(slow.mirrored.samples,
                                    [](const DrivenSample& s) { return s.truth.heading_rad; }),
                             slow_begin)},
                     {"reference", slow_time_s, slow_reference, Draw::line, true}},
          .caption = "As printed the robot turns round and follows backwards, half a turn off the reference.",
          .summary =
              "As printed, the heading runs half a turn beside the reference; mirrored, it follows it.",
          .origin = kModel}});
    section.chart(
        {.title = "Distance to the reference point",
         .x = {"time / s"},
         .y = {"error / m", true, 1e-4, 10},
         .series =
             {{"ours, external pose", time_s,
               column(from.tracking.samples, [](const tools::PathSample& s) { return s.error_m; })},
              {"ours, odometry alone",
               column(from.tracking_odometry.samples, [](const tools::PathSample& s) { return s.time_s; }),
               column(from.tracking_odometry.samples, [](const tools::PathSample& s) { return s.error_m; })},
              {"paper’s law, as printed",
               column(fast.literal.samples, [](const DrivenSample& s) { return s.time_s; }),
               column(fast.literal.samples, [](const DrivenSample& s) { return s.error_m; })},
              {"paper’s law, mirrored",
               column(fast.mirrored.samples, [](const DrivenSample& s) { return s.time_s; }),
               column(fast.mirrored.samples, [](const DrivenSample& s) { return s.error_m; })}},
         .marks = {{"judged from here", 12.0}},
         .caption = "All at " + lap(from.path.period_s) +
                    " a lap. Without an external pose the error grows with the drift of the odometry, "
                    "which the paper shows and sets aside.",
         .summary = "Ours stays near two millimetres; with odometry alone the error grows to decimetres; "
                    "the paper's law stays about a metre behind.",
         .origin = "ours through CAN"});
}

void add_adaptation(report::Page& page, const Reproduction& from) {
    const AdaptationRun& run = from.adaptation;
    Section& section = page.section("Figure 22: adaptation");
    section.text(
        "The paper proposes to let the identified parameters tune the controller while driving, gated by the "
        "covariance, and shows the block diagram. Here it drives: during the figure-8, " +
        percent(run.share, 0) + " of mass and inertia drop onto the robot at " +
        with_unit(fixed(run.payload_at_s, 0), "s") +
        ". No pseudo-random torque is added; the driving excites the parameters. Friction is in the "
        "regression. The "
        "controller’s model follows the estimate only as far and as fast as its guards allow.");
    std::vector<Chart> row;
    for (const std::size_t i : {std::size_t{2}, std::size_t{3}}) {
        std::vector<double> low;
        std::vector<double> high;
        for (std::size_t n = 0; n < run.frames.time_s.size(); ++n) {
            low.push_back(run.frames.value[i][n] - 2 * run.frames.standard_error[i][n]);
            high.push_back(run.frames.value[i][n] + 2 * run.frames.standard_error[i][n]);
        }
        const double before = run.truth_before[i];
        const double after = run.truth_after[i];
        const double end_s = run.frames.time_s.empty() ? 42.0 : run.frames.time_s.back();
        row.push_back(
            {.title = std::string(kNames[i]) + " over time",
             .x = {"time / s"},
             .y = {std::string(kNames[i]) + (i == 2 ? " / (kg m)⁻¹" : " / (kg m²)⁻¹"), false, 0.9 * after,
                   1.1 * before},
             .series = {{"estimate", run.frames.time_s, run.frames.value[i]},
                        {"controller’s model", run.model_time_s, i == 2 ? run.model_k7 : run.model_k8},
                        {"truth",
                         {0, run.payload_at_s, run.payload_at_s, end_s},
                         {before, before, after, after},
                         Draw::line,
                         true}},
             .bands = {{"± 2 standard errors", run.frames.time_s, low, high, 0}},
             .marks = {{"payload", run.payload_at_s}},
             .caption = "Three seconds after the payload the estimate is " +
                        with_unit(signed_fixed(100 * (i == 2 ? run.k7_error : run.k8_error), 2), "%") +
                        " off its new value.",
             .summary = std::string(kNames[i]) + " falls from " + significant(before, 4) + " to " +
                        significant(after, 4) +
                        " when the payload drops on; the estimate follows within "
                        "a second or two.",
             .origin = kThroughCan});
    }
    section.charts(std::move(row));
    section.chart(
        {.title = "What the path feels of it",
         .x = {"time / s"},
         .y = {"error / mm", false, 0, 15},
         .series = {{"distance to the reference point",
                     column(run.tracking.samples, [](const tools::PathSample& s) { return s.time_s; }),
                     scaled(
                         column(run.tracking.samples, [](const tools::PathSample& s) { return s.error_m; }),
                         1000)}},
         .marks = {{"payload", run.payload_at_s}},
         .caption = mm(run.rms_before_m, 1) + " RMS before the payload, " + mm(run.rms_after_m, 1) +
                    " from five seconds after it. The first seconds, on the way to the path, lie off the "
                    "scale.",
         .summary = "The tracking error stays at a few millimetres before and after the payload.",
         .origin = kThroughCan});
}

}  // namespace wheelwright::paper
