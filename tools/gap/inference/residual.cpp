#include "tools/gap/inference/residual.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

#include "tools/gap/inference/structures.hpp"
#include "tools/gap/model/places.hpp"
#include "tools/gap/model/rows.hpp"

namespace wheelwright::gap {
namespace {

bool is_lag(std::string_view place) { return place == "lag"; }

// Where the members that are not linear are.
Points points_of(const Search& search, const ResidualOptions& options) {
    Points points;
    for (const Candidate& candidate : search.members) {
        if (search.points.contains(candidate.effect))
            points[candidate.effect] = options.found.parameter[candidate.effect];
    }
    for (const auto& [effect, parameters] : options.known.given) points[effect] = parameters;
    return points;
}

// A model with these members, fitted anew.
Fit model_of(std::span<const Candidate> members, const Dictionary& dictionary, const Blocks& blocks,
             bool turning) {
    Members same;
    for (const Candidate& member : members) same.push_back(same_candidate(dictionary, member));
    return fit(blocks, shape_of(same, turning), Spread::none);
}

Place place_of(const Structure& structure, double closable) {
    return {std::string(structure.place), structure.squares / closable};
}

}  // namespace

Residual residual_of(const Search& search, const ResidualOptions& options) {
    const Dictionary dictionary(options.setting, points_of(search, options), false, true);
    BlockOptions block_options = options.blocks;
    block_options.dictionary = &dictionary;
    WeighedBlocks weighed = weighed_blocks(options.training, block_options, options.known.excluded);
    const Blocks blocks = pointers(weighed.set);
    const std::span<const Candidate> members = search.members;
    const auto model = [&](std::size_t count) {
        return model_of(members.first(count), dictionary, blocks, options.turning);
    };
    const std::vector<Aspect> aspects = aspects_of(dictionary);
    const Fit after = model(members.size());
    const Fit base = model(search.base_members);
    const bool nothing_added = members.size() == search.base_members;
    const std::vector<Structure> missing = structures_beside(base, blocks, aspects);
    std::vector<Structure> remaining = nothing_added ? missing : structures_beside(after, blocks, aspects);

    const double explained = base.squares - after.squares;
    double closable = std::max(0.0, explained);
    if (!missing.empty()) closable = std::max(closable, missing.front().squares);
    Residual result{{}, search.conclusion};
    const auto put = [&](const Structure& structure, double of) {
        constexpr double kLeast = 0.02;
        const Place place = place_of(structure, of);
        if (place.explains > kLeast || structure.sure) result.where.push_back(place);
    };
    for (const Structure& m : missing) put(m, closable);
    // columns at other points than the search's may fit worse than none
    if (explained < 0) return result;

    Remainder remainder;
    remainder.explained = std::sqrt(explained / torque_squares(blocks, after));
    if (options.known.roughly()) remainder.roughly = options.known.large_gap;
    const auto lag =
        std::find_if(remaining.begin(), remaining.end(), [](const Structure& s) { return is_lag(s.place); });
    if (lag != remaining.end() && of_interest(*lag, remainder)) {
        // that of the drive's speed loop, which answers to noise, is none
        weigh_where_motion_is_seen(weighed.set, weighed.colour);
        std::vector<Aspect> lags;
        std::copy_if(aspects.begin(), aspects.end(), std::back_inserter(lags),
                     [](const Aspect& a) { return is_lag(a.place); });
        const std::vector<Structure> seen = structures_beside(model(members.size()), blocks, lags);
        if (seen.empty() || !of_interest(seen.front(), remainder)) {
            remaining.erase(lag);
            if (nothing_added) std::erase_if(result.where, [](const Place& p) { return is_lag(p.name); });
        }
    }
    remainder.structures = remaining;
    result.conclusion = conclude(search.conclusion, !search.effects.empty(), remainder);

    if (result.conclusion.verdict != Verdict::unexplained || search.effects.empty() || remaining.empty() ||
        !remaining.front().sure)
        return result;
    // what is left beside what was named comes first
    std::erase_if(result.where, [&](const Place& p) { return p.name == remaining.front().place; });
    put(remaining.front(), std::max(closable, remaining.front().squares));
    std::rotate(result.where.begin(), result.where.end() - 1, result.where.end());
    return result;
}

}  // namespace wheelwright::gap
