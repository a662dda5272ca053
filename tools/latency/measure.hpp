// How punctually this machine runs the firmware: its loop, its cycle, in real time, beside cyclictest.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "firmware/task/cycle_schedule.hpp"
#include "hal/linux/realtime.hpp"

namespace wheelwright::tools {

struct LatencyOptions {
    double duration_s = 10;  // at least 1
    hal::RealtimeOptions realtime;
    double send_phase_s = 3e-4;
    std::string cyclictest;  // its path; "": without
};

struct Latency {
    // As in task::LoopStatistics, with the simulated robot's part left out.
    task::DurationHistogram wake_up;  // after the time that was slept for
    task::DurationHistogram cycle;    // the firmware's computing
    task::DurationHistogram sending;  // torques handed over after the time that they are due
    std::uint64_t cycles = 0;
    std::uint64_t missed = 0;
    std::uint64_t late = 0;  // cycles that had not yet thought when their torques were due
    std::optional<task::DurationHistogram> cyclictest;  // its wake-ups, in the same time
    std::string no_cyclictest;                          // why there is none
    std::vector<hal::Refusal> refused;                  // of real time; both ran without it then
};

// Runs the firmware's loop (task::run_cycles) on this machine's clock. In each cycle the whole firmware
// drives a simulated robot on an in-process bus through a figure-8 in adaptive mode; nothing leaves the
// process. Makes the calling thread real-time, as far as the machine allows, and leaves it so. Throws
// std::runtime_error where the example robot's files cannot be read.
Latency measure_latency(const LatencyOptions& options);

// Of cyclictest's output with -h; none where it is not that.
std::optional<task::DurationHistogram> read_cyclictest(const std::string& output);

enum class Fitness : std::uint8_t {
    fit,      // no cycle was missed, and 99.9 % of the torques left within a twentieth of a cycle after their
              // time
    limited,  // no cycle was missed
    unfit,
};
Fitness fitness(const Latency& latency);

}  // namespace wheelwright::tools
