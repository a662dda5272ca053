// Trials as a whole: sizes as drawn, the same bytes every time, nothing about the label in the log.
#include "tools/gap_trials/hidden/trial.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <thread>

#include "tools/gap_trials/hidden/ode_plant.hpp"
#include "tools/gap_trials/hidden/plan.hpp"
#include "tools/logs/measured_csv.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright::hidden;

namespace {

TrialPlan plan(std::uint64_t seed, std::vector<std::string> effects, std::vector<Size> sizes) {
    TrialPlan p;
    p.id = "t1";
    p.kind = effects.empty() ? Kind::nothing : Kind::single;
    p.effects = std::move(effects);
    p.sizes = std::move(sizes);
    p.seed = seed;
    p.noise = 1;
    p.duration_s = 4;
    p.rate_Hz = 250;
    return p;
}

Trial generated(const TrialPlan& p) { return generate(p, "ode", make_ode_plant); }

}  // namespace

TEST_GROUP(HiddenTrial){};

TEST(HiddenTrial, TheSameDriveAtAnotherRate) {
    TrialPlan p = plan(31, {"slope"}, {Size::medium});
    p.motions = {Motion::reversals};
    const Trial trial = generated(p);
    const Trial again = driven_again(trial, 1000, make_ode_plant);
    LONGS_EQUAL(4 * trial.samples.size() - 3, again.samples.size());
    DOUBLES_EQUAL(trial.hidden.effects[0]["angle_rad"], again.hidden.effects[0]["angle_rad"], 0);
    // the small loop of the driver differs, and so does the noise that it sees
    double off = 0;
    double moved = 0;
    for (std::size_t k = 0; k < trial.samples.size(); ++k) {
        const Sample& slow = trial.samples[k];
        const Sample& quick = again.samples[4 * k];
        DOUBLES_EQUAL(slow.t_s, quick.t_s, 1e-9);
        off += std::pow(slow.clean_rad_per_s.left - quick.clean_rad_per_s.left, 2);
        moved += std::pow(slow.clean_rad_per_s.left, 2);
    }
    CHECK(off < 0.01 * moved);
    CHECK(off > 0);
    // at its own rate it is the same log
    STRCMP_EQUAL(csv_text(trial).c_str(), csv_text(driven_again(trial, 250, make_ode_plant)).c_str());
}

TEST(HiddenTrial, EveryEffectReachesItsSize) {
    std::uint64_t seed = 20;
    for (const EffectInfo& info : all_effects()) {
        const auto size = static_cast<Size>(seed % 3);
        TrialPlan p = plan(++seed, {std::string(info.name)}, {size});
        // Moves in every way, so that each effect has something to act on.
        p.motions = {Motion::reversals, Motion::prbs};
        const Trial trial = generated(p);
        const auto& range = info.sizes[static_cast<std::size_t>(size)];
        CHECK_TEXT(trial.reached.at(0) >= range[0] && trial.reached[0] <= range[1],
                   trial.hidden.effects[0].name.c_str());
        LONGS_EQUAL(info.parameters().size(), trial.hidden.effects[0].parameters.size());
        for (const ParameterInfo& parameter : info.parameters()) {
            CHECK_TEXT(trial.hidden.effects[0].parameters.contains(parameter.name), parameter.name.data());
        }
        if (info.needs_gyro) CHECK(trial.gyro);
        LONGS_EQUAL(0, trial.complaints);
        if (info.name == "wheel_slip" || info.name == "wheel_radius_mismatch") continue;
        double off_m_per_s = 0;
        for (const Sample& s : trial.samples) {
            const Pair& w = s.truth.wheel_speed_rad_per_s;
            off_m_per_s = std::max(off_m_per_s, std::abs(s.truth.speed_m_per_s - trial.robot.wheel_radius_m *
                                                                                     (w.left + w.right) / 2));
        }
        CHECK_TEXT(off_m_per_s < 0.005, info.name.data());  // all wheels on the ground
    }
}

TEST(HiddenTrial, TheSamePlanGivesTheSameBytesInAnyThread) {
    const TrialPlan p = plan(5, {"coulomb_friction", "transport_delay"}, {Size::medium, Size::strong});
    const std::string log = csv_text(generated(p));
    const std::string label = label_text(generated(p), {});
    std::string other_log;
    std::thread other([&] { other_log = csv_text(generated(p)); });
    const Trial busy = generated(plan(6, {}, {}));
    other.join();
    CHECK(log == other_log);
    CHECK(log != csv_text(busy));
    STRCMP_EQUAL(label.c_str(), label_text(generated(p), {}).c_str());
}

TEST(HiddenTrial, TheLogIsOneThatTheReaderTakes) {
    for (const std::uint64_t seed : {1, 2, 3, 4}) {
        const Trial trial = generated(plan(seed, {}, {}));
        std::istringstream text(csv_text(trial));
        const auto read = wheelwright::tools::read_measured_csv(text);
        LONGS_EQUAL(0, read.problem_count);
        LONGS_EQUAL(trial.samples.size(), read.segments.front().samples.size());
        LONGS_EQUAL(1001, read.segments.front().samples.size());
        LONGS_EQUAL(trial.gyro, read.segments.front().has_gyro);
        DOUBLES_EQUAL(0.004, read.segments.front().period_s, 1e-9);
        const std::string log = csv_text(trial);
        CHECK(log.find("reversals") == std::string::npos);
    }
}

TEST(HiddenTrial, RobotsAndTimesDiffer) {
    std::set<double> radii;
    for (std::uint64_t seed = 0; seed < 200; ++seed) {
        Random random(seed);
        const Robot robot = draw_robot(random);
        radii.insert(robot.wheel_radius_m);
        CHECK(robot.wheel_radius_m > 0.076 && robot.wheel_radius_m < 0.09);
        CHECK(robot.track_m > 0.34 && robot.track_m < 0.401);
        // neither wheels nor castor leave the ground while it speeds up or brakes
        const double most_m_per_s2 =
            2 * robot.torque_limit_Nm / robot.wheel_radius_m / robot.effective_mass_kg();
        CHECK(robot.mass_kg * (9.81 * robot.cog_ahead_m - most_m_per_s2 * robot.cog_height_m) >
              2 * robot.wheel_inertia_kg_m2 * most_m_per_s2 / robot.wheel_radius_m);
    }
    LONGS_EQUAL(200, radii.size());
}

TEST(HiddenTrial, NoiseIsWhatTheLabelSays) {
    TrialPlan p = plan(9, {}, {});
    p.duration_s = 8;
    p.noise = 2;
    const Trial trial = generated(p);
    double squares = 0;
    for (const Sample& s : trial.samples) {
        const double left = s.speed_rad_per_s.left - s.clean_rad_per_s.left;
        squares += left * left;
    }
    const double rms = std::sqrt(squares / static_cast<double>(trial.samples.size()));
    DOUBLES_EQUAL(0.05, rms, 0.004);
    const auto label = nlohmann::json::parse(label_text(trial, {}));
    STRCMP_EQUAL("high", label["noise"].get<std::string>().c_str());
    DOUBLES_EQUAL(trial.robot.track_m, label["analyst"]["track_m"].get<double>(), 1e-12);
    LONGS_EQUAL(0, label["effects"].size());
}

TEST(HiddenTrial, FaultsDamageOnlyTheFile) {
    TrialPlan p = plan(12, {"log_dropouts"}, {Size::strong});
    p.kind = Kind::fault;
    p.duration_s = 20;
    const Trial trial = generated(p);
    std::size_t held = 0;
    for (std::size_t k = 1; k < trial.samples.size(); ++k) {
        held += trial.samples[k].speed_rad_per_s.left == trial.samples[k - 1].speed_rad_per_s.left &&
                trial.samples[k].speed_rad_per_s.right == trial.samples[k - 1].speed_rad_per_s.right &&
                trial.samples[k].t_s > 1;
    }
    CHECK(held > 10);
    CHECK(static_cast<double>(held) < 0.05 * static_cast<double>(trial.samples.size()));
    // the same robot, undamaged
    TrialPlan whole = p;
    whole.effects.clear();
    whole.sizes.clear();
    const Trial undamaged = generated(whole);
    DOUBLES_EQUAL(undamaged.samples.back().truth.x_m, trial.samples.back().truth.x_m, 0);
}

TEST(HiddenTrial, TheSmallSampleMissesNoEffect) {
    std::set<std::string> ids;
    for (const std::uint64_t seed : {1, 2, 3}) {
        std::map<std::string, int> single;
        std::set<std::vector<std::string>> pairs;
        for (const ListedTrial& trial : every_effect_of(all_trials(seed, {"ode"}), seed)) {
            const TrialPlan& p = trial.plan;
            if (p.kind == Kind::single) {
                ++single[p.effects.at(0)];
                CHECK(p.noise == 1 && p.sizes.at(0) != Size::mild);
            }
            if (p.kind == Kind::pair) pairs.insert(p.effects);
            ids.insert(p.id);
        }
        for (const EffectInfo& info : all_effects()) {
            LONGS_EQUAL_TEXT(info.fault_of_log ? 0 : 1, single[std::string(info.name)], info.name.data());
        }
        LONGS_EQUAL(4, pairs.size());
    }
    LONGS_EQUAL(3 * 38, ids.size());
}

TEST(HiddenTrial, AnImpossibleSizeIsSaid) {
    TrialPlan p = plan(3, {"turning_scrub"}, {Size::medium});
    p.motions = {Motion::straight};
    p.duration_s = 1;
    p.noise = 0;
    CHECK_THROWS(std::runtime_error, generated(p));
    p.effects = {"unheard_of"};
    CHECK_THROWS(std::runtime_error, generated(p));
}
