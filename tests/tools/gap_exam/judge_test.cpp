// What counts as right, confounded, missing and wrong, on answers that are made up.
#include <cmath>

#include "tools/gap_exam/judge.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using bench::GapAnswer;
using bench::Held;
using exam::ExamLog;
using exam::Further;

namespace {

ExamLog log_with(Further further) {
    ExamLog log;
    log.robot.further = further;
    log.late_s = 0.004;
    log.sensors.period_s = 0.005;
    log.true_rms_rad_per_s = 0.1;
    return log;
}

GapAnswer answer(const char* verdict, std::vector<bench::NamedEffect> effects) {
    GapAnswer a;
    a.verdict = verdict;
    a.effects = {{"coulomb_friction", {}}, {"viscous_friction", {"quadratic_drag"}}};
    for (auto& effect : effects) a.effects.push_back(std::move(effect));
    a.both_wheels_rms_rad_per_s = 0.12;
    return a;
}

std::size_t wrong(Further further, const GapAnswer& a) { return judge(log_with(further), a).wrong.size(); }
Held held(Further further, const GapAnswer& a) { return judge(log_with(further), a).further; }

}  // namespace

TEST_GROUP(ExamJudge){};

TEST(ExamJudge, NothingFurther) {
    const exam::Judged judged = judge(log_with(Further::nothing), answer("named", {}));
    CHECK(judged.dry == Held::named && judged.viscous == Held::named && judged.wrong.empty());
    DOUBLES_EQUAL(1.2, judged.over_true, 1e-9);
    LONGS_EQUAL(1, wrong(Further::nothing, answer("named", {{"slope", {}}})));
    LONGS_EQUAL(1, wrong(Further::nothing, answer("named", {{"slope", {"torque_bias"}}})));
    LONGS_EQUAL(0, wrong(Further::nothing, answer("named", {{"dead_zone", {"coulomb_friction"}}})));
    LONGS_EQUAL(0, wrong(Further::nothing, answer("named", {{"encoder_quantisation", {}}})));
}

TEST(ExamJudge, OfTheCatalogue) {
    CHECK(held(Further::slope, answer("named", {{"slope", {"torque_bias"}}})) == Held::named);
    CHECK(held(Further::slope, answer("cannot_tell", {{"torque_bias", {"slope"}}})) == Held::confounded);
    CHECK(held(Further::slope, answer("unexplained", {})) == Held::missing);
    LONGS_EQUAL(0, wrong(Further::slope, answer("cannot_tell", {{"torque_bias", {"slope"}}})));
    LONGS_EQUAL(1, wrong(Further::slope, answer("named", {{"torque_bias", {}}})));
}

TEST(ExamJudge, WhyItIsNotNamed) {
    GapAnswer a = answer("named", {});
    CHECK(exam::miss_of("slope", a) == exam::Miss::not_tried);
    a.tried = {{"slope", 1, 10, 0}};  // a chi square of one degree is above 12.6 once in 2500
    CHECK(exam::miss_of("slope", a) == exam::Miss::unseen);
    a.tried = {{"slope", 1, 30, 2}};
    CHECK(exam::miss_of("slope", a) == exam::Miss::stood_for);
    a.tried = {{"slope", 1, 30, 30}};
    CHECK(exam::miss_of("slope", a) == exam::Miss::not_taken);
    a.denied = {"slope"};
    CHECK(exam::miss_of("slope", a) == exam::Miss::denied);
}

TEST(ExamJudge, OfNoCatalogue) {
    CHECK(held(Further::wind, answer("unexplained", {{"slope", {}}})) == Held::named);
    LONGS_EQUAL(0, wrong(Further::wind, answer("unexplained", {{"slope", {}}})));
    CHECK(held(Further::wind, answer("cannot_tell", {{"slope", {"torque_bias"}}})) == Held::confounded);
    LONGS_EQUAL(0, wrong(Further::wind, answer("cannot_tell", {{"slope", {"torque_bias"}}})));
    CHECK(held(Further::wind, answer("named", {{"slope", {}}})) == Held::missing);
    LONGS_EQUAL(1, wrong(Further::wind, answer("named", {{"slope", {}}})));
}

TEST(ExamJudge, StribeckIsThereWhereTheLawRises) {
    ExamLog log = log_with(Further::nothing);
    GapAnswer a = answer("named", {});
    a.effects.front().name = "stribeck_friction";
    CHECK(judge(log, a).dry == Held::named);
    LONGS_EQUAL(1, judge(log, a).wrong.size());
    for (auto& dry : log.robot.dry) dry = {exam::DryLaw::makkar, 1, 1.2, 1, 0.1, 0, 0};
    LONGS_EQUAL(0, judge(log, a).wrong.size());
}

// Every encoder loop is late; what is said to be much later than it is, is wrong.
TEST(ExamJudge, LateByHowMuch) {
    GapAnswer a = answer("named", {{"transport_delay", {}}});
    a.parameters = {{"transport_delay", "delay_s", 0.006, 0.005, 0.007}};
    LONGS_EQUAL(0, wrong(Further::nothing, a));
    a.parameters[0].value = 0.03;
    LONGS_EQUAL(1, wrong(Further::nothing, a));
}

TEST(ExamJudge, Intervals) {
    ExamLog log = log_with(Further::nothing);
    log.parameters = {
        {"", "k7_per_kg_m", 2}, {"coulomb_friction", "left_Nm", 0.3}, {"slope", "angle_rad", 0.1}};
    GapAnswer a = answer("named", {});
    a.parameters = {{"", "k7_per_kg_m", 2.1, 1.9, 2.3}, {"coulomb_friction", "left_Nm", 0.5, 0.4, 0.6}};
    const exam::Judged judged = judge(log, a);
    LONGS_EQUAL(2, judged.intervals.size());
    STRCMP_EQUAL("k7_per_kg_m", judged.intervals[0].what.c_str());
    CHECK(judged.intervals[0].holds && !judged.intervals[1].holds);
    a.verdict = "unexplained";
    CHECK(judge(log, a).intervals.empty());
}

TEST(ExamJudge, CompleteIsAllThatIsVisible) {
    ExamLog log = log_with(Further::slope);
    log.dry.visible = log.viscous.visible = log.further.visible = 0.02;
    CHECK(!judge(log, answer("named", {})).complete);
    CHECK(judge(log, answer("named", {{"slope", {}}})).complete);
    CHECK(!judge(log, answer("named", {{"slope", {}}, {"castor_drag", {}}})).complete);
    log.further.visible = 0.005;
    CHECK(judge(log, answer("named", {})).complete);
}

TEST(ExamJudge, Refused) {
    const exam::Judged judged = judge(log_with(Further::slope), GapAnswer{});
    CHECK(judged.dry == Held::missing && judged.further == Held::missing && judged.wrong.empty());
    CHECK(std::isinf(judged.over_true));
    ExamLog log = log_with(Further::payload_step);
    log.comparable = false;
    CHECK(std::isnan(judge(log, GapAnswer{}).over_true));
}
