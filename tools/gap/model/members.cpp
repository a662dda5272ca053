#include "tools/gap/model/members.hpp"

#include <algorithm>

#include "tools/gap/hypotheses/hypotheses.hpp"

namespace wheelwright::gap {

Members with(Members members, const Candidate& candidate) {
    members.push_back(candidate);
    return members;
}
Members without(Members members, std::size_t i) {
    members.erase(members.begin() + static_cast<std::ptrdiff_t>(i));
    return members;
}
bool contains(const Members& members, std::size_t effect) {
    return std::any_of(members.begin(), members.end(),
                       [&](const Candidate& m) { return m.effect == effect; });
}

Eigen::Index first_amount_of(const Members& members, std::size_t member) {
    std::size_t at = 1;
    for (std::size_t i = 0; i < member; ++i) at += members[i].amounts.size();
    return kFirstAmount + static_cast<Eigen::Index>(at);
}

Eigen::VectorXd amounts_in(const Members& members, std::size_t member, const Fit& f) {
    return f.value.segment(first_amount_of(members, member),
                           static_cast<Eigen::Index>(members[member].amounts.size()));
}

model::Parameters<double> parameters_within_range(const Candidate& candidate, const Eigen::VectorXd& amounts,
                                                  const Setting& setting) {
    model::Parameters<double> p = parameters_of(candidate, amounts, setting).first;
    const auto& info = model::kEffects[candidate.effect].parameters;
    for (std::size_t j = 0; j < info.size(); ++j) p[j] = std::clamp(p[j], info[j].minimum, info[j].maximum);
    return p;
}

model::EffectSet<double> effects_of(const Members& members, const Fit& fit, const Setting& setting) {
    model::EffectSet<double> set;
    for (std::size_t i = 0; i < members.size(); ++i) {
        set.active[members[i].effect] = true;
        set.parameter[members[i].effect] =
            parameters_within_range(members[i], amounts_in(members, i, fit), setting);
    }
    return set;
}

ModelShape shape_of(std::span<const Candidate> members, bool turning) {
    ModelShape shape{{{{Dictionary::kTiming}}}, {}, turning, {}};
    for (const Candidate& m : members) {
        shape.amounts.insert(shape.amounts.end(), m.amounts.begin(), m.amounts.end());
        shape.fixed.insert(shape.fixed.end(), m.fixed.begin(), m.fixed.end());
    }
    return shape;
}

Candidate same_candidate(const Dictionary& dictionary, const Candidate& candidate) {
    if (candidate.kind == Candidate::Kind::linear) return candidate;
    const std::span<const Candidate> all = dictionary.candidates(candidate.effect);
    Candidate same = all.back();  // the linearised one
    for (const Candidate& other : all) {
        if (candidate.kind == Candidate::Kind::start && other.kind == candidate.kind &&
            other.at == candidate.at)
            same = other;
    }
    if (candidate.amounts.empty()) same.amounts.clear();  // given, and not refitted
    return same;
}

std::vector<Amount> directions(const Candidate& candidate) {
    if (candidate.fixed.empty()) return candidate.amounts;
    return {{candidate.fixed}};
}

bool may_be_negative(const Candidate& candidate, const Setting& setting) {
    if (candidate.kind != Candidate::Kind::linear) {
        const StartingPoints from = hypothesis_of(candidate.effect).starting_points(setting);
        return from.plausible(
            Eigen::VectorXd::Constant(static_cast<Eigen::Index>(from.units(candidate.at).size()), -1));
    }
    return !model::kLinearInParameters[candidate.effect] ||
           model::kEffects[candidate.effect].parameters[candidate.coordinate.front()].minimum < 0;
}

std::size_t unknowns(const Candidate& candidate) {
    return candidate.kind == Candidate::Kind::linear ? candidate.amounts.size()
                                                     : model::kEffects[candidate.effect].parameters.size();
}

std::size_t unknowns(const Members& members) {
    std::size_t sum = 0;
    for (const Candidate& m : members) sum += unknowns(m);
    return sum;
}

std::tuple<bool, std::size_t, std::size_t> simplicity(const Candidate& candidate) {
    return {candidate.kind != Candidate::Kind::linear, unknowns(candidate), candidate.effect};
}

}  // namespace wheelwright::gap
