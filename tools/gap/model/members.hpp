// The effects of a model: in which form each enters, and what a fit says of them.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <tuple>
#include <vector>

#include "tools/gap/model/fit.hpp"

namespace wheelwright::gap {

// Forms in which effects enter the model, in the order of their amounts in a fit; one of each effect at most.
using Members = std::vector<Candidate>;
Members with(Members members, const Candidate& candidate);
Members without(Members members, std::size_t i);
bool contains(const Members& members, std::size_t effect);

// Where a member's amounts begin in Fit::value, and what they are.
Eigen::Index first_amount_of(const Members& members, std::size_t member);
Eigen::VectorXd amounts_in(const Members& members, std::size_t member, const Fit& fit);
// The effect's parameters, within the range that the catalogue gives them.
model::Parameters<double> parameters_within_range(const Candidate& candidate, const Eigen::VectorXd& amounts,
                                                  const Setting& setting);
model::EffectSet<double> effects_of(const Members& members, const Fit& fit, const Setting& setting);

// With the timing of the torque, which every model has, as the first amount.
ModelShape shape_of(std::span<const Candidate> members, bool turning);

// A member as another dictionary has it, which was made with where the members are.
Candidate same_candidate(const Dictionary& dictionary, const Candidate& candidate);

// The columns that an effect's presence shows in.
std::vector<Amount> directions(const Candidate& candidate);

// That an effect of less than nothing is one too: a bias is, a drag is not.
bool may_be_negative(const Candidate& candidate, const Setting& setting);

// Parameters to choose.
std::size_t unknowns(const Candidate& candidate);
std::size_t unknowns(const Members& members);

// Linear in its parameters first, then fewer unknowns, then the catalogue's order.
std::tuple<bool, std::size_t, std::size_t> simplicity(const Candidate& candidate);

}  // namespace wheelwright::gap
