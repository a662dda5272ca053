// Watches that the cycles go on, from a thread of its own with a lower priority. The drives' watchdogs stop
// the wheels when a loop hangs; this makes them idle, whatever is set in them, and ends a process that will
// not end itself. A service manager that watches in turn is told that all is well by this thread only, while
// the cycles go on: it finds a watcher that gets no time.
//
// Time is counted in looks of this thread and not by a clock: a machine that stood still as a whole is one
// look older, and the loop's own affair (cycle_overrun).
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <thread>
#include <utility>

namespace wheelwright::task {

// Longer than what a loop that runs again can deal with by itself; and than the drives' watchdogs are set to,
// so that nothing is lost by ending.
inline constexpr int kLooksUntilHung = 10;
inline constexpr std::chrono::milliseconds kLook{10};

// So many looks in a row that find no new cycle.
class HangDetector {
  public:
    bool look(std::uint64_t cycles) {
        looks_ = cycles == cycles_ ? looks_ + 1 : 0;
        cycles_ = cycles;
        return looks_ >= kLooksUntilHung;
    }

  private:
    std::uint64_t cycles_ = 0;
    int looks_ = 0;
};

class LoopWatch {
  public:
    struct Actions {
        std::function<void()> begin;  // first, in the watcher's thread: its priority
        std::function<void()> alive;  // at each look that finds new cycles
        std::function<void()> hung;   // once; the watch ends with it
    };

    // `cycles` counts them, and outlives this. Start it while the ending signals are blocked: the thread
    // inherits the mask. Nothing is watched before begin().
    LoopWatch(const std::atomic<std::uint64_t>& cycles, Actions actions)
        : cycles_(cycles), actions_(std::move(actions)), thread_([this] { run(); }) {}
    ~LoopWatch() {
        ends_ = true;
        thread_.join();
    }
    LoopWatch(const LoopWatch&) = delete;
    LoopWatch& operator=(const LoopWatch&) = delete;

    void begin() { watches_ = true; }

  private:
    void run() {
        if (actions_.begin) actions_.begin();
        HangDetector detector;
        std::uint64_t before = 0;
        while (!ends_) {
            std::this_thread::sleep_for(kLook);
            if (!watches_ || ends_) continue;
            const std::uint64_t cycles = cycles_.load(std::memory_order_relaxed);
            if (cycles != before && actions_.alive) actions_.alive();
            before = cycles;
            if (!detector.look(cycles)) continue;
            actions_.hung();
            return;
        }
    }

    const std::atomic<std::uint64_t>& cycles_;
    Actions actions_;
    std::atomic<bool> watches_{false};
    std::atomic<bool> ends_{false};
    std::thread thread_;
};

}  // namespace wheelwright::task
