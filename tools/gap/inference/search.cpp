#include "tools/gap/inference/search.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "tools/gap/hypotheses/hypotheses.hpp"
#include "tools/gap/inference/detection_limits.hpp"
#include "tools/gap/inference/evidence.hpp"
#include "tools/gap/inference/outcome.hpp"
#include "tools/gap/inference/statistics.hpp"

namespace wheelwright::gap {
namespace {

constexpr std::size_t kMostEffects = 4;
class Searcher {
  public:
    Searcher(const BlockSet& train, const SearchOptions& options)
        : evidence_(train, options),
          all_(evidence_.all()),
          members_(evidence_.base()),
          base_members_(members_.size()) {}

    Search run() {
        result_.blocks = all_.size();
        result_.base = evidence_.base_fit();
        result_.gap_refit = evidence_.cross_validated(all_, members_) / evidence_.rows();
        result_.floor = floor_of(members_);
        result_.friction = evidence_.friction();
        begin_with_what_is_shown();
        begin_with_friction();
        forward();
        backward();
        exchange();
        put_friction_back();
        drop_trifles();
        result_.after = evidence_.fit(all_, members_);
        result_.gap_after = evidence_.cross_validated(all_, members_) / evidence_.rows();
        // the floor again, from the fuller model: what both leave
        result_.floor = std::min({result_.floor, floor_of(members_), result_.gap_after});
        result_.closable_torque_share = evidence_.torque_share(result_.gap_refit - result_.floor);
        result_.residual_torque_share = evidence_.torque_share(result_.gap_after - result_.floor);
        result_.members = members_;
        result_.detectable = detectable(evidence_, members_);
        try_all();
        result_.base_members = base_members_;
        for (std::size_t i = 0; i < members_.size(); ++i) note(members_, i, result_.after);
        describe_effects(evidence_, probability_, result_);
        result_.unknowable = unknowable(result_.after, evidence_.options().turning);
        result_.timing_samples = result_.after.value(kFirstAmount);
        result_.timing_error = result_.after.error(kFirstAmount);
        result_.conclusion = conclude(result_.effects, gaps());
        return result_;
    }

  private:
    Gaps gaps() const {
        double beyond = 0;
        if (result_.effects.empty() && evidence_.options().white_noise) {
            const BeyondNoise left = beyond_noise(all_.blocks, result_.after);
            if (surely_positive(left.squares, kPolicy.false_alarm)) beyond = left.share_of_torque();
        }
        return {result_.closable_torque_share, result_.residual_torque_share, beyond,
                evidence_.options().large_gap};
    }

    double floor_of(const Members& members) const {
        return std::min(evidence_.reach(all_, members) / evidence_.rows(), result_.gap_refit);
    }

    // An effect of which this log holds something, and that the model does not have.
    bool usable(std::size_t effect) const {
        if (contains(members_, effect) || evidence_.excluded(effect)) return false;
        const std::vector<Candidate> all = evidence_.candidates(effect);
        return std::any_of(all.begin(), all.end(),
                           [&](const Candidate& candidate) { return evidence_.excited(candidate); });
    }

    struct Trial {
        Candidate candidate{};
        double gain = 0;  // on blocks left out
        double probability = 1, sign_probability = 1;
        bool confirmed = false, of_interest = false, in_range = false;
    };

    // What a trial is held against: the model without it.
    struct Without {
        Members members;
        LeftOut left_out;
    };
    Without fitted_without(const Members& members) const {
        return {members, evidence_.left_out(all_, members)};
    }

    Trial attempt(std::size_t effect, const Without& bare) const {
        const auto [first, end] = evidence_.dictionary().linear_columns(effect);
        std::vector<Candidate> tried;
        if (first == end) {
            const auto best = evidence_.best_point(effect, bare.members, all_);
            if (best) tried.push_back(best->candidate);
        } else {
            tried = evidence_.candidates(effect);
        }
        Trial best;
        best.candidate.effect = effect;
        for (const Candidate& candidate : tried) {
            Trial t;
            t.candidate = candidate;
            const Members more = with(bare.members, candidate);
            const std::size_t last = more.size() - 1;
            const LeftOut left_out = first == end ? evidence_.left_out_with(all_, bare.members, effect)
                                                  : evidence_.left_out(all_, more);
            double residual = 0;
            for (std::size_t i = 0; i < all_.size(); ++i) {
                t.gain += bare.left_out.squares[i] - left_out.squares[i];
                residual += left_out.squares[i];
            }
            const std::vector<double> agrees = agreement(all_, bare.left_out, left_out);
            t.sign_probability = signed_sum_probability(agrees);
            // twice the agreement is what it gains and what it predicts
            const double predicted = 2 * std::accumulate(agrees.begin(), agrees.end(), 0.0) - t.gain;
            // On blocks that took no part in choosing it, it gains what it predicts there, as far as noise
            // lets it: of something that is not there they lose as much.
            t.confirmed = t.gain > predicted / 3 - 2 * std::sqrt(residual / evidence_.rows() * predicted);
            const Fit fitted = evidence_.fit_of_part(all_, more);
            if (t.gain > 0) t.probability = evidence_.probability_of_last(all_, more);
            t.in_range = evidence_.in_range(all_, more, fitted);
            t.of_interest = evidence_.effect_torque_share(more, last, fitted) >= least_share(more, candidate);
            // one amount for both unless two are clearly apart
            if (tried.size() == 1 || best.gain == 0 ||
                (t.gain > best.gain && apart(evidence_.fit(all_, more), first_amount_of(more, last)))) {
                best = t;
            }
        }
        return best;
    }

    bool sure(const Trial& t, std::size_t tested) const {
        // by one test after Holm, and by the other at least alone; few blocks have few signs
        const bool first = members_.size() == base_members_;
        const double level = first ? kPolicy.first_false_alarm : kPolicy.false_alarm;
        const double strict = level / double(tested);
        const double by_sign = std::max(level, std::pow(0.5, double(all_.size())) * 1.001);
        const bool significant = (t.probability <= strict && t.sign_probability <= by_sign) ||
                                 (t.probability <= level && t.sign_probability <= strict);
        return significant && t.in_range && t.of_interest && t.gain > 0 &&
               t.gain >= kPolicy.share_of_first_gap * closable_at_first_;
    }

    bool acceptable(const Trial& t, std::size_t tested, double closable) const {
        return sure(t, tested) && t.confirmed && t.gain >= kPolicy.share_of_gap * closable;
    }

    double closable() const {
        const double now = evidence_.cross_validated(all_, members_);
        return now - std::min(now, evidence_.reach(all_, members_));
    }

    void begin_with_what_is_shown() {
        for (const std::size_t effect : evidence_.options().shown) {
            if (contains(members_, effect) || evidence_.excluded(effect)) continue;
            const auto best = evidence_.best_point(effect, members_, all_);
            if (!best) continue;
            members_.push_back(best->candidate);
            probability_[effect] = 0;
            result_.shown.push_back(effect);
        }
    }
    bool is_shown(const Candidate& candidate) const { return result_.is_shown(candidate.effect); }

    // All friction at once, less what is not surely there beside the rest. A drive train that surely has one
    // friction is likely to have the other.
    void begin_with_friction() {
        const Members& friction = evidence_.friction();
        const std::size_t first = members_.size();
        members_.insert(members_.end(), friction.begin(), friction.end());
        while (members_.size() > first) {
            std::optional<std::size_t> least;
            double least_gain = 0;
            bool sure = false;
            for (std::size_t i = first; i < members_.size(); ++i) {
                const Trial t = attempt(members_[i].effect, fitted_without(without(members_, i)));
                // whether it is there, whatever the folds say of how well it predicts
                const double probability =
                    evidence_.probability_of_last(all_, with(without(members_, i), members_[i]));
                probability_[members_[i].effect] = probability;
                const bool there = probability <= kPolicy.kept && t.in_range && t.of_interest;
                sure = sure || (there && probability <= kPolicy.false_alarm);
                if (there || (least && t.gain >= least_gain)) continue;
                least = i;
                least_gain = t.gain;
            }
            if (!least && sure) break;
            members_ = without(members_, least.value_or(first));
        }
        take_apart();
        evidence_.set_friction({members_.begin() + std::ptrdiff_t(first), members_.end()});
        closable_at_first_ = closable();
    }

    // Friction that another effect has taken the place of may be there beside it; and beside what was found
    // since, the one of which nothing was sure at first, if the drive train has the other.
    void put_friction_back() {
        for (const Candidate& candidate : result_.friction) {
            if (contains(members_, candidate.effect)) continue;
            if (!is_friction(candidate) && std::none_of(members_.begin(), members_.end(),
                                                        [&](const Candidate& m) { return is_friction(m); }))
                continue;
            const Members more = with(members_, candidate);
            const double probability = evidence_.probability_of_last(all_, more);
            if (probability > kPolicy.kept || !evidence_.in_range(all_, more, evidence_.fit(all_, more)))
                continue;
            probability_[candidate.effect] = probability;
            members_ = more;
        }
    }

    bool is_friction(const Candidate& candidate) const {
        return contains(evidence_.friction(), candidate.effect);
    }

    void forward() {
        while (members_.size() - base_members_ < kMostEffects) {
            const double closable = this->closable();
            const Without bare = fitted_without(members_);
            std::vector<Trial> trials;
            for (std::size_t i = 0; i < model::kEffectCount; ++i) {
                if (usable(i)) trials.push_back(attempt(i, bare));
            }
            if (trials.empty()) break;
            std::sort(trials.begin(), trials.end(),
                      [](const Trial& a, const Trial& b) { return a.gain > b.gain; });
            const auto chosen = std::find_if(trials.begin(), trials.end(), [&](const Trial& t) {
                return acceptable(t, trials.size(), closable);
            });
            if (chosen == trials.end()) {
                note_leads(trials, std::max(closable, trials.front().gain));
                break;
            }
            probability_[chosen->candidate.effect] = chosen->probability;
            members_.push_back(chosen->candidate);
            take_apart();
        }
    }

    // Where much is missing: what is sure at a starting point, but explains too little there or is not
    // confirmed, as a block is not in which a load was put on at another time than those tried. It may
    // explain more between the points, which a closer evaluation will show.
    void note_leads(const std::vector<Trial>& trials, double missing) {
        if (evidence_.torque_share(missing / row_count(all_.blocks, result_.base.shape)) < kPolicy.gap)
            return;
        for (const Trial& t : trials) {
            if (t.candidate.kind != Candidate::Kind::start ||
                !evidence_.dictionary().can_linearise(t.candidate.effect) || !sure(t, trials.size())) {
                continue;
            }
            const Members more = with(members_, t.candidate);
            note(more, more.size() - 1, evidence_.fit(all_, more, Spread::none));
        }
    }

    // Left and right, once clearly apart beside the effects found by now, get an amount each.
    void take_apart() {
        for (std::size_t i = 0; i < members_.size(); ++i) {
            if (!members_[i].together || !evidence_.options().turning) continue;
            Members other = members_;
            other[i] = evidence_.candidates(members_[i].effect).back();
            if (other[i].amounts.size() != 2) continue;
            const Fit f = evidence_.fit(all_, other);
            if (apart(f, first_amount_of(other, i)) &&
                evidence_.cross_validated(all_, other) < evidence_.cross_validated(all_, members_)) {
                members_ = other;
            }
        }
    }

    // What the effects found later made superfluous goes: not surely there, and nothing much is missing
    // without.
    void backward() {
        for (std::size_t i = base_members_; i < members_.size();) {
            const Fit f = evidence_.fit(all_, members_);
            const Members fewer = without(members_, i);
            const double residual = evidence_.cross_validated(all_, fewer);
            const double gain = residual - evidence_.cross_validated(all_, members_);
            const bool much = gain > kPolicy.share_of_gap *
                                         (residual - std::min(residual, result_.floor * evidence_.rows()));
            const bool little =
                !is_friction(members_[i]) && gain < kPolicy.share_of_first_gap * closable_at_first_;
            const bool needed = !little && (much || evidence_.probability_of_last(
                                                        all_, with(fewer, members_[i])) <= kPolicy.kept);
            if (is_shown(members_[i]) || (needed && evidence_.effect_torque_share(members_, i, f) >=
                                                        least_share(members_, members_[i]))) {
                ++i;
            } else {
                members_ = fewer;
            }
        }
    }

    // What came in another's place must be of interest too.
    void drop_trifles() {
        for (std::size_t i = base_members_; i < members_.size();) {
            if (is_shown(members_[i]) ||
                evidence_.effect_torque_share(members_, i, evidence_.fit(all_, members_)) >=
                    least_share(members_, members_[i])) {
                ++i;
            } else {
                members_ = without(members_, i);
            }
        }
    }

    // What another effect does better in a member's place goes for it, and a general effect for the special
    // case of it that does as well.
    void exchange() {
        for (std::size_t i = base_members_; i < members_.size(); ++i) {
            const Members fewer = without(members_, i);
            if (const auto best = evidence_.best_point(members_[i].effect, fewer, all_);
                best && members_[i].kind != Candidate::Kind::linear) {
                members_[i] = best->candidate;
            }
            if (is_shown(members_[i])) continue;
            const double bare = evidence_.cross_validated(all_, fewer);
            Members held = with(fewer, members_[i]);
            double mine = evidence_.cross_validated(all_, held);
            const std::size_t general = members_[i].effect;
            for (std::size_t r = 0; r < model::kEffectCount; ++r) {
                if (r == general || contains(fewer, r) || evidence_.excluded(r)) continue;
                for (const Members& others : evidence_.others_for(fewer)) {
                    const double most = mine + kPolicy.share_of_gap * (bare - mine);
                    const auto best = evidence_.best_point(r, others, all_);
                    if (!best || best->squares > most || !evidence_.excited(best->candidate)) continue;
                    const Members taken = with(others, best->candidate);
                    const double sum = evidence_.cross_validated(all_, taken);
                    if (sum > most) continue;
                    const bool simpler = unknowns(others) <= unknowns(fewer) &&
                                         simplicity(best->candidate) < simplicity(held.back());
                    const bool held_better = evidence_.better(held, taken);
                    // every drive train may have friction: what goes for it must explain much that it leaves
                    const bool much =
                        !is_friction(held.back()) ||
                        mine - sum >= kPolicy.share_of_gap * (mine - result_.floor * evidence_.rows());
                    if (simpler ? !held_better
                                : much && evidence_.better(taken, held) && !held_better && sum < mine) {
                        held = taken;
                        mine = sum;
                    }
                }
            }
            if (held.back().effect == general) continue;
            probability_[held.back().effect] = evidence_.probability_of_last(all_, held);
            std::rotate(held.begin() + std::ptrdiff_t(i), held.end() - 1, held.end());
            members_ = held;
        }
    }

    // Search::tried.
    void try_all() {
        Members usual = evidence_.base();
        usual.insert(usual.end(), evidence_.friction().begin(), evidence_.friction().end());
        for (std::size_t i = 0; i < model::kEffectCount; ++i) {
            if (contains(evidence_.base(), i) || evidence_.impossible(i)) continue;
            const auto gain = [&](Members beside, Tried& tried) {
                std::erase_if(beside, [&](const Candidate& candidate) { return candidate.effect == i; });
                const auto best = evidence_.best_point(i, beside, all_);
                if (!best || !evidence_.excited(best->candidate)) return 0.0;
                tried.unknowns = unknowns(best->candidate);
                return evidence_.rows() *
                       std::log(evidence_.fit(all_, beside, Spread::none).squares / best->squares);
            };
            Tried tried;
            tried.effect = i;
            tried.beside_friction = gain(usual, tried);
            tried.beside_found = gain(members_, tried);
            if (tried.unknowns > 0) result_.tried.push_back(tried);
        }
    }

    void note(const Members& members, std::size_t member, const Fit& f) {
        note_point(members, member, f, evidence_.dictionary().setting(), result_.points);
    }

    Evidence evidence_;
    const Sample& all_;
    Members members_;
    std::size_t base_members_ = 0;
    double closable_at_first_ = 0;  // beside friction
    std::map<std::size_t, double> probability_;
    Search result_;
};

}  // namespace

bool Search::may_be_denied(std::size_t effect) const {
    const Hypothesis& hypothesis = hypothesis_of(effect);
    return !hypothesis.in_every_drive_train && !hypothesis.late && !is_shown(effect);
}

std::vector<std::string> unknowable(const Fit& f, bool turning) {
    std::vector<std::string> names;
    // a gain is known once it is surely one: its error is written beside it
    constexpr double kClear = 3;  // of zero, standard errors
    const auto unknown = [&](Eigen::Index i, double scale) { return !(f.error(i) < scale); };
    if (!turning || unknown(0, 0.02)) names.emplace_back("K5");
    if (!turning || unknown(1, 0.5 * std::max(1.0, std::abs(f.value(1))))) names.emplace_back("K6");
    if (f.shape.held_gain[kLinear] || unknown(2, std::abs(f.value(2)) / kClear)) names.emplace_back("K7");
    if (!turning || unknown(3, std::abs(f.value(3)) / kClear)) names.emplace_back("K8");
    return names;
}

Search search(const BlockSet& train, const SearchOptions& options) { return Searcher(train, options).run(); }

}  // namespace wheelwright::gap
