// Tasks of a campaign, some at a time.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "tools/cli/progress_line.hpp"

namespace wheelwright::tools {

// Does work(0) to work(count - 1), each of which returns a line about itself; `progress` is called by one
// thread at a time. What a task throws ends the campaign and is thrown again.
inline void in_parallel(std::size_t count, std::size_t jobs,
                        const std::function<void(const CampaignProgress&)>& progress,
                        const std::function<std::string(std::size_t)>& work) {
    std::atomic<std::size_t> next{0};
    std::mutex mutex;
    std::exception_ptr failed;
    CampaignProgress state;
    state.all = count;
    const auto begin = std::chrono::steady_clock::now();
    const auto take = [&] {
        for (std::size_t i = next++; i < count; i = next++) {
            std::string last;
            try {
                last = work(i);
            } catch (const std::exception&) {
                const std::scoped_lock lock(mutex);
                failed = std::current_exception();
                next = count;
                return;
            }
            const std::scoped_lock lock(mutex);
            ++state.done;
            state.elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
            state.last = std::move(last);
            progress(state);
        }
    };
    std::vector<std::thread> threads;
    for (std::size_t i = 1; i < std::min(jobs, count); ++i) threads.emplace_back(take);
    take();
    for (std::thread& thread : threads) thread.join();
    if (failed) std::rethrow_exception(failed);
}

}  // namespace wheelwright::tools
