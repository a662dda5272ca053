#include "tools/gap_exam/truth/simulator.hpp"

#include <numbers>

namespace wheelwright::exam {
namespace {

constexpr double kGravity_m_per_s2 = 9.80665;
constexpr double kLongestStep_s = 0.00025;
constexpr double kPi = std::numbers::pi;

// Of two masses: the motor's part of the wheel's inertia; how the teeth, or the softest shaft, swing.
constexpr double kMotorPart = 0.8;
constexpr double kTeeth_rad_per_s = 400, kTeethDamping = 0.3;
constexpr double kSoftestShaft_rad_per_s = 25, kShaftDamping = 0.06;

constexpr double kRubberDamping = 0.8;   // twice the damping ratio
constexpr double kStiffestTyre = 0.015;  // in softness
constexpr double kNoLimit = 1.2;         // times the commands' limit: one that hardly shows
constexpr double kLoadTakes_s = 0.3;     // to be put on
constexpr double kSecondLag = 0.15;      // part of a lag that is in a second link behind the first
constexpr double kDelayJitter = 0.2;
constexpr double kForkSettles_per_s = 6000;  // a fork that stands, on its tyre
constexpr double kRotationPerLoad = 0.1;     // a load's own inertia over mass times squared track

double sign(double x) { return x < 0 ? -1 : 1; }

}  // namespace

Simulator::Simulator(const Robot& robot, std::uint64_t seed, bool rough)
    : robot_(robot), largest_(largest(robot)), ground_(seed, 1), lateness_(seed, 2) {
    if (!rough) robot_.rough_Nm = 0;
    if (robot_.further == Further::torque_gain_mismatch || robot_.further == Further::wheel_radius_mismatch ||
        robot_.further == Further::cog_lateral) {
        // either side
        largest_ *= robot_.draw[0] < 0.5 ? -1 : 1;
    }
    if (robot_.further == Further::cog_lateral) robot_.cog_left_m = size();
    if (robot_.further == Further::wheel_radius_mismatch) {
        const double mean_m = robot_.mean_radius_m();
        robot_.wheel_radius_m = {mean_m * 2 / (2 + size()), mean_m * 2 * (1 + size()) / (2 + size())};
    }
    if (robot_.further == Further::stribeck_friction) {
        for (DryFriction& f : robot_.dry) f.static_Nm = f.level_Nm + size();
    }
}

bool Simulator::two_masses() const {
    return robot_.further == Further::backlash || robot_.further == Further::elastic_shaft;
}

Simulator::Body Simulator::body(double t_s) const {
    Body b{robot_.mass_kg, robot_.mass_kg * robot_.cog_ahead_m,
           robot_.yaw_inertia_kg_m2 + robot_.mass_kg * (robot_.cog_ahead_m * robot_.cog_ahead_m +
                                                        robot_.cog_left_m * robot_.cog_left_m)};
    if (const double load_kg = is(Further::payload_step); load_kg > 0) {
        const double since = (t_s - robot_.share(0, 8, 18)) / kLoadTakes_s;
        const double on_kg = load_kg * std::clamp(since, 0.0, 1.0);
        const double ahead_m = robot_.track_m * robot_.share(1, -0.3, 0.3);
        b.mass_kg += on_kg;
        b.moment_kg_m += on_kg * ahead_m;
        b.inertia_kg_m2 += on_kg * (ahead_m * ahead_m + kRotationPerLoad * robot_.track_m * robot_.track_m);
    }
    return b;
}

Sides<double> Simulator::rolling_speeds(const State& s) const {
    const double half_m_per_s = s[kYaw] * robot_.track_m / 2;
    return {(s[kForward] - half_m_per_s) / robot_.wheel_radius_m[0],
            (s[kForward] + half_m_per_s) / robot_.wheel_radius_m[1]};
}

Sides<double> Simulator::wheel_speeds(const State& s) const {
    return slips() ? Sides<double>{s[kWheel], s[kWheel + 1]} : rolling_speeds(s);
}

Sides<double> Simulator::speed_rad_per_s() const {
    if (robot_.further == Further::elastic_shaft) return {state_[kMotor], state_[kMotor + 1]};
    return wheel_speeds(state_);
}

Sides<double> Simulator::angle_rad() const {
    Sides<double> angle{state_[kAngle], state_[kAngle + 1]};
    if (robot_.further == Further::elastic_shaft) {
        angle[0] += state_[kTwist];
        angle[1] += state_[kTwist + 1];
    }
    return angle;
}

void Simulator::set_motion(double forward_m_per_s, double yaw_rad_per_s) {
    state_[kForward] = forward_m_per_s;
    state_[kYaw] = yaw_rad_per_s;
    const Sides<double> speed = rolling_speeds(state_);
    for (std::size_t i = 0; i < 2; ++i) state_[kWheel + i] = state_[kMotor + i] = speed[i];
}

double Simulator::kinetic_energy_J() const {
    const Body b = body(t_s_);
    const double v = state_[kForward];
    const double yaw = state_[kYaw];
    const Sides<double> w = wheel_speeds(state_);
    const double wheel = robot_.wheel_inertia_kg_m2 * (two_masses() ? 1 - kMotorPart : 1);
    double energy =
        (b.mass_kg * v * v + b.inertia_kg_m2 * yaw * yaw) / 2 - robot_.mass_kg * robot_.cog_left_m * v * yaw;
    for (std::size_t i = 0; i < 2; ++i) {
        energy += wheel * w[i] * w[i] / 2;
        if (two_masses())
            energy += kMotorPart * robot_.wheel_inertia_kg_m2 * state_[kMotor + i] * state_[kMotor + i] / 2;
    }
    return energy;
}

// What a command becomes at the shaft; the states of what it passes get their rates.
double Simulator::shaft_torque_Nm(std::size_t side, double asked_Nm, const State& s, double shaft_rad_per_s,
                                  State& rate) const {
    const double limit_Nm = robot_.torque_limit_Nm;
    const double amount = size();
    switch (robot_.further) {
        case Further::torque_bias:
            return asked_Nm + amount * robot_.share(side, -1, 1);
        case Further::torque_gain_mismatch:
            return asked_Nm * (side == 0 ? 2 : 2 * (1 + amount)) / (2 + amount);
        case Further::dead_zone:
            return soft_dead_zone(asked_Nm, amount);
        case Further::torque_saturation:
            return soft_limited(asked_Nm, kNoLimit * limit_Nm * (1 - amount));
        case Further::back_emf_limit: {
            if (asked_Nm * shaft_rad_per_s <= 0) return asked_Nm;
            const double left = 1 - amount * std::abs(shaft_rad_per_s) / robot_.top_speed_rad_per_s;
            return soft_limited(asked_Nm, limit_Nm * std::max(0.001, left));
        }
        case Further::actuator_lag:
            if (!(amount > 0)) return asked_Nm;
            rate[kLag + side] =
                (asked_Nm - s[kLag + side]) / std::max(amount * (1 - kSecondLag), 2 * kLongestStep_s);
            rate[kLagged + side] =
                (s[kLag + side] - s[kLagged + side]) / std::max(amount * kSecondLag, 2 * kLongestStep_s);
            return s[kLagged + side];
        case Further::gain_drift: {
            // Heated by both motors' losses, in proportion to squared torque; magnets weaken with heat.
            const double share = asked_Nm / (0.3 * limit_Nm);
            rate[kHeat] += (share * share - s[kHeat]) / 2 / robot_.share(0, 10, 40);
            return asked_Nm / (1 + amount * s[kHeat]);
        }
        case Further::torque_ripple: {
            const double order = 1 + std::floor(robot_.share(0, 0, 14));
            const double angle = order * s[kAngle + side] + 2 * kPi * robot_.draw[1 + side];
            return asked_Nm + amount * (std::sin(angle) + 0.2 * std::sin(2 * angle + 1));
        }
        default:
            return asked_Nm;
    }
}

Resistance Simulator::resistances(const State& s, const Sides<double>& speed) const {
    Resistance r;
    for (std::size_t i = 0; i < 2; ++i) {
        const DryFriction& f = robot_.dry[i];
        r.dry_Nm[i] = dry_torque_Nm(f, s[kBend + i], speed[i]);
        r.viscous_Nm[i] = robot_.viscous_Nm_s_per_rad[i] * speed[i];
        r.ground_Nm[i] = rough_[i] * std::tanh(speed[i] / f.smooth_rad_per_s);
    }
    return r;
}

double Simulator::further_friction_Nm(std::size_t side, double speed, double shaft_Nm, double t_s) const {
    if (robot_.further == Further::load_dependent_friction)
        return size() * std::abs(shaft_Nm) * std::tanh(speed / robot_.dry[side].smooth_rad_per_s);
    if (robot_.further == Further::cold_grease)
        return size() * std::exp(-t_s / robot_.share(0, 5, 15)) * robot_.viscous_Nm_s_per_rad[side] * speed;
    return 0;
}

// On the body, about the middle between the wheels.
Simulator::Push Simulator::pushes(const State& s, const Body& b, double t_s, State& rate) const {
    Push push;
    const double v = s[kForward];
    const double yaw = s[kYaw];
    const double top_m_per_s = robot_.top_speed_rad_per_s * robot_.mean_radius_m();
    const double smooth_m_per_s = robot_.dry[0].smooth_rad_per_s * robot_.mean_radius_m();
    const double amount = size();
    switch (robot_.further) {
        case Further::quadratic_drag:
            push.force_N = -amount * sign(v) * std::pow(std::abs(v) / top_m_per_s, robot_.share(0, 1.8, 2.2));
            break;
        case Further::turning_scrub: {
            const double smooth_rad_per_s = smooth_m_per_s / robot_.track_m;
            push.moment_Nm = -amount * yaw / std::sqrt(yaw * yaw + smooth_rad_per_s * smooth_rad_per_s);
            break;
        }
        case Further::slope: {
            const double from_uphill = s[kHeading] - 2 * kPi * robot_.draw[0];
            const double pull_m_per_s2 = kGravity_m_per_s2 * std::sin(amount);
            const double ahead = -pull_m_per_s2 * std::cos(from_uphill);
            const double left = pull_m_per_s2 * std::sin(from_uphill);
            push = {b.mass_kg * ahead, b.moment_kg_m * left - robot_.mass_kg * robot_.cog_left_m * ahead};
            break;
        }
        case Further::castor_drag: {
            // A fork of its own inertia, whose wheel has a tyre: side force by slip angle.
            const double arm_m = -robot_.track_m * robot_.share(0, 0.5, 1);
            const double trail_m = robot_.track_m * robot_.share(1, 0.08, 0.2);
            const double load_N = robot_.mass_kg * kGravity_m_per_s2 * robot_.share(2, 0.05, 0.15);
            const double pivot_Nm = amount * trail_m * robot_.share(3, 0.2, 1);
            const double c = std::cos(s[kFork]);
            const double d = std::sin(s[kFork]);
            const double along = v * c + yaw * arm_m * d;
            const double across = -v * d + yaw * arm_m * c - trail_m * (yaw + s[kForkRate]);
            const double at_rest_m_per_s = 0.05 * top_m_per_s;
            const MagicFormula tyre{4, 1.3, 0.8, 0};
            const double side_N = -load_N * magic_formula(tyre, across / (std::abs(along) + at_rest_m_per_s));
            const double roll_N = -amount * std::tanh(along / smooth_m_per_s);
            // As light as the integration can follow.
            const double inertia_kg_m2 = trail_m * trail_m * load_N * tyre.stiffness * tyre.shape *
                                         tyre.peak / at_rest_m_per_s / kForkSettles_per_s;
            const double swivel_Nm = pivot_Nm * std::tanh(s[kForkRate] * trail_m / at_rest_m_per_s * 10);
            rate[kFork] = s[kForkRate];
            rate[kForkRate] = (-trail_m * side_N - swivel_Nm) / inertia_kg_m2;
            push = {roll_N * c - side_N * d, arm_m * (roll_N * d + side_N * c) + swivel_Nm};
            break;
        }
        case Further::soft_floor: {
            const double length_m = top_m_per_s * robot_.share(0, 1, 4);
            const double soft =
                (1 + std::tanh(4 * std::sin(2 * kPi * (s[kX] / length_m + robot_.draw[1])))) / 2;
            push.force_N = -amount * soft * std::tanh(v / smooth_m_per_s);
            break;
        }
        case Further::tether:
            push.force_N = -amount * (s[kX] * std::cos(s[kHeading]) + s[kY] * std::sin(s[kHeading]));
            break;
        case Further::wind: {
            const double gust = std::sin(2 * kPi * (t_s / robot_.share(0, 5, 9) + robot_.draw[1])) +
                                std::sin(2 * kPi * (t_s / robot_.share(2, 2, 4) + robot_.draw[3]));
            push.force_N = amount / 2 * gust * std::cos(s[kHeading] - 2 * kPi * robot_.draw[3]);
            break;
        }
        default:
            break;
    }
    return push;
}

void Simulator::roll(const State& s, const Body& b, const Push& push, const Sides<double>& torque,
                     State& rate) const {
    const double wheel_kg_m2 = robot_.wheel_inertia_kg_m2 * (two_masses() ? 1 - kMotorPart : 1);
    const double half_m = robot_.track_m / 2;
    const double left_kg = wheel_kg_m2 / (robot_.wheel_radius_m[0] * robot_.wheel_radius_m[0]);
    const double right_kg = wheel_kg_m2 / (robot_.wheel_radius_m[1] * robot_.wheel_radius_m[1]);
    const double m11 = b.mass_kg + left_kg + right_kg;
    const double m12 = -robot_.mass_kg * robot_.cog_left_m + half_m * (right_kg - left_kg);
    const double m22 = b.inertia_kg_m2 + half_m * half_m * (left_kg + right_kg);
    const double left_N = torque[0] / robot_.wheel_radius_m[0];
    const double right_N = torque[1] / robot_.wheel_radius_m[1];
    const double force = left_N + right_N + push.force_N + b.moment_kg_m * s[kYaw] * s[kYaw];
    const double moment =
        half_m * (right_N - left_N) + push.moment_Nm - b.moment_kg_m * s[kForward] * s[kYaw];
    const double determinant = m11 * m22 - m12 * m12;
    rate[kForward] = (force * m22 - moment * m12) / determinant;
    rate[kYaw] = (moment * m11 - force * m12) / determinant;
}

// Wheels with speeds of their own, on tyres whose slip settles over a relaxation length.
void Simulator::slip(const State& s, const Body& b, const Push& push, const Sides<double>& torque,
                     State& rate) const {
    const double half_m = robot_.track_m / 2;
    const double load_N = robot_.mass_kg * kGravity_m_per_s2 * robot_.share(0, 0.35, 0.45);
    const MagicFormula tyre{1.5 / std::max(size(), kStiffestTyre), 1.6, robot_.share(1, 0.5, 0.9), 0};
    const Sides<double> rolling = rolling_speeds(s);
    Sides<double> force_N{};
    for (std::size_t i = 0; i < 2; ++i) {
        const double radius_m = robot_.wheel_radius_m[i];
        const double over_ground_m_per_s = rolling[i] * radius_m;
        const double slip_m_per_s = s[kWheel + i] * radius_m - over_ground_m_per_s;
        const double relaxation_m = 0.3 * radius_m;
        // What the wheel swings with is damped by the rubber, and more where it stands and has no slip to
        // settle by.
        const double slow_m_per_s = 0.02 * robot_.top_speed_rad_per_s * radius_m;
        const double standing = slow_m_per_s / (std::abs(over_ground_m_per_s) + slow_m_per_s);
        const double stiffness_N_per_m = load_N * tyre.stiffness * tyre.shape * tyre.peak / relaxation_m;
        const double damping_N_s_per_m = std::sqrt(stiffness_N_per_m * robot_.wheel_inertia_kg_m2) /
                                         radius_m * (kRubberDamping + (1 - kRubberDamping) * standing);
        rate[kTyre + i] = (slip_m_per_s - std::abs(over_ground_m_per_s) * s[kTyre + i]) / relaxation_m;
        force_N[i] = load_N * magic_formula(tyre, s[kTyre + i]) + damping_N_s_per_m * slip_m_per_s;
        rate[kWheel + i] = (torque[i] - radius_m * force_N[i]) / robot_.wheel_inertia_kg_m2;
    }
    const double force = force_N[0] + force_N[1] + push.force_N + b.moment_kg_m * s[kYaw] * s[kYaw];
    const double moment =
        half_m * (force_N[1] - force_N[0]) + push.moment_Nm - b.moment_kg_m * s[kForward] * s[kYaw];
    rate[kForward] = force / b.mass_kg;
    rate[kYaw] = moment / b.inertia_kg_m2;
}

Simulator::State Simulator::rates(const State& s, const Sides<double>& asked, double t_s) const {
    State rate{};
    const Sides<double> speed = wheel_speeds(s);
    const Resistance resistance = resistances(s, speed);
    Sides<double> torque{};
    for (std::size_t i = 0; i < 2; ++i) {
        const double shaft_rad_per_s = two_masses() ? s[kMotor + i] : speed[i];
        const double shaft_Nm = shaft_torque_Nm(i, asked[i], s, shaft_rad_per_s, rate);
        torque[i] = shaft_Nm;
        if (two_masses()) {
            const bool shaft = robot_.further == Further::elastic_shaft;
            const double motor_kg_m2 = kMotorPart * robot_.wheel_inertia_kg_m2;
            const double swings = shaft ? kSoftestShaft_rad_per_s / std::max(size(), 0.02) : kTeeth_rad_per_s;
            const double pressed = pressed_rad(s[kTwist + i], is(Further::backlash));
            const double damping = 2 * (shaft ? kShaftDamping : kTeethDamping) * swings * motor_kg_m2;
            torque[i] = motor_kg_m2 * swings * swings * pressed +
                        (pressed != 0 ? damping * (s[kMotor + i] - speed[i]) : 0);
            rate[kMotor + i] = (shaft_Nm - torque[i]) / motor_kg_m2;
            rate[kTwist + i] = s[kMotor + i] - speed[i];
        }
        torque[i] -= resistance.dry_Nm[i] + resistance.viscous_Nm[i] + resistance.ground_Nm[i] +
                     further_friction_Nm(i, speed[i], shaft_Nm, t_s);
        rate[kAngle + i] = speed[i];
        rate[kBend + i] = lugre_bend_rate(robot_.dry[i], s[kBend + i], speed[i]);
    }
    const Body b = body(t_s);
    const Push push = pushes(s, b, t_s, rate);
    if (slips()) {
        slip(s, b, push, torque, rate);
    } else {
        roll(s, b, push, torque, rate);
    }
    rate[kHeading] = s[kYaw];
    rate[kX] = s[kForward] * std::cos(s[kHeading]);
    rate[kY] = s[kForward] * std::sin(s[kHeading]);
    return rate;
}

void Simulator::step(const Sides<double>& asked, double h) {
    const auto moved = [&](const State& by, double factor) {
        State s = state_;
        for (std::size_t i = 0; i < kCount; ++i) s[i] += factor * by[i];
        return s;
    };
    const State k1 = rates(state_, asked, t_s_);
    const State k2 = rates(moved(k1, h / 2), asked, t_s_ + h / 2);
    const State k3 = rates(moved(k2, h / 2), asked, t_s_ + h / 2);
    const State k4 = rates(moved(k3, h), asked, t_s_ + h);
    for (std::size_t i = 0; i < kCount; ++i) state_[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    t_s_ += h;
}

// Four stages follow what dies away at a rate of up to 2.78 in a step.
double Simulator::longest_step_s() const {
    double wheel_kg_m2 = robot_.effective_mass_kg() * robot_.mean_radius_m() * robot_.mean_radius_m() / 2;
    if (slips()) wheel_kg_m2 = robot_.wheel_inertia_kg_m2;
    if (two_masses()) wheel_kg_m2 *= 0.7;
    const DryFriction& f = robot_.dry[0];
    const double steepest =
        std::max(f.level_Nm, f.static_Nm) / f.smooth_rad_per_s +
        is(Further::load_dependent_friction) * robot_.torque_limit_Nm / f.smooth_rad_per_s;
    return std::min(kLongestStep_s, 1.5 * wheel_kg_m2 / steepest);
}

void Simulator::advance(const Sides<double>& asked_Nm, double period_s, const Step& told) {
    const auto steps = static_cast<std::size_t>(std::ceil(period_s / longest_step_s() - 1e-9));
    const double h = period_s / static_cast<double>(steps);
    const double late_s = is(Further::transport_delay);
    commands_.push_back({t_s_ + late_s * lateness_.uniform(1 - kDelayJitter, 1 + kDelayJitter), asked_Nm});
    mean_ = {};
    for (std::size_t k = 0; k < steps; ++k) {
        while (commands_.size() > 1 && commands_[1].from_s <= t_s_ + h / 2) commands_.pop_front();
        const bool begun = commands_.front().from_s <= t_s_ + h / 2;
        const Sides<double> speed = wheel_speeds(state_);
        for (std::size_t i = 0; i < 2; ++i) {
            // Resistance that is alike over a length of the way.
            const double alike =
                std::exp(-std::abs(speed[i]) * h * robot_.wheel_radius_m[i] / robot_.rough_length_m);
            if (robot_.rough_Nm > 0)
                rough_[i] =
                    alike * rough_[i] + robot_.rough_Nm * std::sqrt(1 - alike * alike) * ground_.gaussian();
        }
        step(begun ? commands_.front().asked_Nm : Sides<double>{}, h);
        const Sides<double> now = wheel_speeds(state_);
        const Resistance r = resistances(state_, now);
        const double part = 1 / static_cast<double>(steps);
        for (std::size_t i = 0; i < 2; ++i) {
            // What creeping has more than its level is the further effect's, where that is what is asked.
            double dry_Nm = r.dry_Nm[i];
            if (robot_.further == Further::stribeck_friction &&
                robot_.dry[i].static_Nm > robot_.dry[i].level_Nm) {
                DryFriction level = robot_.dry[i];
                level.static_Nm = level.level_Nm;
                dry_Nm = level.law == DryLaw::lugre
                             ? dry_Nm * level.level_Nm / lugre_level_Nm(robot_.dry[i], now[i])
                             : dry_torque_Nm(level, 0, now[i]);
            }
            mean_.dry_Nm[i] += part * dry_Nm;
            mean_.viscous_Nm[i] += part * r.viscous_Nm[i];
            mean_.ground_Nm[i] += part * r.ground_Nm[i];
        }
        if (told) told(h, angle_rad());
    }
}

}  // namespace wheelwright::exam
