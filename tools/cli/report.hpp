// The figures of a command, collected once and shown twice: as text for people and as JSON for programs.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace wheelwright::tools {

// A figure. Not finite numbers become null in JSON.
using Cell = std::variant<double, std::int64_t, bool, std::string>;

class Report {
  public:
    // `command` names the report in JSON ("command": ...).
    explicit Report(std::string_view command);

    // Begins a section: a heading for people, an object under `key` for programs.
    void section(std::string_view key, std::string_view heading);

    // One line of the current section. `key` holds the unit, as everywhere ("settling_time_s"); `label` and
    // `unit` are for people, and so is the remark behind them.
    void add(std::string_view key, std::string_view label, Cell value, std::string_view unit = "",
             std::string_view remark = "");

    // A table in the current section: an array of objects for programs.
    struct Column {
        std::string key;    // with unit
        std::string label;  // heading
    };
    void table(std::string_view key, std::vector<Column> columns);
    void row(std::vector<Cell> cells);  // as many as columns; goes to the last table begun

    // The text: headings, aligned labels, numbers with `digits` significant digits.
    std::string text(int digits = 6) const;

    std::string json() const;

    // Prints the text on standard output and, unless `json_path` is empty, writes the JSON file (whole). On
    // failure says so on standard error and returns false.
    bool publish(const std::string& json_path) const;

  private:
    struct Line {
        std::string key, label, unit, remark;
        Cell value;
    };
    struct Table {
        std::string key;
        std::vector<Column> columns;
        std::vector<std::vector<Cell>> rows;
    };
    struct Section {
        std::string key, heading;
        std::vector<Line> lines;
        std::vector<Table> tables;
    };
    std::string command_;
    std::vector<Section> sections_;
};

// Columns a text takes on a terminal: characters of UTF-8, not bytes.
std::size_t text_width(std::string_view text);

// A number with so many significant digits, without trailing noise: "1.40855", "3.2e-05".
std::string number_text(double value, int digits = 6);

// "0.0413 ± 0.0002"; the error is left out where there is none.
std::string with_error(double value, double error);

}  // namespace wheelwright::tools
