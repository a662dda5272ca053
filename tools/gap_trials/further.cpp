#include "tools/gap_trials/further.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string_view>
#include <tuple>
#include <utility>

#include "firmware/model/dynamics.hpp"
#include "tools/gap_trials/advised.hpp"
#include "tools/gap_trials/hidden/oracle.hpp"

namespace wheelwright::tools {
namespace {

using hidden::Trial;

bool hides(const Trial& trial, std::string_view effect) { return trial.hidden.find(effect) != nullptr; }

// A part of a log as a log of its own.
Trial part_of(const Trial& whole, std::size_t first, std::size_t end) {
    Trial part = whole;
    part.samples.assign(whole.samples.begin() + static_cast<std::ptrdiff_t>(first),
                        whole.samples.begin() + static_cast<std::ptrdiff_t>(end));
    const double from_s = part.samples.front().t_s;
    for (hidden::Sample& sample : part.samples) sample.t_s -= from_s;
    part.duration_s = part.samples.back().t_s;
    return part;
}

// D3: the first and the second half.
void halves(const Asked& asked, Further& further) {
    const std::size_t count = asked.trial.samples.size();
    // a half without the event is another truth, and so is a damage that one half has
    if (asked.trial.plan.kind == hidden::Kind::fault || hides(asked.trial, "payload_step")) return;
    for (const auto& [name, first, end] :
         {std::tuple{"halves-1", std::size_t{0}, count / 2}, std::tuple{"halves-2", count / 2, count}}) {
        const Trial half = part_of(asked.trial, first, end);
        further.can_tell = further.can_tell && hidden::ask_oracle(half).identifiable;
        const std::filesystem::path log = asked.write(std::string(name) + ".csv", hidden::csv_text(half));
        further.answers.push_back(asked.analyse(name, {log}, {}));
    }
}

// D3: the same robot on the same drive, logged at the other of two rates. First the answer to the quick log.
void rates(const Asked& asked, Further& further) {
    constexpr double kQuick_Hz = 1000;
    constexpr double kSlow_Hz = 250;
    const double rate_Hz = asked.trial.rate_Hz;
    if (asked.trial.plan.kind == hidden::Kind::fault || (rate_Hz != kQuick_Hz && rate_Hz != kSlow_Hz)) return;
    const Trial again =
        hidden::driven_again(asked.trial, rate_Hz == kQuick_Hz ? kSlow_Hz : kQuick_Hz, asked.make_plant);
    further.can_tell = asked.oracle.identifiable && hidden::ask_oracle(again).identifiable;
    const std::filesystem::path log = asked.write("rates-1.csv", hidden::csv_text(again));
    further.answers = {asked.finding, asked.analyse("rates-1", {log}, {})};
    if (rate_Hz == kSlow_Hz) std::swap(further.answers[0], further.answers[1]);
}

// The only effect of a trial that the oracle calls identifiable; else null.
const hidden::HiddenEffect* the_effect(const Asked& asked) {
    const bool single = asked.trial.plan.kind == hidden::Kind::single && asked.oracle.identifiable;
    return single ? &asked.trial.hidden.effects.front() : nullptr;
}

// A7: the same log, and an analyser that does not know the hidden effect, nor what holds it as a special
// case.
void held_out(const Asked& asked, Further& further) {
    constexpr double kNearlyAsWell = 0.1;
    constexpr std::array<std::pair<std::string_view, const char*>, 2> kSpecialCases{
        {{"coulomb_friction", "stribeck_friction"}, {"torque_saturation", "back_emf_limit"}}};
    const hidden::HiddenEffect* effect = the_effect(asked);
    if (effect == nullptr || asked.trial.plan.sizes.front() == hidden::Size::mild) return;
    // no gap is left where no wheel is moved
    if (effect->name == "gyro_bias" || effect->name == "encoder_quantisation") return;
    const hidden::OracleVerdict& o = asked.oracle;
    further.can_tell =
        o.unexplained_rival - o.unexplained_true >= kNearlyAsWell * (o.unexplained_none - o.unexplained_true);
    std::string names = effect->name;
    for (const auto& [special, general] : kSpecialCases) {
        if (effect->name == special) names.append(",").append(general);
    }
    further.answers = {asked.analyse("held_out", {asked.log}, {"--without", names})};
}

bool named_exactly(const Finding& finding, const std::string& effect) {
    return finding.verdict == "named" && finding.effects.size() == 1 &&
           finding.effects.front().name == effect;
}

std::string line(const std::string& key, double value) {
    std::array<char, 40> text{};
    std::snprintf(text.data(), text.size(), " = %.12g\n", value);
    return key + text.data();
}

// C2: the same log beside the true model, of which gap.json tells how well it runs.
void true_model(const Asked& asked, Further& further) {
    const hidden::HiddenEffect* effect = the_effect(asked);
    if (effect == nullptr || !named_exactly(asked.finding, effect->name)) return;
    const std::filesystem::path model = asked.write("true_model.toml", true_model_toml(asked.trial));
    further.answers = {asked.analyse("true_model", {asked.log}, {"--model", model.string()})};
}

struct Question {
    const char* name;
    void (*ask)(const Asked&, Further&);
};
constexpr std::array kFurther{
    Question{"advised", drive_advised}, Question{"halves", halves},         Question{"rates", rates},
    Question{"held_out", held_out},     Question{"true_model", true_model},  // last: it tells the truth
};

}  // namespace

std::string true_model_toml(const Trial& trial) {
    const hidden::Robot& robot = trial.robot;
    const double r = robot.wheel_radius_m;
    const double mass = robot.effective_mass_kg();
    double inertia = robot.effective_inertia_kg_m2();
    const double moment = robot.mass_kg * robot.cog_ahead_m;
    std::string effects;
    for (const hidden::HiddenEffect& effect : trial.hidden.effects) {
        effects += "\n[effects." + effect.name + "]\n";
        for (auto [name, value] : effect.parameters) {
            if (trial.plant == "ode") {
                // where the catalogue takes the mass of K7, the wheels' rotation included, for the body's, or
                // a usual share of it
                if (name == "angle_rad")
                    value = std::asin(std::sin(value) * robot.mass_kg / ((1 - model::kRotationShare) * mass));
                if (name == "offset_m") {
                    inertia += robot.mass_kg * value * value;
                    value *= robot.mass_kg / mass;
                }
                if (name == "friction_coefficient")
                    value *= robot.mass_kg / mass * (1 - robot.cog_ahead_m / robot.castor_ahead_m);
            }
            effects += line(name, value);
        }
    }
    return "[geometry]\n" + line("wheel_radius_m.left", r) + line("wheel_radius_m.right", r) +
           line("track_m", robot.track_m) + "\n[dynamics]\n" + line("k5_m", moment / mass) +
           line("k6_per_m", -moment / inertia) + line("k7_per_kg_m", 1 / (mass * r)) +
           line("k8_per_kg_m2", robot.track_m / (2 * r * inertia)) + effects;
}

std::map<std::string, Further> ask_further(const Asked& asked, bool all) {
    std::map<std::string, Further> answers;
    for (const Question& question : kFurther) {
        if (!all && question.ask != drive_advised) continue;
        Further further;
        question.ask(asked, further);
        if (!further.answers.empty()) answers[question.name] = std::move(further);
    }
    return answers;
}

}  // namespace wheelwright::tools
