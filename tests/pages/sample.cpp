#include "tests/pages/sample.hpp"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "tools/report/format.hpp"

namespace wheelwright::report {
namespace {

std::vector<double> times(std::size_t count, double step_s) {
    std::vector<double> t(count);
    for (std::size_t i = 0; i < count; ++i) t[i] = static_cast<double>(i) * step_s;
    return t;
}

template <typename Function>
std::vector<double> of(const std::vector<double>& t, Function&& function) {
    std::vector<double> y;
    for (const double value : t) y.push_back(function(value));
    return y;
}

}  // namespace

Page sample_page() {
    Page page("A page that uses everything",
              "Headings, text with `code`, tables, charts & their words; <nothing> here is markup.");
    page.figures({{"Error along the way", with_unit(fixed(3.1, 1), "mm"), "aim 5 mm", Tone::good},
                  {"Peak", with_unit(fixed(17.4, 1), "mm"), "aim 15 mm", Tone::bad},
                  {"Laps", "3", "", Tone::plain}});
    page.footer("Made by `sample_page`.");

    Section& text = page.section("Words and numbers");
    text.text(
        "A paragraph that is long enough to be wrapped at every width that people read on, with a number, "
        "−14.3839, and a command, `wheelwright paper --out report`, in the middle of it.");
    text.note(Tone::good, "This went well.");
    text.note(Tone::bad, "This did not.");
    text.list({"first", "second, with `code`", "third"});
    text.table(
        {.caption = "Parameters, ours beside the paper's",
         .columns = {{"parameter"}, {"paper", true}, {"ours", true}, {"difference", true}, {"aim"}},
         .rows = {{"K7", fixed(18.7807, 4), fixed(18.7811, 4), percent(2.1e-5, 3), {"met", Tone::good}},
                  {"K8", fixed(-14.3839, 4), fixed(-14.3, 4), percent(-5.8e-3, 3), {"missed", Tone::bad}},
                  {"P of K5", scientific(7.0428e-12, 4), "", "", {"not asked", Tone::quiet}}}});

    Section& curves = page.section("Curves");
    const std::vector<double> t = times(60001, 1e-3);
    std::vector<double> spike = of(t, [](double s) { return std::sin(s) * std::exp(-s / 40); });
    spike[31415] = 1.8;  // must be seen
    std::vector<double> gap = of(t, [](double s) { return 0.7 * std::cos(s / 2); });
    for (std::size_t i = 20000; i < 25000; ++i) gap[i] = std::numeric_limits<double>::quiet_NaN();
    curves.chart(
        {.title = "Six curves, a band, a level and a mark",
         .x = {"time / s"},
         .y = {"amplitude / Nm"},
         .series = {{"decays, one spike", t, spike},
                    {"with a gap", t, gap},
                    {"third", t, of(t, [](double s) { return -0.5 + 0.01 * s; })},
                    {"fourth", t, of(t, [](double s) { return 0.3 * std::sin(s / 5); })},
                    {"steps", t, of(t, [](double s) { return 0.2 * std::floor(s / 10); }), Draw::steps},
                    {"sixth", t, of(t, [](double s) { return -0.8 - 0.003 * s; })},
                    {"set-point", t, of(t, [](double) { return 0.5; }), Draw::line, true}},
         .bands = {{"two standard errors", t, of(t, [](double s) { return -0.6 + 0.01 * s; }),
                    of(t, [](double s) { return -0.4 + 0.01 * s; }), 2}},
         .levels = {{"limit", 1.5}},
         .marks = {{"payload on", 30.0}},
         .caption = "What to see, in a sentence.",
         .summary = "The sample holds seven curves over a minute; one of them peaks at 1.8 Nm after 31 s.",
         .origin = "through CAN"});
    const std::vector<double> n = of(times(400, 0.01), [](double s) { return std::pow(10.0, s); });
    curves.charts({{.title = "Logarithmic axes",
                    .x = {"samples", true},
                    .y = {"covariance", true},
                    .series = {{"1/n", n, of(n, [](double k) { return 1e-4 / k; })}},
                    .caption = "A straight line falls by ten in ten.",
                    .summary = "The sample falls from 1e-4 to 1e-8 over four decades."},
                   {.title = "Points",
                    .x = {"delay / ms"},
                    .y = {"overshoot / %"},
                    .series = {{"sampled", {0, 1, 2, 3}, {14.9, 17.7, 24.7, 42.9}, Draw::points},
                               {"continuous", {0, 3}, {13.5, 13.5}, Draw::line, true}},
                    .caption = "Four points beside a line.",
                    .summary = "The sample rises from 14.9 to 42.9 percent with delay.",
                    .origin = "model"}});
    curves.chart({.title = "A path, as wide as it is",
                  .x = {"x / m"},
                  .y = {"y / m"},
                  .series = {{"driven", of(t, [](double s) { return 1.52 * std::sin(0.628 * s); }),
                              of(t, [](double s) { return 0.74 * std::sin(1.256 * s); })},
                             {"reference", of(t, [](double s) { return 1.5 * std::sin(0.628 * s); }),
                              of(t, [](double s) { return 0.75 * std::sin(1.256 * s); }), Draw::line, true}},
                  .equal_aspect = true,
                  .caption = "A figure-8 of 3 m by 1.5 m.",
                  .summary = "The sample path is a figure-8, three metres long and one and a half wide."});

    Section& last = page.section("A wide table");
    Table wide{
        .caption = "More columns than a phone is wide", .columns = {{"row"}}, .rows = {{"one"}, {"two"}}};
    for (int i = 1; i <= 12; ++i) {
        wide.columns.push_back({"column " + std::to_string(i), true});
        wide.rows[0].push_back(fixed(1.5 * i, 3));
        wide.rows[1].push_back(fixed(-0.5 * i, 3));
    }
    last.table(std::move(wide));
    return page;
}

}  // namespace wheelwright::report
