// Whether what `detectable` says is true: each effect is put on the robot that was found, at multiples of the
// size that is said to be the smallest that would have been named, and the analysis is asked again.
#pragma once

#include <cstddef>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "tools/cli/progress_line.hpp"
#include "tools/gap/analysis.hpp"

namespace wheelwright::gap {

struct DetectionOptions {
    std::vector<std::string> only;  // effects; empty: all that the log could show
    std::vector<double> factors{0.3, 1, 2};
    std::size_t repeats = 8;  // of each, with the noise from elsewhere
    std::size_t jobs = 1;
    std::function<void(const tools::CampaignProgress&)> progress = [](const auto&) {};
};

// What became of the logs with one effect of one size.
struct Detection {
    std::size_t effect = 0;
    double factor = 0;  // of the detectable size
    std::size_t logs = 0;
    std::size_t named = 0;
    std::size_t confounded = 0;  // not named, but a rival of what is
    std::size_t elsewhere = 0;   // neither, and some other effect is named that was not found at first:
    std::set<std::size_t> instead{};
};

// The motion stays what it was: the robot found, with the effect, is driven by the log's torques and by a
// driver who brings it back to the measured speeds in about a second. What the robot found misses in each
// sample of the log is added, from another time of the log. Throws std::runtime_error.
std::vector<Detection> verify_detection(const Request& request, const Findings& findings,
                                        const DetectionOptions& options);

// A log made so; at `shift` 0 and without effect it is the log itself.
tools::MeasuredLog inject(const tools::MeasuredLog& log, const SimulatedRobot& found,
                          const model::EffectSet<double>& with_effect, std::size_t shift);

}  // namespace wheelwright::gap
