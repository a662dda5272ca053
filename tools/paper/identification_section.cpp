#include "tools/paper/paper_sections.hpp"

#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "tools/report/format.hpp"

namespace wheelwright::paper {
namespace {

using report::fixed;
using report::percent;
using report::Section;
using report::Series;
using report::signed_fixed;
using report::significant;
using report::Table;
using report::with_unit;

}  // namespace

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

}  // namespace wheelwright::paper
