#include "tools/paper/paper_sections.hpp"

#include <utility>
#include <vector>

#include "tools/report/format.hpp"

namespace wheelwright::paper {
namespace {

using report::Draw;
using report::fixed;
using report::percent;
using report::Section;
using report::Series;
using report::Table;
using report::with_unit;

}  // namespace

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

}  // namespace wheelwright::paper
