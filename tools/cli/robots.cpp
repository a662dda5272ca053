#include "tools/cli/robots.hpp"

#include <cstdio>
#include <filesystem>
#include <system_error>
#include <utility>

namespace wheelwright::tools {

std::string example_robot(const std::string& name) {
    std::error_code none;
    const auto program = std::filesystem::read_symlink("/proc/self/exe", none);
    const auto installed = program.parent_path().parent_path() / "share/wheelwright/robots" / name;
    return std::filesystem::exists(installed, none) ? installed.string() : WHEELWRIGHT_ROBOTS "/" + name;
}

std::optional<task::RobotFile> read_robot(const std::string& path) {
    task::RobotFileResult result = task::read_robot_file(path);
    for (const task::Diagnostic& problem : result.problems) {
        std::fprintf(stderr, "%s\n", task::to_text(problem).c_str());
    }
    return std::move(result.robot);
}

}  // namespace wheelwright::tools
