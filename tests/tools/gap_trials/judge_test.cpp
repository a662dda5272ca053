// The judge against answers made by hand.
#include "tools/gap_trials/judge.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include "tools/gap_trials/trials_report.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright::tools;

namespace {

// A label as the generator writes it, of one effect with two parameters.
std::string label(const std::string& name, const std::string& size = "strong",
                  const std::string& kind = "single", bool identifiable = true) {
    return R"({"id": "log-1", "kind": ")" + kind + R"(", "plant": "ode", "effects": [{"name": ")" + name +
           R"(", "size": ")" + size +
           R"(", "parameters": {"left_Nm": 0.2, "right_Nm": 0.25}, "linear": ["left_Nm", "right_Nm"]}],
            "noise": "low", "motions": ["prbs", "spin"], "rate_Hz": 500, "gyro": true,
            "oracle": {"identifiable": )" +
           (identifiable ? "true" : "false") + R"(, "nearest_rival": "dead_zone"}})";
}

const std::string kNothing =
    R"({"id": "log-2", "kind": "nothing", "plant": "ode", "effects": [], "noise": "low", "motions": ["prbs"],
        "rate_Hz": 100, "gyro": false})";

std::string pair_label() {
    return R"({"id": "log-3", "kind": "pair", "plant": "ode", "effects": [
        {"name": "slope", "size": "strong", "parameters": {"angle_rad": 0.08, "uphill_rad": 3.1}, "linear": ["angle_rad"]},
        {"name": "viscous_friction", "size": "medium", "parameters": {}}],
        "noise": "low", "motions": [], "rate_Hz": 100, "gyro": false, "oracle": {"identifiable": true}})";
}

std::string named(const std::string& effects) {
    return R"({"verdict": "named", "closable_share": 0.93, "effects": [)" + effects +
           R"(], "gap": {"heldout": {"wheel_speed_rms_rad_s": {"before": 0.5, "after": 0.1, "floor": 0.05}}}})";
}

const std::string kCoulomb =
    R"({"name": "coulomb_friction", "closes": 0.9, "rivals": [{"name": "dead_zone"}], "parameters": [
    {"name": "left_Nm", "value": 0.202, "standard_error": 0.002, "interval_95": [0.198, 0.206], "unit": "Nm"},
    {"name": "right_Nm", "value": 0.24, "standard_error": 0.002, "interval_95": [0.236, 0.244], "unit": "Nm"}]})";

Outcome judged(const std::string& label_json, const std::string& gap_json) {
    return judge(read_label(label_json), read_gap_json(gap_json));
}

const Measure& measure(const Summary& summary, const std::string& id) {
    return *std::find_if(summary.measures.begin(), summary.measures.end(),
                         [&](const Measure& m) { return m.id == id; });
}

}  // namespace

TEST_GROUP(TrialsJudge){};

TEST(TrialsJudge, TheRightNameIsExactAndItsParametersAreCompared) {
    const Outcome o = judged(label("coulomb_friction"), named(kCoulomb));
    CHECK(o.exact && o.contains && !o.extra && !o.confidently_wrong);
    STRCMP_EQUAL("coulomb_friction", o.said.c_str());
    LONGS_EQUAL(2, o.errors.size());
    // against the RMS of both wheels
    const double scale = 0.22638462845343543;
    DOUBLES_EQUAL(0.002 / scale, o.errors[0].relative, 1e-12);
    DOUBLES_EQUAL(0.01 / scale, o.errors[1].relative, 1e-12);
    CHECK(o.errors[0].linear);
    CHECK(*o.errors[0].covered);
    CHECK_FALSE(*o.errors[1].covered);
    DOUBLES_EQUAL(0.93, *o.finding.closable_share, 0);
    DOUBLES_EQUAL(0.1, *o.finding.heldout_after_rad_per_s, 0);
}

TEST(TrialsJudge, DamageThatALogDoesNotHaveIsCounted) {
    const std::string dropouts =
        R"({"verdict": "nothing_missing", "effects": [], "log": {"faults": [{"name": "log_dropouts", "samples": 12}]}})";
    const std::string damaged =
        R"({"id": "log-4", "kind": "fault", "plant": "ode", "effects": [
        {"name": "log_dropouts", "size": "mild", "parameters": {}}], "noise": "low", "motions": [], "rate_Hz": 100, "gyro": false})";
    const Summary sum = summarise({judged(kNothing, dropouts), judged(damaged, dropouts),
                                   judged(kNothing, R"({"verdict": "nothing_missing", "effects": []})")});
    DOUBLES_EQUAL(100.0 / 3, *measure(sum, "log whole").value, 1e-9);
}

TEST(TrialsJudge, WrongNamesAreConfidentUnlessTheRightOneIsListed) {
    CHECK(judged(label("viscous_friction"), named(kCoulomb)).confidently_wrong);
    const Outcome listed = judged(label("dead_zone"), named(kCoulomb));
    CHECK(!listed.exact && !listed.confidently_wrong);
    CHECK(judged(kNothing, named(kCoulomb)).confidently_wrong);
    CHECK_FALSE(judged(label("dead_zone"), R"({"verdict": "cannot_tell", "effects": [{"name": "slope"}]})")
                    .confidently_wrong);
}

TEST(TrialsJudge, MoreNamesBesideTheRightOne) {
    const Outcome o = judged(label("coulomb_friction"), named(kCoulomb + R"(, {"name": "slope"})"));
    CHECK(!o.exact && o.contains && o.extra && !o.confidently_wrong);
    STRCMP_EQUAL("coulomb_friction+slope", o.said.c_str());
}

TEST(TrialsJudge, PairsAreExactOrContained) {
    const std::string both = R"({"name": "viscous_friction"}, {"name": "slope", "parameters": [
        {"name": "uphill_rad", "value": -3.15, "interval_95": [-3.25, -3.05]}]})";
    const Outcome o = judged(pair_label(), named(both));
    CHECK(o.exact);
    // the same direction but for a turn
    DOUBLES_EQUAL(6.283185307179586 - 6.25, o.errors.at(0).absolute, 1e-12);
    CHECK(*o.errors[0].covered);
    CHECK_FALSE(o.errors[0].linear);
    const Outcome half = judged(pair_label(), named(R"({"name": "slope"})"));
    CHECK(!half.exact && !half.contains && !half.extra && !half.confidently_wrong);
    CHECK(judged(pair_label(), named(both + R"(, {"name": "dead_zone"})")).contains);
}

TEST(TrialsJudge, EveryTrialHasALine) {
    const std::string unexplained = R"({"verdict": "unexplained", "effects": []})";
    const Summary summary = summarise(
        {judged(label("coulomb_friction"), named(kCoulomb)),
         judged(label("viscous_friction"), named(kCoulomb)), judged(label("dead_zone"), named(kCoulomb)),
         judged(label("coulomb_friction"), named(kCoulomb + R"(, {"name": "slope"})")),
         judged(pair_label(), named(R"({"name": "slope"})")),
         judged(label("slope", "mild", "single", false), unexplained), judged(kNothing, unexplained),
         judged(kNothing, R"({"verdict": "nothing_missing", "effects": []})"),
         judged(label("log_dropouts", "mild", "fault"), unexplained),
         judged(label("log_dropouts", "mild", "fault"), named(kCoulomb)), judged(kNothing, "")});
    const std::vector<std::string> wanted{"exact",           "wrong name", "named its rival, and said so",
                                          "a name too many", "one of two", "not named, not identifiable",
                                          "false alarm",     "exact",      "not named",
                                          "false alarm",     "no answer"};
    LONGS_EQUAL(wanted.size(), summary.trials.size());
    for (std::size_t i = 0; i < wanted.size(); ++i)
        STRCMP_EQUAL(wanted[i].c_str(), summary.trials[i].judgement.c_str());
    LONGS_EQUAL(2, summary.wrong_names);
    STRCMP_EQUAL("strong, low noise, 500 Hz, gyro, prbs+spin", summary.trials[0].conditions.c_str());
}

TEST(TrialsJudge, OtherAnalysesAreJudgedOnTheSameLogs) {
    Outcome right = judged(label("coulomb_friction"), named(kCoulomb));
    right.beside[std::string(kStepwise)] = read_gap_json(named(R"({"name": "dead_zone"})"));
    right.beside[std::string(kStepwise)].seconds = 3;
    Outcome nothing = judged(kNothing, R"({"verdict": "nothing_missing", "effects": []})");
    nothing.beside[std::string(kStepwise)] = read_gap_json(named(kCoulomb));
    nothing.beside[std::string(kStepwise)].seconds = 1;
    // as they come back from their files
    const Summary summary =
        summarise({outcome_from_json(outcome_json(right)), outcome_from_json(outcome_json(nothing))});
    LONGS_EQUAL(3, summary.methods.size());
    const MethodRow& ours = summary.methods[0];
    const MethodRow& stepwise = summary.methods[1];
    LONGS_EQUAL(1, ours.single.hits);
    LONGS_EQUAL(0, ours.alarms.hits);
    LONGS_EQUAL(0, stepwise.single.hits);
    LONGS_EQUAL(1, stepwise.single.n);
    LONGS_EQUAL(1, stepwise.alarms.hits);
    LONGS_EQUAL(2, stepwise.wrong.hits);
    DOUBLES_EQUAL(2, stepwise.seconds, 1e-12);
    CHECK_FALSE(summary.methods[2].measured);
    STRCMP_CONTAINS("not measured", trials_report(summary, {"sample of 2", 1, 2}).text().c_str());

    // The terms of one are a subset of the effects: what the others do on those is told too.
    right.beside[std::string(kPysindy)] = read_gap_json(
        R"({"verdict": "named", "effects": [{"name": "coulomb_friction"}], "expressible": ["coulomb_friction"]})");
    const Summary with =
        summarise({outcome_from_json(outcome_json(right)), judged(label("slope"), named(kCoulomb))});
    LONGS_EQUAL(1, with.methods[2].expressible.hits);
    LONGS_EQUAL(1, with.methods[2].expressible.n);
    LONGS_EQUAL(2, with.methods[0].single.n);
    LONGS_EQUAL(1, with.methods[0].expressible.n);
}

TEST(TrialsJudge, WhatIsNoAnswerIsToldAsSuch) {
    for (const char* text : {"", "[]", "{", R"({"verdict": "maybe"})", R"({"verdict": 3})", "null"}) {
        const Finding finding = read_gap_json(text);
        STRCMP_EQUAL("no_answer", finding.verdict.c_str());
        CHECK(!finding.problem.empty());
    }
    // odd but readable
    LONGS_EQUAL(
        1, read_gap_json(R"({"verdict": "named", "effects": [3, {"name": "slope", "parameters": [1, {}]}]})")
               .effects.size());
    for (const char* text : {"", "[]", R"({"id": "x"})"}) CHECK_THROWS(std::runtime_error, read_label(text));
    CHECK_THROWS(std::runtime_error, outcome_from_json("{}"));
}

TEST(TrialsJudge, OutcomesSurviveTheirFile) {
    for (const Outcome& o :
         {judged(label("coulomb_friction", "mild", "single", false), named(kCoulomb)),
          judged(kNothing, R"({"verdict": "nothing_missing"})"), judged(pair_label(), "")}) {
        const Outcome again = outcome_from_json(outcome_json(o));
        STRCMP_EQUAL(outcome_json(o).c_str(), outcome_json(again).c_str());
        CHECK_EQUAL(o.truth.identifiable, again.truth.identifiable);
        CHECK_EQUAL(o.exact, again.exact);
        LONGS_EQUAL(o.errors.size(), again.errors.size());
        STRCMP_EQUAL(o.said.c_str(), again.said.c_str());
        STRCMP_EQUAL(o.truth.motions.c_str(), again.truth.motions.c_str());
    }
}

TEST(TrialsJudge, ClopperPearsonIsTheTextbooks) {
    // R: binom.test(c(0, 300)), (8, 10), (10, 10), (270, 300)
    DOUBLES_EQUAL(0, clopper_pearson(0, 300).first, 1e-9);
    DOUBLES_EQUAL(0.01222095, clopper_pearson(0, 300).second, 1e-7);
    DOUBLES_EQUAL(0.4439045, clopper_pearson(8, 10).first, 1e-6);
    DOUBLES_EQUAL(0.9747893, clopper_pearson(8, 10).second, 1e-6);
    DOUBLES_EQUAL(0.6915029, clopper_pearson(10, 10).first, 1e-6);
    DOUBLES_EQUAL(1, clopper_pearson(10, 10).second, 1e-9);
    DOUBLES_EQUAL(0, clopper_pearson(0, 0).first, 0);
}

TEST(TrialsJudge, MeasuresCountWhatTheyClaim) {
    std::vector<Outcome> all;
    for (int i = 0; i < 9; ++i) all.push_back(judged(label("coulomb_friction"), named(kCoulomb)));
    all.push_back(judged(label("coulomb_friction"), R"({"verdict": "unexplained"})"));
    all.push_back(judged(label("coulomb_friction", "mild"), named(R"({"name": "slope"})")));
    all.push_back(judged(label("coulomb_friction", "mild", "single", false), named(R"({"name": "slope"})")));
    all.push_back(judged(label("dead_zone", "medium", "blind", false), R"({"verdict": "cannot_tell"})"));
    all.push_back(judged(pair_label(), named(R"({"name": "slope"})")));
    all.push_back(judged(kNothing, R"({"verdict": "nothing_missing"})"));
    all.push_back(judged(kNothing, R"({"verdict": "unexplained"})"));
    const Summary s = summarise(all);
    LONGS_EQUAL(9, measure(s, "A1").hits);
    LONGS_EQUAL(10, measure(s, "A1").n);
    DOUBLES_EQUAL(90, *measure(s, "A1").value, 1e-9);
    CHECK(*measure(s, "A1").accepted());
    CHECK_FALSE(*measure(s, "A1").aimed());
    LONGS_EQUAL(0, measure(s, "A2").hits);
    LONGS_EQUAL(1, measure(s, "A2").n);
    LONGS_EQUAL(0, measure(s, "A4 contained").hits);
    LONGS_EQUAL(1, measure(s, "A5").hits);
    LONGS_EQUAL(2, measure(s, "A5").n);
    LONGS_EQUAL(2, measure(s, "A8").n);
    LONGS_EQUAL(1, measure(s, "A8").hits);
    LONGS_EQUAL(0, measure(s, "A6").hits);
    LONGS_EQUAL(10, measure(s, "A6").n);  // nine, and the pair of which one was found
    DOUBLES_EQUAL(50, *measure(s, "B2").value, 1e-9);
    CHECK_FALSE(measure(s, "B3 delay").value.has_value());
    LONGS_EQUAL(1, s.excluded.at(0).count);
    LONGS_EQUAL(12, s.excluded[0].n);
    STRCMP_EQUAL("dead_zone", s.excluded[0].rivals.c_str());
    CHECK_FALSE(all_accepted(s));
    const std::string text = trials_report(s, {"sample", 1, all.size()}).text();
    CHECK(text.find("A1") != std::string::npos);
    CHECK(text.find("not measured") != std::string::npos);
    CHECK(text.find("coulomb_friction") != std::string::npos);
}

TEST(TrialsJudge, TwoLogsOfOneRobotAreAnsweredAlikeOrNot) {
    const Finding coulomb = read_gap_json(named(kCoulomb));
    const Finding slope = read_gap_json(named(R"({"name": "slope"})"));
    const Finding both = read_gap_json(named(R"({"name": "slope"}, )" + kCoulomb));
    const Finding as_well = read_gap_json(named(kCoulomb + R"(, {"name": "slope"})"));
    const Finding nothing = read_gap_json(R"({"verdict": "nothing_missing"})");
    const Finding silent = read_gap_json("");
    std::vector<Outcome> all;
    const auto add = [&](const Finding& first, const Finding& second, bool can_tell = true) {
        Outcome o = judged(label("coulomb_friction"), named(kCoulomb));
        o.asked_further = true;
        o.further["halves"] = {{first, second}, can_tell};
        all.push_back(outcome_from_json(outcome_json(o)));
    };
    add(coulomb, coulomb);
    add(both, as_well);
    add(nothing, nothing);
    add(coulomb, slope);
    add(coulomb, both);
    add(silent, silent);
    add(coulomb, nothing, false);
    all.push_back(judged(label("coulomb_friction"), named(kCoulomb)));
    const Summary s = summarise(all);
    LONGS_EQUAL(3, measure(s, "D3 halves").hits);
    LONGS_EQUAL(6, measure(s, "D3 halves").n);
    STRCMP_EQUAL("3 of all 7", measure(s, "D3 halves").remark.c_str());
    CHECK_FALSE(measure(s, "D3 rates").value.has_value());
    CHECK(all.front().asked_further);
    CHECK_FALSE(all.back().asked_further);
}

TEST(TrialsJudge, AnEffectHeldOutOfTheLibraryIsUnexplainedAtARightPlace) {
    std::vector<Outcome> all;
    const auto add = [&](const std::string& effect, const std::string& answer, bool can_tell = true) {
        Outcome o = judged(label(effect), named(kCoulomb));
        o.asked_further = true;
        o.further["held_out"] = {{read_gap_json(answer)}, can_tell};
        all.push_back(outcome_from_json(outcome_json(o)));
    };
    const auto unexplained = [](const std::string& first, const std::string& second) {
        return R"({"verdict": "unexplained", "effects": [{"name": "dead_zone"}], "where": [{"place": ")" +
               first + R"(", "explains": 0.9}, {"place": ")" + second +
               R"(", "explains": 0.8}, {"place": "heading", "explains": 0.7}]})";
    };
    add("coulomb_friction", unexplained("time", "low wheel speed"));
    add("slope", unexplained("heading", "time"));
    add("slope", unexplained("torque", "time"));  // heading is only the third
    add("slope", R"({"verdict": "unexplained", "where": []})");
    add("viscous_friction", named(kCoulomb));
    add("viscous_friction", R"({"verdict": "nothing_missing", "where": [{"place": "wheel speed"}]})");
    add("viscous_friction", R"({"verdict": "cannot_tell", "effects": [{"name": "quadratic_drag"}]})");
    add("viscous_friction", "");
    add("transport_delay", named(R"({"name": "actuator_lag"})"), false);
    const Summary s = summarise(all);
    LONGS_EQUAL(2, measure(s, "A7").hits);
    LONGS_EQUAL(8, measure(s, "A7").n);
    STRCMP_EQUAL("1 named wrongly, 1 found nothing, 1 cannot tell; 1 not counted",
                 measure(s, "A7").remark.c_str());
    LONGS_EQUAL(9, s.held_out.size());
    STRCMP_EQUAL("time, low wheel speed", s.held_out[0].where.c_str());
    STRCMP_EQUAL("unexplained", s.held_out[0].said.c_str());
    STRCMP_EQUAL("wrong place", s.held_out[2].judgement.c_str());
    STRCMP_EQUAL("coulomb_friction", s.held_out[4].said.c_str());
    STRCMP_EQUAL("no answer", s.held_out[7].judgement.c_str());
    STRCMP_CONTAINS("not counted: a rival does nearly as well",
                    trials_report(s, {"sample", 1, all.size()}).text().c_str());
}

TEST(TrialsJudge, TheFreeRunIsMeasuredAgainstTheTrueModels) {
    const auto windows = [](double after, const std::string& nominal) {
        return R"({"verdict": "named", "effects": [{"name": "coulomb_friction"}], "gap": {"heldout": {"windows": [
            {"window_s": 1.0, "after": 0.3, "nominal": 0.1},
            {"window_s": 5.0, "after": )" +
               std::to_string(after) + R"(, "nominal": )" + nominal + R"(}]}}})";
    };
    std::vector<Outcome> all;
    const auto add = [&](const std::string& effect, double after, const std::string& nominal) {
        Outcome o = judged(label(effect), windows(after, "null"));
        o.asked_further = true;
        o.further["true_model"] = {{read_gap_json(windows(7, nominal))}, true};
        all.push_back(outcome_from_json(outcome_json(o)));
    };
    add("coulomb_friction", 0.12, "0.1");
    add("coulomb_friction", 0.2, "0.1");
    add("coulomb_friction", 0.15, "0.1");
    add("coulomb_friction", 0.15, "null");
    add("slope", 0.9, "0.1");  // another name was given
    const Summary s = summarise(all);
    LONGS_EQUAL(3, measure(s, "C2").n);
    DOUBLES_EQUAL(1.5, *measure(s, "C2").value, 1e-9);
    CHECK_FALSE(*measure(s, "C2").accepted());
    STRCMP_EQUAL("90th percentile 1.5, most 2", measure(s, "C2").remark.c_str());
    CHECK_FALSE(measure(summarise({}), "C2").value.has_value());
    CHECK_FALSE(measure(summarise({}), "A7").value.has_value());
}

TEST(TrialsJudge, TooWideIntervalsAreNoCoverageEither) {
    std::vector<Outcome> all;
    const std::string wide =
        R"({"name": "coulomb_friction", "parameters": [{"name": "left_Nm", "value": 0.2, "interval_95": [-1, 1]}]})";
    for (int i = 0; i < 100; ++i) all.push_back(judged(label("coulomb_friction"), named(wide)));
    CHECK_FALSE(*measure(summarise(all), "B2").accepted());
    CHECK_FALSE(measure(summarise({}), "A1").value.has_value());
}
