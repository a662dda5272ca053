// The catalogue of physical effects: the only place where effects are listed. To add one, write its file in
// effects/ and add its line to Catalogue.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>

#include "firmware/model/effect.hpp"
#include "firmware/model/effects/actuator_lag.hpp"
#include "firmware/model/effects/back_emf_limit.hpp"
#include "firmware/model/effects/backlash.hpp"
#include "firmware/model/effects/castor_drag.hpp"
#include "firmware/model/effects/cog_lateral.hpp"
#include "firmware/model/effects/coulomb_friction.hpp"
#include "firmware/model/effects/dead_zone.hpp"
#include "firmware/model/effects/encoder_quantisation.hpp"
#include "firmware/model/effects/gain_drift.hpp"
#include "firmware/model/effects/gyro_bias.hpp"
#include "firmware/model/effects/measurement_lag.hpp"
#include "firmware/model/effects/payload_step.hpp"
#include "firmware/model/effects/quadratic_drag.hpp"
#include "firmware/model/effects/slope.hpp"
#include "firmware/model/effects/stribeck_friction.hpp"
#include "firmware/model/effects/torque_bias.hpp"
#include "firmware/model/effects/torque_gain_mismatch.hpp"
#include "firmware/model/effects/torque_ripple.hpp"
#include "firmware/model/effects/torque_saturation.hpp"
#include "firmware/model/effects/transport_delay.hpp"
#include "firmware/model/effects/turning_scrub.hpp"
#include "firmware/model/effects/viscous_friction.hpp"
#include "firmware/model/effects/wheel_radius_mismatch.hpp"
#include "firmware/model/effects/wheel_slip.hpp"

namespace wheelwright::model {

// Order is part of the CAN parameter index (robot_parameters.hpp): append, never reorder.
using Catalogue = std::tuple<ViscousFriction,      //
                             CoulombFriction,      //
                             QuadraticDrag,        //
                             TurningScrub,         //
                             TorqueBias,           //
                             Slope,                //
                             TorqueGainMismatch,   //
                             StribeckFriction,     //
                             CastorDrag,           //
                             CogLateral,           //
                             ActuatorLag,          //
                             TransportDelay,       //
                             DeadZone,             //
                             Backlash,             //
                             TorqueSaturation,     //
                             BackEmfLimit,         //
                             WheelRadiusMismatch,  //
                             WheelSlip,            //
                             PayloadStep,          //
                             GainDrift,            //
                             TorqueRipple,         //
                             EncoderQuantisation,  //
                             GyroBias,             //
                             MeasurementLag>;

inline constexpr std::size_t kEffectCount = std::tuple_size_v<Catalogue>;

// Those at the catalogue's beginning that many robots have: where no other is active, the cycle's functions
// need not look at the rest (their parameter kUpTo). A bare target has no room for two of each.
inline constexpr std::size_t kCommonEffects = kBare ? kEffectCount : 7;

// The kinds of effect.hpp.
template <typename Effect>
concept Dry = requires { Effect::template dry_direction<double>(0U); };
template <typename Effect>
concept EachWheel = requires(const EffectContext<double>& context) { Effect::each_wheel(context); };
template <typename Effect>
concept HasOwnCoordinates = requires { Effect::coordinate_count; };
template <typename Effect>
concept OnTorquePath = requires(Parameters<double> p, WheelPair<double> torque) { Effect::asked(p, torque); };
template <typename Effect>
concept HasColumns = requires(const EffectContext<double>& context) { Effect::column(0U, context); } ||
                     EachWheel<Effect> || Dry<Effect>;
// Its columns depend on K5..K8.
template <typename Effect>
concept ColumnsByDynamics = requires { requires Effect::columns_by_dynamics; };
template <typename Effect>
concept SmoothTorque =
    (HasColumns<Effect> && !Dry<Effect>) ||
    requires(Parameters<double> p, const EffectContext<double>& context) { Effect::torque(p, context); };
template <typename Effect>
concept InTorquePath = requires { Effect::path_place; };
// Dry friction of both wheels whose limit depends on the sliding speed.
template <typename Effect>
concept DryBySpeed = requires(Parameters<double> p) { Effect::dry_limit(p, 0.0); };
template <typename Effect>
concept CountsAsDelay = requires(Parameters<double> p) { Effect::controllers_delay_s(p); };
// Its parameters are the coefficients of its columns, whatever the applied torque.
template <typename Effect>
concept LinearInParameters = HasColumns<Effect> && !HasOwnCoordinates<Effect> && !OnTorquePath<Effect>;

template <typename Effect>
inline constexpr std::size_t kCoordinates = [] {
    if constexpr (HasOwnCoordinates<Effect>) {
        return Effect::coordinate_count;
    } else {  // NOLINT(readability-misleading-indentation): clang-tidy 16 misreads "if constexpr"
        return HasColumns<Effect> ? Effect::parameters.size() : 0;
    }
}();

// One value made from each effect's type, in catalogue order.
template <typename Make>
constexpr auto for_catalogue(Make&& make) {
    return [&]<std::size_t... I>(std::index_sequence<I...>) {
        return std::array{make.template operator()<std::tuple_element_t<I, Catalogue>>()...};
    }(std::make_index_sequence<kEffectCount>{});
}

inline constexpr std::array<EffectInfo, kEffectCount> kEffects =
    for_catalogue([]<typename Effect>() { return Effect::info; });
inline constexpr std::array<bool, kEffectCount> kLinearInParameters =
    for_catalogue([]<typename Effect>() { return LinearInParameters<Effect>; });

// The effects on the torque's way: how many, and their indices in the way's order.
inline constexpr std::size_t kPathEffects = [] {
    const auto on_path = for_catalogue([]<typename Effect>() { return InTorquePath<Effect>; });
    return static_cast<std::size_t>(std::count(on_path.begin(), on_path.end(), true));
}();

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

// All parameters of the catalogue that are coefficients of columns.
inline constexpr std::size_t kMaxColumns = [] {
    std::size_t total = 0;
    for (std::size_t i = 0; i < kEffectCount; ++i) {
        if (kLinearInParameters[i]) total += kEffects[i].parameters.size();
    }
    return total;
}();

// Parameters that the cycle's estimators have room for: it sets the size of their matrices, and with it the
// cycle's cost, however long the catalogue grows.
inline constexpr std::size_t kMaxEstimatedColumns = 4;

// Index into kEffects, or kEffectCount for an unknown name.
constexpr std::size_t find_effect(std::string_view name) {
    std::size_t i = 0;
    while (i < kEffectCount && kEffects[i].name != name) ++i;
    return i;
}

// It couples the two accelerations, so that whoever predicts or commands them looks at it by itself.
inline constexpr std::size_t kCogLateral = find_effect(CogLateral::info.name);

// Which effects a robot has, and how large they are.
template <typename Real>
struct EffectSet {
    std::array<bool, kEffectCount> active{};
    std::array<Parameters<Real>, kEffectCount> parameter{};

    template <typename Other>
    // NOLINTNEXTLINE(google-explicit-constructor): clang-tidy 16 does not read the condition
    explicit(sizeof(Other) < sizeof(Real)) constexpr operator EffectSet<Other>() const {
        EffectSet<Other> other{active, {}};
        for (std::size_t i = 0; i < kEffectCount; ++i) {
            for (std::size_t j = 0; j < kMaxEffectParameters; ++j)
                other.parameter[i][j] = Other(parameter[i][j]);
        }
        return other;
    }
};

// Of a parameter that belongs to one wheel: 1 right, -1 left; 0 to none.
constexpr int side_of(std::size_t effect, std::size_t parameter) {
    const std::string_view name = kEffects[effect].parameters[parameter].name;
    return name.starts_with("right_") ? 1 : name.starts_with("left_") ? -1 : 0;
}

// Half of the relative gain mismatch that a file lists: c of torque_gain_mismatch.hpp.
template <typename Real>
constexpr Real listed_mismatch(const EffectSet<Real>& set) {
    constexpr std::size_t gains = find_effect(TorqueGainMismatch::info.name);
    return set.active[gains] ? TorqueGainMismatch::coordinates(set.parameter[gains])[0] : Real(0);
}

// How far the centre of gravity lies to the left, as a file lists it: p of cog_lateral.hpp.
template <typename Real>
constexpr Real listed_offset_m(const EffectSet<Real>& set) {
    return set.active[kCogLateral] ? set.parameter[kCogLateral][0] : Real(0);
}

// Those of the active effects that the cycle's estimators carry: linear in their parameters, in catalogue
// order as far as there is room. The others stay as the robot file says; the estimators take their torque as
// known.
constexpr std::array<bool, kEffectCount> estimated_effects(const std::array<bool, kEffectCount>& active) {
    std::array<bool, kEffectCount> estimated{};
    std::size_t columns = 0;
    for (std::size_t i = 0; i < kEffectCount; ++i) {
        const std::size_t more = kEffects[i].parameters.size();
        if (!active[i] || !kLinearInParameters[i] || columns + more > kMaxEstimatedColumns) continue;
        estimated[i] = true;
        columns += more;
    }
    return estimated;
}

// Whether one of the eight effects from `first` on is active. Cost: a test.
constexpr bool any_of_eight(const std::array<bool, kEffectCount>& active, std::size_t first) {
    const std::size_t count = std::min<std::size_t>(8, kEffectCount - first);
    if (std::is_constant_evaluated()) {
        return std::any_of(active.begin() + first, active.begin() + first + count, [](bool a) { return a; });
    }
    std::uint64_t eight = 0;
    __builtin_memcpy(&eight, active.data() + first, count);  // one load
    return eight != 0;
}

// Calls visit(i) for each active effect, in catalogue order. Cost: a test for eight effects, and where one is
// active another for each.
template <typename Visitor>
constexpr void for_each_active_index(const std::array<bool, kEffectCount>& active, Visitor&& visit) {
    for (std::size_t first = 0; first < kEffectCount; first += 8) {
        if (!any_of_eight(active, first)) continue;
        const std::size_t end = std::min(first + 8, kEffectCount);
        for (std::size_t i = first; i < end; ++i) {
            if (active[i]) visit(i);
        }
    }
}

// Calls visit(index, type) as visit.template operator()<Effect>(i) for each active effect, in catalogue
// order. Cost: as for_each_active_index(); effects for which `visit` is empty cost nothing.
template <std::size_t kUpTo = kEffectCount, typename Visitor>
constexpr void for_each_active(const std::array<bool, kEffectCount>& active, Visitor&& visit) {
    const auto one = [&]<std::size_t I>(std::integral_constant<std::size_t, I>) {
        if (active[I]) visit.template operator()<std::tuple_element_t<I, Catalogue>>(I);
    };
    const auto eight = [&]<std::size_t kFirst>(std::integral_constant<std::size_t, kFirst>) {
        if (!any_of_eight(active, kFirst)) return;
        [&]<std::size_t... J>(std::index_sequence<J...>) {
            (one(std::integral_constant<std::size_t, kFirst + J>{}), ...);
        }(std::make_index_sequence<std::min<std::size_t>(8, kUpTo - kFirst)>{});
    };
    [&]<std::size_t... K>(std::index_sequence<K...>) {
        (eight(std::integral_constant<std::size_t, 8 * K>{}), ...);
    }(std::make_index_sequence<(kUpTo + 7) / 8>{});
}

// The wheel torque that one unit of a smooth effect's coordinate k gives.
template <typename Effect, typename Real>
constexpr WheelPair<Real> smooth_column(unsigned k, const EffectContext<Real>& context) {
    if constexpr (EachWheel<Effect>) {
        const WheelPair<Real> both = Effect::each_wheel(context);
        return k == 0 ? WheelPair<Real>{both.left, 0} : WheelPair<Real>{0, both.right};
    } else {
        return wheel_torque_Nm(context.geometry, Effect::column(k, context));
    }
}

// Calls visit(effect index, parameter index, column, is_dry) for each parameter of each active effect that is
// linear in its parameters, in catalogue order. For a smooth effect `column` is the wheel torque of one unit
// of the parameter; for a dry one it is the direction d of effect.hpp.
template <typename Real, typename Visitor>
constexpr void for_each_column(const std::array<bool, kEffectCount>& active,
                               const EffectContext<Real>& context, Visitor&& visit) {
    for_each_active(active, [&]<typename Effect>(std::size_t i) {
        if constexpr (LinearInParameters<Effect>) {
            for (unsigned j = 0; j < Effect::parameters.size(); ++j) {
                if constexpr (Dry<Effect>) {
                    visit(i, j, wheel_torque_Nm(context.geometry, Effect::template dry_direction<Real>(j)),
                          true);
                } else {
                    visit(i, j, smooth_column<Effect>(j, context), false);
                }
            }
        }
    });
}

// Calls visit(effect index, parameter index, direction d, limit in Nm) for each parameter of each active dry
// effect.
template <typename Real, typename Visitor>
constexpr void for_each_dry(const EffectSet<Real>& set, const Geometry<Real>& geometry, Visitor&& visit) {
    for_each_active(set.active, [&]<typename Effect>(std::size_t i) {
        if constexpr (Dry<Effect>) {
            for (unsigned j = 0; j < Effect::parameters.size(); ++j) {
                visit(i, j, wheel_torque_Nm(geometry, Effect::template dry_direction<Real>(j)),
                      set.parameter[i][j]);
            }
        }
    });
}

// The dry friction that a wheel may feel, of the one that feels more.
template <typename Real>
constexpr Real dry_friction_Nm(const EffectSet<Real>& set, const Geometry<Real>& geometry) {
    WheelPair<Real> dry{};
    for_each_dry(set, geometry,
                 [&dry](std::size_t, unsigned, const WheelPair<Real>& direction, Real limit_Nm) {
                     dry.left += std::abs(direction.left) * limit_Nm;
                     dry.right += std::abs(direction.right) * limit_Nm;
                 });
    return std::max(dry.left, dry.right);
}

// The same as for_each_dry(), and friction whose limit depends on speed, with its limit at these wheel speeds
// (parameter index 0).
template <std::size_t kUpTo = kEffectCount, typename Real, typename Visitor>
constexpr void for_each_dry(const EffectSet<Real>& set, const Geometry<Real>& geometry,
                            const WheelPair<Real>& wheel_speed_rad_per_s, Visitor&& visit) {
    for_each_active<kUpTo>(set.active, [&]<typename Effect>(std::size_t i) {
        if constexpr (Dry<Effect>) {
            for (unsigned j = 0; j < Effect::parameters.size(); ++j) {
                visit(i, j, wheel_torque_Nm(geometry, Effect::template dry_direction<Real>(j)),
                      set.parameter[i][j]);
            }
        } else if constexpr (DryBySpeed<Effect>) {
            visit(i, 0U, WheelPair<Real>{1, 0},
                  Effect::dry_limit(set.parameter[i], wheel_speed_rad_per_s.left));
            visit(i, 0U, WheelPair<Real>{0, 1},
                  Effect::dry_limit(set.parameter[i], wheel_speed_rad_per_s.right));
        }
    });
}

// Adds the wheel torque of one smooth effect.
template <typename Effect, typename Real>
constexpr void add_smooth_torque(const Parameters<Real>& parameter, const EffectContext<Real>& context,
                                 WheelPair<Real>& total_Nm) {
    if constexpr (EachWheel<Effect>) {
        const WheelPair<Real> both = Effect::each_wheel(context);
        total_Nm.left += parameter[0] * both.left;
        total_Nm.right += parameter[1] * both.right;
    } else if constexpr (HasOwnCoordinates<Effect>) {
        const Parameters<Real> amount = Effect::coordinates(parameter);
        for (unsigned k = 0; k < Effect::coordinate_count; ++k) {
            const WheelPair<Real> column = smooth_column<Effect>(k, context);
            total_Nm.left += amount[k] * column.left;
            total_Nm.right += amount[k] * column.right;
        }
    } else if constexpr (HasColumns<Effect>) {
        for (unsigned k = 0; k < Effect::parameters.size(); ++k) {
            const WheelPair<Real> column = smooth_column<Effect>(k, context);
            total_Nm.left += parameter[k] * column.left;
            total_Nm.right += parameter[k] * column.right;
        }
    } else {
        const WheelPair<Real> torque = Effect::torque(parameter, context);
        total_Nm.left += torque.left;
        total_Nm.right += torque.right;
    }
}

// The torque that the active smooth effects add to the wheels; those on the torque's way are not in it.
// kWheelsOnly leaves out all but those that act on each wheel by itself.
template <bool kWheelsOnly = false, std::size_t kUpTo = kEffectCount, typename Real>
constexpr WheelPair<Real> smooth_effect_torque_Nm(const EffectSet<Real>& set,
                                                  const EffectContext<Real>& context) {
    WheelPair<Real> total{};
    for_each_active<kUpTo>(set.active, [&]<typename Effect>(std::size_t i) {
        if constexpr (SmoothTorque<Effect> && !OnTorquePath<Effect> && (EachWheel<Effect> || !kWheelsOnly)) {
            add_smooth_torque<Effect>(set.parameter[i], context, total);
        }
    });
    return total;
}

// Calls visit(index, type) for each effect on the way that has an inverse, active or not, in the way's order.
template <std::size_t kUpTo, typename Visitor>
constexpr void for_each_invertible(Visitor&& visit) {
    const auto one = [&]<std::size_t kStage>(std::integral_constant<std::size_t, kStage>) {
        using Effect = std::tuple_element_t<kPathOrder[kStage], Catalogue>;
        if constexpr (OnTorquePath<Effect> && kPathOrder[kStage] < kUpTo)
            visit.template operator()<Effect>(kPathOrder[kStage]);
    };
    [&]<std::size_t... kStage>(std::index_sequence<kStage...>) {
        (one(std::integral_constant<std::size_t, kStage>{}), ...);
    }(std::make_index_sequence<kPathEffects>{});
}

// What arrives at the wheels of the context's applied torque, as far as the controllers can undo it.
template <std::size_t kUpTo = kEffectCount, typename Real>
constexpr WheelPair<Real> delivered_torque_Nm(const EffectSet<Real>& set, EffectContext<Real> context) {
    for_each_invertible<kUpTo>([&]<typename Effect>(std::size_t i) {
        if (!set.active[i]) return;
        WheelPair<Real> delivered = context.applied_torque_Nm;
        add_smooth_torque<Effect>(set.parameter[i], context, delivered);
        context.applied_torque_Nm = delivered;
    });
    return context.applied_torque_Nm;
}

// What to apply so that `wanted_Nm` arrives at the wheels: the inverse of delivered_torque_Nm().
template <std::size_t kUpTo = kEffectCount, typename Real>
constexpr WheelPair<Real> asked_torque_Nm(const EffectSet<Real>& set, WheelPair<Real> wanted_Nm) {
    const auto one = [&]<std::size_t kStage>(std::integral_constant<std::size_t, kStage>) {
        constexpr std::size_t i = kPathOrder[kPathEffects - 1 - kStage];
        using Effect = std::tuple_element_t<i, Catalogue>;
        if constexpr (OnTorquePath<Effect> && i < kUpTo) {
            if (set.active[i]) wanted_Nm = Effect::asked(set.parameter[i], wanted_Nm);
        }
    };
    [&]<std::size_t... kStage>(std::index_sequence<kStage...>) {
        (one(std::integral_constant<std::size_t, kStage>{}), ...);
    }(std::make_index_sequence<kPathEffects>{});
    return wanted_Nm;
}

// Beyond the delay of every robot: by which the active effects make torque come later.
template <typename Real>
constexpr Real effects_delay_s(const EffectSet<Real>& set) {
    Real delay_s = 0;
    for_each_active(set.active, [&]<typename Effect>(std::size_t i) {
        if constexpr (CountsAsDelay<Effect>) delay_s += Effect::controllers_delay_s(set.parameter[i]);
    });
    return delay_s;
}

// The radii as the active effects say they are.
template <typename Real>
constexpr Geometry<Real> actual_geometry(const EffectSet<Real>& set, const Geometry<Real>& nominal) {
    constexpr std::size_t i = find_effect(WheelRadiusMismatch::info.name);
    return set.active[i] ? WheelRadiusMismatch::geometry(set.parameter[i], nominal) : nominal;
}

template <typename Real>
constexpr Real sliding_speed(const WheelPair<Real>& direction, const WheelPair<Real>& wheel_speed_rad_per_s) {
    return direction.left * wheel_speed_rad_per_s.left + direction.right * wheel_speed_rad_per_s.right;
}

}  // namespace wheelwright::model
