// The pace of a path: judged by a dense walk along the path that it gives, on robots drawn at random.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>

#include "firmware/control/path_pace.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::control;

namespace {

// The largest use of each limit along a path, walked far more densely than the pace is looked for.
struct Uses {
    double speed = 0, yaw_rate = 0, acceleration = 0, yaw_acceleration = 0;
    double torque = 0;  // beyond friction, of what friction leaves
    double largest() const {
        return std::max({speed / kPaceShareOfSpeed, yaw_rate / kPaceShareOfSpeed,
                         acceleration / kPaceShareOfTorque, yaw_acceleration / kPaceShareOfTorque,
                         torque / kPaceShareOfTorque});
    }
};

Uses uses_of(const PathSettings<double>& path, const PlantModel<double>& plant,
             const PaceLimits<double>& limits) {
    Uses uses;
    constexpr int kPoints = 100'000;
    const TrackingSettings<double>& t = limits.tracking;
    for (int i = 0; i <= kPoints; ++i) {
        const auto point = path_point(path, (path.period_s + path.ramp_s) * i / kPoints);
        const auto note = [](double& use, double size, double limit) {
            use = std::max(use, std::abs(size) / limit);
        };
        note(uses.speed, point.twist.v_m_per_s, t.speed_m_per_s);
        note(uses.yaw_rate, point.twist.omega_rad_per_s, t.yaw_rate_rad_per_s);
        note(uses.acceleration, point.rate.v_m_per_s2, t.acceleration_m_per_s2);
        note(uses.yaw_acceleration, point.rate.omega_rad_per_s2, t.yaw_acceleration_rad_per_s2);
        model::Motion<double> motion;
        motion.twist = point.twist;
        motion.wheel_speed_rad_per_s = model::wheel_speeds_from_twist(plant.geometry, point.twist);
        const auto all = linearising_torque_Nm(plant, motion, point.twist, point.rate);
        // What is left of it without acceleration, and without what the body's turning asks for, eq (42),
        // (43).
        auto steady = linearising_torque_Nm(plant, motion, point.twist, TwistRate<double>{});
        const model::Dynamics<double>& k = plant.dynamics;
        const double w = point.twist.omega_rad_per_s;
        const double sum = k.k5_m * w * w / k.k7_per_kg_m;
        const double difference = k.k6_per_m * point.twist.v_m_per_s * w / k.k8_per_kg_m2;
        steady.left += (sum - difference) / 2;
        steady.right += (sum + difference) / 2;
        note(uses.torque, all.left - steady.left, limits.torque_Nm - std::abs(steady.left));
        note(uses.torque, all.right - steady.right, limits.torque_Nm - std::abs(steady.right));
    }
    return uses;
}

PathPace<double> pace_of(const PathSettings<double>& asked, const PlantModel<double>& plant,
                         const PaceLimits<double>& limits, int* calls = nullptr) {
    PathPace<double> pace;
    pace.begin(asked);
    int n = 0;
    for (; pace.running() && n < 100'000; ++n) pace.step(plant, limits);
    if (calls != nullptr) *calls = n;
    return pace;
}

struct Drawn {
    PlantModel<double> plant;
    PaceLimits<double> limits;
    PathSettings<double> path;
};

Drawn draw(std::mt19937_64& random, PathKind kind) {
    const auto log = [&](double low, double high) {
        return low * std::pow(high / low, std::uniform_real_distribution<double>(0, 1)(random));
    };
    model::RobotParameters p = model::default_parameters();
    const double mass_kg = log(1, 200);
    p.geometry.wheel_radius_m.left = p.geometry.wheel_radius_m.right = log(0.03, 0.2);
    p.geometry.track_m = 0.15 * std::cbrt(mass_kg) * log(0.8, 1.25);
    const model::Geometry<double> geometry{{p.geometry.wheel_radius_m.left, p.geometry.wheel_radius_m.right},
                                           p.geometry.track_m};
    const model::MassProperties<double> mass{mass_kg, 0.2 * mass_kg * p.geometry.track_m * p.geometry.track_m,
                                             log(0.01, 0.4) * p.geometry.track_m, 0};
    const auto k = model::dynamics_from_mass(mass, geometry);
    p.dynamics = {k.k5_m, k.k6_per_m, k.k7_per_kg_m, k.k8_per_kg_m2};
    p.limits.torque_Nm = log(0.5, 8) * mass_kg * geometry.mean_radius_m() / 2;
    p.limits.speed_m_per_s = log(0.3, 3);
    p.limits.yaw_rate_rad_per_s = log(1, 8);
    p.effects.active[model::find_effect("coulomb_friction")] = true;
    p.effects.parameter[model::find_effect("coulomb_friction")] = {0.1 * p.limits.torque_Nm,
                                                                   0.12 * p.limits.torque_Nm};
    p.effects.active[model::find_effect("viscous_friction")] = true;
    const double viscous = 0.1 * p.limits.torque_Nm * geometry.mean_radius_m() / p.limits.speed_m_per_s;
    p.effects.parameter[model::find_effect("viscous_friction")] = {viscous, viscous};
    Drawn drawn;
    drawn.plant = plant_model<double>(p);
    drawn.limits = pace_limits<double>(p);
    drawn.path.kind = kind;
    drawn.path.length_m = log(0.3, 30);
    drawn.path.width_m = drawn.path.length_m * log(0.05, 3);
    drawn.path.period_s = log(0.5, 100);
    if (kind != PathKind::figure_eight) drawn.path.ramp_s = drawn.path.period_s / 4;
    return drawn;
}

}  // namespace

TEST_GROUP(PathPace){};

TEST(PathPace, a_path_is_stretched_until_all_limits_hold_and_no_further) {
    std::mt19937_64 random(4711);
    int stretched = 0;
    int most_calls = 0;
    double least = 1, most = 0;
    for (const PathKind kind : {PathKind::figure_eight, PathKind::line, PathKind::circle, PathKind::spin}) {
        for (int i = 0; i < 25; ++i) {
            const Drawn drawn = draw(random, kind);
            int calls = 0;
            const PathPace<double> pace = pace_of(drawn.path, drawn.plant, drawn.limits, &calls);
            CHECK(!pace.running());
            most_calls = std::max(most_calls, calls);
            const double use = uses_of(pace.path(), drawn.plant, drawn.limits).largest();
            CHECK_EQUAL(pace.limited_by() != PaceLimit::none, pace.path().period_s > drawn.path.period_s);
            if (pace.limited_by() == PaceLimit::none) {
                DOUBLES_EQUAL(drawn.path.period_s, pace.path().period_s, 0);
                CHECK(use < 1.01);
            } else {
                ++stretched;
                least = std::min(least, use);
                most = std::max(most, use);
            }
            DOUBLES_EQUAL(drawn.path.length_m, pace.path().length_m, 0);
            DOUBLES_EQUAL(drawn.path.width_m, pace.path().width_m, 0);
        }
    }
    std::printf("%d of 100 paths stretched, to %.3f..%.3f of the share; at most %d calls\n", stretched, least,
                most, most_calls);
    CHECK(stretched > 30 && stretched < 90);
    CHECK(least > 0.95);  // a stretch that is 1 % too long leaves 2 % of the acceleration
    CHECK(most < 1.02);   // between two points of the walk
    CHECK(most_calls < 600);
}

TEST(PathPace, what_limits_is_named) {
    std::mt19937_64 random(12);
    Drawn drawn = draw(random, PathKind::figure_eight);
    drawn.path = {PathKind::figure_eight, 3, 1.5, 100, 0, {}};
    drawn.limits.tracking = {3, 9, 5, 1, 0.05, 0.1, 1, 1, 10, 10};
    drawn.limits.torque_Nm = 1e6;
    drawn.limits.acceleration_by = PaceLimit::acceleration;
    drawn.limits.yaw_acceleration_by = PaceLimit::yaw_acceleration;
    const auto by = [&](auto change) {
        Drawn one = drawn;
        change(one);
        return pace_of(one.path, one.plant, one.limits).limited_by();
    };
    CHECK(by([](Drawn&) {}) == PaceLimit::none);
    CHECK(by([](Drawn& d) { d.limits.tracking.speed_m_per_s = 0.01; }) == PaceLimit::speed);
    CHECK(by([](Drawn& d) { d.limits.tracking.yaw_rate_rad_per_s = 0.01; }) == PaceLimit::yaw_rate);
    CHECK(by([](Drawn& d) { d.limits.tracking.acceleration_m_per_s2 = 1e-4; }) == PaceLimit::acceleration);
    CHECK(by([](Drawn& d) { d.limits.tracking.yaw_acceleration_rad_per_s2 = 1e-4; }) ==
          PaceLimit::yaw_acceleration);
    CHECK(by([](Drawn& d) {
              d.path.period_s = 0.5;
              d.limits.tracking = {3, 9, 5, 1, 0.05, 0.1, 100, 100, 1000, 1000};
              d.limits.torque_Nm = 2 * d.plant.effects.parameter[model::find_effect("coulomb_friction")][1];
          }) == PaceLimit::torque);
}

TEST(PathPace, a_torque_that_friction_takes_whole_ends_the_search) {
    std::mt19937_64 random(13);
    Drawn drawn = draw(random, PathKind::circle);
    drawn.limits.torque_Nm = 0.5 * drawn.plant.effects.parameter[model::find_effect("coulomb_friction")][0];
    int calls = 0;
    const PathPace<double> pace = pace_of(drawn.path, drawn.plant, drawn.limits, &calls);
    CHECK(pace.limited_by() == PaceLimit::torque);
    CHECK(calls < 600);
}
