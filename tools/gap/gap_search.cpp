#include "tools/gap/gap_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <tuple>

#include "tools/gap/gap_statistics.hpp"

namespace wheelwright::gap {
namespace {

constexpr Eigen::Index kFirstAmount = 4;
constexpr double kApart = 4;           // standard errors of the difference between left and right
constexpr double kCloser = 0.98;       // a grid's point must be better than a closer look by more than this
constexpr double kSuperfluous = 0.05;  // probability of what goes again that was accepted once
constexpr double kActs = 0.02;  // power of an effect's columns in a block over that in the block with most
constexpr std::size_t kFewestActing = 5;
constexpr std::size_t kFewestParting = 8;  // blocks: fewer would have to agree in all their ranks
constexpr double kToldApart = 0.0027;      // probability of three standard errors
constexpr double kNoBetter = 1.005;  // share of the gain, kept by a rival with more unknowns, that is chance
constexpr double kTrifle = 0.01;     // share of what is left, by which a model must be better to be so
constexpr double kUnexcited = 1e-4;  // power of a coordinate's column over that of the effect's strongest

// Left and right of one kind, which are equal unless shown unequal: not those
// that may have either sign, but where nothing turns.
bool is_pair(std::size_t effect) {
    const auto& p = model::kEffects[effect].parameters;
    return p.size() == 2 && p[0].name.starts_with("left") && p[1].name.starts_with("right");
}

using Members = std::vector<Way>;

Members with(Members members, const Way& way) {
    members.push_back(way);
    return members;
}
Members without(Members members, std::size_t i) {
    members.erase(members.begin() + static_cast<std::ptrdiff_t>(i));
    return members;
}
bool contains(const Members& members, std::size_t effect) {
    return std::any_of(members.begin(), members.end(), [&](const Way& m) { return m.effect == effect; });
}

class Searcher {
  public:
    Searcher(const BlockSet& train, const std::vector<Block>& report, const SearchOptions& options)
        : set_(train), options_(options), dictionary_(*options.dictionary) {
        for (const Block& b : train.blocks) all_.push_back(&b);
        for (const Block& b : report) report_.push_back(&b);
        // every fourth confirms; with few blocks the last one
        for (std::size_t i = 0; i < all_.size(); ++i) (i % 4 == 2 ? confirm_ : select_).push_back(all_[i]);
        for (std::size_t i = 0; i < model::kEffectCount; ++i) {
            if (!options.base.active[i] && !options.given.contains(i)) continue;
            const std::vector<Way> all = ways(i);
            if (all.empty()) continue;
            members_.push_back(all.back());  // a focus is the last
            if (!options.given.contains(i)) continue;
            members_.back().amounts.clear();
            members_.back().free.clear();
        }
        base_members_ = members_.size();
    }

    // Values and intervals of the named effects, from `after`.
    static void take(Search& search, const Setting& setting) {
        for (NamedEffect& e : search.effects) {
            for (std::size_t i = search.base_members; i < search.members.size(); ++i) {
                if (search.members[i].effect != e.effect) continue;
                e.parameters = parameters_in(search.members, i, search.after, setting, search.blocks);
                widen(search.members[i], setting, e.unmoved, e.parameters);
            }
        }
    }

    Search run() {
        result_.blocks = all_.size();
        result_.base = fit(all_, shape_of(members_));
        rows_ = row_count(all_, result_.base.shape);
        result_.gap_refit = cross_validated(all_, members_) / rows_;
        result_.floor = floor_of(members_);
        find_detectable();
        forward();
        backward();
        exchange();
        merge();
        drop_trifles();
        result_.after = fit(all_, shape_of(members_));
        result_.gap_after = cross_validated(all_, members_) / rows_;
        // the floor again, from the fuller model: what both leave
        result_.floor = std::min({result_.floor, floor_of(members_), result_.gap_after});
        result_.closable_torque_share = torque_share(result_.gap_refit - result_.floor, result_.base);
        result_.left_torque_share = torque_share(result_.gap_after - result_.floor, result_.base);
        result_.members = members_;
        result_.base_members = base_members_;
        note_points(members_, result_.after);
        report_effects();
        report_closed();
        result_.unknowable = unknowable(result_.after, options_.turning);
        result_.timing_samples = result_.after.value(kFirstAmount);
        result_.timing_error = result_.after.error(kFirstAmount);
        judge();
        return result_;
    }

  private:
    // The ways in which an effect may enter; those with fewer unknowns first.
    std::vector<Way> ways(std::size_t effect) const {
        const auto [first, end] = dictionary_.linear_columns(effect);
        if (first == end) {
            const std::span<const Way> all = dictionary_.ways(effect);
            return {all.begin(), all.end()};
        }
        std::vector<Way> made;
        const bool pair = is_pair(effect);
        if (pair && (model::kEffects[effect].parameters[0].minimum >= 0 || !options_.turning)) {
            Way way;
            way.effect = effect;
            way.together = true;
            way.amounts.push_back({{first, first + 1}});
            way.coordinate = {0};
            made.push_back(way);
            if (!options_.turning) return made;
        }
        Way way;
        way.effect = effect;
        double most = 0;
        for (int c = first; c < end; ++c) most = std::max(most, set_.wheel_power(c, c));
        for (int c = first; c < end; ++c) {
            if (set_.wheel_power(c, c) <= kUnexcited * most) continue;
            way.amounts.push_back({{c}});
            way.coordinate.push_back(static_cast<unsigned>(c - first));
        }
        if (way.amounts.empty()) {
            way.amounts.push_back({{first}});
            way.coordinate.push_back(0);
        }
        made.push_back(way);
        return made;
    }

    ModelShape shape_of(const Members& members) const {
        ModelShape shape;
        shape.turning = options_.turning;
        shape.amounts.push_back({{Dictionary::kTiming}});
        for (const Way& m : members) {
            shape.amounts.insert(shape.amounts.end(), m.amounts.begin(), m.amounts.end());
            shape.fixed.insert(shape.fixed.end(), m.fixed.begin(), m.fixed.end());
        }
        return shape;
    }

    static Eigen::Index first_amount_of(const Members& members, std::size_t member) {
        std::size_t at = 1;
        for (std::size_t i = 0; i < member; ++i) at += members[i].amounts.size();
        return kFirstAmount + static_cast<Eigen::Index>(at);
    }
    static Eigen::VectorXd amounts_in(const Members& members, std::size_t member, const Fit& f) {
        return f.value.segment(first_amount_of(members, member),
                               static_cast<Eigen::Index>(members[member].amounts.size()));
    }

    static Blocks leave_out(const Blocks& blocks, std::size_t fold) {
        Blocks rest;
        for (std::size_t i = 0; i < blocks.size(); ++i) {
            if (i % kFolds != fold) rest.push_back(blocks[i]);
        }
        return rest;
    }

    // Squares of each block, left out of the fit.
    std::vector<double> left_out(const Blocks& blocks, const Members& members) const {
        std::vector<double> each(blocks.size());
        const ModelShape shape = shape_of(members);
        for (std::size_t fold = 0; fold < std::min(kFolds, blocks.size()); ++fold) {
            const Fit rest = fit(leave_out(blocks, fold), shape, Spread::left_out);
            for (std::size_t i = fold; i < blocks.size(); i += kFolds) each[i] = squares(*blocks[i], rest);
        }
        return each;
    }
    double cross_validated(const Blocks& blocks, const Members& members) const {
        const std::vector<double> each = left_out(blocks, members);
        return std::accumulate(each.begin(), each.end(), 0.0);
    }

    // What a model with free coefficients for everything smooth leaves, on blocks it was not fitted to.
    double reach(const Blocks& blocks, const Members& members) const {
        std::vector<int> extra{Dictionary::kTiming};
        for (std::size_t i = 0; i < model::kEffectCount; ++i) {
            if (excluded(i)) continue;
            for (auto [c, end] = dictionary_.linear_columns(i); c < end; ++c) extra.push_back(c);
        }
        for (auto [c, end] = dictionary_.rich_columns(); c < end; ++c) extra.push_back(c);
        return reachable_squares(blocks, shape_of(members), extra);
    }
    double floor_of(const Members& members) const {
        return std::min(reach(all_, members) / rows_, result_.gap_refit);
    }

    // A gap as the RMS of torque that would do the same, over the RMS of the
    // torque.
    double torque_share(double gap, const Fit& base) const {
        const double torque = torque_squares(all_, base) / rows_;
        return torque > 0 ? std::sqrt(std::max(0.0, gap) / torque) : 0.0;
    }

    // An effect of which this log holds something, and that the model does not have.
    bool usable(std::size_t effect) const {
        if (contains(members_, effect) || excluded(effect)) return false;
        const std::vector<Way> all = ways(effect);
        return std::any_of(all.begin(), all.end(), [&](const Way& way) { return excited(way); });
    }
    bool excluded(std::size_t effect) const {
        return std::find(options_.excluded.begin(), options_.excluded.end(), effect) !=
               options_.excluded.end();
    }
    bool excited(const Way& way) const {
        for (const Amount& amount : directions(way)) {
            for (const int c : amount.columns) {
                if (set_.wheel_power(c, c) > 0) return likeness(all_, result_.base, directions(way), {}) < 1;
            }
        }
        return false;
    }

    double effect_torque_share(const Members& members, std::size_t member, const Fit& f) const {
        const Way& way = members[member];
        const Eigen::VectorXd amount = amounts_in(members, member, f);
        Eigen::VectorXd p = Eigen::VectorXd::Zero(set_.wheel_power.cols());
        for (std::size_t i = 0; i < way.amounts.size(); ++i) {
            for (const int c : way.amounts[i].columns) p(c) += amount(Eigen::Index(i));
        }
        for (const int c : way.fixed) p(c) += 1;
        return std::sqrt(std::max(0.0, p.dot(set_.wheel_power * p))) / std::max(1e-12, set_.torque_rms_Nm);
    }

    double least_share(const Members& members) const {
        return members.size() > 1 ? kSizeOfInterest : kSizeOfInterestAlone;
    }

    struct Trial {
        Way way{};
        double gain = 0;  // held-out, on the blocks that select
        double probability = 1, rank_probability = 1;
        std::size_t rank_blocks = 0;  // that the latter is from
        bool confirmed = false, of_interest = false, in_range = false;
    };

    // Within its physical range: a friction that drives is none.
    bool in_range(const Members& members, std::size_t member, const Fit& f) const {
        const Way& way = members[member];
        const auto& info = model::kEffects[way.effect].parameters;
        const Eigen::VectorXd amount = amounts_in(members, member, f);
        if (way.kind == Way::Kind::linear) {
            if (!model::kLinearInParameters[way.effect]) return true;
            const Eigen::Index first = first_amount_of(members, member);
            for (Eigen::Index i = 0; i < amount.size(); ++i) {
                const double slack = 3 * f.error(first + i);
                const auto& range = info[way.coordinate[std::size_t(i)]];
                if (amount(i) < range.minimum - slack || amount(i) > range.maximum + slack) return false;
            }
            return true;
        }
        const auto [p, plausible] = parameters_of(way, amount, dictionary_.setting());
        if (!plausible) return false;
        for (std::size_t j = 0; j < info.size(); ++j) {
            const double slack = 0.01 * (std::abs(way.at[j]) + 1e-6);
            if (p[j] < info[j].minimum - slack || p[j] > info[j].maximum + slack) return false;
        }
        return true;
    }

    // That the last member is not there. One at a focus is taken as a whole for it.
    double probability_of_last(const Blocks& blocks, const Members& members) const {
        Members tested = members;
        Way& last = tested.back();
        last.amounts = directions(last);
        last.fixed.clear();
        const Fit f = fit(blocks, shape_of(tested), Spread::plain);
        const Eigen::Index at = first_amount_of(tested, tested.size() - 1);
        const auto n = static_cast<Eigen::Index>(last.amounts.size());
        const double degrees = std::max(1.0, double(blocks.size()) - 4 - double(n));
        return wald_probability(f.value.segment(at, n), f.covariance.block(at, at, n, n), degrees);
    }

    // Two amounts from here on differ by more than chance.
    static bool apart(const Fit& f, Eigen::Index at) {
        return std::abs(f.value(at) - f.value(at + 1)) > kApart * std::sqrt(difference_variance(f, at));
    }
    static double difference_variance(const Fit& f, Eigen::Index at) {
        return std::max(0.0,
                        f.covariance(at, at) + f.covariance(at + 1, at + 1) - 2 * f.covariance(at, at + 1));
    }

    // The best of an effect's points, beside the members.
    std::optional<Way> best_point(std::size_t effect, const Members& members, const Blocks& blocks) const {
        std::optional<Way> best;
        double least = std::numeric_limits<double>::infinity();
        for (const Way& way : ways(effect)) {
            const Members more = with(members, way);
            // only what is linear has its errors looked at
            const Fit f =
                fit(blocks, shape_of(more), way.kind == Way::Kind::linear ? Spread::known : Spread::left_out);
            if (!in_range(more, more.size() - 1, f)) continue;
            // a closer look is preferred, for it goes on from where it is
            const double left = way.kind == Way::Kind::focus ? kCloser * f.squares : f.squares;
            if (left >= least) continue;
            least = left;
            best = way;
        }
        return best;
    }

    // The blocks' gains without those in which an effect hardly acts: scrub while the robot goes straight.
    static std::vector<double> where_it_acts(const std::vector<double>& gain, const Blocks& blocks,
                                             const Way& way) {
        std::vector<double> power(blocks.size());
        for (const Amount& amount : directions(way)) {
            for (const int a : amount.columns) {
                for (const int b : amount.columns) {
                    for (std::size_t i = 0; i < blocks.size(); ++i) {
                        power[i] += blocks[i]->product[kLinear](a, b) + blocks[i]->product[kTurning](a, b);
                    }
                }
            }
        }
        const double most = *std::max_element(power.begin(), power.end());
        std::vector<double> acting;
        for (std::size_t i = 0; i < gain.size(); ++i) {
            if (power[i] >= kActs * most) acting.push_back(gain[i]);
        }
        return acting;
    }

    // Two models' squares, block by block, left out of the fit: of the blocks in which the models foretell
    // something different. In others noise would judge between them.
    struct Compared {
        std::vector<double> one, other;
    };
    Compared compared(const Members& one, const Members& other) const {
        return compared({left_out(all_, one), left_out(all_, other)}, one, other);
    }
    Compared compared(const Compared& all, const Members& one, const Members& other) const {
        const Fit a = fit(all_, shape_of(one), Spread::left_out);
        const Fit b = fit(all_, shape_of(other), Spread::left_out);
        std::vector<double> apart(all_.size());
        for (std::size_t i = 0; i < apart.size(); ++i) apart[i] = squares_apart(*all_[i], a, b);
        std::vector<std::size_t> order(apart.size());
        std::iota(order.begin(), order.end(), std::size_t{0});
        std::sort(order.begin(), order.end(),
                  [&](std::size_t i, std::size_t j) { return apart[i] > apart[j]; });
        Compared parting;
        for (const std::size_t i : order) {
            if (parting.one.size() >= kFewestParting && apart[i] < kActs * apart[order.front()]) break;
            parting.one.push_back(all.one[i]);
            parting.other.push_back(all.other[i]);
        }
        return parting;
    }

    // One model is true rather than the other, by all that they foretell.
    bool told_apart(const Members& one, const Members& other) const {
        const Fit a = fit(all_, shape_of(one), Spread::left_out);
        const Fit b = fit(all_, shape_of(other), Spread::left_out);
        std::vector<double> gain(all_.size());
        std::vector<double> apart(all_.size());
        for (std::size_t i = 0; i < all_.size(); ++i) {
            const Blocks block{all_[i]};
            gain[i] = squares(block, b) - squares(block, a);
            apart[i] = squares_apart(*all_[i], a, b);
        }
        return surely_as_foretold(gain, apart, squares(all_, a) / rows_, kToldApart);
    }

    Trial attempt(std::size_t effect, const Members& members) const {
        const auto [first, end] = dictionary_.linear_columns(effect);
        std::vector<Way> tried;
        if (first == end) {
            const std::optional<Way> best = best_point(effect, members, select_);
            if (best) tried.push_back(*best);
        } else {
            tried = ways(effect);
        }
        Trial best;
        best.way.effect = effect;
        const std::vector<double> before = left_out(select_, members);
        const Fit without_it = fit(select_, shape_of(members), Spread::left_out);
        for (const Way& way : tried) {
            Trial t;
            t.way = way;
            const Members more = with(members, way);
            const std::size_t last = more.size() - 1;
            const std::vector<double> after = left_out(select_, more);
            std::vector<double> gain(before.size());
            for (std::size_t i = 0; i < gain.size(); ++i) gain[i] = before[i] - after[i];
            t.gain = std::accumulate(gain.begin(), gain.end(), 0.0);
            const std::vector<double> acting = where_it_acts(gain, select_, way);
            t.rank_probability = signed_rank_probability(gain);
            t.rank_blocks = gain.size();
            if (acting.size() >= kFewestActing && signed_rank_probability(acting) < t.rank_probability) {
                t.rank_probability = signed_rank_probability(acting);
                t.rank_blocks = acting.size();
            }
            const Fit selected = fit(select_, shape_of(more));
            t.probability = probability_of_last(select_, more);
            t.in_range = in_range(more, last, selected);
            t.of_interest = effect_torque_share(more, last, selected) >= least_share(more);
            t.confirmed = confirmed(without_it, selected);
            // one amount for both unless two are clearly apart
            if (tried.size() == 1 || best.gain == 0 ||
                (t.gain > best.gain && apart(selected, first_amount_of(more, last)))) {
                best = t;
            }
        }
        return best;
    }

    // On blocks that took no part in choosing it, it gains what it foretells there, as far as they can tell:
    // of something that is not there they lose as much.
    bool confirmed(const Fit& without_it, const Fit& with_it) const {
        if (confirm_.empty()) return true;
        const double left = squares(confirm_, with_it);
        double foretold = 0;
        for (const Block* b : confirm_) foretold += squares_apart(*b, without_it, with_it);
        const double variance = left / row_count(confirm_, with_it.shape);
        return squares(confirm_, without_it) - left > foretold / 3 - 2 * std::sqrt(variance * foretold);
    }

    void note_point(const Members& members, std::size_t member, const Fit& f) {
        const Way& way = members[member];
        if (way.kind == Way::Kind::linear) return;
        auto p = parameters_of(way, amounts_in(members, member, f), dictionary_.setting()).first;
        const auto& info = model::kEffects[way.effect].parameters;
        for (std::size_t j = 0; j < info.size(); ++j)
            p[j] = std::clamp(p[j], info[j].minimum, info[j].maximum);
        result_.points[way.effect] = p;
    }
    void note_points(const Members& members, const Fit& f) {
        for (std::size_t i = 0; i < members.size(); ++i) note_point(members, i, f);
    }

    // Among those that do the same in every motion of this log: linear in its
    // parameters first, then the catalogue's order.
    const Trial* simplest_equal(const std::vector<Trial>& trials, const Trial& chosen) const {
        const Trial* best = &chosen;
        const Fit bare = fit(all_, shape_of(members_));
        for (const Trial& t : trials) {
            if (!t.in_range || t.gain < 0.9 * chosen.gain) continue;
            if (simplicity(t.way) < simplicity(best->way) &&
                likeness(all_, bare, directions(chosen.way), directions(t.way)) > kAlike) {
                best = &t;
            }
        }
        return best;
    }

    bool acceptable(const Trial& t, std::size_t tested, double closable) const {
        // by one test after Holm, and by the other at least alone; few blocks have few ranks
        const double level = members_.empty() ? kSignificanceAlone : kSignificance;
        const double strict = level / double(tested);
        const double rank = std::max(level, std::pow(0.5, double(t.rank_blocks)) * 1.001);
        const bool significant = (t.probability <= strict && t.rank_probability <= rank) ||
                                 (t.probability <= level && t.rank_probability <= strict);
        const auto& earlier = options_.confirmed;
        const bool confirmed =
            t.confirmed || std::find(earlier.begin(), earlier.end(), t.way.effect) != earlier.end();
        return significant && t.in_range && t.of_interest && confirmed && t.gain > 0 &&
               t.gain >= kLeastShareOfClosable * closable && t.gain >= kLeastShareOfAll * closable_at_first_;
    }

    void forward() {
        while (members_.size() - base_members_ < kMostEffects) {
            const double now = cross_validated(select_, members_);
            const double closable = now - std::min(now, reach(select_, members_));
            if (members_.size() == base_members_) closable_at_first_ = closable;
            std::vector<Trial> trials;
            for (std::size_t i = 0; i < model::kEffectCount; ++i) {
                if (usable(i)) trials.push_back(attempt(i, members_));
            }
            if (trials.empty()) break;
            std::sort(trials.begin(), trials.end(),
                      [](const Trial& a, const Trial& b) { return a.gain > b.gain; });
            const auto chosen = std::find_if(trials.begin(), trials.end(), [&](const Trial& t) {
                return acceptable(t, trials.size(), closable);
            });
            if (chosen != trials.end()) {
                const Trial* simplest = simplest_equal(trials, *chosen);
                probability_[simplest->way.effect] = simplest->probability;
                members_.push_back(simplest->way);
                take_apart();
            } else if (torque_share(closable / row_count(select_, result_.base.shape), result_.base) <
                       kLargeGap) {
                break;
            } else if (!add_two(trials, closable)) {
                note_leads(trials);
                break;
            }
        }
    }

    // Where much is missing: what is sure at a point of its grid and explains too little there. It may
    // explain more between the points, which a closer look will tell.
    void note_leads(const std::vector<Trial>& trials) {
        for (const Trial& t : trials) {
            if (t.way.kind != Way::Kind::grid || !dictionary_.can_focus(t.way.effect) ||
                !acceptable(t, trials.size(), 0)) {
                continue;
            }
            const Members more = with(members_, t.way);
            note_point(more, more.size() - 1, fit(select_, shape_of(more), Spread::left_out));
        }
    }

    // Left and right, once clearly apart beside the effects found by now, get an amount each.
    void take_apart() {
        for (std::size_t i = 0; i < members_.size(); ++i) {
            if (!members_[i].together || !options_.turning) continue;
            Members other = members_;
            other[i] = ways(members_[i].effect).back();
            if (other[i].amounts.size() != 2) continue;
            const Fit f = fit(select_, shape_of(other));
            if (apart(f, first_amount_of(other, i)) &&
                cross_validated(select_, other) < cross_validated(select_, members_)) {
                members_ = other;
            }
        }
    }

    // Where much is missing and nothing alone is sure, each of two may be beside the other: one that gains
    // much, and any other, which alone may gain nothing.
    bool add_two(const std::vector<Trial>& trials, double closable) {
        constexpr std::size_t kLeaders = 5;
        struct Pair {
            const Trial* leader;
            Trial other;
            double gain;
        };
        std::vector<Pair> pairs;
        double most = 0;
        for (std::size_t i = 0; i < std::min(kLeaders, trials.size()); ++i) {
            const Trial& leader = trials[i];
            if (!leader.in_range || leader.gain <= 0) continue;
            for (const Trial& t : trials) {
                if (t.way.effect == leader.way.effect) continue;
                const Trial other = attempt(t.way.effect, with(members_, leader.way));
                const double gain = leader.gain + other.gain;
                if (members_.size() == base_members_ && other.in_range && gain > most) {
                    most = gain;
                    result_.guess = fit(all_, shape_of(with(with(members_, leader.way), other.way)));
                }
                if (acceptable(other, trials.size(), 0) && gain >= kLeastShareOfClosable * closable)
                    pairs.push_back({&leader, other, gain});
            }
        }
        std::sort(pairs.begin(), pairs.end(), [](const Pair& a, const Pair& b) { return a.gain > b.gain; });
        for (const Pair& pair : pairs) {
            const Trial leader = attempt(pair.leader->way.effect, with(members_, pair.other.way));
            if (!acceptable(leader, trials.size(), 0)) continue;
            for (const Trial* t : {&leader, &pair.other}) {
                probability_[t->way.effect] = t->probability;
                members_.push_back(t->way);
            }
            return true;
        }
        return false;
    }

    // What the effects found later made superfluous goes: not surely there, and nothing much is missing
    // without.
    void backward() {
        for (std::size_t i = base_members_; i < members_.size();) {
            const Fit f = fit(all_, shape_of(members_));
            const Members fewer = without(members_, i);
            const double left = cross_validated(all_, fewer);
            const double gain = left - cross_validated(all_, members_);
            const bool much = gain > kLeastShareOfClosable * (left - std::min(left, result_.floor * rows_));
            const bool little = gain < kLeastShareOfAll * (result_.gap_refit - result_.floor) * rows_;
            const bool needed =
                !little && (much || probability_of_last(all_, with(fewer, members_[i])) <= kSuperfluous);
            if (needed && effect_torque_share(members_, i, f) >= least_share(members_)) {
                ++i;
            } else {
                members_ = fewer;
            }
        }
    }

    // What came in another's place must be of interest too.
    void drop_trifles() {
        for (std::size_t i = base_members_; i < members_.size();) {
            if (effect_torque_share(members_, i, fit(all_, shape_of(members_))) >= least_share(members_)) {
                ++i;
            } else {
                members_ = without(members_, i);
            }
        }
    }

    // What a rival is tried beside: the others as they are; and with left and right of each apart, for what
    // is named instead of the rival may have hidden that they differ.
    std::vector<Members> others_for(const Members& fewer) const {
        std::vector<Members> all{fewer};
        Members apart = fewer;
        for (Way& m : apart) {
            if (m.together && options_.turning) m = ways(m.effect).back();
        }
        if (unknowns(apart) > unknowns(fewer)) all.push_back(apart);
        return all;
    }

    // What another effect does better in a member's place goes for it, and a general effect for the special
    // case of it that does as well.
    void exchange() {
        for (std::size_t i = base_members_; i < members_.size(); ++i) {
            const Members fewer = without(members_, i);
            if (const auto best = best_point(members_[i].effect, fewer, all_);
                best && members_[i].kind != Way::Kind::linear) {
                members_[i] = *best;
            }
            const double bare = cross_validated(all_, fewer);
            Members held = with(fewer, members_[i]);
            double mine = cross_validated(all_, held);
            const std::size_t general = members_[i].effect;
            for (std::size_t r = 0; r < model::kEffectCount; ++r) {
                if (r == general || contains(fewer, r) || excluded(r)) continue;
                for (const Members& others : others_for(fewer)) {
                    const std::optional<Way> best = best_point(r, others, all_);
                    if (!best || !excited(*best)) continue;
                    const Members taken = with(others, *best);
                    const double sum = cross_validated(all_, taken);
                    if (sum > mine + 4 * kTied * (bare - mine)) continue;
                    const bool simpler =
                        unknowns(others) <= unknowns(fewer) && simplicity(*best) < simplicity(held.back());
                    const bool held_better = better(held, taken);
                    if (simpler ? !held_better : better(taken, held) && !held_better && sum < mine) {
                        held = taken;
                        mine = sum;
                    }
                }
            }
            if (held.back().effect == general) continue;
            probability_[held.back().effect] = probability_of_last(all_, held);
            std::rotate(held.begin() + std::ptrdiff_t(i), held.end() - 1, held.end());
            members_ = held;
        }
    }

    // One effect that leaves less than two of those found goes for both.
    void merge() {
        for (std::size_t i = base_members_; i < members_.size(); ++i) {
            for (std::size_t j = i + 1; j < members_.size(); ++j) {
                if (merge(i, j)) return merge();
            }
        }
    }
    bool merge(std::size_t i, std::size_t j) {
        const Members fewer = without(without(members_, j), i);
        Members held = members_;
        double mine = cross_validated(all_, held);
        for (std::size_t r = 0; r < model::kEffectCount; ++r) {
            if (contains(members_, r) || excluded(r)) continue;
            for (const Members& others : others_for(fewer)) {
                const std::optional<Way> best = best_point(r, others, all_);
                if (!best || !excited(*best)) continue;
                const Members taken = with(others, *best);
                const double sum = cross_validated(all_, taken);
                if (!(sum < mine) || better(held, taken)) continue;
                held = taken;
                mine = sum;
            }
        }
        if (held.size() == members_.size()) return false;
        probability_[held.back().effect] = probability_of_last(all_, held);
        members_ = held;
        return true;
    }

    // Surely one rather than the other.
    bool better(const Members& one, const Members& other) const {
        const auto [first, second] = compared(one, other);
        return surely_less(first, second) || told_apart(one, other);
    }

    // The first of each block's squares are less than the second, by more than chance and by more than a
    // trifle.
    static bool surely_less(const std::vector<double>& first, const std::vector<double>& second) {
        std::vector<double> gain(first.size());
        for (std::size_t b = 0; b < first.size(); ++b) gain[b] = second[b] - first[b];
        const double sum = std::accumulate(gain.begin(), gain.end(), 0.0);
        const double of = std::accumulate(first.begin(), first.end(), 0.0);
        return sum > kTrifle * of && surely_positive(gain);
    }

    static bool surely_positive(const std::vector<double>& gain) {
        return gap::surely_positive(gain, kSignificance);
    }

    static std::size_t unknowns(const Way& way) {
        return way.kind == Way::Kind::linear ? way.amounts.size()
                                             : model::kEffects[way.effect].parameters.size();
    }

    static std::size_t unknowns(const Members& members) {
        std::size_t sum = 0;
        for (const Way& m : members) sum += unknowns(m);
        return sum;
    }

    // Linear in its parameters first, then fewer unknowns, then the catalogue's order.
    static std::tuple<bool, std::size_t, std::size_t> simplicity(const Way& way) {
        return {way.kind != Way::Kind::linear, unknowns(way), way.effect};
    }

    static bool is_special_case(std::size_t special, std::size_t general) {
        constexpr std::array<std::pair<std::string_view, std::string_view>, 2> kCases{
            {{"coulomb_friction", "stribeck_friction"}, {"torque_saturation", "back_emf_limit"}}};
        return std::any_of(kCases.begin(), kCases.end(), [&](const auto& c) {
            return model::kEffects[special].name == c.first && model::kEffects[general].name == c.second;
        });
    }

    void report_effects() {
        const double closable = std::max(1e-12, (result_.gap_refit - result_.floor) * rows_);
        const double with_all = squares(all_, result_.after);
        for (std::size_t i = base_members_; i < members_.size(); ++i) {
            NamedEffect named;
            named.effect = members_[i].effect;
            named.torque_share = effect_torque_share(members_, i, result_.after);
            named.probability = probability_[named.effect];
            named.parameters = parameters_in(members_, i, result_.after, dictionary_.setting(), all_.size());
            named.unmoved = unmoved_by(i);
            widen(members_[i], dictionary_.setting(), named.unmoved, named.parameters);
            const Members fewer = without(members_, i);
            const Fit bare = fit(all_, shape_of(fewer));
            named.closes = std::clamp(
                (cross_validated(all_, fewer) / rows_ - result_.gap_after) * rows_ / closable, 0.0, 1.0);
            find_rivals(fewer, members_[i], bare, with_all, squares(all_, bare) - with_all, named);
            result_.effects.push_back(named);
        }
        std::sort(result_.effects.begin(), result_.effects.end(),
                  [](const NamedEffect& a, const NamedEffect& b) { return a.closes > b.closes; });
    }

    // NamedEffect::unmoved.
    std::vector<double> unmoved_by(std::size_t member) const {
        std::vector<double> errors(model::kEffects[members_[member].effect].parameters.size(), 0.0);
        if (members_[member].together && options_.turning) {
            // left and right that share an amount may differ by what is not clear yet
            Members other = members_;
            other[member] = ways(members_[member].effect).back();
            if (other[member].amounts.size() != 2) return errors;
            const Fit f = fit(all_, shape_of(other));
            const Eigen::Index at = first_amount_of(other, member);
            errors[0] = errors[1] =
                std::sqrt(std::pow(f.value(at) - f.value(at + 1), 2) + difference_variance(f, at)) / 2;
        }
        if (members_[member].kind == Way::Kind::focus) {
            // foci beside the one chosen, by how likely they are
            struct Beside {
                model::Parameters<double> p;
                double squares;
            };
            std::vector<Beside> beside;
            for (const Way& way : ways(members_[member].effect)) {
                if (way.kind != Way::Kind::focus) continue;
                Members other = members_;
                other[member] = way;
                const Fit f = fit(all_, shape_of(other), Spread::left_out);
                beside.push_back(
                    {parameters_of(way, amounts_in(other, member, f), dictionary_.setting()).first,
                     f.squares});
            }
            const auto best =
                std::min_element(beside.begin(), beside.end(),
                                 [](const Beside& a, const Beside& b) { return a.squares < b.squares; });
            const double level = best->squares / rows_;
            double all = 0;
            std::vector<double> sum(errors.size(), 0.0);
            for (const Beside& one : beside) {
                const double weight = std::exp((best->squares - one.squares) / (2 * level));
                all += weight;
                for (std::size_t j = 0; j < sum.size(); ++j)
                    sum[j] += weight * std::pow(one.p[j] - best->p[j], 2);
            }
            for (std::size_t j = 0; j < sum.size(); ++j)
                errors[j] = beside.size() > 1 ? std::sqrt(sum[j] / all) : 0.0;
        }
        return errors;
    }

    void find_rivals(const Members& fewer, const Way& mine, const Fit& bare, double with_all, double gain,
                     NamedEffect& named) {
        const Members mine_there = with(fewer, mine);
        const std::vector<double> mine_left = left_out(all_, mine_there);
        for (std::size_t r = 0; r < model::kEffectCount; ++r) {
            if (r == mine.effect || contains(fewer, r) || excluded(r)) continue;
            std::optional<Way> best = best_point(r, fewer, all_);
            if (!best || !excited(*best)) continue;
            // as many unknowns as the one it would stand for
            if (mine.kind == Way::Kind::linear && !mine.together && best->together) best = ways(r).back();
            const Members other = with(fewer, *best);
            const Fit instead = fit(all_, shape_of(other));
            if (!in_range(other, other.size() - 1, instead)) continue;
            Rival rival;
            rival.effect = r;
            rival.keeps = gain > 0 ? 1 - (squares(all_, instead) - with_all) / gain : 0.0;
            // a general effect that does no better than its special case is that
            rival.alike = likeness(all_, bare, directions(mine), directions(*best)) > kAlike ||
                          (is_special_case(mine.effect, r) && std::abs(rival.keeps - 1) < kTied / 5);
            const std::vector<Way> all = ways(r);
            rival.coarse = dictionary_.can_focus(r) &&
                           std::all_of(all.begin(), all.end(),
                                       [](const Way& way) { return way.kind == Way::Kind::grid; });
            if (rival.keeps > 0.3) note_point(other, other.size() - 1, instead);
            auto [loss, here] = compared({left_out(all_, other), mine_left}, other, mine_there);
            rival.richer =
                unknowns(mine) < unknowns(*best) && rival.keeps < kNoBetter && !surely_less(loss, here);
            for (std::size_t b = 0; b < loss.size(); ++b) loss[b] -= here[b];
            const bool told = told_apart(mine_there, other);
            const bool worse = told || surely_positive(loss);
            const double trifle = told ? kTrifleOfGainForetold : kTrifleOfGain;
            if (rival.alike || (!worse && rival.keeps > 1 - 4 * kTied) || rival.keeps > 1 - trifle) {
                named.rivals.push_back(rival);
            } else {
                named.ruled_out.push_back(rival);
            }
        }
    }

    static std::vector<ParameterEstimate> parameters_in(const Members& members, std::size_t member,
                                                        const Fit& f, const Setting& setting,
                                                        std::size_t blocks) {
        const Eigen::VectorXd amounts = amounts_in(members, member, f);
        const Eigen::Index at = first_amount_of(members, member);
        return estimates_of(members[member], amounts,
                            f.covariance.block(at, at, amounts.size(), amounts.size()), setting, blocks);
    }

    void report_closed() {
        if (report_.empty()) {
            const double closable = result_.gap_refit - result_.floor;
            result_.closable_share = closable > 0 ? (result_.gap_refit - result_.gap_after) / closable : 0.0;
            return;
        }
        const double rows = row_count(report_, result_.base.shape);
        const double before = squares(report_, result_.base) / rows;
        const double after = squares(report_, result_.after) / rows;
        const double closable = before - result_.floor;
        result_.closable_share = closable > 0 ? std::clamp((before - after) / closable, -1.0, 1.0) : 0.0;
    }

    // The smallest size that this log could have shown: as certain as the
    // acceptance asks, and of interest.
    void find_detectable() {
        const double infinity = std::numeric_limits<double>::infinity();
        for (std::size_t i = 0; i < model::kEffectCount; ++i) {
            const std::vector<Way> all = ways(i);
            if (all.empty() || contains(members_, i)) continue;
            const bool linear = all.front().kind == Way::Kind::linear;
            const Way& way = linear ? all.front() : all[all.size() / 2];
            if (way.kind == Way::Kind::focus) continue;  // the look at the grid has told
            const Members more = with(members_, way);
            const Fit f = fit(all_, shape_of(more));
            const Eigen::Index first = first_amount_of(more, more.size() - 1);
            Eigen::VectorXd least(way.amounts.size());
            for (std::size_t k = 0; k < way.amounts.size(); ++k) {
                double power = 0;
                for (const int c : way.amounts[k].columns) {
                    for (const int c2 : way.amounts[k].columns) power += set_.wheel_power(c, c2);
                }
                const bool excited = power > 0 && likeness(all_, result_.base, {way.amounts[k]}, {}) < 1;
                const double interest =
                    power > 0 ? kSizeOfInterestAlone * set_.torque_rms_Nm / std::sqrt(power) : infinity;
                least(Eigen::Index(k)) =
                    excited ? std::max(interest, 4.5 * f.error(first + Eigen::Index(k))) : infinity;
            }
            Detectable d;
            d.effect = i;
            if (linear) {
                for (Eigen::Index k = 0; k < least.size(); ++k) d.size.push_back(least(k));
                if (way.together) d.size.push_back(least(0));
            } else if (least.allFinite()) {
                const auto p = parameters_of(way, least, dictionary_.setting()).first;
                d.size.assign(p.begin(), p.begin() + std::ptrdiff_t(model::kEffects[i].parameters.size()));
            } else {
                d.size.assign(model::kEffects[i].parameters.size(), infinity);
            }
            result_.detectable.push_back(d);
        }
    }

    void judge() {
        const bool much_left = (result_.left_torque_share > options_.large_gap &&
                                result_.left_torque_share > 0.5 * result_.closable_torque_share) ||
                               (!result_.effects.empty() && result_.left_torque_share > kSmallGap &&
                                result_.left_torque_share > kShareLeft * result_.closable_torque_share);
        const auto percent = [](double share) {
            return std::to_string(double(std::lround(1000 * share)) / 10.0).substr(0, 4) + " %";
        };
        if (result_.effects.empty()) {
            const double beyond = options_.white_noise ? beyond_noise_share(all_, result_.after) : 0.0;
            const double left = std::max(result_.left_torque_share, beyond);
            if (much_left || beyond > options_.large_gap) {
                result_.verdict = Verdict::unexplained;
                result_.reason = "a gap as large as " + percent(left) +
                                 " of the torque is left that no effect of the catalogue explains";
            } else {
                result_.verdict = Verdict::nothing_missing;
                result_.reason = "what K5..K8 leave is no larger than " + percent(result_.left_torque_share) +
                                 " of the torque, and no effect explains it";
            }
            return;
        }
        for (const NamedEffect& e : result_.effects) {
            for (const Rival& r : e.rivals) {
                if (r.alike || r.richer) continue;
                result_.verdict = Verdict::cannot_tell;
                result_.reason = "this log does not tell " + std::string(model::kEffects[e.effect].name) +
                                 " from " + std::string(model::kEffects[r.effect].name);
                return;
            }
        }
        if (much_left) {
            result_.verdict = Verdict::unexplained;
            result_.reason = "the effects found leave most of the gap";
            return;
        }
        result_.verdict = Verdict::named;
        result_.reason =
            "each effect is significant on blocks that did not choose "
            "it, and closes its share of the gap";
    }

    const BlockSet& set_;
    const SearchOptions& options_;
    const Dictionary& dictionary_;
    Blocks all_, select_, confirm_, report_;
    Members members_;
    std::size_t base_members_ = 0;
    double rows_ = 1;
    double closable_at_first_ = 0;  // on the blocks that select
    std::map<std::size_t, double> probability_;
    Search result_;
};

}  // namespace

const char* verdict_name(Verdict verdict) {
    switch (verdict) {
        case Verdict::named:
            return "named";
        case Verdict::nothing_missing:
            return "nothing_missing";
        case Verdict::cannot_tell:
            return "cannot_tell";
        case Verdict::unexplained:
            return "unexplained";
        case Verdict::unusable_log:
            return "unusable_log";
    }
    return "";
}

void take_refined(Search& search, const Setting& setting) { Searcher::take(search, setting); }

std::vector<std::string> unknowable(const Fit& f, bool turning) {
    std::vector<std::string> names;
    const auto unknown = [&](Eigen::Index i, double scale) { return !(f.error(i) < scale); };
    if (unknown(0, 0.02)) names.emplace_back("K5");
    if (!turning || unknown(1, 0.5 * std::max(1.0, std::abs(f.value(1))))) names.emplace_back("K6");
    if (unknown(2, 0.2 * std::abs(f.value(2)))) names.emplace_back("K7");
    if (!turning || unknown(3, 0.2 * std::abs(f.value(3)))) names.emplace_back("K8");
    return names;
}

std::vector<Amount> directions(const Way& way) {
    if (way.fixed.empty()) return way.amounts;
    return {{way.fixed}};
}

model::EffectSet<double> effects_of(const std::vector<Way>& members, const Fit& f, const Setting& setting) {
    model::EffectSet<double> set;
    Eigen::Index at = kFirstAmount + 1;
    for (const Way& way : members) {
        const auto count = static_cast<Eigen::Index>(way.amounts.size());
        model::Parameters<double> p = parameters_of(way, f.value.segment(at, count), setting).first;
        at += count;
        const auto& info = model::kEffects[way.effect].parameters;
        for (std::size_t j = 0; j < info.size(); ++j)
            p[j] = std::clamp(p[j], info[j].minimum, info[j].maximum);
        set.active[way.effect] = true;
        set.parameter[way.effect] = p;
    }
    return set;
}

Search search(const BlockSet& train, const std::vector<Block>& report, const SearchOptions& options) {
    return Searcher(train, report, options).run();
}

}  // namespace wheelwright::gap
