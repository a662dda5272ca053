// The frame of the program `wheelwright`: each subcommand lives in a file of its own and adds itself to the
// command line through one function, listed in commands_workbench.cpp and, if it has its place on a robot's
// computer too, in commands_robot.cpp; the build takes the one or the other.
//
// To add a subcommand: write `void add_<name>(const CommandLine& program, Run& run)`, declare it below, add
// its line to kCommands and its files to tools/CMakeLists.txt. The function adds a subcommand with its
// options (command_line.hpp) and a callback that sets `run` to what shall happen; it must not do anything
// else yet.
#pragma once

#include <functional>
#include <span>

namespace wheelwright::tools {

class CommandLine;

// Exit status, the same for every subcommand.
inline constexpr int kDone = 0;
inline constexpr int kUsage = 1;         // usage or configuration, bad robot files included
inline constexpr int kBadInput = 2;      // a log or another input that cannot be used
inline constexpr int kAimMissed = 3;     // ran, but did not reach its aim
inline constexpr int kMachineLacks = 4;  // no CAN, no permission, no room

// What the chosen subcommand does once the command line is understood; returns the exit status.
using Run = std::function<int()>;

using AddCommand = void (*)(const CommandLine& program, Run& run);

// The subcommands of this build, in the order of --help.
std::span<const AddCommand> commands();

void add_check(const CommandLine& program, Run& run);
void add_ctl(const CommandLine& program, Run& run);
void add_key(const CommandLine& program, Run& run);
void add_demo(const CommandLine& program, Run& run);
void add_excite(const CommandLine& program, Run& run);
void add_free_run(const CommandLine& program, Run& run);
void add_gap(const CommandLine& program, Run& run);
void add_gap_bench(const CommandLine& program, Run& run);
void add_gap_exam(const CommandLine& program, Run& run);
void add_gap_trials(const CommandLine& program, Run& run);
void add_ident(const CommandLine& program, Run& run);
void add_latency(const CommandLine& program, Run& run);
void add_monitor(const CommandLine& program, Run& run);
void add_record(const CommandLine& program, Run& run);
void add_paper(const CommandLine& program, Run& run);
void add_replay(const CommandLine& program, Run& run);
void add_robots(const CommandLine& program, Run& run);
void add_sim(const CommandLine& program, Run& run);
void add_torture(const CommandLine& program, Run& run);

}  // namespace wheelwright::tools
