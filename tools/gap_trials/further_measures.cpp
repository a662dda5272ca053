#include "tools/gap_trials/further_measures.hpp"

#include <set>
#include <string>

namespace wheelwright::tools {
namespace {

std::set<std::string> names_of(const Finding& finding) {
    std::set<std::string> names;
    if (finding.verdict != "named") return names;
    for (const Finding::Effect& effect : finding.effects) names.insert(effect.name);
    return names;
}

bool alike(const Finding& a, const Finding& b) {
    return a.verdict == b.verdict && a.verdict != "no_answer" && names_of(a) == names_of(b);
}

const Further* further_of(const Outcome& outcome, const char* name) {
    const auto found = outcome.further.find(name);
    return found == outcome.further.end() ? nullptr : &found->second;
}

Measure same_answers(const std::vector<Outcome>& outcomes, const char* name, const char* id,
                     const char* meaning) {
    Share all, telling;
    for (const Outcome& o : outcomes) {
        const Further* further = further_of(o, name);
        if (further == nullptr || further->answers.size() != 2) continue;
        const bool same = alike(further->answers[0], further->answers[1]);
        all.add(same);
        if (further->can_tell) telling.add(same);
    }
    Measure m = share(id, meaning, telling.hits, telling.n, 90, 97);
    if (all.n > 0) m.remark = std::to_string(all.hits) + " of all " + std::to_string(all.n);
    return m;
}

}  // namespace

std::vector<Measure> further_measures(const std::vector<Outcome>& outcomes) {
    return {same_answers(outcomes, "halves", "D3 halves", "same verdict and names from each half of a log"),
            same_answers(outcomes, "rates", "D3 rates", "same verdict and names at 1000 and 250 Hz")};
}

}  // namespace wheelwright::tools
