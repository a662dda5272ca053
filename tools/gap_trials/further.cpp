#include "tools/gap_trials/further.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <tuple>
#include <utility>

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

struct Question {
    const char* name;
    void (*ask)(const Asked&, Further&);
};
constexpr std::array kFurther{
    Question{"halves", halves},
    Question{"rates", rates},
};

}  // namespace

std::map<std::string, Further> ask_further(const Asked& asked) {
    std::map<std::string, Further> all;
    for (const Question& question : kFurther) {
        Further further;
        question.ask(asked, further);
        if (!further.answers.empty()) all[question.name] = std::move(further);
    }
    return all;
}

}  // namespace wheelwright::tools
