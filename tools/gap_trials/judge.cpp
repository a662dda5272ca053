#include "tools/gap_trials/judge.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>
#include <stdexcept>

#include "tools/gap_trials/further_measures.hpp"

namespace wheelwright::tools {
namespace {

using Json = nlohmann::ordered_json;

std::optional<double> number(const Json& json, const char* key) {
    const auto found = json.find(key);
    if (found == json.end() || !found->is_number()) return std::nullopt;
    return found->get<double>();
}

std::string text(const Json& json, const char* key) {
    const auto found = json.find(key);
    return found != json.end() && found->is_string() ? found->get<std::string>() : std::string();
}

const Json& member(const Json& json, const char* key) {
    static const Json kNothing;
    const auto found = json.find(key);
    return found == json.end() ? kNothing : *found;
}

// "a+b" in the alphabet's order.
std::string joined(const std::set<std::string>& names) {
    std::string all;
    for (const std::string& name : names) all.append(all.empty() ? "" : "+").append(name);
    return all;
}

template <typename Effects>
std::set<std::string> names_of(const Effects& effects) {
    std::set<std::string> names;
    for (const auto& effect : effects) names.insert(effect.name);
    return names;
}

double wrapped(double angle) { return std::remainder(angle, 2 * std::numbers::pi); }

// What an error is measured against: the value; for one of two wheels the RMS of both, as one of them may be
// nearly zero; for a direction one radian.
double scale_of(const Truth::Effect& effect, const std::string& parameter, double value) {
    if (parameter == "uphill_rad" || parameter == "phase_rad") return 1;
    for (const auto& [side, other] : {std::pair{"left_", "right_"}, std::pair{"right_", "left_"}}) {
        if (parameter.rfind(side, 0) != 0) continue;
        const auto found = effect.parameters.find(other + parameter.substr(std::string(side).size()));
        if (found != effect.parameters.end()) return std::hypot(value, found->second) / std::numbers::sqrt2;
    }
    return std::abs(value);
}

}  // namespace

Truth read_label(std::string_view json) {
    const Json label = Json::parse(json, nullptr, false);
    if (!label.is_object() || text(label, "id").empty() || !member(label, "effects").is_array()) {
        throw std::runtime_error("this is no label of a trial");
    }
    Truth truth;
    truth.id = text(label, "id");
    truth.plant = text(label, "plant");
    truth.kind = text(label, "kind");
    truth.noise = text(label, "noise");
    for (const Json& motion : member(label, "motions")) {
        truth.motions.append(truth.motions.empty() ? "" : "+").append(motion.get<std::string>());
    }
    truth.rate_Hz = number(label, "rate_Hz").value_or(0);
    truth.gyro = member(label, "gyro").is_boolean() && label["gyro"].get<bool>();
    for (const Json& entry : label["effects"]) {
        Truth::Effect effect;
        effect.name = text(entry, "name");
        effect.size = text(entry, "size");
        for (const auto& [name, value] : member(entry, "parameters").items()) {
            effect.parameters[name] = value.get<double>();
        }
        for (const Json& name : member(entry, "linear")) effect.linear[name.get<std::string>()] = true;
        truth.effects.push_back(std::move(effect));
    }
    const Json& oracle = member(label, "oracle");
    if (member(oracle, "identifiable").is_boolean()) truth.identifiable = oracle["identifiable"].get<bool>();
    truth.confused_with = text(oracle, "nearest_rival");
    return truth;
}

Finding read_gap_json(std::string_view json) {
    Finding finding;
    finding.verdict = "no_answer";
    const Json root = Json::parse(json, nullptr, false);
    if (!root.is_object()) {
        finding.problem = "gap.json is not JSON";
        return finding;
    }
    constexpr std::array kVerdicts{"named", "nothing_missing", "cannot_tell", "unexplained", "unusable_log"};
    const std::string verdict = text(root, "verdict");
    if (std::find(kVerdicts.begin(), kVerdicts.end(), verdict) == kVerdicts.end()) {
        finding.problem = "gap.json has no verdict that is known";
        return finding;
    }
    finding.verdict = verdict;
    for (const Json& entry : member(root, "effects")) {
        if (!entry.is_object() || text(entry, "name").empty()) continue;
        Finding::Effect effect;
        effect.name = text(entry, "name");
        for (const Json& given : member(entry, "parameters")) {
            if (!given.is_object()) continue;
            const auto value = number(given, "value");
            if (!value) continue;
            Finding::Parameter parameter{text(given, "name"), *value, std::nullopt};
            const Json& interval = member(given, "interval_95");
            if (interval.is_array() && interval.size() == 2 && interval[0].is_number() &&
                interval[1].is_number()) {
                parameter.interval = {interval[0].get<double>(), interval[1].get<double>()};
            }
            effect.parameters.push_back(std::move(parameter));
        }
        for (const Json& rival : member(entry, "rivals")) {
            if (rival.is_string()) effect.rivals.push_back(rival.get<std::string>());
            if (rival.is_object()) effect.rivals.push_back(text(rival, "name"));
        }
        finding.effects.push_back(std::move(effect));
    }
    finding.closable_share = number(root, "closable_share");
    if (!finding.closable_share) finding.closable_share = number(member(root, "gap"), "closable_share");
    const Json& gap = root.contains("gap") ? root["gap"] : root;
    const Json& heldout = member(gap, "heldout");
    const Json& speeds =
        heldout.contains("wheel_speed_rms_rad_s") ? heldout["wheel_speed_rms_rad_s"] : heldout;
    finding.heldout_before_rad_per_s = number(speeds, "before");
    finding.heldout_after_rad_per_s = number(speeds, "after");
    constexpr double kWindow_s = 5;
    for (const Json& window : member(heldout, "windows")) {
        if (!window.is_object() || number(window, "window_s") != kWindow_s) continue;
        finding.window_after_rad_per_s = number(window, "after");
        finding.window_nominal_rad_per_s = number(window, "nominal");
    }
    for (const Json& place : member(root, "where")) {
        if (place.is_object() && !text(place, "place").empty()) finding.where.push_back(text(place, "place"));
    }
    for (const Json& fault : member(member(root, "log"), "faults")) {
        if (fault.is_object()) finding.faults.push_back(text(fault, "name"));
    }
    for (const Json& name : member(root, "expressible")) {
        if (name.is_string()) finding.expressible.push_back(name.get<std::string>());
    }
    return finding;
}

namespace {

Json finding_json(const Finding& f) {
    Json finding{{"verdict", f.verdict},
                 {"seconds", f.seconds},
                 {"memory_bytes", f.memory_bytes},
                 {"problem", f.problem}};
    if (f.closable_share) finding["closable_share"] = *f.closable_share;
    if (f.heldout_before_rad_per_s) finding["before"] = *f.heldout_before_rad_per_s;
    if (f.heldout_after_rad_per_s) finding["after"] = *f.heldout_after_rad_per_s;
    finding["effects"] = Json::array();
    for (const Finding::Effect& effect : f.effects) {
        Json parameters = Json::array();
        for (const Finding::Parameter& p : effect.parameters) {
            Json entry{{"name", p.name}, {"value", p.value}};
            if (p.interval) entry["interval_95"] = {p.interval->first, p.interval->second};
            parameters.push_back(std::move(entry));
        }
        finding["effects"].push_back(
            {{"name", effect.name}, {"parameters", parameters}, {"rivals", effect.rivals}});
    }
    if (!f.expressible.empty()) finding["expressible"] = f.expressible;
    for (const std::string& fault : f.faults) finding["log"]["faults"].push_back({{"name", fault}});
    for (const std::string& place : f.where) finding["where"].push_back({{"place", place}});
    if (f.window_after_rad_per_s) finding["window_after"] = *f.window_after_rad_per_s;
    if (f.window_nominal_rad_per_s) finding["window_nominal"] = *f.window_nominal_rad_per_s;
    return finding;
}

Finding finding_from(const Json& f) {
    Finding finding = read_gap_json(f.dump());
    finding.seconds = number(f, "seconds").value_or(0);
    finding.memory_bytes = number(f, "memory_bytes").value_or(0);
    finding.heldout_before_rad_per_s = number(f, "before");
    finding.heldout_after_rad_per_s = number(f, "after");
    finding.window_after_rad_per_s = number(f, "window_after");
    finding.window_nominal_rad_per_s = number(f, "window_nominal");
    if (finding.verdict == "no_answer") finding.problem = text(f, "problem");
    return finding;
}

}  // namespace

Outcome judge(const Truth& truth, const Finding& finding) {
    Outcome out;
    out.truth = truth;
    out.finding = finding;
    const std::set<std::string> hidden =
        truth.kind == "fault" ? std::set<std::string>{} : names_of(truth.effects);
    const std::set<std::string> named =
        finding.verdict == "named" ? names_of(finding.effects) : std::set<std::string>{};
    out.said = finding.verdict == "named" ? joined(named) : finding.verdict;
    if (hidden.empty()) {
        out.exact = finding.verdict == "nothing_missing";
        out.contains = out.exact;
        out.confidently_wrong = !named.empty();
        return out;
    }
    out.exact = named == hidden;
    out.contains = std::includes(named.begin(), named.end(), hidden.begin(), hidden.end());
    const bool some_right =
        std::any_of(named.begin(), named.end(), [&](const auto& n) { return hidden.contains(n); });
    const bool some_wrong =
        std::any_of(named.begin(), named.end(), [&](const auto& n) { return !hidden.contains(n); });
    out.extra = some_right && some_wrong;
    if (finding.verdict == "named") {
        std::set<std::string> spoken_of = named;
        for (const Finding::Effect& effect : finding.effects) {
            spoken_of.insert(effect.rivals.begin(), effect.rivals.end());
        }
        out.confidently_wrong =
            some_wrong && !std::includes(spoken_of.begin(), spoken_of.end(), hidden.begin(), hidden.end());
        for (const Truth::Effect& effect : truth.effects) {
            const auto found = std::find_if(finding.effects.begin(), finding.effects.end(),
                                            [&](const Finding::Effect& e) { return e.name == effect.name; });
            if (found == finding.effects.end()) continue;
            for (const Finding::Parameter& told : found->parameters) {
                const auto real = effect.parameters.find(told.name);
                if (real == effect.parameters.end()) continue;
                const double scale = scale_of(effect, told.name, real->second);
                if (!(scale > 0)) continue;
                double error = told.value - real->second;
                double value = real->second;
                if (told.name == "uphill_rad" || told.name == "phase_rad") {
                    error = wrapped(error);
                    value = told.value - error;  // on the interval's side of the circle
                }
                ParameterError entry;
                entry.parameter = effect.name + "." + told.name;
                entry.linear = effect.linear.contains(told.name);
                entry.absolute = std::abs(error);
                entry.relative = entry.absolute / scale;
                if (told.interval)
                    entry.covered = told.interval->first <= value && value <= told.interval->second;
                out.errors.push_back(std::move(entry));
            }
        }
    }
    return out;
}

std::string outcome_json(const Outcome& o) {
    Json truth{{"id", o.truth.id},
               {"plant", o.truth.plant},
               {"kind", o.truth.kind},
               {"noise", o.truth.noise},
               {"motions", o.truth.motions},
               {"rate_Hz", o.truth.rate_Hz},
               {"gyro", o.truth.gyro},
               {"identifiable", o.truth.identifiable},
               {"nearest_rival", o.truth.confused_with}};
    truth["effects"] = Json::array();
    for (const Truth::Effect& effect : o.truth.effects) {
        Json linear = Json::array();
        for (const auto& [name, yes] : effect.linear) linear.push_back(name);
        truth["effects"].push_back({{"name", effect.name},
                                    {"size", effect.size},
                                    {"parameters", effect.parameters},
                                    {"linear", linear}});
    }
    Json outcome{{"truth", truth}, {"finding", finding_json(o.finding)}};
    for (const auto& [name, finding] : o.beside) outcome["beside"][name] = finding_json(finding);
    outcome["asked_further"] = o.asked_further;
    for (const auto& [name, further] : o.further) {
        Json& one = outcome["further"][name];
        one["can_tell"] = further.can_tell;
        if (!further.apart.empty()) one["apart"] = further.apart;
        if (!further.driven.empty()) one["driven"] = further.driven;
        for (const Finding& finding : further.answers) one["answers"].push_back(finding_json(finding));
    }
    return outcome.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

Outcome outcome_from_json(std::string_view json) {
    const Json root = Json::parse(json, nullptr, false);
    if (!root.is_object() || !root.contains("truth") || !root.contains("finding")) {
        throw std::runtime_error("this is no outcome of a trial");
    }
    const Json& t = root["truth"];
    const Json& f = root["finding"];
    Truth truth = [&] {
        Json label = t;
        label["motions"] = Json::array();
        return read_label(label.dump());
    }();
    truth.motions = text(t, "motions");
    truth.identifiable = t.value("identifiable", true);
    truth.confused_with = text(t, "nearest_rival");
    Outcome outcome = judge(truth, finding_from(f));
    for (const auto& [name, finding] : member(root, "beside").items())
        outcome.beside[name] = finding_from(finding);
    outcome.asked_further = root.value("asked_further", false);
    for (const auto& [name, one] : member(root, "further").items()) {
        Further& further = outcome.further[name];
        further.can_tell = one.value("can_tell", true);
        for (const Json& effect : member(one, "apart")) further.apart.push_back(effect.get<std::string>());
        further.driven = one.value("driven", "");
        for (const Json& finding : member(one, "answers")) further.answers.push_back(finding_from(finding));
    }
    return outcome;
}

namespace {

std::string judgement_of(const Outcome& o) {
    const std::string& verdict = o.finding.verdict;
    if (verdict == "no_answer") return "no answer";
    const bool nothing = o.truth.effects.empty() || o.truth.kind == "fault";
    if (o.exact) return "exact";
    if (nothing) {
        const bool alarm = verdict == "named" || (o.truth.effects.empty() && verdict != "unusable_log");
        return alarm ? "false alarm" : "not named";
    }
    if (o.confidently_wrong) return "wrong name";
    if (o.extra) return "a name too many";
    if (verdict != "named") return "not named";
    return o.finding.effects.size() < o.truth.effects.size() ? "one of two" : "named its rival, and said so";
}

TrialLine line_of(const Outcome& o, const std::string& hidden) {
    std::string conditions;
    for (const Truth::Effect& effect : o.truth.effects) conditions.append(effect.size).append(", ");
    conditions.append(o.truth.noise).append(" noise, ").append(std::to_string(std::lround(o.truth.rate_Hz)));
    conditions.append(o.truth.gyro ? " Hz, gyro, " : " Hz, ").append(o.truth.motions);
    return {o.truth.id,
            o.truth.plant,
            o.truth.kind,
            hidden,
            std::move(conditions),
            o.said,
            judgement_of(o) + (o.truth.identifiable ? "" : ", not identifiable"),
            o.confidently_wrong};
}

void count(MethodRow& row, const Outcome& o, const std::set<std::string>& expressible) {
    const Truth& t = o.truth;
    row.measured = true;
    if (t.identifiable && t.kind == "single") {
        const Truth::Effect& effect = t.effects.front();
        (effect.size == "mild" ? row.mild : row.single).add(o.exact);
        if (effect.size != "mild" && expressible.contains(effect.name)) row.expressible.add(o.exact);
    }
    if (t.identifiable && t.kind == "pair") row.pairs.add(o.exact);
    if (t.kind == "nothing")
        row.alarms.add(o.finding.verdict == "named" || o.finding.verdict == "cannot_tell" ||
                       o.finding.verdict == "unexplained");
    row.wrong.add(o.confidently_wrong);
    row.seconds += o.finding.seconds;
}

// Each on the trials that it was given.
std::vector<MethodRow> methods_of(const std::vector<Outcome>& outcomes) {
    std::set<std::string> expressible;
    for (const Outcome& o : outcomes) {
        const auto found = o.beside.find(std::string(kPysindy));
        if (found != o.beside.end())
            expressible.insert(found->second.expressible.begin(), found->second.expressible.end());
    }
    std::vector<MethodRow> rows;
    rows.emplace_back().name = "wheelwright gap";
    for (const Outcome& o : outcomes) count(rows.front(), o, expressible);
    for (const std::string_view name : {kStepwise, kPysindy}) {
        MethodRow& row = rows.emplace_back();
        row.name = name;
        for (const Outcome& o : outcomes) {
            const auto found = o.beside.find(row.name);
            if (found != o.beside.end()) count(row, judge(o.truth, found->second), expressible);
        }
    }
    for (MethodRow& row : rows) row.seconds /= static_cast<double>(std::max<std::size_t>(1, row.wrong.n));
    return rows;
}

}  // namespace

Summary summarise(const std::vector<Outcome>& outcomes) {
    Summary sum;
    Share strong, mild, pairs_exact, pairs_contained, alarms, named_alarms, extra, blind, covered, faults,
        no_damage;
    std::map<std::string, Share> by_effect;
    std::map<std::array<std::string, 3>, TrialCell> cells;
    std::map<std::pair<std::string, std::string>, std::size_t> confusions;
    std::map<std::string, Excluded> excluded;
    std::map<std::string, std::map<std::string, std::size_t>> rivals;
    std::vector<double> linear, nonlinear, time_s, delay_s, closed, worse;
    for (const Outcome& o : outcomes) {
        const Truth& t = o.truth;
        ++sum.kinds[t.kind];
        sum.seconds += o.finding.seconds / static_cast<double>(outcomes.size());
        sum.memory_bytes = std::max(sum.memory_bytes, o.finding.memory_bytes);
        sum.unanswered += o.finding.verdict == "no_answer" ? 1 : 0;
        const std::string hidden = t.effects.empty() ? "nothing" : joined(names_of(t.effects));
        ++confusions[{hidden, o.said}];
        sum.trials.push_back(line_of(o, hidden));
        sum.wrong_names += o.confidently_wrong ? 1 : 0;
        if (t.kind == "single") {
            const Truth::Effect& effect = t.effects.front();
            TrialCell& cell = cells[{effect.name, effect.size, t.noise}];
            cell.effect = effect.name;
            cell.size = effect.size;
            cell.noise = t.noise;
            Excluded& out = excluded[effect.name];
            out.effect = effect.name;
            ++out.n;
            if (t.identifiable) {
                ++cell.n;
                cell.hits += o.exact ? 1 : 0;
                (effect.size == "mild" ? mild : strong).add(o.exact);
                if (effect.size != "mild") by_effect[effect.name].add(o.exact);
            } else {
                ++cell.excluded;
                ++out.count;
                ++rivals[effect.name][t.confused_with];
            }
        }
        if (t.kind == "pair" && t.identifiable) {
            pairs_exact.add(o.exact);
            pairs_contained.add(o.contains);
        }
        if (t.kind == "nothing") {
            const std::string& v = o.finding.verdict;
            alarms.add(v == "named" || v == "cannot_tell" || v == "unexplained");
            named_alarms.add(v == "named");
            if (o.finding.heldout_before_rad_per_s.value_or(0) > 0 && o.finding.heldout_after_rad_per_s) {
                worse.push_back(
                    100 * (*o.finding.heldout_after_rad_per_s / *o.finding.heldout_before_rad_per_s - 1));
            }
        }
        if (t.kind == "fault") faults.add(o.finding.verdict == "named");
        const std::set<std::string> damage = names_of(t.effects);
        no_damage.add(std::any_of(o.finding.faults.begin(), o.finding.faults.end(),
                                  [&](const std::string& fault) { return !damage.contains(fault); }));
        if ((t.kind == "single" || t.kind == "pair") && t.identifiable) {
            const bool some_right =
                o.finding.verdict == "named" &&
                std::any_of(o.finding.effects.begin(), o.finding.effects.end(),
                            [&](const Finding::Effect& e) { return names_of(t.effects).contains(e.name); });
            if (some_right) extra.add(o.extra);
            if (o.finding.verdict == "named" && o.finding.closable_share) {
                closed.push_back(100 * *o.finding.closable_share);
            }
            for (const ParameterError& e : o.errors) {
                if (e.covered) covered.add(*e.covered);
                if (e.parameter == "payload_step.time_s") {
                    time_s.push_back(e.absolute);
                } else if (e.parameter == "transport_delay.delay_s") {
                    delay_s.push_back(1e3 * e.absolute);
                } else {
                    (e.linear ? linear : nonlinear).push_back(100 * e.relative);
                }
            }
        }
        if (t.kind == "blind" || (t.kind == "single" && !t.identifiable)) {
            if (!t.identifiable) blind.add(o.confidently_wrong);
        }
    }

    const auto middle = [](const std::vector<double>& values) -> std::optional<double> {
        return values.empty() ? std::nullopt : std::optional<double>(median(values));
    };
    auto& m = sum.measures;
    m.push_back(
        share("A1", "single effects, medium and strong, named exactly", strong.hits, strong.n, 90, 97));
    m.push_back(share("A2", "single effects, mild, named exactly", mild.hits, mild.n, 75, 90));
    const auto worst = std::min_element(by_effect.begin(), by_effect.end(), [](const auto& a, const auto& b) {
        return a.second.hits * b.second.n < b.second.hits * a.second.n;
    });
    m.push_back(worst == by_effect.end()
                    ? share("A3", "worst effect in A1", 0, 0, 70, 85)
                    : share("A3", "worst effect in A1", worst->second.hits, worst->second.n, 70, 85));
    if (worst != by_effect.end()) m.back().remark = worst->first;
    m.push_back(share("A4 exact", "pairs named exactly", pairs_exact.hits, pairs_exact.n, 70, 85));
    m.push_back(share("A4 contained", "pairs of which both are named", pairs_contained.hits,
                      pairs_contained.n, 85, 95));
    m.push_back(
        share("A5", "alarms where nothing is hidden, upper 95 % bound", alarms.hits, alarms.n, 3, 1.3, true));
    if (m.back().interval) m.back().judged = m.back().interval->second;
    m.back().remark = std::to_string(named_alarms.hits) + " of them with a name";
    m.push_back(share("A6", "more names beside a right one", extra.hits, extra.n, 5, 2, true));
    m.push_back(
        share("A8", "confident wrong names where the log cannot tell", blind.hits, blind.n, 5, 1, true));
    m.push_back(figure("B1 linear", "error of linear parameters, median", middle(linear), linear.size(), "%",
                       3, 1, true));
    m.push_back(figure("B1 nonlinear", "error of nonlinear parameters, median", middle(nonlinear),
                       nonlinear.size(), "%", 8, 3, true));
    Measure coverage =
        share("B2", "95 % intervals that hold the truth, 90 to 98 %", covered.hits, covered.n, 90, 93);
    if (coverage.value && *coverage.value > 98)
        coverage.judged = 0;
    else if (coverage.value && *coverage.value > 97)
        coverage.judged = 92.9;
    m.push_back(std::move(coverage));
    m.push_back(figure("B3 time", "error of a payload's time, median", middle(time_s), time_s.size(), "s", 1,
                       0.3, true));
    m.push_back(
        figure("B3 delay", "error of a delay, median", middle(delay_s), delay_s.size(), "ms", 1, 0.3, true));
    m.push_back(figure("C1 median", "closable gap closed, median", middle(closed), closed.size(), "%", 85, 95,
                       false));
    m.push_back(figure("C1 tenth", "closable gap closed, 10th percentile",
                       closed.empty() ? std::nullopt : std::optional<double>(quantile(closed, 0.1)),
                       closed.size(), "%", 60, 80, false));
    m.push_back(figure("C3", "nothing hidden: held-out error against base, median", middle(worse),
                       worse.size(), "%", 1, 0, true));
    Measure fault = share("log faults", "names given to damaged logs", faults.hits, faults.n, 5, 1, true);
    m.push_back(std::move(fault));
    m.push_back(share("log whole", "logs said to be damaged in a way that they are not", no_damage.hits,
                      no_damage.n, 5, 1, true));

    for (Measure& further : further_measures(outcomes)) m.push_back(std::move(further));
    sum.held_out = held_out(outcomes);

    sum.methods = methods_of(outcomes);
    for (auto& [key, cell] : cells) sum.cells.push_back(cell);
    for (const auto& [key, count] : confusions) sum.confusions.push_back({key.first, key.second, count});
    for (auto& [name, out] : excluded) {
        for (const auto& [rival, count] : rivals[name]) {
            out.rivals.append(out.rivals.empty() ? "" : ", ").append(rival);
        }
        sum.excluded.push_back(out);
    }
    return sum;
}

}  // namespace wheelwright::tools
