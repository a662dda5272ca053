#include "tools/cli/example_robots.hpp"

#include <filesystem>
#include <system_error>

namespace wheelwright::tools {

std::string example_robot(const std::string& name) {
    std::error_code none;
    const auto program = std::filesystem::read_symlink("/proc/self/exe", none);
    const auto installed = program.parent_path().parent_path() / "share/wheelwright/robots" / name;
    return std::filesystem::exists(installed, none) ? installed.string() : WHEELWRIGHT_ROBOTS "/" + name;
}

}  // namespace wheelwright::tools
