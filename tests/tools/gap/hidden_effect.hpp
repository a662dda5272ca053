// Logs of a simulated robot that hides an effect, for the tests of the gap analysis. The robot's numbers are
// drawn here and known to nobody else.
#pragma once

#include <cstdint>
#include <string>

#include "firmware/model/effects.hpp"
#include "tools/logs/measured_log.hpp"

namespace wheelwright::test {

struct HiddenEffect {
    std::string name;         // "" for none
    double torque_share = 0;  // RMS of its torque over that of the torque; 0: `parameters` as they are
    model::Parameters<double> parameters{};
};

struct HiddenLog {
    tools::MeasuredLog log;
    model::Geometry<double> geometry;
    model::Parameters<double> parameters{};  // of the hidden effect, as simulated
};

// Driven by random references of speed and yaw rate under a stiff loop, with pseudo-random torque added;
// straight: with the same torque on both wheels.
HiddenLog hidden_log(const HiddenEffect& effect, std::uint64_t seed, double noise_rad_per_s,
                     double duration_s, double rate_Hz, bool straight = false);

void write_csv(const tools::MeasuredLog& log, const std::string& path);

}  // namespace wheelwright::test
