// Our own simulated robot as a plant of the trials: the same robot as the engine's, and every effect at its
// size.
#include "tools/gap_trials/own_plant.hpp"

#include <algorithm>
#include <cmath>

#include "tools/gap_trials/hidden/ode_plant.hpp"
#include "tools/gap_trials/hidden/trial.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright::hidden;
using wheelwright::tools::make_own_plant;

namespace {

// Largest difference of wheel speeds between both plants, over the largest speed.
double difference(const Robot& robot, const HiddenSet& hidden) {
    const auto own = make_own_plant(robot, hidden);
    const auto engine = make_ode_plant(robot, hidden);
    double apart = 0;
    double largest = 0;
    for (int i = 0; i < 12000; ++i) {
        const double t_s = 5e-4 * i;
        const Pair torque{0.5 * std::sin(2.1 * t_s) + 0.3 * std::sin(9 * t_s), 0.6 * std::sin(1.7 * t_s)};
        own->advance(5e-4, torque);
        engine->advance(5e-4, torque);
        const Pair a = own->state().wheel_speed_rad_per_s;
        const Pair b = engine->state().wheel_speed_rad_per_s;
        apart = std::max({apart, std::abs(a.left - b.left), std::abs(a.right - b.right)});
        largest = std::max({largest, std::abs(a.left), std::abs(b.right)});
    }
    CHECK(largest > 2);
    return apart / largest;
}

}  // namespace

TEST_GROUP(OwnPlant){};

TEST(OwnPlant, MovesAsTheEnginesRobotDoes) {
    Random random(31);
    const Robot robot = draw_robot(random);
    DOUBLES_EQUAL(0, difference(robot, {}), 0.005);
    for (const HiddenEffect& effect :
         {HiddenEffect{"viscous_friction", {{"left_Nm_s_per_rad", 0.03}, {"right_Nm_s_per_rad", 0.02}}},
          HiddenEffect{"coulomb_friction", {{"left_Nm", 0.08}, {"right_Nm", 0.05}}},
          HiddenEffect{"slope", {{"angle_rad", 0.03}, {"uphill_rad", 0.7}}},
          HiddenEffect{"cog_lateral", {{"offset_m", 0.03}}},
          HiddenEffect{"quadratic_drag", {{"drag_N_s2_per_m2", 4}}},
          HiddenEffect{"wheel_radius_mismatch", {{"relative", 0.05}}},
          HiddenEffect{"payload_step", {{"time_s", 2}, {"mass_kg", 3}, {"inertia_kg_m2", 0.1}}}}) {
        const HiddenSet hidden{{effect}};
        const double apart = difference(robot, hidden);
        // The catalogue's slope, lateral centre of gravity and radii take the wheels' rotation for mass
        // (slope.hpp); nothing brakes here, so differences add up.
        CHECK_TEXT(apart < 0.08, (effect.name + " " + std::to_string(apart)).c_str());
    }
}

TEST(OwnPlant, EveryEffectReachesItsSize) {
    std::uint64_t seed = 60;
    for (const EffectInfo& info : all_effects()) {
        const auto size = static_cast<Size>(seed % 3);
        TrialPlan plan;
        plan.id = "t1";
        plan.kind = Kind::single;
        plan.effects = {std::string(info.name)};
        plan.sizes = {size};
        plan.seed = ++seed;
        plan.noise = 1;
        plan.duration_s = 4;
        plan.rate_Hz = 250;
        plan.motions = {Motion::reversals, Motion::prbs};
        const Trial trial = generate(plan, "own", make_own_plant);
        const auto& range = info.sizes[static_cast<std::size_t>(size)];
        CHECK_TEXT(trial.reached.at(0) >= range[0] && trial.reached[0] <= range[1], info.name.data());
    }
}
