#include "tools/torture/kill_saves.hpp"

#include <csignal>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <vector>

#include "firmware/task/robot_file.hpp"
#include "firmware/task/write_file.hpp"
#include "sim_hal/random.hpp"

namespace wheelwright::tools {
namespace {

constexpr const char* kFirst = "dynamics.k7_per_kg_m";
constexpr const char* kSecond = "dynamics.k8_per_kg_m2";
constexpr double kRatio = 2;         // of the second to the first, in each version of the file
constexpr double kStep = 1.0 / 1024;  // from version to version, exact in binary
constexpr double kLongest_s = 0.012;  // until the kill: some saves

std::vector<task::FileChange> version(std::uint64_t number) {
    const double value = 1 + kStep * static_cast<double>(number % 4096);
    return {{kFirst, value}, {kSecond, kRatio * value}};
}

// The file as it is, judged: whole, and both values of one version. `first` is then that version's.
std::string complaint(const std::string& path, double& first) {
    const task::RobotFileResult read = task::read_robot_file(path);
    if (!read.robot) {
        return read.problems.empty() ? "unreadable" : task::to_text(read.problems.front());
    }
    first = read.robot->parameters.dynamics.k7_per_kg_m;
    const double second = read.robot->parameters.dynamics.k8_per_kg_m2;
    if (second != kRatio * first) return std::to_string(first) + " beside " + std::to_string(second);
    return "";
}

[[noreturn]] void save_for_ever(const std::string& path, std::uint64_t from, int ready) {
    const char byte = 1;
    if (::write(ready, &byte, 1) != 1) ::_exit(1);
    for (std::uint64_t number = from;; ++number) {
        if (!task::save_robot_file(path, version(number)).empty()) ::_exit(1);
    }
}

}  // namespace

KillSavesResult kill_saves(const std::string& path, std::uint64_t kills, std::uint64_t seed) {
    KillSavesResult result;
    result.problem = task::save_robot_file(path, version(0));
    if (!result.problem.empty()) return result;
    sim::Random random(seed);
    double last = 1;
    std::uint64_t number = 1;
    while (result.kills < kills) {
        std::array<int, 2> ready{};
        if (::pipe(ready.data()) != 0) {
            result.problem = "no pipe";
            return result;
        }
        const pid_t child = ::fork();
        if (child == 0) save_for_ever(path, number, ready[1]);
        ::close(ready[1]);
        char byte = 0;
        const bool begun = child > 0 && ::read(ready[0], &byte, 1) == 1;
        ::close(ready[0]);
        if (!begun) {
            result.problem = "no child process";
            return result;
        }
        timespec wait{0, static_cast<long>(1e9 * kLongest_s * random.uniform())};
        ::nanosleep(&wait, nullptr);
        ::kill(child, SIGKILL);
        int status = 0;
        ::waitpid(child, &status, 0);
        if (!WIFSIGNALED(status)) {
            result.problem = "the child could not save";
            return result;
        }
        ++result.kills;
        number += 1000;  // no two children write the same
        double first = 0;
        const std::string wrong = complaint(path, first);
        if (!wrong.empty()) {
            ++result.broken;
            if (result.problem.empty()) result.problem = wrong;
            result.problem += "";
            if (!task::save_robot_file(path, version(number)).empty()) return result;
        }
        if (first != last) ++result.saves_seen;
        last = first;
    }
    for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::path(path).parent_path())) {
        if (entry.path() != std::filesystem::path(path)) ++result.temporary_left;
    }
    return result;
}

}  // namespace wheelwright::tools
