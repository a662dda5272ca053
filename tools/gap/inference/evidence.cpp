#include "tools/gap/inference/evidence.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "tools/gap/hypotheses/hypotheses.hpp"
#include "tools/gap/inference/statistics.hpp"
#include "tools/gap/model/rows.hpp"

namespace wheelwright::gap {
namespace {

// Left and right get an amount each from so many standard errors of their difference on.
constexpr double kApart = 4;
// Power of a coordinate's column over that of the effect's strongest: less of it is not in the log.
constexpr double kUnexcited = 1e-4;
// Share of the squares at where an effect was linearised that a starting point must leave to be preferred.
constexpr double kCloser = 0.98;
// Blocks that models are compared on, at least: fewer would have to agree in all their ranks.
constexpr std::size_t kFewestParting = 8;
// Squares by which they are apart in a block, over those where they are most, from which on it is one of
// them.
constexpr double kParting = 0.02;

// Left and right of one kind, which are equal unless shown unequal: not those
// that may have either sign, but where nothing turns.
bool is_pair(std::size_t effect) {
    const auto& p = model::kEffects[effect].parameters;
    return p.size() == 2 && p[0].name.starts_with("left") && p[1].name.starts_with("right");
}

// The blocks in which two models foretell something different, from the squares by which they are apart.
std::vector<std::size_t> parting(const std::vector<double>& apart) {
    std::vector<std::size_t> order(apart.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::sort(order.begin(), order.end(), [&](std::size_t i, std::size_t j) { return apart[i] > apart[j]; });
    std::size_t some = std::min(kFewestParting, order.size());
    while (some < order.size() && apart[order[some]] >= kParting * apart[order.front()]) ++some;
    order.resize(some);
    return order;
}

void add(const Block& block, Block& sum) {
    for (std::size_t e = 0; e < kEquations; ++e) {
        sum.rows[e] += block.rows[e];
        if (sum.product[e].size() == 0) {
            sum.product[e] = block.product[e];
        } else {
            sum.product[e] += block.product[e];
        }
    }
}

LeftOut left_out_of(const Sample& sample, std::vector<Fit> rest) {
    LeftOut made{std::move(rest), {}};
    for (std::size_t i = 0; i < sample.size(); ++i)
        made.squares.push_back(squares(*sample.blocks[i], made.rest[i % kFolds]));
    return made;
}

}  // namespace

Fit fit_beside_friction(const Blocks& blocks, ModelShape shape, const std::vector<Amount>& frictions) {
    const auto others = static_cast<std::ptrdiff_t>(shape.amounts.size());
    shape.amounts.insert(shape.amounts.end(), frictions.begin(), frictions.end());
    for (;;) {
        const Fit f = fit(blocks, shape);
        Eigen::Index least = 0;
        const auto count = f.value.size() - kFirstAmount - others;
        if (count == 0 || f.value.tail(count).minCoeff(&least) >= 0) return f;
        shape.amounts.erase(shape.amounts.begin() + others + least);
    }
}

std::vector<ParameterEstimate> parameters_in(const Members& members, std::size_t member, const Fit& f,
                                             const Setting& setting, std::size_t blocks) {
    const Eigen::VectorXd amounts = amounts_in(members, member, f);
    const Eigen::Index at = first_amount_of(members, member);
    return estimates_of(members[member], amounts, f.covariance.block(at, at, amounts.size(), amounts.size()),
                        setting, blocks);
}

double probability_of_none(const Candidate& candidate, const Eigen::VectorXd& amounts,
                           const Eigen::MatrixXd& covariance, double degrees, const Setting& setting) {
    const double either = wald_probability(amounts, covariance, degrees);
    if (amounts.size() > 1 || may_be_negative(candidate, setting)) return either;
    return amounts(0) > 0 ? either / 2 : 1 - either / 2;
}

bool apart(const Fit& f, Eigen::Index at) {
    return std::abs(f.value(at) - f.value(at + 1)) > kApart * std::sqrt(difference_variance(f, at));
}

double difference_variance(const Fit& f, Eigen::Index at) {
    return std::max(0.0, f.covariance(at, at) + f.covariance(at + 1, at + 1) - 2 * f.covariance(at, at + 1));
}

std::vector<double> agreement(const Sample& sample, const LeftOut& first, const LeftOut& second) {
    std::vector<double> agrees;
    for (std::size_t i = 0; i < sample.size(); ++i) {
        const double apart =
            squares_apart(*sample.blocks[i], first.rest[i % kFolds], second.rest[i % kFolds]);
        agrees.push_back((first.squares[i] - second.squares[i] + apart) / 2);
    }
    return agrees;
}

bool surely_less(const std::vector<double>& first, const std::vector<double>& second) {
    std::vector<double> gain(first.size());
    for (std::size_t b = 0; b < first.size(); ++b) gain[b] = second[b] - first[b];
    const double sum = std::accumulate(gain.begin(), gain.end(), 0.0);
    const double of = std::accumulate(first.begin(), first.end(), 0.0);
    return sum > kPolicy.better_by * of && surely_positive(gain, kPolicy.false_alarm);
}

double least_share(const Members& members, const Candidate& candidate) {
    const bool usual = hypothesis_of(candidate.effect).in_every_drive_train;
    return members.size() > 1 && !usual ? kPolicy.effect : kPolicy.effect_alone;
}

void note_point(const Members& members, std::size_t member, const Fit& f, const Setting& setting,
                Points& points) {
    const Candidate& candidate = members[member];
    if (candidate.kind == Candidate::Kind::linear) return;
    points[candidate.effect] = parameters_within_range(candidate, amounts_in(members, member, f), setting);
}

Sample::Sample(Blocks of) : blocks(std::move(of)), rest(std::min(kFolds, blocks.size())) {
    for (std::size_t i = 0; i < blocks.size(); ++i) {
        add(*blocks[i], whole);
        add(*blocks[i], rest[i % kFolds]);
    }
    for (Block& fold : rest) {
        for (std::size_t e = 0; e < kEquations; ++e) {
            fold.product[e] = whole.product[e] - fold.product[e];
            fold.rows[e] = whole.rows[e] - fold.rows[e];
        }
    }
}

Evidence::Evidence(const BlockSet& train, const SearchOptions& options)
    : set_(train), options_(options), all_(pointers(train)) {
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (!options.base.active[i] && !options.given.contains(i)) continue;
        const std::vector<Candidate> all = candidates(i);
        if (all.empty()) continue;
        base_.push_back(all.back());  // the linearised one is the last
        if (!options.given.contains(i)) continue;
        base_.back().amounts.clear();
        base_.back().free.clear();
    }
    base_fit_ = usual_fit_ = fit(all_, base_);
    std::vector<Amount> amounts;
    for (const std::size_t i : usual_friction()) {
        if (contains(base_, i) || excluded(i)) continue;
        friction_.push_back(candidates(i).front());
        amounts.insert(amounts.end(), friction_.back().amounts.begin(), friction_.back().amounts.end());
    }
    usual_fit_ = fit_beside_friction(all_.blocks, shape_of(base_), amounts);
    std::erase_if(friction_, [&](const Candidate& candidate) { return !excited(candidate); });
    rows_ = row_count(all_.blocks, base_fit_.shape);
    constexpr double kMostOfIt = 0.5;  // more than all others together
    const auto shares = largest_fold_shares(all_.blocks, usual_fit_);
    for (std::size_t e = 0; e < kEquations; ++e) one_tells_[e] = shares[e] > kMostOfIt;
}

std::vector<Candidate> Evidence::candidates(std::size_t effect) const {
    const auto [first, end] = options_.dictionary->linear_columns(effect);
    if (first == end) {
        const std::span<const Candidate> all = options_.dictionary->candidates(effect);
        return {all.begin(), all.end()};
    }
    std::vector<Candidate> made;
    const bool pair = is_pair(effect);
    if (pair && (model::kEffects[effect].parameters[0].minimum >= 0 || !options_.turning)) {
        Candidate candidate;
        candidate.effect = effect;
        candidate.together = true;
        candidate.amounts.push_back({{first, first + 1}});
        candidate.coordinate = {0};
        made.push_back(candidate);
        if (!options_.turning) return made;
    }
    Candidate candidate;
    candidate.effect = effect;
    double most = 0;
    for (int c = first; c < end; ++c) most = std::max(most, set_.wheel_power(c, c));
    for (int c = first; c < end; ++c) {
        if (set_.wheel_power(c, c) <= kUnexcited * most) continue;
        candidate.amounts.push_back({{c}});
        candidate.coordinate.push_back(static_cast<unsigned>(c - first));
    }
    if (candidate.amounts.empty()) {
        candidate.amounts.push_back({{first}});
        candidate.coordinate.push_back(0);
    }
    made.push_back(candidate);
    return made;
}

ModelShape Evidence::shape_of(const Members& members) const {
    ModelShape shape = gap::shape_of(members, options_.turning);
    shape.held_gain[kLinear] = options_.k7_per_kg_m;
    return shape;
}

Fit Evidence::fit(const Sample& sample, const Members& members, Spread spread) const {
    if (spread == Spread::none) return gap::fit({&sample.whole}, shape_of(members), spread);
    return gap::fit(sample.blocks, shape_of(members), spread);
}

ModelShape Evidence::shape_for_part(const Members& members) const {
    ModelShape shape = shape_of(members);
    if (!one_tells_[kLinear] && !one_tells_[kTurning]) return shape;
    Members usual = members;
    for (const Candidate& candidate : friction_) {
        if (!contains(members, candidate.effect)) usual.push_back(candidate);
    }
    const Fit all = fit(all_, usual, Spread::none);
    for (std::size_t e = 0; e < kEquations; ++e) {
        if (one_tells_[e]) shape.held_gain[e] = all.value(gain_of(e));
    }
    return shape;
}

Fit Evidence::fit_of_part(const Sample& part, const Members& members) const {
    return gap::fit({&part.whole}, shape_for_part(members), Spread::none);
}

LeftOut Evidence::left_out(const Sample& sample, const Members& members) const {
    const ModelShape shape = shape_for_part(members);
    std::vector<Fit> rest;
    for (const Block& block : sample.rest) rest.push_back(gap::fit({&block}, shape, Spread::none));
    return left_out_of(sample, std::move(rest));
}

LeftOut Evidence::left_out_with(const Sample& sample, const Members& members, std::size_t effect) const {
    std::vector<Fit> rest;
    for (const Block& block : sample.rest) {
        const auto best = best_point(effect, members, Sample({&block}));
        const Members more = best ? with(members, best->candidate) : members;
        rest.push_back(gap::fit({&block}, shape_for_part(more), Spread::none));
    }
    return left_out_of(sample, std::move(rest));
}

double Evidence::cross_validated(const Sample& sample, const Members& members) const {
    const std::vector<double> each = squares_left_out(sample, members);
    return std::accumulate(each.begin(), each.end(), 0.0);
}

double Evidence::reach(const Sample& sample, const Members& members) const {
    std::vector<int> extra{Dictionary::kTiming};
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (excluded(i)) continue;
        for (auto [c, end] = options_.dictionary->linear_columns(i); c < end; ++c) extra.push_back(c);
    }
    for (auto [c, end] = options_.dictionary->rich_columns(); c < end; ++c) extra.push_back(c);
    return reachable_squares(sample.blocks, shape_of(members), extra);
}

double Evidence::torque_share(double gap) const {
    const double torque = torque_squares(all_.blocks, usual_fit_) / rows_;
    return torque > 0 ? std::sqrt(std::max(0.0, gap) / torque) : 0.0;
}

bool Evidence::impossible(std::size_t effect) const {
    return std::find(options_.excluded.begin(), options_.excluded.end(), effect) != options_.excluded.end();
}

bool Evidence::excluded(std::size_t effect) const {
    const std::vector<std::size_t>& unnamed = options_.rivals_only;
    return impossible(effect) || std::find(unnamed.begin(), unnamed.end(), effect) != unnamed.end();
}

bool Evidence::excited(const Candidate& candidate) const {
    for (const Amount& amount : directions(candidate)) {
        for (const int c : amount.columns) {
            if (set_.wheel_power(c, c) > 0)
                return likeness(all_.blocks, base_usually(), directions(candidate), {}) < 1;
        }
    }
    return false;
}

// The base, with K5..K8 beside friction.
Fit Evidence::base_usually() const {
    Fit base = base_fit_;
    base.value.head<kFirstAmount>() = usual_fit_.value.head<kFirstAmount>();
    return base;
}

double Evidence::effect_torque_share(const Members& members, std::size_t member, const Fit& f) const {
    constexpr double kClear = 2;  // of zero, standard errors
    const Candidate& candidate = members[member];
    const Eigen::Index count = static_cast<Eigen::Index>(candidate.amounts.size());
    Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(set_.wheel_power.cols(), count);  // of each amount
    for (Eigen::Index i = 0; i < count; ++i) {
        for (const int c : candidate.amounts[std::size_t(i)].columns) columns(c, i) += 1;
    }
    Eigen::VectorXd fixed = Eigen::VectorXd::Zero(columns.rows());
    for (const int c : candidate.fixed) fixed(c) += 1;
    const auto power_of = [&](const Eigen::VectorXd& amount) {
        const Eigen::VectorXd p = fixed + columns * amount;
        return p.dot(set_.wheel_power * p);
    };
    Eigen::VectorXd amount = amounts_in(members, member, f);
    double power = power_of(amount);
    if (f.covariance.size() > 0) {
        // An amount that the log does not show is large by its noise: less what that makes, or without it.
        const Eigen::Index at = first_amount_of(members, member);
        const Eigen::MatrixXd squares = columns.transpose() * set_.wheel_power * columns;
        const double noise = squares.cwiseProduct(f.covariance.block(at, at, count, count)).sum();
        for (Eigen::Index i = 0; i < count; ++i) {
            if (std::abs(amount(i)) < kClear * f.error(at + i)) amount(i) = 0;
        }
        power = std::max(power - noise, std::min(power, power_of(amount)));
    }
    return std::sqrt(std::max(0.0, power)) / std::max(1e-12, set_.torque_rms_Nm);
}

bool Evidence::in_range(const Sample& sample, const Members& members, const Fit& f) const {
    const Candidate& candidate = members.back();
    const std::size_t member = members.size() - 1;
    const auto& info = model::kEffects[candidate.effect].parameters;
    const Eigen::VectorXd amount = amounts_in(members, member, f);
    if (candidate.kind == Candidate::Kind::linear) {
        if (!model::kLinearInParameters[candidate.effect]) return true;
        const auto within = [&](const auto& slack) {
            for (Eigen::Index i = 0; i < amount.size(); ++i) {
                const auto& range = info[candidate.coordinate[std::size_t(i)]];
                if (amount(i) < range.minimum - slack(i) || amount(i) > range.maximum + slack(i))
                    return false;
            }
            return true;
        };
        if (within([](Eigen::Index) { return 0.0; })) return true;
        const Fit known = f.covariance.size() > 0 ? f : fit(sample, members);
        const Eigen::Index first = first_amount_of(members, member);
        return within([&](Eigen::Index i) { return 3 * known.error(first + i); });
    }
    const auto [p, plausible] = parameters_of(candidate, amount, options_.dictionary->setting());
    if (!plausible) return false;
    if (candidate.effect == kMeasurementLag && p[0] > options_.most_report_lag_s) return false;
    for (std::size_t j = 0; j < info.size(); ++j) {
        const double slack = 0.01 * (std::abs(candidate.at[j]) + 1e-6);
        if (p[j] < info[j].minimum - slack || p[j] > info[j].maximum + slack) return false;
    }
    return true;
}

double Evidence::probability_of_last(const Sample& sample, const Members& members) const {
    Members tested = members;
    Candidate& last = tested.back();
    last.amounts = directions(last);
    last.fixed.clear();
    const Fit f = gap::fit(sample.blocks, shape_for_part(tested), Spread::plain);
    const Eigen::Index at = first_amount_of(tested, tested.size() - 1);
    const auto n = static_cast<Eigen::Index>(last.amounts.size());
    const double degrees = std::max(1.0, double(sample.size()) - 4 - double(n));
    return probability_of_none(last, f.value.segment(at, n), f.covariance.block(at, at, n, n), degrees,
                               options_.dictionary->setting());
}

std::optional<BestPoint> Evidence::best_point(std::size_t effect, const Members& members,
                                              const Sample& sample) const {
    std::optional<BestPoint> best;
    double least = std::numeric_limits<double>::infinity();
    const auto attempt = [&](const Candidate& candidate) {
        const Members more = with(members, candidate);
        const Fit f = fit(sample, more, Spread::none);
        // what is linearised is preferred, for it goes on from where it is
        const double squares =
            candidate.kind == Candidate::Kind::linearised ? kCloser * f.squares : f.squares;
        if (squares >= least) return true;
        if (!in_range(sample, more, f)) return false;
        least = squares;
        best = {candidate, f.squares};
        return true;
    };
    for (const Candidate& candidate : candidates(effect)) {
        if (attempt(candidate)) continue;
        if (const std::optional<Candidate> open = left_free(candidate)) attempt(*open);
    }
    return best;
}

Compared Evidence::compared(const Members& one, const Members& other) const {
    return compared({squares_left_out(all_, one), squares_left_out(all_, other)}, one, other);
}

Compared Evidence::compared(const Compared& all, const Members& one, const Members& other) const {
    const Fit a = fit(all_, one, Spread::none);
    const Fit b = fit(all_, other, Spread::none);
    std::vector<double> apart(all_.size());
    for (std::size_t i = 0; i < apart.size(); ++i) apart[i] = squares_apart(*all_.blocks[i], a, b);
    Compared there;
    for (const std::size_t i : parting(apart)) {
        there.one.push_back(all.one[i]);
        there.other.push_back(all.other[i]);
    }
    return there;
}

bool Evidence::distinguishes(const Members& one, const Members& other) const {
    const Fit a = fit(all_, one, Spread::none);
    const Fit b = fit(all_, other, Spread::none);
    std::vector<double> gain(all_.size());
    std::vector<double> apart(all_.size());
    for (std::size_t i = 0; i < all_.size(); ++i) {
        const Block& block = *all_.blocks[i];
        gain[i] = squares(block, b) - squares(block, a);
        apart[i] = squares_apart(block, a, b);
    }
    return surely_as_predicted(gain, apart, squares(all_.blocks, a) / rows_, kPolicy.better);
}

bool Evidence::better(const Members& one, const Members& other) const {
    const auto [first, second] = compared(one, other);
    return surely_less(first, second) || distinguishes(one, other);
}

std::vector<Members> Evidence::others_for(const Members& fewer) const {
    std::vector<Members> all{fewer};
    Members apart = fewer;
    for (Candidate& m : apart) {
        if (m.together && options_.turning) m = candidates(m.effect).back();
    }
    if (unknowns(apart) > unknowns(fewer)) all.push_back(apart);
    return all;
}

}  // namespace wheelwright::gap
