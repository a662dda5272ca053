#include "sim_hal/plant.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "sim_hal/plain_math.hpp"

namespace wheelwright::sim {
namespace {

constexpr int kMostCuts = 4;

template <typename Effect>
constexpr std::size_t index_of() {
    return model::find_effect(Effect::info.name);
}

template <typename Effect>
bool is_active(const model::EffectSet<double>& set) {
    return set.active[index_of<Effect>()];
}

// nullptr when the effect is not active.
template <typename Effect>
const model::Parameters<double>* parameters_of(const model::EffectSet<double>& set) {
    return is_active<Effect>(set) ? &set.parameter[index_of<Effect>()] : nullptr;
}

}  // namespace

Plant::Matrix Plant::inverse_of(double a11, double a12, double a22) {
    const double determinant = a11 * a22 - a12 * a12;
    return {a22 / determinant, -a12 / determinant, -a12 / determinant, a11 / determinant};
}

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
    p.wheel_inertia_kg_m2 = body.wheel_inertia_kg_m2;
    return p;
}

model::Dynamics<double> plant_dynamics(const PlantParameters& p) {
    const double radius = p.geometry.mean_radius_m();
    return {p.centrifugal_kg_m / p.mass_kg, p.coriolis_kg_m / p.inertia_kg_m2, 1 / (p.mass_kg * radius),
            p.geometry.track_m / (2 * radius * p.inertia_kg_m2)};
}

Plant::Plant(const PlantParameters& parameters, const Pose<double>& start) {
    time_s_ = parameters.start_s;
    angle_ = parameters.start_angle_rad;
    set_parameters(parameters);
    place(start, {});
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
    if (const auto* radii = parameters_of<model::WheelRadiusMismatch>(parameters_.effects))
        p.geometry = model::WheelRadiusMismatch::geometry(*radii, p.geometry);
    const double ahead = p.centrifugal_kg_m / p.mass_kg;
    const auto* lateral = parameters_of<model::CogLateral>(parameters_.effects);
    lateral_m_ = lateral != nullptr ? (*lateral)[0] : 0;
    p.mass_coupling_kg_m -= lateral_m_ * p.mass_kg;
    payload_s_ = -1;
    if (const auto* load = parameters_of<model::PayloadStep>(parameters_.effects)) {
        if (loaded_) {
            const double mass = (*load)[1];
            p.mass_kg += mass;
            p.inertia_kg_m2 += (*load)[2] + mass * (ahead * ahead + lateral_m_ * lateral_m_);
            p.mass_coupling_kg_m -= mass * lateral_m_;
            p.centrifugal_kg_m += mass * ahead;
            p.coriolis_kg_m -= mass * ahead;
        } else {
            payload_s_ = (*load)[0];
        }
    }
    dynamics_ = plant_dynamics(p);
    if (parameters_of<model::Backlash>(parameters_.effects) != nullptr) {
        // as a wheel's rotation in plant_from_mass(); most of the robot must remain
        double& motor = p.effects.parameter[index_of<model::Backlash>()][1];
        const double left = 1 / (p.geometry.wheel_radius_m.left * p.geometry.wheel_radius_m.left);
        const double right = 1 / (p.geometry.wheel_radius_m.right * p.geometry.wheel_radius_m.right);
        const double half_track = p.geometry.track_m / 2;
        motor = std::min({motor, 0.8 * p.mass_kg / (left + right),
                          0.8 * p.inertia_kg_m2 / ((left + right) * half_track * half_track)});
        p.mass_kg -= motor * (left + right);
        p.inertia_kg_m2 -= motor * (left + right) * half_track * half_track;
        p.mass_coupling_kg_m -= motor * (right - left) * half_track;
    }
}

void Plant::list_dry() {
    const PlantParameters& p = actual_;
    const std::array<DryEffect, kMostDry> before = dry_;
    const std::size_t count_before = dry_count_;
    dry_count_ = 0;
    const auto add = [&](const auto& push, double limit_Nm) -> DryEffect& {
        DryEffect& dry = dry_[dry_count_++];
        dry = {};
        dry.limit_Nm = limit_Nm;
        if constexpr (std::is_same_v<decltype(push), const BodyForce&>) {
            dry.body = push;
            dry.on_body = true;
        }
        set_direction(dry, model::wheel_torque_Nm(p.geometry, push));
        return dry;
    };
    model::for_each_active(p.effects.active, [&]<typename Effect>(std::size_t i) {
        if constexpr (model::Dry<Effect>) {
            for (unsigned j = 0; j < Effect::parameters.size(); ++j) {
                const double limit_Nm = p.effects.parameter[i][j];
                if (limit_Nm > 0) add(Effect::template dry_direction<double>(j), limit_Nm);
            }
        }
    });
    if (const auto* values = parameters_of<model::StribeckFriction>(p.effects)) {
        const double limit_Nm = model::StribeckFriction::dry_limit(*values, 0.0);
        add(WheelPair<double>{1, 0}, limit_Nm).law = DryEffect::Law::stribeck;
        add(WheelPair<double>{0, 1}, limit_Nm).law = DryEffect::Law::stribeck;
    }
    if (const auto* values = parameters_of<model::CastorDrag>(p.effects)) {
        for (unsigned j = 0; j < 2; ++j) {
            if (!((*values)[j] > 0)) continue;
            DryEffect& dry = add(model::CastorDrag::direction(j, *values, castor_), (*values)[j]);
            dry.law = DryEffect::Law::castor;
            dry.which = j;
        }
    }
    for (std::size_t j = 0; j < dry_count_; ++j) {
        const double last = dry_count_ == count_before ? before[j].lambda_Nm : 0;
        dry_[j].lambda_Nm = std::clamp(last, -dry_[j].limit_Nm, dry_[j].limit_Nm);
    }
}

void Plant::set_direction(DryEffect& dry, const WheelPair<double>& direction) const {
    dry.direction = direction;
    dry.response = {from_torque_.a11 * direction.left + from_torque_.a12 * direction.right,
                    from_torque_.a21 * direction.left + from_torque_.a22 * direction.right};
    // a fork can stand so that nothing the robot does turns it
    dry.compliance =
        std::max(direction.left * dry.response.left + direction.right * dry.response.right, 1e-12);
}

// Sizes and directions as of now.
void Plant::renew_dry() {
    for (std::size_t j = 0; j < dry_count_; ++j) {
        DryEffect& dry = dry_[j];
        if (dry.law == DryEffect::Law::stribeck) {
            dry.limit_Nm =
                model::StribeckFriction::dry_limit(*parameters_of<model::StribeckFriction>(actual_.effects),
                                                   model::sliding_speed(dry.direction, speed_));
            dry.lambda_Nm = std::clamp(dry.lambda_Nm, -dry.limit_Nm, dry.limit_Nm);
        } else if (dry.law == DryEffect::Law::castor) {
            dry.body = model::CastorDrag::direction(
                dry.which, *parameters_of<model::CastorDrag>(actual_.effects), castor_);
            set_direction(dry, model::wheel_torque_Nm(actual_.geometry, dry.body));
        }
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

void Plant::place(const Pose<double>& pose, const Twist<double>& twist,
                  const WheelPair<double>& slip_m_per_s) {
    pose_ = pose;
    const SineCosine heading = sine_cosine(pose.heading_rad);
    heading_sine_ = heading.sine;
    heading_cosine_ = heading.cosine;
    twist_ = twist;
    speed_ = model::wheel_speeds_from_twist(actual_.geometry, twist);
    if (!slips_) return;
    speed_.left += slip_m_per_s.left / actual_.geometry.wheel_radius_m.left;
    speed_.right += slip_m_per_s.right / actual_.geometry.wheel_radius_m.right;
}

double Plant::kinetic_energy_J() const {
    const double v = twist_.v_m_per_s;
    const double omega = twist_.omega_rad_per_s;
    return (actual_.mass_kg * v * v + actual_.inertia_kg_m2 * omega * omega) / 2 +
           actual_.mass_coupling_kg_m * v * omega;
}

Twist<double> Plant::twist_of(const WheelPair<double>& speed) const {
    return model::twist_from_wheel_speeds(actual_.geometry, speed);
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
    const model::EffectContext<double> context{motion, torque_Nm, actual_.geometry, dynamics_};
    const WheelPair<double> smooth = model::smooth_effect_torque_Nm<kWheelsOnly>(actual_.effects, context);
    smooth_Nm = smooth;
    const double forward =
        actual_.centrifugal_kg_m * u.omega_rad_per_s * u.omega_rad_per_s + disturbance_.force_N;
    double yaw = actual_.coriolis_kg_m * u.v_m_per_s * u.omega_rad_per_s + disturbance_.yaw_torque_Nm;
    if constexpr (!kWheelsOnly) yaw += lateral_slope_Nm(context);
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

// Gravity on a slope pulls at a centre of gravity beside the middle line.
double Plant::lateral_slope_Nm(const model::EffectContext<double>& context) const {
    const auto* slope = parameters_of<model::Slope>(actual_.effects);
    if (slope == nullptr || lateral_m_ == 0) return 0;
    const model::Parameters<double> pull = model::Slope::coordinates(*slope);
    const double force_N = pull[0] * model::Slope::column(0, context).force_N +
                           pull[1] * model::Slope::column(1, context).force_N;
    // the offset is one of all that is accelerated, cog_lateral.hpp
    return -lateral_m_ * force_N / (1 - model::kRotationShare);
}

void Plant::advance(double dt_s, const WheelPair<double>& torque_Nm) {
    if (plain_) {
        double rest_s = dt_s;
        for (int cuts = 0; rest_s > 0; ++cuts) rest_s -= step(rest_s, torque_Nm, cuts < kMostCuts);
    } else {
        advance_with_all(dt_s, torque_Nm);
    }
    time_s_ += dt_s;
}

void Plant::advance_with_all(double dt_s, const WheelPair<double>& torque_Nm) {
    if (payload_s_ >= 0 && time_s_ >= payload_s_ - dt_s / 2) {
        loaded_ = true;
        const Twist<double> twist = twist_;
        const WheelPair<double> speed = speed_;
        set_parameters(parameters_);
        twist_ = twist;
        speed_ = speed;
    }
    WheelPair<double> arrives = torque_Nm;
    if (torque_path_) {
        const auto one = [&](double asked, double speed, double angle, bool right) {
            return model::delivered_along_path_Nm(
                path_effects_, path_memory_[right ? 1 : 0],
                {asked, speed, angle, time_s_, dt_s, parameters_.span_s, right});
        };
        arrives = {one(torque_Nm.left, speed_.left, angle_.left, false),
                   one(torque_Nm.right, speed_.right, angle_.right, true)};
    }
    double rest_s = dt_s;
    for (int cuts = 0; rest_s > 0; ++cuts) {
        if (dry_changes_) renew_dry();
        const Twist<double> before = twist_;
        const double taken_s =
            slips_ ? step_slipping(rest_s, arrives) : step(rest_s, arrives, cuts < kMostCuts);
        if (castor_turns_) {
            model::CastorDrag::advance(*parameters_of<model::CastorDrag>(actual_.effects), castor_,
                                       Twist<double>{(before.v_m_per_s + twist_.v_m_per_s) / 2,
                                                     (before.omega_rad_per_s + twist_.omega_rad_per_s) / 2},
                                       taken_s);
        }
        rest_s -= taken_s;
    }
}

WheelPair<double> Plant::slip_m_per_s() const {
    if (!slips_) return {};
    const double half_turn = twist_.omega_rad_per_s * actual_.geometry.track_m / 2;
    return {actual_.geometry.wheel_radius_m.left * speed_.left - (twist_.v_m_per_s - half_turn),
            actual_.geometry.wheel_radius_m.right * speed_.right - (twist_.v_m_per_s + half_turn)};
}

void Plant::derive_slip() {
    if (!slips_) return;
    const PlantParameters& p = actual_;
    const double left = 1 / (p.geometry.wheel_radius_m.left * p.geometry.wheel_radius_m.left);
    const double right = 1 / (p.geometry.wheel_radius_m.right * p.geometry.wheel_radius_m.right);
    const double half_track = p.geometry.track_m / 2;
    double inertia = p.wheel_inertia_kg_m2 > 0 ? p.wheel_inertia_kg_m2
                                               : model::kRotationShare * p.mass_kg / (left + right);
    inertia = std::min(inertia, 0.5 * p.inertia_kg_m2 / ((left + right) * half_track * half_track));
    slip_inertia_kg_m2_ = inertia;
    slip_load_N_ = model::WheelSlip::load_N(p.geometry, dynamics_);
    from_body_ = inverse_of(p.mass_kg - inertia * (left + right),
                            p.mass_coupling_kg_m - inertia * (right - left) * half_track,
                            p.inertia_kg_m2 - inertia * (left + right) * half_track * half_track);
    const auto contact = [&](double radius_m, double lever_m) {
        Contact c;
        c.on_body = {1, lever_m};
        c.radius_m = radius_m;
        const Twist<double> moves = body_response(c.on_body);
        c.compliance = radius_m * radius_m / inertia + moves.v_m_per_s + lever_m * moves.omega_rad_per_s;
        return c;
    };
    contact_ = {contact(p.geometry.wheel_radius_m.left, -half_track),
                contact(p.geometry.wheel_radius_m.right, half_track)};
}

Twist<double> Plant::body_response(const BodyForce& push) const {
    return {from_body_.a11 * push.force_N + from_body_.a12 * push.yaw_torque_Nm,
            from_body_.a21 * push.force_N + from_body_.a22 * push.yaw_torque_Nm};
}

// Wheels and body by themselves, held together by tyres that slip. Returns the time taken.
double Plant::step_slipping(double rest_s, const WheelPair<double>& torque_Nm) {
    constexpr double kLongest_s = 5e-5;
    constexpr int kMostSweeps = 200;
    constexpr double kTolerance = 1e-12;
    const double dt_s = rest_s > 1.5 * kLongest_s ? kLongest_s : rest_s;
    const model::Geometry<double>& g = actual_.geometry;
    const double inertia = slip_inertia_kg_m2_;

    // Everything but tyres and dry friction. What acts on each wheel acts on the wheel, the rest on the body.
    const model::Motion<double> motion{speed_, angle_, twist_, pose_.heading_rad};
    const model::EffectContext<double> context{motion, torque_Nm, g, dynamics_};
    const WheelPair<double> on_wheels = model::smooth_effect_torque_Nm<true>(actual_.effects, context);
    smooth_Nm_ = model::smooth_effect_torque_Nm(actual_.effects, context);
    const double body_left_N = (smooth_Nm_.left - on_wheels.left) / g.wheel_radius_m.left;
    const double body_right_N = (smooth_Nm_.right - on_wheels.right) / g.wheel_radius_m.right;
    const double v = twist_.v_m_per_s;
    const double omega = twist_.omega_rad_per_s;
    const Twist<double> rate = body_response(
        {actual_.centrifugal_kg_m * omega * omega + disturbance_.force_N + body_left_N + body_right_N,
         actual_.coriolis_kg_m * v * omega + disturbance_.yaw_torque_Nm + lateral_slope_Nm(context) +
             (body_right_N - body_left_N) * g.track_m / 2});
    Twist<double> u{v + dt_s * rate.v_m_per_s, omega + dt_s * rate.omega_rad_per_s};
    WheelPair<double> w{speed_.left + dt_s / inertia * (torque_Nm.left + on_wheels.left),
                        speed_.right + dt_s / inertia * (torque_Nm.right + on_wheels.right)};

    const auto& slip = *parameters_of<model::WheelSlip>(actual_.effects);
    const double most_N = slip[0] * slip_load_N_;
    const double give = slip[1] / most_N;  // slip per force
    const auto push_body = [&](const BodyForce& direction, double impulse) {
        const Twist<double> moves = body_response(direction);
        u.v_m_per_s += impulse * moves.v_m_per_s;
        u.omega_rad_per_s += impulse * moves.omega_rad_per_s;
    };
    const auto tyre = [&](Contact& c, double& wheel, double force_change_N) {
        c.force_N += force_change_N;
        wheel -= dt_s * force_change_N * c.radius_m / inertia;
        push_body(c.on_body, dt_s * force_change_N);
    };
    const auto rub = [&](DryEffect& dry, double change) {
        dry.lambda_Nm += change;
        if (dry.on_body) {
            push_body(dry.body, -dt_s * change);
        } else {
            w.left -= dt_s * change * dry.direction.left / inertia;
            w.right -= dt_s * change * dry.direction.right / inertia;
        }
    };
    const auto sliding = [&](const DryEffect& dry) {
        return dry.on_body ? dry.body.force_N * u.v_m_per_s + dry.body.yaw_torque_Nm * u.omega_rad_per_s
                           : model::sliding_speed(dry.direction, w);
    };
    const auto compliance = [&](const DryEffect& dry) {
        if (!dry.on_body)
            return (dry.direction.left * dry.direction.left + dry.direction.right * dry.direction.right) /
                   inertia;
        const Twist<double> moves = body_response(dry.body);
        return std::max(dry.body.force_N * moves.v_m_per_s + dry.body.yaw_torque_Nm * moves.omega_rad_per_s,
                        1e-12);
    };
    // from the last solution
    for (std::size_t side = 0; side < 2; ++side) {
        Contact& c = contact_[side];
        const double last = std::clamp(c.force_N, -most_N, most_N);
        c.force_N = 0;
        tyre(c, side == 0 ? w.left : w.right, last);
    }
    for (std::size_t j = 0; j < dry_count_; ++j) {
        const double last = dry_[j].lambda_Nm;
        dry_[j].lambda_Nm = 0;
        rub(dry_[j], last);
    }
    for (int sweep = 0; sweep < kMostSweeps; ++sweep) {
        double largest = 0;
        for (std::size_t side = 0; side < 2; ++side) {
            Contact& c = contact_[side];
            double& wheel = side == 0 ? w.left : w.right;
            const double ground = u.v_m_per_s + c.on_body.yaw_torque_Nm * u.omega_rad_per_s;
            const double lacks = c.radius_m * wheel - ground - give * c.force_N;
            const double force =
                std::clamp(c.force_N + lacks / (dt_s * c.compliance + give), -most_N, most_N);
            largest = std::max(largest, std::abs(force - c.force_N) / most_N);
            tyre(c, wheel, force - c.force_N);
        }
        for (std::size_t j = 0; j < dry_count_; ++j) {
            DryEffect& dry = dry_[j];
            const double wanted = dry.lambda_Nm + sliding(dry) / (dt_s * compliance(dry));
            const double lambda = std::clamp(wanted, -dry.limit_Nm, dry.limit_Nm);
            largest = std::max(largest, std::abs(lambda - dry.lambda_Nm) / dry.limit_Nm);
            rub(dry, lambda - dry.lambda_Nm);
        }
        if (largest <= kTolerance) break;
    }
    // a wheel that sticks has no speed at all
    for (std::size_t j = 0; j < dry_count_; ++j) {
        const DryEffect& dry = dry_[j];
        if (dry.on_body || std::abs(dry.lambda_Nm) >= dry.limit_Nm) continue;
        (dry.direction.left != 0 ? w.left : w.right) = 0;
    }
    angle_.left += dt_s / 2 * (speed_.left + w.left);
    angle_.right += dt_s / 2 * (speed_.right + w.right);
    advance_pose(dt_s / 2 * (v + u.v_m_per_s), dt_s / 2 * (omega + u.omega_rad_per_s));
    speed_ = w;
    twist_ = u;
    motor_Nm_ = torque_Nm;
    return dt_s;
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
    std::array<double, kMostDry> sense;  // of sliding
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
