// The exam's laws of friction, tyre, drive and ground, each with its source. None is the catalogue's.
#pragma once

#include <algorithm>
#include <cmath>

namespace wheelwright::exam {

// ---- dry friction of a wheel, by one of three laws that are smooth where the catalogue has a sign
// -----------

enum class DryLaw { tanh, makkar, lugre };

struct DryFriction {
    DryLaw law = DryLaw::tanh;
    double level_Nm = 0;              // at speed
    double static_Nm = 0;             // creeping; not used by tanh
    double stribeck_rad_per_s = 1;    // over which it falls from one to the other; not used by tanh
    double smooth_rad_per_s = 0.1;    // tanh, makkar: over which the sign changes
    double bristle_Nm_per_rad = 0;    // lugre: stiffness
    double damping_Nm_s_per_rad = 0;  // lugre: of the bristles
};

// LuGre's level at a steady speed (Canudas de Wit, Olsson, Astrom, Lischinsky 1995, eq 5).
inline double lugre_level_Nm(const DryFriction& f, double speed_rad_per_s) {
    const double share = speed_rad_per_s / f.stribeck_rad_per_s;
    return f.level_Nm + (f.static_Nm - f.level_Nm) * std::exp(-share * share);
}

// How fast the bristles bend, eq 3 there.
inline double lugre_bend_rate(const DryFriction& f, double bend_rad, double speed_rad_per_s) {
    if (f.law != DryLaw::lugre || !(f.level_Nm > 0)) return 0;
    return speed_rad_per_s -
           f.bristle_Nm_per_rad * std::abs(speed_rad_per_s) / lugre_level_Nm(f, speed_rad_per_s) * bend_rad;
}

// Torque against the motion, without anything viscous. Makkar, Dixon, Sawyer, Hu (2005), eq 2: tanh's in
// place of the sign and of Stribeck's fall.
inline double dry_torque_Nm(const DryFriction& f, double bend_rad, double speed_rad_per_s) {
    if (f.law == DryLaw::lugre) {
        return f.bristle_Nm_per_rad * bend_rad +
               f.damping_Nm_s_per_rad * lugre_bend_rate(f, bend_rad, speed_rad_per_s);
    }
    const double sign = std::tanh(speed_rad_per_s / f.smooth_rad_per_s);
    if (f.law == DryLaw::tanh) return f.level_Nm * sign;
    return f.level_Nm * sign +
           (f.static_Nm - f.level_Nm) * (sign - std::tanh(speed_rad_per_s / f.stribeck_rad_per_s));
}

// ---- tyres
// ------------------------------------------------------------------------------------------------------

struct MagicFormula {
    double stiffness = 10, shape = 1.9, peak = 1, curvature = 0.97;  // B, C, D, E
};

// Force over load (Pacejka, Bakker 1992).
inline double magic_formula(const MagicFormula& m, double slip) {
    const double bent = m.stiffness * slip;
    return m.peak * std::sin(m.shape * std::atan(bent - m.curvature * (bent - std::atan(bent))));
}

// ---- torque between command and shaft
// ---------------------------------------------------------------------------

// A limit that is neared smoothly: x / (1 + |x / limit|^n)^(1/n).
inline double soft_limited(double x, double limit) {
    constexpr double kSharpness = 12;
    return x / std::pow(1 + std::pow(std::abs(x) / limit, kSharpness), 1 / kSharpness);
}

// What is small is lost, without a corner: nothing near zero, x less the width far out.
inline double soft_dead_zone(double x, double width) {
    return width > 0 ? x - width * std::tanh(x / width) : x;
}

// Angle by which teeth are pressed together, of an angle between motor and wheel.
inline double pressed_rad(double twist_rad, double half_gap_rad) {
    return twist_rad - std::clamp(twist_rad, -half_gap_rad, half_gap_rad);
}

}  // namespace wheelwright::exam
