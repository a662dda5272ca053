// `wheelwright replay`: the cycles of a black box again, and whether they do the same.
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>
#include <string>

#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/replay/cycle_replay.hpp"

namespace wheelwright::tools {
namespace {

std::string time_text(std::int64_t time_ns) {
    std::array<char, 40> text{};
    std::snprintf(text.data(), text.size(), "%lld.%06lld", static_cast<long long>(time_ns / 1'000'000'000),
                  static_cast<long long>(time_ns / 1000 % 1'000'000));
    return text.data();
}

// Each change of mode and fault, as recorded.
void print_story(const task::BlackBoxFile& file) {
    std::string before;
    for (std::size_t i = 0; i < file.cycles.size(); ++i) {
        const task::CycleRecord& told = file.cycles[i].told;
        std::string now(protocol::to_string_view(told.state.mode));
        if (told.state.fault != protocol::Fault::none)
            now += ", " + std::string(protocol::to_string_view(told.state.fault));
        if (now != before) {
            std::printf("  %s  cycle %llu  %s\n",
                        time_text(told.time.scheduled_ns + file.about.offset_ns).c_str(),
                        static_cast<unsigned long long>(file.first_cycle + i), now.c_str());
        }
        before = now;
    }
}

int run_replay(const std::string& path) {
    const auto fail = [&path](const std::string& why) {
        std::fprintf(stderr, "wheelwright replay: %s: %s\n", path.c_str(), why.c_str());
        return kBadInput;
    };
    std::ifstream in(path);
    if (!in) return fail(std::strerror(errno));
    task::BlackBoxFile file;
    if (const std::string problem = task::read_black_box(in, file); !problem.empty()) return fail(problem);
    std::printf("%s in cycle %llu, recorded by %s\n", file.fault.c_str(),
                static_cast<unsigned long long>(file.fault_cycle), file.about.build.c_str());
    print_story(file);
    const ReplayResult result = replay(file);
    if (!result.problem.empty()) return fail(result.problem);
    if (result.difference) {
        std::printf("DIFFERS in cycle %llu (%s): %s\n",
                    static_cast<unsigned long long>(result.difference->cycle),
                    time_text(result.difference->time_ns).c_str(), result.difference->what.c_str());
    } else {
        std::printf("%llu cycles, %llu frames in: all %llu frames out and all states as recorded\n",
                    static_cast<unsigned long long>(result.cycles),
                    static_cast<unsigned long long>(result.received),
                    static_cast<unsigned long long>(result.sent));
    }
    if (!file.as_written) std::printf("CHANGED: the file is not as it was written\n");
    return result.difference || !file.as_written ? kAimMissed : kDone;
}

}  // namespace

void add_replay(const CommandLine& program, Run& run) {
    const auto path = std::make_shared<std::string>();
    const CommandLine command = program.add_subcommand("replay", "Run the cycles of a black box again");
    command.footer(
        "Takes a file that wheelwrightd --black-box has written, and hands its frames, times and lines to "
        "the\n"
        "same cycle, from the memory that it had then. Names the first cycle and frame that differs.\n"
        "Exit status 2: no black box, or another build's; 3: something differs, or the file was changed.");
    command.add_option("file", *path, "The black box's file").required();
    command.callback([path, &run] { run = [path] { return run_replay(*path); }; });
}

}  // namespace wheelwright::tools
