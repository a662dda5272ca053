#include "tools/gap/gap_blocks.hpp"

#include <algorithm>

namespace wheelwright::gap {
namespace {

std::vector<int> columns_without(std::span<const std::size_t> effects, const Dictionary& dictionary) {
    std::vector<int> columns;
    const std::span<const Column> all = dictionary.columns();
    for (std::size_t c = 0; c < all.size(); ++c) {
        if (std::find(effects.begin(), effects.end(), all[c].effect) == effects.end())
            columns.push_back(static_cast<int>(c));
    }
    return columns;
}

}  // namespace

BlockOptions block_options(std::span<const LogPart> parts, const WheelPair<double>& noise_rad_per_s,
                           double speed_rms_rad_per_s) {
    BlockOptions options;
    options.noise_rad_per_s = noise_rad_per_s;
    options.speed_rms_rad_per_s = speed_rms_rad_per_s;
    double total_s = 0;
    for (const LogPart& part : parts) total_s += part.log->period_s * double(part.end - part.first);
    options.block_s = std::clamp(total_s / 24, 0.5, 2.0);
    return options;
}

WeighedBlocks weighed_blocks(std::span<const LogPart> parts, const BlockOptions& options,
                             std::span<const std::size_t> excluded) {
    WeighedBlocks blocks;
    blocks.set = make_blocks(parts, options);
    blocks.colour = colour_of_rest(blocks.set, columns_without(excluded, *options.dictionary));
    weigh(blocks.set, blocks.colour);
    return blocks;
}

Blocks pointers(const BlockSet& set) {
    Blocks blocks;
    for (const Block& b : set.blocks) blocks.push_back(&b);
    return blocks;
}

}  // namespace wheelwright::gap
