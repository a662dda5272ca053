// The parameters of effects by their type, for the plant's own files.
#pragma once

#include <cstddef>

#include "sim_hal/plant.hpp"

namespace wheelwright::sim {

template <typename Effect>
constexpr std::size_t index_of() {
    return model::find_effect(Effect::info.name);
}

template <typename Effect>
bool is_active(const model::EffectSet<double>& set) {
    return set.active[index_of<Effect>()];
}

// nullptr when the effect is not active.
template <typename Effect>
const model::Parameters<double>* parameters_of(const model::EffectSet<double>& set) {
    return is_active<Effect>(set) ? &set.parameter[index_of<Effect>()] : nullptr;
}

// What the rotation of two wheels adds to the plant's masses; a negative one takes it away.
void add_rotation(PlantParameters& p, double wheel_inertia_kg_m2);

}  // namespace wheelwright::sim
