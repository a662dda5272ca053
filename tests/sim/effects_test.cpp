// The effects' own functions against closed formulas and numbers worked out by hand.
#include <array>
#include <cmath>
#include <string_view>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/torque_path.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::model;

namespace {

constexpr double kPi = 3.14159265358979323846;

Geometry<double> geometry() { return {{0.0743, 0.0743}, 0.327}; }

PathInstant<double> instant(double torque_Nm, double step_s, double speed = 0, double angle = 0,
                            double time_s = 0) {
    PathInstant<double> at;
    at.torque_Nm = torque_Nm;
    at.speed_rad_per_s = speed;
    at.angle_rad = angle;
    at.time_s = time_s;
    at.step_s = step_s;
    at.span_s = 20;
    return at;
}

// What arrives at once, by an effect that remembers nothing.
template <typename Effect>
double arrives(const Parameters<double>& p, const PathInstant<double>& at) {
    typename Effect::template Memory<double> memory;
    return Effect::deliver(p, memory, at);
}

// A command that goes up and down.
double command_Nm(int step) { return 1.3 * std::sin(0.07 * step) + (step % 40 < 20 ? 0.4 : -0.5); }

}  // namespace

TEST_GROUP(EffectsOnThePath){};

TEST(EffectsOnThePath, stand_in_the_order_of_the_way) {
    const std::array<std::string_view, 10> order{
        "transport_delay",   "dead_zone",      "torque_gain_mismatch", "gain_drift",    "torque_bias",
        "torque_saturation", "back_emf_limit", "actuator_lag",         "torque_ripple", "backlash"};
    LONGS_EQUAL(order.size(), kPathEffects);
    for (std::size_t i = 0; i < order.size(); ++i) CHECK(order[i] == kEffects[kPathOrder[i]].name);
}

TEST(EffectsOnThePath, change_nothing_while_none_is_active_and_follow_each_other) {
    EffectSet<double> set;
    PathMemory<double> memory;
    DOUBLES_EQUAL(1.7, delivered_along_path_Nm(set, memory, instant(1.7, 1e-3)), 0);
    CHECK_FALSE(changes_torque_path(set.active));
    const auto add = [&](const char* name, const Parameters<double>& p) {
        set.active[find_effect(name)] = true;
        set.parameter[find_effect(name)] = p;
    };
    add("torque_saturation", {1.0});
    add("dead_zone", {0.25});
    add("torque_bias", {0.3, -0.4});
    // (1.0 - 0.25) + 0.3 beyond the limit; the right wheel: 0.75 - 0.4
    DOUBLES_EQUAL(1.0, delivered_along_path_Nm(set, memory, instant(1.0, 1e-3)), 1e-15);
    PathInstant<double> right = instant(1.0, 1e-3);
    right.right = true;
    DOUBLES_EQUAL(0.35, delivered_along_path_Nm(set, memory, right), 1e-15);
    CHECK(changes_torque_path(set.active));
}

TEST(EffectsOnThePath, static_curves) {
    DOUBLES_EQUAL(0.45, arrives<DeadZone>({0.25}, instant(0.7, 1e-3)), 1e-15);
    DOUBLES_EQUAL(-0.85, arrives<DeadZone>({0.25}, instant(-1.1, 1e-3)), 1e-15);
    DOUBLES_EQUAL(0, arrives<DeadZone>({0.25}, instant(-0.2, 1e-3)), 0);
    DOUBLES_EQUAL(0.9, arrives<TorqueSaturation>({0.9}, instant(1.1, 1e-3)), 0);
    DOUBLES_EQUAL(-0.9, arrives<TorqueSaturation>({0.9}, instant(-1.1, 1e-3)), 0);
    DOUBLES_EQUAL(-0.7, arrives<TorqueSaturation>({0.9}, instant(-0.7, 1e-3)), 0);
    PathInstant<double> right = instant(1.1, 1e-3);
    right.right = true;
    // both gains' mean is one, their ratio 1.2
    DOUBLES_EQUAL(1.0, arrives<TorqueGainMismatch>({0.2}, instant(1.1, 1e-3)), 1e-15);
    DOUBLES_EQUAL(1.2, arrives<TorqueGainMismatch>({0.2}, right), 1e-15);
}

TEST(EffectsOnThePath, back_emf_limits_driving_more_than_braking) {
    const Parameters<double> p{2, 20};
    DOUBLES_EQUAL(0.5, arrives<BackEmfLimit>(p, instant(1.5, 1e-3, 15)), 1e-15);
    DOUBLES_EQUAL(-1.7, arrives<BackEmfLimit>(p, instant(-1.7, 1e-3, 15)), 0);
    DOUBLES_EQUAL(-3.5, arrives<BackEmfLimit>(p, instant(-4, 1e-3, 15)), 1e-15);
    DOUBLES_EQUAL(0, arrives<BackEmfLimit>(p, instant(1.5, 1e-3, 25)), 0);
    DOUBLES_EQUAL(-1.5, arrives<BackEmfLimit>(p, instant(-1.5, 1e-3, 25)), 0);
    DOUBLES_EQUAL(-0.5, arrives<BackEmfLimit>(p, instant(-1.5, 1e-3, -15)), 1e-15);
    DOUBLES_EQUAL(1.5, arrives<BackEmfLimit>({2, 0}, instant(1.5, 1e-3, 15)), 0);
}

TEST(EffectsOnThePath, drift_is_even_over_the_span_or_settles) {
    DOUBLES_EQUAL(0.85, arrives<GainDrift>({0.3, 0}, instant(1, 1e-3, 0, 0, 10)), 1e-15);
    DOUBLES_EQUAL(0.7, arrives<GainDrift>({0.3, 0}, instant(1, 1e-3, 0, 0, 35)), 1e-15);
    DOUBLES_EQUAL(1 - 0.3 * (1 - std::exp(-2.0)), arrives<GainDrift>({0.3, 5}, instant(1, 1e-3, 0, 0, 10)),
                  1e-14);
}

TEST(EffectsOnThePath, ripple_follows_the_wheels_angle) {
    DOUBLES_EQUAL(1.2, arrives<TorqueRipple>({0.2, 3, 0}, instant(1, 1e-3, 0, kPi / 6)), 1e-13);
    DOUBLES_EQUAL(1 + 0.2 * std::sin(7 * 12.3 - 0.4),
                  arrives<TorqueRipple>({0.2, 7, -0.4}, instant(1, 1e-3, 0, 12.3)), 1e-12);
}

TEST(EffectsOnThePath, lag_gives_the_exact_impulse_of_the_step_response_however_time_is_cut) {
    const double lag_s = 0.013;
    for (const double step_s : {0.0005, 0.004, 0.05}) {
        ActuatorLag::Memory<double> memory;
        double impulse = 0;
        const int steps = static_cast<int>(std::lround(0.1 / step_s));
        for (int i = 0; i < steps; ++i)
            impulse += step_s * ActuatorLag::deliver({lag_s}, memory, instant(1.7, step_s));
        DOUBLES_EQUAL(1.7 * (0.1 - lag_s * (1 - std::exp(-0.1 / lag_s))), impulse, 1e-14);
        DOUBLES_EQUAL(1.7 * (1 - std::exp(-0.1 / lag_s)), memory.torque_Nm, 1e-13);
    }
    DOUBLES_EQUAL(1.7, arrives<ActuatorLag>({0}, instant(1.7, 1e-3)), 0);
}

TEST(EffectsOnThePath, delay_shifts_the_impulse_by_any_part_of_a_step) {
    for (const double delay_s : {0.0, 0.00013, 0.002, 0.0061, 0.05}) {
        for (const double step_s : {0.0005, 0.003}) {
            TransportDelay::Memory<double> memory;
            // the impulse commanded up to a time
            const auto asked = [&](double until_s) {
                double sum = 0;
                for (int i = 0; i * step_s < until_s; ++i)
                    sum += command_Nm(i) * std::fmin(step_s, until_s - i * step_s);
                return sum;
            };
            double impulse = 0;
            for (int i = 0; i < 300; ++i) {
                impulse +=
                    step_s * TransportDelay::deliver({delay_s}, memory, instant(command_Nm(i), step_s));
                DOUBLES_EQUAL(asked((i + 1) * step_s - delay_s), impulse, 1e-12);
            }
        }
    }
}

TEST(EffectsOnThePath, delay_keeps_the_impulse_where_it_has_no_room_for_every_step) {
    TransportDelay::Memory<double> memory;
    double asked = 0;
    double impulse = 0;
    for (int i = 0; i < 4000; ++i) {
        const double torque = i < 3000 ? command_Nm(i) : 0;
        asked += 5e-5 * torque;
        impulse += 5e-5 * TransportDelay::deliver({0.05}, memory, instant(torque, 5e-5));
    }
    DOUBLES_EQUAL(asked, impulse, 1e-12);
}

TEST_GROUP(EffectBacklash) {
    const Parameters<double> parameters{0.03, 0.002};
    Backlash::Memory<double> memory;
    double arrives(double torque, double step_s, double speed = 0, double angle = 0) {
        return Backlash::deliver(parameters, memory, instant(torque, step_s, speed, angle));
    }
};

TEST(EffectBacklash, the_motor_crosses_the_gap_freely_and_strikes_with_its_momentum) {
    // 0.03 rad at 0.4 / 0.002 rad/s^2: sqrt(2 0.03 / 200) = 17.32 ms
    const double meets_s = std::sqrt(2 * 0.03 / 200);
    double impulse = 0;
    int i = 0;
    for (; (i + 1) * 0.0005 < meets_s; ++i) DOUBLES_EQUAL(0, arrives(0.4, 0.0005), 0);
    impulse += 0.0005 * arrives(0.4, 0.0005);
    // the blow, and the torque for the rest of the step: all that was asked till now
    DOUBLES_EQUAL(0.4 * 0.0005 * (i + 1), impulse, 1e-14);
    DOUBLES_EQUAL(0.4, arrives(0.4, 0.0005), 1e-14);
    DOUBLES_EQUAL(0, memory.speed_rad_per_s, 0);
}

TEST(EffectBacklash, long_steps_give_the_same_impulse) {
    DOUBLES_EQUAL(0, arrives(0.4, 0.010), 0);
    DOUBLES_EQUAL(0.4 * 0.020, 0.010 * arrives(0.4, 0.010), 1e-14);
    // back across the whole gap: sqrt(2 0.06 / 150) = 28.28 ms
    DOUBLES_EQUAL(0, arrives(-0.3, 0.010), 1e-14);
    DOUBLES_EQUAL(0, arrives(-0.3, 0.010), 0);
    DOUBLES_EQUAL(-0.3 * 0.030, 0.010 * arrives(-0.3, 0.010), 1e-14);
}

TEST(EffectBacklash, in_contact_the_wheel_gets_the_torque_less_what_accelerates_the_motor) {
    double speed = 0;
    double angle = 0;
    for (int i = 0; i < 100; ++i) {
        arrives(0.4, 0.0005, speed, angle);
        angle += 0.0005 * speed;
    }
    for (int i = 0; i < 200; ++i) {
        const double got = arrives(0.4, 0.0005, speed, angle);
        if (i > 0) DOUBLES_EQUAL(0.4 - 0.002 * 15, got, 1e-10);
        angle += 0.0005 * (speed + 15 * 0.0005 / 2);
        speed += 15 * 0.0005;
    }
}

TEST(EffectBacklash, the_impulse_that_does_not_arrive_is_the_motors_momentum) {
    for (const double step_s : {0.0005, 0.003, 0.010}) {
        memory = {};
        double asked = 0;
        double got = 0;
        double speed = 0;
        double angle = 0;
        for (int i = 0; i < 2000; ++i) {
            const double torque = command_Nm(i);
            asked += step_s * torque;
            const double arrived = arrives(torque, step_s, speed, angle);
            got += step_s * arrived;
            DOUBLES_EQUAL(asked - got, 0.002 * memory.speed_rad_per_s, 1e-10);
            CHECK(std::fabs(memory.ahead_rad) <= 0.03 * (1 + 1e-12));
            // a wheel of ten motors' inertia, with drag
            const double change = step_s * (arrived / 0.02 - 2 * speed);
            angle += step_s * (speed + change / 2);
            speed += change;
        }
    }
}

// A robot of ten motors' inertia moved by what arrives, and one of eleven moved by as_whole: without drag the
// motion is the same whenever there is contact.
TEST(EffectBacklash, as_a_whole_the_robot_moves_the_same) {
    for (const double step_s : {0.0005, 0.003}) {
        memory = {};
        Backlash::Memory<double> whole_memory;
        double speed = 0;
        double whole_speed = 0;
        double angle = 0;
        int in_contact = 0;
        for (int i = 0; i < 2000; ++i) {
            const auto at = instant(command_Nm(i), step_s, speed, angle);
            whole_speed += step_s * Backlash::as_whole(parameters, whole_memory, at) / 0.022;
            const double change = step_s * arrives(command_Nm(i), step_s, speed, angle) / 0.02;
            angle += step_s * (speed + change / 2);
            speed += change;
            CHECK_EQUAL(memory.side, whole_memory.side);
            if (memory.side == 0) continue;
            ++in_contact;
            // the motor has the wheel's speed of the step before
            DOUBLES_EQUAL((0.02 * speed + 0.002 * memory.speed_rad_per_s) / 0.022, whole_speed, 1e-10);
        }
        CHECK(in_contact > 100 && in_contact < 1999);
    }
}

TEST(EffectBacklash, as_a_whole_a_measured_wheels_noise_does_nothing_in_contact) {
    for (int i = 0; i < 60; ++i) arrives(0.4, 0.0005);
    CHECK_EQUAL(1, memory.side);
    double sum = 0;
    for (int i = 0; i < 100; ++i) {
        const double noise = i % 2 == 0 ? 0.04 : -0.04;  // as an acceleration 0.32 Nm
        sum += Backlash::as_whole(parameters, memory, instant(0.4, 0.0005, noise, 0.0));
    }
    DOUBLES_EQUAL(100 * 0.4, sum, 1e-12);
}

TEST(EffectBacklash, rest_is_the_robot_without_its_motors) {
    const MassProperties<double> whole{7.7, 0.21, 0.034, 0.0063};
    const MassProperties<double> rest{7.7, 0.21, 0.034, 0.0043};
    const Dynamics<double> k = Backlash::rest(parameters, geometry(), dynamics_from_mass(whole, geometry()));
    const Dynamics<double> expected = dynamics_from_mass(rest, geometry());
    DOUBLES_EQUAL(expected.k5_m, k.k5_m, 1e-14);
    DOUBLES_EQUAL(expected.k6_per_m, k.k6_per_m, 1e-13);
    DOUBLES_EQUAL(expected.k7_per_kg_m, k.k7_per_kg_m, 1e-13);
    DOUBLES_EQUAL(expected.k8_per_kg_m2, k.k8_per_kg_m2, 1e-13);
}

TEST_GROUP(EffectsOnTheBody){};

TEST(EffectsOnTheBody, stribeck_falls_from_static_to_coulomb) {
    const Parameters<double> p{0.2, 0.5, 1.5};
    DOUBLES_EQUAL(0.5, StribeckFriction::dry_limit(p, 0.0), 0);
    DOUBLES_EQUAL(0.2 + 0.3 * std::exp(-1.0), StribeckFriction::dry_limit(p, -1.5), 1e-15);
    DOUBLES_EQUAL(0.2, StribeckFriction::dry_limit(p, 30.0), 1e-15);
    DOUBLES_EQUAL(0.2, StribeckFriction::dry_limit({0.2, 0.5, 0}, 0.0), 0);
}

TEST(EffectsOnTheBody, a_castor_ends_up_where_its_wheel_does_not_slip_sideways) {
    const Parameters<double> p{1.7, 0.02, 0.16, 0.03};
    for (const Twist<double> u : {Twist<double>{0.8, 1.9}, Twist<double>{0.3, -1.2}, Twist<double>{0, 2.0}}) {
        CastorDrag::Memory<double> memory;
        for (int i = 0; i < 20000; ++i) CastorDrag::advance(p, memory, u, 0.0005);
        const double c = memory.cosine;
        const double s = memory.sine;
        // velocity of the castor wheel's contact, which moves with the robot once the fork holds still
        const double x = 0.16 - 0.03 * c;
        const double y = -0.03 * s;
        const double vx = u.v_m_per_s - u.omega_rad_per_s * y;
        const double vy = u.omega_rad_per_s * x;
        DOUBLES_EQUAL(0, -s * vx + c * vy, 1e-9);
        CHECK(c * vx + s * vy > 0);
        // rolling takes power by its force at its speed, and the pivot none
        const EffectContext<double> at{{{}, {}, u, 0}, {}, geometry(), {}};
        const BodyForce<double> push = CastorDrag::push({1.7, 0, 0.16, 0.03}, memory, at, 0.0005);
        DOUBLES_EQUAL(-1.7 * (c * vx + s * vy),
                      push.force_N * u.v_m_per_s + push.yaw_torque_Nm * u.omega_rad_per_s, 1e-9);
    }
}

TEST(EffectsOnTheBody, a_castors_fork_keeps_its_length_in_single_precision) {
    const Parameters<float> p{1.7F, 0.02F, 0.16F, 0.03F};
    CastorDrag::Memory<float> memory;
    for (int i = 0; i < 2000000; ++i)
        CastorDrag::advance(p, memory, Twist<float>{0.4F, i / 700 % 2 == 0 ? 2.1F : -1.3F}, 0.001F);
    DOUBLES_EQUAL(1.0, std::hypot(double(memory.sine), double(memory.cosine)), 1e-6);
}

TEST(EffectsOnTheBody, a_castor_turns_around_as_the_tractrix_says) {
    // driving back, the fork leaves pi - d0 behind: tan(d / 2) falls by exp(v t / trail)
    const Parameters<double> p{1.7, 0.02, 0.16, 0.03};
    CastorDrag::Memory<double> memory;
    memory = {std::sin(0.4), std::cos(0.4)};
    for (int i = 0; i < 200; ++i) CastorDrag::advance(p, memory, {-0.3, 0.0}, 0.0005);
    DOUBLES_EQUAL(2 * std::atan(std::tan(0.2) * std::exp(0.3 * 0.1 / 0.03)),
                  std::atan2(memory.sine, memory.cosine), 5e-6);
    // and the pivot's friction does exactly the work of its turning
    const EffectContext<double> at{{{}, {}, {-0.3, 0.0}, 0}, {}, geometry(), {}};
    const double rate = 0.3 * memory.sine / 0.03;
    const BodyForce<double> push = CastorDrag::push({0, 0.02, 0.16, 0.03}, memory, at, 0.0005);
    DOUBLES_EQUAL(-0.02 * rate, push.force_N * -0.3, 1e-12);
}

TEST(EffectsOnTheBody, a_centre_of_gravity_to_the_left_couples_both_accelerations) {
    const Dynamics<double> k{0, 0, 1.31, 6.1};
    const double mass = 1 / (1.31 * 0.0743);
    const BodyForce<double> push = CogLateral::push({0.015}, geometry(), k, {0.7, -2.0});
    DOUBLES_EQUAL(mass * 0.015 * -2.0, push.force_N, 1e-14);
    DOUBLES_EQUAL(mass * 0.015 * 0.7, push.yaw_torque_Nm, 1e-14);
}

TEST(EffectsOnTheBody, a_payload_on_the_centre_of_gravity_makes_the_heavier_robot) {
    // without wheels of their own inertia K5 is the centre of gravity's place exactly
    const Dynamics<double> before = dynamics_from_mass<double>({7.7, 0.21, 0.034, 0}, geometry());
    const Dynamics<double> expected = dynamics_from_mass<double>({9.2, 0.21 + 0.04, 0.034, 0}, geometry());
    const Dynamics<double> k = PayloadStep::loaded({12.0, 1.5, 0.04}, geometry(), before);
    DOUBLES_EQUAL(expected.k5_m, k.k5_m, 1e-14);
    DOUBLES_EQUAL(expected.k6_per_m, k.k6_per_m, 1e-13);
    DOUBLES_EQUAL(expected.k7_per_kg_m, k.k7_per_kg_m, 1e-13);
    DOUBLES_EQUAL(expected.k8_per_kg_m2, k.k8_per_kg_m2, 1e-13);
}

TEST(EffectsOnTheBody, a_payload_ahead_of_the_centre_of_gravity_moves_it) {
    // by hand: 7.7 kg at 0.034 m and 1.5 kg at 0.124 m from the axle, each about the common centre
    const Dynamics<double> before = dynamics_from_mass<double>({7.7, 0.21, 0.034, 0}, geometry());
    const double ahead = (7.7 * 0.034 + 1.5 * 0.124) / 9.2;
    const double inertia = 0.21 + 0.04 + 7.7 * std::pow(0.034 - ahead, 2) + 1.5 * std::pow(0.124 - ahead, 2);
    const Dynamics<double> expected = dynamics_from_mass<double>({9.2, inertia, ahead, 0}, geometry());
    const Dynamics<double> k = PayloadStep::loaded({12.0, 1.5, 0.04, 0.09}, geometry(), before);
    DOUBLES_EQUAL(expected.k5_m, k.k5_m, 1e-14);
    DOUBLES_EQUAL(expected.k6_per_m, k.k6_per_m, 1e-13);
    DOUBLES_EQUAL(expected.k7_per_kg_m, k.k7_per_kg_m, 1e-13);
    DOUBLES_EQUAL(expected.k8_per_kg_m2, k.k8_per_kg_m2, 1e-13);
}

TEST(EffectsOnTheBody, unequal_radii_keep_their_mean) {
    const Geometry<double> g = WheelRadiusMismatch::geometry({0.03}, geometry());
    DOUBLES_EQUAL(1.03, g.wheel_radius_m.right / g.wheel_radius_m.left, 1e-14);
    DOUBLES_EQUAL(0.0743, g.mean_radius_m(), 1e-16);
    DOUBLES_EQUAL(0.327, g.track_m, 0);
}

TEST(EffectsOnTheBody, a_tyre_slips_with_its_force_up_to_its_limit) {
    const Parameters<double> p{0.4, 0.25};
    const double load = WheelSlip::load_N(geometry(), Dynamics<double>{0, 0, 1.31, 6.1});
    DOUBLES_EQUAL(9.80665 / (1.31 * 0.0743) / 2, load, 1e-12);
    DOUBLES_EQUAL(0.4 * load, WheelSlip::force_N(p, load, 0.3), 1e-12);
    DOUBLES_EQUAL(-0.4 * load, WheelSlip::force_N(p, load, -0.25), 1e-12);
    DOUBLES_EQUAL(0.2 * load, WheelSlip::force_N(p, load, 0.125), 1e-12);
    DOUBLES_EQUAL(0.125, WheelSlip::slip_m_per_s(p, load, 0.2 * load), 1e-15);
}

TEST_GROUP(EffectsOnReports){};

TEST(EffectsOnReports, speeds_come_in_counts_per_10_ms) {
    EncoderQuantisation::Memory<double> memory;
    const double step = 2 * kPi / (1024 * 0.010);
    DOUBLES_EQUAL(3 * step, EncoderQuantisation::report_speed({1024}, memory, 2.6 * step, 1e-3), 1e-14);
    DOUBLES_EQUAL(-2 * step, EncoderQuantisation::report_speed({1024}, memory, -2.4 * step, 1e-3), 1e-14);
    DOUBLES_EQUAL(1.23, EncoderQuantisation::report_speed({0}, memory, 1.23, 1e-3), 0);
}

TEST(EffectsOnReports, a_late_speed_follows_the_exponential) {
    MeasurementLag::Memory<double> memory;
    double reported = 0;
    for (int i = 0; i < 40; ++i) reported = MeasurementLag::report_speed({0.03}, memory, 5.0, 0.002);
    DOUBLES_EQUAL(5 * (1 - std::exp(-0.08 / 0.03)), reported, 1e-13);
}

TEST(EffectsOnReports, a_gyro_bias_is_added) {
    DOUBLES_EQUAL(0.72, GyroBias::report_yaw_rate({0.02}, 0.7), 1e-15);
}
