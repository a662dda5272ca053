#include "tools/paper/paper_page.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "tools/paper/paper_sections.hpp"
#include "tools/report/format.hpp"

namespace wheelwright::paper {
namespace {

using report::fixed;
using report::percent;
using report::Section;
using report::significant;
using report::Table;
using report::Tone;
using report::with_unit;

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
