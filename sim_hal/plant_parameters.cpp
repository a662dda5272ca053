#include "sim_hal/plant.hpp"

#include <algorithm>
#include <array>

#include "sim_hal/plant_effects.hpp"

namespace wheelwright::sim {

// A wheel turns at (v -+ omega b / 2) / radius: its rotation adds to all entries of M.
void add_rotation(PlantParameters& p, double wheel_inertia_kg_m2) {
    const double left =
        wheel_inertia_kg_m2 / (p.geometry.wheel_radius_m.left * p.geometry.wheel_radius_m.left);
    const double right =
        wheel_inertia_kg_m2 / (p.geometry.wheel_radius_m.right * p.geometry.wheel_radius_m.right);
    const double half_track = p.geometry.track_m / 2;
    p.mass_kg += left + right;
    p.inertia_kg_m2 += (left + right) * half_track * half_track;
    p.mass_coupling_kg_m += (right - left) * half_track;
}

namespace {

// What a wheel's inertia of one adds.
PlantParameters unit_rotation(const model::Geometry<double>& geometry) {
    PlantParameters unit;
    unit.geometry = geometry;
    add_rotation(unit, 1);
    return unit;
}

// Of one wheel; half of the robot must remain.
double wheel_inertia_of(const PlantParameters& p) {
    const PlantParameters unit = unit_rotation(p.geometry);
    const double told =
        p.wheel_inertia_kg_m2 > 0 ? p.wheel_inertia_kg_m2 : model::kRotationShare * p.mass_kg / unit.mass_kg;
    return std::min(told, 0.5 * p.inertia_kg_m2 / unit.inertia_kg_m2);
}

}  // namespace

PlantParameters plant_from_dynamics(const model::Geometry<double>& geometry,
                                    const model::Dynamics<double>& dynamics,
                                    const model::EffectSet<double>& effects) {
    const double radius = geometry.mean_radius_m();
    PlantParameters p;
    p.geometry = geometry;
    p.mass_kg = 1 / (dynamics.k7_per_kg_m * radius);
    p.inertia_kg_m2 = geometry.track_m / (2 * radius * dynamics.k8_per_kg_m2);
    p.centrifugal_kg_m = dynamics.k5_m * p.mass_kg;
    p.coriolis_kg_m = dynamics.k6_per_m * p.inertia_kg_m2;
    p.effects = effects;
    return p;
}

PlantParameters plant_from_mass(const model::Geometry<double>& geometry,
                                const model::MassProperties<double>& body,
                                const model::EffectSet<double>& effects) {
    const double moment = body.mass_kg * body.cog_ahead_m;
    PlantParameters p;
    p.geometry = geometry;
    p.mass_kg = body.mass_kg;
    p.inertia_kg_m2 = body.yaw_inertia_kg_m2 + moment * body.cog_ahead_m;
    p.centrifugal_kg_m = moment;
    p.coriolis_kg_m = -moment;
    p.effects = effects;
    p.wheel_inertia_kg_m2 = body.wheel_inertia_kg_m2;
    add_rotation(p, body.wheel_inertia_kg_m2);
    return p;
}

model::Dynamics<double> plant_dynamics(const PlantParameters& p) {
    const double radius = p.geometry.mean_radius_m();
    return {p.centrifugal_kg_m / p.mass_kg, p.coriolis_kg_m / p.inertia_kg_m2, 1 / (p.mass_kg * radius),
            p.geometry.track_m / (2 * radius * p.inertia_kg_m2)};
}

Plant::Matrix Plant::inverse_of(double a11, double a12, double a22) {
    const double determinant = a11 * a22 - a12 * a12;
    return {a22 / determinant, -a12 / determinant, -a12 / determinant, a11 / determinant};
}

void Plant::set_parameters(const PlantParameters& parameters) {
    const model::EffectSet<double> before = parameters_.effects;
    parameters_ = parameters;
    derive_actual();
    const PlantParameters& p = actual_;
    // The bias alone is a smooth torque like others; beside what stands on the way it is part of the way.
    // What the way does is not done again as a smooth torque.
    std::array<bool, model::kEffectCount> path = parameters_.effects.active;
    path[index_of<model::TorqueBias>()] = false;
    torque_path_ = model::changes_torque_path(path);
    path_effects_ = actual_.effects;
    if (torque_path_) {
        for (const std::size_t i : model::kPathOrder) actual_.effects.active[i] = false;
    }
    wheels_only_ = true;
    model::for_each_active(p.effects.active, [this]<typename Effect>(std::size_t) {
        if constexpr (model::SmoothTorque<Effect> && !model::OnTorquePath<Effect>)
            wheels_only_ = wheels_only_ && model::EachWheel<Effect>;
    });
    if (before.active != parameters_.effects.active || before.parameter != parameters_.effects.parameter)
        path_memory_ = {};
    slips_ = is_active<model::WheelSlip>(p.effects);
    castor_turns_ = is_active<model::CastorDrag>(p.effects);
    dry_changes_ = castor_turns_ || is_active<model::StribeckFriction>(p.effects);
    plain_ = !torque_path_ && !slips_ && !dry_changes_ && payload_s_ < 0;

    const double radius_left = p.geometry.wheel_radius_m.left;
    const double radius_right = p.geometry.wheel_radius_m.right;
    const double half_track = p.geometry.track_m / 2;
    const Matrix inverse = inverse_of(p.mass_kg, p.mass_coupling_kg_m, p.inertia_kg_m2);
    // G has the rows (1, -b/2) / r_left and (1, b/2) / r_right.
    from_force_ = {(inverse.a11 - half_track * inverse.a12) / radius_left,
                   (inverse.a12 - half_track * inverse.a22) / radius_left,
                   (inverse.a11 + half_track * inverse.a12) / radius_right,
                   (inverse.a12 + half_track * inverse.a22) / radius_right};
    from_torque_ = {(from_force_.a11 - half_track * from_force_.a12) / radius_left,
                    (from_force_.a11 + half_track * from_force_.a12) / radius_right,
                    (from_force_.a21 - half_track * from_force_.a22) / radius_left,
                    (from_force_.a21 + half_track * from_force_.a22) / radius_right};
    list_dry();
    derive_slip();
    place(pose_, twist_);
}

// What the effects make of geometry and masses.
void Plant::derive_actual() {
    actual_ = parameters_;
    PlantParameters& p = actual_;
    p.wheel_inertia_kg_m2 = wheel_inertia_of(p);
    if (const auto* radii = parameters_of<model::WheelRadiusMismatch>(parameters_.effects)) {
        add_rotation(p, -p.wheel_inertia_kg_m2);
        p.geometry = model::WheelRadiusMismatch::geometry(*radii, p.geometry);
        add_rotation(p, p.wheel_inertia_kg_m2);
    }
    const double ahead = p.centrifugal_kg_m / p.mass_kg;
    const auto* lateral = parameters_of<model::CogLateral>(parameters_.effects);
    lateral_m_ = lateral != nullptr ? (*lateral)[0] : 0;
    p.mass_coupling_kg_m -= lateral_m_ * p.mass_kg;
    payload_s_ = -1;
    if (const auto* load = parameters_of<model::PayloadStep>(parameters_.effects)) {
        if (loaded_) {
            const double mass = (*load)[1];
            const double at = ahead + (*load)[3];
            p.mass_kg += mass;
            p.inertia_kg_m2 += (*load)[2] + mass * (at * at + lateral_m_ * lateral_m_);
            p.mass_coupling_kg_m -= mass * lateral_m_;
            p.centrifugal_kg_m += mass * at;
            p.coriolis_kg_m -= mass * at;
        } else {
            payload_s_ = (*load)[0];
        }
    }
    dynamics_ = plant_dynamics(p);
    if (parameters_of<model::Backlash>(parameters_.effects) != nullptr) {
        // most of the robot must remain
        double& motor = p.effects.parameter[index_of<model::Backlash>()][1];
        const PlantParameters unit = unit_rotation(p.geometry);
        motor = std::min({motor, 0.8 * p.mass_kg / unit.mass_kg, 0.8 * p.inertia_kg_m2 / unit.inertia_kg_m2});
        add_rotation(p, -motor);
    }
}

void Plant::add_payload(const Payload& load) {
    PlantParameters p = parameters_;
    p.mass_kg += load.mass_kg;
    p.inertia_kg_m2 +=
        load.inertia_kg_m2 + load.mass_kg * (load.ahead_m * load.ahead_m + load.left_m * load.left_m);
    p.mass_coupling_kg_m -= load.mass_kg * load.left_m;
    p.centrifugal_kg_m += load.mass_kg * load.ahead_m;
    p.coriolis_kg_m -= load.mass_kg * load.ahead_m;
    set_parameters(p);
}

}  // namespace wheelwright::sim
