// The advised motion from `wheelwright excite`'s plan to the second log, and how its answers are counted.
#include "tools/gap_trials/advised.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "tools/gap_trials/further_measures.hpp"
#include "tools/gap_trials/hidden/ode_plant.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;

namespace {

hidden::Trial trial() {
    hidden::TrialPlan plan;
    plan.id = "t";
    plan.kind = hidden::Kind::single;
    plan.effects = {"viscous_friction"};
    plan.sizes = {hidden::Size::medium};
    plan.seed = 5;
    plan.noise = 2;
    plan.motions = {hidden::Motion::spin};
    plan.duration_s = 4;
    plan.rate_Hz = 250;
    return hidden::generate(plan, "ode", hidden::make_ode_plant);
}

excite::Excitation excitation(const char* motion, double size_Nm) {
    excite::Excitation e;
    e.motion = excite::find_motion(motion);
    e.size_Nm = size_Nm;
    e.rounds = 2;
    e.speed_limit_m_per_s = 2.2;
    e.yaw_rate_limit_rad_per_s = 5.4;
    return e;
}

double forward_m_per_s(const hidden::Trial& t, const hidden::Sample& s) {
    return t.robot.wheel_radius_m * (s.clean_rad_per_s.left + s.clean_rad_per_s.right) / 2;
}

// Of one rest before, and a halt behind each round.
constexpr double kRest_s = 0.4;
constexpr double kRound_s = excite::kMotion_s + excite::kHalt_s;

Finding said(const std::string& verdict, const std::vector<std::vector<std::string>>& names_and_rivals) {
    Finding finding;
    finding.verdict = verdict;
    for (const std::vector<std::string>& one : names_and_rivals) {
        Finding::Effect effect;
        effect.name = one.front();
        effect.rivals.assign(one.begin() + 1, one.end());
        finding.effects.push_back(effect);
    }
    return finding;
}

Outcome advised(const std::vector<std::string>& hidden, const std::vector<std::string>& apart,
                const std::vector<Finding>& answers) {
    Outcome outcome;
    for (const std::string& name : hidden) outcome.truth.effects.push_back({name, "strong", {}, {}});
    Further& further = outcome.further["advised"];
    further.answers = answers;
    further.apart = apart;
    further.can_tell = std::any_of(hidden.begin(), hidden.end(), [&](const std::string& name) {
        return std::find(apart.begin(), apart.end(), name) != apart.end();
    });
    return outcome;
}

Measure told(const std::vector<Outcome>& outcomes) {
    const std::vector<Measure> all = further_measures(outcomes);
    return *std::find_if(all.begin(), all.end(), [](const Measure& m) { return m.id == "A9"; });
}

}  // namespace

TEST_GROUP(Advised){};

TEST(Advised, TheSecondLogHoldsTheTorquesThatExciteCommands) {
    const hidden::Trial first = trial();
    const excite::Excitation e = excitation("creep", 0.9);
    const hidden::Trial second = hidden::driven_through(first, programme_of(e), hidden::make_ode_plant);
    DOUBLES_EQUAL(kRest_s + 2 * kRound_s, second.duration_s, 1e-12);
    LONGS_EQUAL(std::lround(second.duration_s * second.rate_Hz) + 1, second.samples.size());
    double fastest_m_per_s = 0;
    for (const hidden::Sample& s : second.samples) {
        const double t_s = s.t_s - kRest_s;
        if (t_s < -1e-9) {
            DOUBLES_EQUAL(0, s.torque_Nm.left, 0);
            continue;
        }
        const int round = t_s < kRound_s - 1e-9 ? 0 : 1;
        const double in_round_s = t_s - round * kRound_s;
        fastest_m_per_s = std::max(fastest_m_per_s, std::abs(forward_m_per_s(second, s)));
        if (in_round_s > excite::kMotion_s - 1e-9) continue;
        // of a set-point 10 ms old at most
        const double setpoint_s = std::floor(in_round_s * 100 + 1e-4) / 100;
        const WheelPair<double> wanted = e.torque_at(round, setpoint_s);
        DOUBLES_EQUAL(wanted.left, s.torque_Nm.left, 1e-12);
        DOUBLES_EQUAL(wanted.right, s.torque_Nm.right, 1e-12);
    }
    CHECK(fastest_m_per_s > 0.1);
    // at rest behind each halt
    for (const double t_s : {kRest_s + kRound_s, kRest_s + 2 * kRound_s}) {
        const auto at = static_cast<std::size_t>(std::lround(t_s * second.rate_Hz));
        CHECK(std::abs(forward_m_per_s(second, second.samples[at])) < 0.02 * fastest_m_per_s);
    }
}

TEST(Advised, TheRobotIsTheSameAndTheNoiseIsNot) {
    const hidden::Trial first = trial();
    const hidden::Trial second =
        hidden::driven_through(first, programme_of(excitation("coast", 0.3)), hidden::make_ode_plant);
    const hidden::Trial again =
        hidden::driven_through(first, programme_of(excitation("coast", 0.3)), hidden::make_ode_plant);
    CHECK(hidden::csv_text(second) == hidden::csv_text(again));
    CHECK(first.hidden.effects[0].parameters == second.hidden.effects[0].parameters);
    // both stand still at first: what is logged is noise
    std::size_t alike = 0;
    for (std::size_t k = 0; k < 50; ++k) {
        const auto noise = [k](const hidden::Trial& t) {
            return t.samples[k].speed_rad_per_s.left - t.samples[k].clean_rad_per_s.left;
        };
        if (noise(first) == noise(second)) ++alike;
    }
    CHECK(alike < 25);
}

TEST(Advised, ARoundInWhichTheRobotGetsTooFastEnds) {
    const hidden::Trial first = trial();
    excite::Excitation e = excitation("coast", 0.6);
    e.speed_limit_m_per_s = 0.2;
    const hidden::Trial second = hidden::driven_through(first, programme_of(e), hidden::make_ode_plant);
    double fastest_m_per_s = 0, slowest_m_per_s = 0;
    for (const hidden::Sample& s : second.samples) {
        fastest_m_per_s = std::max(fastest_m_per_s, forward_m_per_s(second, s));
        slowest_m_per_s = std::min(slowest_m_per_s, forward_m_per_s(second, s));
    }
    // a sample further than the limit, and the next round, backwards, is driven
    DOUBLES_EQUAL(0.2, fastest_m_per_s, 0.02);
    DOUBLES_EQUAL(-0.2, slowest_m_per_s, 0.02);
    const auto later = static_cast<std::size_t>(4 * second.rate_Hz);
    CHECK(std::abs(forward_m_per_s(second, second.samples[later])) < 0.01);
}

TEST(Advised, TorquesAreWithinTheDrivesLimit) {
    const hidden::Trial first = trial();
    const hidden::Trial second =
        hidden::driven_through(first, programme_of(excitation("coast", 50)), hidden::make_ode_plant);
    double largest_Nm = 0;
    for (const hidden::Sample& s : second.samples)
        largest_Nm = std::max({largest_Nm, std::abs(s.torque_Nm.left), std::abs(s.torque_Nm.right)});
    DOUBLES_EQUAL(first.robot.torque_limit_Nm, largest_Nm, 1e-12);
}

TEST(Advised, ResolvedIsTheHiddenSetWithoutTheRival) {
    const Finding tied = said("cannot_tell", {{"coulomb_friction", "turning_scrub", "dead_zone"}});
    const std::vector<std::string> pair{"coulomb_friction", "turning_scrub"};
    const auto hits = [&](const std::vector<std::string>& hidden, const Finding& after) {
        return told({advised(hidden, pair, {tied, after})}).hits;
    };
    LONGS_EQUAL(1, hits({"turning_scrub"}, said("named", {{"turning_scrub"}})));
    // another rival may be left
    LONGS_EQUAL(1, hits({"turning_scrub"}, said("named", {{"turning_scrub", "castor_drag"}})));
    LONGS_EQUAL(0, hits({"turning_scrub"}, said("named", {{"turning_scrub", "coulomb_friction"}})));
    LONGS_EQUAL(0, hits({"turning_scrub"}, said("named", {{"coulomb_friction"}})));
    LONGS_EQUAL(0, hits({"turning_scrub"}, said("cannot_tell", {{"turning_scrub"}})));
    LONGS_EQUAL(0, hits({"turning_scrub"}, said("named", {{"turning_scrub"}, {"slope"}})));
    LONGS_EQUAL(0, hits({"turning_scrub", "slope"}, said("named", {{"turning_scrub"}})));
    LONGS_EQUAL(1, hits({"turning_scrub", "slope"}, said("named", {{"turning_scrub"}, {"slope"}})));
}

TEST(Advised, OnlyTrialsThatHideOneOfThoseCount) {
    const Finding tied = said("cannot_tell", {{"coulomb_friction", "turning_scrub"}});
    const std::vector<std::string> pair{"coulomb_friction", "turning_scrub"};
    const Measure m = told({advised({"turning_scrub"}, pair, {tied, said("named", {{"turning_scrub"}})}),
                            advised({"slope"}, pair, {tied, said("named", {{"slope"}})}),
                            // could not be driven
                            advised({"turning_scrub"}, pair, {tied}), Outcome{}});
    LONGS_EQUAL(2, m.n);
    LONGS_EQUAL(1, m.hits);
    STRCMP_EQUAL("1 more hide none of these", m.remark.c_str());
    CHECK_FALSE(told({Outcome{}}).value.has_value());
    // and is the same when it has been stored
    Outcome stored = advised({"turning_scrub"}, pair, {tied, said("named", {{"turning_scrub"}})});
    stored.asked_further = true;
    stored.truth.id = "log-1";
    stored.further["advised"].driven = "creep, 0.4 of 0.5 Nm";
    const Outcome read = outcome_from_json(outcome_json(stored));
    LONGS_EQUAL(1, told({read}).hits);
    STRCMP_EQUAL("creep, 0.4 of 0.5 Nm", read.further.at("advised").driven.c_str());
}
