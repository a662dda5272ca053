#include "tools/gap_trials/trials_report.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <set>

#include "tools/report/format.hpp"
#include "tools/report/page.hpp"

namespace wheelwright::tools {
namespace {

constexpr double kMostExcluded = 0.15;
constexpr std::size_t kWorstCells = 12;
constexpr std::size_t kMostTrialsShown = 60;

std::string of(std::size_t hits, std::size_t n) {
    return n == 0 ? std::string("-") : std::to_string(hits) + "/" + std::to_string(n);
}

std::string judgement(const Measure& m) {
    if (!m.value) return "not measured";
    if (*m.aimed()) return "aim reached";
    return *m.accepted() ? "accepted" : "MISSED";
}

std::string value_text(const Measure& m) { return m.value ? number_text(*m.value, 3) + " " + m.unit : "-"; }

std::string interval_text(const Measure& m) {
    if (!m.interval) return "-";
    return number_text(m.interval->first, 3) + " to " + number_text(m.interval->second, 3);
}

std::string level_text(const Measure& m, double level) {
    return (m.smaller_is_better ? "<= " : ">= ") + number_text(level, 3);
}

struct EffectRow {
    std::map<std::string, std::pair<std::size_t, std::size_t>> sizes;
    std::size_t excluded = 0;
    std::size_t n = 0;
};

std::map<std::string, EffectRow> effect_rows(const Summary& summary) {
    std::map<std::string, EffectRow> rows;
    for (const TrialCell& cell : summary.cells) {
        auto& [hits, n] = rows[cell.effect].sizes[cell.size];
        hits += cell.hits;
        n += cell.n;
    }
    for (const Excluded& out : summary.excluded) {
        rows[out.effect].excluded = out.count;
        rows[out.effect].n = out.n;
    }
    return rows;
}

std::vector<TrialCell> worst_cells(const Summary& summary) {
    std::vector<TrialCell> cells;
    for (const TrialCell& cell : summary.cells) {
        if (cell.n > 0 && cell.hits < cell.n) cells.push_back(cell);
    }
    std::stable_sort(cells.begin(), cells.end(),
                     [](const TrialCell& a, const TrialCell& b) { return a.hits * b.n < b.hits * a.n; });
    if (cells.size() > kWorstCells) cells.resize(kWorstCells);
    return cells;
}

}  // namespace

bool all_accepted(const Summary& summary) {
    const bool measures = std::all_of(summary.measures.begin(), summary.measures.end(),
                                      [](const Measure& m) { return m.accepted().value_or(true); });
    // of an effect tried only a few times one excluded case is no share
    const bool excluded =
        std::none_of(summary.excluded.begin(), summary.excluded.end(), [](const Excluded& e) {
            return e.n >= 20 && static_cast<double>(e.count) > kMostExcluded * static_cast<double>(e.n);
        });
    return measures && excluded && summary.unanswered == 0;
}

Report trials_report(const Summary& summary, const TrialsRun& run, const PlantSummaries& by_plant) {
    Report report("gap-trials");
    report.section("run", "Blind trials");
    report.add("what", "trials", run.what);
    report.add("seed", "seed", static_cast<std::int64_t>(run.seed));
    std::size_t done = 0;
    for (const auto& [kind, count] : summary.kinds) done += count;
    report.add("listed", "in the list", static_cast<std::int64_t>(run.listed));
    report.add("done", "done", static_cast<std::int64_t>(done));
    for (const auto& [kind, count] : summary.kinds) {
        report.add("kind_" + kind, "  " + kind, static_cast<std::int64_t>(count));
    }
    report.add("unanswered", "without an answer", static_cast<std::int64_t>(summary.unanswered));
    report.add("wrong_names", "confident wrong names", static_cast<std::int64_t>(summary.wrong_names));
    report.add("seconds", "processor time of an analysis, mean", summary.seconds, "s");
    report.add("memory_MiB", "memory of an analysis, most", summary.memory_bytes / (1024 * 1024), "MiB");

    report.section("measures", "Measures");
    report.table("measures", {{"id", "id"},
                              {"meaning", "meaning"},
                              {"shown", "value"},
                              {"count", "of"},
                              {"interval", "95 % interval"},
                              {"accept", "accept"},
                              {"aim", "aim"},
                              {"judgement", "judgement"},
                              {"remark", "remark"}});
    for (const Measure& m : summary.measures) {
        report.row({m.id, m.meaning, value_text(m), m.interval ? of(m.hits, m.n) : std::to_string(m.n),
                    interval_text(m), level_text(m, m.accept), level_text(m, m.aim), judgement(m), m.remark});
    }

    if (!by_plant.empty()) {
        report.section("plants", "Plant by plant");
        report.table("plants", {{"plant", "plant"},
                                {"id", "id"},
                                {"meaning", "meaning"},
                                {"shown", "value"},
                                {"count", "of"},
                                {"judgement", "judgement"}});
        for (const auto& [plant, one] : by_plant) {
            for (const Measure& m : one.measures) {
                report.row({plant, m.id, m.meaning, value_text(m),
                            m.interval ? of(m.hits, m.n) : std::to_string(m.n), judgement(m)});
            }
        }
    }

    report.section("sure_and_wrong", "Sure and wrong: a name that is not hidden, the hidden one no rival");
    report.table("trials", {{"id", "log"},
                            {"plant", "plant"},
                            {"kind", "kind"},
                            {"hidden", "hidden"},
                            {"said", "named"},
                            {"conditions", "conditions"}});
    for (const TrialLine& t : summary.trials) {
        if (t.sure_and_wrong) report.row({t.id, t.plant, t.kind, t.hidden, t.said, t.conditions});
    }

    report.section("effects",
                   "Single effects named exactly, by size; excluded: the oracle calls them not identifiable");
    report.table("effects", {{"effect", "effect"},
                             {"mild", "mild"},
                             {"medium", "medium"},
                             {"strong", "strong"},
                             {"excluded", "excluded"},
                             {"confused_with", "confused with"}});
    std::map<std::string, std::string> rivals;
    for (const Excluded& out : summary.excluded) rivals[out.effect] = out.rivals;
    for (const auto& [effect, row] : effect_rows(summary)) {
        const auto cell = [&](const char* size) {
            const auto found = row.sizes.find(size);
            return found == row.sizes.end() ? std::string("-")
                                            : of(found->second.first, found->second.second);
        };
        report.row(
            {effect, cell("mild"), cell("medium"), cell("strong"), of(row.excluded, row.n), rivals[effect]});
    }

    report.section("methods", "Beside others, on the same logs: named exactly, and alarms");
    report.table("methods", {{"method", "analysis"},
                             {"single", "single, medium and strong"},
                             {"expressible", "of these PySINDy has terms for"},
                             {"mild", "mild"},
                             {"pairs", "pairs"},
                             {"alarms", "alarms with nothing hidden"},
                             {"wrong", "confident wrong names"},
                             {"seconds", "processor time, s"}});
    for (const MethodRow& row : summary.methods) {
        if (!row.measured) {
            report.row({row.name, "not measured", "", "", "", "", "", ""});
            continue;
        }
        const auto cell = [](const Share& share) { return of(share.hits, share.n); };
        report.row({row.name, cell(row.single), cell(row.expressible), cell(row.mild), cell(row.pairs),
                    cell(row.alarms), cell(row.wrong), number_text(row.seconds, 3)});
    }

    if (!summary.held_out.empty()) {
        report.section("held_out", "Effects held out of the library: what was said instead");
        report.table("held_out", {{"hidden", "hidden"},
                                  {"size", "size"},
                                  {"said", "said"},
                                  {"where", "where"},
                                  {"judgement", "judgement"},
                                  {"id", "trial"}});
        for (const HeldOut& one : summary.held_out)
            report.row({one.hidden, one.size, one.said, one.where, one.judgement, one.id});
    }

    report.section("worst", "Worst cells");
    report.table("cells", {{"effect", "effect"}, {"size", "size"}, {"noise", "noise"}, {"exact", "exact"}});
    for (const TrialCell& cell : worst_cells(summary)) {
        report.row({cell.effect, cell.size, cell.noise, of(cell.hits, cell.n)});
    }

    report.section("confusion", "What was said of what (right answers too)");
    report.table("confusion", {{"hidden", "hidden"}, {"said", "said"}, {"count", "times"}});
    std::vector<Confusion> confusions = summary.confusions;
    std::stable_sort(confusions.begin(), confusions.end(), [](const Confusion& a, const Confusion& b) {
        return a.hidden != b.hidden ? a.hidden < b.hidden : a.count > b.count;
    });
    for (const Confusion& c : confusions) report.row({c.hidden, c.said, static_cast<std::int64_t>(c.count)});

    if (summary.trials.size() <= kMostTrialsShown) {
        report.section("trials", "Trial by trial");
        report.table("trials", {{"kind", "kind"},
                                {"hidden", "hidden"},
                                {"said", "said"},
                                {"judgement", "judgement"},
                                {"plant", "plant"},
                                {"id", "trial"},
                                {"conditions", "size, noise, rate, motions"}});
        for (const TrialLine& trial : summary.trials) {
            report.row({trial.kind, trial.hidden, trial.said, trial.judgement, trial.plant, trial.id,
                        trial.conditions});
        }
    }
    return report;
}

void write_trials_page(const Summary& summary, const TrialsRun& run, const std::string& path) {
    report::Page page(
        "Blind trials of the gap analysis",
        "Robots with a hidden effect were driven, their logs analysed by a process that saw nothing "
        "else, and the answers compared with what had been hidden.");
    std::size_t done = 0;
    for (const auto& [kind, count] : summary.kinds) done += count;
    std::vector<report::KeyFigure> key;
    for (const Measure& m : summary.measures) {
        if (m.id != "A1" && m.id != "A5" && m.id != "A8") continue;
        const auto accepted = m.accepted();
        key.push_back(
            {m.meaning, value_text(m), of(m.hits, m.n),
             accepted ? (*accepted ? report::Tone::good : report::Tone::bad) : report::Tone::quiet});
    }
    page.figures(key);

    report::Section& measures = page.section("Measures");
    report::Table table;
    table.caption = run.what + ", seed " + std::to_string(run.seed) + ": " + std::to_string(done) + " of " +
                    std::to_string(run.listed) + " trials.";
    table.columns = {{"measure"},       {"meaning"}, {"value", true}, {"of", true},
                     {"95 % interval"}, {"accept"},  {"aim"},         {"judgement"}};
    table.stack_when_narrow = true;
    for (const Measure& m : summary.measures) {
        const auto accepted = m.accepted();
        const report::Tone tone =
            accepted ? (*accepted ? report::Tone::good : report::Tone::bad) : report::Tone::quiet;
        table.rows.push_back({m.id,
                              m.remark.empty() ? m.meaning : m.meaning + " (" + m.remark + ")",
                              value_text(m),
                              m.interval ? of(m.hits, m.n) : std::to_string(m.n),
                              interval_text(m),
                              level_text(m, m.accept),
                              level_text(m, m.aim),
                              {judgement(m), tone}});
    }
    measures.table(std::move(table));

    report::Section& effects = page.section("Effect by effect");
    effects.text(
        "How often a single effect was named exactly, by size. Excluded are cases in which noise-free data, "
        "by formulas of their own, do not tell the effect from a rival; at most 15 % of each effect may be.");
    report::Table by_effect;
    by_effect.columns = {{"effect"}, {"mild", true}, {"medium", true}, {"strong", true}, {"excluded", true}};
    for (const auto& [effect, row] : effect_rows(summary)) {
        std::vector<report::Cell> cells{effect};
        for (const char* size : {"mild", "medium", "strong"}) {
            const auto found = row.sizes.find(size);
            const auto [hits, n] =
                found == row.sizes.end() ? std::pair<std::size_t, std::size_t>{} : found->second;
            cells.emplace_back(
                of(hits, n), n == 0 ? report::Tone::quiet
                                    : (hits == n ? report::Tone::good
                                                 : (2 * hits < n ? report::Tone::bad : report::Tone::plain)));
        }
        cells.emplace_back(
            of(row.excluded, row.n),
            row.n >= 20 && static_cast<double>(row.excluded) > kMostExcluded * static_cast<double>(row.n)
                ? report::Tone::bad
                : report::Tone::plain);
        by_effect.rows.push_back(std::move(cells));
    }
    effects.table(std::move(by_effect));

    if (!summary.held_out.empty()) {
        report::Section& unknown = page.section("Effects held out of the library");
        unknown.text(
            "What was said by an analysis that did not know the hidden effect. Right is: unexplained, and a "
            "place "
            "that tells of it.");
        report::Table lines;
        lines.columns = {{"hidden"}, {"size"}, {"said"}, {"where"}, {"judgement"}};
        lines.stack_when_narrow = true;
        for (const HeldOut& one : summary.held_out) {
            const bool counted = one.judgement.rfind("not counted", 0) != 0;
            const report::Tone tone = !counted                   ? report::Tone::quiet
                                      : one.judgement == "right" ? report::Tone::good
                                                                 : report::Tone::bad;
            lines.rows.push_back({one.hidden, one.size, one.said, one.where, {one.judgement, tone}});
        }
        unknown.table(std::move(lines));
    }

    report::Section& confusion = page.section("What was said of what");
    report::Table said;
    said.columns = {{"hidden"}, {"said"}, {"times", true}};
    for (const Confusion& c : summary.confusions) {
        const bool right = c.hidden == c.said || (c.hidden == "nothing" && c.said == "nothing_missing");
        said.rows.push_back(
            {c.hidden, {c.said, right ? report::Tone::good : report::Tone::plain}, std::to_string(c.count)});
    }
    confusion.table(std::move(said));
    page.footer("wheelwright gap-trials, seed " + std::to_string(run.seed));
    page.write(path);
}

}  // namespace wheelwright::tools
