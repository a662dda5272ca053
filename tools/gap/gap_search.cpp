#include "tools/gap/gap_search.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

namespace wheelwright::gap {
namespace {

constexpr Eigen::Index kFirstAmount = 4;
constexpr std::size_t kFolds = 5;
constexpr double kApart = 4;         // standard errors of the difference between left and right
constexpr double kUnexcited = 1e-4;  // power of a coordinate's column over that of the effect's strongest

// Where a model's amounts come from: an effect's coordinates, or the torque's
// timing.
Amount timing() { return {{kTiming}}; }

// Left and right of one kind, which are equal unless shown unequal: not those
// that may have either sign, but where nothing turns.
bool is_pair(std::size_t effect) {
    const auto& p = model::kEffects[effect].parameters;
    return p.size() == 2 && p[0].name.starts_with("left") && p[1].name.starts_with("right");
}

struct Member {
    std::size_t effect;
    bool together;
};

// Student's t, two-sided probability; by the series for whole degrees of
// freedom.
double t_probability(double t, double degrees) {
    const double angle = std::atan2(std::abs(t), std::sqrt(degrees));
    const auto n = static_cast<int>(degrees);
    double sum = 0;
    if (n % 2 == 1) {
        double term = std::cos(angle);
        for (int k = 1; k <= n - 2; k += 2) {
            sum += term;
            term *= std::cos(angle) * std::cos(angle) * (k + 1) / (k + 2);
        }
        sum = 2 / 3.14159265358979323846 * (angle + (n > 1 ? std::sin(angle) * sum : 0.0));
    } else {
        double term = 1;
        for (int k = 0; k <= n - 2; k += 2) {
            sum += term;
            term *= std::cos(angle) * std::cos(angle) * (k + 1) / (k + 2);
        }
        sum *= std::sin(angle);
    }
    return std::max(0.0, 1 - sum);
}

// One-sided Wilcoxon signed-rank probability that the values are not above zero
// (normal approximation, exact for few values).
double signed_rank_probability(std::vector<double> values) {
    std::sort(values.begin(), values.end(), [](double a, double b) { return std::abs(a) < std::abs(b); });
    const std::size_t n = values.size();
    if (n == 0) return 1;
    double positive = 0;
    for (std::size_t i = 0; i < n; ++i) {
        if (values[i] > 0) positive += double(i + 1);
    }
    // exact distribution of the sum of ranks
    const std::size_t most = n * (n + 1) / 2;
    std::vector<double> ways(most + 1, 0.0);
    ways[0] = 1;
    for (std::size_t rank = 1; rank <= n; ++rank) {
        for (std::size_t s = most; s >= rank; --s) ways[s] = (ways[s] + ways[s - rank]) / 2;
        for (std::size_t s = 0; s < rank; ++s) ways[s] /= 2;
    }
    double probability = 0;
    for (auto s = static_cast<std::size_t>(positive); s <= most; ++s) probability += ways[s];
    return probability;
}

class Searcher {
  public:
    Searcher(const BlockSet& train, const std::vector<Block>& report, const SearchOptions& options)
        : set_(train), options_(options) {
        for (const Block& b : train.blocks) all_.push_back(&b);
        for (const Block& b : report) report_.push_back(&b);
        // every fourth confirms; with few blocks the last one
        for (std::size_t i = 0; i < all_.size(); ++i) (i % 4 == 2 ? confirm_ : select_).push_back(all_[i]);
        for (std::size_t i = 0; i < model::kEffectCount; ++i) {
            if (options.base.active[i] && has_columns(i)) members_.push_back({i, must_be_together(i)});
        }
        base_members_ = members_.size();
    }

    Search run() {
        result_.base = fit(all_, shape_of(members_, options_.turning));
        rows_ = row_count(all_, result_.base.shape);
        result_.gap_refit = cross_validated(all_, members_) / rows_;
        result_.floor = floor_of(members_);
        result_.closable_torque_share = torque_share(result_.gap_refit - result_.floor, result_.base);
        find_places();
        find_detectable();
        forward();
        backward();
        result_.after = fit(all_, shape_of(members_, options_.turning));
        result_.gap_after = cross_validated(all_, members_) / rows_;
        // the floor again, from the fuller model: what both leave
        result_.floor = std::min({result_.floor, floor_of(members_), result_.gap_after});
        result_.left_torque_share = torque_share(result_.gap_after - result_.floor, result_.base);
        report_effects();
        report_closed();
        find_unknowable();
        judge();
        return result_;
    }

  private:
    // The amounts of one effect: one for each coordinate that the log excites, or
    // one for left and right together.
    std::vector<Amount> amounts_of(std::size_t effect, bool together) const {
        const auto [first, end] = columns_of(effect);
        std::vector<Amount> amounts;
        if (together) {
            Amount one;
            for (int c = first; c < end; ++c) one.columns.push_back(c);
            return {one};
        }
        double most = 0;
        for (int c = first; c < end; ++c) most = std::max(most, set_.wheel_power(c, c));
        for (int c = first; c < end; ++c) {
            if (set_.wheel_power(c, c) > kUnexcited * most) amounts.push_back({{c}});
        }
        if (amounts.empty()) amounts.push_back({{first}});
        return amounts;
    }

    bool may_be_together(std::size_t effect) const {
        return is_pair(effect) && (model::kEffects[effect].parameters[0].minimum >= 0 || !options_.turning);
    }
    bool must_be_together(std::size_t effect) const { return is_pair(effect) && !options_.turning; }

    ModelShape shape_of(const std::vector<Member>& members, bool turning) const {
        ModelShape shape;
        shape.turning = turning;
        shape.amounts.push_back(timing());
        for (const Member& m : members) {
            for (const Amount& a : amounts_of(m.effect, m.together)) shape.amounts.push_back(a);
        }
        return shape;
    }

    Blocks without(const Blocks& blocks, std::size_t fold) const {
        Blocks rest;
        for (std::size_t i = 0; i < blocks.size(); ++i) {
            if (i % kFolds != fold) rest.push_back(blocks[i]);
        }
        return rest;
    }

    // Squares of each block, left out of the fit.
    std::vector<double> left_out(const Blocks& blocks, const std::vector<Member>& members) const {
        std::vector<double> each(blocks.size());
        const ModelShape shape = shape_of(members, options_.turning);
        for (std::size_t fold = 0; fold < std::min(kFolds, blocks.size()); ++fold) {
            const Fit rest = fit(without(blocks, fold), shape);
            for (std::size_t i = fold; i < blocks.size(); i += kFolds) each[i] = squares(*blocks[i], rest);
        }
        return each;
    }
    double cross_validated(const Blocks& blocks, const std::vector<Member>& members) const {
        const std::vector<double> each = left_out(blocks, members);
        return std::accumulate(each.begin(), each.end(), 0.0);
    }

    double floor_of(const std::vector<Member>& members) const {
        std::vector<int> extra{kTiming};
        for (int c = kFirstEffect; c < static_cast<int>(columns().size()); ++c) extra.push_back(c);
        const double rich = reachable_squares(all_, shape_of(members, options_.turning), extra) / rows_;
        return std::min(rich, result_.gap_refit);
    }

    // A gap as the RMS of torque that would do the same, over the RMS of the
    // torque.
    double torque_share(double gap, const Fit& base) const {
        const double torque = torque_squares(all_, base) / rows_;
        return torque > 0 ? std::sqrt(std::max(0.0, gap) / torque) : 0.0;
    }

    static bool has_columns(std::size_t effect) {
        const auto [first, end] = columns_of(effect);
        return first < end;
    }

    bool usable(std::size_t effect) const {
        if (!has_columns(effect)) return false;
        for (const Member& m : members_) {
            if (m.effect == effect) return false;
        }
        // an effect of which this log holds next to nothing
        const Fit& base = result_.base;
        return likeness(all_, base, amounts_of(effect, false), {}) < 1 && column_excited(effect);
    }

    bool column_excited(std::size_t effect) const {
        const auto [first, end] = columns_of(effect);
        for (int c = first; c < end; ++c) {
            if (set_.wheel_power(c, c) > 0) return true;
        }
        return false;
    }

    double effect_torque_share(const Fit& f, std::size_t first_amount,
                               const std::vector<Amount>& amounts) const {
        Eigen::VectorXd p = Eigen::VectorXd::Zero(set_.wheel_power.cols());
        for (std::size_t i = 0; i < amounts.size(); ++i) {
            for (const int c : amounts[i].columns)
                p(c) = f.value(kFirstAmount + Eigen::Index(first_amount + i));
        }
        return std::sqrt(std::max(0.0, p.dot(set_.wheel_power * p))) / std::max(1e-12, set_.torque_rms_Nm);
    }

    struct Trial {
        Member member{};
        double gain = 0;  // held-out, on the blocks that select
        double probability = 1, rank_probability = 1;
        bool confirmed = false, of_interest = false, in_range = true;
    };

    // Within its physical range: a friction that drives is none.
    bool in_range(const Fit& f, std::size_t first_amount, const Member& m) const {
        const std::vector<Amount> amounts = amounts_of(m.effect, m.together);
        const auto& info = model::kEffects[m.effect].parameters;
        if (model::kLinearInParameters[m.effect]) {
            for (std::size_t i = 0; i < amounts.size(); ++i) {
                const Eigen::Index at = kFirstAmount + Eigen::Index(first_amount + i);
                const double slack = 3 * f.error(at);
                if (f.value(at) < info[i].minimum - slack || f.value(at) > info[i].maximum + slack)
                    return false;
            }
        }
        return true;
    }

    static double wald_probability(const Fit& f, std::size_t first_amount, std::size_t count,
                                   std::size_t blocks) {
        // Hotelling's test of all amounts together
        const auto n = Eigen::Index(count);
        const Eigen::Index at = kFirstAmount + Eigen::Index(first_amount);
        const Eigen::MatrixXd cov = f.covariance.block(at, at, n, n);
        const Eigen::VectorXd p = f.value.segment(at, n);
        const double degrees = std::max(1.0, double(blocks) - 4 - double(count));
        if (n == 1) return t_probability(p(0) / std::sqrt(std::max(1e-300, cov(0, 0))), degrees);
        // scaled to unit variances, for left and right may be known as a sum only
        const Eigen::VectorXd scale = cov.diagonal().cwiseSqrt().cwiseMax(1e-300).cwiseInverse();
        const Eigen::MatrixXd correlation = scale.asDiagonal() * cov * scale.asDiagonal();
        const Eigen::VectorXd z = scale.cwiseProduct(p);
        const double square = z.dot((correlation + 1e-9 * Eigen::MatrixXd::Identity(n, n)).ldlt().solve(z));
        // two of them: the F distribution has a closed form; more: as if there were
        // two, times their number
        return std::min(1.0, double(n) / 2 * std::pow(1 + square / degrees, -degrees / 2));
    }

    Trial attempt(std::size_t effect) const {
        Trial best;
        for (const bool together : {true, false}) {
            if (together ? !may_be_together(effect) : must_be_together(effect)) continue;
            Trial t;
            t.member = {effect, together};
            std::vector<Member> more = members_;
            more.push_back(t.member);
            const ModelShape shape = shape_of(more, options_.turning);
            const std::size_t count = amounts_of(effect, together).size();
            const std::size_t first = shape.amounts.size() - count;
            const std::vector<double> before = left_out(select_, members_);
            const std::vector<double> after = left_out(select_, more);
            std::vector<double> gain(before.size());
            for (std::size_t i = 0; i < gain.size(); ++i) gain[i] = before[i] - after[i];
            t.gain = std::accumulate(gain.begin(), gain.end(), 0.0);
            t.rank_probability = signed_rank_probability(gain);
            const Fit selected = fit(select_, shape);
            t.probability = wald_probability(selected, first, count, select_.size());
            t.in_range = in_range(selected, first, t.member);
            t.of_interest = effect_torque_share(selected, first,
                                                {shape.amounts.begin() + std::ptrdiff_t(first),
                                                 shape.amounts.end()}) >= kSizeOfInterest;
            const Fit without_it = fit(select_, shape_of(members_, options_.turning));
            const double unconfirmed = squares(confirm_, without_it);
            const double confirm_gain = unconfirmed - squares(confirm_, selected);
            const double share = t.gain / std::accumulate(before.begin(), before.end(), 0.0);
            t.confirmed = confirm_.empty() || (confirm_gain > 0 && confirm_gain > share * unconfirmed / 3);
            // one amount for both unless two are clearly apart
            const auto apart = [&] {
                const Eigen::Index at = kFirstAmount + Eigen::Index(first);
                const double variance = selected.covariance(at, at) + selected.covariance(at + 1, at + 1) -
                                        2 * selected.covariance(at, at + 1);
                return std::abs(selected.value(at) - selected.value(at + 1)) >
                       kApart * std::sqrt(std::max(0.0, variance));
            };
            if (best.gain == 0 || (t.gain > best.gain && apart())) best = t;
        }
        return best;
    }

    // Among those that do the same in every motion of this log: linear in its
    // parameters first, then the catalogue's order.
    const Trial* simplest_equal(const std::vector<Trial>& trials, const Trial& chosen) const {
        const Trial* best = &chosen;
        const Fit bare = fit(all_, shape_of(members_, options_.turning));
        for (const Trial& t : trials) {
            if (!t.in_range || t.gain < 0.9 * chosen.gain) continue;
            const auto rank = [](const Trial& x) {
                return std::pair{!model::kLinearInParameters[x.member.effect], x.member.effect};
            };
            if (rank(t) < rank(*best) &&
                likeness(all_, bare, amounts_of(chosen.member.effect, chosen.member.together),
                         amounts_of(t.member.effect, t.member.together)) > kAlike) {
                best = &t;
            }
        }
        return best;
    }

    void forward() {
        while (members_.size() - base_members_ < kMostEffects) {
            const double now = cross_validated(select_, members_);
            std::vector<int> extra{kTiming};
            for (int c = kFirstEffect; c < static_cast<int>(columns().size()); ++c) extra.push_back(c);
            const double reach =
                std::min(now, reachable_squares(select_, shape_of(members_, options_.turning), extra));
            const double closable = now - reach;
            std::vector<Trial> trials;
            for (std::size_t i = 0; i < model::kEffectCount; ++i) {
                if (usable(i)) trials.push_back(attempt(i));
            }
            if (trials.empty()) break;
            std::sort(trials.begin(), trials.end(),
                      [](const Trial& a, const Trial& b) { return a.gain > b.gain; });
            const Trial* chosen = nullptr;
            for (const Trial& t : trials) {
                const bool significant =
                    t.probability <= kSignificance / double(trials.size()) &&
                    t.rank_probability <=
                        std::max(kSignificance, std::pow(0.5, double(select_.size())) * 1.001);
                if (significant && t.in_range && t.of_interest && t.confirmed && t.gain > 0 &&
                    t.gain >= kLeastShareOfClosable * closable) {
                    chosen = &t;
                    break;
                }
            }
            if (chosen == nullptr) break;
            chosen = simplest_equal(trials, *chosen);
            gains_[chosen->member.effect] = {chosen->gain, chosen->probability};
            members_.push_back(chosen->member);
        }
    }

    // What the effects found later made superfluous goes.
    void backward() {
        for (std::size_t i = base_members_; i < members_.size();) {
            std::vector<Member> fewer = members_;
            fewer.erase(fewer.begin() + std::ptrdiff_t(i));
            const Fit f = fit(all_, shape_of(members_, options_.turning));
            const std::size_t first = first_amount_of(i);
            const std::vector<Amount> amounts = amounts_of(members_[i].effect, members_[i].together);
            if (wald_probability(f, first, amounts.size(), all_.size()) <= kSignificance &&
                effect_torque_share(f, first, amounts) >= kSizeOfInterest) {
                ++i;
            } else {
                members_ = fewer;
            }
        }
    }

    std::size_t first_amount_of(std::size_t member) const {
        std::size_t at = 1;
        for (std::size_t i = 0; i < member; ++i)
            at += amounts_of(members_[i].effect, members_[i].together).size();
        return at;
    }

    void report_effects() {
        const double closable = std::max(1e-12, (result_.gap_refit - result_.floor) * rows_);
        const double with = squares(all_, result_.after);
        for (std::size_t i = base_members_; i < members_.size(); ++i) {
            const Member m = members_[i];
            NamedEffect named;
            named.effect = m.effect;
            const std::size_t first = first_amount_of(i);
            const std::vector<Amount> amounts = amounts_of(m.effect, m.together);
            named.torque_share = effect_torque_share(result_.after, first, amounts);
            named.probability = gains_[m.effect].second;
            named.parameters = parameters_of(result_.after, first, m);
            std::vector<Member> fewer = members_;
            fewer.erase(fewer.begin() + std::ptrdiff_t(i));
            const Fit bare = fit(all_, shape_of(fewer, options_.turning));
            const double gain = squares(all_, bare) - with;
            named.closes = std::clamp(
                (cross_validated(all_, fewer) / rows_ - result_.gap_after) * rows_ / closable, 0.0, 1.0);
            find_rivals(fewer, m, bare, with, gain, named);
            result_.effects.push_back(named);
        }
        std::sort(result_.effects.begin(), result_.effects.end(),
                  [](const NamedEffect& a, const NamedEffect& b) { return a.closes > b.closes; });
    }

    void find_rivals(const std::vector<Member>& fewer, const Member& m, const Fit& bare, double with,
                     double gain, NamedEffect& named) const {
        const std::vector<Amount> wanted = amounts_of(m.effect, m.together);
        const std::vector<double> mine = [&] {
            std::vector<Member> more = fewer;
            more.push_back(m);
            return left_out(all_, more);
        }();
        for (std::size_t r = 0; r < model::kEffectCount; ++r) {
            if (r == m.effect || !column_excited(r)) continue;
            if (std::any_of(fewer.begin(), fewer.end(), [&](const Member& o) { return o.effect == r; }))
                continue;
            const bool together = must_be_together(r) || (m.together && may_be_together(r));
            std::vector<Member> other = fewer;
            other.push_back({r, together});
            const Fit instead = fit(all_, shape_of(other, options_.turning));
            const std::size_t first = instead.shape.amounts.size() - amounts_of(r, together).size();
            if (!in_range(instead, first, {r, together})) continue;
            Rival rival;
            rival.effect = r;
            rival.keeps = gain > 0 ? 1 - (squares(all_, instead) - with) / gain : 0.0;
            rival.alike = likeness(all_, bare, wanted, amounts_of(r, together)) > kAlike;
            std::vector<double> loss = left_out(all_, other);
            for (std::size_t b = 0; b < loss.size(); ++b) loss[b] -= mine[b];
            const bool worse = signed_rank_probability(loss) <= 0.05;
            if (rival.alike || (!worse && rival.keeps > 1 - 4 * kTied) || rival.keeps > 1 - kTied / 5) {
                named.rivals.push_back(rival);
            } else {
                named.ruled_out.push_back(rival);
            }
        }
    }

    std::vector<ParameterEstimate> parameters_of(const Fit& f, std::size_t first, const Member& m) const {
        const auto& info = model::kEffects[m.effect].parameters;
        const std::vector<Amount> amounts = amounts_of(m.effect, m.together);
        const std::size_t count = amounts.size();
        const Eigen::Index at = kFirstAmount + Eigen::Index(first);
        const double degrees = std::max(1.0, double(all_.size()) - 4);
        const double quantile = 1.96 + 2.4 / degrees + 3.0 / (degrees * degrees);
        std::vector<ParameterEstimate> estimates;
        const auto value_at = [&](const Eigen::VectorXd& amount) {
            model::Parameters<double> c{};
            for (std::size_t j = 0; j < info.size(); ++j)
                c[j] = amount(Eigen::Index(m.together ? 0 : std::min(j, count - 1)));
            model::Parameters<double> p = c;
            std::array<bool, model::kEffectCount> one{};
            one[m.effect] = true;
            model::for_each_active(one, [&]<typename Effect>(std::size_t) {
                if constexpr (model::HasOwnCoordinates<Effect>) p = Effect::from_coordinates(c);
            });
            return p;
        };
        const Eigen::VectorXd amount = f.value.segment(at, Eigen::Index(count));
        const Eigen::MatrixXd cov = f.covariance.block(at, at, Eigen::Index(count), Eigen::Index(count));
        const model::Parameters<double> p = value_at(amount);
        for (std::size_t j = 0; j < info.size(); ++j) {
            Eigen::VectorXd slope(count);
            for (std::size_t k = 0; k < count; ++k) {
                Eigen::VectorXd moved = amount;
                const double step = 1e-4 * std::max(1e-9, std::sqrt(cov(Eigen::Index(k), Eigen::Index(k))));
                moved(Eigen::Index(k)) += step;
                slope(Eigen::Index(k)) = (value_at(moved)[j] - p[j]) / step;
            }
            ParameterEstimate e;
            e.value = std::clamp(p[j], info[j].minimum, info[j].maximum);
            e.standard_error = std::sqrt(std::max(0.0, slope.dot(cov * slope)));
            e.known = e.standard_error > 0;  // a direction that the log does not show moves nothing
            e.interval_95 = {p[j] - quantile * e.standard_error, p[j] + quantile * e.standard_error};
            estimates.push_back(e);
        }
        return estimates;
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

    void find_places() {
        const ModelShape shape = shape_of(members_, options_.turning);
        std::map<std::string, std::vector<int>> places;
        const auto [first, end] = rich_columns();
        for (int c = first; c < end; ++c) places[std::string(columns()[std::size_t(c)].place)].push_back(c);
        const double closable = (result_.gap_refit - result_.floor) * rows_;
        for (auto& [name, group] : places) {
            group.push_back(kTiming);
            const double left = reachable_squares(all_, shape, group);
            const double share = closable > 0 ? (result_.gap_refit * rows_ - left) / closable : 0.0;
            if (share > 0.02) result_.where.push_back({name, std::min(1.0, share)});
        }
        std::sort(result_.where.begin(), result_.where.end(),
                  [](const Place& a, const Place& b) { return a.explains > b.explains; });
    }

    // The smallest size that this log could have shown: as certain as the
    // acceptance asks, and of interest.
    void find_detectable() {
        for (std::size_t i = 0; i < model::kEffectCount; ++i) {
            Detectable d;
            d.effect = i;
            if (!has_columns(i)) continue;
            std::vector<Member> more = members_;
            if (std::any_of(more.begin(), more.end(), [&](const Member& m) { return m.effect == i; }))
                continue;
            const bool together = may_be_together(i);
            more.push_back({i, together});
            const ModelShape shape = shape_of(more, options_.turning);
            const Fit f = fit(all_, shape);
            const std::vector<Amount> amounts = amounts_of(i, together);
            const std::size_t first = shape.amounts.size() - amounts.size();
            for (std::size_t j = 0;
                 j < model::kEffects[i].parameters.size() && j < std::max<std::size_t>(amounts.size(), 2);
                 ++j) {
                const std::size_t k = std::min(j, amounts.size() - 1);
                double power = 0;
                for (const int c : amounts[k].columns) {
                    for (const int c2 : amounts[k].columns) power += set_.wheel_power(c, c2);
                }
                const double interest = power > 0 ? kSizeOfInterest * set_.torque_rms_Nm / std::sqrt(power)
                                                  : std::numeric_limits<double>::infinity();
                const bool excited = power > 0 && likeness(all_, result_.base, {amounts[k]}, {}) < 1;
                d.size.push_back(
                    excited ? std::max(interest, 4.5 * f.error(kFirstAmount + Eigen::Index(first + k)))
                            : std::numeric_limits<double>::infinity());
            }
            result_.detectable.push_back(d);
        }
    }

    void find_unknowable() {
        const Fit& f = result_.after;
        const std::array<const char*, 4> names{"K5", "K6", "K7", "K8"};
        const auto unknown = [&](Eigen::Index i, double scale) { return !(f.error(i) < scale); };
        if (unknown(0, 0.02)) result_.unknowable.emplace_back(names[0]);
        if (!options_.turning || unknown(1, 0.5 * std::max(1.0, std::abs(f.value(1)))))
            result_.unknowable.emplace_back(names[1]);
        if (unknown(2, 0.2 * std::abs(f.value(2)))) result_.unknowable.emplace_back(names[2]);
        if (!options_.turning || unknown(3, 0.2 * std::abs(f.value(3))))
            result_.unknowable.emplace_back(names[3]);
        const Eigen::Index timing_at = kFirstAmount;
        result_.timing_samples = f.value(timing_at);
        result_.timing_error = f.error(timing_at);
    }

    void judge() {
        const bool much_left = result_.left_torque_share > kLargeGap &&
                               result_.left_torque_share > 0.5 * result_.closable_torque_share;
        const auto percent = [](double share) {
            return std::to_string(double(std::lround(1000 * share)) / 10.0).substr(0, 4) + " %";
        };
        if (result_.effects.empty()) {
            if (much_left) {
                result_.verdict = Verdict::unexplained;
                result_.reason = "a gap as large as " + percent(result_.left_torque_share) +
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
                if (r.alike) continue;
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
    Blocks all_, select_, confirm_, report_;
    std::vector<Member> members_;
    std::size_t base_members_ = 0;
    double rows_ = 1;
    std::map<std::size_t, std::pair<double, double>> gains_;
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

model::EffectSet<double> effects_of(const Fit& f) {
    model::EffectSet<double> set;
    std::array<model::Parameters<double>, model::kEffectCount> coordinates{};
    for (std::size_t a = 0; a < f.shape.amounts.size(); ++a) {
        for (const int c : f.shape.amounts[a].columns) {
            const ColumnName& name = columns()[std::size_t(c)];
            if (name.effect == model::kEffectCount) continue;
            set.active[name.effect] = true;
            coordinates[name.effect][name.coordinate] = f.value(kFirstAmount + Eigen::Index(a));
        }
    }
    model::for_each_active(set.active, [&]<typename Effect>(std::size_t i) {
        if constexpr (model::HasOwnCoordinates<Effect>) {
            set.parameter[i] = Effect::from_coordinates(coordinates[i]);
        } else {
            set.parameter[i] = coordinates[i];
        }
        for (std::size_t j = 0; j < Effect::parameters.size(); ++j) {
            set.parameter[i][j] =
                std::clamp(set.parameter[i][j], Effect::parameters[j].minimum, Effect::parameters[j].maximum);
        }
    });
    return set;
}

Search search(const BlockSet& train, const std::vector<Block>& report, const SearchOptions& options) {
    return Searcher(train, report, options).run();
}

}  // namespace wheelwright::gap
