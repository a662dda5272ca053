// The subcommands on a robot's computer: those that do not write pages.
#include <array>

#include "tools/cli/command.hpp"

namespace wheelwright::tools {
namespace {

// The order of --help.
constexpr std::array kCommands{
    &add_sim,    &add_check,  &add_ctl,   &add_key,     &add_monitor,
    &add_record, &add_replay, &add_ident, &add_latency,
};

}  // namespace

std::span<const AddCommand> commands() { return kCommands; }

}  // namespace wheelwright::tools
