#include "tools/report/page.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string_view>
#include <system_error>

#include "firmware/task/write_file.hpp"
#include "tools/report/assets.hpp"
#include "tools/report/decimate.hpp"
#include "tools/report/format.hpp"

namespace wheelwright::report {
namespace {

constexpr std::size_t kDashes = 6;  // page.css and page.js know as many colours and dashes

std::string escape(std::string_view text) {
    std::string out;
    out.reserve(text.size());
    for (const char c : text) {
        switch (c) {
            case '&':
                out += "&amp;";
                break;
            case '<':
                out += "&lt;";
                break;
            case '>':
                out += "&gt;";
                break;
            case '"':
                out += "&quot;";
                break;
            default:
                out += c;
        }
    }
    return out;
}

// A number and its unit stay on one line: the space between them becomes a narrow one that does not break.
std::string with_units_kept(std::string_view text) {
    constexpr std::array<std::string_view, 14> kUnits{"%", "s",   "ms", "m",  "mm",  "cm",    "Nm",
                                                      "N", "kHz", "Hz", "kg", "rad", "rad/s", "m/s"};
    const auto digit = [](char c) { return c >= '0' && c <= '9'; };
    const auto part_of_word = [&digit](char c) {
        return digit(c) || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '/' || (c & 0x80) != 0;
    };
    std::string out;
    for (std::size_t i = 0; i < text.size(); ++i) {
        if (text[i] == ' ' && i > 0 && digit(text[i - 1])) {
            std::size_t end = i + 1;
            while (end < text.size() && (part_of_word(text[end]) || text[end] == '%')) ++end;
            const std::string_view word = text.substr(i + 1, end - i - 1);
            if (std::find(kUnits.begin(), kUnits.end(), word) != kUnits.end()) {
                out += "\u202f";
                continue;
            }
        }
        out += text[i];
    }
    return out;
}

// Running text: escaped, with `code`.
std::string prose(std::string_view text) {
    std::string out;
    bool code = false;
    std::size_t at = 0;
    while (at < text.size()) {
        const std::size_t tick = text.find('`', at);
        const std::string_view piece = text.substr(at, tick == std::string_view::npos ? tick : tick - at);
        out += code ? escape(piece) : escape(with_units_kept(piece));
        if (tick == std::string_view::npos) break;
        if (code || text.find('`', tick + 1) != std::string_view::npos) {
            out += code ? "</code>" : "<code>";
            code = !code;
        } else {
            out += '`';
        }
        at = tick + 1;
    }
    return out;
}

std::string anchor(std::string_view heading, std::size_t number) {
    std::string out = "s" + std::to_string(number) + "-";
    for (const char c : heading) {
        const bool keep = (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9');
        const bool upper = c >= 'A' && c <= 'Z';
        if (keep) {
            out += c;
        } else if (upper) {
            out += static_cast<char>(c - 'A' + 'a');
        } else if (out.back() != '-') {
            out += '-';
        }
    }
    while (out.back() == '-') out.pop_back();
    return out;
}

std::string_view tone_class(Tone tone) {
    switch (tone) {
        case Tone::quiet:
            return "quiet";
        case Tone::good:
            return "good";
        case Tone::bad:
            return "bad";
        case Tone::plain:
            break;
    }
    return "";
}

// A sign before what turned out well or badly, so that colour is not needed to tell.
std::string_view tone_sign(Tone tone) {
    if (tone == Tone::good) return "<span class=\"sign\" aria-hidden=\"true\">\u2713</span> ";
    if (tone == Tone::bad) return "<span class=\"sign\" aria-hidden=\"true\">\u2717</span> ";
    return "";
}

struct Range {
    double low = std::numeric_limits<double>::infinity();
    double high = -std::numeric_limits<double>::infinity();

    void add(double value) {
        if (!std::isfinite(value)) return;
        low = std::min(low, value);
        high = std::max(high, value);
    }
    bool empty() const { return !(low <= high); }
};

// As many digits as can be seen: 1/20000 of the axis, or five significant digits on a logarithmic one.
class Rounding {
  public:
    Rounding(const Range& range, bool logarithmic) {
        if (logarithmic || range.empty()) return;
        const double step = std::max(range.high - range.low, 1e-9 * std::abs(range.high)) / 20000;
        if (step > 0) decimals_ = std::clamp(static_cast<int>(std::ceil(-std::log10(step))), 0, 300);
    }

    nlohmann::json operator()(double value) const {
        if (!std::isfinite(value)) return nullptr;
        std::array<char, 400> text{};
        if (decimals_ >= 0 && std::abs(value) < 1e15) {
            std::snprintf(text.data(), text.size(), "%.*f", decimals_, value);
        } else {
            std::snprintf(text.data(), text.size(), "%.4e", value);
        }
        const double rounded = std::strtod(text.data(), nullptr);
        return rounded == 0 ? nlohmann::json(0) : nlohmann::json(rounded);  // no -0.0
    }

  private:
    int decimals_ = -1;
};

class Writer {
  public:
    explicit Writer(std::size_t points) : points_(points) {}

    void add(std::string_view text) { out_ += text; }
    std::string take() { return std::move(out_); }

    void figures(const std::vector<KeyFigure>& row) {
        if (row.empty()) return;
        out_ += "<dl class=\"figures\">\n";
        for (const KeyFigure& figure : row) {
            out_ += "<div class=\"" + std::string(tone_class(figure.tone)) + "\"><dt>" + prose(figure.label) +
                    "</dt><dd><strong>" + std::string(tone_sign(figure.tone)) + prose(figure.value) +
                    "</strong>";
            if (!figure.remark.empty()) out_ += "<span>" + prose(figure.remark) + "</span>";
            out_ += "</dd></div>\n";
        }
        out_ += "</dl>\n";
    }

    void table(const Table& table) {
        const std::string caption = prose(table.caption);
        // stacked cells are no table cells to a browser: the roles keep them so for a screen reader
        const bool stack = table.stack_when_narrow;
        const auto role = [stack](std::string_view name) {
            return stack ? " role=\"" + std::string(name) + "\"" : std::string();
        };
        out_ += "<div class=\"table\" role=\"region\" tabindex=\"0\" aria-label=\"" + escape(table.caption) +
                "\"><table" + (stack ? " class=\"stack\"" : "") + role("table") + "><caption>" + caption +
                "</caption>\n<thead" + role("rowgroup") + "><tr" + role("row") + ">";
        for (const Column& column : table.columns)
            out_ += "<th scope=\"col\"" + role("columnheader") +
                    std::string(column.numbers ? " class=\"n\"" : "") + ">" + prose(column.heading) + "</th>";
        out_ += "</tr></thead>\n<tbody" + role("rowgroup") + ">\n";
        for (const std::vector<Cell>& row : table.rows) {
            out_ += "<tr" + role("row") + ">";
            for (std::size_t i = 0; i < table.columns.size(); ++i) {
                const Cell cell = i < row.size() ? row[i] : Cell("");
                std::string classes(tone_class(cell.tone));
                if (table.columns[i].numbers) classes += classes.empty() ? "n" : " n";
                std::string attribute = classes.empty() ? "" : " class=\"" + classes + "\"";
                if (stack) attribute += " data-label=\"" + escape(table.columns[i].heading) + "\"";
                attribute += role(i == 0 ? "rowheader" : "cell");
                std::string text = std::string(tone_sign(cell.tone)) + prose(cell.text);
                if (stack) text = "<span>" + text + "</span>";  // beside its label
                out_ += i == 0 ? "<th scope=\"row\"" + attribute + ">" + text + "</th>"
                               : "<td" + attribute + ">" + text + "</td>";
            }
            out_ += "</tr>\n";
        }
        out_ += "</tbody></table></div>\n";
    }

    void chart(const Chart& chart) {
        const std::string id = "chart" + std::to_string(++charts_);
        out_ += "<figure id=\"" + id + "\" class=\"chart" + (chart.equal_aspect ? " path" : "") + "\">\n";
        out_ += "<h3 id=\"" + id + "-title\">" + prose(chart.title);
        if (!chart.origin.empty()) out_ += " <span class=\"origin\">" + prose(chart.origin) + "</span>";
        out_ += "</h3>\n";
        legend(chart);
        out_ += "<div class=\"canvas\"><canvas role=\"img\" aria-label=\"" + escape(chart.summary) +
                "\"></canvas></div>\n";
        if (!chart.caption.empty()) out_ += "<figcaption>" + prose(chart.caption) + "</figcaption>\n";
        in_numbers(chart);
        out_ += "<script type=\"application/json\">" + data(chart) + "</script>\n</figure>\n";
    }

  private:
    void legend(const Chart& chart) {
        if (chart.series.size() + chart.bands.size() + chart.levels.size() < 2) return;
        out_ += "<ul class=\"legend\">";
        std::size_t dataset = 0;
        std::size_t colour = 0;
        for (const Series& series : chart.series) {
            const std::string slot = series.reference ? "ref" : std::to_string(colour++ % kDashes);
            const bool points = series.draw == Draw::points;
            item(dataset++, slot, points ? "<circle cx=\"14\" cy=\"6\" r=\"3.5\"/>" : "<path d=\"M1 6H27\"/>",
                 series.name);
        }
        for (const Band& band : chart.bands)
            item(dataset++, std::to_string(band.like % kDashes) + " area",
                 "<rect x=\"1\" y=\"1\" width=\"26\" height=\"10\"/>", band.name);
        for (const Level& level : chart.levels) item(dataset++, "level", "<path d=\"M1 6H27\"/>", level.name);
        out_ += "</ul>\n";
    }

    void item(std::size_t dataset, const std::string& slot, std::string_view shape, const std::string& name) {
        out_ += "<li><button type=\"button\" aria-pressed=\"true\" data-set=\"" + std::to_string(dataset) +
                "\"><svg class=\"swatch c" + slot +
                "\" width=\"28\" height=\"12\" viewBox=\"0 0 28 12\" aria-hidden=\"true\">" +
                std::string(shape) + "</svg>" + prose(name) + "</button></li>";
    }

    // The chart for who cannot see it, or wants the numbers.
    void in_numbers(const Chart& chart) {
        out_ += "<details><summary>In numbers</summary>\n<p>" + prose(chart.summary) + "</p>\n";
        Table table{.caption = chart.y.label + " of each curve",
                    .columns = {{"curve", false},
                                {"from", true},
                                {"to", true},
                                {"first", true},
                                {"last", true},
                                {"lowest", true},
                                {"highest", true}},
                    .rows = {}};
        for (const Series& series : chart.series) {
            const std::size_t size = std::min(series.x.size(), series.y.size());
            Range x;
            Range y;
            double first = std::numeric_limits<double>::quiet_NaN();
            double last = first;
            for (std::size_t i = 0; i < size; ++i) {
                x.add(series.x[i]);
                y.add(series.y[i]);
                if (!std::isfinite(series.y[i])) continue;
                if (!std::isfinite(first)) first = series.y[i];
                last = series.y[i];
            }
            if (x.empty() || y.empty()) {
                table.rows.push_back({series.name, "no data"});
                continue;
            }
            const auto text = [](double value) { return significant(value, 5); };
            table.rows.push_back(
                {series.name, text(x.low), text(x.high), text(first), text(last), text(y.low), text(y.high)});
        }
        this->table(table);
        out_ += "</details>\n";
    }

    std::string data(const Chart& chart) const {
        using nlohmann::json;
        Range x_range;
        Range y_range;
        for (const Series& series : chart.series) {
            for (const double value : series.x) x_range.add(value);
            for (const double value : series.y) y_range.add(value);
        }
        for (const Band& band : chart.bands) {
            for (const double value : band.low) y_range.add(value);
            for (const double value : band.high) y_range.add(value);
        }
        const auto shown = [](Range& range, const Axis& axis) {
            range.low = axis.minimum.value_or(range.low);
            range.high = axis.maximum.value_or(range.high);
        };
        const Range whole_x = x_range;
        shown(x_range, chart.x);
        shown(y_range, chart.y);
        const Rounding round_x(x_range, chart.x.logarithmic);
        const Rounding round_y(y_range, chart.y.logarithmic);
        const auto values = [](const std::vector<double>& from, const std::vector<std::size_t>& kept,
                               const Rounding& round) {
            json out = json::array();
            for (const std::size_t i : kept) out.push_back(round(from[i]));
            return out;
        };
        const auto axis = [](const Axis& from) {
            json to{{"label", from.label}, {"log", from.logarithmic}};
            if (from.minimum) to["min"] = *from.minimum;
            if (from.maximum) to["max"] = *from.maximum;
            return to;
        };
        json sets = json::array();
        std::size_t colour = 0;
        for (const Series& series : chart.series) {
            const std::vector<std::size_t> kept =
                chart.equal_aspect ? thin_path(series.x, series.y, points_)
                                   : thin_curve(series.x, series.y, points_, chart.x.logarithmic);
            json set{{"name", series.name},
                     {"x", values(series.x, kept, round_x)},
                     {"y", values(series.y, kept, round_y)}};
            if (series.reference) {
                set["ref"] = true;
            } else {
                set["slot"] = colour++ % kDashes;
            }
            if (series.draw == Draw::points) set["points"] = true;
            if (series.draw == Draw::steps) set["steps"] = true;
            sets.push_back(std::move(set));
        }
        json bands = json::array();
        for (const Band& band : chart.bands) {
            // of each part of the width the outermost: the lowest of the low and the highest of the high edge
            const std::vector<std::size_t> low =
                thin_curve(band.x, band.low, points_ / 2, chart.x.logarithmic);
            const std::vector<std::size_t> high =
                thin_curve(band.x, band.high, points_ / 2, chart.x.logarithmic);
            bands.push_back({{"name", band.name},
                             {"slot", band.like % kDashes},
                             {"lowx", values(band.x, low, round_x)},
                             {"low", values(band.low, low, round_y)},
                             {"highx", values(band.x, high, round_x)},
                             {"high", values(band.high, high, round_y)}});
        }
        json levels = json::array();
        for (const Level& level : chart.levels) {
            if (whole_x.empty()) break;
            double from = whole_x.low;
            if (chart.x.logarithmic && from <= 0) {
                from = whole_x.high;
                for (const Series& series : chart.series)
                    for (const double value : series.x)
                        if (value > 0) from = std::min(from, value);
            }
            levels.push_back({{"name", level.name},
                              {"y", level.y},
                              {"from", chart.x.minimum.value_or(from)},
                              {"to", chart.x.maximum.value_or(whole_x.high)}});
        }
        json marks = json::array();
        for (const Mark& mark : chart.marks) marks.push_back({{"name", mark.name}, {"x", mark.x}});
        const json all{{"x", axis(chart.x)}, {"y", axis(chart.y)}, {"equal", chart.equal_aspect},
                       {"sets", sets},       {"bands", bands},     {"levels", levels},
                       {"marks", marks}};
        // "<" would end or open an element of the page; errors in the encoding become a replacement sign
        std::string out;
        for (const char c : all.dump(-1, ' ', false, json::error_handler_t::replace)) {
            if (c == '<') {
                out += "\\u003c";
            } else {
                out += c;
            }
        }
        return out;
    }

    std::string out_;
    std::size_t points_;
    std::size_t charts_ = 0;
};

}  // namespace

Section& Section::text(std::string paragraph) {
    blocks_.emplace_back(Text{std::move(paragraph)});
    return *this;
}

Section& Section::note(Tone tone, std::string paragraph) {
    blocks_.emplace_back(Note{tone, std::move(paragraph)});
    return *this;
}

Section& Section::list(std::vector<std::string> items) {
    blocks_.emplace_back(List{std::move(items)});
    return *this;
}

Section& Section::table(Table table) {
    blocks_.emplace_back(std::move(table));
    return *this;
}

Section& Section::chart(Chart chart) {
    std::vector<Chart> row;
    row.push_back(std::move(chart));
    return charts(std::move(row));
}

Section& Section::charts(std::vector<Chart> row) {
    blocks_.emplace_back(Charts{std::move(row)});
    return *this;
}

Section& Section::figures(std::vector<KeyFigure> row) {
    blocks_.emplace_back(Figures{std::move(row)});
    return *this;
}

Section& Page::section(std::string heading) {
    sections_.emplace_back().heading_ = std::move(heading);
    return sections_.back();
}

std::string Page::html() const {
    Writer out(points_);
    out.add(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src "
        "'unsafe-inline'; "
        "script-src 'unsafe-inline'; img-src data:\">\n"
        "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
        "<meta name=\"color-scheme\" content=\"light dark\">\n"
        "<link rel=\"icon\" href=\"data:,\">\n");
    out.add("<title>" + escape(title_) + "</title>\n<style>\n");
    out.add(assets::page_css);
    out.add("</style>\n</head>\n<body>\n");
    if (sections_.size() > 2) {
        out.add("<nav aria-label=\"Contents\"><details open><summary>Contents</summary><ol>");
        for (std::size_t i = 0; i < sections_.size(); ++i) {
            out.add("<li><a href=\"#" + anchor(sections_[i].heading_, i + 1) + "\">" +
                    prose(sections_[i].heading_) + "</a></li>");
        }
        out.add("</ol></details></nav>\n");
    }
    out.add("<main>\n<header>\n<h1>" + prose(title_) + "</h1>\n<p class=\"lead\">" + prose(lead_) + "</p>\n");
    out.figures(figures_);
    out.add(
        "<noscript><p class=\"note bad\">The charts need JavaScript; the numbers stand in the "
        "text.</p></noscript>\n</header>\n");
    for (std::size_t i = 0; i < sections_.size(); ++i) {
        const Section& section = sections_[i];
        const std::string id = anchor(section.heading_, i + 1);
        out.add("<section aria-labelledby=\"" + id + "\">\n<h2 id=\"" + id + "\">" + prose(section.heading_) +
                "</h2>\n");
        for (const Section::Block& block : section.blocks_) {
            if (const auto* text = std::get_if<Section::Text>(&block)) {
                out.add("<p>" + prose(text->paragraph) + "</p>\n");
            } else if (const auto* note = std::get_if<Section::Note>(&block)) {
                out.add("<p class=\"note " + std::string(tone_class(note->tone)) + "\">" +
                        std::string(tone_sign(note->tone)) + prose(note->paragraph) + "</p>\n");
            } else if (const auto* list = std::get_if<Section::List>(&block)) {
                out.add("<ul>");
                for (const std::string& item : list->items) out.add("<li>" + prose(item) + "</li>\n");
                out.add("</ul>\n");
            } else if (const auto* table = std::get_if<Table>(&block)) {
                out.table(*table);
            } else if (const auto* charts = std::get_if<Section::Charts>(&block)) {
                out.add(charts->row.size() > 1 ? "<div class=\"row\">\n" : "<div>\n");
                for (const Chart& chart : charts->row) out.chart(chart);
                out.add("</div>\n");
            } else if (const auto* figures = std::get_if<Section::Figures>(&block)) {
                out.figures(figures->row);
            }
        }
        out.add("</section>\n");
    }
    out.add("<footer>");
    if (!footer_.empty()) out.add("<p>" + prose(footer_) + "</p>");
    out.add(
        "<p>Charts: Chart.js 3.9.1 (MIT licence), part of this file. The page loads nothing.</p></footer>\n");
    out.add("</main>\n<script>\n");
    out.add(assets::chart_js);
    out.add("\n</script>\n<script>\n");
    out.add(assets::page_js);
    out.add("</script>\n</body>\n</html>\n");
    return out.take();
}

void Page::write(const std::filesystem::path& file) const {
    std::string failed;
    std::error_code error;
    if (file.has_parent_path()) std::filesystem::create_directories(file.parent_path(), error);
    if (error) {
        failed = "cannot make the folder " + file.parent_path().string() + ": " + error.message();
    } else {
        failed = task::write_whole_file(file.string(), html());
    }
    if (!failed.empty()) throw std::runtime_error(failed);
}

}  // namespace wheelwright::report
