#include "tools/paper/paper_page.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "tools/report/format.hpp"

namespace wheelwright::paper {
namespace {

using report::Chart;
using report::Draw;
using report::fixed;
using report::percent;
using report::scientific;
using report::Section;
using report::Series;
using report::signed_fixed;
using report::signed_significant;
using report::significant;
using report::Table;
using report::Tone;
using report::with_unit;

constexpr std::array<const char*, 4> kNames{"K5", "K6", "K7", "K8"};
constexpr const char* kThroughCan = "through CAN";
constexpr const char* kModel = "model";

std::string ms(double seconds, int decimals) { return with_unit(fixed(1000 * seconds, decimals), "ms"); }
std::string mm(double metres, int decimals) { return with_unit(fixed(1000 * metres, decimals), "mm"); }

std::vector<double> scaled(std::vector<double> values, double factor) {
    for (double& value : values) value *= factor;
    return values;
}

template <typename Samples, typename Get>
std::vector<double> column(const Samples& samples, Get&& get) {
    std::vector<double> out;
    out.reserve(samples.size());
    for (const auto& sample : samples) out.push_back(get(sample));
    return out;
}

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

// ---- the table of rows ----------------------------------------------------------------------------------

void add_rows(report::Page& page, const Reproduction& from) {
    Section& section = page.section("Row by row");
    section.text(
        "Every result of the paper and its counterpart here. “Through CAN” means: the firmware under its 1 "
        "kHz "
        "cycle, talking CAN frames to simulated drives on a robot whose numbers it has not been told; the "
        "truth "
        "is seen by the judge alone. “Model” means: this project’s code on the paper’s equations, without a "
        "bus. Each row is "
        "one run with one seed unless it says otherwise, and aims that the paper does not set are this "
        "project’s own.");
    Table table{.caption = "The paper, reproduced",
                .columns = {{"in the paper"}, {"here"}, {"evidence"}, {"aim"}, {"measured"}, {"result"}},
                .rows = {},
                .stack_when_narrow = true};
    for (const Row& row : from.rows) {
        table.rows.push_back({row.paper,
                              row.what,
                              {row.through == Through::can ? kThroughCan : kModel, Tone::quiet},
                              {row.aim, Tone::quiet},
                              row.measured,
                              row.met ? report::Cell{"met", Tone::good} : report::Cell{"missed", Tone::bad}});
    }
    section.table(std::move(table));
}

// ---- Figs 10-17, Table 1 --------------------------------------------------------------------------------

// The range that holds the values after `from_s`, the truth in it.
std::pair<double, double> range_after(const std::vector<double>& time_s, const std::vector<double>& values,
                                      double from_s, double truth) {
    double low = truth;
    double high = truth;
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (time_s[i] < from_s || !std::isfinite(values[i])) continue;
        low = std::min(low, values[i]);
        high = std::max(high, values[i]);
    }
    const double margin = 0.15 * (high - low);
    return {low - margin, high + margin};
}

void add_table1(report::Page& page, const Reproduction& from) {
    Section& section = page.section("Figures 10–17 and Table 1: identification");
    section.text(
        "The paper excites a simulated robot with ±5 Nm of pseudo-random torque at 100 Hz and identifies "
        "K5…K8 by "
        "two recursive regressions. Its listing works in wheel rates, so Table 1’s numbers are those of "
        "wheel "
        "coordinates (hence K8 < 0, and K5, K6 without physical meaning). They are reproduced here in their "
        "own "
        "coordinates: the paper’s regression on a plant with the paper’s numbers, eq (60), 10 200 samples, "
        "P(−1) "
        "= 10⁶ I, no forgetting. That plant is unstable at every u₁ > 0, so its speed is bounded by "
        "overriding the "
        "torque (|u₁| < 3, |u₂| < 20).");
    Table table{.caption = "Table 1: the paper’s values are the plant’s truth here; ours without noise",
                .columns = {{"parameter"},
                            {"paper", true},
                            {"ours", true},
                            {"difference", true},
                            {"by the print’s (44), (47)", true},
                            {"paper’s P diagonal", true},
                            {"our P diagonal", true},
                            {"difference", true}},
                .rows = {}};
    for (std::size_t i = 0; i < 4; ++i) {
        const double truth = kTable1Truth[i];
        const auto off = [truth](double value) {
            const double share = value / truth - 1;
            return with_unit(signed_significant(100 * share, 2), "%");
        };
        const double diagonal = from.table1.covariance_diagonal[i];
        table.rows.push_back(
            {kNames[i], fixed(truth, i < 2 ? 5 : 4), fixed(from.table1.estimate[i], i < 2 ? 5 : 4),
             off(from.table1.estimate[i]), off(from.table1_plain.estimate[i]),
             scientific(kTable1PaperCovariance[i], 4), scientific(diagonal, 4),
             i < 2 ? report::Cell{"not comparable", Tone::quiet}
                   : report::Cell{
                         with_unit(signed_fixed(100 * (diagonal / kTable1PaperCovariance[i] - 1), 1), "%")}});
    }
    section.table(std::move(table));
    section.text(
        "“Ours” averages the regressors over each step; the print’s plain difference takes them at the "
        "step’s "
        "start, which leaves K6 and K5 wrong even without noise. P of K7 and K8 is 1/Σφ² of the torques, so "
        "it "
        "says how long the experiment was: 10 227 samples. P of K5 and K6 in wheel coordinates belongs to "
        "regressors (u₂², u₁u₂) that do not describe the robot; it cannot be reproduced.");
    const std::vector<double> time_s =
        column(from.table1_noisy.series, [](const Table1Point& p) { return p.time_s; });
    for (std::size_t pair = 0; pair < 4; pair += 2) {
        std::vector<Chart> row;
        for (std::size_t i = pair; i < pair + 2; ++i) {
            const std::vector<double> values =
                column(from.table1_noisy.series, [i](const Table1Point& p) { return p.estimate[i]; });
            const auto [low, high] = range_after(time_s, values, i < 2 ? 5.0 : 0.15, kTable1Truth[i]);
            row.push_back(
                {.title = "Fig. " + std::to_string(10 + i) + ": estimate of " + kNames[i],
                 .x = {"time / s"},
                 .y = {kNames[i], false, low, high},
                 .series = {{"ours, with noise", time_s, values}},
                 .levels = {{"paper, Table 1", kTable1Truth[i]}},
                 .caption = i < 2
                                ? "The paper says that its values keep changing with the noise and are taken "
                                  "to converge "
                                  "to an average. So do ours; the first moments lie off the scale."
                                : "The paper takes its values to converge to an average. Ours settle within "
                                  "seconds, for the torque is a strong regressor from the first sample on.",
                 .summary = std::string("The estimate of ") + kNames[i] + " converges to " +
                            significant(from.table1_noisy.estimate[i], 5) + "; the paper's value is " +
                            significant(kTable1Truth[i], 5) + ".",
                 .origin = kModel});
        }
        section.charts(std::move(row));
    }
    for (std::size_t pair = 0; pair < 4; pair += 2) {
        std::vector<Chart> row;
        for (std::size_t i = pair; i < pair + 2; ++i) {
            row.push_back(
                {.title = "Fig. " + std::to_string(14 + i) + ": covariance diagonal of " + kNames[i],
                 .x = {"time / s", true},
                 .y = {std::string("P of ") + kNames[i], true},
                 .series = {{"ours", time_s,
                             column(from.table1_noisy.series,
                                    [i](const Table1Point& p) { return p.covariance_diagonal[i]; })}},
                 .levels = {{i < 2 ? "paper’s final value (other regressors)" : "paper’s final value",
                             kTable1PaperCovariance[i]}},
                 .caption =
                     i < 2 ? "Of the paper, only the final value is compared; it belongs to other regressors."
                           : "Ours falls as 1/t and ends at the paper’s final value, the only one compared.",
                 .summary = std::string("P of ") + kNames[i] + " falls to " +
                            significant(from.table1_noisy.covariance_diagonal[i], 3) +
                            " in 102 seconds; the paper ends at " +
                            significant(kTable1PaperCovariance[i], 3) + ".",
                 .origin = kModel});
        }
        section.charts(std::move(row));
    }
    Table honesty{.caption = "Are the standard errors honest? Noise on speed and torque, " +
                             std::to_string(from.intervals.seeds) + " seeds; z = error / standard error",
                  .columns = {{"parameter"},
                              {"mean z", true},
                              {"rms z", true},
                              {"95 % interval covers", true},
                              {"rms z of the naive √(σ²P)", true}},
                  .rows = {}};
    for (std::size_t i = 0; i < 4; ++i) {
        honesty.rows.push_back({kNames[i], signed_fixed(from.intervals.mean_z[i], 2),
                                fixed(from.intervals.rms_z[i], 2), percent(from.intervals.coverage[i], 0),
                                fixed(from.intervals.naive_rms_z[i], 2)});
    }
    section.table(std::move(honesty));
    section.text(
        "The paper takes the covariance diagonal as “a measure of the confidence”. It is one only times the "
        "noise "
        "variance, and only for white residuals; differenced measurement noise is not white. Ours takes the "
        "residuals’ colour into account: an honest rms z is 1.");
}

// ---- identification over CAN ----------------------------------------------------------------------------

void add_identification(report::Page& page, const Reproduction& from) {
    const CanIdentification& id = from.identification;
    Section& section = page.section("Identification over CAN");
    section.text(
        "The same regressions in physical coordinates, run by the firmware at 1 kHz: ±5 Nm PRBS with a bit "
        "every "
        "10 ms, encoder quantisation, torque lag and noise, bus latency, Coulomb and viscous friction. The "
        "delay "
        "is measured first; speed, yaw rate and distance from the start stay bounded. The figures hold what "
        "the "
        "firmware publishes on the bus ten times a second.");
    Table table{.caption = "K5…K8 by the firmware after " + with_unit(fixed(id.duration_s, 0), "s") +
                           ", and the simulated robot’s truth",
                .columns = {{"parameter"},
                            {"truth", true},
                            {"identified", true},
                            {"standard error", true},
                            {"difference", true},
                            {"difference at the default stop", true}},
                .rows = {}};
    const CanIdentification& early = from.default_identification;
    for (std::size_t i = 0; i < 4; ++i) {
        table.rows.push_back(
            {kNames[i], significant(id.truth[i], 5), significant(id.estimate[i], 5),
             significant(id.standard_error[i], 2),
             with_unit(signed_fixed(100 * (id.estimate[i] / id.truth[i] - 1), 2), "%"),
             with_unit(signed_fixed(100 * (early.estimate[i] / early.truth[i] - 1), 2), "%")});
    }
    section.table(std::move(table));
    section.text(
        "With the robot file’s own settings the ident mode stops after " +
        with_unit(fixed(early.duration_s, 0), "s") + ", with the worst of the four " +
        percent(early.largest_relative_error, 1) +
        " off. For this page it is asked for much smaller standard errors and runs about as long as the "
        "paper’s experiment; the controllers below use this longer run.");
    section.text(
        "Measured delay from command to torque: " + ms(id.delay_s, 2) +
        ". Farthest from the start: " + with_unit(fixed(id.farthest_m, 2), "m") +
        ". Truth is given as a controller must see it that believes wheels and track of the robot file, "
        "which differ a little from the robot’s, as every number does.");
    std::vector<Series> deviation;
    std::vector<Series> error;
    for (const std::size_t i : {std::size_t{2}, std::size_t{3}, std::size_t{0}, std::size_t{1}}) {
        std::vector<double> share = id.frames.value[i];
        std::vector<double> relative_error = id.frames.standard_error[i];
        for (double& value : share) value = 100 * (value / id.truth[i] - 1);
        for (double& value : relative_error) {
            value = 100 * std::abs(value / id.truth[i]);
            if (value > 1e6) value = std::numeric_limits<double>::quiet_NaN();  // not known yet
        }
        deviation.push_back({kNames[i], id.frames.time_s, std::move(share)});
        error.push_back({kNames[i], id.frames.time_s, std::move(relative_error)});
    }
    section.charts(
        {{.title = "Estimates over time",
          .x = {"time / s"},
          .y = {"estimate − truth / %", false, -20, 20},
          .series = std::move(deviation),
          .caption =
              "As Figs 10–13, for the robot’s own K5…K8: K7 and K8 first, the products of speeds later.",
          .summary = "All four estimates converge to within " + percent(id.largest_relative_error, 1) +
                     " of the truth in " + fixed(id.duration_s, 0) + " seconds.",
          .origin = kThroughCan},
         {.title = "Standard errors over time",
          .x = {"time / s"},
          .y = {"standard error / %", true},
          .series = std::move(error),
          .caption = "What the firmware itself says about its confidence.",
          .summary =
              "The relative standard errors fall throughout; those of K7 and K8 end below 0.1 percent.",
          .origin = kThroughCan}});
    std::vector<Series> diagonal;
    for (const std::size_t i : {std::size_t{2}, std::size_t{3}, std::size_t{0}, std::size_t{1}}) {
        std::vector<double> values = id.frames.covariance_diagonal[i];
        for (double& value : values)
            if (!(value > 0) || value >= 1e5) value = std::numeric_limits<double>::quiet_NaN();
        diagonal.push_back({kNames[i], id.frames.time_s, std::move(values)});
    }
    section.chart({.title = "Covariance diagonal over time",
                   .x = {"time / s"},
                   .y = {"P, per unit of noise variance", true},
                   .series = std::move(diagonal),
                   .caption = "As Figs 14–17: the bare diagonal, published beside the standard errors.",
                   .summary = "The diagonal of P falls for all four parameters.",
                   .origin = kThroughCan});
}

// ---- velocity loops -------------------------------------------------------------------------------------

void add_velocity(report::Page& page, const Reproduction& from) {
    Section& section = page.section("Velocity loops: eq (61)–(72)");
    section.text(
        "The paper places both poles at ξ = 1 “to avoid overshoot” and takes ωₙ = 92 rad/s for 1 % settling "
        "in "
        "50 ms. The zero of (67) at −Ki/Kp overshoots all the same by e⁻² = 13.5 %, and the bound (69) holds "
        "for "
        "the envelope only: 68 ms with the zero, 72 ms without. Sampled at 1 kHz, every millisecond of delay "
        "makes "
        "it worse.");
    Table table{.caption = "A step of the set-point at 1 kHz, zero-order hold: the paper’s gains and ours",
                .columns = {{"delay"},
                            {"paper: overshoot", true},
                            {"paper: 1 % settling", true},
                            {"ours: overshoot", true},
                            {"ours: 1 % settling", true},
                            {"ours: Kp", true},
                            {"ours: phase margin", true},
                            {"ours: Ms", true}},
                .rows = {}};
    table.rows.push_back({"continuous, no delay", percent(from.continuous.overshoot, 1),
                          ms(from.continuous.settling_s, 1), "", "", "", "", ""});
    for (const auto& delayed : from.delayed) {
        table.rows.push_back(
            {ms(delayed.delay_s, 0), percent(delayed.paper.overshoot, 1), ms(delayed.paper.settling_s, 0),
             percent(delayed.ours.overshoot, 1), ms(delayed.ours.settling_s, 0),
             with_unit(fixed(delayed.design.kp_per_s, 0), "s⁻¹"),
             fixed(delayed.design.phase_margin_deg, 0) + "°", fixed(delayed.design.sensitivity_peak, 2)});
    }
    section.table(std::move(table));
    std::vector<Series> paper;
    std::vector<Series> ours;
    paper.push_back(
        {"continuous", scaled(from.continuous.time_s, 1000), from.continuous.speed, Draw::line, true});
    for (const auto& delayed : from.delayed) {
        paper.push_back({ms(delayed.delay_s, 0), scaled(delayed.paper.time_s, 1000), delayed.paper.speed});
        ours.push_back({ms(delayed.delay_s, 0), scaled(delayed.ours.time_s, 1000), delayed.ours.speed});
    }
    section.charts(
        {{.title = "Eq (67) with the paper’s gains",
          .x = {"time / ms"},
          .y = {"speed / step", false, 0, 1.5},
          .series = std::move(paper),
          .levels = {{"set-point", 1}},
          .caption =
              "The print expects no overshoot. In continuous time it is 13.5 %; with 3 ms of delay, 43 %.",
          .summary =
              "Overshoot 13.5 percent in continuous time; 14.9, 17.7, 24.7 and 42.9 percent sampled with a "
              "delay of 0 to 3 milliseconds.",
          .origin = kModel},
         {.title = "Ours, designed for each delay",
          .x = {"time / ms"},
          .y = {"speed / step", false, 0, 1.5},
          .series = std::move(ours),
          .levels = {{"set-point", 1}},
          .caption = "Two degrees of freedom: a set-point weight below one takes the zero’s overshoot away.",
          .summary = "No overshoot at any delay from 0 to 3 milliseconds; settles in about 32 milliseconds.",
          .origin = kModel}});
    section.chart(
        {.title = "The same through the whole chain",
         .x = {"time / ms", false, 0, 200},
         .y = {"true speed / step"},
         .series = {{"ours, step of 0.15 m/s", scaled(from.step_ours.response.time_s, 1000),
                     scaled(from.step_ours.response.v_m_per_s, 1 / from.step_ours.step_m_per_s)},
                    {"paper’s gains, step of 0.055 m/s, mean of eight runs",
                     scaled(from.step_paper.response.time_s, 1000),
                     scaled(from.step_paper.response.v_m_per_s, 1 / from.step_paper.step_m_per_s)}},
         .levels = {{"set-point", 1}},
         .caption = "Ours settles in " + ms(from.step_ours.response.settling_s, 0) +
                    ". The paper’s gains overshoot by " + percent(from.step_paper.response.overshoot, 1) +
                    "; their model with the identified delay of " + ms(from.identification.delay_s, 2) +
                    " predicts " + percent(from.step_paper.predicted_overshoot, 1) +
                    ". Their step is smaller because at 0.15 m/s they ask for more torque than there is; its "
                    "ripple is encoder noise, less in the mean of eight runs, which is shown and judged. "
                    "Single runs "
                    "overshoot by " +
                    percent(from.step_paper.lowest_overshoot, 1) + " to " +
                    percent(from.step_paper.highest_overshoot, 1) + ".",
         .summary = "Our loop reaches the set-point without overshoot in about 40 milliseconds; the paper's "
                    "gains overshoot by a fifth.",
         .origin = kThroughCan});
}

// ---- pose -----------------------------------------------------------------------------------------------

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

// ---- Figs 20, 21 ----------------------------------------------------------------------------------------

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

// ---- Fig 22 ---------------------------------------------------------------------------------------------

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

// ---- the rest -------------------------------------------------------------------------------------------

void add_rest(report::Page& page, const Reproduction& from) {
    Section& section = page.section("The estimator by itself, and the plant");
    Table arx{.caption = "ARX models, eq (1)–(35): coefficients recovered from 4000 noisy samples",
              .columns = {{"model"},
                          {"coefficient"},
                          {"truth", true},
                          {"recursive", true},
                          {"standard error", true}},
              .rows = {}};
    for (const auto& [name, outputs, result] :
         {std::tuple{"ARX(2,2)", 2, &from.arx_2_2}, {"ARX(4,3)", 4, &from.arx_4_3}}) {
        for (std::size_t i = 0; i < result->truth.size(); ++i) {
            const auto number = static_cast<int>(i);
            const std::string coefficient =
                number < outputs ? std::string("a").append(std::to_string(number + 1))
                                 : std::string("b").append(std::to_string(number - outputs + 1));
            arx.rows.push_back({name, coefficient, fixed(result->truth[i], 4), fixed(result->recursive[i], 4),
                                fixed(result->standard_error[i], 4)});
        }
    }
    section.table(std::move(arx));
    section.table(
        {.caption = "Checks",
         .columns = {{"check"}, {"result", true}},
         .rows = {
             {"recursive against batch least squares, in double, relative",
              significant(std::max(from.arx_2_2.batch_difference, from.arx_4_3.batch_difference), 2)},
             {"single precision against batch: U-D factorised", significant(from.precision.factorised, 2)},
             {"single precision against batch: textbook update (31)",
              significant(from.precision.textbook, 2)},
             {"samples until the textbook’s P is no longer positive",
              std::to_string(from.precision.textbook_negative_after)},
             {"plant against eq (36)–(43) by Runge-Kutta, position",
              with_unit(significant(1000 * from.cascade.position_m, 2), "mm")},
             {"acceleration after linearisation against the one asked for, relative",
              significant(from.linearisation_error, 2)},
             {"pendulum arm J q̈ = τ − m g l sin q − d q̇: three parameters, relative",
              significant(from.arm.largest_relative_error, 2)}}});
}

void add_differences(report::Page& page) {
    Section& section = page.section("Where the print is different, and why");
    section.list({
        "Listing 4 uses wheel rates where (42)–(49) speak of v and ω. Hence Table 1’s K8 < 0 and the size of "
        "its "
        "numbers; K7 and K8 convert to physical coordinates, K5 and K6 do not.",
        "(60) is unstable at every u₁ > 0: raw PRBS makes it diverge, so the torque is overridden at a speed "
        "bound.",
        "(44) and (47) difference the speeds and take the regressors at the step’s start. Averaging them "
        "over the "
        "step removes the error.",
        "P is a covariance only times the noise variance, and √(σ²P) an honest standard error only for white "
        "residuals.",
        "ξ = 1 does not remove the overshoot of (67), and (69) bounds the envelope only. The loops here are "
        "designed "
        "on the delayed, sampled plant, with a set-point weight; (69)–(72) stay as the option `paper`.",
        "(77) must be wrapped. The printed pose law ends in reverse; forward, reverse and automatic are "
        "offered.",
        "A law for a goal at rest has no feed-forward. The trajectory mode gives the reference its own "
        "velocities.",
        "Nothing in the print limits torque. Here speed and yaw rate are scaled jointly and torques "
        "saturated with "
        "anti-windup on what was applied.",
        "K5…K8 know no friction: the estimator carries friction columns, the controller compensates them.",
    });
}

}  // namespace

report::Page page_of(const Reproduction& from) {
    report::Page page(
        "The paper, reproduced",
        "W. F. Lages, “Parametric Identification of the Dynamics of Mobile Robots and Its Application to the "
        "Tuning "
        "of Controllers in ROS”: every result run again with Wheelwright, ours beside the paper’s.");
    const auto met = static_cast<std::size_t>(
        std::count_if(from.rows.begin(), from.rows.end(), [](const Row& row) { return row.met; }));
    const bool all = met == from.rows.size();
    double k78 = 0;
    for (const std::size_t i : {std::size_t{2}, std::size_t{3}})
        k78 = std::max(k78, std::abs(from.table1.estimate[i] / kTable1Truth[i] - 1));
    const auto tone = [&from](const char* id) {
        for (const Row& row : from.rows)
            if (row.id == id) return row.met ? Tone::good : Tone::bad;
        return Tone::plain;
    };
    page.figures(
        {{"Rows of the paper that reach their aim",
          std::to_string(met) + " of " + std::to_string(from.rows.size()),
          all ? "all" : "see the table for those that miss", all ? Tone::good : Tone::bad},
         {"Table 1: K7, K8 off by", with_unit(significant(100 * k78, 1), "%"), "aim 0.1 %", tone("table1")},
         {"K5…K8 over CAN off by", percent(from.identification.largest_relative_error, 1),
          "the worst of them, aim 2 %", tone("regressions")},
         {"Figure-8 over CAN, RMS error", mm(from.tracking.rms_m, 1),
          "peak " + mm(from.tracking.peak_m, 1) + ", aim 5 and 15 mm", tone("figure_eight")},
         {"K7, K8 after +30 % mass off by",
          percent(std::max(std::abs(from.adaptation.k7_error), std::abs(from.adaptation.k8_error)), 1),
          "three seconds later, aim 5 %", tone("adaptation")}});
    add_rows(page, from);
    if (!all) {
        Section& missed = page.section("What is missed");
        for (const Row& row : from.rows) {
            if (!row.met)
                missed.note(Tone::bad, row.paper + ": " + row.what + ". Aim: " + row.aim +
                                           ". Measured: " + row.measured + ".");
        }
    }
    add_table1(page, from);
    add_identification(page, from);
    add_velocity(page, from);
    add_pose(page, from);
    add_figure_eight(page, from);
    add_adaptation(page, from);
    add_rest(page, from);
    add_differences(page);
    page.footer("Made by `wheelwright paper" + std::string(from.quick ? " --quick" : "") + "`, seed " +
                std::to_string(from.seed) + ". The same seed gives the same page.");
    return page;
}

}  // namespace wheelwright::paper
