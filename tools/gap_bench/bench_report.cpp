#include "tools/gap_bench/bench_report.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <string_view>

namespace wheelwright::bench {
namespace {

using tools::Cell;
using tools::number_text;
using tools::Report;

// What the benchmark demands.
constexpr double kMostMedianOverSysid = 1;
constexpr double kNearSysid = 1.1;  // times SysId's error
constexpr double kLeastNearSysid = 0.9;
constexpr double kLeastBothFrictions = 0.9;
constexpr double kLeastSame = 1;

// Published figures have three decimals.
constexpr double kRounding_rad_per_s = 0.0005 + 1e-9;

using Splits = std::vector<Split>;

Splits usable(const Splits& splits) {
    Splits some;
    std::copy_if(splits.begin(), splits.end(), std::back_inserter(some),
                 [](const Split& split) { return split.unusable.empty(); });
    return some;
}

template <typename Condition>
double share(const Splits& splits, Condition condition) {
    if (splits.empty()) return std::numeric_limits<double>::quiet_NaN();
    return static_cast<double>(std::count_if(splits.begin(), splits.end(), condition)) /
           static_cast<double>(splits.size());
}

struct Method {
    const char* name;
    double (*rms_rad_per_s)(const Split&);
};
constexpr std::array<Method, 5> kMethods{{
    {"signal", [](const Split& s) { return s.signal_rad_per_s; }},
    {"torque alone", [](const Split& s) { return s.torque_alone_rad_per_s; }},
    {"SysId's regression", [](const Split& s) { return s.sysid_rad_per_s; }},
    {"plain least squares", [](const Split& s) { return s.plain_rad_per_s; }},
    {"gap", [](const Split& s) { return s.gap.rms_rad_per_s; }},
}};

double median_over_sysid(const Splits& splits, const Method& method) {
    std::vector<double> ratios;
    for (const Split& split : splits) ratios.push_back(method.rms_rad_per_s(split) / split.sysid_rad_per_s);
    return median(std::move(ratios));
}

double near_sysid(const Splits& splits, const Method& method) {
    return share(splits,
                 [&](const Split& s) { return method.rms_rad_per_s(s) <= kNearSysid * s.sysid_rad_per_s; });
}

// What one log is said to be, without the parameters.
std::string answer_of(const Split& split) {
    if (!split.gap.refusal.empty()) return "refused";
    std::vector<std::string> names;
    for (const NamedEffect& effect : split.gap.effects) names.push_back(effect.name);
    std::sort(names.begin(), names.end());
    std::string answer = split.gap.verdict;
    for (const std::string& name : names) answer += " " + name;
    return answer;
}

void add_splits(Report& report, const Splits& splits, const char* held_out) {
    report.section("splits", "Held-out free run, rad/s RMS");
    report.table("list", {{"robot", "robot"},
                          {"held_out", held_out},
                          {"signal_rad_s", "signal"},
                          {"torque_alone_rad_s", "torque alone"},
                          {"sysid_rad_s", "SysId"},
                          {"plain_rad_s", "plain"},
                          {"gap_rad_s", "gap"},
                          {"gap_over_sysid", "gap/SysId"},
                          {"verdict", "verdict"},
                          {"effects", "named (confounded with)"}});
    const auto figure = [](double value) { return Cell{std::stod(number_text(value, 4))}; };
    for (const Split& s : splits) {
        if (!s.unusable.empty()) continue;
        report.row({s.robot, s.held_out, figure(s.signal_rad_per_s), figure(s.torque_alone_rad_per_s),
                    figure(s.sysid_rad_per_s), figure(s.plain_rad_per_s), figure(s.gap.rms_rad_per_s),
                    figure(s.gap_over_sysid()), s.gap.refusal.empty() ? s.gap.verdict : "refused",
                    s.gap.names()});
    }
    const auto reason = [](const Split& s) { return s.unusable.empty() ? s.gap.refusal : s.unusable; };
    const bool any =
        std::any_of(splits.begin(), splits.end(), [&](const Split& s) { return !reason(s).empty(); });
    report.section("refusals", any ? "Refused" : "");
    report.table("list", {{"robot", "robot"}, {"held_out", held_out}, {"reason", "reason"}});
    for (const Split& s : splits) {
        if (!reason(s).empty()) report.row({s.robot, s.held_out, reason(s)});
    }
}

void add_methods(Report& report, const Splits& splits) {
    report.section("methods", "Methods, against SysId's regression on the same runs");
    report.table("list", {{"method", "method"},
                          {"median_over_sysid", "median of error / SysId's"},
                          {"near_sysid", "share within 10 %"},
                          {"better_than_sysid", "better in"},
                          {"worse_than_torque_alone", "worse than torque alone in"},
                          {"refused", "refused"}});
    for (const Method& method : kMethods) {
        const auto count = [&](auto condition) {
            return Cell{static_cast<std::int64_t>(std::count_if(splits.begin(), splits.end(), condition))};
        };
        report.row({std::string(method.name), median_over_sysid(splits, method), near_sysid(splits, method),
                    count([&](const Split& s) { return method.rms_rad_per_s(s) < s.sysid_rad_per_s; }),
                    count([&](const Split& s) { return method.rms_rad_per_s(s) > s.torque_alone_rad_per_s; }),
                    count([&](const Split& s) { return std::isinf(method.rms_rad_per_s(s)); })});
    }
}

void add_names(Report& report, const Splits& splits) {
    report.section("names", "What is named");
    for (const std::string_view friction : kFrictions) {
        for (const auto& [held, words] :
             {std::pair{Held::named, "named"}, {Held::confounded, "confounded"}}) {
            report.add(std::string(friction) + "_" + words, std::string(friction) + " " + words,
                       share(splits, [&](const Split& s) { return s.gap.held(friction) == held; }));
        }
    }
    std::map<std::string, std::pair<std::int64_t, std::int64_t>>
        others;  // how often; of those without a rival
    for (const Split& split : splits) {
        for (const NamedEffect& other : split.gap.others()) {
            ++others[other.name].first;
            others[other.name].second += other.rivals.empty() ? 1 : 0;
        }
    }
    report.table("others",
                 {{"effect", "other names"}, {"splits", "splits"}, {"without_rival", "without a rival"}});
    for (const auto& [name, count] : others) report.row({name, count.first, count.second});
}

struct Deviation {
    std::int64_t figures = 0, equal = 0;
    double largest = 0;  // relative
    std::string where;

    void take(std::optional<double> published, double ours, const Split& split) {
        if (!published) return;
        ++figures;
        if (std::abs(ours - *published) <= kRounding_rad_per_s) ++equal;
        const double relative = std::abs(ours / *published - 1);
        if (relative <= largest) return;
        largest = relative;
        where = split.robot + " " + split.held_out + ": " + number_text(ours, 4) + ", published " +
                number_text(*published);
    }
};

void add_checks(Report& report, const Splits& splits) {
    report.section("checks", "Checks");
    Deviation signal;
    Deviation torque_alone;
    Deviation sysid;
    double most_off = 1;
    std::string where;
    for (const Split& split : splits) {
        signal.take(split.published.signal, split.signal_rad_per_s, split);
        torque_alone.take(split.published.torque_alone, split.torque_alone_rad_per_s, split);
        sysid.take(split.published.sysid, split.sysid_rad_per_s, split);
        const double ratio = split.gap.rms_rad_per_s / split.gap.stated_rms_rad_per_s;
        const double off = std::max(ratio, 1 / ratio);
        if (std::isfinite(ratio) && off > most_off) {
            most_off = off;
            where = split.robot + " " + split.held_out + ": " + number_text(split.gap.rms_rad_per_s, 4) +
                    ", stated " + number_text(split.gap.stated_rms_rad_per_s, 4);
        }
    }
    report.table("published", {{"figure", "published figure"},
                               {"compared", "compared"},
                               {"equal", "equal in their three decimals"},
                               {"largest_deviation", "largest deviation"},
                               {"where", "where"}});
    for (const auto& [name, deviation] :
         {std::pair{"signal", signal}, {"torque alone", torque_alone}, {"SysId's regression", sysid}}) {
        report.row(
            {std::string(name), deviation.figures, deviation.equal, deviation.largest, deviation.where});
    }
    report.add("written_over_stated", "error of the written robot file over what gap states, at most",
               most_off, "", where);
}

}  // namespace

double median(std::vector<double> values) {
    if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
    std::sort(values.begin(), values.end());
    const std::size_t half = values.size() / 2;
    return values.size() % 2 == 1 ? values[half] : (values[half - 1] + values[half]) / 2;
}

std::vector<Aim> corpus_aims(const std::vector<Split>& all) {
    const Splits splits = usable(all);
    const Method& gap = kMethods.back();
    return {
        {"median_over_sysid", "gap's error over SysId's, median", median_over_sysid(splits, gap),
         kMostMedianOverSysid, true},
        {"near_sysid", "share of the splits within 10 % of SysId's", near_sysid(splits, gap),
         kLeastNearSysid},
        {"both_frictions", "share with both frictions named, or named as confounded",
         share(splits, [](const Split& s) { return s.gap.both_frictions(); }), kLeastBothFrictions},
    };
}

std::vector<Aim> one_log_aims(const std::vector<Split>& all) {
    std::map<std::string, double> answers;
    for (const Split& split : all) ++answers[answer_of(split)];
    double most = 0;
    for (const auto& [answer, count] : answers) most = std::max(most, answer == "refused" ? 0 : count);
    return {{"same_answer", "share of the splits with the commonest answer",
             most / static_cast<double>(all.size()), kLeastSame}};
}

bool all_reached(const std::vector<Aim>& aims) {
    return std::all_of(aims.begin(), aims.end(), [](const Aim& aim) { return aim.reached(); });
}

void add_aims(Report& report, const std::vector<Aim>& aims) {
    report.section("aims", "Aims");
    report.table("list", {{"aim", "aim"},
                          {"measured", "measured"},
                          {"bound", ""},
                          {"wanted", "wanted"},
                          {"reached", "reached"}});
    for (const Aim& aim : aims) {
        report.row({aim.words, aim.measured, std::string(aim.at_most ? "at most" : "at least"), aim.wanted,
                    aim.reached()});
    }
}

Report corpus_report(const std::vector<Split>& splits) {
    Report report("gap-bench");
    add_splits(report, splits, "held out");
    add_methods(report, usable(splits));
    add_names(report, usable(splits));
    add_checks(report, usable(splits));
    add_aims(report, corpus_aims(splits));
    return report;
}

Report one_log_report(const std::vector<Split>& splits) {
    Report report("gap-bench");
    add_splits(report, splits, "learned from the first");
    add_aims(report, one_log_aims(splits));
    return report;
}

}  // namespace wheelwright::bench
