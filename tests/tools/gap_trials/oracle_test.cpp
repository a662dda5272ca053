// The oracle: its formulas explain the engine's robots, and what cannot be told is not called identifiable.
#include "tools/gap_trials/hidden/oracle.hpp"

#include <cstdio>
#include <set>
#include <string>
#include <vector>

#include "tools/gap_trials/hidden/ode_plant.hpp"
#include "tools/gap_trials/hidden/plan.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright::hidden;

namespace {

OracleVerdict asked(const char* effect, std::vector<Motion> motions, std::size_t noise = 1,
                    double duration_s = 6) {
    TrialPlan p;
    p.id = "t";
    p.effects = {effect};
    p.sizes = {Size::strong};
    p.noise = noise;
    p.seed = 3;  // a robot with a gyro
    p.motions = std::move(motions);
    p.duration_s = duration_s;
    p.rate_Hz = 200;
    return ask_oracle(generate(p, "ode", make_ode_plant));
}

}  // namespace

TEST_GROUP(HiddenOracle){};

TEST(HiddenOracle, TheTrueEffectExplainsTheEnginesLog) {
    // These have exact formulas: what is left is far below one variance of noise a window.
    for (const char* effect : {"viscous_friction", "coulomb_friction", "quadratic_drag", "slope",
                               "torque_bias", "torque_gain_mismatch", "cog_lateral", "actuator_lag",
                               "transport_delay", "dead_zone", "torque_saturation", "gain_drift"}) {
        const OracleVerdict v = asked(effect, {Motion::reversals, Motion::prbs});
        CHECK_TEXT(v.unexplained_none > 1000, effect);
        CHECK_TEXT(v.unexplained_true < 2e-5 * v.unexplained_none + 1, effect);
        CHECK_TEXT(v.identifiable, effect);
        CHECK_TEXT(v.nearest_rival != effect, effect);
    }
}

TEST(HiddenOracle, OnTheSpotDryFrictionOfWheelsAndOfTheGroundAreOne) {
    const OracleVerdict v = asked("turning_scrub", {Motion::spin}, 2);
    std::printf("  scrub %g, nothing %g, %s %g\n", v.unexplained_true, v.unexplained_none,
                v.nearest_rival.c_str(), v.unexplained_rival);
    CHECK_FALSE(v.identifiable);
    STRCMP_EQUAL("coulomb_friction", v.nearest_rival.c_str());
}

TEST(HiddenOracle, NothingHiddenIsNothingToTell) {
    TrialPlan p;
    p.id = "t";
    p.seed = 4;
    p.duration_s = 3;
    p.rate_Hz = 100;
    const OracleVerdict v = ask_oracle(generate(p, "ode", make_ode_plant));
    CHECK(v.identifiable);
    CHECK(v.nearest_rival.empty());
}

TEST(HiddenOracle, TheListHasEveryCellOnceAndNamesThatTellNothing) {
    const std::vector<ListedTrial> all = all_trials(11, {"ode"});
    std::set<std::string> names;
    std::set<std::uint64_t> streams;
    std::size_t coulomb = 0;
    std::size_t nothing = 0;
    for (const ListedTrial& t : all) {
        names.insert(t.plan.id);
        streams.insert(t.plan.stream);
        coulomb += t.plan.kind == Kind::single && t.plan.effects.front() == "coulomb_friction";
        nothing += t.plan.kind == Kind::nothing;
        LONGS_EQUAL(14, t.plan.id.size());
    }
    LONGS_EQUAL(all.size(), names.size());
    LONGS_EQUAL(all.size(), streams.size());
    LONGS_EQUAL(45, coulomb);
    LONGS_EQUAL(300, nothing);
    LONGS_EQUAL(16, tried_pairs().size());
    const std::vector<ListedTrial> sample = sample_of(all, 50, 11);
    LONGS_EQUAL(50, sample.size());
    std::set<std::string> kinds;
    for (const ListedTrial& t : sample) kinds.insert(std::string(name_of(t.plan.kind)));
    LONGS_EQUAL(5, kinds.size());
    // nearly all: none twice
    std::set<std::string> drawn;
    for (const ListedTrial& t : sample_of(all, all.size() - 3, 11)) drawn.insert(t.plan.id);
    LONGS_EQUAL(all.size() - 3, drawn.size());
    CHECK_EQUAL(0, drawn.count(""));
    CHECK(all_trials(12, {"ode"}).front().plan.id != all.front().plan.id);
}
