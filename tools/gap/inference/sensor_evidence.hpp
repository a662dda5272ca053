// What is known without a search: what the sensors show, what is excluded on request, and what both mean for
// the search and for what is said.
#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tools/gap/inference/search.hpp"
#include "tools/gap/logs/sensors.hpp"
#include "tools/logs/measured_log.hpp"

namespace wheelwright::gap {

// For the search and for what is said of its residual.
struct Known {
    Points given;                       // effects that a sensor shows, and that are not refitted
    std::vector<std::size_t> excluded;  // are not there
    // No free run gets better with them: they are not named, but may be what a like one that is named stands
    // for.
    std::vector<std::size_t> rivals_only;
    std::vector<std::size_t> shown;  // are there: a sensor shows it, and the rows are to tell how they act
    double large_gap = kPolicy.gap;  // more left than this is not explained
    bool white_noise = true;         // of the wheel speeds
    // The latest that a gyro lets the wheel speeds be reported, where it does not show how late they are.
    double most_report_lag_s = std::numeric_limits<double>::infinity();

    // Something is known only so well: less than `large_gap` may be left by that.
    bool roughly() const { return !given.empty() || !white_noise; }
};
Known known_before(const Sensors& sensors, std::span<const std::size_t> excluded, double track_m);

// What was found, with unequal radii by the gyro, which tells them better than any acceleration, and with
// what sensors show, which comes from no search but is as much a part of it: `shown` says whether there is
// such. What is excluded and yet shown is `denied`.
struct BesideSensors {
    std::vector<NamedEffect> effects;
    bool shown = false;
    struct Denied {
        std::string place, what;  // where it shows, and what the gyro shows
    };
    std::vector<Denied> denied;  // the last one first
};
BesideSensors beside_sensors(std::vector<NamedEffect> found, const Sensors& sensors, const Known& known,
                             std::span<const std::size_t> excluded, double track_m);

}  // namespace wheelwright::gap
