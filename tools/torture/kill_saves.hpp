// Real processes, killed while they save a robot file.
#pragma once

#include <cstdint>
#include <string>

namespace wheelwright::tools {

struct KillSavesResult {
    std::uint64_t kills = 0;
    std::uint64_t saves_seen = 0;      // kills after which the file was newer than before
    std::uint64_t broken = 0;          // files that were neither the old nor the new one
    std::uint64_t temporary_left = 0;  // files beside it at the end
    std::string problem;               // the first broken file, or why nothing could be done
};

// Saves the file at `path` again and again in child processes, each killed at a random moment. The file must
// exist and be a good robot file; it is changed. Only in a process of one thread.
KillSavesResult kill_saves(const std::string& path, std::uint64_t kills, std::uint64_t seed);

}  // namespace wheelwright::tools
