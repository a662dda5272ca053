#include "tools/gap/model/blocks.hpp"

#include <algorithm>
#include <array>

namespace wheelwright::gap {
namespace {

// All of the dictionary's columns but those of the excluded effects; and of these the linear ones.
std::array<std::vector<int>, 2> columns_without(std::span<const std::size_t> excluded,
                                                const Dictionary& dictionary) {
    std::array<std::vector<int>, 2> columns;
    const std::span<const Column> all = dictionary.columns();
    for (std::size_t c = 0; c < all.size(); ++c) {
        const std::size_t effect = all[c].effect;
        if (std::find(excluded.begin(), excluded.end(), effect) != excluded.end()) continue;
        const auto i = static_cast<int>(c);
        columns[0].push_back(i);
        const bool linear = effect < model::kEffectCount && i < dictionary.linear_columns(effect).second;
        if (i < Dictionary::kFirstEffect || linear) columns[1].push_back(i);
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
