#include "tools/cli/report.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

#include "firmware/task/write_file.hpp"

namespace wheelwright::tools {
namespace {

std::string cell_text(const Cell& cell, int digits) {
    if (const double* real = std::get_if<double>(&cell)) return number_text(*real, digits);
    if (const auto* integer = std::get_if<std::int64_t>(&cell)) return std::to_string(*integer);
    if (const bool* truth = std::get_if<bool>(&cell)) return *truth ? "yes" : "no";
    return std::get<std::string>(cell);
}

bool is_number(const Cell& cell) {
    return std::holds_alternative<double>(cell) || std::holds_alternative<std::int64_t>(cell);
}

nlohmann::ordered_json cell_json(const Cell& cell) {
    return std::visit([](const auto& value) { return nlohmann::ordered_json(value); }, cell);
}

std::string padding(std::size_t width, std::size_t used) {
    return std::string(width > used ? width - used : 0, ' ');
}

}  // namespace

std::size_t text_width(std::string_view text) {
    return static_cast<std::size_t>(std::count_if(
        text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U; }));
}

std::string number_text(double value, int digits) {
    std::array<char, 48> buffer{};
    std::snprintf(buffer.data(), buffer.size(), "%.*g", digits, value);
    return buffer.data();
}

std::string with_error(double value, double error) {
    std::string text = number_text(value, 5);
    if (error > 0) text += " ± " + number_text(error, 2);
    return text;
}

Report::Report(std::string_view command) : command_(command) {}

void Report::section(std::string_view key, std::string_view heading) {
    sections_.push_back({std::string(key), std::string(heading), {}, {}});
}

void Report::add(std::string_view key, std::string_view label, Cell value, std::string_view unit,
                 std::string_view remark) {
    if (sections_.empty()) section("result", "");
    sections_.back().lines.push_back(
        {std::string(key), std::string(label), std::string(unit), std::string(remark), std::move(value)});
}

void Report::table(std::string_view key, std::vector<Column> columns) {
    if (sections_.empty()) section("result", "");
    sections_.back().tables.push_back({std::string(key), std::move(columns), {}});
}

void Report::row(std::vector<Cell> cells) {
    if (sections_.empty() || sections_.back().tables.empty()) return;
    Table& table = sections_.back().tables.back();
    cells.resize(table.columns.size());
    table.rows.push_back(std::move(cells));
}

std::string Report::text(int digits) const {
    std::string out;
    for (const Section& section : sections_) {
        const bool empty =
            section.lines.empty() && std::all_of(section.tables.begin(), section.tables.end(),
                                                 [](const Table& table) { return table.rows.empty(); });
        if (empty) continue;
        if (!out.empty()) out += '\n';
        if (!section.heading.empty()) out += section.heading + '\n';
        const std::string indent = section.heading.empty() ? "" : "  ";
        std::size_t labels = 0;
        std::size_t values = 0;
        for (const Line& line : section.lines) {
            labels = std::max(labels, text_width(line.label));
            if (is_number(line.value)) values = std::max(values, text_width(cell_text(line.value, digits)));
        }
        for (const Line& line : section.lines) {
            const std::string value = cell_text(line.value, digits);
            std::string row = indent + line.label + padding(labels, text_width(line.label)) + "  ";
            if (is_number(line.value)) row += padding(values, text_width(value));
            row += value;
            if (!line.unit.empty()) row.append(" ").append(line.unit);
            if (!line.remark.empty()) row.append("  (").append(line.remark).append(")");
            out += row + '\n';
        }
        for (const Table& table : section.tables) {
            if (table.rows.empty()) continue;
            if (!section.lines.empty() || &table != &section.tables.front()) out += '\n';
            std::vector<std::size_t> widths;
            for (std::size_t c = 0; c < table.columns.size(); ++c) {
                std::size_t width = text_width(table.columns[c].label);
                for (const auto& cells : table.rows) {
                    width = std::max(width, text_width(cell_text(cells[c], digits)));
                }
                widths.push_back(width);
            }
            std::vector<bool> right(table.columns.size(), false);
            for (std::size_t c = 0; c < table.columns.size(); ++c) {
                right[c] = !table.rows.empty() && is_number(table.rows.front()[c]);
            }
            const auto write = [&](std::size_t c, const std::string& cell, std::string& row) {
                if (c > 0) row += "  ";
                const std::string space = padding(widths[c], text_width(cell));
                row += right[c] ? space + cell : cell + space;
            };
            const auto finish = [&](std::string& row) {
                row.erase(row.find_last_not_of(' ') + 1);
                out += row + '\n';
            };
            std::string head = indent;
            for (std::size_t c = 0; c < table.columns.size(); ++c) write(c, table.columns[c].label, head);
            finish(head);
            for (const auto& cells : table.rows) {
                std::string row = indent;
                for (std::size_t c = 0; c < cells.size(); ++c) write(c, cell_text(cells[c], digits), row);
                finish(row);
            }
        }
    }
    return out;
}

std::string Report::json() const {
    nlohmann::ordered_json root;
    root["command"] = command_;
    for (const Section& section : sections_) {
        nlohmann::ordered_json& object = root[section.key];
        if (object.is_null()) object = nlohmann::ordered_json::object();
        for (const Line& line : section.lines) object[line.key] = cell_json(line.value);
        for (const Table& table : section.tables) {
            nlohmann::ordered_json rows = nlohmann::ordered_json::array();
            for (const auto& cells : table.rows) {
                nlohmann::ordered_json row;
                for (std::size_t c = 0; c < cells.size(); ++c) {
                    row[table.columns[c].key] = cell_json(cells[c]);
                }
                rows.push_back(std::move(row));
            }
            object[table.key] = std::move(rows);
        }
    }
    // Text that is not UTF-8 (a file's name, say) must not end the program.
    return root.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

bool Report::publish(const std::string& json_path) const {
    std::fputs(text().c_str(), stdout);
    std::fflush(stdout);
    if (json_path.empty()) return true;
    const std::string failed = task::write_whole_file(json_path, json());
    if (!failed.empty()) std::fprintf(stderr, "wheelwright: %s\n", failed.c_str());
    return failed.empty();
}

}  // namespace wheelwright::tools
