// The robots of the trials.
#pragma once

#include "tools/gap_trials/hidden/effects.hpp"
#include "tools/gap_trials/hidden/random.hpp"

namespace wheelwright::hidden {

// A robot with two driven wheels and a castor. The wheels belong to mass_kg.
struct Robot {
    double wheel_radius_m = 0;  // rolling radius, mean of both
    double track_m = 0;
    double mass_kg = 0;
    double yaw_inertia_kg_m2 = 0;    // about the centre of gravity, the wheels' spin excluded
    double cog_ahead_m = 0;          // ahead of the axle
    double cog_height_m = 0;         // above the ground
    double wheel_mass_kg = 0;        // one wheel
    double wheel_inertia_kg_m2 = 0;  // about its axle, with gearbox and rotor
    double castor_ahead_m = 0;       // contact point, or swivel axis
    double torque_limit_Nm = 0;      // what the drives are asked for at most

    // What both wheels must push, and what they must turn: the motors' view of mass and inertia.
    double effective_mass_kg() const {
        return mass_kg + 2 * wheel_inertia_kg_m2 / (wheel_radius_m * wheel_radius_m);
    }
    double effective_inertia_kg_m2() const {
        return yaw_inertia_kg_m2 + mass_kg * cog_ahead_m * cog_ahead_m +
               wheel_inertia_kg_m2 * track_m * track_m / (2 * wheel_radius_m * wheel_radius_m);
    }
};

// Every length and mass within 8 % of a nominal robot of 11 kg on wheels of 83 mm. The torque limit lets all
// three wheels stay on the ground and the tyres hold.
Robot draw_robot(Random& random);

}  // namespace wheelwright::hidden
