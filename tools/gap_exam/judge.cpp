#include "tools/gap_exam/judge.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace wheelwright::exam {
namespace {

using bench::GapAnswer;
using bench::Held;
using bench::NamedEffect;

constexpr double kLateWithin = 2;  // times the true delay, that what is said to be late may be

bool is_late(std::string_view name) {
    return name == "actuator_lag" || name == "transport_delay" || name == "measurement_lag";
}

bool rises_when_creeping(const Robot& robot) {
    return robot.further == Further::stribeck_friction ||
           (robot.dry[0].law != DryLaw::tanh && robot.dry[0].static_Nm > robot.dry[0].level_Nm);
}

// What is there as something that drives, not as a sensor's habit.
bool drives(const ExamLog& log, std::string_view name) {
    return name == "coulomb_friction" || name == "viscous_friction" ||
           (name == "stribeck_friction" && rises_when_creeping(log.robot)) ||
           (in_catalogue(log.robot.further) && name == name_of(log.robot.further));
}

bool is_there(const ExamLog& log, const GapAnswer& answer, const std::string& name) {
    // Encoders count in every log, and a gyro is never without a bias.
    if (drives(log, name) || name == "encoder_quantisation") return true;
    if (name == "gyro_bias") return log.sensors.gyro;
    if (!is_late(name)) return false;
    // Something is late in every log: the drive's encoder loop.
    return std::any_of(
        answer.parameters.begin(), answer.parameters.end(), [&](const bench::StatedParameter& p) {
            return p.effect == name && p.value <= kLateWithin * log.late_s + log.sensors.period_s;
        });
}

Held of_further(const ExamLog& log, const GapAnswer& answer, const std::vector<NamedEffect>& strange) {
    if (!outside_catalogue(log.robot.further)) return answer.held(name_of(log.robot.further));
    if (answer.verdict == "unexplained") return Held::named;
    return std::any_of(strange.begin(), strange.end(), [](const NamedEffect& e) { return !e.rivals.empty(); })
               ? Held::confounded
               : Held::missing;
}

}  // namespace

Miss miss_of(std::string_view effect, const GapAnswer& answer) {
    // Chance makes no more than this of a chi square: Chernoff's bound.
    const auto sure = [](double ratio, double unknowns) {
        const double level = kOracleLevel / static_cast<double>(kFirstOutside - 1);
        return ratio > unknowns &&
               (ratio - unknowns) / 2 - unknowns / 2 * std::log(ratio / unknowns) > -std::log(level);
    };
    const auto tried = std::find_if(answer.tried.begin(), answer.tried.end(),
                                    [&](const bench::Tried& t) { return t.name == effect; });
    if (std::find(answer.denied.begin(), answer.denied.end(), effect) != answer.denied.end())
        return Miss::denied;
    if (tried == answer.tried.end()) return Miss::not_tried;
    if (!sure(tried->beside_friction, tried->unknowns)) return Miss::unseen;
    return sure(tried->beside_found, tried->unknowns) ? Miss::not_taken : Miss::stood_for;
}

Judged judge(const ExamLog& log, const GapAnswer& answer) {
    Judged judged;
    judged.dry = std::max(answer.held("coulomb_friction"), answer.held("stribeck_friction"));
    judged.viscous = answer.held("viscous_friction");
    std::vector<NamedEffect> strange;
    for (const NamedEffect& effect : answer.effects) {
        if (!is_there(log, answer, effect.name)) strange.push_back(effect);
    }
    judged.further = of_further(log, answer, strange);
    for (const NamedEffect& effect : strange) {
        // Nobody can name what has no name: a doubtful name, or a name beside "unexplained", is no wrong one
        // there.
        if (outside_catalogue(log.robot.further) && judged.further == Held::named) continue;
        const bool doubtful =
            std::any_of(effect.rivals.begin(), effect.rivals.end(), [&](const std::string& rival) {
                return outside_catalogue(log.robot.further) || drives(log, rival);
            });
        if (!doubtful) judged.wrong.push_back(effect.name);
    }
    const auto found = [](const Size& size, Held held) {
        return size.visible < kVisible || held == Held::named;
    };
    judged.complete = found(log.dry, judged.dry) && found(log.viscous, judged.viscous) &&
                      found(log.further, judged.further) && judged.wrong.empty();
    if (answer.verdict != "unexplained") {  // what says that its model is not complete claims no numbers
        for (const bench::StatedParameter& said : answer.parameters) {
            const auto truth = std::find_if(
                log.parameters.begin(), log.parameters.end(),
                [&](const Parameter& p) { return p.effect == said.effect && p.name == said.name; });
            if (truth == log.parameters.end()) continue;
            judged.intervals.push_back({(said.effect.empty() ? "" : said.effect + ".") + said.name,
                                        said.low <= truth->value && truth->value <= said.high});
        }
    }
    judged.over_true = log.comparable ? answer.both_wheels_rms_rad_per_s / log.true_rms_rad_per_s
                                      : std::numeric_limits<double>::quiet_NaN();
    return judged;
}

}  // namespace wheelwright::exam
