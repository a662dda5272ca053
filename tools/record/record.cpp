// `wheelwright record`: what was on the bus, as candump -L writes it, with the kernel's times.
#include <cstdio>
#include <cstring>
#include <memory>

#include "tools/cli/can_port.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/logs/candump.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    std::string interface = "can0";
    std::string out;
    double for_s = 0;
};

// Frames of a full bus come every 0.1 ms, and the kernel keeps a thousand for us.
constexpr std::int64_t kNap_ns = 10'000'000;

struct CloseFile {
    void operator()(std::FILE* file) const {
        if (file != stdout) std::fclose(file);
    }
};

int record(const Options& options) {
    int status = kDone;
    const std::unique_ptr<hal::SocketCanBus> bus = open_can(options.interface, status);
    if (bus == nullptr) return status;
    const std::unique_ptr<std::FILE, CloseFile> file(
        options.out == "-" ? stdout : std::fopen(options.out.c_str(), "wxe"));
    if (file == nullptr) {
        std::fprintf(stderr, "wheelwright record: cannot make %s: %s%s\n", options.out.c_str(),
                     std::strerror(errno), errno == EEXIST ? "; a log is never overwritten" : "");
        return errno == EEXIST ? kUsage : kMachineLacks;
    }
    catch_interrupt();
    const std::int64_t offset_ns = wall_clock_offset_ns();
    const std::int64_t begin_ns = can_now_ns();
    const std::int64_t end_ns =
        options.for_s > 0 ? begin_ns + static_cast<std::int64_t>(options.for_s * 1e9) : INT64_MAX;
    LogFrame entry;
    entry.interface = options.interface;
    std::uint64_t frames = 0;
    bool written = true;
    while (written && !interrupted() && can_now_ns() < end_ns) {
        hal::ReceivedFrame received;
        const std::int64_t flush_ns = std::min(end_ns, can_now_ns() + 500'000'000);
        if (!receive_until(*bus, received, flush_ns)) {
            written = std::fflush(file.get()) == 0;
            continue;
        }
        do {
            entry.time_ns = received.timestamp_ns + offset_ns;
            entry.frame = received.frame;
            entry.fd_flags = received.frame.bit_rate_switch ? 1 : 0;
            const std::string line = format_candump_line(entry) + "\n";
            written = std::fwrite(line.data(), 1, line.size(), file.get()) == line.size();
            ++frames;
        } while (written && received.timestamp_ns < end_ns && bus->receive(received) == hal::CanStatus::ok);
        // The kernel keeps time and frames meanwhile: to wake for each would cost more than to write it.
        sleep_until(std::min(end_ns, can_now_ns() + kNap_ns));
    }
    written = std::fflush(file.get()) == 0 && written;
    const hal::CanStatistics statistics = bus->statistics();
    std::fprintf(stderr, "%llu frames in %.1f s", static_cast<unsigned long long>(frames),
                 static_cast<double>(can_now_ns() - begin_ns) * 1e-9);
    if (statistics.receive_overflow > 0) {
        std::fprintf(stderr, "; %llu lost, as the machine was too slow",
                     static_cast<unsigned long long>(statistics.receive_overflow));
    }
    std::fputc('\n', stderr);
    if (!written) {
        std::fprintf(stderr, "wheelwright record: cannot write %s: %s\n", options.out.c_str(),
                     std::strerror(errno));
        return kMachineLacks;
    }
    return statistics.receive_overflow > 0 ? kAimMissed : kDone;
}

}  // namespace

void add_record(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command = program.add_subcommand("record", "Record a bus into a log");
    command.footer(
        "Writes candump -L lines with the kernel's receive times until Ctrl-C or --for. An existing file is\n"
        "not overwritten. Exit status 3: frames were lost on the way.");
    command.add_option("--can", options->interface, "CAN interface").show_default();
    command.add_option("--out", options->out, "File to write, - for standard output").required();
    command.add_option("--for", options->for_s, "Seconds to record (default: until Ctrl-C)")
        .check(greater_than_zero());
    command.callback([options, &run] { run = [options] { return record(*options); }; });
}

}  // namespace wheelwright::tools
