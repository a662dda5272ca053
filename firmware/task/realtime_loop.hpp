// The loop that runs one cycle in each millisecond of a clock: wake on the grid, think, wait for the sending
// phase, send. One thread; nothing in it allocates, locks or logs.
#pragma once

#include <atomic>
#include <cstdint>

#include "firmware/task/cycle_schedule.hpp"
#include "hal/clock.hpp"

namespace wheelwright::task {

struct LoopStatistics {
    // One value for each cycle that ran: woken - the deadline slept for (CycleTime::wake_latency_ns). A
    // wake-up so late that periods passed whole is one value longer than those periods, whether the machine
    // woke the loop late or the cycle before it took too long. cyclictest counts the same way.
    DurationHistogram wake_latency;
    DurationHistogram execution;   // thinking and sending, the wait for the sending phase left out
    DurationHistogram send_phase;  // torques sent - scheduled, that is from the grid point after missed ones
    std::atomic<std::uint64_t> cycles{0};  // written by the loop's thread only; LoopWatch reads it
    std::uint64_t missed = 0;
};

// Runs until cycle.finished(). A Cycle has
//     void think(const CycleTime&);   read, estimate, decide
//     std::int64_t send_phase_ns();   when, after the scheduled time, the torques go out
//     void send(std::int64_t now_ns); torques, then telemetry
//     bool finished();
//     void request_termination();  called after `most_cycles` cycles, unless that is 0
template <typename Cycle>
void run_cycles(Cycle& cycle, hal::Clock& clock, LoopStatistics& statistics, std::uint64_t most_cycles = 0) {
    CycleSchedule schedule(clock.now_ns() + 2 * kCyclePeriod_ns);
    while (!cycle.finished()) {
        clock.sleep_until_ns(schedule.next_deadline_ns());
        const CycleTime time = schedule.begin(clock.now_ns());
        cycle.think(time);
        const std::int64_t thought_ns = clock.now_ns();
        const std::int64_t phase_ns = time.scheduled_ns + cycle.send_phase_ns();
        std::int64_t sending_ns = thought_ns;
        if (thought_ns < phase_ns) {
            clock.sleep_until_ns(phase_ns);
            sending_ns = clock.now_ns();
        }
        cycle.send(sending_ns);
        const std::int64_t computing_ns = (thought_ns - time.woken_ns) + (clock.now_ns() - sending_ns);
        schedule.end(computing_ns);
        const std::uint64_t cycles = statistics.cycles.load(std::memory_order_relaxed) + 1;
        statistics.cycles.store(cycles, std::memory_order_relaxed);
        if (cycles == most_cycles) cycle.request_termination();
        statistics.missed += static_cast<std::uint64_t>(time.missed);
        statistics.wake_latency.add(time.wake_latency_ns());
        statistics.execution.add(computing_ns);
        statistics.send_phase.add(sending_ns - time.scheduled_ns);
    }
}

}  // namespace wheelwright::task
