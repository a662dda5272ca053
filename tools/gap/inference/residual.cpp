#include "tools/gap/inference/residual.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

#include "tools/gap/inference/structures.hpp"
#include "tools/gap/model/places.hpp"
#include "tools/gap/model/rows.hpp"

namespace wheelwright::gap {
namespace {

std::string percent(double share) {
    std::array<char, 20> text{};
    std::snprintf(text.data(), text.size(), "%.3g %%", 100 * share);
    return text.data();
}

bool is_lag(std::string_view place) { return place == "lag"; }

// Where the members that are not linear are.
Points points_of(const Search& search, const ResidualOptions& options) {
    Points points;
    for (const Way& way : search.members) {
        if (search.points.contains(way.effect)) points[way.effect] = options.found.parameter[way.effect];
    }
    for (const auto& [effect, parameters] : options.known.given) points[effect] = parameters;
    return points;
}

// A member of the model as another dictionary has it, which was made with where the members are.
Way same_way(const Dictionary& dictionary, const Way& way) {
    if (way.kind == Way::Kind::linear) return way;
    const std::span<const Way> all = dictionary.ways(way.effect);
    Way same = all.back();  // the focus
    for (const Way& other : all) {
        if (way.kind == Way::Kind::grid && other.kind == way.kind && other.at == way.at) same = other;
    }
    if (way.amounts.empty()) same.amounts.clear();  // given, and not refitted
    return same;
}

// A model with these members, fitted anew.
Fit model_of(std::span<const Way> members, const Dictionary& dictionary, const Blocks& blocks, bool turning) {
    ModelShape shape{{{{Dictionary::kTiming}}}, {}, turning, {}};
    for (const Way& member : members) {
        const Way way = same_way(dictionary, member);
        shape.amounts.insert(shape.amounts.end(), way.amounts.begin(), way.amounts.end());
        shape.fixed.insert(shape.fixed.end(), way.fixed.begin(), way.fixed.end());
    }
    return fit(blocks, shape, Spread::left_out);
}

// Sure and by enough; beside what a sensor tells only so well, by more. `explained_share` of the torque is
// what the model's effects explain.
bool of_interest(const Structure& left, double explained_share, const Known& known) {
    double least = explained_share > 0 ? kShownBeside : kShown;
    if (known.roughly()) least = known.large_gap;
    return left.sure && left.torque_share >= least &&
           left.torque_share >= kShareShownBeside * std::hypot(explained_share, left.torque_share);
}

Place place_of(const Structure& structure, double closable) {
    return {std::string(structure.place), structure.squares / closable};
}

void judge(Search& search, const std::vector<Structure>& left, double explained_share, const Known& known) {
    if (search.verdict == Verdict::unexplained) return;
    const auto found = std::find_if(
        left.begin(), left.end(), [&](const Structure& l) { return of_interest(l, explained_share, known); });
    if (found == left.end()) return;
    search.verdict = Verdict::unexplained;
    search.reason = (search.effects.empty()
                         ? "no effect that was looked for explains what depends on the "
                         : "beside what the effects found explain, something is left that depends on the ") +
                    std::string(found->place) + ": " + percent(found->torque_share) + " of the torque";
}

}  // namespace

void judge_residual(Search& search, const ResidualOptions& options) {
    const Dictionary dictionary(options.setting, points_of(search, options), false, true);
    BlockOptions block_options = options.blocks;
    block_options.dictionary = &dictionary;
    WeighedBlocks weighed = weighed_blocks(options.training, block_options, options.known.excluded);
    const Blocks blocks = pointers(weighed.set);
    const std::span<const Way> members = search.members;
    const auto model = [&](std::size_t count) {
        return model_of(members.first(count), dictionary, blocks, options.turning);
    };
    const std::vector<Aspect> aspects = aspects_of(dictionary);
    const Fit after = model(members.size());
    const Fit base = model(search.base_members);
    const bool nothing_added = members.size() == search.base_members;
    const std::vector<Structure> missing = structures_beside(base, blocks, aspects);
    std::vector<Structure> left = nothing_added ? missing : structures_beside(after, blocks, aspects);

    const double explained = base.squares - after.squares;
    double closable = std::max(0.0, explained);
    if (!missing.empty()) closable = std::max(closable, missing.front().squares);
    const auto put = [&](const Structure& structure, double of) {
        constexpr double kLeast = 0.02;
        const Place place = place_of(structure, of);
        if (place.explains > kLeast || structure.sure) search.where.push_back(place);
    };
    search.where.clear();
    for (const Structure& m : missing) put(m, closable);
    // columns at other points than the search's may fit worse than none
    if (explained < 0) return;

    const double explained_share = std::sqrt(explained / torque_squares(blocks, after));
    const auto lag =
        std::find_if(left.begin(), left.end(), [](const Structure& s) { return is_lag(s.place); });
    if (lag != left.end() && of_interest(*lag, explained_share, options.known)) {
        // that of the drive's speed loop, which answers to noise, is none
        weigh_where_motion_is_seen(weighed.set, weighed.colour);
        std::vector<Aspect> lags;
        std::copy_if(aspects.begin(), aspects.end(), std::back_inserter(lags),
                     [](const Aspect& a) { return is_lag(a.place); });
        const std::vector<Structure> seen = structures_beside(model(members.size()), blocks, lags);
        if (seen.empty() || !of_interest(seen.front(), explained_share, options.known)) {
            left.erase(lag);
            if (nothing_added) std::erase_if(search.where, [](const Place& p) { return is_lag(p.name); });
        }
    }
    judge(search, left, explained_share, options.known);

    if (search.verdict != Verdict::unexplained || search.effects.empty() || left.empty() ||
        !left.front().sure)
        return;
    // what is left beside what was named comes first
    std::erase_if(search.where, [&](const Place& p) { return p.name == left.front().place; });
    put(left.front(), std::max(closable, left.front().squares));
    std::rotate(search.where.begin(), search.where.end() - 1, search.where.end());
}

}  // namespace wheelwright::gap
