// The writing half of robot_file.hpp. A value is replaced where toml++ says it stands, and a comment behind
// it becomes a note of the former value; everything else is copied byte for byte, and the outcome is parsed
// again before anybody gets it.
#include <algorithm>
#include <charconv>
#include <cmath>

#include "firmware/task/robot_file.hpp"
#include "firmware/task/robot_file_toml.hpp"
#include "firmware/task/write_file.hpp"

namespace wheelwright::task {
namespace {

std::vector<std::string> split_key(std::string_view key) {
    std::vector<std::string> parts;
    while (true) {
        const std::size_t dot = key.find('.');
        parts.emplace_back(key.substr(0, dot));
        if (dot == std::string_view::npos) return parts;
        key.remove_prefix(dot + 1);
    }
}

std::string join_from(const std::vector<std::string>& parts, std::size_t from, std::size_t to) {
    std::string text;
    for (std::size_t i = from; i < to; ++i) text += (i > from ? "." : "") + parts[i];
    return text;
}

bool is_bare_key(std::string_view part) {
    return !part.empty() && std::all_of(part.begin(), part.end(), [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
               c == '-';
    });
}

std::string quoted(const std::string& text) {
    std::string result = "\"";
    for (const char c : text) {
        const auto code = static_cast<unsigned char>(c);
        if (c == '"' || c == '\\') {
            result += '\\';
            result += c;
        } else if (code < 0x20 || code == 0x7F) {
            constexpr std::string_view digits = "0123456789ABCDEF";
            result += "\\u00";
            result += digits[code >> 4U];
            result += digits[code & 15U];
        } else {
            result += c;
        }
    }
    return result + "\"";
}

std::string toml_text(const FileValue& value) {
    if (const double* real = std::get_if<double>(&value)) return shortest_number(*real);
    if (const auto* integer = std::get_if<std::int64_t>(&value)) return std::to_string(*integer);
    if (const bool* truth = std::get_if<bool>(&value)) return *truth ? "true" : "false";
    return quoted(std::get<std::string>(value));
}

// Whether the node already holds this value; a whole number counts as the real it stands for.
bool holds(const toml::node& node, const FileValue& value) {
    if (const double* real = std::get_if<double>(&value)) {
        if (node.is_integer()) return static_cast<double>(node.as_integer()->get()) == *real;
        return node.is_floating_point() && node.as_floating_point()->get() == *real;
    }
    if (const auto* integer = std::get_if<std::int64_t>(&value)) {
        return node.is_integer() && node.as_integer()->get() == *integer;
    }
    if (const bool* truth = std::get_if<bool>(&value)) {
        return node.is_boolean() && node.as_boolean()->get() == *truth;
    }
    return node.is_string() && node.as_string()->get() == std::get<std::string>(value);
}

// Sets the value in a parsed document, making tables on the way: what the edited text must parse to.
void assign(toml::table& root, const std::vector<std::string>& parts, const FileValue& value) {
    toml::table* table = &root;
    for (std::size_t i = 0; i + 1 < parts.size(); ++i) {
        if (table->get(parts[i]) == nullptr) table->insert(parts[i], toml::table{});
        table = table->get(parts[i])->as_table();
        if (table == nullptr) return;
    }
    std::visit([&](const auto& v) { table->insert_or_assign(parts.back(), v); }, value);
}

class Editor {
  public:
    explicit Editor(std::string_view text) : text_(text) {}

    // "" when done, else why not.
    std::string set(const FileChange& change) {
        if (const double* real = std::get_if<double>(&change.value)) {
            if (!std::isfinite(*real)) return change.key + ": not a finite number";
        }
        const std::vector<std::string> parts = split_key(change.key);
        if (parts.size() < 2 || !std::all_of(parts.begin(), parts.end(), is_bare_key)) {
            return change.key + ": not a dotted key of a table";
        }
        toml::parse_result parsed = toml::parse(text_);
        if (!parsed) {
            return "line " + std::to_string(parsed.error().source().begin.line) + ": " +
                   std::string(parsed.error().description());
        }
        const std::string before = text_;
        index_lines();
        std::string failed = place(parsed.table(), parts, change.value);
        if (failed.empty() && text_ == before) return "";  // it says so already
        if (failed.empty()) {
            toml::parse_result after = toml::parse(text_);
            toml::table wanted(parsed.table());
            assign(wanted, parts, change.value);
            if (!after || after.table() != wanted) failed = "the file's form does not allow to set this key";
        }
        if (failed.empty()) return "";
        text_ = before;
        return change.key + ": " + failed;
    }

    std::string take() { return std::move(text_); }

  private:
    void index_lines() {
        lines_.assign(1, 0);
        for (std::size_t i = 0; i < text_.size(); ++i) {
            if (text_[i] == '\n') lines_.push_back(i + 1);
        }
        newline_ = text_.find("\r\n") != std::string::npos ? "\r\n" : "\n";
        // toml++ does not count a byte order mark
        first_ = text_.starts_with("\xEF\xBB\xBF") ? 3 : 0;
    }

    // Byte offset of a toml++ position, whose columns count characters.
    std::size_t offset(const toml::source_position& at) const {
        if (at.line == 0 || at.line > lines_.size()) return text_.size();
        std::size_t byte = lines_[at.line - 1];
        if (at.line == 1) byte += first_;
        for (std::uint32_t column = 1; column < at.column && byte < text_.size(); ++column) {
            ++byte;
            while (byte < text_.size() && (static_cast<unsigned char>(text_[byte]) & 0xC0U) == 0x80U) ++byte;
        }
        return byte;
    }

    // Byte after the newline of the line that holds byte `at`.
    std::size_t line_after(std::size_t at) const {
        const std::size_t end = text_.find('\n', at);
        return end == std::string::npos ? text_.size() : end + 1;
    }

    void insert_line(std::size_t at, const std::string& line) {
        std::string added = line + newline_;
        if (at > 0 && text_[at - 1] != '\n') added = newline_ + line;
        text_.insert(at, added);
    }

    std::string place(const toml::table& root, const std::vector<std::string>& parts,
                      const FileValue& value) {
        const toml::table* table = &root;
        const toml::table* inline_table = nullptr;
        std::size_t inline_depth = 0;
        std::size_t depth = 0;
        for (; depth + 1 < parts.size(); ++depth) {
            const toml::node* child = table->get(parts[depth]);
            if (child == nullptr) break;
            if (!child->is_table()) return join_from(parts, 0, depth + 1) + " is not a table";
            table = child->as_table();
            if (table->is_inline()) {
                inline_table = table;
                inline_depth = depth + 1;
            }
        }
        const bool parent_exists = depth + 1 == parts.size();
        if (parent_exists) {
            if (const toml::node* old = table->get(parts.back())) return replace(*old, value);
        }
        const std::string text = toml_text(value);
        if (inline_table != nullptr) {
            return insert_inline(*inline_table, join_from(parts, inline_depth, parts.size()) + " = " + text);
        }
        if (parent_exists && is_header(*table)) {
            insert_line(end_of_section(root, *table), indent_of(*table) + parts.back() + " = " + text);
            return "";
        }
        if (parent_exists && insert_beside(*table, parts.back() + " = " + text)) return "";
        append_table(join_from(parts, 0, parts.size() - 1), parts.back() + " = " + text);
        return "";
    }

    // Where the comment's text begins that stands on this line behind byte `at`; npos: there is none.
    std::size_t comment_behind(std::size_t at) const {
        char quote = 0;
        for (; at < text_.size() && text_[at] != '\n'; ++at) {
            const char c = text_[at];
            if (quote != 0) {
                if (c == '\\' && quote == '"') ++at;
                if (c == quote) quote = 0;
            } else if (c == '"' || c == '\'') {
                quote = c;
            } else if (c == '#') {
                at = text_.find_first_not_of("# \t", at);
                const bool empty = at == std::string::npos || text_[at] == '\n' || text_[at] == '\r';
                return empty ? std::string::npos : at;
            }
        }
        return std::string::npos;
    }

    // A comment was written about the value that it stands behind: it is kept as a note of that one.
    void note_former(std::size_t begin, std::size_t end) {
        constexpr std::string_view kWas = "was ";
        const std::size_t comment = comment_behind(end);
        if (comment == std::string::npos || std::string_view(text_).substr(comment).starts_with(kWas)) return;
        text_.insert(comment, std::string(kWas) + text_.substr(begin, end - begin) + ": ");
    }

    std::string replace(const toml::node& old, const FileValue& value) {
        if (holds(old, value)) return "";
        if (!old.is_value()) return "it holds a table or an array";
        const std::size_t begin = offset(old.source().begin);
        const std::size_t end = offset(old.source().end);
        if (begin >= end) return "its place in the file is not known";
        note_former(begin, end);
        text_.replace(begin, end - begin, toml_text(value));
        return "";
    }

    std::string insert_inline(const toml::table& table, const std::string& statement) {
        const std::size_t end = offset(table.source().end);
        if (end < 2 || text_[end - 1] != '}') return "the end of its inline table is not known";
        if (table.empty()) {
            text_.insert(end - 1, (text_[end - 2] == ' ' ? "" : " ") + statement + " ");
            return "";
        }
        const std::size_t last = text_.find_last_not_of(" \t", end - 2);
        text_.insert(last + 1, ", " + statement);
        return "";
    }

    // A table that has a [header] of its own, not one implied by a longer header or by dotted keys.
    bool is_header(const toml::table& table) const {
        if (table.is_inline()) return false;
        const std::size_t at = offset(table.source().begin);
        if (at >= text_.size() || text_[at] != '[') return false;
        return std::none_of(table.begin(), table.end(), [&](const auto& item) {
            return item.second.is_table() && item.second.source().begin == table.source().begin;
        });
    }

    std::string indent_of(const toml::table& table) const {
        // As the first statement of the table is indented.
        for (const auto& [key, node] : table) {
            if (node.is_table() && !node.as_table()->is_inline()) continue;
            const std::size_t at = offset(key.source().begin);
            const std::size_t line = lines_[key.source().begin.line - 1];
            const std::string lead = text_.substr(line, at - line);
            if (lead.find_first_not_of(" \t") == std::string::npos) return lead;
        }
        return "";
    }

    // Collects where values end and where headers begin.
    void collect(const toml::node& node, std::vector<std::size_t>& headers,
                 std::vector<std::size_t>& ends) const {
        if (const toml::table* table = node.as_table(); table != nullptr && !table->is_inline()) {
            const std::size_t at = offset(table->source().begin);
            if (at < text_.size() && text_[at] == '[') headers.push_back(at);
            for (const auto& [key, child] : *table) collect(child, headers, ends);
        } else if (const toml::array* array = node.as_array();
                   array != nullptr && array->is_array_of_tables()) {
            for (const toml::node& child : *array) collect(child, headers, ends);
        } else {
            ends.push_back(offset(node.source().end));
        }
    }

    // Where a further line of this table goes: after its last statement, before the comments that lead to
    // the next table.
    std::size_t end_of_section(const toml::table& root, const toml::table& table) const {
        const std::size_t begin = offset(table.source().begin);
        std::vector<std::size_t> headers;
        std::vector<std::size_t> ends;
        for (const auto& [key, child] : root) collect(child, headers, ends);
        std::size_t limit = text_.size();
        for (const std::size_t at : headers) {
            if (at > begin) limit = std::min(limit, at);
        }
        std::size_t last = begin;
        for (const std::size_t at : ends) {
            if (at > begin && at <= limit) last = std::max(last, at);
        }
        return line_after(last);
    }

    // For a table made of dotted keys ("drive.left.node = 1"): a line like its last one.
    bool insert_beside(const toml::table& table, const std::string& statement) {
        const toml::key* after = nullptr;
        const toml::node* node = nullptr;
        for (const auto& [key, child] : table) {
            if (child.is_table() && !child.as_table()->is_inline()) continue;
            if (after == nullptr || after->source().begin < key.source().begin) {
                after = &key;
                node = &child;
            }
        }
        if (after == nullptr) return false;
        const std::size_t line = lines_[after->source().begin.line - 1];
        const std::string prefix = text_.substr(line, offset(after->source().begin) - line);
        insert_line(line_after(offset(node->source().end)), prefix + statement);
        return true;
    }

    void append_table(const std::string& name, const std::string& statement) {
        std::string added;
        if (!text_.empty() && text_.back() != '\n') added += newline_;
        if (!text_.empty()) added += newline_;
        text_ += added + "[" + name + "]" + newline_ + statement + newline_;
    }

    std::string text_;
    std::vector<std::size_t> lines_;  // byte offset of each line
    std::string newline_ = "\n";
    std::size_t first_ = 0;
};

}  // namespace

std::optional<FileChange> file_change(std::uint16_t index, double value) {
    double real = value;
    if (const auto single = static_cast<float>(value);
        std::isfinite(single) && static_cast<double>(single) == value) {
        std::array<char, 40> digits{};
        const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), single).ptr;
        std::from_chars(digits.data(), end, real);
    }
    if (const model::ParameterInfo* info = model::find_parameter(index)) {
        const std::string key(info->key);
        switch (info->kind) {
            case model::ParameterKind::real:
                if (info->automatic() && value == 0) return FileChange{key, std::string("auto")};
                return FileChange{key, real};
            case model::ParameterKind::integer:
                return FileChange{key, static_cast<std::int64_t>(value)};
            case model::ParameterKind::boolean:
                return FileChange{key, value != 0};
            case model::ParameterKind::choice: {
                const auto choice = static_cast<std::size_t>(value);
                if (value < 0 || choice >= info->choices.size()) return std::nullopt;
                return FileChange{key, std::string(info->choices[choice])};
            }
        }
    }
    if (index < model::kEffectIndexBase) return std::nullopt;
    const std::size_t effect = (index - std::size_t{model::kEffectIndexBase}) / 16;
    const std::size_t slot = (index - std::size_t{model::kEffectIndexBase}) % 16;
    if (effect >= model::kEffectCount) return std::nullopt;
    const model::EffectInfo& info = model::kEffects[effect];
    const std::string prefix = "effects." + std::string(info.name) + ".";
    if (slot == model::kEffectActiveSlot) return FileChange{prefix + "active", value != 0};
    if (slot >= info.parameters.size()) return std::nullopt;
    return FileChange{prefix + std::string(info.parameters[slot].name), real};
}

EditResult set_values(std::string_view text, std::span<const FileChange> changes) {
    Editor editor(text);
    for (const FileChange& change : changes) {
        const std::string failed = editor.set(change);
        if (!failed.empty()) return {std::nullopt, failed};
    }
    return {editor.take(), ""};
}

std::string save_robot_file(const std::string& path, std::span<const FileChange> changes) {
    std::string text;
    if (const std::string failed = read_whole_file(path, text); !failed.empty()) return path + ": " + failed;
    const EditResult edited = set_values(text, changes);
    if (!edited.text.has_value()) return path + ": " + edited.error;
    const RobotFileResult checked = parse_robot_file(*edited.text, path);
    if (!checked.problems.empty()) {
        return "not saved, as the file would be bad: " + to_text(checked.problems.front());
    }
    if (*edited.text == text) return "";
    return write_whole_file(path, *edited.text);
}

}  // namespace wheelwright::task
