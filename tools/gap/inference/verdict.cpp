#include "tools/gap/inference/verdict.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace wheelwright::gap {
namespace {

std::string percent(double share) {
    return std::to_string(double(std::lround(1000 * share)) / 10.0).substr(0, 4) + " %";
}

std::string three_digits(double share) {
    std::array<char, 20> text{};
    std::snprintf(text.data(), text.size(), "%.3g %%", 100 * share);
    return text.data();
}

}  // namespace

const char* verdict_name(Verdict verdict) {
    switch (verdict) {
        case Verdict::named:
            return "named";
        case Verdict::nothing_missing:
            return "nothing_missing";
        case Verdict::cannot_tell:
            return "cannot_tell";
        case Verdict::unexplained:
            return "unexplained";
        case Verdict::unusable_log:
            return "unusable_log";
    }
    return "";
}

Conclusion conclude(std::span<const NamedEffect> effects, const Gaps& gaps, const Policy& policy) {
    const bool much_remains = (gaps.residual > gaps.of_interest && gaps.residual > 0.5 * gaps.closable) ||
                              (!effects.empty() && gaps.residual > policy.effect &&
                               gaps.residual > policy.share_unexplained * gaps.closable);
    if (effects.empty()) {
        if (much_remains || gaps.beyond_noise > gaps.of_interest) {
            return {Verdict::unexplained,
                    "a gap as large as " + percent(std::max(gaps.residual, gaps.beyond_noise)) +
                        " of the torque is left that no effect of the catalogue explains"};
        }
        return {Verdict::nothing_missing, "what K5..K8 leave is no larger than " + percent(gaps.residual) +
                                              " of the torque, and no effect explains it"};
    }
    if (much_remains) return {Verdict::unexplained, "the effects found leave most of the gap"};
    for (const NamedEffect& e : effects) {
        for (const Rival& r : e.rivals) {
            if (r.confounded || r.richer) continue;
            return {Verdict::cannot_tell, "this log does not tell " +
                                              std::string(model::kEffects[e.effect].name) + " from " +
                                              std::string(model::kEffects[r.effect].name)};
        }
    }
    return {Verdict::named,
            "each effect is significant on blocks that did not choose it, and closes its share of the gap"};
}

bool of_interest(const Structure& structure, const Remainder& beside, const Policy& policy) {
    const double least = beside.roughly.value_or(beside.explained > 0 ? policy.place_beside : policy.place);
    return structure.sure && structure.torque_share >= least &&
           structure.torque_share >=
               policy.share_of_gap * std::hypot(beside.explained, structure.torque_share);
}

Conclusion conclude(const Conclusion& search, bool named, const Remainder& remainder, const Policy& policy) {
    if (search.verdict == Verdict::unexplained) return search;
    const auto found =
        std::find_if(remainder.structures.begin(), remainder.structures.end(),
                     [&](const Structure& structure) { return of_interest(structure, remainder, policy); });
    if (found == remainder.structures.end()) return search;
    return {Verdict::unexplained,
            (named ? "beside what the effects found explain, something is left that depends on the "
                   : "no effect that was looked for explains what depends on the ") +
                std::string(found->place) + ": " + three_digits(found->torque_share) + " of the torque"};
}

Conclusion conclude(const Conclusion& search, const SensorGrounds& sensors) {
    if (!sensors.denied.empty()) {
        return {Verdict::unexplained,
                "the gyro shows " + sensors.denied.front() + ", which no effect that was looked for does"};
    }
    if (search.verdict != Verdict::nothing_missing) return search;
    if (sensors.slip) {
        return {Verdict::named,
                "the wheels turn by more than the robot moves, in proportion to force and speed"};
    }
    if (sensors.effects) return {Verdict::named, "what a sensor reports shows it directly"};
    return search;
}

}  // namespace wheelwright::gap
