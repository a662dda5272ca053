#include "tools/torture/campaign.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <thread>

namespace wheelwright::tools {

void in_parallel(std::size_t count, std::size_t jobs, const std::function<bool()>& stop,
                 const std::function<void(std::size_t)>& work) {
    std::atomic<std::size_t> next{0};
    const auto run = [&] {
        for (std::size_t i = next++; i < count && !stop(); i = next++) work(i);
    };
    std::vector<std::thread> threads;
    for (std::size_t i = 1; i < std::min(jobs, count); ++i) threads.emplace_back(run);
    run();
    for (std::thread& thread : threads) thread.join();
}

TortureOutcome run_torture(const TortureCampaign& campaign,
                           const std::function<void(const CampaignProgress&)>& progress,
                           const std::function<bool()>& stop) {
    std::vector<std::vector<TortureResult>> by_seed(campaign.seeds);
    std::vector<std::string> problems(campaign.seeds);
    std::mutex mutex;
    CampaignProgress state;
    state.all = campaign.seeds;
    const auto begin = std::chrono::steady_clock::now();
    in_parallel(campaign.seeds, campaign.jobs, stop, [&](std::size_t i) {
        const std::uint64_t seed = campaign.first_seed + i;
        const UntouchedDrive untouched = untouched_drive(seed, campaign.robots, campaign.report_period_ms);
        if (untouched.problem.empty()) {
            for (const TortureKind* kind : campaign.kinds) {
                by_seed[i].push_back(torture(*kind, untouched));
                by_seed[i].back().story = {};
            }
        } else {
            problems[i] =
                "seed " + std::to_string(seed) + " (" + untouched.setup.text() + "): " + untouched.problem;
        }
        const std::scoped_lock lock(mutex);
        ++state.done;
        state.elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
        state.last = "seed " + std::to_string(seed) + ", " + untouched.setup.text();
        progress(state);
    });
    TortureOutcome outcome;
    for (std::size_t i = 0; i < campaign.seeds; ++i) {
        for (TortureResult& result : by_seed[i]) outcome.results.push_back(std::move(result));
        if (!problems[i].empty()) outcome.not_driven.push_back(std::move(problems[i]));
    }
    return outcome;
}

std::vector<KindSummary> summaries(const std::vector<const TortureKind*>& kinds,
                                   const std::vector<TortureResult>& results) {
    constexpr std::size_t kSeedsNamed = 20;  // of a kind and a rule
    std::vector<KindSummary> all;
    for (const TortureKind* kind : kinds) {
        KindSummary sum;
        sum.kind = kind;
        struct Broken {
            std::map<std::string, std::size_t> modes;  // runs
            std::string first;
            std::string others;  // seeds
            std::size_t runs = 0;
        };
        std::map<std::string, Broken> rules;
        for (const TortureResult& r : results) {
            if (r.kind != kind->name) continue;
            ++sum.runs;
            if (r.stopped || kind->expect == Expect::rests) {
                if (r.stopped) ++sum.stopped;
                sum.longest_zero_s = std::max(sum.longest_zero_s, r.zero_s);
            } else {
                sum.largest_deviation_m = std::max(sum.largest_deviation_m, r.deviation_m);
            }
            if (!r.violations.empty()) ++sum.violated;
            for (const std::string& violation : r.violations) {
                const std::string rule = violation.substr(0, violation.find(':'));
                if (rule == "false trip") ++sum.false_trips;
                Broken& broken = rules[rule];
                broken.runs++;
                if (broken.first.empty())
                    broken.first = "seed " + std::to_string(r.seed) + " (" + r.setup + ") " + violation;
                else if (broken.runs <= kSeedsNamed)
                    broken.others += (broken.others.empty() ? ", then " : " ") + std::to_string(r.seed);
                ++broken.modes[r.setup.substr(0, r.setup.find(','))];
            }
        }
        for (const auto& [rule, broken] : rules) {
            std::string modes;
            for (const auto& [mode, runs] : broken.modes)
                modes += (modes.empty() ? "" : ", ") + mode + " " + std::to_string(runs);
            sum.examples.push_back(std::to_string(broken.runs) + " runs (" + modes + "), first " +
                                   broken.first + broken.others + (broken.runs > kSeedsNamed ? " ..." : ""));
        }
        all.push_back(std::move(sum));
    }
    return all;
}

}  // namespace wheelwright::tools
