// The hypotheses of an analysis: one for each effect of the catalogue.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

// HypothesisOf an effect of the catalogue, by its index.
struct Hypothesis {
    // Null: the catalogue's columns, or none.
    std::unique_ptr<Contribution> (*columns)(const Parameters<double>&, const Setting&) = nullptr;
    bool by_dynamics = false;  // the columns, its own or the catalogue's, depend on K5..K8
    StartingPoints (*starting_points)(const Setting&) = nullptr;
    bool in_every_drive_train = false;
    bool late = false;
    bool dry = false;  // friction: no two laws say the same of it near standstill
    std::size_t special_case_of = model::kEffectCount;  // this: of none
    std::span<const Confounder> unless_measured;
    std::size_t event = model::kMaxEffectParameters;  // this: there is none
    Uncertainty (*uncertainty)(const UncertaintyOf&) = nullptr;
};
const Hypothesis& hypothesis_of(std::size_t effect);

// The friction that every drive train has, in the catalogue's order.
std::span<const std::size_t> usual_friction();
// One of these, or the general law of one.
bool is_usual_friction(std::size_t effect);

}  // namespace wheelwright::gap
