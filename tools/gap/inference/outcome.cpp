#include "tools/gap/inference/outcome.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "tools/gap/hypotheses/hypotheses.hpp"
#include "tools/gap/inference/statistics.hpp"

namespace wheelwright::gap {
namespace {

// Share of the gain, kept by a rival with more unknowns, that is chance.
constexpr double kNoBetter = 1.005;

class Outcome {
  public:
    Outcome(const Evidence& evidence, const std::map<std::size_t, double>& probability, Search& result)
        : evidence_(evidence),
          all_(evidence.all()),
          probability_(probability),
          members_(result.members),
          base_members_(result.base_members),
          result_(result) {}

    void report_effects() {
        const double closable = std::max(1e-12, (result_.gap_refit - result_.floor) * evidence_.rows());
        const double with_all = squares(all_.blocks, result_.after);
        for (std::size_t i = base_members_; i < members_.size(); ++i) {
            NamedEffect named;
            named.effect = members_[i].effect;
            named.torque_share = evidence_.effect_torque_share(members_, i, result_.after);
            named.probability = probability_.at(named.effect);
            named.parameters =
                parameters_in(members_, i, result_.after, evidence_.dictionary().setting(), all_.size());
            named.unmoved = unmoved_by(i);
            widen(members_[i], evidence_.dictionary().setting(), named.unmoved, named.parameters);
            const Members fewer = without(members_, i);
            const Fit bare = evidence_.fit(all_, fewer);
            named.closes =
                std::clamp((evidence_.cross_validated(all_, fewer) / evidence_.rows() - result_.gap_after) *
                               evidence_.rows() / closable,
                           0.0, 1.0);
            find_rivals(fewer, members_[i], bare, with_all, squares(all_.blocks, bare) - with_all, named);
            add_friction_beside(members_[i], named);
            result_.effects.push_back(named);
        }
        std::sort(result_.effects.begin(), result_.effects.end(),
                  [](const NamedEffect& a, const NamedEffect& b) { return a.closes > b.closes; });
    }

  private:
    // The other friction, which this log leaves open: how much of the drag is dry it does not tell.
    void add_friction_beside(const Candidate& mine, NamedEffect& named) const {
        if (!hypothesis_of(mine.effect).in_every_drive_train) return;
        for (const Candidate& candidate : result_.friction) {
            if (contains(members_, candidate.effect)) continue;
            const Members more = with(members_, candidate);
            const Fit f = evidence_.fit(all_, more);
            if (!evidence_.in_range(all_, more, f)) continue;
            Fit most = f;  // that it may be
            most.covariance.resize(0, 0);
            const Eigen::Index at = first_amount_of(more, more.size() - 1);
            most.value(at) += kNormalQuantile * f.error(at);
            if (evidence_.effect_torque_share(more, more.size() - 1, most) < kPolicy.effect) continue;
            std::erase_if(named.rivals, [&](const Rival& r) { return r.effect == candidate.effect; });
            std::erase_if(named.ruled_out, [&](const Rival& r) { return r.effect == candidate.effect; });
            Rival rival;
            rival.effect = candidate.effect;
            rival.richer = true;
            rival.keeps = 1;
            named.rivals.push_back(rival);
        }
    }

    // NamedEffect::unmoved.
    std::vector<double> unmoved_by(std::size_t member) const {
        std::vector<double> errors(model::kEffects[members_[member].effect].parameters.size(), 0.0);
        // Straight, the wheels' sum is all that is told. Friction of two like drives differs so much at
        // times.
        constexpr double kUnlike = 0.1;
        if (members_[member].together && !evidence_.options().turning)
            errors[0] = errors[1] =
                kUnlike * std::abs(result_.after.value(first_amount_of(members_, member)));
        if (members_[member].together && evidence_.options().turning) {
            // left and right that share an amount may differ by what is not clear yet
            Members other = members_;
            other[member] = evidence_.candidates(members_[member].effect).back();
            if (other[member].amounts.size() != 2) return errors;
            const Fit f = evidence_.fit(all_, other);
            const Eigen::Index at = first_amount_of(other, member);
            errors[0] = errors[1] =
                std::sqrt(std::pow(f.value(at) - f.value(at + 1), 2) + difference_variance(f, at)) / 2;
        }
        if (members_[member].kind == Candidate::Kind::linearised) {
            // points beside the one chosen, by how likely they are
            struct Beside {
                model::Parameters<double> p;
                double squares;
            };
            std::vector<Beside> beside;
            for (const Candidate& candidate : evidence_.candidates(members_[member].effect)) {
                if (candidate.kind != Candidate::Kind::linearised) continue;
                Members other = members_;
                other[member] = candidate;
                const Fit f = evidence_.fit(all_, other, Spread::none);
                beside.push_back(
                    {parameters_of(candidate, amounts_in(other, member, f), evidence_.dictionary().setting())
                         .first,
                     f.squares});
            }
            const auto best =
                std::min_element(beside.begin(), beside.end(),
                                 [](const Beside& a, const Beside& b) { return a.squares < b.squares; });
            const double level = best->squares / evidence_.rows();
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

    // Search::moved_by_rivals: of a fit with a rival, the last of its members.
    Eigen::VectorXd moved_by(const Members& with_rival, const Fit& instead) const {
        const Fit& mine = result_.after;
        Eigen::VectorXd moved = Eigen::VectorXd::Zero(mine.value.size());
        moved.head(kFirstAmount) = instead.value.head(kFirstAmount) - mine.value.head(kFirstAmount);
        for (std::size_t i = 0; i < members_.size(); ++i) {
            const auto other = std::find_if(
                with_rival.begin(), with_rival.end() - 1,
                [&](const Candidate& candidate) { return candidate.effect == members_[i].effect; });
            if (other == with_rival.end() - 1) continue;
            const auto count = Eigen::Index(members_[i].amounts.size());
            const Eigen::Index at = first_amount_of(members_, i);
            moved.segment(at, count) =
                instead.value.segment(first_amount_of(with_rival, std::size_t(other - with_rival.begin())),
                                      count) -
                mine.value.segment(at, count);
        }
        return moved;
    }

    void find_rivals(const Members& fewer, const Candidate& mine, const Fit& bare, double with_all,
                     double gain, NamedEffect& named) {
        const Members mine_there = with(fewer, mine);
        const std::vector<double> mine_squares = evidence_.squares_left_out(all_, mine_there);
        for (std::size_t r = 0; r < model::kEffectCount; ++r) {
            if (r == mine.effect || contains(fewer, r) || evidence_.impossible(r)) continue;
            const std::optional<BestPoint> best = evidence_.best_point(r, fewer, all_);
            if (!best || !evidence_.excited(best->candidate)) continue;
            // as many unknowns as the one it would stand for
            const bool apart =
                mine.kind == Candidate::Kind::linear && !mine.together && best->candidate.together;
            const Candidate its = apart ? evidence_.candidates(r).back() : best->candidate;
            const Members other = with(fewer, its);
            const Fit instead = evidence_.fit(all_, other, Spread::none);
            if (!evidence_.in_range(all_, other, instead)) continue;
            Rival rival;
            rival.effect = r;
            rival.keeps = gain > 0 ? 1 - (squares(all_.blocks, instead) - with_all) / gain : 0.0;
            // a general effect that does no better than its special case is that
            rival.confounded = likeness(all_.blocks, bare, directions(mine), directions(its)) > kConfounded ||
                               (hypothesis_of(mine.effect).special_case_of == r &&
                                std::abs(rival.keeps - 1) < kPolicy.better_by);
            const std::vector<Candidate> all = evidence_.candidates(r);
            rival.coarse = evidence_.dictionary().can_linearise(r) &&
                           std::all_of(all.begin(), all.end(), [](const Candidate& candidate) {
                               return candidate.kind == Candidate::Kind::start;
                           });
            if (rival.keeps > 0.3)
                note_point(other, other.size() - 1, instead, evidence_.dictionary().setting(),
                           result_.points);
            auto [loss, here] = evidence_.compared({evidence_.squares_left_out(all_, other), mine_squares},
                                                   other, mine_there);
            rival.richer =
                unknowns(mine) < unknowns(its) && rival.keeps < kNoBetter && !surely_less(loss, here);
            for (std::size_t b = 0; b < loss.size(); ++b) loss[b] -= here[b];
            const bool worse =
                evidence_.distinguishes(mine_there, other) || surely_positive(loss, kPolicy.false_alarm);
            if (!result_.is_shown(mine.effect) &&
                (rival.confounded || (!worse && rival.keeps > 1 - kPolicy.share_of_gap))) {
                named.rivals.push_back(rival);
                result_.moved_by_rivals.push_back(moved_by(other, instead));
            } else {
                named.ruled_out.push_back(rival);
            }
        }
    }

    const Evidence& evidence_;
    const Sample& all_;
    const std::map<std::size_t, double>& probability_;
    const Members& members_;
    std::size_t base_members_ = 0;
    Search& result_;
};

}  // namespace

void describe_effects(const Evidence& evidence, const std::map<std::size_t, double>& probability,
                      Search& found) {
    Outcome(evidence, probability, found).report_effects();
}

double closed_share(const Blocks& held_out, const Search& found) {
    if (held_out.empty()) {
        const double closable = found.gap_refit - found.floor;
        return closable > 0 ? (found.gap_refit - found.gap_after) / closable : 0.0;
    }
    const double rows = row_count(held_out, found.base.shape);
    const double before = squares(held_out, found.base) / rows;
    const double after = squares(held_out, found.after) / rows;
    const double closable = before - found.floor;
    return closable > 0 ? std::clamp((before - after) / closable, -1.0, 1.0) : 0.0;
}

std::vector<NamedEffect> described_anew(const Search& search, const Setting& setting) {
    std::vector<NamedEffect> effects = search.effects;
    for (NamedEffect& e : effects) {
        for (std::size_t i = search.base_members; i < search.members.size(); ++i) {
            if (search.members[i].effect != e.effect) continue;
            e.parameters = parameters_in(search.members, i, search.after, setting, search.blocks);
            widen(search.members[i], setting, e.unmoved, e.parameters);
        }
    }
    return effects;
}

}  // namespace wheelwright::gap
