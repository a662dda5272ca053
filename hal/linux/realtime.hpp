// What a thread needs from Linux to keep a deadline. Each function does one thing to the calling thread or
// process, and says by name what was missing when the machine refuses. For start-up: they may allocate.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace wheelwright::hal {

// What the machine refused. The parts are clauses; sentence() joins them.
struct Refusal {
    std::string what;       // "real-time scheduling at priority 80"
    std::string privilege;  // "CAP_SYS_NICE or RLIMIT_RTPRIO >= 80"; empty when no privilege would help
    std::string remedy;     // "run as root, or add `LimitRTPRIO=80` to the service"

    std::string sentence() const;
};

// SCHED_FIFO, priority 1..99, for the calling thread and threads it starts.
std::optional<Refusal> set_fifo_priority(int priority);

// Keeps in RAM what the process has, touched or not, and what it takes later from when that is first touched.
// So take before it what a cycle uses, and start threads that need not be punctual after it: of their stacks
// they then hold what they use.
std::optional<Refusal> lock_memory();

// Threads started from now on get stacks of 512 KiB, for a limit of locked memory counts the usual 8 MiB
// whole. Where the C library refuses, they keep its default.
void limit_thread_stacks();

// Lets the calling thread run on this processor only.
std::optional<Refusal> pin_to_cpu(int cpu);

// Touches the next `bytes` of the calling thread's stack, so that no cycle meets a page for the first time.
// Refused when the stack's limit leaves no room for it.
std::optional<Refusal> prefault_stack(std::size_t bytes);

// Until the process ends, no processor enters an idle state from which it wakes slowly
// (/dev/cpu_dma_latency). None also where the machine has no such device, as most virtual ones.
std::optional<Refusal> keep_processors_awake();

struct RealtimeOptions {
    int priority = 80;
    std::optional<int> cpu;  // none: the scheduler decides
    std::size_t stack_bytes =
        64 * 1024;       // a cycle uses less than a quarter of it (tests/alloc/stack_use.cpp)
    bool memory = true;  // false: it has been locked before
};

// All of the above but the idle states, everything tried; empty when all were granted. Also sets the timer
// slack to 1 ns, which matters only to a thread that has to run without SCHED_FIFO.
std::vector<Refusal> become_realtime(const RealtimeOptions& options);

}  // namespace wheelwright::hal
