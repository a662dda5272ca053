// `wheelwright torture`: the firmware as it is, with everything against it.
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>

#include "tools/cli/can_port.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/report.hpp"
#include "tools/cli/robots.hpp"
#include "tools/report/page.hpp"
#include "tools/torture/campaign.hpp"
#include "tools/torture/healthy.hpp"
#include "tools/torture/hostile.hpp"
#include "tools/torture/kill_saves.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    std::uint64_t seeds = 20;
    std::uint64_t first_seed = 1;
    std::uint64_t seed = 0;
    std::uint64_t hostile = 0;
    std::uint64_t kill_saves = 0;
    double healthy_hours = 0;
    std::size_t jobs = 0;
    std::vector<std::string> kinds;
    std::string robots = "both";
    int report_ms = 1;
    std::string log;
    std::string black_box;
    std::string page;
    std::string json;
    bool list = false;
    bool rough = false;
};

TorturedRobots robots_of(const Options& options) {
    if (options.robots == "default") return TorturedRobots::standard;
    return options.robots == "drawn" ? TorturedRobots::drawn : TorturedRobots::both;
}

std::string expectation(const TortureKind& kind) {
    switch (kind.expect) {
        case Expect::stops:
            return std::string(kind.bound);
        case Expect::rests:
            return "rests within " + std::string(kind.bound);
        case Expect::serves:
            return "goes on";
        case Expect::either:
            return "goes on or stops";
        case Expect::obeys:
            return "no rule broken";
    }
    return "";
}

// Where none is stated, a stop may come at any time.
bool has_bound(const KindSummary& sum) {
    return (sum.stopped > 0 || sum.kind->expect == Expect::rests) && sum.kind->bound_s != nullptr;
}

void write_page(const std::string& path, const std::vector<KindSummary>& sums, const Options& options) {
    report::Page page("Torture",
                      "Faults at random moments of a drive, judged by the simulated robots' truth.");
    std::size_t runs = 0;
    std::size_t violated = 0;
    std::size_t false_trips = 0;
    report::Table table;
    table.columns = {{"fault"},         {"what happens"},       {"what must follow"}, {"runs", true},
                     {"stopped", true}, {"longest / ms", true}, {"violations", true}};
    report::Table broken;
    broken.columns = {{"fault"}, {"first run that breaks a rule"}};
    broken.stack_when_narrow = true;
    for (const KindSummary& sum : sums) {
        runs += sum.runs;
        violated += sum.violated;
        false_trips += sum.false_trips;
        table.rows.push_back(
            {std::string(sum.kind->name),
             std::string(sum.kind->what),
             expectation(*sum.kind),
             std::to_string(sum.runs),
             std::to_string(sum.stopped),
             has_bound(sum) ? number_text(std::round(1e4 * sum.longest_zero_s) / 10) : "",
             {std::to_string(sum.violated), sum.violated > 0 ? report::Tone::bad : report::Tone::good}});
        for (const std::string& example : sum.examples)
            broken.rows.push_back({std::string(sum.kind->name), example});
    }
    page.figures({{"runs", std::to_string(runs), std::to_string(sums.size()) + " kinds of fault"},
                  {"runs that break a rule", std::to_string(violated), "aim 0",
                   violated > 0 ? report::Tone::bad : report::Tone::good},
                  {"false trips", std::to_string(false_trips), "aim 0",
                   false_trips > 0 ? report::Tone::bad : report::Tone::good}});
    page.section("Kind by kind").table(std::move(table));
    if (!broken.rows.empty()) page.section("Rules broken").table(std::move(broken));
    page.footer("wheelwright torture --seeds " + std::to_string(options.seeds) + " --first-seed " +
                std::to_string(options.first_seed) + " --robots " + options.robots + " --report-ms " +
                std::to_string(options.report_ms));
    page.write(path);
}

// One seed again, in full.
int replay(const Options& options, const TortureKind& kind) {
    const UntouchedDrive untouched = untouched_drive(options.seed, robots_of(options), options.report_ms);
    if (!untouched.problem.empty()) {
        std::fprintf(stderr, "wheelwright torture: seed %llu (%s) does not drive even untouched: %s\n",
                     static_cast<unsigned long long>(options.seed), untouched.setup.text().c_str(),
                     untouched.problem.c_str());
        return kBadInput;
    }
    const TortureResult result = torture(kind, untouched, {options.log, options.black_box});
    std::printf("%s, seed %llu: %s\n", std::string(kind.name).c_str(),
                static_cast<unsigned long long>(options.seed), result.setup.c_str());
    for (const std::string& line : result.story) std::printf("%s\n", line.c_str());
    if (result.stopped)
        std::printf("zero torque after %.0f ms, fault %s\n", 1e3 * result.zero_s, result.fault.c_str());
    if (!result.stopped) std::printf("went on; at most %.3f m off its way\n", result.deviation_m);
    std::printf("bytes %016llx\n", static_cast<unsigned long long>(result.bytes));
    for (const std::string& violation : result.violations) std::printf("VIOLATION %s\n", violation.c_str());
    return result.violations.empty() ? kDone : kAimMissed;
}

int run_campaign(const Options& options, std::vector<const TortureKind*> kinds) {
    TortureCampaign campaign;
    campaign.kinds = std::move(kinds);
    campaign.first_seed = options.seed > 0 ? options.seed : options.first_seed;
    campaign.seeds = options.seed > 0 ? 1 : options.seeds;
    campaign.robots = robots_of(options);
    campaign.report_period_ms = options.report_ms;
    campaign.jobs = options.jobs;
    catch_interrupt();
    TortureOutcome outcome;
    {
        ProgressLine progress;
        outcome = run_torture(
            campaign, [&](const CampaignProgress& now) { progress(now); }, [] { return interrupted(); });
    }
    const std::vector<KindSummary> sums = summaries(campaign.kinds, outcome.results);
    Report report("torture");
    report.section("kinds", "Kinds of fault");
    report.table("kinds", {{"fault", "fault"},
                           {"runs", "runs"},
                           {"stopped", "stopped"},
                           {"longest_ms", "longest / ms"},
                           {"off_its_way_m", "off / m"},
                           {"false_trips", "false trips"},
                           {"violated", "violated"},
                           {"must_follow", "what must follow"}});
    std::size_t violated = 0;
    for (const KindSummary& sum : sums) {
        violated += sum.violated;
        report.row({std::string(sum.kind->name), std::int64_t(sum.runs), std::int64_t(sum.stopped),
                    has_bound(sum) ? Cell(std::round(1e4 * sum.longest_zero_s) / 10) : Cell(std::string("-")),
                    sum.stopped < sum.runs ? Cell(std::round(1e3 * sum.largest_deviation_m) / 1e3)
                                           : Cell(std::string("-")),
                    std::int64_t(sum.false_trips), std::int64_t(sum.violated), expectation(*sum.kind)});
    }
    report.section("all", "All together");
    report.add("runs", "runs", std::int64_t(outcome.results.size()));
    report.add("kinds", "kinds of fault", std::int64_t(sums.size()));
    report.add("not_driven", "seeds that do not drive untouched", std::int64_t(outcome.not_driven.size()));
    report.add("violated", "runs that break a rule", std::int64_t(violated));
    if (!report.publish(options.json)) return kMachineLacks;
    for (const KindSummary& sum : sums) {
        for (const std::string& example : sum.examples)
            std::printf("%s: %s\n", std::string(sum.kind->name).c_str(), example.c_str());
    }
    for (const std::string& seed : outcome.not_driven) std::printf("not driven: %s\n", seed.c_str());
    if (interrupted()) {
        std::printf("stopped early\n");
        return kAimMissed;
    }
    if (!options.page.empty()) {
        try {
            write_page(options.page, sums, options);
        } catch (const std::runtime_error& error) {
            std::fprintf(stderr, "wheelwright torture: %s\n", error.what());
            return kMachineLacks;
        }
        std::printf("\npage: %s\n", options.page.c_str());
    }
    return violated == 0 ? kDone : kAimMissed;
}

std::function<void(std::size_t)> counting(CampaignProgress& state, ProgressLine& line, std::mutex& mutex,
                                          const std::string& what) {
    const auto begin = std::chrono::steady_clock::now();
    return [&state, &line, &mutex, what, begin](std::size_t i) {
        const std::scoped_lock lock(mutex);
        ++state.done;
        state.elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
        state.last = what + " " + std::to_string(i + 1);
        line(state);
    };
}

int run_healthy(const Options& options) {
    catch_interrupt();
    const std::uint64_t first = options.seed > 0 ? options.seed : options.first_seed;
    const std::size_t robots = options.seed > 0 ? 1 : kHealthyRobots;
    std::vector<HealthyResult> results(robots);
    std::mutex mutex;
    CampaignProgress state;
    state.all = robots;
    {
        ProgressLine line;
        const auto count = counting(state, line, mutex, "robot");
        in_parallel(
            robots, options.jobs, [] { return interrupted(); },
            [&](std::size_t i) {
                results[i] = drive_healthy(first + i, 3600 * options.healthy_hours / kHealthyRobots,
                                           options.rough, options.report_ms);
                count(i);
            });
    }
    double driven_s = 0, fastest = 0, astray = 0;
    std::size_t drives = 0, trips = 0, runaways = 0;
    for (const HealthyResult& result : results) {
        driven_s += result.driven_s;
        drives += result.drives;
        trips += result.trips.size();
        for (const std::string& trip : result.trips)
            std::printf("robot %llu (%s): %s\n", static_cast<unsigned long long>(result.seed),
                        result.robot.c_str(), trip.c_str());
        fastest = std::max(fastest, result.fastest);
        astray = std::max(astray, result.astray);
        if (result.strays.empty()) continue;
        ++runaways;
        std::printf("robot %llu (%s): %s\n", static_cast<unsigned long long>(result.seed),
                    result.robot.c_str(), result.strays.c_str());
    }
    std::printf(
        "%.2f hours on %zu robots, %zu drives, %.1f %% of the frames lost: %zu false trips; at most "
        "%.2f of a limit of speed, and %.3f beside a set-point\n",
        driven_s / 3600, robots, drives, 100 * kHealthyLoss, trips, fastest, astray);
    return trips + runaways == 0 && !interrupted() ? kDone : kAimMissed;
}

int run_hostile(const Options& options) {
    // Each plan on both layouts and both generations.
    constexpr std::size_t kRuns = 4 * kHostilePlans;
    catch_interrupt();
    std::vector<HostileResult> results(kRuns);
    std::vector<std::uint64_t> memory(kRuns);
    std::mutex mutex;
    CampaignProgress state;
    state.all = kRuns;
    {
        ProgressLine line;
        const auto count = counting(state, line, mutex, "run");
        in_parallel(
            kRuns, options.jobs, [] { return interrupted(); },
            [&](std::size_t i) {
                results[i] = be_hostile(static_cast<HostilePlan>(i % kHostilePlans),
                                        options.first_seed + i / kHostilePlans, options.hostile / kRuns);
                memory[i] = resident_bytes();
                count(i);
            });
    }
    constexpr std::array kPlans{"idle, harmless", "driving, harmless", "idle, all", "driving, all"};
    Report report("torture hostile");
    report.section("runs", "Hostile frames");
    report.table("runs", {{"plan", "plan"},
                          {"robot", "robot"},
                          {"frames", "frames"},
                          {"valid", "valid by chance"},
                          {"fastest_m_per_s", "rim / m/s"},
                          {"memory_MB", "memory / MB"},
                          {"faults", "faults"},
                          {"violations", "violations"}});
    std::uint64_t frames = 0;
    std::size_t violations = 0;
    for (std::size_t i = 0; i < kRuns; ++i) {
        const HostileResult& r = results[i];
        std::string faults;
        for (const auto& [name, count] : r.faults)
            faults += (faults.empty() ? "" : ", ") + name + " " + std::to_string(count);
        std::string broken;
        for (const auto& [rule, count] : r.broken)
            broken += (broken.empty() ? "" : ", ") + rule + " " + std::to_string(count);
        report.row({std::string(kPlans[std::size_t(r.plan)]), r.setup, std::int64_t(r.frames),
                    std::int64_t(r.valid_commands), r.fastest_rim_m_per_s,
                    std::round(static_cast<double>(memory[i]) / 1e4) / 100, faults, broken});
        frames += r.frames;
        violations += r.violations.size();
    }
    report.section("all", "All together");
    report.add("frames", "frames", std::int64_t(frames));
    report.add("violations", "violations", std::int64_t(violations));
    if (!report.publish(options.json)) return kMachineLacks;
    for (const HostileResult& r : results) {
        for (const std::string& violation : r.violations)
            std::printf("%s (%s): %s\n", kPlans[std::size_t(r.plan)], r.setup.c_str(), violation.c_str());
    }
    return violations == 0 && !interrupted() ? kDone : kAimMissed;
}

int run_kill_saves(const Options& options) {
    const std::filesystem::path folder =
        std::filesystem::temp_directory_path() / ("wheelwright-torture-" + std::to_string(::getpid()));
    std::error_code failed;
    std::filesystem::create_directories(folder, failed);
    const std::string path = (folder / "robot.toml").string();
    std::filesystem::copy_file(example_robot("default.toml"), path, failed);
    const KillSavesResult result = kill_saves(path, options.kill_saves, options.first_seed);
    std::filesystem::remove_all(folder, failed);
    std::printf(
        "%llu kills, %llu of them after a save was through, %llu broken files, %llu temporary files left\n",
        static_cast<unsigned long long>(result.kills), static_cast<unsigned long long>(result.saves_seen),
        static_cast<unsigned long long>(result.broken),
        static_cast<unsigned long long>(result.temporary_left));
    if (!result.problem.empty()) std::fprintf(stderr, "wheelwright torture: %s\n", result.problem.c_str());
    return result.broken == 0 && result.problem.empty() ? kDone : kAimMissed;
}

int run_command(const Options& options) {
    if (options.list) {
        for (const TortureKind& kind : torture_kinds())
            std::printf("%-26s %s; %s\n", std::string(kind.name).c_str(), std::string(kind.what).c_str(),
                        expectation(kind).c_str());
        return kDone;
    }
    if (options.hostile > 0) return run_hostile(options);
    if (options.healthy_hours > 0) return run_healthy(options);
    if (options.kill_saves > 0) return run_kill_saves(options);
    std::vector<const TortureKind*> kinds;
    for (const std::string& name : options.kinds) {
        kinds.push_back(find_torture_kind(name));
        if (kinds.back() != nullptr) continue;
        std::fprintf(stderr, "wheelwright torture: no kind of fault is called %s; --list names them\n",
                     name.c_str());
        return kUsage;
    }
    if (options.seed > 0 && kinds.size() == 1) return replay(options, *kinds.front());
    if (!options.log.empty() || !options.black_box.empty()) {
        std::fprintf(stderr, "wheelwright torture: --log and --black-box are of one --kind, not of %zu\n",
                     kinds.size());
        return kUsage;
    }
    if (kinds.empty()) {
        for (const TortureKind& kind : torture_kinds()) kinds.push_back(&kind);
    }
    return run_campaign(options, std::move(kinds));
}

}  // namespace

void add_torture(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command =
        program.add_subcommand("torture", "Faults at random moments, judged by the truth");
    command.footer(
        "Drives simulated robots, does something bad to each, and judges by the robots' true speed, place "
        "and\n"
        "torque (docs/torture.md). The same seed gives the same bytes.\n"
        "Exit status 3: a rule is broken.");
    command.add_option("--seeds", options->seeds, "So many seeds, each with every kind of fault")
        .check(from_to("1", "1000000"))
        .show_default();
    command.add_option("--first-seed", options->first_seed, "The first of them")
        .check(from_to("1", "1000000000"))
        .show_default();
    const Option seed =
        command.add_option("--seed", options->seed, "One seed again, or one robot; with one --kind, in full")
            .check(from_to("1", "2000000000"));
    const Option kind =
        command.add_option("--kind", options->kinds, "Only these kinds of fault, with commas between")
            .delimiter(',');
    command.add_flag("--list", options->list, "Print the kinds of fault and end");
    command.add_option("--robots", options->robots, "Whose robots")
        .check(one_of({"both", "default", "drawn"}))
        .show_default();
    command.add_option("--report-ms", options->report_ms, "How often their drives report encoders, in ms")
        .check(from_to("1", "10"))
        .show_default();
    command.add_option("--hostile", options->hostile, "Instead: so many hostile frames on the bus")
        .check(from_to("1", "1000000000"));
    command
        .add_option("--healthy-hours", options->healthy_hours,
                    "Instead: so many hours of normal driving on twenty drawn robots")
        .check(from_to("0.01", "100000"));
    command.add_flag("--rough", options->rough,
                     "With --healthy-hours: slopes, bumps, obstacles, tyres that slip");
    command
        .add_option("--kill-saves", options->kill_saves,
                    "Instead: so many processes killed while they save a robot file")
        .check(from_to("1", "1000000"));
    command.add_option("--jobs", options->jobs, "Seeds at a time; 0: as many as processors")
        .check(from_to("0", "1000"))
        .show_default();
    command.add_option("--log", options->log, "Write its bus's frames to this file, as candump -L does")
        .needs(seed)
        .needs(kind);
    command.add_option("--black-box", options->black_box, "Write its black boxes to this directory")
        .needs(seed)
        .needs(kind);
    command.add_option("--page", options->page, "Write a page (HTML) to this file");
    command.add_option("--json", options->json, "Write the figures to this file");
    command.callback([options, &run] {
        if (options->jobs == 0) options->jobs = std::max(1U, std::thread::hardware_concurrency());
        run = [options] { return run_command(*options); };
    });
}

}  // namespace wheelwright::tools
