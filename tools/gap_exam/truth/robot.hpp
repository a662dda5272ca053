// The exam's robots: what is drawn for one log.
#pragma once

#include <array>
#include <string_view>

#include "tools/gap_exam/truth/laws.hpp"
#include "tools/gap_trials/hidden/random.hpp"

namespace wheelwright::exam {

using hidden::Random;

template <typename T>
using Sides = std::array<T, 2>;  // left, right

// The one thing that is further than friction, of continuous size. Those from soft_floor on are in no
// catalogue.
enum class Further {
    nothing,
    stribeck_friction,
    quadratic_drag,
    turning_scrub,
    castor_drag,
    slope,
    torque_bias,
    torque_gain_mismatch,
    cog_lateral,
    actuator_lag,
    transport_delay,
    dead_zone,
    backlash,
    torque_saturation,
    back_emf_limit,
    wheel_radius_mismatch,
    wheel_slip,
    payload_step,
    gain_drift,
    torque_ripple,
    measurement_lag,
    soft_floor,
    tether,
    wind,
    load_dependent_friction,
    elastic_shaft,
    cold_grease,
};
inline constexpr std::array<std::string_view, 27> kFurtherNames{
    "nothing",
    "stribeck_friction",
    "quadratic_drag",
    "turning_scrub",
    "castor_drag",
    "slope",
    "torque_bias",
    "torque_gain_mismatch",
    "cog_lateral",
    "actuator_lag",
    "transport_delay",
    "dead_zone",
    "backlash",
    "torque_saturation",
    "back_emf_limit",
    "wheel_radius_mismatch",
    "wheel_slip",
    "payload_step",
    "gain_drift",
    "torque_ripple",
    "measurement_lag",
    "soft_floor",
    "tether",
    "wind",
    "load_dependent_friction",
    "elastic_shaft",
    "cold_grease",
};
inline constexpr std::size_t kFirstOutside = static_cast<std::size_t>(Further::soft_floor);
constexpr std::string_view name_of(Further f) { return kFurtherNames[static_cast<std::size_t>(f)]; }
constexpr bool in_catalogue(Further f) {
    return f != Further::nothing && static_cast<std::size_t>(f) < kFirstOutside;
}
constexpr bool outside_catalogue(Further f) { return static_cast<std::size_t>(f) >= kFirstOutside; }

struct Robot {
    double mass_kg = 1, yaw_inertia_kg_m2 = 0.1;  // about the centre of gravity, wheels' spin excluded
    double cog_ahead_m = 0, cog_left_m = 0;       // of the middle between the wheels
    double wheel_inertia_kg_m2 = 0;               // one wheel with gear and rotor
    Sides<double> wheel_radius_m{0.1, 0.1};
    double track_m = 0.4;
    double torque_limit_Nm = 1, top_speed_rad_per_s = 10;  // of a wheel
    Sides<DryFriction> dry;
    Sides<double> viscous_Nm_s_per_rad{};
    double rough_Nm = 0,
           rough_length_m = 0.2;  // ground's resistance at a wheel: RMS, and how far it is alike

    // The one that is there, and how much of it: 1 is as large as the effect is ever drawn; and numbers of
    // its own that do not change with its size, evenly in [0, 1).
    Further further = Further::nothing;
    double amount = 0;
    std::array<double, 4> draw{};

    double mean_radius_m() const { return (wheel_radius_m[0] + wheel_radius_m[1]) / 2; }
    double effective_mass_kg() const;  // wheels' rotation included, of mean radius
    double effective_inertia_kg_m2() const;
    double share(std::size_t i, double low, double high) const { return low + (high - low) * draw[i]; }
};

// What the largest amount of the effect is for this robot: in the effect's own unit, as simulator.cpp says.
double largest(const Robot& robot);

// 1 to 200 kg; all else in proportion, and drawn.
Robot draw_robot(Random& random);

}  // namespace wheelwright::exam
