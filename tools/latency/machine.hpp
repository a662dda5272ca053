// What of this machine bears on how punctually a 1 kHz loop wakes, and what its owner can change. From /proc
// and /sys, without privileges.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace wheelwright::tools {

struct CanInterface {
    std::string name;
    std::string queueing;             // its queueing discipline, as `ip` names it; "" where ip does not say
    std::int64_t queue_frames = 0;    // frames that it holds: tx_queue_len
    bool has_controller = false;      // not a virtual one, whose frames wait for nobody
    std::optional<int> irq_priority;  // real-time priority of its interrupt thread; none: no such thread
};

struct Machine {
    std::string kernel;  // release
    bool realtime_kernel = false;
    bool virtual_machine = false;
    int processors = 0;
    std::string isolated;     // processors that ordinary processes leave alone: "3", "2-3", ""
    std::string governor;     // of the processors' frequency, where one is not "performance"; else ""
    double idle_exit_us = 0;  // of the deepest idle state that is in use; 0: none, or not said
    std::vector<CanInterface> can;
};

// `root`: "" on this machine; else a folder with its proc/ and sys/. `ip_json`: what `ip -json link` prints.
Machine look_at_machine(const std::string& root, const std::string& ip_json);

struct Advice {
    std::string what;    // what was found
    std::string change;  // what to do about it
};
// What to change, most useful first. `cpu`: the processor that the loop is bound to; none: any.
std::vector<Advice> advice(const Machine& machine, int priority, std::optional<int> cpu);

}  // namespace wheelwright::tools
