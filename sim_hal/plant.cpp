#include "sim_hal/plant.hpp"

#include <algorithm>
#include <cmath>

#include "sim_hal/plain_math.hpp"

namespace wheelwright::sim {

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
    // A wheel turns at (v -+ omega b / 2) / radius: its rotation adds to all entries of M.
    const double left =
        body.wheel_inertia_kg_m2 / (geometry.wheel_radius_m.left * geometry.wheel_radius_m.left);
    const double right =
        body.wheel_inertia_kg_m2 / (geometry.wheel_radius_m.right * geometry.wheel_radius_m.right);
    const double half_track = geometry.track_m / 2;
    const double moment = body.mass_kg * body.cog_ahead_m;
    PlantParameters p;
    p.geometry = geometry;
    p.mass_kg = body.mass_kg + left + right;
    p.inertia_kg_m2 =
        body.yaw_inertia_kg_m2 + moment * body.cog_ahead_m + (left + right) * half_track * half_track;
    p.mass_coupling_kg_m = (right - left) * half_track;
    p.centrifugal_kg_m = moment;
    p.coriolis_kg_m = -moment;
    p.effects = effects;
    return p;
}

model::Dynamics<double> plant_dynamics(const PlantParameters& p) {
    const double radius = p.geometry.mean_radius_m();
    return {p.centrifugal_kg_m / p.mass_kg, p.coriolis_kg_m / p.inertia_kg_m2, 1 / (p.mass_kg * radius),
            p.geometry.track_m / (2 * radius * p.inertia_kg_m2)};
}

Plant::Plant(const PlantParameters& parameters, const Pose<double>& start) {
    set_parameters(parameters);
    place(start, {});
}

void Plant::set_parameters(const PlantParameters& parameters) {
    parameters_ = parameters;
    dynamics_ = plant_dynamics(parameters);
    torque_path_ = false;
    wheels_only_ = true;
    model::for_each_active(parameters.effects.active, [this]<typename Effect>(std::size_t) {
        if constexpr (model::OnTorquePath<Effect>) {
            torque_path_ = true;
        } else if constexpr (model::SmoothTorque<Effect>) {
            wheels_only_ = wheels_only_ && model::EachWheel<Effect>;
        }
    });
    const PlantParameters& p = parameters_;
    const double radius_left = p.geometry.wheel_radius_m.left;
    const double radius_right = p.geometry.wheel_radius_m.right;
    const double half_track = p.geometry.track_m / 2;

    const double determinant = p.mass_kg * p.inertia_kg_m2 - p.mass_coupling_kg_m * p.mass_coupling_kg_m;
    const double inverse_11 = p.inertia_kg_m2 / determinant;
    const double inverse_12 = -p.mass_coupling_kg_m / determinant;
    const double inverse_22 = p.mass_kg / determinant;
    // G has the rows (1, -b/2) / r_left and (1, b/2) / r_right.
    from_force_ = {(inverse_11 - half_track * inverse_12) / radius_left,
                   (inverse_12 - half_track * inverse_22) / radius_left,
                   (inverse_11 + half_track * inverse_12) / radius_right,
                   (inverse_12 + half_track * inverse_22) / radius_right};
    from_torque_ = {(from_force_.a11 - half_track * from_force_.a12) / radius_left,
                    (from_force_.a11 + half_track * from_force_.a12) / radius_right,
                    (from_force_.a21 - half_track * from_force_.a22) / radius_left,
                    (from_force_.a21 + half_track * from_force_.a22) / radius_right};

    const std::array<DryEffect, model::kMaxColumns> before = dry_;
    const std::size_t count_before = dry_count_;
    dry_count_ = 0;
    model::for_each_dry(
        p.effects, p.geometry,
        [&](std::size_t, unsigned, const WheelPair<double>& direction, double limit_Nm) {
            if (limit_Nm <= 0) return;
            DryEffect& dry = dry_[dry_count_++];
            dry.direction = direction;
            dry.response = {from_torque_.a11 * direction.left + from_torque_.a12 * direction.right,
                            from_torque_.a21 * direction.left + from_torque_.a22 * direction.right};
            dry.limit_Nm = limit_Nm;
            dry.compliance = direction.left * dry.response.left + direction.right * dry.response.right;
        });
    for (std::size_t j = 0; j < dry_count_; ++j) {
        const double last = dry_count_ == count_before ? before[j].lambda_Nm : 0;
        dry_[j].lambda_Nm = std::clamp(last, -dry_[j].limit_Nm, dry_[j].limit_Nm);
    }
    place(pose_, twist_);
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

void Plant::place(const Pose<double>& pose, const Twist<double>& twist) {
    pose_ = pose;
    const SineCosine heading = sine_cosine(pose.heading_rad);
    heading_sine_ = heading.sine;
    heading_cosine_ = heading.cosine;
    twist_ = twist;
    speed_ = model::wheel_speeds_from_twist(parameters_.geometry, twist);
}

double Plant::kinetic_energy_J() const {
    const double v = twist_.v_m_per_s;
    const double omega = twist_.omega_rad_per_s;
    return (parameters_.mass_kg * v * v + parameters_.inertia_kg_m2 * omega * omega) / 2 +
           parameters_.mass_coupling_kg_m * v * omega;
}

Twist<double> Plant::twist_of(const WheelPair<double>& speed) const {
    return model::twist_from_wheel_speeds(parameters_.geometry, speed);
}

// At `since_s` after the step's begin, by when the wheels have turned at `speed`.
template <bool kWheelsOnly>
WheelPair<double> Plant::acceleration(const WheelPair<double>& speed, const WheelPair<double>& torque_Nm,
                                      double since_s, WheelPair<double>& smooth_Nm) const {
    const Twist<double> u = twist_of(speed);
    const model::Motion<double> motion{
        speed,
        {angle_.left + since_s * speed.left, angle_.right + since_s * speed.right},
        u,
        pose_.heading_rad + since_s * u.omega_rad_per_s};
    const WheelPair<double> smooth = model::smooth_effect_torque_Nm<kWheelsOnly>(
        parameters_.effects, {motion, torque_Nm, parameters_.geometry, dynamics_});
    smooth_Nm = smooth;
    const double forward =
        parameters_.centrifugal_kg_m * u.omega_rad_per_s * u.omega_rad_per_s + disturbance_.force_N;
    const double yaw =
        parameters_.coriolis_kg_m * u.v_m_per_s * u.omega_rad_per_s + disturbance_.yaw_torque_Nm;
    const double left = torque_Nm.left + smooth.left;
    const double right = torque_Nm.right + smooth.right;
    return {from_force_.a11 * forward + from_force_.a12 * yaw + from_torque_.a11 * left +
                from_torque_.a12 * right,
            from_force_.a21 * forward + from_force_.a22 * yaw + from_torque_.a21 * left +
                from_torque_.a22 * right};
}

// `speed` comes without the dry torques and leaves with them.
void Plant::solve_dry(double dt_s, WheelPair<double>& speed) {
    // Two wheels' own friction converges tenfold and faster per sweep; the bound is for the odd case of more
    // directions than wheels.
    constexpr int kMostSweeps = 60;
    constexpr double kTolerance = 1e-14;

    for (std::size_t j = 0; j < dry_count_; ++j) {
        speed.left -= dt_s * dry_[j].lambda_Nm * dry_[j].response.left;
        speed.right -= dt_s * dry_[j].lambda_Nm * dry_[j].response.right;
    }
    for (int sweep = 0; sweep < kMostSweeps; ++sweep) {
        bool settled = true;
        for (std::size_t j = 0; j < dry_count_; ++j) {
            DryEffect& dry = dry_[j];
            const double sliding = model::sliding_speed(dry.direction, speed);
            const double wanted = dry.lambda_Nm + sliding / (dt_s * dry.compliance);
            const double lambda = std::clamp(wanted, -dry.limit_Nm, dry.limit_Nm);
            const double change = lambda - dry.lambda_Nm;
            if (change == 0) continue;
            if (std::abs(change) > kTolerance * dry.limit_Nm) settled = false;
            dry.lambda_Nm = lambda;
            speed.left -= dt_s * change * dry.response.left;
            speed.right -= dt_s * change * dry.response.right;
        }
        if (settled) break;
    }
    // What sticks has no speed at all: rounding must not let a parked robot creep.
    WheelPair<double> stuck{};
    bool have_one = false;
    for (std::size_t j = 0; j < dry_count_; ++j) {
        const DryEffect& dry = dry_[j];
        if (std::abs(dry.lambda_Nm) >= dry.limit_Nm) continue;
        if (have_one && dry.direction.left * stuck.right !=
                            dry.direction.right * stuck.left) {  // two directions: no motion
            speed = {};
            return;
        }
        have_one = true;
        stuck = dry.direction;
        const double remains =
            model::sliding_speed(stuck, speed) / (stuck.left * stuck.left + stuck.right * stuck.right);
        speed.left = stuck.right == 0 ? 0 : speed.left - remains * stuck.left;
        speed.right = stuck.left == 0 ? 0 : speed.right - remains * stuck.right;
    }
}

WheelPair<double> Plant::dry_torque_Nm() const {
    WheelPair<double> dry{};
    for (std::size_t j = 0; j < dry_count_; ++j) {
        dry.left -= dry_[j].lambda_Nm * dry_[j].direction.left;
        dry.right -= dry_[j].lambda_Nm * dry_[j].direction.right;
    }
    return dry;
}

// When within the step, as a part of it, a sliding first comes to zero; 1 when none does. The sliding is
// linear in time while friction keeps its size, to the accuracy of the step.
double Plant::cut_at(double dt_s, const WheelPair<double>& without_dry,
                     const WheelPair<double>& speed) const {
    WheelPair<double> kept = without_dry;  // the end of the step, had friction kept its direction
    bool ended = false;
    for (std::size_t j = 0; j < dry_count_; ++j) {
        const DryEffect& dry = dry_[j];
        const double before = model::sliding_speed(dry.direction, speed_);
        const double after = model::sliding_speed(dry.direction, speed);
        const double direction = before > 0 ? 1 : before < 0 ? -1 : 0;
        ended = ended || (direction != 0 && after * direction <= 0);
        const double lambda = direction != 0 ? direction * dry.limit_Nm : dry.lambda_Nm;
        kept.left -= dt_s * lambda * dry.response.left;
        kept.right -= dt_s * lambda * dry.response.right;
    }
    if (!ended) return 1;
    double cut = 1;
    for (std::size_t j = 0; j < dry_count_; ++j) {
        const double before = model::sliding_speed(dry_[j].direction, speed_);
        const double after = model::sliding_speed(dry_[j].direction, kept);
        if (before * after < 0) cut = std::min(cut, before / (before - after));
    }
    return cut;
}

WheelPair<double> Plant::delivered_torque_Nm(const WheelPair<double>& torque_Nm) const {
    const model::Motion<double> motion{speed_, angle_, twist_, pose_.heading_rad};
    return model::delivered_torque_Nm(parameters_.effects,
                                      {motion, torque_Nm, parameters_.geometry, dynamics_});
}

void Plant::advance(double dt_s, const WheelPair<double>& torque_Nm) {
    constexpr int kMostCuts = 4;
    double rest_s = dt_s;
    if (torque_path_) {
        const WheelPair<double> delivered = delivered_torque_Nm(torque_Nm);
        for (int cuts = 0; rest_s > 0; ++cuts) rest_s -= step(rest_s, delivered, cuts < kMostCuts);
    } else {
        for (int cuts = 0; rest_s > 0; ++cuts) rest_s -= step(rest_s, torque_Nm, cuts < kMostCuts);
    }
}

// Returns the time taken: all of dt_s, or less when the step was cut.
double Plant::step(double dt_s, const WheelPair<double>& torque_Nm, bool may_cut) {
    WheelPair<double> speed;
    WheelPair<double> smooth;
    const bool slides = wheels_only_ ? step_sliding<true>(dt_s, torque_Nm, speed, smooth)
                                     : step_sliding<false>(dt_s, torque_Nm, speed, smooth);
    if (!slides) {
        const double cut_s = step_sticking(dt_s, torque_Nm, may_cut, speed, smooth);
        if (cut_s < dt_s) return step(cut_s, torque_Nm, false);
    }
    const double turned_left = dt_s / 2 * (speed_.left + speed.left);
    const double turned_right = dt_s / 2 * (speed_.right + speed.right);
    angle_.left += turned_left;
    angle_.right += turned_right;
    const Twist<double> moved = twist_of({turned_left, turned_right});
    advance_pose(moved.v_m_per_s, moved.omega_rad_per_s);
    speed_ = speed;
    twist_ = twist_of(speed);
    motor_Nm_ = torque_Nm;
    smooth_Nm_ = smooth;
    return dt_s;
}

// The step whatever sticks or comes to rest. Returns the part of it after which it should be cut; dt_s: none.
double Plant::step_sticking(double dt_s, const WheelPair<double>& torque_Nm, bool may_cut,
                            WheelPair<double>& speed, WheelPair<double>& smooth_Nm) {
    constexpr double kShortest_s = 1e-9;
    const WheelPair<double> first = acceleration<false>(speed_, torque_Nm, 0, smooth_Nm);
    WheelPair<double> middle{speed_.left + dt_s / 2 * first.left, speed_.right + dt_s / 2 * first.right};
    solve_dry(dt_s / 2, middle);
    const WheelPair<double> second = acceleration<false>(middle, torque_Nm, dt_s / 2, smooth_Nm);
    speed = {speed_.left + dt_s * second.left, speed_.right + dt_s * second.right};
    const WheelPair<double> without_dry = speed;
    solve_dry(dt_s, speed);
    if (!may_cut) return dt_s;
    const double cut_s = dt_s * cut_at(dt_s, without_dry, speed);
    return cut_s > kShortest_s && cut_s < dt_s - kShortest_s ? cut_s : dt_s;
}

// The step when everything slides from its begin to its end without reversing, which is nearly always: then
// all dry torques are at their limits and nothing is to be solved. False, and no change, when it is not so.
template <bool kWheelsOnly>
bool Plant::step_sliding(double dt_s, const WheelPair<double>& torque_Nm, WheelPair<double>& speed,
                         WheelPair<double>& smooth_Nm) {
    WheelPair<double> torque = torque_Nm;
    std::array<double, model::kMaxColumns> sense;  // of sliding
    for (std::size_t j = 0; j < dry_count_; ++j) {
        const DryEffect& dry = dry_[j];
        const double sliding = model::sliding_speed(dry.direction, speed_);
        if (sliding == 0) return false;
        sense[j] = sliding > 0 ? 1 : -1;
        torque.left -= sense[j] * dry.limit_Nm * dry.direction.left;
        torque.right -= sense[j] * dry.limit_Nm * dry.direction.right;
    }
    const WheelPair<double> first = acceleration<kWheelsOnly>(speed_, torque, 0, smooth_Nm);
    const WheelPair<double> middle{speed_.left + dt_s / 2 * first.left,
                                   speed_.right + dt_s / 2 * first.right};
    const WheelPair<double> second = acceleration<kWheelsOnly>(middle, torque, dt_s / 2, smooth_Nm);
    speed = {speed_.left + dt_s * second.left, speed_.right + dt_s * second.right};
    for (std::size_t j = 0; j < dry_count_; ++j) {
        if (!(sense[j] * model::sliding_speed(dry_[j].direction, speed) > 0)) return false;
    }
    for (std::size_t j = 0; j < dry_count_; ++j) dry_[j].lambda_Nm = sense[j] * dry_[j].limit_Nm;
    return true;
}

// As model::advance_along_arc, with the heading's sine and cosine carried along instead of computed.
void Plant::advance_pose(double distance_m, double turn_rad) {
    const double half = turn_rad / 2;
    const double square = half * half;
    // A step turns by far less than 0.1 rad: the series are exact to rounding.
    const double shrink = 1 - square / 6 * (1 - square / 20 * (1 - square / 42));
    const double sine = half * shrink;
    const double cosine = 1 - square / 2 * (1 - square / 12 * (1 - square / 30 * (1 - square / 56)));
    const double middle_cosine = heading_cosine_ * cosine - heading_sine_ * sine;
    const double middle_sine = heading_sine_ * cosine + heading_cosine_ * sine;
    pose_.x_m += distance_m * shrink * middle_cosine;
    pose_.y_m += distance_m * shrink * middle_sine;
    pose_.heading_rad += turn_rad;
    const double end_cosine = middle_cosine * cosine - middle_sine * sine;
    const double end_sine = middle_sine * cosine + middle_cosine * sine;
    const double rescale = 1.5 - (end_cosine * end_cosine + end_sine * end_sine) / 2;
    heading_cosine_ = end_cosine * rescale;
    heading_sine_ = end_sine * rescale;
}

}  // namespace wheelwright::sim
