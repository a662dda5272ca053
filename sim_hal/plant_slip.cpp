#include "sim_hal/plant.hpp"

#include <algorithm>
#include <cmath>

#include "sim_hal/plant_effects.hpp"

namespace wheelwright::sim {

WheelPair<double> Plant::slip_m_per_s() const {
    if (!slips_) return {};
    const double half_turn = twist_.omega_rad_per_s * actual_.geometry.track_m / 2;
    return {actual_.geometry.wheel_radius_m.left * speed_.left - (twist_.v_m_per_s - half_turn),
            actual_.geometry.wheel_radius_m.right * speed_.right - (twist_.v_m_per_s + half_turn)};
}

void Plant::derive_slip() {
    if (!slips_) return;
    const PlantParameters& p = actual_;
    const double half_track = p.geometry.track_m / 2;
    const double inertia = p.wheel_inertia_kg_m2;
    slip_load_N_ = model::WheelSlip::load_N(p.geometry, dynamics_);
    PlantParameters body = p;
    add_rotation(body, -inertia);
    from_body_ = inverse_of(body.mass_kg, body.mass_coupling_kg_m, body.inertia_kg_m2);
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
    const double inertia = actual_.wheel_inertia_kg_m2;

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
    const auto most_of = [&](std::size_t side) {
        return (side == 0 ? parameters_.lifted.left : parameters_.lifted.right) ? 0 : most_N;
    };
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
        const double last = std::clamp(c.force_N, -most_of(side), most_of(side));
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
                std::clamp(c.force_N + lacks / (dt_s * c.compliance + give), -most_of(side), most_of(side));
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

}  // namespace wheelwright::sim
