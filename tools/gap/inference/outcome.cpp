#include "tools/gap/inference/outcome.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "tools/gap/gap_statistics.hpp"

namespace wheelwright::gap {
namespace {

bool is_special_case(std::size_t special, std::size_t general) {
    constexpr std::array<std::pair<std::string_view, std::string_view>, 2> kCases{
        {{"coulomb_friction", "stribeck_friction"}, {"torque_saturation", "back_emf_limit"}}};
    return std::any_of(kCases.begin(), kCases.end(), [&](const auto& c) {
        return model::kEffects[special].name == c.first && model::kEffects[general].name == c.second;
    });
}

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
    void add_friction_beside(const Way& mine, NamedEffect& named) const {
        const auto is_usual = [](std::size_t effect) {
            return std::find(kFrictions.begin(), kFrictions.end(), effect) != kFrictions.end();
        };
        if (!is_usual(mine.effect)) return;
        for (const Way& way : result_.friction) {
            if (contains(members_, way.effect)) continue;
            const Members more = with(members_, way);
            const Fit f = evidence_.fit(all_, more);
            if (!evidence_.in_range(all_, more, f)) continue;
            Fit most = f;  // that it may be
            most.covariance.resize(0, 0);
            const Eigen::Index at = first_amount_of(more, more.size() - 1);
            most.value(at) += kNormalQuantile * f.error(at);
            if (evidence_.effect_torque_share(more, more.size() - 1, most) < kSizeOfInterest) continue;
            std::erase_if(named.rivals, [&](const Rival& r) { return r.effect == way.effect; });
            std::erase_if(named.ruled_out, [&](const Rival& r) { return r.effect == way.effect; });
            Rival rival;
            rival.effect = way.effect;
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
            other[member] = evidence_.ways(members_[member].effect).back();
            if (other[member].amounts.size() != 2) return errors;
            const Fit f = evidence_.fit(all_, other);
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
            for (const Way& way : evidence_.ways(members_[member].effect)) {
                if (way.kind != Way::Kind::focus) continue;
                Members other = members_;
                other[member] = way;
                const Fit f = evidence_.fit(all_, other, Spread::left_out);
                beside.push_back(
                    {parameters_of(way, amounts_in(other, member, f), evidence_.dictionary().setting()).first,
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
            const auto other = std::find_if(with_rival.begin(), with_rival.end() - 1,
                                            [&](const Way& way) { return way.same_effect(members_[i]); });
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

    void find_rivals(const Members& fewer, const Way& mine, const Fit& bare, double with_all, double gain,
                     NamedEffect& named) {
        const Members mine_there = with(fewer, mine);
        const std::vector<double> mine_left = evidence_.left_out(all_, mine_there);
        for (std::size_t r = 0; r < model::kEffectCount; ++r) {
            if (r == mine.effect || contains(fewer, r) || evidence_.impossible(r)) continue;
            const std::optional<BestPoint> best = evidence_.best_point(r, fewer, all_);
            if (!best || !evidence_.excited(best->way)) continue;
            // as many unknowns as the one it would stand for
            const bool apart = mine.kind == Way::Kind::linear && !mine.together && best->way.together;
            const Way its = apart ? evidence_.ways(r).back() : best->way;
            const Members other = with(fewer, its);
            const Fit instead = evidence_.fit(all_, other, Spread::left_out);
            if (!evidence_.in_range(all_, other, instead)) continue;
            Rival rival;
            rival.effect = r;
            rival.keeps = gain > 0 ? 1 - (squares(all_.blocks, instead) - with_all) / gain : 0.0;
            // a general effect that does no better than its special case is that
            rival.alike = likeness(all_.blocks, bare, directions(mine), directions(its)) > kAlike ||
                          (is_special_case(mine.effect, r) && std::abs(rival.keeps - 1) < kTied / 5);
            const std::vector<Way> all = evidence_.ways(r);
            rival.coarse = evidence_.dictionary().can_focus(r) &&
                           std::all_of(all.begin(), all.end(),
                                       [](const Way& way) { return way.kind == Way::Kind::grid; });
            if (rival.keeps > 0.3)
                note_point(other, other.size() - 1, instead, evidence_.dictionary().setting(),
                           result_.points);
            auto [loss, here] =
                evidence_.compared({evidence_.left_out(all_, other), mine_left}, other, mine_there);
            rival.richer =
                unknowns(mine) < unknowns(its) && rival.keeps < kNoBetter && !surely_less(loss, here);
            for (std::size_t b = 0; b < loss.size(); ++b) loss[b] -= here[b];
            const bool told = evidence_.told_apart(mine_there, other);
            const bool worse = told || surely_positive(loss, kSignificance);
            const double trifle = told ? kTrifleOfGainForetold : kTrifleOfGain;
            const bool shown =
                std::find(result_.shown.begin(), result_.shown.end(), mine.effect) != result_.shown.end();
            if (!shown &&
                (rival.alike || (!worse && rival.keeps > 1 - 4 * kTied) || rival.keeps > 1 - trifle)) {
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

void judge(const Evidence& evidence, Search& found) {
    const bool much_left = (found.left_torque_share > evidence.options().large_gap &&
                            found.left_torque_share > 0.5 * found.closable_torque_share) ||
                           (!found.effects.empty() && found.left_torque_share > kSmallGap &&
                            found.left_torque_share > kShareLeft * found.closable_torque_share);
    const auto percent = [](double share) {
        return std::to_string(double(std::lround(1000 * share)) / 10.0).substr(0, 4) + " %";
    };
    if (found.effects.empty()) {
        const double beyond =
            evidence.options().white_noise ? beyond_noise_share(evidence.all().blocks, found.after) : 0.0;
        const double left = std::max(found.left_torque_share, beyond);
        if (much_left || beyond > evidence.options().large_gap) {
            found.verdict = Verdict::unexplained;
            found.reason = "a gap as large as " + percent(left) +
                           " of the torque is left that no effect of the catalogue explains";
        } else {
            found.verdict = Verdict::nothing_missing;
            found.reason = "what K5..K8 leave is no larger than " + percent(found.left_torque_share) +
                           " of the torque, and no effect explains it";
        }
        return;
    }
    for (const NamedEffect& e : found.effects) {
        for (const Rival& r : e.rivals) {
            if (r.alike || r.richer) continue;
            found.verdict = Verdict::cannot_tell;
            found.reason = "this log does not tell " + std::string(model::kEffects[e.effect].name) +
                           " from " + std::string(model::kEffects[r.effect].name);
            return;
        }
    }
    if (much_left) {
        found.verdict = Verdict::unexplained;
        found.reason = "the effects found leave most of the gap";
        return;
    }
    found.verdict = Verdict::named;
    found.reason =
        "each effect is significant on blocks that did not choose "
        "it, and closes its share of the gap";
}

void take_refined(Search& search, const Setting& setting) {
    for (NamedEffect& e : search.effects) {
        for (std::size_t i = search.base_members; i < search.members.size(); ++i) {
            if (search.members[i].effect != e.effect) continue;
            e.parameters = parameters_in(search.members, i, search.after, setting, search.blocks);
            widen(search.members[i], setting, e.unmoved, e.parameters);
        }
    }
}

}  // namespace wheelwright::gap
