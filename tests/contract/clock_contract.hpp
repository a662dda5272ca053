// What every hal::Clock does. A rig provides: hal::Clock& clock().
#pragma once

#include <cstdint>

#include "hal/clock.hpp"
#include "tests/contract/expect.hpp"

namespace wheelwright::contract {

template <typename Rig>
void time_does_not_go_back(Rig& rig) {
    std::int64_t last_ns = rig.clock().now_ns();
    for (int i = 0; i < 1000; ++i) {
        const std::int64_t now_ns = rig.clock().now_ns();
        EXPECT_THAT(now_ns >= last_ns);
        last_ns = now_ns;
    }
}

template <typename Rig>
void a_sleep_ends_no_earlier_than_its_deadline(Rig& rig) {
    for (const std::int64_t step_ns : {1, 999, 1'000'000, 1'500'000}) {
        const std::int64_t deadline_ns = rig.clock().now_ns() + step_ns;
        rig.clock().sleep_until_ns(deadline_ns);
        EXPECT_THAT(rig.clock().now_ns() >= deadline_ns);
    }
}

template <typename Rig>
void a_deadline_that_has_passed_returns_at_once(Rig& rig) {
    const std::int64_t before_ns = rig.clock().now_ns();
    rig.clock().sleep_until_ns(before_ns - 1);
    rig.clock().sleep_until_ns(before_ns);
    rig.clock().sleep_until_ns(0);
    rig.clock().sleep_until_ns(-1'000'000'000);
    EXPECT_THAT(rig.clock().now_ns() - before_ns < 500'000'000);
}

template <typename Rig>
void absolute_deadlines_do_not_add_up_lateness(Rig& rig) {
    // Ten periods of 2 ms end when the tenth deadline does, however late each wake-up was.
    const std::int64_t start_ns = rig.clock().now_ns();
    for (int i = 1; i <= 10; ++i) {
        rig.clock().sleep_until_ns(start_ns + i * 2'000'000);
        EXPECT_THAT(rig.clock().now_ns() >= start_ns + i * 2'000'000);
    }
    EXPECT_THAT(rig.clock().now_ns() - start_ns < 1'000'000'000);
}

#define WHEELWRIGHT_CLOCK_CONTRACT(X)             \
    X(time_does_not_go_back)                      \
    X(a_sleep_ends_no_earlier_than_its_deadline)  \
    X(a_deadline_that_has_passed_returns_at_once) \
    X(absolute_deadlines_do_not_add_up_lateness)

}  // namespace wheelwright::contract
