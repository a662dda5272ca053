// The frame of the program `wheelwright`: each subcommand lives in a file of its own and adds itself to the
// command line through one function, listed in commands_workbench.cpp and, if it has its place on a robot's
// computer too, in commands_robot.cpp; the build takes the one or the other.
//
// To add a subcommand: write `void add_<name>(CLI::App& program, Run& run)`, declare it below, add its line
// to kCommands and its files to tools/CMakeLists.txt. The function adds a subcommand with its
// options and a callback that sets `run` to what shall happen; it must not do anything else yet. CLI11 is
// slow to compile: include it in that one file only.
#pragma once

#include <functional>
#include <span>

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11 names it
class App;
}

namespace wheelwright::tools {

// Exit status, the same for every subcommand.
inline constexpr int kDone = 0;
inline constexpr int kUsage = 1;         // usage or configuration, bad robot files included
inline constexpr int kBadInput = 2;      // a log or another input that cannot be used
inline constexpr int kAimMissed = 3;     // ran, but did not reach its aim
inline constexpr int kMachineLacks = 4;  // no CAN, no permission, no room

// What the chosen subcommand does once the command line is understood; returns the exit status.
using Run = std::function<int()>;

using AddCommand = void (*)(CLI::App& program, Run& run);

// The subcommands of this build, in the order of --help.
std::span<const AddCommand> commands();

void add_check(CLI::App& program, Run& run);
void add_ctl(CLI::App& program, Run& run);
void add_demo(CLI::App& program, Run& run);
void add_excite(CLI::App& program, Run& run);
void add_gap(CLI::App& program, Run& run);
void add_gap_trials(CLI::App& program, Run& run);
void add_ident(CLI::App& program, Run& run);
void add_monitor(CLI::App& program, Run& run);
void add_record(CLI::App& program, Run& run);
void add_paper(CLI::App& program, Run& run);
void add_sim(CLI::App& program, Run& run);

}  // namespace wheelwright::tools
