#include "sim_hal/virtual_clock.hpp"

#include <cstdint>

#include "sim_hal/sim_line.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

TEST_GROUP(VirtualClock){};

TEST(VirtualClock, moves_only_when_told_and_never_back) {
    sim::VirtualClock clock(500);
    LONGS_EQUAL(500, clock.now_ns());
    LONGS_EQUAL(500, clock.now_ns());
    clock.advance_to(700);
    clock.advance_to(600);
    LONGS_EQUAL(700, clock.now_ns());
    clock.sleep_until_ns(650);
    LONGS_EQUAL(700, clock.now_ns());
    clock.sleep_until_ns(900);
    LONGS_EQUAL(900, clock.now_ns());
}

TEST(VirtualClock, a_sleep_lets_the_world_run_from_event_to_event) {
    class World final : public sim::VirtualClock::Sleeper {
      public:
        explicit World(sim::VirtualClock& clock) : clock_(clock) {}
        void run_until(std::int64_t deadline_ns) override {
            ++sleeps;
            for (; next_ns <= deadline_ns; next_ns += 300) {
                clock_.advance_to(next_ns);
                ++events;
            }
        }
        int sleeps = 0;
        int events = 0;
        std::int64_t next_ns = 300;

      private:
        sim::VirtualClock& clock_;
    };
    sim::VirtualClock clock;
    World world(clock);
    clock.set_sleeper(&world);
    clock.sleep_until_ns(1000);
    LONGS_EQUAL(1000, clock.now_ns());
    LONGS_EQUAL(3, world.events);
    clock.sleep_until_ns(1000);  // has passed: the world does not run
    LONGS_EQUAL(1, world.sleeps);
    clock.sleep_until_ns(2000);
    LONGS_EQUAL(6, world.events);
    clock.set_sleeper(nullptr);
    clock.sleep_until_ns(3000);
    LONGS_EQUAL(2, world.sleeps);
    LONGS_EQUAL(3000, clock.now_ns());
}

TEST_GROUP(SimLine){};

TEST(SimLine, changes_are_recorded_with_their_time_and_repeats_are_not) {
    sim::VirtualClock clock;
    sim::SimOutput output(clock);
    CHECK(output.level() == hal::LineLevel::unknown);
    LONGS_EQUAL(0, output.history().size());
    clock.advance_to(10);
    CHECK(output.write(true));
    clock.advance_to(20);
    CHECK(output.write(true));
    clock.advance_to(30);
    CHECK(output.write(false));
    LONGS_EQUAL(2, output.history().size());
    LONGS_EQUAL(10, output.history()[0].time_ns);
    CHECK(output.history()[0].level == hal::LineLevel::active);
    LONGS_EQUAL(30, output.history()[1].time_ns);
    CHECK(output.history()[1].level == hal::LineLevel::inactive);
}

TEST(SimLine, a_long_history_keeps_the_latest_and_counts_all) {
    sim::VirtualClock clock;
    sim::SimInput input(clock);
    constexpr std::size_t changes = sim::LineHistory::capacity + 10;
    for (std::size_t i = 1; i <= changes; ++i) {
        clock.advance_to(static_cast<std::int64_t>(i));
        input.set(i % 2 == 1 ? hal::LineLevel::active : hal::LineLevel::inactive);
    }
    LONGS_EQUAL(changes, input.history().total());
    LONGS_EQUAL(sim::LineHistory::capacity, input.history().size());
    LONGS_EQUAL(11, input.history()[0].time_ns);
    LONGS_EQUAL(changes, input.history()[sim::LineHistory::capacity - 1].time_ns);
}

TEST(SimLine, a_line_that_cannot_be_read_is_unknown_and_a_broken_output_refuses) {
    sim::VirtualClock clock;
    sim::SimInput input(clock, hal::LineLevel::active);
    CHECK(input.read() == hal::LineLevel::active);
    input.set(hal::LineLevel::unknown);
    CHECK(input.read() == hal::LineLevel::unknown);
    sim::SimOutput output(clock);
    CHECK(output.write(true));
    output.set_broken(true);
    CHECK(!output.write(false));
    CHECK(output.level() == hal::LineLevel::active);
}
