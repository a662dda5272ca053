#include "tools/cli/run_program.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <thread>

#include "tools/cli/report.hpp"

extern char** environ;

namespace wheelwright::tools {

std::string Ended::abnormal(double time_limit_s) const {
    if (!problem.empty()) return problem;
    if (too_long) return "took longer than " + number_text(time_limit_s) + " s";
    if (WIFSIGNALED(status)) return "ended by signal " + std::to_string(WTERMSIG(status));
    return "";
}

bool Ended::well() const {
    return problem.empty() && !too_long && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

Ended run_program(const std::vector<std::string>& words, const std::string& output, double time_limit_s) {
    using Clock = std::chrono::steady_clock;
    Ended ended;
    posix_spawn_file_actions_t files;
    ::posix_spawn_file_actions_init(&files);
    ::posix_spawn_file_actions_addopen(&files, 0, "/dev/null", O_RDONLY, 0);
    ::posix_spawn_file_actions_addopen(&files, 1, output.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    ::posix_spawn_file_actions_adddup2(&files, 1, 2);
    std::vector<std::string> copies = words;
    std::vector<char*> arguments;
    for (std::string& word : copies) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    posix_spawnattr_t attributes;
    ::posix_spawnattr_init(&attributes);
    ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
    pid_t child = 0;
    const auto begin = Clock::now();
    const int failed =
        ::posix_spawn(&child, words.front().c_str(), &files, &attributes, arguments.data(), environ);
    ::posix_spawnattr_destroy(&attributes);
    ::posix_spawn_file_actions_destroy(&files);
    if (failed != 0) {
        ended.problem = "cannot run " + words.front() + ": " + std::strerror(failed);
        return ended;
    }
    rusage used{};
    for (;;) {
        const pid_t done = ::wait4(child, &ended.status, WNOHANG, &used);
        if (done == child) break;
        if (done < 0 && errno != EINTR) break;
        if (!ended.too_long && std::chrono::duration<double>(Clock::now() - begin).count() > time_limit_s) {
            ended.too_long = true;
            ::kill(child, SIGKILL);
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    ended.seconds = static_cast<double>(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
                    1e-6 * static_cast<double>(used.ru_utime.tv_usec + used.ru_stime.tv_usec);
    ended.memory_bytes = 1024.0 * static_cast<double>(used.ru_maxrss);
    return ended;
}

std::string own_path() { return std::filesystem::read_symlink("/proc/self/exe").string(); }

}  // namespace wheelwright::tools
