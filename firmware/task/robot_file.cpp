// The reading half of robot_file.hpp: the reader takes what each key says, the checks judge the keys
// together.
#include "firmware/task/robot_file.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "firmware/task/robot_file_checks.hpp"
#include "firmware/task/robot_file_diagnostics.hpp"
#include "firmware/task/robot_file_hints.hpp"
#include "firmware/task/robot_file_keys.hpp"
#include "firmware/task/robot_file_text.hpp"
#include "firmware/task/robot_file_toml.hpp"
#include "firmware/task/write_file.hpp"

namespace wheelwright::task {
namespace {

using model::ParameterInfo;
using model::ParameterKind;

constexpr double kLargestStandardError = 1e9;

Position position_of(const toml::source_region& region) {
    return {region.begin.line, static_cast<std::uint32_t>(region.begin.column)};
}

std::optional<double> number_of(const toml::node& node) {
    if (node.is_integer()) return static_cast<double>(node.as_integer()->get());
    if (node.is_floating_point()) return node.as_floating_point()->get();
    return std::nullopt;
}

std::string date_text(const toml::date& date) {
    std::array<char, 24> buffer{};
    std::snprintf(buffer.data(), buffer.size(), "%04d-%02d-%02d", int(date.year), int(date.month),
                  int(date.day));
    return buffer.data();
}

// What stands there, for people.
std::string found_text(const toml::node& node) {
    switch (node.type()) {
        case toml::node_type::integer:
            return std::to_string(node.as_integer()->get());
        case toml::node_type::floating_point:
            return plain_number(node.as_floating_point()->get());
        case toml::node_type::boolean:
            return node.as_boolean()->get() ? "true" : "false";
        case toml::node_type::string:
            return "the text \"" + node.as_string()->get() + "\"";
        case toml::node_type::table:
            return "a table";
        case toml::node_type::array:
            return "an array";
        default:
            return "a date or a time";
    }
}

// The message for a key that no robot file has: what was meant, or else what there is.
std::string unknown_text(const std::string& path, const toml::node& node) {
    const std::string what = node.is_table() ? "unknown table; " : "unknown key; ";
    const std::string hint = hint_for_unknown(path, number_of(node), known_keys());
    if (!hint.empty()) return what + hint;
    const std::size_t dot = path.rfind('.');
    if (dot == std::string::npos) return what + "the tables are " + names_below("");
    const std::string parent = path.substr(0, dot);
    if (parent == kEffectsTable) return what + "the effects are " + names_below(parent);
    return what + "[" + parent + "] may have " + names_below(parent);
}

// Puts what each key says into `robot`. A value of the wrong kind or out of its range is a problem and leaves
// the default, as does a key that is not known.
class Reader {
  public:
    Reader(RobotFile& robot, Diagnostics& diagnostics) : robot_(robot), diagnostics_(diagnostics) {}

    // `prefix` is the table's path with a point behind it; "" for the root.
    void read(const toml::table& table, const std::string& prefix) {
        for (const auto& [key, node] : table) {
            const std::string path = prefix + std::string(key.str());
            if (key.str().find('.') != std::string_view::npos) {
                diagnostics_.problem_at(
                    position_of(key.source()), path,
                    "unknown key, with a point inside quotes; write dotted keys without quotes");
                continue;
            }
            entry(path, position_of(key.source()), node);
        }
    }

  private:
    void entry(const std::string& path, Position key_at, const toml::node& node) {
        if (path == kEffectsTable) {
            if (expect_table(path, node, "a table for each effect")) effects(*node.as_table());
        } else if (const ParameterInfo* info = model::find_parameter(path)) {
            const std::optional<double> value = parameter_value(*info, path, node);
            if (value.has_value()) info->set(robot_.parameters, *value);
        } else if (const SimulationInfo* simulated = find_simulation(path)) {
            const std::optional<double> value = number(
                path, node, {simulated->minimum, simulated->maximum, simulated->unit, simulated->whole});
            if (value.has_value()) simulated->set(robot_.simulation, *value);
        } else if (const MassInfo* mass = find_mass(path)) {
            if (!robot_.mass.has_value()) robot_.mass.emplace();
            const std::optional<double> value =
                number(path, node, {mass->minimum, mass->maximum, mass->unit});
            if (value.has_value()) (*robot_.mass).*(mass->field) = *value;
        } else if (is_text_key(path)) {
            text(path, node);
        } else if (const std::string names = names_below(path); !names.empty()) {
            std::string what = "a table with " + names;
            if (node.is_number() && names == "left, right") {
                const std::string both = found_text(node);
                what.append(": { left = ").append(both).append(", right = ").append(both).append(" }");
            }
            if (expect_table(path, node, what)) read(*node.as_table(), path + ".");
        } else {
            diagnostics_.problem_at(key_at, path, unknown_text(path, node));
        }
    }

    void remember(const std::string& path, const toml::node& node) {
        diagnostics_.remember(path, position_of(node.source()));
    }

    void unexpected(const std::string& path, const toml::node& node, const std::string& expected) {
        diagnostics_.problem_at(position_of(node.source()), path,
                                "found " + found_text(node) + ", expected " + expected);
    }

    bool expect_table(const std::string& path, const toml::node& node, const std::string& what) {
        if (!node.is_table()) unexpected(path, node, what);
        return node.is_table();
    }

    // The values that a key may have. Each remembers that the key is given; nothing after a problem.

    std::optional<double> number(const std::string& path, const toml::node& node, const NumberRange& range) {
        remember(path, node);
        if (range.automatic && node.is_string() && node.as_string()->get() == "auto") return 0;
        const std::optional<double> found = number_of(node);
        if (!found.has_value() || (range.whole && !node.is_integer())) {
            std::string expected = range_text(range);
            if (node.is_string()) expected += ", without quotes and unit";
            if (node.is_floating_point()) expected += ", without a decimal point";
            if (const ParameterInfo* info = model::find_parameter(path); info != nullptr && range.whole) {
                expected += " (" + std::string(info->meaning) + ")";
            }
            unexpected(path, node, expected);
            return std::nullopt;
        }
        if (!std::isfinite(*found) || *found < range.minimum || *found > range.maximum) {
            diagnostics_.problem_at(position_of(node.source()), path,
                                    "found " +
                                        quantity_text(*found, std::isfinite(*found) ? range.unit : "") +
                                        ", expected " + range_text(range) + range_hint(*found, range));
            return std::nullopt;
        }
        return found;
    }

    std::optional<bool> truth(const std::string& path, const toml::node& node) {
        remember(path, node);
        if (node.is_boolean()) return node.as_boolean()->get();
        unexpected(path, node, "true or false");
        return std::nullopt;
    }

    // The number of the one that is named.
    std::optional<double> choice(const std::string& path, const toml::node& node,
                                 std::span<const std::string_view> choices) {
        remember(path, node);
        if (node.is_string()) {
            const auto name =
                std::find(choices.begin(), choices.end(), std::string_view(node.as_string()->get()));
            if (name != choices.end()) return static_cast<double>(name - choices.begin());
        }
        unexpected(path, node, choices_text(choices));
        return std::nullopt;
    }

    std::optional<std::string> text_of(const std::string& path, const toml::node& node) {
        remember(path, node);
        if (node.is_string()) return node.as_string()->get();
        if (path.ends_with(".date")) {
            if (node.is_date()) return date_text(node.as_date()->get());
            if (node.is_date_time()) return date_text(node.as_date_time()->get().date);
        }
        unexpected(path, node, "text in quotes");
        return std::nullopt;
    }

    // As ParameterInfo::set() takes it.
    std::optional<double> parameter_value(const ParameterInfo& info, const std::string& path,
                                          const toml::node& node) {
        switch (info.kind) {
            case ParameterKind::boolean: {
                const std::optional<bool> value = truth(path, node);
                if (!value.has_value()) return std::nullopt;
                return *value ? 1 : 0;
            }
            case ParameterKind::choice:
                return choice(path, node, info.choices);
            case ParameterKind::real:
            case ParameterKind::integer:
                break;
        }
        return number(path, node, range_of(info));
    }

    void text(const std::string& path, const toml::node& node) {
        const std::optional<std::string> value = text_of(path, node);
        if (!value.has_value()) return;
        if (path == "robot.name") robot_.name = *value;
        if (path == "lines.chip") robot_.lines_chip = *value;
        if (path == "arming.key_file") robot_.key_file = *value;
        if (path == "dynamics.log") robot_.dynamics_provenance.log = *value;
        if (path == "dynamics.date") robot_.dynamics_provenance.date = *value;
    }

    void effects(const toml::table& table) {
        for (const auto& [key, node] : table) {
            const std::string path = std::string(kEffectsTable) + "." + std::string(key.str());
            const std::size_t index = model::find_effect(key.str());
            if (index == model::kEffectCount) {
                diagnostics_.problem_at(position_of(key.source()), path, unknown_text(path, node));
            } else if (expect_table(path, node, "a table with the effect's parameters")) {
                effect(index, path + ".", *node.as_table());
            }
        }
    }

    // An effect that has a table is active unless the table says otherwise.
    void effect(std::size_t index, const std::string& prefix, const toml::table& table) {
        bool& active = robot_.parameters.effects.active[index];
        Provenance& provenance = robot_.effect_provenance[index];
        active = true;
        for (const auto& [key, node] : table) {
            const std::string path = prefix + std::string(key.str());
            const std::string_view name = key.str();
            if (name == "active") {
                active = truth(path, node).value_or(active);
            } else if (name == "log") {
                provenance.log = text_of(path, node).value_or("");
            } else if (name == "date") {
                provenance.date = text_of(path, node).value_or("");
            } else if (!effect_number(index, path, name, node)) {
                diagnostics_.problem_at(position_of(key.source()), path, unknown_text(path, node));
            }
        }
    }

    // False when the name is not a parameter of the effect or its standard error.
    bool effect_number(std::size_t index, const std::string& path, std::string_view name,
                       const toml::node& node) {
        const auto& infos = model::kEffects[index].parameters;
        for (std::size_t j = 0; j < infos.size(); ++j) {
            const model::EffectParameterInfo& info = infos[j];
            if (name == info.name) {
                const std::optional<double> value =
                    number(path, node, {info.minimum, info.maximum, info.unit});
                if (value.has_value()) robot_.parameters.effects.parameter[index][j] = *value;
                return true;
            }
            if (name == std::string(info.name) + std::string(kErrorSuffix)) {
                const std::optional<double> value = number(path, node, {0, kLargestStandardError, info.unit});
                if (value.has_value()) robot_.parameters.effects_standard_error.parameter[index][j] = *value;
                return true;
            }
        }
        return false;
    }

    RobotFile& robot_;
    Diagnostics& diagnostics_;
};

}  // namespace

bool RobotFile::is_given(std::string_view key) const {
    return std::find(given.begin(), given.end(), key) != given.end();
}

RobotFileResult parse_robot_file(std::string_view text, const std::string& file_name) {
    RobotFile robot;
    robot.parameters = model::default_parameters();
    robot.simulation = default_simulation();
    Diagnostics diagnostics(file_name);
    const toml::parse_result parsed = toml::parse(text, file_name);
    if (parsed) {
        Reader(robot, diagnostics).read(parsed.table(), "");
        complete_dynamics(robot, diagnostics);
        find_contradictions(robot, diagnostics);
        take_notes(robot, diagnostics);
    } else {
        const toml::parse_error& error = parsed.error();
        diagnostics.problem_at(position_of(error.source()), "", std::string(error.description()));
    }
    return diagnostics.result(std::move(robot));
}

RobotFileResult read_robot_file(const std::string& path) {
    std::string text;
    const std::string failed = read_whole_file(path, text);
    if (failed.empty()) return parse_robot_file(text, path);
    RobotFileResult result;
    result.problems.push_back({path, 0, 0, "", failed});
    return result;
}

}  // namespace wheelwright::task
