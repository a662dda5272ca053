#include "sim_hal/plant.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>

#include "sim_hal/plain_math.hpp"
#include "sim_hal/plant_effects.hpp"

namespace wheelwright::sim {

namespace {

constexpr int kMostCuts = 4;

}  // namespace

Plant::Plant(const PlantParameters& parameters, const Pose<double>& start) {
    time_s_ = parameters.start_s;
    angle_ = parameters.start_angle_rad;
    set_parameters(parameters);
    place(start, {});
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
