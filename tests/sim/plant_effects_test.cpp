// The simulated robot with each effect of the catalogue that is more than a torque column, against closed
// formulas.
#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <cstdio>

#include "firmware/model/dynamics.hpp"
#include "sim_hal/plant.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using sim::Plant;

namespace {

constexpr double kRadius_m = 0.0743;
constexpr double kTrack_m = 0.327;
constexpr double kK7 = 1.31;
constexpr double kK8 = 6.1;
constexpr double kMass_kg = 1 / (kK7 * kRadius_m);
constexpr double kInertia_kg_m2 = kTrack_m / (2 * kRadius_m * kK8);

model::EffectSet<double> with(const char* name, const model::Parameters<double>& parameters,
                              model::EffectSet<double> set = {}) {
    const std::size_t i = model::find_effect(name);
    CHECK(i < model::kEffectCount);
    set.active[i] = true;
    set.parameter[i] = parameters;
    return set;
}

// The centre of gravity on the axle, unless said otherwise.
Plant robot(const model::EffectSet<double>& effects, double k5_m = 0) {
    const model::Geometry<double> g{{kRadius_m, kRadius_m}, kTrack_m};
    const model::Dynamics<double> k{k5_m, model::coupled_k6(k5_m, kK7, kK8, kTrack_m), kK7, kK8};
    return Plant(sim::plant_from_dynamics(g, k, effects));
}

void go(Plant& p, double duration_s, const WheelPair<double>& torque, double dt_s = 0.00037) {
    const int steps = static_cast<int>(std::ceil(duration_s / dt_s));
    for (int i = 0; i < steps; ++i) p.advance(duration_s / steps, torque);
}

}  // namespace

TEST_GROUP(SimPlantPath){};

TEST(SimPlantPath, a_lag_delays_the_speed_by_its_time_constant) {
    Plant p = robot(with("actuator_lag", {0.021}));
    go(p, 0.05, {0.4, 0.3});
    const double lagged_s = 0.05 - 0.021 * (1 - std::exp(-0.05 / 0.021));
    DOUBLES_EQUAL(kK7 * 0.7 * lagged_s, p.twist().v_m_per_s, 1e-12);
    DOUBLES_EQUAL(kK8 * -0.1 * lagged_s, p.twist().omega_rad_per_s, 1e-12);
}

TEST(SimPlantPath, a_delay_shifts_the_speed) {
    Plant p = robot(with("transport_delay", {0.0061}));
    go(p, 0.0061, {0.4, 0.4}, 0.00061);
    DOUBLES_EQUAL(0, p.twist().v_m_per_s, 1e-15);
    go(p, 0.04, {0.4, 0.4});
    DOUBLES_EQUAL(kK7 * 0.8 * 0.04, p.twist().v_m_per_s, 1e-12);
}

TEST(SimPlantPath, dead_zone_and_saturation_have_their_static_curves) {
    Plant dead = robot(with("dead_zone", {0.15}));
    go(dead, 0.2, {0.14, -0.15});
    CHECK(dead.at_rest());
    go(dead, 0.2, {0.4, -0.25});
    DOUBLES_EQUAL(kK7 * (0.25 - 0.10) * 0.2, dead.twist().v_m_per_s, 1e-12);
    Plant limited = robot(with("torque_saturation", {0.5}, with("torque_bias", {0.2, 0})));
    go(limited, 0.2, {0.4, -0.25});
    DOUBLES_EQUAL(kK7 * (0.5 - 0.25) * 0.2, limited.twist().v_m_per_s, 1e-12);
}

TEST(SimPlantPath, a_motor_approaches_its_no_load_speed_exponentially) {
    Plant p = robot(with("back_emf_limit", {0.6, 14}));
    go(p, 0.7, {5, 5});
    const double rate = 2 * kK7 * 0.6 / (kRadius_m * 14);
    DOUBLES_EQUAL(kRadius_m * 14 * (1 - std::exp(-rate * 0.7)), p.twist().v_m_per_s, 1e-3);
}

TEST(SimPlantPath, a_drift_loses_its_share_over_the_span) {
    Plant p = robot(with("gain_drift", {0.3, 0}));
    go(p, 3, {0.02, 0.02}, 0.0005);
    DOUBLES_EQUAL(kK7 * 0.04 * (3 - 0.3 * 3 * 3 / (2 * 60)), p.twist().v_m_per_s, 1e-5);
    DOUBLES_EQUAL(3, p.time_s(), 1e-9);
}

TEST(SimPlantPath, a_ripple_has_its_order_in_the_wheels_angle) {
    Plant p = robot(with("torque_ripple", {0.2, 7, 0.4}));
    p.place({}, {0.5, 0.8});
    double in_phase = 0;
    double other_order = 0;
    int steps = 0;
    for (; p.wheel_angle_rad().right < 4 * 3.14159265358979323846; ++steps) {
        const double angle = p.wheel_angle_rad().right;
        p.advance(0.0005, {});
        in_phase += p.torques().motor_Nm.right * std::sin(7 * angle + 0.4);
        other_order += p.torques().motor_Nm.right * std::sin(6 * angle + 0.4);
    }
    DOUBLES_EQUAL(0.1, in_phase / steps, 0.003);
    DOUBLES_EQUAL(0, other_order / steps, 0.003);
}

TEST(SimPlantPath, a_motor_behind_backlash_runs_free_strikes_and_then_drives_the_whole_robot) {
    const double motor = 0.0009;
    Plant p = robot(with("backlash", {0.03, motor}));
    // the robot without its motors
    const double rest_kg = kMass_kg - 2 * motor / (kRadius_m * kRadius_m);
    DOUBLES_EQUAL(rest_kg, p.actual().mass_kg, 1e-12);
    const double meets_s = std::sqrt(2 * 0.03 * motor / 0.2);
    go(p, 0.98 * meets_s, {0.2, 0.2});
    CHECK(p.at_rest());
    go(p, 0.04 * meets_s, {0.2, 0.2});
    CHECK_FALSE(p.at_rest());
    // all momentum that was given is in robot and motors, which turn together
    go(p, 0.3 - 1.02 * meets_s, {0.2, 0.2});
    DOUBLES_EQUAL(kK7 * 0.4 * 0.3, p.twist().v_m_per_s, 2e-3 * kK7 * 0.4 * 0.3);
    const double before = p.twist().v_m_per_s;
    go(p, 0.1, {0.2, 0.2});
    DOUBLES_EQUAL(kK7 * 0.4 * 0.1, p.twist().v_m_per_s - before, 1e-7);
}

TEST_GROUP(SimPlantRobot){};

TEST(SimPlantRobot, stribeck_friction_holds_to_its_static_limit_and_breaks_away) {
    Plant p = robot(with("stribeck_friction", {0.2, 0.5, 1.5}));
    for (int i = 0; i < 2000; ++i) {
        p.advance(0.0005, {0.499 * std::sin(i * 0.01), -0.499 * std::cos(i * 0.01)});
        CHECK(p.at_rest());
    }
    go(p, 0.05, {0.501, 0.501});
    CHECK(p.twist().v_m_per_s > 0);
    // at speed only Coulomb's part is left
    p.place({}, {3.0, 0});
    go(p, 0.1, {});
    DOUBLES_EQUAL(3.0 - 2 * kK7 * 0.2 * 0.1, p.twist().v_m_per_s, 1e-9);
}

TEST(SimPlantRobot, stribeck_friction_stops_a_coasting_robot_when_its_equation_says) {
    Plant p = robot(with("stribeck_friction", {0.2, 0.5, 4}));
    p.place({}, {0.8, 0});
    // the same equation in fine steps: dv / (2 K7 limit(v / r)) = -dt
    double stop_s = 0;
    constexpr int kParts = 200000;
    for (int i = 0; i < kParts; ++i) {
        const double ratio = (i + 0.5) * 0.8 / kParts / kRadius_m / 4;
        stop_s += 0.8 / kParts / (2 * kK7 * (0.2 + 0.3 * std::exp(-ratio * ratio)));
    }
    go(p, stop_s - 0.002, {});
    CHECK_FALSE(p.at_rest());
    go(p, 0.004, {});
    CHECK(p.at_rest());
}

TEST(SimPlantRobot, a_castor_slows_a_straight_drive_by_its_rolling_force_and_then_holds) {
    Plant p = robot(with("castor_drag", {2.1, 0.03, 0.16, 0.03}));
    p.place({}, {0.3, 0});
    go(p, 0.4, {});
    DOUBLES_EQUAL(0.3 - 2.1 / kMass_kg * 0.4, p.twist().v_m_per_s, 1e-9);
    DOUBLES_EQUAL(0, p.twist().omega_rad_per_s, 1e-12);
    go(p, 2, {});
    CHECK(p.at_rest());
    // 2.1 N are 0.078 Nm on each wheel
    go(p, 0.5, {0.077, 0.077});
    CHECK(p.at_rest());
    go(p, 0.5, {0.079, 0.079});
    CHECK(p.twist().v_m_per_s > 0);
}

TEST(SimPlantRobot, a_castor_takes_as_much_energy_as_its_friction_forces_need) {
    const model::Parameters<double> c{1.4, 0.05, 0.16, 0.03};
    Plant p = robot(with("castor_drag", c), 0.04);
    p.place({}, {0.5, 2.5});
    double work = 0;
    model::CastorDrag::Memory<double> fork;
    const double before = p.kinetic_energy_J();
    for (int i = 0; i < 8000; ++i) {
        const Twist<double> u = p.twist();
        for (unsigned j = 0; j < 2; ++j) {
            const auto d = model::CastorDrag::direction(j, c, fork);
            work += 0.0001 * c[j] * std::fabs(d.force_N * u.v_m_per_s + d.yaw_torque_Nm * u.omega_rad_per_s);
        }
        p.advance(0.0001, {});
        model::CastorDrag::advance(c, fork,
                                   Twist<double>{(u.v_m_per_s + p.twist().v_m_per_s) / 2,
                                                 (u.omega_rad_per_s + p.twist().omega_rad_per_s) / 2},
                                   0.0001);
    }
    const double lost = before - p.kinetic_energy_J();
    CHECK(lost > 0.3);
    DOUBLES_EQUAL(work, lost, 2e-3 * lost);
}

TEST(SimPlantRobot, a_lateral_centre_of_gravity_accelerates_by_its_mass_matrix) {
    const double b = 0.031;
    Plant p = robot(with("cog_lateral", {b}));
    go(p, 0.2, {0.5, 0.3});
    Eigen::Matrix2d mass;
    mass << kMass_kg, -kMass_kg * b, -kMass_kg * b, kInertia_kg_m2;
    const Eigen::Vector2d push(0.8 / kRadius_m, -0.2 / kRadius_m * kTrack_m / 2);
    const Eigen::Vector2d rate = mass.ldlt().solve(push);
    DOUBLES_EQUAL(rate(0) * 0.2, p.twist().v_m_per_s, 1e-12);
    DOUBLES_EQUAL(rate(1) * 0.2, p.twist().omega_rad_per_s, 1e-12);
    // the effect's own push is what the middle one lacks
    const model::BodyForce<double> extra =
        model::CogLateral::push({b}, p.parameters().geometry, {0, 0, kK7, kK8}, {rate(0), rate(1)});
    DOUBLES_EQUAL(kMass_kg * rate(0), push(0) + extra.force_N, 1e-12);
    DOUBLES_EQUAL(kInertia_kg_m2 * rate(1), push(1) + extra.yaw_torque_Nm, 1e-12);
}

TEST(SimPlantRobot, on_a_slope_a_lateral_centre_of_gravity_turns_the_robot) {
    const double b = 0.031;
    Plant p = robot(with("cog_lateral", {b}, with("slope", {0.05, 0})));
    p.advance(1e-4, {});
    // Uphill ahead. Without the wheels' rotation it would fall back without turning; as it is, rotation holds
    // the axle back and the centre of gravity goes ahead of it.
    const double pull = -9.80665 * std::sin(0.05);
    const double falls = (1 - model::kRotationShare) * kMass_kg * pull;
    const double moment = -b * kMass_kg * pull;  // of the same body, at the offset that it really has
    const double coupling = -b * kMass_kg;
    const double determinant = kMass_kg * kInertia_kg_m2 - coupling * coupling;
    DOUBLES_EQUAL((kInertia_kg_m2 * falls - coupling * moment) / determinant * 1e-4, p.twist().v_m_per_s,
                  1e-10);
    DOUBLES_EQUAL((kMass_kg * moment - coupling * falls) / determinant * 1e-4, p.twist().omega_rad_per_s,
                  1e-10);
    CHECK(p.twist().omega_rad_per_s > 1e-8);
}

TEST(SimPlantRobot, a_payload_comes_at_its_time_and_keeps_the_speed) {
    const double k5 = 0.04;
    const double ahead = 0.07;
    Plant p = robot(with("payload_step", {0.25, 3.0, 0.06, ahead}), k5);
    const model::Dynamics<double> before = sim::plant_dynamics(p.actual());
    DOUBLES_EQUAL(kK7, before.k7_per_kg_m, 1e-12);
    go(p, 0.25, {0.2, 0.2}, 0.0005);
    const double v = p.twist().v_m_per_s;
    DOUBLES_EQUAL(kK7 * 0.4 * 0.25, v, 1e-12);
    p.advance(0.0005, {});
    DOUBLES_EQUAL(v, p.twist().v_m_per_s, 1e-12);
    const model::Dynamics<double> after = sim::plant_dynamics(p.actual());
    DOUBLES_EQUAL(kMass_kg / (kMass_kg + 3), after.k7_per_kg_m / kK7, 1e-12);
    DOUBLES_EQUAL(kInertia_kg_m2 / (kInertia_kg_m2 + 0.06 + 3 * std::pow(k5 + ahead, 2)),
                  after.k8_per_kg_m2 / kK8, 1e-12);
    const model::Dynamics<double> loaded =
        model::PayloadStep::loaded({0.25, 3.0, 0.06, ahead}, p.parameters().geometry, before);
    DOUBLES_EQUAL(loaded.k5_m, after.k5_m, 1e-12);
    DOUBLES_EQUAL(loaded.k6_per_m, after.k6_per_m, 1e-12);
    const double from = p.twist().v_m_per_s;
    go(p, 0.1, {0.2, 0.2}, 0.0005);
    DOUBLES_EQUAL(after.k7_per_kg_m * 0.4 * 0.1, p.twist().v_m_per_s - from, 1e-12);
}

TEST(SimPlantRobot, unequal_radii_turn_a_robot_whose_wheels_turn_alike) {
    Plant p = robot(with("wheel_radius_mismatch", {0.05}));
    p.place({}, {0.6, 0});
    const double left = 2 * kRadius_m / 2.05;
    DOUBLES_EQUAL(0.6 / left, p.wheel_speed_rad_per_s().left, 1e-12);
    DOUBLES_EQUAL(0.6 / (1.05 * left), p.wheel_speed_rad_per_s().right, 1e-12);
    DOUBLES_EQUAL(kRadius_m, p.parameters().geometry.wheel_radius_m.left, 0);
}

TEST(SimPlantRobot, unequal_radii_are_the_same_from_the_effect_as_from_the_geometry) {
    const model::MassProperties<double> body{3.1, 0.06, 0.04, 0.0023};
    const double left = 2 * kRadius_m / 2.3;
    Plant as_effect(
        sim::plant_from_mass({{kRadius_m, kRadius_m}, kTrack_m}, body, with("wheel_radius_mismatch", {0.3})));
    Plant as_geometry(sim::plant_from_mass({{left, 1.3 * left}, kTrack_m}, body, {}));
    for (const WheelPair<double> torque : {WheelPair<double>{0.4, 0.1}, {-0.2, 0.3}, {0.3, 0.3}}) {
        go(as_effect, 0.4, torque);
        go(as_geometry, 0.4, torque);
        DOUBLES_EQUAL(as_geometry.twist().v_m_per_s, as_effect.twist().v_m_per_s, 1e-12);
        DOUBLES_EQUAL(as_geometry.twist().omega_rad_per_s, as_effect.twist().omega_rad_per_s, 1e-12);
    }
}

TEST_GROUP(SimPlantSlip){};

TEST(SimPlantSlip, a_pulling_tyre_slips_by_its_share_of_the_largest_force) {
    const double mu = 0.5;
    const double slip_speed = 0.2;
    sim::PlantParameters q = robot(with("wheel_slip", {mu, slip_speed})).parameters();
    q.wheel_inertia_kg_m2 = 0.0011;
    Plant p(q);
    go(p, 0.3, {0.4, 0.4}, 0.0005);
    const double before = p.twist().v_m_per_s;
    go(p, 0.1, {0.4, 0.4}, 0.0005);
    // settled: everything accelerates as one body
    DOUBLES_EQUAL(kK7 * 0.8 * 0.1, p.twist().v_m_per_s - before, 1e-9);
    const double load = kMass_kg * 9.80665 / 2;
    const double force = (0.4 - 0.0011 * kK7 * 0.8 / kRadius_m) / kRadius_m;
    DOUBLES_EQUAL(slip_speed * force / (mu * load), p.slip_m_per_s().left, 1e-9);
    DOUBLES_EQUAL(p.slip_m_per_s().left, kRadius_m * p.wheel_speed_rad_per_s().left - p.twist().v_m_per_s,
                  1e-12);
}

TEST(SimPlantSlip, soft_tyres_go_after_the_torque_as_the_columns_of_a_log_take_it) {
    const model::Parameters<double> soft{1.3, 1.7};
    Plant p = robot(with("wheel_slip", soft));
    // one wheel's rotation as mass at its rim, and its share where the robot drives on, and where it turns
    const double rim_kg = model::kRotationShare * kMass_kg / 2;
    const double share = 2 * rim_kg / kMass_kg;
    const double turning_share = rim_kg * kTrack_m * kTrack_m / (2 * kInertia_kg_m2);
    const double give = soft[1] / (soft[0] * kMass_kg * 9.80665 / 2);  // slip per force
    const auto slip = [&](double of_it, double torque_Nm, double time_s) {
        return (1 - of_it) * give * torque_Nm / kRadius_m *
               (1 - std::exp(-time_s / ((1 - of_it) * give * rim_kg)));
    };
    const WheelPair<double> torque{0.11, 0.42};
    double time_s = 0;
    for (const double more_s : {0.004, 0.008, 0.03}) {
        time_s += more_s;
        go(p, more_s, torque, 5e-5);
        const double ahead = slip(share, torque.sum() / 2, time_s);
        const double across = slip(turning_share, torque.difference(), time_s);
        const WheelPair<double> rim{kRadius_m * p.wheel_speed_rad_per_s().left,
                                    kRadius_m * p.wheel_speed_rad_per_s().right};
        DOUBLES_EQUAL(kK7 * torque.sum() * time_s + (1 - share) * ahead, rim.sum() / 2, 0.004 * ahead);
        DOUBLES_EQUAL(kK8 * torque.difference() * time_s + (1 - turning_share) * across / kTrack_m,
                      rim.difference() / kTrack_m, 0.004 * across / kTrack_m);
        const model::Dynamics<double> k{0, 0, kK7, kK8};
        const auto forward = model::WheelSlip::forward(soft, p.parameters().geometry, k);
        const auto turning = model::WheelSlip::turning(soft, p.parameters().geometry, k);
        DOUBLES_EQUAL(ahead, forward.slip_per_force * torque.sum() / 2 / kRadius_m * forward.share_of(time_s),
                      1e-12);
        DOUBLES_EQUAL(across,
                      turning.slip_per_force * torque.difference() / kRadius_m * turning.share_of(time_s),
                      1e-12);
        DOUBLES_EQUAL(1 - turning_share, turning.bodys_share, 1e-12);
    }
}

TEST(SimPlantSlip, beyond_its_limit_a_tyre_pushes_with_that_and_the_wheel_spins_up) {
    const double mu = 0.1;
    sim::PlantParameters q = robot(with("wheel_slip", {mu, 0.05})).parameters();
    q.wheel_inertia_kg_m2 = 0.0011;
    Plant p(q);
    go(p, 0.1, {1, 1}, 0.0005);
    const double v = p.twist().v_m_per_s;
    const double w = p.wheel_speed_rad_per_s().right;
    go(p, 0.1, {1, 1}, 0.0005);
    const double most = mu * kMass_kg * 9.80665 / 2;
    const double body = kMass_kg - 2 * 0.0011 / (kRadius_m * kRadius_m);
    DOUBLES_EQUAL(2 * most / body * 0.1, p.twist().v_m_per_s - v, 1e-9);
    DOUBLES_EQUAL((1 - kRadius_m * most) / 0.0011 * 0.1, p.wheel_speed_rad_per_s().right - w, 1e-7);
}

// Its motor turns nothing but the wheel; the other one drives the robot round a point, as on one ski.
TEST(SimPlantSlip, a_wheel_in_the_air_turns_alone_and_the_other_one_moves_the_robot) {
    constexpr double kWheel_kg_m2 = 0.004;
    sim::PlantParameters q = robot(with("wheel_slip", {3, 1e-4})).parameters();
    q.wheel_inertia_kg_m2 = kWheel_kg_m2;
    q.lifted.left = true;
    Plant p(q);
    const double of_wheel_kg = kWheel_kg_m2 / (kRadius_m * kRadius_m);
    const double lever_m = kTrack_m / 2;
    go(p, 0.1, {0.02, 0});
    DOUBLES_EQUAL(0.02 / kWheel_kg_m2 * 0.1, p.wheel_speed_rad_per_s().left, 1e-9);
    DOUBLES_EQUAL(0, p.twist().v_m_per_s, 1e-12);
    DOUBLES_EQUAL(0, p.wheel_speed_rad_per_s().right, 1e-12);
    p.place({}, {});
    go(p, 0.1, {0, 0.05});
    // Body without wheels, and the right one's rotation at its rim: M u' = (1, b/2) f, f + J w' / r = tau /
    // r.
    const double mass = kMass_kg - 2 * of_wheel_kg;
    const double inertia = kInertia_kg_m2 - 2 * of_wheel_kg * lever_m * lever_m;
    const double rim_per_N = 1 / mass + lever_m * lever_m / inertia;
    const double force_N = 0.05 / kRadius_m / (1 + of_wheel_kg * rim_per_N);
    DOUBLES_EQUAL(force_N / mass * 0.1, p.twist().v_m_per_s, 1e-4 * force_N / mass);
    DOUBLES_EQUAL(force_N * lever_m / inertia * 0.1, p.twist().omega_rad_per_s,
                  1e-4 * force_N * lever_m / inertia);
    DOUBLES_EQUAL(0, p.wheel_speed_rad_per_s().left, 1e-9);
}

TEST(SimPlantSlip, a_parked_robot_with_dry_friction_stays_where_it_is) {
    Plant p = robot(with("wheel_slip", {0.5, 0.2}, with("coulomb_friction", {0.3, 0.25})));
    for (int i = 0; i < 1000; ++i) {
        p.advance(0.0005, {0.299 * std::sin(i * 0.01), -0.249 * std::cos(i * 0.013)});
        CHECK(p.at_rest());
    }
    DOUBLES_EQUAL(0, p.pose().x_m, 1e-12);
}

TEST(SimPlantSlip, stiff_tyres_are_no_tyres) {
    const auto effects = with("coulomb_friction", {0.1, 0.08}, with("turning_scrub", {0.1}));
    Plant bare = robot(effects, 0.04);
    Plant stiff = robot(with("wheel_slip", {3, 1e-4}, effects), 0.04);
    for (int i = 0; i < 3000; ++i) {
        const WheelPair<double> torque{0.6 * std::sin(i * 0.004), 0.5 * std::sin(i * 0.005 + 1)};
        bare.advance(0.0005, torque);
        stiff.advance(0.0005, torque);
    }
    std::printf("1.5 s on stiff tyres and on none: %.1e m, %.1e rad apart\n",
                std::hypot(bare.pose().x_m - stiff.pose().x_m, bare.pose().y_m - stiff.pose().y_m),
                std::fabs(bare.pose().heading_rad - stiff.pose().heading_rad));
    DOUBLES_EQUAL(bare.pose().x_m, stiff.pose().x_m, 5e-4);
    DOUBLES_EQUAL(bare.pose().heading_rad, stiff.pose().heading_rad, 2e-3);
}

TEST_GROUP(SimPlantAllEffects){};

TEST(SimPlantAllEffects, together_they_keep_the_robot_finite_and_repeat_bit_by_bit) {
    model::EffectSet<double> all;
    const auto add = [&](const char* name, const model::Parameters<double>& p) { all = with(name, p, all); };
    add("viscous_friction", {0.003, 0.004});
    add("coulomb_friction", {0.02, 0.03});
    add("quadratic_drag", {0.3});
    add("turning_scrub", {0.02});
    add("torque_bias", {0.01, -0.02});
    add("slope", {0.01, 1});
    add("torque_gain_mismatch", {0.05});
    add("stribeck_friction", {0.02, 0.04, 1});
    add("castor_drag", {0.4, 0.004, 0.16, 0.03});
    add("cog_lateral", {0.01});
    add("actuator_lag", {0.004});
    add("transport_delay", {0.003});
    add("dead_zone", {0.02});
    add("backlash", {0.01, 0.0005});
    add("torque_saturation", {1.0});
    add("back_emf_limit", {1.2, 40});
    add("wheel_radius_mismatch", {0.02});
    add("wheel_slip", {0.6, 0.1});
    add("payload_step", {0.5, 1.0, 0.02});
    add("gain_drift", {0.1, 2});
    add("torque_ripple", {0.02, 6, 0.3});
    add("encoder_quantisation", {1024});
    add("gyro_bias", {0.01});
    add("measurement_lag", {0.02});
    for (const bool active : all.active) CHECK(active);
    Plant p = robot(all, 0.03);
    Plant again = robot(all, 0.03);
    for (int i = 0; i < 4000; ++i) {
        const WheelPair<double> torque{0.9 * std::sin(i * 0.006), 0.8 * std::sin(i * 0.005 + 1)};
        p.advance(0.0005, torque);
        again.advance(0.0005, torque);
    }
    CHECK(std::fabs(p.twist().v_m_per_s) < 5 && std::fabs(p.twist().omega_rad_per_s) < 30);
    DOUBLES_EQUAL(again.pose().x_m, p.pose().x_m, 0);
    DOUBLES_EQUAL(again.pose().heading_rad, p.pose().heading_rad, 0);
}
