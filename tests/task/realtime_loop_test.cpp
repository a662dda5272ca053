// The loop's schedule and statistics on a clock that wakes as late as the test says.
#include <cstdint>
#include <memory>
#include <vector>

#include "firmware/task/realtime_loop.hpp"
#include "hal/clock.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kUs = 1'000;

class LateClock final : public hal::Clock {
  public:
    std::int64_t now_ns() const override { return now_ns_; }
    void sleep_until_ns(std::int64_t deadline_ns) override {
        if (deadline_ns > now_ns_) now_ns_ = deadline_ns + late_ns_;
    }
    void pass(std::int64_t duration_ns) { now_ns_ += duration_ns; }
    void wake_late(std::int64_t late_ns) { late_ns_ = late_ns; }

  private:
    std::int64_t now_ns_ = 5 * kMs + 137;
    std::int64_t late_ns_ = 0;
};

// What cycle i does: compute for so long, and be woken so late the next time.
struct Plan {
    std::int64_t computing_ns = 0;
    std::int64_t next_late_ns = 0;
};

class PlannedCycle {
  public:
    PlannedCycle(LateClock& clock, const std::vector<Plan>& plan) : clock_(clock), plan_(plan) {}

    void think(const task::CycleTime& time) {
        times.push_back(time);
        clock_.pass(plan_[times.size() - 1].computing_ns);
        clock_.wake_late(plan_[times.size() - 1].next_late_ns);
    }
    static std::int64_t send_phase_ns() { return 0; }
    void send(std::int64_t) {}
    bool finished() const { return times.size() == plan_.size(); }
    void request_termination() {}

    std::vector<task::CycleTime> times;

  private:
    LateClock& clock_;
    std::vector<Plan> plan_;
};

}  // namespace

TEST_GROUP(RealtimeLoop){};

TEST(RealtimeLoop, AMissedPeriodShowsInTheWakeUpLatencyAndTheGridStays) {
    const auto statistics = std::make_unique<task::LoopStatistics>();
    LateClock clock;
    PlannedCycle cycle(clock, {{0, 40 * kUs}, {0, 2 * kMs + 300 * kUs}, {0, 0}, {0, 0}});
    task::run_cycles(cycle, clock, *statistics);
    LONGS_EQUAL(4, statistics->cycles);
    LONGS_EQUAL(2, statistics->missed);
    LONGS_EQUAL(4, statistics->wake_latency.total());
    LONGS_EQUAL(2 * kMs + 300 * kUs, statistics->wake_latency.largest_ns());
    LONGS_EQUAL(2, cycle.times[2].missed);
    LONGS_EQUAL(300 * kUs, cycle.times[2].woken_ns - cycle.times[2].scheduled_ns);
    const std::int64_t first_ns = cycle.times[0].scheduled_ns;
    for (const task::CycleTime& time : cycle.times) LONGS_EQUAL(0, (time.scheduled_ns - first_ns) % kMs);
    LONGS_EQUAL(5 * kMs, cycle.times[3].scheduled_ns - first_ns);
}

TEST(RealtimeLoop, SoDoesACycleThatTakesLongerThanItsPeriod) {
    const auto statistics = std::make_unique<task::LoopStatistics>();
    LateClock clock;
    PlannedCycle cycle(clock, {{0, 0}, {3 * kMs + 600 * kUs, 0}, {0, 0}});
    task::run_cycles(cycle, clock, *statistics);
    LONGS_EQUAL(2, statistics->missed);
    // Due 1 ms after the cycle before it began, and woken 3.6 ms after.
    LONGS_EQUAL(2 * kMs + 600 * kUs, statistics->wake_latency.largest_ns());
    LONGS_EQUAL(3 * kMs + 600 * kUs, statistics->execution.largest_ns());
}

TEST(RealtimeLoop, ALateWakeUpWithinItsPeriodMissesNothing) {
    const auto statistics = std::make_unique<task::LoopStatistics>();
    LateClock clock;
    PlannedCycle cycle(clock, {{0, 999 * kUs}, {0, 999 * kUs}, {0, 0}});
    task::run_cycles(cycle, clock, *statistics);
    LONGS_EQUAL(0, statistics->missed);
    LONGS_EQUAL(999 * kUs, statistics->wake_latency.largest_ns());
}

TEST(RealtimeLoop, OverrunsInARowOrInASecondAreAFault) {
    task::OverrunMonitor row(3, 1000);
    CHECK_FALSE(row.step(2));
    CHECK(row.step(3));
    task::OverrunMonitor second(1000, 10);
    for (int i = 0; i < 9; ++i) CHECK_FALSE(second.step(1));
    CHECK(second.step(1));
    for (int i = 0; i < 1000; ++i) second.step(0);
    CHECK_FALSE(second.step(1));
    LONGS_EQUAL(11, second.total());
}
