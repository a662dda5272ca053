// What `wheelwright gap` answers, asked as a person asks: by its command line, in a process of its own. Known
// of it are gap.json and the robot file that it writes, as documented.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/model/dynamics.hpp"
#include "tools/logs/measured_log.hpp"

namespace wheelwright::bench {

// Samples first .. end - 1 of a log.
struct Piece {
    const tools::MeasuredLog* log = nullptr;
    std::size_t first = 0, end = 0;
};

// The frictions that every robot has, and how the answer holds each.
inline constexpr std::array<std::string_view, 2> kFrictions{"coulomb_friction", "viscous_friction"};
enum class Held { missing, confounded, named };  // confounded: a rival of what was named

struct NamedEffect {
    std::string name;
    std::vector<std::string> rivals;
};

// Twice the logarithm of an effect's likelihood ratio, beside friction and beside all that is named.
struct Tried {
    std::string name;
    double unknowns = 1, beside_friction = 0, beside_found = 0;
};

// A number that the answer gives with an interval: of an effect that is named, or one of K5..K8 (no effect).
struct StatedParameter {
    std::string effect, name;
    double value = 0, low = 0, high = 0;
};

struct GapAnswer {
    std::string refusal;  // why there is no model; else empty
    std::string verdict;
    std::vector<NamedEffect> effects;
    std::vector<StatedParameter> parameters;  // those with an interval
    std::vector<Tried> tried;                 // by builds that say so
    std::vector<std::string> denied;
    // Of a free run over the pieces asked for, rad/s: by the written robot file, forward and over both
    // wheels, and forward as gap.json states it.
    double rms_rad_per_s = std::numeric_limits<double>::infinity();
    double both_wheels_rms_rad_per_s = std::numeric_limits<double>::infinity();
    double stated_rms_rad_per_s = std::numeric_limits<double>::quiet_NaN();

    Held held(std::string_view effect) const;
    bool both_frictions() const;
    std::vector<NamedEffect> others() const;  // no frictions
    std::string names() const;                // "coulomb_friction, viscous_friction (back_emf_limit)"
};

struct GapQuestion {
    std::string program;                // `wheelwright`, of this build or another
    std::vector<std::string> logs;      // learned from
    std::vector<std::string> held_out;  // options that say what is not
    std::vector<std::string> reading;   // options that say how logs are read
    model::Geometry<double> geometry;
    std::string out;  // folder for what it writes
    double time_limit_s = 600;
};

// Whatever the analysis does instead of answering is a refusal. Throws std::runtime_error when the folder
// cannot be made.
GapAnswer ask_gap(const GapQuestion& question, const std::vector<Piece>& held_out);

}  // namespace wheelwright::bench
