// A report as one HTML file that needs nothing else: no network, no other file, no server. Text, tables and
// charts (Chart.js, inlined), light and dark by the reader's setting, from a phone's width to a printed
// sheet.
//
//   Page page("Figure-8", "What the robot did.");
//   Section& s = page.section("Tracking");
//   s.text("The error stays below `5 mm`.");
//   s.chart({.title = "Error", .x = {"time / s"}, .y = {"error / mm"}, .series = {{"ours", t, e}}, ...});
//   page.write("report/index.html");
//
// All texts are plain UTF-8 and are escaped; `back ticks` set code. The same content gives the same bytes.
// Not thread-safe; throws std::runtime_error where it says so and nothing else but std::bad_alloc.
#pragma once

#include <cstddef>
#include <deque>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace wheelwright::report {

// How something turned out. Shown by colour, weight and a word or sign: never by colour alone.
enum class Tone { plain, quiet, good, bad };

struct Cell {
    std::string text;
    Tone tone = Tone::plain;

    Cell(std::string text_, Tone tone_ = Tone::plain) : text(std::move(text_)), tone(tone_) {}  // NOLINT
    Cell(const char* text_, Tone tone_ = Tone::plain) : text(text_), tone(tone_) {}             // NOLINT
};

struct Column {
    std::string heading;   // with the unit: "error / mm"
    bool numbers = false;  // set flush right in figures of one width
};

// The first column names the row. A row may be shorter than `columns`: the rest stays empty.
struct Table {
    std::string caption;
    std::vector<Column> columns;
    std::vector<std::vector<Cell>> rows;
    bool stack_when_narrow = false;  // for tables of words: on a phone each row becomes a small list
};

// A number worth a large type.
struct KeyFigure {
    std::string label;
    std::string value;  // with its unit
    std::string remark;
    Tone tone = Tone::plain;
};

enum class Draw { line, points, steps };

// Points where x or y is not finite break the line. x and y are of one length; the longer one is cut.
struct Series {
    std::string name;
    std::vector<double> x;
    std::vector<double> y;
    Draw draw = Draw::line;
    bool reference = false;  // drawn in ink, dashed, behind the others: set-points, true values, the paper's
};

// The area between two curves, in the colour of the series of that number (0 is the first).
struct Band {
    std::string name;
    std::vector<double> x;
    std::vector<double> low;
    std::vector<double> high;
    std::size_t like = 0;
};

struct Level {  // horizontal line
    std::string name;
    double y = 0;
};

struct Mark {  // vertical line with its name
    std::string name;
    double x = 0;
};

struct Axis {
    std::string label;  // with the unit: "time / s"
    bool logarithmic = false;
    std::optional<double> minimum = {};  // else from the data
    std::optional<double> maximum = {};
};

struct Chart {
    std::string title;
    Axis x;
    Axis y;
    std::vector<Series> series;
    std::vector<Band> bands = {};
    std::vector<Level> levels = {};
    std::vector<Mark> marks = {};
    bool equal_aspect = false;  // one metre is as long across as up: for paths
    std::string caption;        // below the chart: what to see
    std::string summary;        // for who cannot see it: what it shows, with its numbers; must not be empty
    std::string origin = {};    // how the data came about, as a label: "through CAN"
};

class Section {
  public:
    Section& text(std::string paragraph);
    Section& note(Tone tone, std::string paragraph);  // set apart
    Section& list(std::vector<std::string> items);
    Section& table(Table table);
    Section& chart(Chart chart);
    Section& charts(std::vector<Chart> row);  // side by side where there is room
    Section& figures(std::vector<KeyFigure> row);

  private:
    friend class Page;
    struct Text {
        std::string paragraph;
    };
    struct Note {
        Tone tone;
        std::string paragraph;
    };
    struct List {
        std::vector<std::string> items;
    };
    struct Charts {
        std::vector<Chart> row;
    };
    struct Figures {
        std::vector<KeyFigure> row;
    };
    using Block = std::variant<Text, Note, List, Table, Charts, Figures>;

    std::string heading_;
    std::vector<Block> blocks_;
};

class Page {
  public:
    Page(std::string title, std::string lead) : title_(std::move(title)), lead_(std::move(lead)) {}

    // Shown large below the title, before the first section.
    void figures(std::vector<KeyFigure> row) { figures_ = std::move(row); }

    // The reference stays good while the page lives.
    Section& section(std::string heading);

    // How the page was made: the command, versions. Last on the page.
    void footer(std::string text) { footer_ = std::move(text); }

    // Points that one series may have on the page; longer ones are thinned (decimate.hpp).
    void set_points_per_series(std::size_t points) { points_ = points; }

    std::string html() const;

    // Writes the file whole and makes its folder where needed. Throws std::runtime_error with path and cause.
    void write(const std::filesystem::path& file) const;

  private:
    std::string title_;
    std::string lead_;
    std::string footer_;
    std::vector<KeyFigure> figures_;
    std::deque<Section> sections_;
    std::size_t points_ = 1200;
};

}  // namespace wheelwright::report
