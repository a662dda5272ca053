#include "tools/gap_trials/further_measures.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <set>
#include <string>
#include <string_view>

namespace wheelwright::tools {
namespace {

struct RightPlaces {
    std::string_view effect;
    std::array<std::string_view, 3> places;
};

// Where an effect shows to somebody who does not know it, by the names that gap.json has for places.
constexpr std::array kPlaces{
    RightPlaces{"viscous_friction", {"wheel speed"}},
    RightPlaces{"coulomb_friction", {"direction of turning of the wheels", "low wheel speed"}},
    RightPlaces{"stribeck_friction", {"direction of turning of the wheels", "low wheel speed"}},
    RightPlaces{"quadratic_drag", {"wheel speed"}},
    RightPlaces{"turning_scrub", {"yaw rate"}},
    // rolling resistance straight on, swivelling in turns
    RightPlaces{"castor_drag", {"direction of turning of the wheels", "yaw rate", "low wheel speed"}},
    RightPlaces{"slope", {"heading"}},
    RightPlaces{"torque_bias", {"constant"}},
    RightPlaces{"torque_gain_mismatch", {"torque"}},
    // couples both accelerations, which are the torques' sum and difference
    RightPlaces{"cog_lateral", {"torque", "coupling of turning and driving"}},
    RightPlaces{"actuator_lag", {"lag"}},
    RightPlaces{"transport_delay", {"lag"}},
    RightPlaces{"dead_zone", {"torque"}},
    // nothing arrives while the gap is crossed: late, and less of a small torque
    RightPlaces{"backlash", {"lag", "torque"}},
    RightPlaces{"torque_saturation", {"torque"}},
    // a limit of the torque that falls with the speed
    RightPlaces{"back_emf_limit", {"torque times speed", "torque", "wheel speed"}},
    // radii scale forces, and turn straight motion into yaw
    RightPlaces{"wheel_radius_mismatch", {"torque", "coupling of turning and driving"}},
    // the slip follows the force: a speed that steps with the torque
    RightPlaces{"wheel_slip", {"lag", "torque"}},
    RightPlaces{"payload_step", {"time"}},
    RightPlaces{"gain_drift", {"time"}},
    RightPlaces{"torque_ripple", {"wheel angle"}},
    RightPlaces{"measurement_lag", {"lag"}},
};
constexpr std::size_t kPlacesRead = 2;

bool is_right_place(const std::string& effect, const std::string& place) {
    return std::any_of(kPlaces.begin(), kPlaces.end(), [&](const RightPlaces& right) {
        return right.effect == effect &&
               std::find(right.places.begin(), right.places.end(), place) != right.places.end();
    });
}

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
    return found == outcome.further.end() || found->second.answers.empty() ? nullptr : &found->second;
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

constexpr const char* kRight = "right";
constexpr const char* kNamed = "wrong name";
constexpr const char* kNothing = "found nothing";
constexpr const char* kCannotTell = "cannot tell";
constexpr const char* kNotCounted = "not counted: a rival does nearly as well";

std::string judgement_of(const Outcome& o, const Further& further) {
    const Finding& said = further.answers.front();
    if (!further.can_tell) return kNotCounted;
    if (said.verdict == "named") return kNamed;
    if (said.verdict == "nothing_missing") return kNothing;
    if (said.verdict == "cannot_tell") return kCannotTell;
    if (said.verdict != "unexplained") return "no answer";
    const auto end =
        said.where.begin() + static_cast<std::ptrdiff_t>(std::min(kPlacesRead, said.where.size()));
    const bool right = std::any_of(said.where.begin(), end, [&](const std::string& place) {
        return is_right_place(o.truth.effects.front().name, place);
    });
    return right ? kRight : "wrong place";
}

Measure places_of_the_unknown(const std::vector<Outcome>& outcomes) {
    std::map<std::string, std::size_t> count;
    for (const HeldOut& line : held_out(outcomes)) ++count[line.judgement];
    std::size_t n = 0;
    for (const auto& [judgement, times] : count) n += judgement == kNotCounted ? 0 : times;
    Measure m =
        share("A7", "effects held out of the library: unexplained, right place", count[kRight], n, 80, 95);
    if (n > 0) {
        m.remark = std::to_string(count[kNamed]) + " named wrongly, " + std::to_string(count[kNothing]) +
                   " found nothing, " + std::to_string(count[kCannotTell]) + " cannot tell; " +
                   std::to_string(count[kNotCounted]) + " not counted";
    }
    return m;
}

Measure free_run_over_oracle(const std::vector<Outcome>& outcomes) {
    std::vector<double> ratio;
    for (const Outcome& o : outcomes) {
        const Further* further = further_of(o, "true_model");
        if (further == nullptr || !further->can_tell || !o.exact || !o.finding.window_after_rad_per_s)
            continue;
        const double best = further->answers.front().window_nominal_rad_per_s.value_or(0);
        if (best > 0) ratio.push_back(*o.finding.window_after_rad_per_s / best);
    }
    Measure m = figure("C2", "free run over 5 s against the true model's, median",
                       ratio.empty() ? std::nullopt : std::optional<double>(median(ratio)), ratio.size(),
                       "times", 1.3, 1.1, true);
    if (!ratio.empty()) {
        std::array<char, 60> text{};
        std::snprintf(text.data(), text.size(), "90th percentile %.3g, most %.3g", quantile(ratio, 0.9),
                      *std::max_element(ratio.begin(), ratio.end()));
        m.remark = text.data();
    }
    return m;
}

bool resolved(const Outcome& outcome, const Further& further) {
    if (further.answers.size() != 2) return false;  // it could not be driven
    const Finding& after = further.answers.back();
    std::set<std::string> hidden;
    for (const Truth::Effect& effect : outcome.truth.effects) hidden.insert(effect.name);
    if (names_of(after) != hidden) return false;
    for (const Finding::Effect& effect : after.effects) {
        for (const std::string& rival : effect.rivals) {
            const auto was_asked = [&](const std::string& name) {
                return std::find(further.apart.begin(), further.apart.end(), name) != further.apart.end();
            };
            if (was_asked(effect.name) && was_asked(rival)) return false;
        }
    }
    return true;
}

Measure told_apart(const std::vector<Outcome>& outcomes) {
    Share pairs;
    std::size_t others = 0;
    for (const Outcome& o : outcomes) {
        const Further* further = further_of(o, "advised");
        if (further == nullptr) continue;
        if (further->can_tell) {
            pairs.add(resolved(o, *further));
        } else {
            ++others;
        }
    }
    constexpr double kAccept = 80;
    constexpr double kAim = 95;
    Measure m = share("A9", "the advised motion, driven next, tells the rivals apart", pairs.hits, pairs.n,
                      kAccept, kAim);
    if (others > 0) m.remark = std::to_string(others) + " more hide none of these";
    return m;
}

}  // namespace

std::vector<Measure> further_measures(const std::vector<Outcome>& outcomes) {
    return {places_of_the_unknown(outcomes), told_apart(outcomes), free_run_over_oracle(outcomes),
            same_answers(outcomes, "halves", "D3 halves", "same verdict and names from each half of a log"),
            same_answers(outcomes, "rates", "D3 rates", "same verdict and names at 1000 and 250 Hz")};
}

std::vector<HeldOut> held_out(const std::vector<Outcome>& outcomes) {
    std::vector<HeldOut> lines;
    for (const Outcome& o : outcomes) {
        const Further* further = further_of(o, "held_out");
        if (further == nullptr || o.truth.effects.empty()) continue;
        const Finding& said = further->answers.front();
        std::string names;
        for (const std::string& name : names_of(said)) names.append(names.empty() ? "" : "+").append(name);
        std::string where;
        for (std::size_t i = 0; i < std::min(kPlacesRead, said.where.size()); ++i)
            where.append(where.empty() ? "" : ", ").append(said.where[i]);
        const Truth::Effect& hidden = o.truth.effects.front();
        lines.push_back({o.truth.id, hidden.name, hidden.size, names.empty() ? said.verdict : names, where,
                         judgement_of(o, *further)});
    }
    return lines;
}

}  // namespace wheelwright::tools
