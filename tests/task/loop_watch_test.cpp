// A loop that hangs, in a bus that does not come back: real threads, real time.
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <thread>

#include "firmware/task/loop_watch.hpp"
#include "firmware/task/realtime_loop.hpp"
#include "hal/linux/monotonic_clock.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace std::chrono_literals;

namespace {

// Sends into a bus that holds the cycle up for as long as somebody wants.
class HangingCycle {
  public:
    static void think(const task::CycleTime&) {}
    static std::int64_t send_phase_ns() { return 0; }
    void send(std::int64_t) {
        while (hangs) std::this_thread::sleep_for(1ms);
    }
    bool finished() const { return ends; }
    void request_termination() { ends = true; }
    std::atomic<bool> hangs{false}, ends{false};
};

struct Seen {
    std::atomic<int> begun{0}, alive{0}, hung{0};
    task::LoopWatch::Actions actions() {
        return {[this] { ++begun; }, [this] { ++alive; }, [this] { ++hung; }};
    }
};

}  // namespace

TEST_GROUP(LoopWatch){};

TEST(LoopWatch, ten_looks_in_a_row_without_a_new_cycle_are_a_hang) {
    task::HangDetector detector;
    std::uint64_t cycles = 0;
    for (int i = 0; i < 100; ++i) CHECK(!detector.look(++cycles));
    for (int round = 0; round < 3; ++round) {  // held up, and on
        for (int i = 1; i < task::kLooksUntilHung; ++i) CHECK(!detector.look(cycles));
        CHECK(!detector.look(++cycles));
    }
    for (int i = 1; i < task::kLooksUntilHung; ++i) CHECK(!detector.look(cycles));
    CHECK(detector.look(cycles));
}

TEST(LoopWatch, a_loop_that_hangs_is_found_and_one_that_runs_is_told_alive) {
    HangingCycle cycle;
    Seen seen;
    hal::MonotonicClock clock;
    const auto statistics = std::make_unique<task::LoopStatistics>();
    task::LoopWatch watch(statistics->cycles, seen.actions());
    const auto wait = [&clock](const auto& until) {  // s
        const std::int64_t from_ns = clock.now_ns();
        while (!until() && clock.now_ns() < from_ns + 10'000'000'000) std::this_thread::sleep_for(1ms);
        return 1e-9 * static_cast<double>(clock.now_ns() - from_ns);
    };
    wait([&] { return seen.begun == 1; });
    std::this_thread::sleep_for(150ms);
    const int before_the_beginning = seen.hung;
    watch.begin();
    std::thread loop([&] { task::run_cycles(cycle, clock, *statistics); });
    wait([&] { return seen.alive > 2; });
    cycle.hangs = true;
    const double found_s = wait([&] { return seen.hung > 0; });
    const int alive = seen.alive;
    cycle.hangs = false;
    cycle.ends = true;
    loop.join();
    CHECK_EQUAL(0, before_the_beginning);
    CHECK(alive > 2);
    CHECK_EQUAL(1, seen.hung.load());
    CHECK(found_s < 5);  // 0.11 on a machine that has time
    std::printf("  found after %.0f ms\n", 1e3 * found_s);
}
