// What an analysis says of effects: those that it names with their rivals, and those that it does not.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "tools/gap/inference/estimates.hpp"

namespace wheelwright::excite {
struct Motion;
}

namespace wheelwright::gap {

struct Rival {
    std::size_t effect = 0;
    bool confounded = false;  // no motion in this log tells them apart
    bool richer = false;      // has more to choose, and is not surely better for it: the simpler one is named
    bool coarse = false;      // judged at its starting points only, and may do better between them
    double keeps = 0;         // share of the gain that it keeps in the winner's place
    std::string_view measurement;  // that would tell it, where no motion does; empty: none is known
    // Driven with this size it tells them apart best (motions.hpp); null: none is known.
    const excite::Motion* motion = nullptr;
    double motion_size_Nm = 0;
};

struct NamedEffect {
    std::size_t effect = 0;
    std::vector<ParameterEstimate> parameters;  // the catalogue's
    double closes = 0;                          // share of the closable gap
    double torque_share = 0;                    // RMS of its torque over RMS of the commanded
    double probability = 1;                     // that nothing is there, by the held-out blocks
    // By parameter, the standard error of what the fit does not move: the difference that one amount for both
    // wheels hides, the time of an event.
    std::vector<double> unmoved;
    std::vector<Rival> rivals;
    std::vector<Rival> ruled_out;  // that did worse in its place
    bool in_file = true;           // false: its law is another than the catalogue's
};

struct Place {
    std::string name;
    double explains = 0;  // share of what is missing beside the base
};

struct Detectable {
    std::size_t effect = 0;
    std::vector<double> size;  // by parameter; infinite: not in this log
    // The effect at so many times that size; each coordinate that the log shows by itself.
    std::function<std::vector<model::Parameters<double>>(double factor)> parameters;
};

// An effect at the best of its points, in all pieces, whether it is named or not: twice the logarithm of the
// likelihood ratio, which is as large as `unknowns` by chance if every row is one by itself.
struct Tried {
    std::size_t effect = 0, unknowns = 0;
    double beside_friction = 0;  // found
    double beside_found = 0;     // beside all that was found
};

}  // namespace wheelwright::gap
