// `wheelwright latency`: is this machine fit for 1 kHz, and what would make it so?
#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>

#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/report.hpp"
#include "tools/cli/robots.hpp"
#include "tools/cli/run_program.hpp"
#include "tools/cli/scratch_folder.hpp"
#include "tools/latency/machine.hpp"
#include "tools/latency/measure.hpp"
#include "tools/latency/page.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    double duration_s = 10;
    std::string config;
    std::string json;
    std::string out;
};

double us(std::int64_t ns) { return 1e-3 * static_cast<double>(ns); }

// The first that exists: a service's path has no sbin.
std::string program(const std::string& name) {
    for (const char* folder : {"/usr/bin/", "/usr/sbin/", "/bin/", "/sbin/"}) {
        if (std::filesystem::exists(folder + name)) return folder + name;
    }
    return "";
}

std::string links_as_json() {
    const std::string ip = program("ip");
    if (ip.empty()) return "";
    const ScratchFolder folder;
    const std::string path = folder.path() + "/links";
    run_program({ip, "-json", "link"}, path, 5);
    std::ifstream file(path);
    return {std::istreambuf_iterator<char>(file), {}};
}

std::string verdict(const Latency& latency) {
    switch (fitness(latency)) {
        case Fitness::fit:
            return "fit for 1 kHz";
        case Fitness::limited:
            return "no cycle was missed, but torques leave late: the controller is less exact than designed";
        case Fitness::unfit:
            break;
    }
    return "not fit for 1 kHz: cycles were missed";
}

void report_durations(const Latency& latency, Report& report) {
    report.section("durations", "Durations, us");
    report.table("durations", {{"what", "what"},
                               {"median_us", "median"},
                               {"p99_us", "99 %"},
                               {"p999_us", "99.9 %"},
                               {"longest_us", "longest"}});
    const auto row = [&](const char* what, const task::DurationHistogram& h) {
        report.row({std::string(what), us(h.quantile_ns(0.5)), us(h.quantile_ns(0.99)),
                    us(h.quantile_ns(0.999)), us(h.largest_ns())});
    };
    row("wake-up of the firmware's loop", latency.wake_up);
    if (latency.cyclictest) row("wake-up of cyclictest, in the same time", *latency.cyclictest);
    row("one cycle's computing", latency.cycle);
    row("torques sent, after their time", latency.sending);
    if (latency.cyclictest) {
        report.add("added_p999_us", "added over cyclictest, 99.9 %",
                   us(latency.wake_up.quantile_ns(0.999) - latency.cyclictest->quantile_ns(0.999)), "us");
    }
}

void report_histogram(const Latency& latency, Report& report) {
    report.section("histogram",
                   "Histogram: cycles that took longer than the row before, and up to so many us");
    std::vector<Report::Column> columns{{"up_to_us", "up to"}, {"wake_up", "wake-up"}};
    if (latency.cyclictest) columns.push_back({"cyclictest", "cyclictest"});
    columns.push_back({"cycle", "computing"});
    columns.push_back({"sending", "torques"});
    report.table("histogram", std::move(columns));
    std::size_t from = 0;
    constexpr std::array<std::size_t, 10> kEdges{2,   5,   10,  20,   50,
                                                 100, 200, 500, 1000, task::DurationHistogram::kBins};
    for (const std::size_t edge : kEdges) {
        const auto count = [&](const task::DurationHistogram& h) {
            std::int64_t sum = 0;
            for (std::size_t bin = from; bin < edge; ++bin) sum += static_cast<std::int64_t>(h.count(bin));
            return sum;
        };
        const bool last = edge == task::DurationHistogram::kBins;
        std::vector<Cell> row{last ? Cell(std::string("more")) : Cell(static_cast<std::int64_t>(edge)),
                              count(latency.wake_up)};
        if (latency.cyclictest) row.emplace_back(count(*latency.cyclictest));
        row.emplace_back(count(latency.cycle));
        row.emplace_back(count(latency.sending));
        report.row(std::move(row));
        from = edge;
    }
}

int latency(const Options& options) {
    LatencyOptions measure;
    measure.duration_s = options.duration_s;
    measure.cyclictest = program("cyclictest");
    if (!options.config.empty()) {
        const auto robot = read_robot(options.config);
        if (!robot) return kUsage;
        const auto& realtime = robot->parameters.realtime;
        measure.realtime.priority = realtime.priority;
        if (realtime.cpu >= 0) measure.realtime.cpu = realtime.cpu;
        measure.send_phase_s = realtime.send_phase_s;
    }
    const Machine machine = look_at_machine("", links_as_json());
    const Latency found = measure_latency(measure);

    Report report("latency");
    report.section("machine", "");
    report.add("verdict", "verdict", verdict(found));
    report.add("cycles", "cycles", static_cast<std::int64_t>(found.cycles));
    report.add("missed", "missed", static_cast<std::int64_t>(found.missed));
    report.add("late", "torques not yet known when due", static_cast<std::int64_t>(found.late), "",
               "due " + number_text(1e6 * measure.send_phase_s) + " us after the cycle's begin");
    report.add("kernel", "kernel", machine.kernel, "",
               machine.realtime_kernel ? "PREEMPT_RT" : "not PREEMPT_RT");
    report_durations(found, report);
    if (!found.no_cyclictest.empty()) report.add("no_cyclictest", "without cyclictest", found.no_cyclictest);
    report_histogram(found, report);

    const std::vector<Advice> list = advice(machine, measure.realtime.priority, measure.realtime.cpu);
    report.section("change", list.empty() && found.refused.empty() ? "" : "What could be changed");
    report.table("change", {{"found", "found"}, {"change", "change"}});
    for (const hal::Refusal& one : found.refused) {
        report.row({"no " + one.what + (one.privilege.empty() ? "" : ": " + one.privilege + " is missing"),
                    one.remedy});
    }
    for (const Advice& one : list) report.row({one.what, one.change});
    if (!report.publish(options.json)) return kUsage;
    if constexpr (WHEELWRIGHT_PAGES) {
        if (!options.out.empty()) {
            const std::string path = options.out + "/latency.html";
            write_latency_page(found, verdict(found), list, path);
            std::printf("\n%s is written.\n", path.c_str());
        }
    }
    return fitness(found) == Fitness::unfit ? kAimMissed : kDone;
}

}  // namespace

void add_latency(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command = program.add_subcommand(
        "latency", "Measure how punctually this machine runs the firmware, and say what would help");
    command.footer(
        "The whole firmware drives a simulated robot in real time, in this process; nothing goes to a bus, "
        "so that a "
        "robot\nbeside it stands still. Not while wheelwrightd drives: both would have the same priority.\n"
        "Exit status 3: cycles were missed.");
    command.add_option("--duration", options->duration_s, "Seconds to measure")
        .show_default()
        .check(from_to("1", "86400"));
    command.add_option("--config", options->config,
                       "Robot file: priority, processor and sending phase; else 80, any, 300 us");
    command.add_option("--json", options->json, "Write the figures to this file too");
    if constexpr (WHEELWRIGHT_PAGES) {
        command.add_option("--out", options->out, "Write a page, latency.html, into this folder");
    }
    command.callback([options, &run] { run = [options] { return latency(*options); }; });
}

}  // namespace wheelwright::tools
