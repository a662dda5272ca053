// Running another program: for commands whose trials are processes of their own.
#pragma once

#include <string>
#include <vector>

namespace wheelwright::tools {

struct Ended {
    int status = 0;  // as of waitpid
    bool too_long = false;
    double seconds = 0;  // of processors
    double memory_bytes = 0;
    std::string problem;  // it did not even start

    // "" for a program that ended by itself with an exit status; else one sentence.
    std::string abnormal(double time_limit_s) const;
    bool well() const;  // exit status 0
};

// Runs words[0], a path, with its output in a file, in a process group of its own: Ctrl-C ends the campaign
// after the trial, not the trial.
Ended run_program(const std::vector<std::string>& words, const std::string& output, double time_limit_s);

// The running program's own path.
std::string own_path();

}  // namespace wheelwright::tools
