// The motion that is advised to tell two effects apart.
#include <algorithm>
#include <cmath>
#include <string_view>
#include <tuple>

#include "sim_hal/plant.hpp"
#include "tools/gap/inference/separating_motion.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

constexpr double kNoise_rad_per_s = 0.01;

// A robot that has `named`, which is confused with `rival`.
gap::Confusion confusion(std::string_view named, const model::Parameters<double>& parameters,
                         std::string_view rival) {
    gap::Confusion c;
    c.effect = model::find_effect(named);
    c.rival = model::find_effect(rival);
    c.setting.geometry = {{0.079, 0.079}, 0.37};
    c.setting.dynamics = {0.04, 0, 1.05, 5.1};
    c.setting.dynamics.k6_per_m = model::coupled_k6(0.04, 1.05, 5.1, 0.37);
    c.effects.active[c.effect] = true;
    c.effects.parameter[c.effect] = parameters;
    const gap::Dictionary dictionary(c.setting, {}, true);
    gap::Candidate candidate;
    candidate.effect = c.effect;
    if (!dictionary.candidates(c.effect).empty()) {
        candidate = dictionary.candidates(c.effect).back();
        c.points[c.effect] = parameters;
    }
    for (auto [column, end] = dictionary.linear_columns(c.effect); column < end; ++column)
        candidate.amounts.push_back({{column}});
    c.members = {candidate};
    c.torque_rms_Nm = 0.6;
    c.speed_rms_rad_per_s = 6;
    c.noise_rad_per_s = {kNoise_rad_per_s, kNoise_rad_per_s};
    return c;
}

// How far the robot that was named turns in all.
double turned_rad(const gap::Confusion& c, const gap::Separation& found) {
    sim::Plant plant(sim::plant_from_dynamics(c.setting.geometry, c.setting.dynamics, c.effects));
    double least = 0;
    double most = 0;
    for (double t = 0; t < excite::kMotion_s; t += 0.002) {
        plant.advance(0.002, found.motion->torque_Nm(t, found.size_Nm));
        least = std::min(least, plant.pose().heading_rad);
        most = std::max(most, plant.pose().heading_rad);
    }
    return most - least;
}

bool turns_on_the_spot(const excite::Motion& motion) {
    for (double t = 0; t < excite::kMotion_s; t += 0.1) {
        if (motion.torque_Nm(t, 1).left != -motion.torque_Nm(t, 1).right) return false;
    }
    return true;
}

}  // namespace

TEST_GROUP(GapMotions){};

// Both push with the same force as long as the heading stays.
TEST(GapMotions, a_slope_and_a_bias_are_separated_by_turning) {
    for (const auto& [named, rival, parameters] :
         {std::tuple{"slope", "torque_bias", model::Parameters<double>{0.02, 0.4}},
          std::tuple{"torque_bias", "slope", model::Parameters<double>{0.05, 0.05}}}) {
        const gap::Separation found = gap::separating_motion(confusion(named, parameters, rival));
        CHECK(found.motion != nullptr);
        CHECK(turned_rad(confusion(named, parameters, rival), found) > 0.1);
    }
}

// On the spot the wheels' friction and the tyres' oppose the same turning, unless the centre of gravity pulls
// the robot from it.
TEST(GapMotions, friction_of_the_wheels_and_scrub_are_separated_by_driving_on) {
    for (const auto& [named, rival, parameters] :
         {std::tuple{"coulomb_friction", "turning_scrub", model::Parameters<double>{0.06, 0.06}},
          std::tuple{"turning_scrub", "coulomb_friction", model::Parameters<double>{0.3}}}) {
        gap::Confusion c = confusion(named, parameters, rival);
        c.setting.dynamics.k5_m = c.setting.dynamics.k6_per_m = 0;
        const gap::Separation found = gap::separating_motion(c);
        CHECK(found.motion != nullptr);
        CHECK_FALSE(turns_on_the_spot(*found.motion));
    }
}

TEST(GapMotions, none_is_advised_where_noise_hides_the_difference) {
    gap::Confusion c = confusion("viscous_friction", {0.004, 0.004}, "quadratic_drag");
    CHECK(gap::separating_motion(c).motion != nullptr);
    c.noise_rad_per_s = {30, 30};
    CHECK(gap::separating_motion(c).motion == nullptr);
}

TEST(GapMotions, the_robot_stays_within_the_speeds_it_had) {
    for (const auto& [named, rival, parameters] :
         {std::tuple{"viscous_friction", "quadratic_drag", model::Parameters<double>{0.004, 0.004}},
          std::tuple{"coulomb_friction", "castor_drag", model::Parameters<double>{0.05, 0.05}}}) {
        const gap::Confusion c = confusion(named, parameters, rival);
        const gap::Separation found = gap::separating_motion(c);
        CHECK(found.motion != nullptr);
        sim::Plant plant(sim::plant_from_dynamics(c.setting.geometry, c.setting.dynamics, c.effects));
        double fastest = 0;
        for (double t = 0; t < excite::kMotion_s; t += 0.002) {
            plant.advance(0.002, found.motion->torque_Nm(t, found.size_Nm));
            const WheelPair<double>& w = plant.wheel_speed_rad_per_s();
            fastest = std::max({fastest, std::abs(w.left), std::abs(w.right)});
        }
        CHECK(fastest < 1.02 * 2 * c.speed_rms_rad_per_s);
        CHECK(fastest > 0.1 * c.speed_rms_rad_per_s);
    }
}
