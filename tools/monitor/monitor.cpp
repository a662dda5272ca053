// `wheelwright monitor`: what a robot says, live from a bus or from a log.
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iostream>
#include <memory>

#include "tools/cli/can_port.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/message_text.hpp"
#include "tools/logs/candump.hpp"
#include "tools/monitor/robot_view.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    std::string interface = "can0";
    std::string log;
    std::string json;
    double every_s = 1;
    double for_s = 0;
    bool all = false;
};

constexpr std::int64_t kRedraw_ns = 100'000'000;

std::int64_t nanoseconds(double seconds) { return static_cast<std::int64_t>(seconds * 1e9); }

// Plain lines: each frame with --all, else one when the state changes and one each --every seconds.
class LinePrinter {
  public:
    explicit LinePrinter(const Options& options) : options_(options) {}

    void print(RobotView& view, const hal::CanFrame& frame, std::int64_t time_ns) {
        if (first_ns_ < 0) first_ns_ = time_ns;
        if (options_.all) {
            const auto text = describe(frame);
            if (text.has_value()) {
                std::printf("%10.6f s  %s\n", static_cast<double>(time_ns - first_ns_) * 1e-9,
                            one_line(*text).c_str());
            }
            return;
        }
        const bool changed = view.status_changed();
        if (!view.heard() || (!changed && time_ns < due_ns_)) return;
        std::printf("%s\n", view.line(time_ns).c_str());
        due_ns_ = time_ns + nanoseconds(options_.every_s);
    }

  private:
    const Options& options_;
    std::int64_t first_ns_ = -1;
    std::int64_t due_ns_ = 0;
};

int watch_log(const Options& options) {
    std::ifstream file;
    if (options.log != "-") {
        file.open(options.log);
        if (!file) {
            std::fprintf(stderr, "wheelwright monitor: cannot open %s: %s\n", options.log.c_str(),
                         std::strerror(errno));
            return kBadInput;
        }
    }
    CandumpReader reader(options.log == "-" ? std::cin : file);
    RobotView view;
    LinePrinter printer(options);
    LogFrame entry;
    std::size_t bad = 0;
    std::size_t ours = 0;
    constexpr std::size_t told = 20;
    for (;;) {
        const CandumpReader::Next next = reader.next(entry);
        if (next == CandumpReader::Next::end) break;
        if (next == CandumpReader::Next::bad_line) {
            if (++bad <= told) std::fprintf(stderr, "%s\n", to_text(options.log, reader.problem()).c_str());
            continue;
        }
        if (view.accept(entry.frame, entry.time_ns)) ++ours;
        printer.print(view, entry.frame, entry.time_ns);
    }
    if (bad > told) std::fprintf(stderr, "%s: %zu more bad lines\n", options.log.c_str(), bad - told);
    if (ours == 0) {
        std::fprintf(stderr, "%s: holds no frame of ours\n", options.log.c_str());
        return kBadInput;
    }
    std::putchar('\n');
    Report report("monitor");
    view.fill(report);
    if (!report.publish(options.json)) return kUsage;
    return bad > 0 ? kBadInput : kDone;
}

int watch_bus(const Options& options) {
    int status = kDone;
    const std::unique_ptr<hal::SocketCanBus> bus = open_can(options.interface, status);
    if (bus == nullptr) return status;
    catch_interrupt();
    const bool terminal = ::isatty(STDOUT_FILENO) == 1 && !options.all;
    const std::int64_t end_ns = options.for_s > 0 ? can_now_ns() + nanoseconds(options.for_s) : INT64_MAX;
    RobotView view;
    LinePrinter printer(options);
    std::int64_t redraw_ns = 0;
    while (!interrupted() && can_now_ns() < end_ns) {
        hal::ReceivedFrame received;
        if (receive_until(*bus, received, std::min(end_ns, can_now_ns() + kRedraw_ns))) {
            view.accept(received.frame, received.timestamp_ns);
            if (!terminal) {
                printer.print(view, received.frame, received.timestamp_ns);
                std::fflush(stdout);
            }
        }
        if (terminal && can_now_ns() >= redraw_ns) {
            // home, the text with each line cleared to its end, then the rest of the screen
            std::string screen =
                "wheelwright monitor, " + options.interface + ", Ctrl-C ends\n" + view.screen(can_now_ns());
            for (std::size_t at = 0; (at = screen.find('\n', at)) != std::string::npos; at += 4) {
                screen.insert(at, "\033[K");
            }
            std::printf("\033[H%s\033[J", screen.c_str());
            std::fflush(stdout);
            redraw_ns = can_now_ns() + kRedraw_ns;
        }
    }
    if (!options.json.empty()) {
        Report report("monitor");
        view.fill(report);
        if (!report.publish(options.json)) return kUsage;
    }
    if (!view.heard()) {
        std::fprintf(stderr, "wheelwright monitor: heard no firmware on %s\n", options.interface.c_str());
        return kAimMissed;
    }
    return kDone;
}

}  // namespace

void add_monitor(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command =
        program.add_subcommand("monitor", "Show what a robot says, live or from a log");
    command.footer(
        "On a terminal: a screen that is renewed ten times a second; otherwise a line when the state "
        "changes\n"
        "and each --every seconds. With --log a summary follows.\n"
        "Exit status 2: the log has bad lines or nothing of ours; 3: no firmware was heard.");
    const Option can = command.add_option("--can", options->interface, "CAN interface").show_default();
    command.add_option("--log", options->log, "Read a candump -L log instead, - for standard input")
        .excludes(can);
    command.add_flag("--all", options->all, "Print every message of ours, decoded");
    command.add_option("--every", options->every_s, "Seconds between lines")
        .check(greater_than_zero())
        .show_default();
    command.add_option("--for", options->for_s, "Seconds to watch (default: until Ctrl-C)")
        .check(greater_than_zero());
    command.add_option("--json", options->json, "Write the summary to this file too");
    command.callback([options, &run] {
        run = [options] { return options->log.empty() ? watch_bus(*options) : watch_log(*options); };
    });
}

}  // namespace wheelwright::tools
