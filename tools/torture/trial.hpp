// One fault at one moment of one robot's drive, judged by the simulated robot's truth: its speed, its place
// and the torque that its drives' motors are told. The firmware's own state is looked at for one thing: which
// fault and mode it says there are.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/torture/kinds.hpp"

namespace wheelwright::tools {

// The same drive without a fault, from the moment of the injection on, a sample in each millisecond.
struct UntouchedDrive {
    SceneSetup setup;
    std::string problem;  // why it could not be driven; else empty
    std::vector<Pose<double>> pose;
    std::vector<double> fastest_rim_m_per_s;  // so far
    protocol::Mode mode_at_end = protocol::Mode::idle;
};
UntouchedDrive untouched_drive(std::uint64_t seed, TorturedRobots robots, int report_period_ms = 1);

struct TortureResult {
    std::string_view kind;
    std::uint64_t seed = 0;
    std::string setup;
    bool stopped = false;  // a fault was latched, or the drive ended otherwise than untouched
    std::string fault;     // as the firmware names it
    // When the torque is seen to be gone for good, from where the bound counts and without the drive's own
    // latency; if it stopped.
    double zero_s = 0;
    double bound_s = 0;          // 0: none is stated
    double quicker_m_per_s = 0;  // of a rim, than in the untouched drive
    double deviation_m = 0;      // if it did not stop
    std::vector<std::string> violations;
    std::uint64_t bytes =
        0;  // a checksum of all frames on the drives' bus with their times, and the last pose
    std::vector<std::string> story;  // one line for each change
};
TortureResult torture(const TortureKind& kind, const UntouchedDrive& untouched,
                      const SceneRecords& records = {});

}  // namespace wheelwright::tools
