#include "tools/torture/kill_saves.hpp"

#include <sys/wait.h>
#include <unistd.h>
#include <csignal>

#include <algorithm>
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
constexpr double kRatio = 2;             // of the second to the first, in each version of the file
constexpr double kStep = 1.0 / 1024;     // from version to version, exact in binary
constexpr std::uint64_t kMostSaves = 3;  // that a process may finish before it is killed

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

// Tells by a byte that it begins, and each save that is through.
[[noreturn]] void save_for_ever(const std::string& path, std::uint64_t from, int tell) {
    const char byte = 1;
    for (std::uint64_t number = from;; ++number) {
        if (::write(tell, &byte, 1) != 1) ::_exit(1);
        if (!task::save_robot_file(path, version(number)).empty()) ::_exit(1);
    }
}

double now_s() {
    timespec now{};
    ::clock_gettime(CLOCK_MONOTONIC, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace

KillSavesResult kill_saves(const std::string& path, std::uint64_t kills, std::uint64_t seed) {
    KillSavesResult result;
    result.problem = task::save_robot_file(path, version(0));
    if (!result.problem.empty()) return result;
    sim::Random random(seed);
    double last = 1;
    std::uint64_t number = 1;
    double save_s = 0.003;  // that the last one took
    while (result.kills < kills) {
        std::array<int, 2> ready{};
        if (::pipe(ready.data()) != 0) {
            result.problem = "no pipe";
            return result;
        }
        const pid_t child = ::fork();
        if (child == 0) save_for_ever(path, number, ready[1]);
        ::close(ready[1]);
        // Killed within the save that follows so many others.
        const std::uint64_t saves = random.bits() % (kMostSaves + 1);
        bool begun = child > 0;
        double begin_s = now_s();
        for (std::uint64_t i = 0; begun && i <= saves; ++i) {
            char byte = 0;
            begun = ::read(ready[0], &byte, 1) == 1;
            if (i > 0) save_s = now_s() - begin_s;
            begin_s = now_s();
        }
        if (!begun) {
            ::close(ready[0]);
            result.problem = "no child process, or it could not save";
            return result;
        }
        const timespec wait{0, std::min(static_cast<long>(1.2e9 * save_s * random.uniform()), 900'000'000L)};
        ::nanosleep(&wait, nullptr);
        ::kill(child, SIGKILL);
        int status = 0;
        ::waitpid(child, &status, 0);
        ::close(ready[0]);  // not before: a broken pipe would end it between two saves
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
