// The simulated body against closed-form mechanics.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <type_traits>

#include "firmware/control/feedback_linearisation.hpp"
#include "firmware/model/dynamics.hpp"
#include "sim_hal/plant.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using sim::Plant;
using sim::PlantParameters;

namespace {

constexpr double kPi = 3.14159265358979323846;

model::Geometry<double> geometry(double left = 0.0743, double right = 0.0743) {
    return {{left, right}, 0.327};
}

model::Dynamics<double> dynamics() {
    model::Dynamics<double> k;
    k.k5_m = 0.0413;
    k.k7_per_kg_m = 1.31;
    k.k8_per_kg_m2 = 6.1;
    k.k6_per_m = model::coupled_k6(k.k5_m, k.k7_per_kg_m, k.k8_per_kg_m2, 0.327);
    return k;
}

model::Dynamics<double> uncoupled() {
    model::Dynamics<double> k = dynamics();
    k.k5_m = k.k6_per_m = 0;
    return k;
}

model::EffectSet<double> friction(double viscous, double coulomb_left, double coulomb_right) {
    model::EffectSet<double> effects;
    const std::size_t drag = model::find_effect("viscous_friction");
    const std::size_t dry = model::find_effect("coulomb_friction");
    effects.active[drag] = viscous > 0;
    effects.parameter[drag] = {viscous, viscous};
    effects.active[dry] = coulomb_left > 0 || coulomb_right > 0;
    effects.parameter[dry] = {coulomb_left, coulomb_right};
    return effects;
}

model::EffectSet<double> effect(const char* name, const model::Parameters<double>& parameters) {
    model::EffectSet<double> effects;
    const std::size_t i = model::find_effect(name);
    CHECK(i < model::kEffectCount);
    effects.active[i] = true;
    effects.parameter[i] = parameters;
    return effects;
}

Plant plant(const model::Dynamics<double>& k, const model::EffectSet<double>& effects = {},
            const model::Geometry<double>& g = geometry()) {
    return Plant(sim::plant_from_dynamics(g, k, effects));
}

void go(Plant& p, double duration_s, const WheelPair<double>& torque, double dt_s = 0.00037) {
    const int steps = static_cast<int>(std::ceil(duration_s / dt_s));
    for (int i = 0; i < steps; ++i) p.advance(duration_s / steps, torque);
}

}  // namespace

TEST_GROUP(SimPlant){};

TEST(SimPlant, parameters_come_back_as_the_dynamics_they_were_made_from) {
    const model::Dynamics<double> k = dynamics();
    const model::Dynamics<double> back =
        sim::plant_dynamics(sim::plant_from_dynamics(geometry(0.071, 0.079), k, {}));
    DOUBLES_EQUAL(k.k5_m, back.k5_m, 1e-15);
    DOUBLES_EQUAL(k.k6_per_m, back.k6_per_m, 1e-14);
    DOUBLES_EQUAL(k.k7_per_kg_m, back.k7_per_kg_m, 1e-14);
    DOUBLES_EQUAL(k.k8_per_kg_m2, back.k8_per_kg_m2, 1e-14);
}

TEST(SimPlant, speed_step_under_viscous_friction_follows_the_exponential) {
    const double c = 0.021;
    const double tau = 0.47;
    const double r = 0.0743;
    const model::Dynamics<double> k = uncoupled();
    Plant p = plant(k, friction(c, 0, 0));
    go(p, 1.7, {tau, tau});
    // v' = K7 (2 tau - 2 c v / r)
    const double rate = 2 * c * k.k7_per_kg_m / r;
    DOUBLES_EQUAL(tau * r / c * (1 - std::exp(-rate * 1.7)), p.twist().v_m_per_s, 1e-7);
    DOUBLES_EQUAL(0, p.twist().omega_rad_per_s, 1e-15);
    DOUBLES_EQUAL(tau * r / c * (1.7 - (1 - std::exp(-rate * 1.7)) / rate), p.pose().x_m, 1e-6);
}

TEST(SimPlant, yaw_rate_step_under_viscous_friction_follows_the_exponential) {
    const double c = 0.021;
    const double r = 0.0743;
    const double b = 0.327;
    const model::Dynamics<double> k = uncoupled();
    Plant p = plant(k, friction(c, 0, 0));
    go(p, 0.9, {-0.31, 0.31});
    // omega' = K8 (2 tau - c b omega / r)
    const double rate = k.k8_per_kg_m2 * c * b / r;
    DOUBLES_EQUAL(0.62 * r / (c * b) * (1 - std::exp(-rate * 0.9)), p.twist().omega_rad_per_s, 1e-6);
    DOUBLES_EQUAL(0, p.twist().v_m_per_s, 1e-15);
}

TEST(SimPlant, free_motion_with_the_centre_of_gravity_ahead_follows_the_hyperbolic_tangent) {
    // Energy keeps v^2 + w^2 (-K5/K6) = V^2, so v' = -K6 (V^2 - v^2).
    const model::Dynamics<double> k = dynamics();
    Plant p = plant(k);
    p.place({}, {-0.4, 7.0});
    const double total = std::sqrt(0.16 + 49 * -k.k5_m / k.k6_per_m);
    for (int second = 1; second <= 3; ++second) {
        go(p, 0.5, {});
        const double expected =
            total * std::tanh(-k.k6_per_m * total * 0.5 * second + std::atanh(-0.4 / total));
        DOUBLES_EQUAL(expected, p.twist().v_m_per_s, 2e-7);
    }
}

TEST(SimPlant, without_torque_and_friction_kinetic_energy_stays) {
    Plant p = plant(dynamics());
    p.place({}, {-0.8, 9.0});
    const double before = p.kinetic_energy_J();
    double worst = 0;
    for (int i = 0; i < 40; ++i) {
        go(p, 0.5, {}, 0.0005);
        worst = std::fmax(worst, std::fabs(p.kinetic_energy_J() / before - 1));
    }
    std::printf("energy drift over 20 s: %.2e\n", worst);
    CHECK(worst < 1e-6);
}

TEST(SimPlant, k6_without_its_coupling_makes_energy_at_the_rate_that_mechanics_says) {
    model::Dynamics<double> k = dynamics();
    k.k6_per_m = 0.3;
    Plant p = plant(k);
    p.place({}, {0.5, 2.0});
    const PlantParameters& q = p.parameters();
    const double rate = 0.5 * 4.0 * (q.mass_kg * k.k5_m + q.inertia_kg_m2 * k.k6_per_m);
    const double before = p.kinetic_energy_J();
    for (int i = 0; i < 10; ++i) p.advance(1e-5, {});
    DOUBLES_EQUAL(rate, (p.kinetic_energy_J() - before) / 1e-4, 1e-3 * rate);
}

TEST(SimPlant, unequal_wheels_move_by_forces_at_their_own_radii) {
    const model::Dynamics<double> k = uncoupled();
    const double left = 0.071;
    const double right = 0.079;
    Plant p = plant(k, {}, geometry(left, right));
    const double mass = 1 / (k.k7_per_kg_m * 0.075);
    const double inertia = 0.327 / (2 * 0.075 * k.k8_per_kg_m2);
    const double force_left = 0.13 / left;
    const double force_right = -0.22 / right;
    go(p, 0.8, {0.13, -0.22});
    DOUBLES_EQUAL((force_left + force_right) / mass * 0.8, p.twist().v_m_per_s, 1e-12);
    const double omega = (force_right - force_left) * 0.327 / (2 * inertia) * 0.8;
    DOUBLES_EQUAL(omega, p.twist().omega_rad_per_s, 1e-12);
    DOUBLES_EQUAL(omega * 0.4, p.pose().heading_rad, 1e-12);
    DOUBLES_EQUAL((p.twist().v_m_per_s - omega * 0.327 / 2) / left, p.wheel_speed_rad_per_s().left, 1e-12);
}

TEST(SimPlant, wheel_torques_do_exactly_the_work_that_the_energy_gains) {
    // Everything at once: unequal wheels, heavy wheels, payload off centre, every velocity term.
    const model::MassProperties<double> body{7.7, 0.21, 0.034, 0.0043};
    Plant p(sim::plant_from_mass(geometry(0.068, 0.081), body, {}));
    p.add_payload({2.9, 0.05, -0.11, 0.07});
    p.place({}, {0.6, -3.0});
    double work = 0;
    const double before = p.kinetic_energy_J();
    for (int i = 0; i < 20000; ++i) {
        const WheelPair<double> torque{0.9 * std::sin(i * 1e-3), -0.6 * std::cos(i * 7e-4)};
        const WheelPair<double> from = p.wheel_angle_rad();
        p.advance(1e-4, torque);
        work += torque.left * (p.wheel_angle_rad().left - from.left) +
                torque.right * (p.wheel_angle_rad().right - from.right);
    }
    CHECK(std::fabs(p.kinetic_energy_J() - before) > 0.1);
    DOUBLES_EQUAL(work, p.kinetic_energy_J() - before, 1e-6);
}

TEST(SimPlant, kinetic_energy_is_that_of_body_wheels_and_payload_added_up) {
    const model::MassProperties<double> body{7.7, 0.21, 0.034, 0.0043};
    Plant p(sim::plant_from_mass(geometry(0.068, 0.081), body, {}));
    p.add_payload({2.9, 0.05, -0.11, 0.07});
    const double v = 0.6;
    const double w = -3.0;
    p.place({}, {v, w});
    const auto translation = [&](double mass, double ahead, double left) {
        return mass / 2 * (std::pow(v - w * left, 2) + std::pow(w * ahead, 2));
    };
    const double expected =
        translation(7.7, 0.034, 0) + translation(2.9, -0.11, 0.07) + (0.21 + 0.05) / 2 * w * w +
        0.0043 / 2 * (std::pow((v - w * 0.327 / 2) / 0.068, 2) + std::pow((v + w * 0.327 / 2) / 0.081, 2));
    DOUBLES_EQUAL(expected, p.kinetic_energy_J(), 1e-12);
}

TEST(SimPlant, a_payload_at_the_axle_scales_k7_and_k8_and_keeps_the_speed) {
    Plant p = plant(dynamics());
    p.place({}, {0.7, 0.9});
    const PlantParameters q = p.parameters();
    p.add_payload({0.3 * q.mass_kg, 0.3 * q.inertia_kg_m2, 0, 0});
    const model::Dynamics<double> k = sim::plant_dynamics(p.parameters());
    DOUBLES_EQUAL(1.31 / 1.3, k.k7_per_kg_m, 1e-12);
    DOUBLES_EQUAL(6.1 / 1.3, k.k8_per_kg_m2, 1e-12);
    DOUBLES_EQUAL(0.7, p.twist().v_m_per_s, 0);
    DOUBLES_EQUAL(0.9, p.twist().omega_rad_per_s, 0);
}

TEST(SimPlant, constant_speeds_trace_a_circle) {
    Plant p = plant(uncoupled());
    p.place({1.5, -0.5, 0.7}, {0.8, 1.6});
    go(p, kPi / 1.6, {});  // half a turn: across the circle of radius 0.5
    DOUBLES_EQUAL(1.5 - 2 * 0.5 * std::sin(0.7), p.pose().x_m, 1e-11);
    DOUBLES_EQUAL(-0.5 + 2 * 0.5 * std::cos(0.7), p.pose().y_m, 1e-11);
    go(p, kPi / 1.6, {});
    DOUBLES_EQUAL(1.5, p.pose().x_m, 1e-11);
    DOUBLES_EQUAL(-0.5, p.pose().y_m, 1e-11);
    DOUBLES_EQUAL(0.7 + 2 * kPi, p.pose().heading_rad, 1e-11);
}

TEST(SimPlant, an_external_push_accelerates_by_mass_and_inertia) {
    Plant p = plant(uncoupled());
    p.set_disturbance({3.0, -0.2});
    go(p, 0.4, {});
    DOUBLES_EQUAL(3.0 / p.parameters().mass_kg * 0.4, p.twist().v_m_per_s, 1e-12);
    DOUBLES_EQUAL(-0.2 / p.parameters().inertia_kg_m2 * 0.4, p.twist().omega_rad_per_s, 1e-12);
}

TEST_GROUP(SimPlantFriction){};

TEST(SimPlantFriction, a_robot_at_rest_does_not_move_one_bit_below_the_friction_limit) {
    Plant p = plant(dynamics(), friction(0.02, 0.31, 0.27), geometry(0.0743, 0.0761));
    const Pose<double> start{0.3, 0.2, 0.1};
    p.place(start, {});
    for (int i = 0; i < 20000; ++i) {
        p.advance(0.0005, {0.3099 * std::sin(i * 0.01), -0.2699 * std::cos(i * 0.013)});
        CHECK(p.at_rest());
    }
    CHECK_EQUAL(0, std::memcmp(&start, &p.pose(), sizeof start));
    CHECK(p.wheel_angle_rad().left == 0 && p.wheel_angle_rad().right == 0);
    // While it sticks, friction is the torque it is asked for.
    p.advance(0.0005, {0.123, -0.2});
    DOUBLES_EQUAL(-0.123, p.torques().dry_effects_Nm.left, 1e-13);
    DOUBLES_EQUAL(0.2, p.torques().dry_effects_Nm.right, 1e-13);
    p.advance(0.0005, {0.3101, 0.2701});
    CHECK(p.wheel_speed_rad_per_s().left > 0);
    CHECK(p.wheel_speed_rad_per_s().right > 0);
}

TEST(SimPlantFriction, coasting_slows_linearly_stops_at_the_right_place_and_stays) {
    const model::Dynamics<double> k = uncoupled();
    const double f = 0.3;
    const double v0 = 0.9;
    Plant p = plant(k, friction(0, f, f));
    p.place({}, {v0, 0});
    const double slope = 2 * f * k.k7_per_kg_m;
    go(p, 0.5, {});
    DOUBLES_EQUAL(v0 - slope * 0.5, p.twist().v_m_per_s, 1e-12);
    go(p, v0 / slope - 0.5 - 0.001, {});
    CHECK(p.twist().v_m_per_s > 0);
    go(p, 0.002, {});
    CHECK(p.at_rest());
    const Pose<double> stopped = p.pose();
    DOUBLES_EQUAL(v0 * v0 / (2 * slope), stopped.x_m, 1e-6);
    go(p, 5, {0.29, -0.29});
    CHECK_EQUAL(0, std::memcmp(&stopped, &p.pose(), sizeof stopped));
}

TEST(SimPlantFriction, coasting_with_viscous_and_dry_friction_stops_when_the_formula_says) {
    const model::Dynamics<double> k = uncoupled();
    const double f = 0.12;
    const double c = 0.03;
    const double r = 0.0743;
    const double v0 = 1.4;
    Plant p = plant(k, friction(c, f, f));
    p.place({}, {v0, 0});
    const double rate = 2 * c * k.k7_per_kg_m / r;
    go(p, 0.6, {});
    DOUBLES_EQUAL((v0 + f * r / c) * std::exp(-rate * 0.6) - f * r / c, p.twist().v_m_per_s, 1e-6);
    const double stop_s = std::log(1 + c * v0 / (r * f)) / rate;
    go(p, stop_s - 0.6 - 0.001, {});
    CHECK(!p.at_rest());
    go(p, 0.002, {});
    CHECK(p.at_rest());
}

TEST(SimPlantFriction, one_wheel_holds_while_the_other_turns_the_robot_around_it) {
    const model::Dynamics<double> k = uncoupled();
    const double r = 0.0743;
    const double b = 0.327;
    Plant p = plant(k, friction(0, 3.0, 0.2));
    go(p, 0.3, {0, 1.1});
    CHECK(p.wheel_speed_rad_per_s().left == 0);
    CHECK(p.wheel_angle_rad().left == 0);
    // About the left contact point: right wheel mass r^2 (m/4 + I/b^2), coupling r^2 (m/4 - I/b^2).
    const double own = r * r * (p.parameters().mass_kg / 4 + p.parameters().inertia_kg_m2 / (b * b));
    const double coupling = r * r * (p.parameters().mass_kg / 4 - p.parameters().inertia_kg_m2 / (b * b));
    const double acceleration = (1.1 - 0.2) / own;
    DOUBLES_EQUAL(acceleration * 0.3, p.wheel_speed_rad_per_s().right, 1e-11);
    DOUBLES_EQUAL(coupling * acceleration, p.torques().dry_effects_Nm.left, 1e-11);
    DOUBLES_EQUAL(-0.2, p.torques().dry_effects_Nm.right, 1e-14);
}

TEST(SimPlantFriction, dry_friction_never_adds_energy) {
    Plant p = plant(dynamics(), friction(0, 0.35, 0.22), geometry(0.071, 0.079));
    p.place({}, {0.3, -5.0});
    double before = p.kinetic_energy_J();
    for (int i = 0; i < 4000; ++i) {
        p.advance(0.0005, {});
        CHECK(p.kinetic_energy_J() <= before * (1 + 1e-9));
        before = p.kinetic_energy_J();
    }
    CHECK(p.at_rest());
}

TEST(SimPlantFriction, the_motion_does_not_depend_on_how_time_is_cut) {
    Plant fine = plant(dynamics(), friction(0.02, 0.31, 0.27), geometry(0.0743, 0.0761));
    Plant coarse = fine;
    for (int i = 0; i < 3000; ++i) {
        const WheelPair<double> torque{1.5 * std::sin(i * 0.02), 1.3 * std::sin(i * 0.023 + 1)};
        coarse.advance(0.0005, torque);
        for (int j = 0; j < 10; ++j) fine.advance(0.00005, torque);
    }
    std::printf("1.5 s of reversing wheels, steps of 0.5 and 0.05 ms: %.1e m, %.1e rad apart\n",
                std::hypot(fine.pose().x_m - coarse.pose().x_m, fine.pose().y_m - coarse.pose().y_m),
                std::fabs(fine.pose().heading_rad - coarse.pose().heading_rad));
    DOUBLES_EQUAL(fine.pose().x_m, coarse.pose().x_m, 1e-4);
    DOUBLES_EQUAL(fine.pose().y_m, coarse.pose().y_m, 1e-4);
    DOUBLES_EQUAL(fine.pose().heading_rad, coarse.pose().heading_rad, 3e-4);
}

// Newton's laws by hand, with the mass and inertia that K7 and K8 stand for.
TEST_GROUP(SimPlantEffects){};

TEST(SimPlantEffects, quadratic_drag_slows_a_coasting_robot_along_the_hyperbola) {
    const double c = 2.3;
    Plant p = plant(uncoupled(), effect("quadratic_drag", {c}));
    p.place({}, {-1.7, 0});
    go(p, 2.5, {});
    const double mass = 1 / (1.31 * 0.0743);
    DOUBLES_EQUAL(-1.7 / (1 + c / mass * 1.7 * 2.5), p.twist().v_m_per_s, 1e-6);
    DOUBLES_EQUAL(0, p.twist().omega_rad_per_s, 1e-15);
}

TEST(SimPlantEffects, quadratic_drag_acts_on_the_body_and_turns_it_only_by_unequal_wheels) {
    // a force at the axle's middle, whatever the wheels
    Plant p = plant(uncoupled(), effect("quadratic_drag", {2.3}), geometry(0.071, 0.079));
    p.place({}, {1.2, 0});
    go(p, 0.5, {});
    DOUBLES_EQUAL(0, p.twist().omega_rad_per_s, 1e-12);
    CHECK(p.twist().v_m_per_s < 1.19);
}

TEST(SimPlantEffects, turning_scrub_stops_a_turn_when_the_formula_says_and_lets_the_robot_roll) {
    const double scrub = 0.4;
    Plant p = plant(uncoupled(), effect("turning_scrub", {scrub}), geometry(0.071, 0.079));
    p.place({}, {0.5, 2.0});
    const double inertia = p.parameters().inertia_kg_m2;
    go(p, 0.2, {});
    DOUBLES_EQUAL(2.0 - scrub / inertia * 0.2, p.twist().omega_rad_per_s, 1e-10);
    DOUBLES_EQUAL(0.5, p.twist().v_m_per_s, 1e-10);
    go(p, 2.0 * inertia / scrub, {});
    DOUBLES_EQUAL(0, p.twist().omega_rad_per_s, 1e-15);
    DOUBLES_EQUAL(0.5, p.twist().v_m_per_s, 1e-10);
}

TEST(SimPlantEffects, turning_scrub_holds_the_heading_below_its_limit_and_not_above) {
    Plant p = plant(uncoupled(), effect("turning_scrub", {0.4}));
    // N = (tau_R - tau_L) b / (2 r): 0.4 Nm at a difference of 0.1818 Nm
    go(p, 0.5, {0.1, 0.281});
    DOUBLES_EQUAL(0, p.twist().omega_rad_per_s, 1e-15);
    CHECK(p.twist().v_m_per_s > 0.1);
    go(p, 0.1, {0.1, 0.283});
    CHECK(p.twist().omega_rad_per_s > 0);
}

TEST(SimPlantEffects, torque_bias_drives_a_robot_that_nobody_drives) {
    Plant p = plant(uncoupled(), effect("torque_bias", {0.05, -0.02}));
    go(p, 0.7, {});
    DOUBLES_EQUAL(1.31 * 0.03 * 0.7, p.twist().v_m_per_s, 1e-12);
    DOUBLES_EQUAL(6.1 * -0.07 * 0.7, p.twist().omega_rad_per_s, 1e-12);
}

// Gravity does not pull at the wheels' rotation.
TEST(SimPlantEffects, a_slope_pulls_back_uphill_and_forward_downhill_by_g_sine_at_the_body) {
    const double angle = 0.06;
    const double body = 1 - model::kRotationShare;
    for (const double uphill : {0.0, 2.1, -1.3}) {
        Plant p = plant(uncoupled(), effect("slope", {angle, uphill}));
        p.place({0, 0, 0.4}, {});
        go(p, 0.3, {});
        DOUBLES_EQUAL(-9.80665 * body * std::sin(angle) * std::cos(uphill - 0.4) * 0.3, p.twist().v_m_per_s,
                      1e-9);
        DOUBLES_EQUAL(0, p.twist().omega_rad_per_s, 1e-12);
    }
}

TEST(SimPlantEffects, on_a_slope_the_centre_of_gravity_ahead_turns_the_robot_downhill) {
    const double angle = 0.06;
    Plant p = plant(dynamics(), effect("slope", {angle, 1.5707963267948966}));  // the left side is up
    p.advance(1e-4, {});
    const PlantParameters& q = p.parameters();
    const double yaw_torque = -q.centrifugal_kg_m * 9.80665 * std::sin(angle);
    DOUBLES_EQUAL(yaw_torque / q.inertia_kg_m2 * 1e-4, p.twist().omega_rad_per_s, 1e-9);
    DOUBLES_EQUAL(0, p.twist().v_m_per_s, 1e-9);
    CHECK(p.twist().omega_rad_per_s < 0);
}

TEST(SimPlantEffects, a_robot_that_rolls_on_a_slope_keeps_its_energy) {
    const double angle = 0.05;
    Plant p = plant(dynamics(), effect("slope", {angle, 0.8}), geometry(0.071, 0.079));
    p.place({0, 0, 1.9}, {0.3, 1.1});
    const PlantParameters& q = p.parameters();
    const double body_kg = (1 - model::kRotationShare) * q.mass_kg;
    const double ahead = q.centrifugal_kg_m / body_kg;
    const auto energy = [&] {
        const double along = (p.pose().x_m + ahead * std::cos(p.pose().heading_rad)) * std::cos(0.8) +
                             (p.pose().y_m + ahead * std::sin(p.pose().heading_rad)) * std::sin(0.8);
        return p.kinetic_energy_J() + body_kg * 9.80665 * std::sin(angle) * along;
    };
    const double before = energy();
    for (int i = 0; i < 10; ++i) {
        go(p, 0.5, {});
        DOUBLES_EQUAL(before, energy(), 1e-5);
    }
    CHECK(std::fabs(p.twist().v_m_per_s) > 0.3);
}

TEST(SimPlantEffects, torque_gain_mismatch_keeps_the_mean_and_the_ratio) {
    const double relative = 0.08;
    Plant p = plant(uncoupled(), effect("torque_gain_mismatch", {relative}));
    p.advance(1e-4, {1.3, 1.3});
    const WheelPair<double> motor = p.torques().motor_Nm;
    DOUBLES_EQUAL(1 + relative, motor.right / motor.left, 1e-12);
    DOUBLES_EQUAL(2.6, motor.sum(), 1e-12);
    DOUBLES_EQUAL(6.1 * motor.difference() * 1e-4, p.twist().omega_rad_per_s, 1e-12);
    CHECK(p.twist().omega_rad_per_s > 0);
}

TEST(SimPlantEffects, coordinates_lead_back_to_the_parameters) {
    using Values = model::Parameters<double>;
    for (const Values& p : {Values{0.03, 2.9}, Values{0.2, -1.1}}) {
        const Values back = model::Slope::from_coordinates(model::Slope::coordinates(p));
        DOUBLES_EQUAL(p[0], back[0], 1e-13);
        DOUBLES_EQUAL(p[1], back[1], 1e-13);
    }
    for (const double relative : {-0.2, 0.03, 0.9}) {
        const Values back = model::TorqueGainMismatch::from_coordinates(
            model::TorqueGainMismatch::coordinates(Values{relative}));
        DOUBLES_EQUAL(relative, back[0], 1e-14);
    }
}

TEST(SimPlantEffects, estimators_take_what_they_have_room_for_in_catalogue_order) {
    const auto at = [](const char* name) { return model::find_effect(name); };
    std::array<bool, model::kEffectCount> active{};
    active.fill(true);
    const auto estimated = model::estimated_effects(active);
    CHECK(estimated[at("viscous_friction")] && estimated[at("coulomb_friction")]);
    CHECK_FALSE(estimated[at("quadratic_drag")] || estimated[at("torque_bias")]);
    active[at("coulomb_friction")] = false;
    const auto others = model::estimated_effects(active);
    CHECK(others[at("viscous_friction")] && others[at("quadratic_drag")] && others[at("turning_scrub")]);
    CHECK_FALSE(others[at("torque_bias")] || others[at("slope")] || others[at("torque_gain_mismatch")]);
}

// The controller's inverse against the simulated robot, which shares the effects' equations but not this use
// of them: the acceleration that comes is the one that was asked for, and without compensation it is another
// one.
TEST(SimPlantEffects, each_effect_is_compensated_by_the_linearisation) {
    struct Case {
        const char* name;
        model::Parameters<double> parameters;
    };
    const std::array<Case, 11> cases{{{"viscous_friction", {0.011, 0.013}},
                                      {"coulomb_friction", {0.31, 0.27}},
                                      {"quadratic_drag", {3.1}},
                                      {"turning_scrub", {0.35}},
                                      {"torque_bias", {0.06, -0.11}},
                                      {"slope", {0.07, 0.9}},
                                      {"torque_gain_mismatch", {0.12}},
                                      {"stribeck_friction", {0.1, 0.3, 8}},
                                      {"cog_lateral", {0.03}},
                                      {"dead_zone", {0.2}},
                                      {"torque_ripple", {0.15, 7, 0.9}}}};
    const auto compensated = model::for_catalogue([]<typename Effect>() {
        return model::SmoothTorque<Effect> || model::Dry<Effect> || model::DryBySpeed<Effect> ||
               std::is_same_v<Effect, model::CogLateral>;
    });
    LONGS_EQUAL(std::count(compensated.begin(), compensated.end(), true), cases.size());
    for (const Case& c : cases) {
        const control::PlantModel<double> informed{geometry(), dynamics(), effect(c.name, c.parameters)};
        auto ignorant = informed;
        ignorant.effects.active = {};
        sim::Plant robot(sim::plant_from_dynamics(informed.geometry, informed.dynamics, informed.effects),
                         {0.2, -0.1, 0.4});
        const TwistRate<double> nu{1.1, -4.2};
        const auto comes = [&](const control::PlantModel<double>& plant) {
            robot.place(robot.pose(), {0.8, -1.3});
            model::Motion<double> motion;
            motion.twist = robot.twist();
            motion.wheel_speed_rad_per_s = robot.wheel_speed_rad_per_s();
            motion.heading_rad = robot.pose().heading_rad;
            const auto torque = linearising_torque_Nm(plant, motion, motion.twist, nu);
            const auto back = linearised_acceleration(plant, motion, motion.twist, torque);
            DOUBLES_EQUAL(nu.v_m_per_s2, back.v_m_per_s2, 1e-12);
            DOUBLES_EQUAL(nu.omega_rad_per_s2, back.omega_rad_per_s2, 1e-12);
            constexpr double kStep_s = 1e-6;
            robot.advance(kStep_s, torque);
            return TwistRate<double>{(robot.twist().v_m_per_s - 0.8) / kStep_s,
                                     (robot.twist().omega_rad_per_s + 1.3) / kStep_s};
        };
        const TwistRate<double> with = comes(informed);
        DOUBLES_EQUAL(nu.v_m_per_s2, with.v_m_per_s2, 1e-4);
        DOUBLES_EQUAL(nu.omega_rad_per_s2, with.omega_rad_per_s2, 1e-4);
        const TwistRate<double> without = comes(ignorant);
        CHECK(std::abs(without.v_m_per_s2 - nu.v_m_per_s2) > 0.02 ||
              std::abs(without.omega_rad_per_s2 - nu.omega_rad_per_s2) > 0.2);
    }
}
