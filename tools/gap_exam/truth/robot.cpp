#include "tools/gap_exam/truth/robot.hpp"

namespace wheelwright::exam {
namespace {

constexpr double kGravity_m_per_s2 = 9.80665;

}  // namespace

double Robot::effective_mass_kg() const {
    return mass_kg + 2 * wheel_inertia_kg_m2 / (mean_radius_m() * mean_radius_m());
}

double Robot::effective_inertia_kg_m2() const {
    return yaw_inertia_kg_m2 + mass_kg * (cog_ahead_m * cog_ahead_m + cog_left_m * cog_left_m) +
           wheel_inertia_kg_m2 * track_m * track_m / (2 * mean_radius_m() * mean_radius_m());
}

double largest(const Robot& r) {
    const double force_N = 2 * r.torque_limit_Nm / r.mean_radius_m();
    const double top_m_per_s = r.top_speed_rad_per_s * r.mean_radius_m();
    switch (r.further) {
        case Further::nothing:
            return 0;
        case Further::stribeck_friction:
            return r.torque_limit_Nm;  // static above level
        case Further::quadratic_drag:
            return force_N;  // at top speed
        case Further::turning_scrub:
            return force_N * r.track_m / 4;  // Nm
        case Further::castor_drag:
            return force_N / 2;  // rolling N
        case Further::slope:
            return std::min(0.3, force_N / (r.mass_kg * kGravity_m_per_s2) / 2);  // rad
        case Further::torque_bias:
            return r.torque_limit_Nm;  // of the stronger side
        case Further::torque_gain_mismatch:
            return 0.8;
        case Further::cog_lateral:
            return r.track_m / 2;
        case Further::actuator_lag:
            return 0.15;  // s
        case Further::transport_delay:
            return 0.05;  // s
        case Further::dead_zone:
            return r.torque_limit_Nm / 2;
        case Further::backlash:
            return 0.3;  // half gap, rad
        case Further::torque_saturation:
            return 0.8;  // share of the limit lost
        case Further::back_emf_limit:
            return 0.95;  // torque lost at top speed
        case Further::wheel_radius_mismatch:
            return 0.4;
        case Further::wheel_slip:
            return 1;  // softness of the tyre
        case Further::payload_step:
            return 1.5 * r.mass_kg;
        case Further::gain_drift:
            return 0.6;  // share lost in the end
        case Further::torque_ripple:
            return r.torque_limit_Nm;
        case Further::measurement_lag:
            return 0.2;  // s
        case Further::soft_floor:
            return force_N / 2;
        case Further::tether:
            return force_N / (top_m_per_s * 4);  // N/m
        case Further::wind:
            return force_N / 2;
        case Further::load_dependent_friction:
            return 0.6;  // Nm per Nm
        case Further::elastic_shaft:
            return 1;  // softness of the shaft
        case Further::cold_grease:
            return 20;  // viscous friction more, cold
    }
    return 0;
}

Robot draw_robot(Random& random) {
    Robot r;
    r.mass_kg = random.log_uniform(1, 200);
    const double scale = std::cbrt(r.mass_kg);
    const double radius_m = std::clamp(0.035 * scale * random.log_uniform(0.7, 1.5), 0.025, 0.2);
    r.wheel_radius_m = {radius_m, radius_m};
    r.track_m = std::max(0.16 * scale * random.log_uniform(0.75, 1.35), 3 * radius_m);
    const double gyration_m = r.track_m * random.uniform(0.33, 0.55);
    r.yaw_inertia_kg_m2 = r.mass_kg * gyration_m * gyration_m;
    r.cog_ahead_m = r.track_m * random.uniform(-0.3, 0.3);
    const double rotor_share = random.log_uniform(0.02, 0.4);
    r.wheel_inertia_kg_m2 = r.mass_kg * rotor_share / (1 - rotor_share) * radius_m * radius_m / 2;
    const double fastest_m_per_s2 = random.log_uniform(0.8, 6);
    r.torque_limit_Nm = fastest_m_per_s2 * r.effective_mass_kg() * radius_m / 2;
    r.top_speed_rad_per_s = random.log_uniform(0.4, 3) / radius_m;

    // 2 to 25 % of the torque limit at top speed, dry and viscous in any proportion.
    double dry = 0;
    double viscous = 0;
    do {
        dry = random.log_uniform(0.003, 0.25);
        viscous = random.log_uniform(0.003, 0.25);
    } while (dry + viscous < 0.02 || dry + viscous > 0.25);
    const auto law = static_cast<DryLaw>(random.below(3));
    const double rise = law == DryLaw::tanh ? 0 : random.uniform(0, 0.4);
    const double smooth = random.log_uniform(0.003, 0.02);
    const double stribeck = smooth * random.log_uniform(3, 10);
    for (std::size_t side = 0; side < 2; ++side) {
        const double level_Nm = dry * r.torque_limit_Nm * random.uniform(0.85, 1.15);
        DryFriction& f = r.dry[side];
        f.law = law;
        f.level_Nm = level_Nm;
        f.static_Nm = level_Nm * (1 + rise);
        f.smooth_rad_per_s = smooth * r.top_speed_rad_per_s;
        f.stribeck_rad_per_s = stribeck * r.top_speed_rad_per_s;
        // Bristles that bend by a two-thousandth of the angle of a second at top speed; damping as is usual,
        // half of what keeps the wheel's inertia from swinging on them.
        f.bristle_Nm_per_rad = level_Nm / (r.top_speed_rad_per_s * 0.0005);
        const double inertia_kg_m2 = r.effective_mass_kg() * radius_m * radius_m / 2;
        f.damping_Nm_s_per_rad =
            std::min(std::sqrt(f.bristle_Nm_per_rad * inertia_kg_m2), 0.5 * level_Nm / f.stribeck_rad_per_s);
        r.viscous_Nm_s_per_rad[side] =
            viscous * r.torque_limit_Nm / r.top_speed_rad_per_s * random.uniform(0.85, 1.15);
    }
    r.rough_Nm = r.torque_limit_Nm * random.log_uniform(0.001, 0.03);
    r.rough_length_m = r.track_m * random.log_uniform(0.1, 1);
    for (double& draw : r.draw) draw = random.uniform();
    return r;
}

}  // namespace wheelwright::exam
