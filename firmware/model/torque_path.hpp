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

inline constexpr std::size_t kPathEffects = [] {
    const auto on_path = for_catalogue([]<typename Effect>() { return InTorquePath<Effect>; });
    return static_cast<std::size_t>(std::count(on_path.begin(), on_path.end(), true));
}();

// Indices into kEffects, in the order of the way.
inline constexpr std::array<std::size_t, kPathEffects> kPathOrder = [] {
    const std::array<int, kEffectCount> place = for_catalogue([]<typename Effect>() {
        if constexpr (InTorquePath<Effect>) {
            return static_cast<int>(Effect::path_place);
        } else {  // NOLINT(readability-misleading-indentation): clang-tidy 16 misreads "if constexpr"
            return 1'000'000;  // nowhere
        }
    });
    std::array<std::size_t, kEffectCount> all{};
    for (std::size_t i = 0; i < kEffectCount; ++i) all[i] = i;
    std::sort(all.begin(), all.end(), [&](std::size_t a, std::size_t b) { return place[a] < place[b]; });
    std::array<std::size_t, kPathEffects> order{};
    std::copy_n(all.begin(), kPathEffects, order.begin());
    return order;
}();

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
