// `wheelwright`, the workbench tool: checks robot files, commands and watches robots, keeps logs.
#include <cstdio>
#include <exception>

#include "firmware/task/build_identity.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"

using namespace wheelwright;
using namespace wheelwright::tools;

int main(int argc, char** argv) {
    try {
        const Program program("wheelwright", "Identify, tune and drive differential-drive robots over CAN.",
                              task::build_identity());
        const CommandLine line = program.line();
        line.footer(
            "wheelwright COMMAND --help explains a command.\n"
            "Exit status: 0 done; 1 usage or configuration; 2 unusable input; 3 ran but did not reach its "
            "aim;\n"
            "4 the machine lacks something (no CAN, no permission).");
        line.require_subcommand();
        Run run;
        for (const AddCommand add : commands()) add(line, run);
        if (const auto over = program.parse(argc, argv)) return *over;
        return run ? run() : kUsage;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "wheelwright: %s\n", error.what());
        return kMachineLacks;
    }
}
