#include "tools/latency/measure.hpp"

#include <cmath>
#include <fstream>
#include <iterator>
#include <memory>
#include <sstream>
#include <thread>

#include "firmware/task/realtime_loop.hpp"
#include "hal/linux/monotonic_clock.hpp"
#include "tools/cli/run_program.hpp"
#include "tools/cli/scratch_folder.hpp"
#include "tools/sim/cycle_rig.hpp"

namespace wheelwright::tools {
namespace {

// Until the robot is on the figure-8 and adapts.
constexpr int kStart = 300;
constexpr int kSettling = 13'000;

// What task::run_cycles runs: the rig's firmware at the times of the real clock, and the rig's robot between.
class Workload {
  public:
    Workload(CycleRig& rig, hal::Clock& clock, std::int64_t send_phase_ns, Latency& result)
        : rig_(rig), clock_(clock), send_phase_ns_(send_phase_ns), result_(result) {
        rig_.wake();
    }

    void think(const task::CycleTime& time) {
        const std::int64_t begin_ns = clock_.now_ns();
        rig_.think();
        const std::int64_t end_ns = clock_.now_ns();
        thinking_ns_ = end_ns - begin_ns;
        due_ns_ = time.scheduled_ns + send_phase_ns_;
        if (end_ns > due_ns_) ++result_.late;
        rig_.wait_for_sending();
    }
    std::int64_t send_phase_ns() const { return send_phase_ns_; }
    void send(std::int64_t now_ns) {
        const std::int64_t begin_ns = clock_.now_ns();
        rig_.send();
        result_.cycle.add(thinking_ns_ + clock_.now_ns() - begin_ns);
        result_.sending.add(now_ns - due_ns_);
        rig_.wake();
    }
    bool finished() const { return finished_; }
    void request_termination() { finished_ = true; }

  private:
    CycleRig& rig_;
    hal::Clock& clock_;
    std::int64_t send_phase_ns_;
    Latency& result_;
    std::int64_t thinking_ns_ = 0;
    std::int64_t due_ns_ = 0;
    bool finished_ = false;
};

void drive_figure_eight(CycleRig& rig) {
    for (int i = 0; i < kStart; ++i) rig.step();
    rig.host().external_pose(rig.world().pose());
    protocol::TrajectoryCommand command;
    command.shape = protocol::TrajectoryShape::figure_eight;
    rig.host().trajectory(command);
    rig.host().mode(protocol::Mode::adaptive);
    for (int i = 0; i < kSettling; ++i) rig.step();
}

// Beside the loop, for as long: 1 kHz at the loop's priority, by whatever scheduling the loop has.
class Cyclictest {
  public:
    Cyclictest(const LatencyOptions& options, bool realtime) {
        if (options.cyclictest.empty()) return;
        const auto whole_s = static_cast<long>(std::ceil(options.duration_s));
        std::vector<std::string> words{options.cyclictest, "-m",     "-q",
                                       "-i1000",           "-h1024", "-D" + std::to_string(whole_s)};
        words.push_back(realtime ? "-p" + std::to_string(options.realtime.priority) : "--policy=other");
        if (options.realtime.cpu) words.push_back("-a" + std::to_string(*options.realtime.cpu));
        thread_ = std::thread([this, words, limit_s = 2 * options.duration_s + 10] {
            ended_ = run_program(words, output(), limit_s);
        });
    }
    ~Cyclictest() {
        if (thread_.joinable()) thread_.join();
    }
    Cyclictest(const Cyclictest&) = delete;
    Cyclictest& operator=(const Cyclictest&) = delete;

    void end(Latency& result) {
        if (!thread_.joinable()) {
            result.no_cyclictest = "cyclictest is not installed: apt-get install rt-tests";
            return;
        }
        thread_.join();
        std::ifstream file(output());
        const std::string text{std::istreambuf_iterator<char>(file), {}};
        if (ended_.well()) result.cyclictest = read_cyclictest(text);
        if (!result.cyclictest) result.no_cyclictest = "cyclictest said: " + text.substr(0, text.find('\n'));
    }

  private:
    std::string output() const { return folder_.path() + "/cyclictest"; }
    ScratchFolder folder_;
    Ended ended_;
    std::thread thread_;
};

}  // namespace

Latency measure_latency(const LatencyOptions& options) {
    const ExampleRobots robots = example_robots(true);
    RigOptions rig_options;
    rig_options.world = robots.world;
    const auto rig = std::make_unique<CycleRig>(robots.controller, robots.truth, rig_options);
    drive_figure_eight(*rig);

    const auto result = std::make_unique<Latency>();
    const auto statistics = std::make_unique<task::LoopStatistics>();
    hal::MonotonicClock clock;
    Workload workload(*rig, clock, std::llround(options.send_phase_s * 1e9), *result);
    bool realtime = false;  // asked by a thread that ends: who waits for cyclictest shall not have it
    std::thread([&] { realtime = !hal::set_fifo_priority(options.realtime.priority); }).join();
    Cyclictest beside(options, realtime);
    result->refused = hal::become_realtime(options.realtime);
    if (auto refusal = hal::keep_processors_awake()) result->refused.push_back(*std::move(refusal));
    const auto cycles = static_cast<std::uint64_t>(std::llround(options.duration_s * 1000));
    task::run_cycles(workload, clock, *statistics, cycles);
    beside.end(*result);
    result->wake_up = statistics->wake_latency;
    result->cycles = statistics->cycles;
    result->missed = statistics->missed;
    return *result;
}

std::optional<task::DurationHistogram> read_cyclictest(const std::string& output) {
    task::DurationHistogram histogram;
    std::istringstream in(output);
    std::string line;
    std::int64_t longest_us = 0;
    while (std::getline(in, line)) {
        std::istringstream words(line);
        std::int64_t us = 0;
        std::uint64_t count = 0;
        std::string hash;
        std::string name;
        std::string unit;
        if (line.rfind("# Max Latencies:", 0) == 0) {
            words >> hash >> name >> unit >> longest_us;
        } else if (line.rfind("# Histogram Overflows:", 0) == 0) {  // behind the longest, and beyond the bins
            words >> hash >> name >> unit >> count;
            us = longest_us;
        } else {
            words >> us >> count;
        }
        if (!words) count = 0;
        for (; count > 0; --count) histogram.add(us * 1000);
    }
    return histogram.total() > 0 ? std::optional(histogram) : std::nullopt;
}

Fitness fitness(const Latency& latency) {
    if (latency.missed > 0) return Fitness::unfit;
    return latency.sending.quantile_ns(0.999) <= task::kCyclePeriod_ns / 20 ? Fitness::fit : Fitness::limited;
}

}  // namespace wheelwright::tools
