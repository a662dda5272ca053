// Runs the cycles of a black box's file again, on the same core, and compares what they send and decide with
// what was recorded, byte by byte.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "firmware/task/black_box_file.hpp"

namespace wheelwright::tools {

struct ReplayDifference {
    std::uint64_t cycle = 0;
    std::int64_t time_ns = 0;  // when it was due, as in the log's lines
    std::string what;          // "frame 2: recorded can0 04E#..., replayed can0 04E#..."
};

struct ReplayResult {
    std::string problem;  // why it cannot be replayed; else ""
    std::uint64_t cycles = 0, received = 0, sent = 0;
    std::optional<ReplayDifference> difference;  // the first; nothing is replayed behind it
};

// The file must be of this build: its memory is that of this build's objects.
ReplayResult replay(const task::BlackBoxFile& file);

}  // namespace wheelwright::tools
