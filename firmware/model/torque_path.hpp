// The torque's whole way to one wheel: the effects that change it, one behind the other in the order of their
// path_place.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <tuple>
#include <utility>

#include "firmware/model/effects.hpp"

namespace wheelwright::model {

template <std::size_t kStage>
using PathEffect = std::tuple_element_t<kPathOrder[kStage], Catalogue>;

template <typename Real, typename Stages>
struct PathMemoryOf;
template <typename Real, std::size_t... kStage>
struct PathMemoryOf<Real, std::index_sequence<kStage...>> {
    using Type = std::tuple<typename PathEffect<kStage>::template Memory<Real>...>;
};
// What the effects on one wheel's way remember. In double about 3 KB, the delay's.
template <typename Real>
using PathMemory = typename PathMemoryOf<Real, std::make_index_sequence<kPathEffects>>::Type;

// Whether one of the effects that are active is on the way.
constexpr bool changes_torque_path(const std::array<bool, kEffectCount>& active) {
    return std::any_of(kPathOrder.begin(), kPathOrder.end(), [&](std::size_t i) { return active[i]; });
}

// The mean torque that arrives at one wheel over the step that begins now, of `at.torque_Nm` asked at the
// way's beginning; advances the memory.
template <typename Real>
constexpr Real delivered_along_path_Nm(const EffectSet<Real>& set, PathMemory<Real>& memory,
                                       PathInstant<Real> at) {
    const auto one = [&]<std::size_t kStage>(std::integral_constant<std::size_t, kStage>) {
        constexpr std::size_t i = kPathOrder[kStage];
        if (set.active[i])
            at.torque_Nm = PathEffect<kStage>::deliver(set.parameter[i], std::get<kStage>(memory), at);
    };
    [&]<std::size_t... kStage>(std::index_sequence<kStage...>) {
        (one(std::integral_constant<std::size_t, kStage>{}), ...);
    }(std::make_index_sequence<kPathEffects>{});
    return at.torque_Nm;
}

}  // namespace wheelwright::model
