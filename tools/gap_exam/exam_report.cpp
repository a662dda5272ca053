#include "tools/gap_exam/exam_report.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

namespace wheelwright::exam {
namespace {

using bench::Held;
using tools::Cell;
using tools::number_text;
using tools::Report;
using Answers = std::vector<Answered>;

// What the exam demands.
constexpr double kLarge = 0.05;  // share of the torque
constexpr double kLeastFrictionNamed = 0.95, kLeastFurtherNamed = 0.85, kMostWrong = 0.02;
constexpr double kLeastCovered = 0.9, kMostCovered = 0.98, kMostOverTrue = 1.3;

// Upper ends of the bins, shares of the torque.
constexpr std::array kBins{0.01, 0.02, 0.05, 0.1, 0.2};
std::size_t bin_of(double share) {
    return static_cast<std::size_t>(std::lower_bound(kBins.begin(), kBins.end(), share) - kBins.begin());
}

std::vector<Report::Column> size_columns(std::vector<Report::Column> first) {
    for (std::size_t k = 0; k <= kBins.size(); ++k) {
        const std::string from = k == 0 ? "0" : number_text(100 * kBins.at(k - 1));
        const bool last = k == kBins.size();
        const std::string to = last ? "" : number_text(100 * kBins.at(k));
        first.push_back(
            {last ? "above_" + from : "to_" + to, last ? "> " + from + " %" : from + "-" + to + " %"});
    }
    return first;
}

// Something that is asked for: how large it is, and how the answer holds it.
struct Asked {
    Size size;
    Held held;
};

template <typename What>
std::vector<Asked> asked(const Answers& answers, What what) {
    std::vector<Asked> all;
    for (const Answered& a : answers) {
        if (const std::optional<Asked> one = what(a)) all.push_back(*one);
    }
    return all;
}

std::vector<Asked> dry(const Answers& answers) {
    return asked(answers, [](const Answered& a) { return std::optional<Asked>({a.log.dry, a.judged.dry}); });
}
std::vector<Asked> viscous(const Answers& answers) {
    return asked(answers, [](const Answered& a) {
        return std::optional<Asked>({a.log.viscous, a.judged.viscous});
    });
}
template <typename Which>
std::vector<Asked> further(const Answers& answers, Which which) {
    return asked(answers, [&](const Answered& a) {
        return which(a.log.robot.further) ? std::optional<Asked>({a.log.further, a.judged.further})
                                          : std::nullopt;
    });
}

struct Count {
    std::int64_t named = 0, confounded = 0, all = 0;
    void take(Held held) {
        ++all;
        named += held == Held::named ? 1 : 0;
        confounded += held == Held::confounded ? 1 : 0;
    }
    // "3 +1 of 5": named, and confounded.
    std::string text() const {
        if (all == 0) return "";
        const std::string more = confounded > 0 ? " +" + std::to_string(confounded) : "";
        return std::to_string(named) + more + " of " + std::to_string(all);
    }
};

Count large(const std::vector<Asked>& all) {
    Count count;
    for (const Asked& one : all) {
        if (one.size.share > kLarge && one.size.visible >= kVisible) count.take(one.held);
    }
    return count;
}

double share(std::int64_t some, std::int64_t all) {
    if (all == 0) return std::numeric_limits<double>::quiet_NaN();
    return static_cast<double>(some) / static_cast<double>(all);
}

void add_power_row(Report& report, std::string_view name, const std::vector<Asked>& all) {
    std::array<Count, kBins.size() + 1> bins;
    std::int64_t hidden = 0;
    for (const Asked& one : all) {
        if (one.size.visible >= kVisible || one.size.share <= kBins[0]) {
            bins.at(bin_of(one.size.share)).take(one.held);
        } else {
            ++hidden;
        }
    }
    std::vector<Cell> row{std::string(name)};
    for (const Count& bin : bins) row.emplace_back(bin.text());
    row.emplace_back(hidden);
    report.row(std::move(row));
}

void add_power(Report& report, const Answers& answers) {
    report.section("power", "Power over size: named +confounded of logs, by share of the torque");
    std::vector<Report::Column> columns = size_columns({{"effect", "effect"}});
    columns.push_back({"hidden", "hidden by base"});
    report.table("list", std::move(columns));
    add_power_row(report, "dry friction", dry(answers));
    add_power_row(report, "viscous friction", viscous(answers));
    add_power_row(report, "further, of the catalogue", further(answers, in_catalogue));
    add_power_row(report, "further, of none", further(answers, outside_catalogue));
    for (std::size_t k = 1; k < kFurtherNames.size(); ++k) {
        const std::vector<Asked> one =
            further(answers, [k](Further f) { return f == static_cast<Further>(k); });
        if (!one.empty()) add_power_row(report, kFurtherNames.at(k), one);
    }
}

// The ceiling: what an oracle could be sure of that knows which effect to ask for, and tests it beside
// friction by the likelihood ratio of all rows.
void add_misses(Report& report, const Answers& answers) {
    constexpr std::array kWhy{"unseen: no likelihood ratio beside friction",
                              "another that is named stands for it",
                              "denied by the free run or other weightings",
                              "sure by all rows, not by the pieces", "no point in range"};
    std::array<std::pair<std::int64_t, std::string>, kWhy.size()> why;
    Count asked;
    for (const Answered& a : answers) {
        const Further f = a.log.robot.further;
        if (!in_catalogue(f) || a.log.further.share <= kLarge || a.log.further.visible < kVisible) continue;
        asked.take(a.judged.further);
        if (a.judged.further == Held::named) continue;
        auto& [count, logs] = why.at(static_cast<std::size_t>(miss_of(name_of(f), a.answer)));
        ++count;
        logs += (logs.empty() ? "" : ", ") + std::to_string(a.log.number) + " " + std::string(name_of(f));
    }
    report.section("misses", "Further effects of the catalogue above " + number_text(100 * kLarge) +
                                 " % of the torque that are not named");
    report.table("list", {{"why", "why"}, {"logs", "logs"}, {"which", "which"}});
    for (std::size_t k = 0; k < kWhy.size(); ++k) {
        if (why.at(k).first > 0) report.row({std::string(kWhy.at(k)), why.at(k).first, why.at(k).second});
    }
    const auto seen = asked.all - why[0].first - why[4].first;
    report.add("oracle", "likelihood ratio sure, if one knew what to ask for", share(seen, asked.all));
    report.add("ceiling", "the same, and nothing that is named stands for it",
               share(seen - why[1].first, asked.all));
}

void add_wrong(Report& report, const Answers& answers) {
    report.section("wrong", "Logs with a wrong name, by share of the torque that the further effect has");
    report.table("by_size", size_columns({{"logs", "logs with"}, {"none", "none"}}));
    for (const auto& [name, which] : {std::pair{"a further effect of the catalogue", &in_catalogue},
                                      {"one of none", &outside_catalogue},
                                      {"nothing further", static_cast<bool (*)(Further)>(nullptr)}}) {
        // first without a further effect, then the bins
        std::array<std::pair<std::int64_t, std::int64_t>, kBins.size() + 2> counts{};
        for (const Answered& a : answers) {
            const Further f = a.log.robot.further;
            if (which != nullptr ? !which(f) : f != Further::nothing) continue;
            auto& count = counts.at(which != nullptr ? 1 + bin_of(a.log.further.share) : 0);
            ++count.second;
            count.first += a.judged.wrong.empty() ? 0 : 1;
        }
        std::vector<Cell> row{std::string(name)};
        for (const auto& [wrong, all] : counts)
            row.emplace_back(all == 0 ? "" : std::to_string(wrong) + " of " + std::to_string(all));
        report.row(std::move(row));
    }
    report.table("list", {{"log", "log"},
                          {"wrong", "wrong name"},
                          {"hidden", "what was there"},
                          {"said", "all that was named (rivals)"}});
    for (const Answered& a : answers) {
        for (const std::string& name : a.judged.wrong)
            report.row({static_cast<std::int64_t>(a.log.number), name,
                        std::string(name_of(a.log.robot.further)), a.answer.names()});
    }
}

struct Coverage {
    std::int64_t holds = 0, all = 0;
    void take(const Covered& interval) {
        ++all;
        holds += interval.holds ? 1 : 0;
    }
};

template <typename Which>
Coverage covered(const Answers& answers, Which which) {
    Coverage coverage;
    for (const Answered& a : answers) {
        for (const Covered& interval : a.judged.intervals) {
            if (which(a)) coverage.take(interval);
        }
    }
    return coverage;
}

void add_intervals(Report& report, const Answers& answers) {
    report.section("intervals", "95 % intervals that hold the truth");
    report.table("list",
                 {{"parameter", "parameter"}, {"holds", "hold it"}, {"all", "of"}, {"share", "share"}});
    std::map<std::string, Coverage> by_name;
    for (const Answered& a : answers) {
        for (const Covered& interval : a.judged.intervals) by_name[interval.what].take(interval);
    }
    for (const auto& [what, coverage] : by_name)
        report.row({what, coverage.holds, coverage.all, share(coverage.holds, coverage.all)});
    for (const bool complete : {true, false}) {
        const Coverage c = covered(answers, [&](const Answered& a) { return a.judged.complete == complete; });
        report.row({std::string(complete ? "where all that is visible is named" : "where not"), c.holds,
                    c.all, share(c.holds, c.all)});
    }
}

std::vector<double> over_true(const Answers& answers) {
    std::vector<double> ratios;
    for (const Answered& a : answers) {
        if (!std::isnan(a.judged.over_true)) ratios.push_back(a.judged.over_true);
    }
    return ratios;
}

void add_logs(Report& report, const Answers& answers) {
    report.section("logs", "Logs");
    report.table("list", {{"log", "log"},
                          {"mass_kg", "kg"},
                          {"dry_percent", "dry %"},
                          {"viscous_percent", "viscous %"},
                          {"further", "further"},
                          {"further_percent", "%"},
                          {"visible_percent", "visible %"},
                          {"verdict", "verdict"},
                          {"named", "named (rivals)"},
                          {"over_true", "error/true's"}});
    const auto percent = [](double value) { return Cell{std::stod(number_text(100 * value, 2))}; };
    for (const Answered& a : answers) {
        report.row({static_cast<std::int64_t>(a.log.number), std::stod(number_text(a.log.robot.mass_kg, 3)),
                    percent(a.log.dry.share), percent(a.log.viscous.share),
                    std::string(name_of(a.log.robot.further)), percent(a.log.further.share),
                    percent(a.log.further.visible), a.answer.refusal.empty() ? a.answer.verdict : "refused",
                    a.answer.names(), std::stod(number_text(a.judged.over_true, 3))});
    }
    bool any = false;
    for (const Answered& a : answers) any = any || !a.answer.refusal.empty();
    report.section("refusals", any ? "Refused" : "");
    report.table("list", {{"log", "log"}, {"reason", "reason"}});
    for (const Answered& a : answers) {
        if (!a.answer.refusal.empty())
            report.row({static_cast<std::int64_t>(a.log.number), a.answer.refusal});
    }
}

void add_held_out(Report& report, const Answers& answers) {
    report.section("held_out", "Held-out free run over the true robot's, both wheels");
    std::vector<double> ratios = over_true(answers);
    std::sort(ratios.begin(), ratios.end());
    if (ratios.empty()) return;
    for (const int percent : {10, 50, 75, 90}) {
        const auto at = static_cast<std::size_t>(percent) * (ratios.size() - 1) / 100;
        report.add("percentile_" + std::to_string(percent), std::to_string(percent) + "th percentile",
                   ratios[at]);
    }
    report.add("logs", "logs", static_cast<std::int64_t>(ratios.size()));
}

}  // namespace

std::vector<bench::Aim> exam_aims(const Answers& answers) {
    const auto named = [](const std::vector<Asked>& all) {
        const Count count = large(all);
        return share(count.named, count.all);
    };
    std::int64_t wrong = 0;
    for (const Answered& a : answers) wrong += a.judged.wrong.empty() ? 0 : 1;
    const Coverage intervals = covered(answers, [](const Answered&) { return true; });
    const std::string above = " above " + number_text(100 * kLarge) + " % of the torque named";
    return {{"dry", "dry friction" + above, named(dry(answers)), kLeastFrictionNamed},
            {"viscous", "viscous friction" + above, named(viscous(answers)), kLeastFrictionNamed},
            {"further", "a further effect of the catalogue" + above, named(further(answers, in_catalogue)),
             kLeastFurtherNamed},
            {"wrong", "logs with a wrong name", share(wrong, static_cast<std::int64_t>(answers.size())),
             kMostWrong, true},
            {"covered", "95 % intervals that hold the truth", share(intervals.holds, intervals.all),
             kLeastCovered},
            {"covered_at_most", "95 % intervals that hold the truth", share(intervals.holds, intervals.all),
             kMostCovered, true},
            {"over_true", "held-out error over the true robot's, median", bench::median(over_true(answers)),
             kMostOverTrue, true}};
}

Report exam_report(const Answers& answers) {
    Report report("gap-exam");
    add_logs(report, answers);
    add_power(report, answers);
    add_misses(report, answers);
    add_wrong(report, answers);
    add_intervals(report, answers);
    add_held_out(report, answers);
    bench::add_aims(report, exam_aims(answers));
    return report;
}

}  // namespace wheelwright::exam
