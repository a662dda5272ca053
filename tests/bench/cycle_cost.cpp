// Runs cycles for an instruction counter: cycle_cost WHAT CYCLES [each].
//   cycle, recorded
//               the firmware's cycle alone, adaptive figure-8: frames recorded from a drive before are handed
//   to
//               it again from memory, and the frames that it gives go to memory, so nothing of a bus is
//               counted
//               With its black box, or without
//   simulation  whole milliseconds of the same drive: cycle, both ends of the bus, drives, body, host
//   time        the same, on the clock: prints the times real time
// `each`: the counter writes down every cycle by itself.
#include <valgrind/callgrind.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string_view>
#include <vector>

#include "firmware/task/black_box.hpp"
#include "tools/sim/cycle_rig.hpp"
#include "tools/sim/experiments.hpp"

namespace {

using namespace wheelwright;

// Until the robot is on the figure-8, adapts, and everything that happens now and then has happened.
constexpr int kSettling = 13'000;
constexpr int kStart = 300;  // the drives have been heard, the mode can be asked for

void start_drive(tools::SimulatedHost& host, const sim::World& world) {
    host.external_pose(world.pose());
    protocol::TrajectoryCommand command;
    command.shape = protocol::TrajectoryShape::figure_eight;
    host.trajectory(command);
    host.mode(protocol::Mode::adaptive);
}

void expect_adaptive(const task::Cycle& cycle) {
    if (cycle.supervisor().mode() == protocol::Mode::adaptive && cycle.supervisor().may_drive()) return;
    std::fprintf(stderr, "the robot is not in adaptive mode: nothing was measured\n");
    std::exit(3);
}

bool same(const hal::CanFrame& a, const hal::CanFrame& b) {
    return a.id == b.id && a.length == b.length && a.remote == b.remote && a.extended == b.extended &&
           std::memcmp(a.data.data(), b.data.data(), a.length) == 0;
}

struct Recording {
    std::vector<hal::ReceivedFrame> in;
    std::vector<std::size_t> in_end;  // of each cycle
    std::vector<hal::CanFrame> out;
    std::vector<task::CycleTime> times;
};

class Recorder final : public tools::FrontBus {
  public:
    explicit Recorder(Recording& recording) : recording_(recording) {}
    hal::CanStatus send(const hal::CanFrame& frame) override {
        const hal::CanStatus status = FrontBus::send(frame);
        if (status == hal::CanStatus::ok) recording_.out.push_back(frame);
        return status;
    }
    hal::CanStatus receive(hal::ReceivedFrame& out) override {
        const hal::CanStatus status = FrontBus::receive(out);
        if (status == hal::CanStatus::ok) recording_.in.push_back(out);
        return status;
    }

  private:
    Recording& recording_;
};

// Hands out one cycle's frames, and keeps what is sent.
class Replayer final : public hal::CanBus {
  public:
    explicit Replayer(const Recording& recording) : recording_(recording), out_(recording.out.size() + 64) {}
    void begin(std::size_t cycle) { end_ = recording_.in_end[cycle]; }
    hal::CanStatus send(const hal::CanFrame& frame) override {
        out_[sent_++] = frame;
        return hal::CanStatus::ok;
    }
    bool waits(std::uint32_t) const override { return false; }
    hal::CanStatus receive(hal::ReceivedFrame& out) override {
        if (next_ == end_) return hal::CanStatus::would_block;
        out = recording_.in[next_++];
        return hal::CanStatus::ok;
    }
    bool set_filters(std::span<const hal::CanFilter>) override { return true; }
    hal::CanStatistics statistics() const override { return {}; }

    bool as_recorded() const {
        return sent_ == recording_.out.size() &&
               std::equal(recording_.out.begin(), recording_.out.end(), out_.begin(), same);
    }

  private:
    const Recording& recording_;
    std::vector<hal::CanFrame> out_;
    std::size_t next_ = 0;
    std::size_t end_ = 0;
    std::size_t sent_ = 0;
};

template <typename Part>
void counted(bool each, Part&& part) {
    CALLGRIND_TOGGLE_COLLECT;
    part();
    CALLGRIND_TOGGLE_COLLECT;
    if (each) CALLGRIND_DUMP_STATS;
}

int count_cycles(int cycles, bool each, bool recorded) {
    const tools::ExampleRobots robots = tools::example_robots(true);
    Recording recording;
    Recorder recorder(recording);
    tools::RigOptions options;
    options.world = robots.world;
    options.front = &recorder;
    tools::CycleRig rig(robots.controller, robots.truth, options);
    const auto total = static_cast<std::size_t>(kSettling + cycles);
    for (std::size_t i = 0; i < total; ++i) {
        if (i == kStart) start_drive(rig.host(), rig.world());
        rig.step();
        recording.in_end.push_back(recording.in.size());
        recording.times.push_back(rig.time());
    }
    expect_adaptive(rig.cycle());

    Replayer replayer(recording);
    model::RobotParameters parameters = robots.controller;
    task::SaveMailbox mailbox;
    drivers::DriveSlot left;
    drivers::DriveSlot right;
    const task::CyclePorts ports{replayer, nullptr,
                                 *drivers::make_drive(left, parameters, drivers::Wheel::left),
                                 *drivers::make_drive(right, parameters, drivers::Wheel::right)};
    task::BlackBox box(ports, mailbox);
    task::Cycle cycle(parameters, mailbox, recorded ? box.ports() : ports);
    task::RecordedCycle recorded_cycle(cycle, box);
    if (recorded) box.watch(cycle);
    for (std::size_t i = 0; i < total; ++i) {
        if (i == kSettling) CALLGRIND_START_INSTRUMENTATION;
        const task::CycleTime time = recording.times[i];
        replayer.begin(i);
        const auto run = [&] {
            if (recorded) {
                recorded_cycle.think(time);
                recorded_cycle.send(time.scheduled_ns);
            } else {
                cycle.think(time);
                cycle.send(time.scheduled_ns);
            }
        };
        if (i < kSettling) {
            run();
        } else {
            counted(each, run);
        }
    }
    CALLGRIND_STOP_INSTRUMENTATION;
    if (!replayer.as_recorded()) {
        std::fprintf(stderr, "the replayed cycles sent other frames than the recorded ones\n");
        return 3;
    }
    std::printf("%d cycles, the frames sent as in the recording\n", cycles);
    return 0;
}

int run_simulation(int cycles, bool each, bool by_clock) {
    const tools::ExampleRobots robots = tools::example_robots(true);
    tools::SimulationOptions options;
    options.world = robots.world;
    tools::Simulation sim(robots.controller, robots.truth, options);
    for (int i = 0; i < kSettling; ++i) {
        if (i == kStart) start_drive(sim.host(), sim.world());
        sim.step();
    }
    expect_adaptive(sim.cycle());
    if (by_clock) {
        using Clock = std::chrono::steady_clock;
        const auto begin = Clock::now();
        for (int i = 0; i < cycles; ++i) sim.step();
        const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
        std::printf("%.0f\n", 1e-3 * cycles / seconds);
        return 0;
    }
    CALLGRIND_START_INSTRUMENTATION;
    for (int i = 0; i < cycles; ++i) {
        counted(each, [&] { sim.step(); });
    }
    CALLGRIND_STOP_INSTRUMENTATION;
    expect_adaptive(sim.cycle());
    std::printf("%d cycles\n", cycles);
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 3 || argc > 4) return 1;
    const std::string_view what = argv[1];
    const int cycles = std::atoi(argv[2]);
    const bool each = argc == 4 && std::string_view(argv[3]) == "each";
    if (what == "cycle" || what == "recorded") return count_cycles(cycles, each, what == "recorded");
    if (what == "simulation") return run_simulation(cycles, each, false);
    if (what == "time") return run_simulation(cycles, each, true);
    return 1;
}
