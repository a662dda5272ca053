// How late this machine wakes the firmware's own loop: run_cycles with a cycle that does nothing, in real
// time, on this machine's clock. Prints the wake-up latency; host_latency beside it runs cyclictest at the
// same time.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>

#include "firmware/task/realtime_loop.hpp"
#include "hal/linux/monotonic_clock.hpp"
#include "hal/linux/realtime.hpp"

namespace {

using namespace wheelwright;

class IdleCycle {
  public:
    void think(const task::CycleTime&) {}
    static std::int64_t send_phase_ns() { return 0; }
    void send(std::int64_t) {}
    bool finished() const { return finished_; }
    void request_termination() { finished_ = true; }

  private:
    bool finished_ = false;
};

}  // namespace

int main(int argc, char** argv) {
    const long seconds = argc > 1 ? std::strtol(argv[1], nullptr, 10) : 5;
    if (seconds < 1) {
        std::fprintf(stderr, "usage: host_latency_loop [SECONDS]\n");
        return 1;
    }
    const auto statistics = std::make_unique<task::LoopStatistics>();
    for (const hal::Refusal& one : hal::become_realtime({})) std::printf("%s\n", one.sentence().c_str());
    IdleCycle cycle;
    hal::MonotonicClock clock;
    task::run_cycles(cycle, clock, *statistics, static_cast<std::uint64_t>(seconds) * 1000);

    const task::DurationHistogram& late = statistics->wake_latency;
    const auto us = [](std::int64_t ns) { return 1e-3 * static_cast<double>(ns); };
    std::printf(
        "wheelwright: cycles %llu, missed %llu, median %.0f us, 99 %% %.0f us, 99.9 %% %.0f us, longest %.0f "
        "us\n",
        static_cast<unsigned long long>(statistics->cycles),
        static_cast<unsigned long long>(statistics->missed), us(late.quantile_ns(0.5)),
        us(late.quantile_ns(0.99)), us(late.quantile_ns(0.999)), us(late.largest_ns()));
    return statistics->cycles == static_cast<std::uint64_t>(seconds) * 1000 ? 0 : 1;
}
