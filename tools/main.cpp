// `wheelwright`, the workbench tool: checks robot files, commands and watches robots, keeps logs.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>

#include "tools/cli/command.hpp"

using namespace wheelwright::tools;

int main(int argc, char** argv) {
    try {
        CLI::App program{"Identify, tune and drive differential-drive robots over CAN."};
        program.name("wheelwright");
        program.footer(
            "wheelwright COMMAND --help explains a command.\n"
            "Exit status: 0 done; 1 usage or configuration; 2 unusable input; 3 ran but did not reach its "
            "aim;\n"
            "4 the machine lacks something (no CAN, no permission).");
        program.require_subcommand(1);
        Run run;
        for (const AddCommand add : commands()) add(program, run);
        try {
            program.parse(argc, argv);
        } catch (const CLI::ParseError& error) {
            // 0 for --help, whose text goes to standard output
            return program.exit(error) == 0 ? kDone : kUsage;
        }
        return run ? run() : kUsage;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "wheelwright: %s\n", error.what());
        return kMachineLacks;
    }
}
