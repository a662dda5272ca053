// A tour through everything that a cycle of the firmware can be asked to do: every mode, command, answer,
// fault and reaction. What it has come past is written down, so that a test can demand that nothing was left
// out.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "firmware/supervisor/modes.hpp"

namespace wheelwright::alloc {

struct Tour {
    std::uint64_t cycles = 0;
    std::array<bool, protocol::mode_values.size()> mode{};
    std::array<bool, protocol::fault_values.size()> coasted{};  // faults that were met with torque off,
    std::array<bool, protocol::fault_values.size()> ramped{};   // and those met by braking
    std::array<bool, std::size_t(protocol::blocker_values.back()) + 1> blocker{};
    std::array<bool, protocol::counter_cause_values.size()> counted{};
    std::array<bool, protocol::parameter_result_values.size()> answered{};
    std::array<bool, 32> flag{};     // fields of Status that are yes or no, by number: were yes
    std::array<bool, 0x800> sent{};  // identifiers on the bus, by anybody
    bool identified = false;
    bool adapted = false;
    bool saved = false;
    bool finished = false;

    // What a whole tour must have met and this one has not.
    std::vector<std::string> missing() const;
};

// Called twice in each cycle, with one of its two parts: calls it, under whatever watch.
using Watch = std::function<void(const std::function<void()>& part)>;

// `scene` is told what comes next.
Tour drive_everything(const Watch& watch, const std::function<void(const char*)>& scene);

}  // namespace wheelwright::alloc
