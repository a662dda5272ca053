#include "tools/strangers/campaign.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>
#include <optional>
#include <thread>

namespace wheelwright::tools {

std::vector<RobotResult> run_robots(const std::vector<DrawnRobot>& robots, std::size_t jobs,
                                    const TrialOptions& options,
                                    const std::function<void(const CampaignProgress&)>& progress,
                                    const std::function<bool()>& stop) {
    std::vector<std::optional<RobotResult>> results(robots.size());
    std::atomic<std::size_t> next{0};
    std::mutex mutex;
    CampaignProgress state;
    state.all = robots.size();
    const auto begin = std::chrono::steady_clock::now();
    const auto work = [&] {
        for (std::size_t i = next++; i < robots.size() && !stop(); i = next++) {
            RobotResult result = run_trial(robots[i], options);
            const std::scoped_lock lock(mutex);
            ++state.done;
            state.elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
            state.last = "robot " + std::to_string(robots[i].number) + " " +
                         (result.problem.empty() ? result.end : result.problem);
            results[i] = std::move(result);
            progress(state);
        }
    };
    std::vector<std::thread> threads;
    for (std::size_t i = 1; i < std::min(jobs, robots.size()); ++i) threads.emplace_back(work);
    work();
    for (std::thread& thread : threads) thread.join();
    std::vector<RobotResult> done;
    for (auto& result : results) {
        if (result) done.push_back(std::move(*result));
    }
    return done;
}

}  // namespace wheelwright::tools
