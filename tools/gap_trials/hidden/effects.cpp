#include "tools/gap_trials/hidden/effects.hpp"

#include <algorithm>

namespace wheelwright::hidden {
namespace {

using Sizes = std::array<std::array<double, 2>, 3>;
constexpr Sizes kShares{{{0.02, 0.05}, {0.05, 0.12}, {0.12, 0.30}}};

// A size that is one number, spread a little so that no trial repeats another.
constexpr Sizes about(double mild, double medium, double strong) {
    constexpr double kSpread = 0.12;
    return {{{mild * (1 - kSpread), mild * (1 + kSpread)},
             {medium * (1 - kSpread), medium * (1 + kSpread)},
             {strong * (1 - kSpread), strong * (1 + kSpread)}}};
}

using enum SizeKind;
constexpr std::array kTable{
    EffectInfo{
        "viscous_friction", {{{"left_Nm_s_per_rad", true}, {"right_Nm_s_per_rad", true}}}, share, kShares},
    EffectInfo{"coulomb_friction", {{{"left_Nm", true}, {"right_Nm", true}}}, share, kShares},
    EffectInfo{"stribeck_friction",
               {{{"coulomb_Nm", true}, {"static_Nm", true}, {"stribeck_rad_per_s", false}}},
               share,
               kShares},
    EffectInfo{"quadratic_drag", {{{"drag_N_s2_per_m2", true}}}, share, kShares},
    EffectInfo{"turning_scrub", {{{"scrub_Nm", true}}}, share, kShares},
    EffectInfo{"castor_drag",
               {{{"rolling_N", true}, {"swivel_Nm", true}, {"arm_m", false}, {"trail_m", false}}},
               share,
               kShares},
    EffectInfo{"slope", {{{"angle_rad", true}, {"uphill_rad", false}}}, value, about(0.01, 0.03, 0.08)},
    EffectInfo{"torque_bias", {{{"left_Nm", true}, {"right_Nm", true}}}, share, kShares},
    EffectInfo{"torque_gain_mismatch", {{{"relative", true}}}, value, about(0.03, 0.08, 0.20)},
    EffectInfo{"cog_lateral", {{{"offset_m", true}}}, value, about(0.005, 0.015, 0.040)},
    EffectInfo{"actuator_lag",
               {{{"time_constant_s", false}}},
               value,
               about(0.008, 0.020, 0.040),
               false,
               false,
               true,
               true},
    EffectInfo{"transport_delay",
               {{{"delay_s", false}}},
               value,
               about(0.002, 0.006, 0.015),
               false,
               false,
               false,
               true},
    EffectInfo{"dead_zone", {{{"width_Nm", false}}}, peak_share, about(0.03, 0.08, 0.20)},
    EffectInfo{"backlash",
               {{{"half_gap_rad", false}, {"motor_inertia_kg_m2", false}}},
               value,
               about(0.01, 0.03, 0.08)},
    EffectInfo{"torque_saturation", {{{"limit_Nm", false}}}, peak_share, about(0.90, 0.75, 0.55)},
    EffectInfo{"back_emf_limit", {{{"stall_Nm", false}, {"no_load_rad_per_s", false}}}, share, kShares},
    EffectInfo{"wheel_radius_mismatch", {{{"relative", false}}}, value, about(0.01, 0.03, 0.08)},
    EffectInfo{"wheel_slip",
               {{{"friction_coefficient", false}, {"slip_speed_m_per_s", false}}},
               travel_share,
               about(0.01, 0.04, 0.10)},
    EffectInfo{"payload_step",
               {{{"time_s", false}, {"mass_kg", false}, {"inertia_kg_m2", false}}},
               value,
               about(0.05, 0.15, 0.40)},
    EffectInfo{"gain_drift", {{{"loss", false}, {"time_constant_s", false}}}, value, about(0.05, 0.12, 0.30)},
    EffectInfo{
        "torque_ripple", {{{"amplitude_Nm", true}, {"order", false}, {"phase_rad", false}}}, share, kShares},
    EffectInfo{"encoder_quantisation",
               {{{"counts_per_turn", false}}},
               value,
               {{{16384, 16384}, {4096, 4096}, {1024, 1024}}}},
    EffectInfo{"gyro_bias", {{{"bias_rad_per_s", true}}}, value, about(0.005, 0.02, 0.06), true},
    EffectInfo{"measurement_lag",
               {{{"time_constant_s", false}}},
               value,
               about(0.010, 0.040, 0.120),
               false,
               false,
               true},
    EffectInfo{"log_outliers", {{{"rate", false}}}, value, about(0.0005, 0.002, 0.01), false, true},
    EffectInfo{"log_dropouts", {{{"rate", false}}}, value, about(0.0005, 0.002, 0.01), false, true},
};

}  // namespace

std::string_view name_of(Size size) {
    constexpr std::array<std::string_view, 3> kNames{"mild", "medium", "strong"};
    return kNames[static_cast<std::size_t>(size)];
}

std::span<const EffectInfo> all_effects() { return kTable; }

const EffectInfo* find_effect(std::string_view name) {
    const auto found =
        std::find_if(kTable.begin(), kTable.end(), [&](const EffectInfo& e) { return e.name == name; });
    return found == kTable.end() ? nullptr : &*found;
}

}  // namespace wheelwright::hidden
