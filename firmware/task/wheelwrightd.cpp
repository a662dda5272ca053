// The firmware as a Linux process: reads the robot file, opens buses and lines, becomes real-time, and runs
// one cycle in each millisecond until it is asked to end.
#include <poll.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/drive_catalogue.hpp"
#include "firmware/task/black_box_writer.hpp"
#include "firmware/task/build_identity.hpp"
#include "firmware/task/bus_plan.hpp"
#include "firmware/task/cycle.hpp"
#include "firmware/task/key_file.hpp"
#include "firmware/task/loop_watch.hpp"
#include "firmware/task/realtime_loop.hpp"
#include "firmware/task/robot_file.hpp"
#include "firmware/task/saver.hpp"
#include "firmware/task/write_file.hpp"
#include "hal/linux/cryptography.hpp"
#include "hal/linux/gpiod_line.hpp"
#include "hal/linux/line_guard.hpp"
#include "hal/linux/monotonic_clock.hpp"
#include "hal/linux/realtime.hpp"
#include "hal/linux/service_manager.hpp"
#include "hal/linux/socketcan_bus.hpp"

namespace {

using namespace wheelwright;

enum ExitStatus : int { kDone = 0, kUsage = 1, kHung = 3, kMachineLacks = 4 };

task::Cycle* running_cycle = nullptr;  // for the signal handler only

void on_signal(int) {
    if (running_cycle != nullptr) running_cycle->request_termination();
}

// They end the firmware in order, and are taken by the cycle's thread alone: asked to, or as a terminal goes.
constexpr std::array kEndingSignals{SIGTERM, SIGINT, SIGHUP, SIGQUIT};

void catch_signals() {
    struct sigaction action {};
    action.sa_handler = &on_signal;
    sigemptyset(&action.sa_mask);
    for (const int signal : kEndingSignals) sigaction(signal, &action, nullptr);
}

// Nobody who reads what we print is worth a robot that stops without its ramp.
void ignore_broken_pipes() {
    struct sigaction action {};
    action.sa_handler = SIG_IGN;
    sigemptyset(&action.sa_mask);
    sigaction(SIGPIPE, &action, nullptr);
}

void block_signals(bool block) {
    sigset_t set;
    sigemptyset(&set);
    for (const int signal : kEndingSignals) sigaddset(&set, signal);
    pthread_sigmask(block ? SIG_BLOCK : SIG_UNBLOCK, &set, nullptr);
}

struct Options {
    std::string config;
    std::string can;
    std::string host_can;
    std::string key;
    std::string black_box;
    double duration_s = 0;
    bool allow_soft_realtime = false;
    bool statistics = false;
};

int fail(int status, const std::string& message) {
    std::fprintf(stderr, "wheelwrightd: %s\n", message.c_str());
    return status;
}

// What every firmware tells in normal service.
constexpr hal::CanFilter kTelemetry{protocol::Status::id, 0x7F0, false};

// Only the drives' frames, our commands, and what another firmware would say reach the cycle.
bool set_filters(hal::CanBus& bus, const model::RobotParameters& parameters, bool drives, bool host) {
    constexpr std::uint32_t kNodeMask = 0x7E0;
    std::array<hal::CanFilter, 4> filters;
    std::size_t count = 0;
    if (drives) {
        filters[count++] = {static_cast<std::uint32_t>(parameters.drive.left.node) << 5, kNodeMask, false};
        filters[count++] = {static_cast<std::uint32_t>(parameters.drive.right.node) << 5, kNodeMask, false};
    }
    if (host) {
        filters[count++] = {protocol::EmergencyStop::id & kNodeMask, kNodeMask, false};
    } else {
        filters[count++] = {protocol::EmergencyStop::id, 0x7FF, false};  // a stop may come from anywhere
    }
    filters[count++] = kTelemetry;
    return bus.set_filters({filters.data(), count});
}

// For how long nobody else's telemetry must be heard before we speak. A dozen frames come in that time, so
// that some may be late, or lost.
constexpr std::int64_t kListen_ns = 2 * std::int64_t{protocol::Status::cycle_time_ms} * 1'000'000;

// Whether a firmware speaks there already: what has come, and comes until then.
bool is_taken(hal::CanBus& bus, hal::Clock& clock, std::int64_t end_ns) {
    hal::ReceivedFrame received;
    for (;;) {
        while (bus.receive(received) == hal::CanStatus::ok) {
            const hal::CanFrame& frame = received.frame;
            if ((frame.id & kTelemetry.mask) == kTelemetry.id && !frame.extended && !frame.remote &&
                !frame.error)
                return true;
        }
        if (clock.now_ns() >= end_ns) return false;
        clock.sleep_until_ns(clock.now_ns() + 1'000'000);
    }
}

using OpenedBus = hal::Result<std::unique_ptr<hal::SocketCanBus>>;

// Hears from here on who speaks there already; what else it shall hear is not known yet.
OpenedBus listen(const std::string& interface) {
    auto bus = hal::SocketCanBus::open(interface);
    if (bus) bus.value()->set_filters({&kTelemetry, 1});
    return bus;
}

std::string taken_text(const std::string& interface) {
    return "another wheelwrightd drives a robot on " + interface +
           " (its telemetry, 0x620 to 0x62F, is heard); end it first, or give this one another interface";
}

void print_duration(const char* name, const task::DurationHistogram& h) {
    const auto us = [](std::int64_t ns) { return 1e-3 * static_cast<double>(ns); };
    std::printf("%-16s median %7.1f   99 %% %7.1f   99.9 %% %7.1f   longest %7.1f us\n", name,
                us(h.quantile_ns(0.5)), us(h.quantile_ns(0.99)), us(h.quantile_ns(0.999)),
                us(h.largest_ns()));
}

void print_histogram(const char* name, const task::DurationHistogram& h) {
    std::printf("%s, cycles per microsecond bin:", name);
    for (std::size_t i = 0; i < task::DurationHistogram::kBins; ++i) {
        if (h.count(i) > 0) std::printf(" %zu:%llu", i, static_cast<unsigned long long>(h.count(i)));
    }
    std::printf("\n");
}

void print_statistics(const task::LoopStatistics& statistics) {
    std::printf("cycles %llu, missed %llu\n", static_cast<unsigned long long>(statistics.cycles.load()),
                static_cast<unsigned long long>(statistics.missed));
    print_duration("wake-up latency", statistics.wake_latency);
    print_duration("execution", statistics.execution);
    print_duration("sending phase", statistics.send_phase);
    print_histogram("wake-up latency", statistics.wake_latency);
    print_histogram("sending phase", statistics.send_phase);
}

// The cycle's thread hangs, maybe inside of its bus or the kernel: nothing that it uses is used here but the
// drives' addresses and the enable line. The process ends without it; a service manager starts it anew.
[[noreturn]] void end_hung(hal::CanBus& bus, const drivers::MotorDrive& left,
                           const drivers::MotorDrive& right, hal::DigitalOutput* enable) {
    constexpr int kTimes = 3;
    constexpr int kTries = 20;  // of a frame that the queue does not take
    constexpr useconds_t kBetween_us = 1000;
    if (enable != nullptr) enable->write(false);
    task::FrameBox<4> idle;
    left.push_idle(idle);
    right.push_idle(idle);
    for (int i = 0; i < kTimes; ++i) {
        for (const hal::CanFrame& frame : idle.frames()) {
            for (int n = 0; n < kTries && bus.send(frame) == hal::CanStatus::would_block; ++n)
                ::usleep(kBetween_us);
        }
        ::usleep(kBetween_us);
    }
    constexpr std::string_view kWords =
        "wheelwrightd: the cycle hangs; the drives are told to be idle, and this ends\n";
    pollfd standard_error{STDERR_FILENO, POLLOUT, 0};
    const bool somebody_reads = ::poll(&standard_error, 1, 0) == 1;
    if (somebody_reads && ::write(STDERR_FILENO, kWords.data(), kWords.size()) < 0) ::_exit(kHung);
    ::_exit(kHung);
}

template <typename Line>
bool take(hal::Result<std::unique_ptr<Line>> result, std::unique_ptr<Line>& line, int& status) {
    if (result) {
        line = std::move(result.value());
        return true;
    }
    status = fail(result.error().exit_status(), result.error().message);
    return false;
}

int open_lines(const task::RobotFile& robot, std::unique_ptr<hal::DigitalInput>& stop_line,
               std::unique_ptr<hal::DigitalOutput>& enable_line) {
    const auto& lines = robot.parameters.lines;
    int status = kDone;
    if (lines.drive_enable >= 0) {
        hal::LineOptions line;
        line.chip = robot.lines_chip;
        line.offset = static_cast<unsigned>(lines.drive_enable);
        line.active_low = lines.drive_enable_active_low;
        if (!take(hal::open_output(line), enable_line, status)) return status;
        if (!hal::guard_line(*enable_line, robot.parameters.realtime.priority)) {
            return fail(kMachineLacks,
                        "no process could be started to take the drive-enable line away when this is killed");
        }
    }
    if (lines.emergency_stop >= 0) {
        hal::LineOptions line;
        line.chip = robot.lines_chip;
        line.offset = static_cast<unsigned>(lines.emergency_stop);
        line.active_low = lines.emergency_stop_active_low;
        // A broken wire reads as stop, where the chip has such a resistor.
        line.bias = line.active_low ? hal::LineBias::pull_down : hal::LineBias::pull_up;
        if (!take(hal::open_input(line), stop_line, status)) return status;
    }
    return status;
}

// The key without which nobody arms the robot, if one is named; it outlives the cycle.
struct InstalledKey {
    std::unique_ptr<hal::MessageCode> code;
    std::unique_ptr<hal::RandomSource> random;
    std::string robot;

    int read(const std::string& path) {
        task::KeyFile file;
        if (const std::string wrong = task::read_key_file(path, file); !wrong.empty()) {
            return fail(kUsage, wrong);
        }
        int status = kDone;
        if (!take(hal::make_aes_cmac(file.key), code, status) || !take(hal::make_random(), random, status)) {
            return status;
        }
        robot = file.robot;
        std::printf("wheelwrightd: arming needs the key of %s (%s)\n", robot.c_str(), path.c_str());
        return kDone;
    }
    task::ArmingKey view() {
        return code ? task::ArmingKey{code.get(), random.get(), robot} : task::ArmingKey{};
    }
};

std::string key_path(const Options& options, const task::RobotFile& robot) {
    if (!options.key.empty() || robot.key_file.empty()) return options.key;
    return std::filesystem::path(options.config).parent_path() / robot.key_file;  // a whole path stays itself
}

// From the cycle's clock to that of candump.
std::int64_t wall_clock_offset_ns() {
    using std::chrono::nanoseconds;
    const auto wall = std::chrono::system_clock::now().time_since_epoch();
    const auto ours = std::chrono::steady_clock::now().time_since_epoch();
    return std::chrono::duration_cast<nanoseconds>(wall).count() -
           std::chrono::duration_cast<nanoseconds>(ours).count();
}

task::BoxAbout about_box(const Options& options, const task::CyclePorts& ports,
                         std::int32_t drive_generation) {
    task::BoxAbout about;
    about.build = task::build_identity();
    about.interface = {options.can, ports.host_bus == nullptr ? "" : options.host_can};
    about.stop_line = ports.emergency_stop != nullptr;
    about.enable_line = ports.drive_enable != nullptr;
    about.drive_generation = drive_generation;
    task::read_whole_file(options.config, about.robot_file);
    return about;
}

int run(const Options& options) {
    ignore_broken_pipes();
    // First, as it takes time, in which the rest is made ready. What is wrong with them is said when it is
    // their turn.
    const bool shared = options.host_can.empty() || options.host_can == options.can;
    auto opened = listen(options.can);
    auto host_opened = shared ? OpenedBus(nullptr) : listen(options.host_can);
    hal::MonotonicClock clock;
    const std::int64_t listened_ns = clock.now_ns() + kListen_ns;

    const task::RobotFileResult file = task::read_robot_file(options.config);
    for (const task::Diagnostic& problem : file.problems) {
        std::fprintf(stderr, "%s\n", task::to_text(problem).c_str());
    }
    if (!file.robot) return kUsage;
    for (const task::Diagnostic& note : file.notes) {
        std::fprintf(stderr, "wheelwrightd: note: %s: %s\n", note.key.c_str(), note.message.c_str());
    }
    model::RobotParameters parameters = file.robot->parameters;
    const std::string refusal = task::bus_refusal(task::bus_plan(parameters), parameters, shared);
    if (!refusal.empty()) return fail(kUsage, refusal);

    InstalledKey key;
    if (const std::string path = key_path(options, *file.robot); !path.empty()) {
        if (const int status = key.read(path); status != kDone) return status;
    }

    // First of all what the machine has: the drives are not enabled from here on, whatever ends this.
    std::unique_ptr<hal::DigitalInput> stop_line;
    std::unique_ptr<hal::DigitalOutput> enable_line;
    if (const int status = open_lines(*file.robot, stop_line, enable_line); status != kDone) return status;

    int status = kDone;
    std::unique_ptr<hal::SocketCanBus> drive_bus;
    std::unique_ptr<hal::SocketCanBus> host_bus;
    if (!take(std::move(opened), drive_bus, status)) return status;
    if (!take(std::move(host_opened), host_bus, status)) return status;
    if (host_bus) set_filters(*host_bus, parameters, false, true);
    set_filters(*drive_bus, parameters, true, shared);
    auto watch_bus = hal::SocketCanBus::open(options.can);  // of its own, for when the cycle hangs
    if (!watch_bus) return fail(watch_bus.error().exit_status(), watch_bus.error().message);
    watch_bus.value()->set_filters({});

    drivers::DriveSlot left_slot;
    drivers::DriveSlot right_slot;
    drivers::MotorDrive* left = drivers::make_drive(left_slot, parameters, drivers::Wheel::left);
    drivers::MotorDrive* right = drivers::make_drive(right_slot, parameters, drivers::Wheel::right);
    if (left == nullptr || right == nullptr) {
        return fail(kUsage, options.config + ": drive.generation: no such motor drive");
    }

    task::SaveMailbox mailbox;
    const task::CyclePorts ports{*drive_bus,      host_bus.get(),    *left,     *right,
                                 stop_line.get(), enable_line.get(), key.view()};
    std::unique_ptr<task::BlackBox> box;
    if (!options.black_box.empty()) {
        const std::string problem = task::BlackBoxWriter::prepare(options.black_box);
        if (!problem.empty()) return fail(kMachineLacks, problem);
        box = std::make_unique<task::BlackBox>(ports, mailbox);
    }
    const auto cycle =
        std::make_unique<task::Cycle>(parameters, mailbox, box == nullptr ? ports : box->ports());
    const auto statistics = std::make_unique<task::LoopStatistics>();

    // All that a cycle touches is there; the threads below need not hold more than they use.
    std::vector<hal::Refusal> refused;
    if (box != nullptr) box->watch(*cycle);
    if (auto unlocked = hal::lock_memory()) refused.push_back(*std::move(unlocked));

    block_signals(true);
    hal::limit_thread_stacks();
    const task::Saver saver(options.config, mailbox);
    std::optional<task::BlackBoxWriter> box_writer;
    std::optional<task::BlackBoxThread> box_thread;
    if (box != nullptr) {
        const auto say = [](const std::string& sentence) {
            std::fprintf(stderr, "wheelwrightd: %s\n", sentence.c_str());
        };
        box_writer.emplace(*box, options.black_box, about_box(options, ports, parameters.drive.generation),
                           say, &wall_clock_offset_ns);
        box_thread.emplace(*box_writer);
    }

    // An adapter that comes back is another interface: whoever keeps this running starts it anew.
    const auto gone = [&] { return drive_bus->gone() || (host_bus && host_bus->gone()); };
    hal::ServiceManager manager;
    std::optional<task::LoopWatch> watch;
    watch.emplace(statistics->cycles,
                  task::LoopWatch::Actions{
                      [&] { hal::set_fifo_priority(std::max(parameters.realtime.priority - 1, 1)); },
                      [&] {
                          manager.alive(clock.now_ns());
                          if (gone()) cycle->request_termination();
                      },
                      [&] { end_hung(*watch_bus.value(), *left, *right, enable_line.get()); }});

    hal::RealtimeOptions realtime;
    realtime.priority = parameters.realtime.priority;
    if (parameters.realtime.cpu >= 0) realtime.cpu = parameters.realtime.cpu;
    realtime.memory = false;
    for (hal::Refusal& one : hal::become_realtime(realtime)) refused.push_back(std::move(one));
    // Punctual without it too, where the machine has no deep idle states.
    if (const auto slow = hal::keep_processors_awake()) {
        std::fprintf(stderr, "wheelwrightd: note: %s\n", slow->sentence().c_str());
    }
    for (const hal::Refusal& one : refused) {
        std::fprintf(stderr, "wheelwrightd: %s\n", one.sentence().c_str());
    }
    if (!refused.empty() && !options.allow_soft_realtime) {
        return fail(
            kMachineLacks,
            "without these the 1 kHz cycle cannot be promised; --allow-soft-realtime runs all the same");
    }

    if (is_taken(*drive_bus, clock, listened_ns)) return fail(kUsage, taken_text(options.can));
    if (host_bus && is_taken(*host_bus, clock, listened_ns))
        return fail(kUsage, taken_text(options.host_can));

    running_cycle = cycle.get();
    catch_signals();
    block_signals(false);
    std::printf("wheelwrightd: running on %s\n", options.can.c_str());
    std::fflush(stdout);
    manager.ready();
    watch->begin();
    const auto cycles = static_cast<std::uint64_t>(options.duration_s / task::kCyclePeriod_s);
    if (box == nullptr) {
        task::run_cycles(*cycle, clock, *statistics, cycles);
    } else {
        task::RecordedCycle recorded(*cycle, *box);
        task::run_cycles(recorded, clock, *statistics, cycles);
    }
    watch.reset();
    manager.stopping();
    running_cycle = nullptr;
    if (options.statistics) print_statistics(*statistics);
    if (gone()) return fail(kMachineLacks, "a CAN interface was removed");
    return kDone;
}

}  // namespace

int main(int argc, char** argv) {
    Options options;
    CLI::App program{"The firmware of a differential-drive robot: drives it over CAN at 1 kHz."};
    program.name("wheelwrightd");
    program.footer(
        "Ends on SIGTERM, SIGHUP, SIGQUIT or Ctrl-C: the robot brakes, the drives go idle.\n"
        "Exit status: 0 done; 1 usage or configuration; 3 the cycle hung, and the drives were told to be "
        "idle; "
        "4 the machine lacks something (no CAN, no permission).");
    program.set_version_flag("--version", "wheelwrightd " + task::build_identity(),
                             "Print version and build, and exit");
    program.add_option("--config", options.config, "Robot file")->required();
    program
        .add_option("--can", options.can, "CAN interface of the drives, and of the host unless --host-can")
        ->required();
    program.add_option("--host-can", options.host_can, "CAN interface of the host, where it is another one");
    program.add_option("--key", options.key,
                       "File of the key without which nobody arms the robot (else arming.key_file)");
    program.add_flag("--allow-soft-realtime", options.allow_soft_realtime,
                     "Run although the machine refuses what real time needs");
    program.add_option("--duration", options.duration_s, "End as on SIGTERM after so many seconds")
        ->check([](const std::string& text) {
            const double value = std::strtod(text.c_str(), nullptr);
            return value > 0 && value <= 1e9 ? "" : "found " + text + ", expected a number greater than 0";
        });
    program.add_option(
        "--black-box", options.black_box,
        "After each fault, write the last half minute to a file in this directory; the newest 8 stay");
    program.add_flag("--statistics", options.statistics,
                     "At the end, print latency, execution time and sending phase of the cycles");
    try {
        program.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        return program.exit(error) == 0 ? kDone : kUsage;
    }
    return run(options);
}
