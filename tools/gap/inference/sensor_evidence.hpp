// What is known without a search: what the sensors tell by themselves, what who asks has left out, and what
// both mean for the search and its verdict.
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

// What the sensors tell. `left_out`: effects that who asks knows not to be there.
struct Told {
    std::optional<Sensors::Gyro> gyro;  // where the robot turns
    std::vector<SensorEffect> effects;  // none that is left out
    double unknown_step_rad_per_s = 0;
    bool late_report = false;  // of the wheel speeds: the gyro says so, and it is left out
};
Told told_by_sensors(const std::vector<tools::MeasuredLog>& logs, const model::Geometry<double>& geometry,
                     bool turning, std::span<const std::size_t> left_out);

// Why the wheels' speeds cannot be what they are said to be, as the gyro has it: sides or units.
std::optional<std::string> wrong_beside_gyro(const Sensors::Gyro& gyro);

// For the search and for the look at what it leaves.
struct Known {
    Points given;                       // effects that a sensor tells, and that are not refitted
    std::vector<std::size_t> excluded;  // are not there
    // No free run gets better with them: they are not named, but may be what a like one that is named stands
    // for.
    std::vector<std::size_t> rivals_only;
    double large_gap = kLargeGap;  // more left than this is not explained
    bool white_noise = true;       // of the wheel speeds

    // Something is told only so well: less than `large_gap` may be left by that.
    bool roughly() const { return !given.empty() || !white_noise; }
};
Known known_before(const Told& told, std::span<const std::size_t> left_out, double track_m);

// Adds to what was found what the sensors show, which comes from no search but is as much a part of it, and
// takes unequal radii from the gyro: that tells them better than any acceleration.
void name_what_sensors_show(Search& search, const Told& told, const Known& known, double track_m);

// A sensor that shows directly what the search was told not to look for: nothing else does that, and the
// verdict is `unexplained`.
void judge_by_sensors(Search& search, const Told& told, std::span<const std::size_t> left_out,
                      double track_m);

}  // namespace wheelwright::gap
