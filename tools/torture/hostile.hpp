// Whatever can be on a bus: every identifier with random payloads, remote and extended frames, wrong lengths,
// error frames; on a robot that idles and on one that drives.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace wheelwright::tools {

enum class HostilePlan : std::uint8_t {
    idle_harmless,     // idle; frames of all identifiers but the drives' and the stop: nothing may happen
    driving_harmless,  // the same while driving: nothing may happen
    idle_all,          // all identifiers: the stated faults, no motion to speak of
    driving_all,       // the same while driving: the stated faults, all limits hold
};
inline constexpr std::size_t kHostilePlans = 4;

struct HostileResult {
    HostilePlan plan{};
    std::string setup;
    std::uint64_t frames = 0;
    std::uint64_t valid_commands = 0;  // that random bytes have made: a checksum is right once in 256
    std::map<std::string, std::uint64_t> faults;
    double fastest_rim_m_per_s = 0;
    std::map<std::string, std::uint64_t> broken;  // rules, and how often
    std::vector<std::string> violations;          // the first of each rule
};

// Layout and generation take turns with the seed. Where all identifiers come, the robot is switched on anew
// after each thousand frames: what is latched for good must not hide the rest.
HostileResult be_hostile(HostilePlan plan, std::uint64_t seed, std::uint64_t frames);

// Resident memory of this process; 0 where the system does not tell.
std::uint64_t resident_bytes();

}  // namespace wheelwright::tools
