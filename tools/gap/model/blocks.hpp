// The blocks of a log's parts for one dictionary, weighed by the colour of the rest.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "tools/gap/gap_fit.hpp"
#include "tools/gap/model/rows.hpp"

namespace wheelwright::gap {

// Two dozens of blocks where the parts allow it. The dictionary is left to be set.
BlockOptions block_options(std::span<const LogPart> parts, const WheelPair<double>& noise_rad_per_s,
                           double speed_rms_rad_per_s);

struct WeighedBlocks {
    BlockSet set;
    Colour colour;  // that the dictionary's columns leave without those of `excluded` effects
};
WeighedBlocks weighed_blocks(std::span<const LogPart> parts, const BlockOptions& options,
                             std::span<const std::size_t> excluded);

// They point into `set`.
Blocks pointers(const BlockSet& set);

}  // namespace wheelwright::gap
