// The subcommands on a workbench: all of them.
#include <array>

#include "tools/cli/command.hpp"

namespace wheelwright::tools {
namespace {

// The order of --help.
constexpr std::array kCommands{
    &add_demo,     &add_sim,        &add_check,  &add_ctl,      &add_key,     &add_monitor, &add_record,
    &add_replay,   &add_ident,      &add_gap,    &add_free_run, &add_excite,  &add_paper,   &add_gap_bench,
    &add_gap_exam, &add_gap_trials, &add_robots, &add_torture,  &add_latency,
};

}  // namespace

std::span<const AddCommand> commands() { return kCommands; }

}  // namespace wheelwright::tools
