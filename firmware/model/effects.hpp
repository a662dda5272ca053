// The catalogue of physical effects: the only place where effects are listed. To add one, write its file in
// effects/ and add its line to Catalogue.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <tuple>
#include <utility>

#include "firmware/model/effect.hpp"
#include "firmware/model/effects/coulomb_friction.hpp"
#include "firmware/model/effects/viscous_friction.hpp"

namespace wheelwright::model {

// Order is part of the CAN parameter index (robot_parameters.hpp): append, never reorder.
using Catalogue = std::tuple<ViscousFriction,  //
                             CoulombFriction>;

inline constexpr std::size_t kEffectCount = std::tuple_size_v<Catalogue>;

inline constexpr std::array<EffectInfo, kEffectCount> kEffects =
    []<std::size_t... I>(std::index_sequence<I...>) {
        return std::array<EffectInfo, kEffectCount>{std::tuple_element_t<I, Catalogue>::info...};
    }(std::make_index_sequence<kEffectCount>{});

// Columns an estimator may have to carry: one for each parameter of each effect.
inline constexpr std::size_t kMaxColumns = [] {
    std::size_t total = 0;
    for (const EffectInfo& effect : kEffects) total += effect.parameters.size();
    return total;
}();

// Index into kEffects, or kEffectCount for an unknown name.
constexpr std::size_t find_effect(std::string_view name) {
    std::size_t i = 0;
    while (i < kEffectCount && kEffects[i].name != name) ++i;
    return i;
}

// Which effects a robot has, and how large they are.
template <typename Real>
struct EffectSet {
    std::array<bool, kEffectCount> active{};
    std::array<std::array<Real, kMaxEffectParameters>, kEffectCount> parameter{};
};

// Calls visit(effect index, parameter index, column, is_dry) for each parameter of each active effect, in
// catalogue order. For a smooth effect `column` is the wheel torque of one unit of the parameter; for a dry
// one it is the direction d of effect.hpp. Cost: one test for each effect that is not active.
template <typename Real, typename Visitor>
constexpr void for_each_column(const EffectSet<Real>& set, const Motion<Real>& motion, Visitor&& visit) {
    const auto one = [&]<std::size_t I>(std::integral_constant<std::size_t, I>) {
        using Effect = std::tuple_element_t<I, Catalogue>;
        if (!set.active[I]) return;
        for (unsigned j = 0; j < Effect::parameters.size(); ++j) {
            if constexpr (requires { Effect::template dry_direction<Real>(j); }) {
                visit(I, j, Effect::template dry_direction<Real>(j), true);
            } else {
                visit(I, j, Effect::smooth_column(j, motion), false);
            }
        }
    };
    [&]<std::size_t... I>(std::index_sequence<I...>) {
        (one(std::integral_constant<std::size_t, I>{}), ...);
    }(std::make_index_sequence<kEffectCount>{});
}

template <typename Real>
constexpr Real sliding_speed(const WheelPair<Real>& direction, const WheelPair<Real>& wheel_speed_rad_per_s) {
    return direction.left * wheel_speed_rad_per_s.left + direction.right * wheel_speed_rad_per_s.right;
}

// The torque that the active effects add to the wheels (mostly against the motion). `sign` maps a sliding
// speed in rad/s to [-1, 1]; controllers pass a softened one.
template <typename Real, typename Sign>
constexpr WheelPair<Real> effect_torque_Nm(const EffectSet<Real>& set, const Motion<Real>& motion,
                                           Sign&& sign) {
    WheelPair<Real> total{};
    for_each_column(set, motion, [&](std::size_t i, unsigned j, const WheelPair<Real>& column, bool dry) {
        Real amount = set.parameter[i][j];
        if (dry) amount *= -sign(sliding_speed(column, motion.wheel_speed_rad_per_s));
        total.left += amount * column.left;
        total.right += amount * column.right;
    });
    return total;
}

}  // namespace wheelwright::model
