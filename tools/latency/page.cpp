#include "tools/latency/page.hpp"

#include "tools/report/format.hpp"
#include "tools/report/page.hpp"

namespace wheelwright::tools {
namespace {

std::string us(std::int64_t ns) { return report::with_unit(report::fixed(1e-3 * double(ns), 0), "us"); }

// How many in each bin, up to the last that has any.
report::Series bins(const char* name, const task::DurationHistogram& h) {
    report::Series series{name, {}, {}, report::Draw::steps};
    std::size_t end = task::DurationHistogram::kBins;
    while (end > 0 && h.count(end - 1) == 0) --end;
    for (std::size_t i = 0; i < end; ++i) {
        series.x.push_back(1e-3 * double(task::DurationHistogram::kBin_ns) * double(i + 1));
        series.y.push_back(h.count(i) > 0 ? double(h.count(i)) : 0.5);  // a logarithmic axis has no 0
    }
    return series;
}

}  // namespace

void write_latency_page(const Latency& latency, const std::string& verdict, const std::vector<Advice>& advice,
                        const std::string& path) {
    report::Page page(
        "Latency of this machine",
        "The firmware's loop at 1 kHz in real time, driving a simulated robot, beside cyclictest.");
    const bool bad = fitness(latency) == Fitness::unfit;
    const auto& wake = latency.wake_up;
    std::vector<report::KeyFigure> key{
        {"verdict",
         bad                                ? "not fit"
         : fitness(latency) == Fitness::fit ? "fit"
                                            : "limited",
         verdict, bad ? report::Tone::bad : report::Tone::good},
        {"missed cycles", std::to_string(latency.missed),
         "of " + std::to_string(latency.cycles + latency.missed)},
        {"wake-up, 99.9 %", us(wake.quantile_ns(0.999)),
         latency.cyclictest ? "cyclictest " + us(latency.cyclictest->quantile_ns(0.999))
                            : latency.no_cyclictest},
        {"one cycle's computing, 99.9 %", us(latency.cycle.quantile_ns(0.999)),
         "longest " + us(latency.cycle.largest_ns())},
    };
    page.figures(std::move(key));
    report::Chart chart;
    chart.title = "How often, by duration";
    chart.x = {"duration / us", true, 1.0};
    chart.y = {"cycles", true, 0.5};
    chart.series = {bins("wake-up", wake)};
    if (latency.cyclictest) chart.series.push_back(bins("cyclictest", *latency.cyclictest));
    chart.series.push_back(bins("computing", latency.cycle));
    chart.series.push_back(bins("torques after their time", latency.sending));
    chart.caption =
        "In bins of 1 us; the last bin holds all that took longer. What lies far to the right is what a "
        "controller feels.";
    chart.summary = "Histogram of wake-up, computing and sending; the longest wake-up took " +
                    us(wake.largest_ns()) + ".";
    page.section("Histogram").chart(std::move(chart));
    if (!advice.empty() || !latency.refused.empty()) {
        report::Table table{"", {{"found"}, {"change"}}, {}, true};
        for (const hal::Refusal& one : latency.refused) table.rows.push_back({"no " + one.what, one.remedy});
        for (const Advice& one : advice) table.rows.push_back({one.what, one.change});
        page.section("What could be changed").table(std::move(table));
    }
    page.footer("wheelwright latency");
    page.write(path);
}

}  // namespace wheelwright::tools
