// What is known without a search: what the sensors show, what is excluded on request, and what both mean for
// the search and its verdict.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tools/gap/gap_search.hpp"
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
    double large_gap = kLargeGap;    // more left than this is not explained
    bool white_noise = true;         // of the wheel speeds

    // Something is known only so well: less than `large_gap` may be left by that.
    bool roughly() const { return !given.empty() || !white_noise; }
};
Known known_before(const Sensors& sensors, std::span<const std::size_t> excluded, double track_m);

// Adds to what was found what the sensors show, which comes from no search but is as much a part of it, and
// takes unequal radii from the gyro: that tells them better than any acceleration.
void name_what_sensors_show(Search& search, const Sensors& sensors, const Known& known, double track_m);

// A sensor that shows directly an effect that is excluded: nothing else does that, and the
// verdict is `unexplained`.
void judge_by_sensors(Search& search, const Sensors& sensors, std::span<const std::size_t> excluded,
                      double track_m);

}  // namespace wheelwright::gap
