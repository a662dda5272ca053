#include "tools/paper/paper_sections.hpp"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "tools/report/column.hpp"
#include "tools/report/format.hpp"

namespace wheelwright::paper {
namespace {

using report::Chart;
using report::column;
using report::fixed;
using report::percent;
using report::scientific;
using report::Section;
using report::signed_fixed;
using report::signed_significant;
using report::significant;
using report::Table;
using report::Tone;
using report::with_unit;

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

}  // namespace

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

}  // namespace wheelwright::paper
