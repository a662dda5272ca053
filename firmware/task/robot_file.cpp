#include "firmware/task/robot_file.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <tuple>

#include "firmware/task/robot_file_hints.hpp"
#include "firmware/task/robot_file_toml.hpp"
#include "firmware/task/write_file.hpp"

namespace wheelwright::task {
namespace {

using model::ParameterInfo;
using model::ParameterKind;

// Identifiers from here on are the firmware's own; a drive uses 32 from node * 32.
constexpr int kFirstOwnId = 0x600;
constexpr std::string_view kErrorSuffix = "_standard_error";
constexpr std::string_view kEffects = "effects";
constexpr double kLargestStandardError = 1e9;

constexpr double kSmallest = 1e-6;
const std::array kMassTable{
    MassInfo{"mass.mass_kg", "kg", 0.01, 1e5, &model::MassProperties<double>::mass_kg,
             "whole robot, wheels included"},
    MassInfo{"mass.yaw_inertia_kg_m2", "kg m^2", kSmallest, 1e6,
             &model::MassProperties<double>::yaw_inertia_kg_m2,
             "about the centre of gravity, wheels' spin excluded"},
    MassInfo{"mass.cog_ahead_m", "m", -5.0, 5.0, &model::MassProperties<double>::cog_ahead_m,
             "centre of gravity ahead of the axle"},
    MassInfo{"mass.wheel_inertia_kg_m2", "kg m^2", 0.0, 1e4,
             &model::MassProperties<double>::wheel_inertia_kg_m2,
             "one wheel with its gearbox and rotor, about its axis"},
};

const std::array kTextTable{
    TextInfo{"robot.name", "what people call this robot"},
    TextInfo{"lines.chip", "gpiochip device of the lines, such as /dev/gpiochip0"},
    TextInfo{"dynamics.log", "the log K5..K8 were identified from"},
    TextInfo{"dynamics.date", "the day that log was made, as text or as a date"},
};

const SimulationInfo* find_simulation(std::string_view key) {
    for (const SimulationInfo& info : simulation_table()) {
        if (info.key == key) return &info;
    }
    return nullptr;
}

const MassInfo* find_mass(std::string_view key) {
    for (const MassInfo& info : kMassTable) {
        if (info.key == key) return &info;
    }
    return nullptr;
}

bool is_text(std::string_view key) {
    return std::any_of(kTextTable.begin(), kTextTable.end(),
                       [&](const TextInfo& info) { return info.key == key; });
}

std::string with_unit(const std::string& text, std::string_view unit) {
    return unit.empty() ? text : text + " " + std::string(unit);
}

// For people: no ".0" behind whole numbers.
std::string plain_number(double value) {
    std::array<char, 40> buffer{};
    const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
    return {buffer.data(), end};
}

std::string range_text(double minimum, double maximum, std::string_view unit, bool whole) {
    return std::string(whole ? "a whole number from " : "a number from ") + plain_number(minimum) + " to " +
           with_unit(plain_number(maximum), unit);
}

std::string expected_text(const ParameterInfo& info) {
    switch (info.kind) {
        case ParameterKind::boolean:
            return "true or false";
        case ParameterKind::choice: {
            std::string text;
            for (const std::string_view name : info.choices) {
                if (!text.empty()) text += " or ";
                text.append("\"").append(name).append("\"");
            }
            return text;
        }
        case ParameterKind::integer:
            return range_text(info.minimum, info.maximum, info.unit, true);
        case ParameterKind::real:
            break;
    }
    return range_text(info.minimum, info.maximum, info.unit, false);
}

std::string date_text(const toml::date& date) {
    std::array<char, 24> buffer{};
    std::snprintf(buffer.data(), buffer.size(), "%04d-%02d-%02d", int(date.year), int(date.month),
                  int(date.day));
    return buffer.data();
}

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

std::optional<double> number_of(const toml::node& node) {
    if (node.is_integer()) return static_cast<double>(node.as_integer()->get());
    if (node.is_floating_point()) return node.as_floating_point()->get();
    return std::nullopt;
}

struct Position {
    std::uint32_t line = 0;
    std::uint32_t column = 0;
};

Position position_of(const toml::source_region& region) {
    return {region.begin.line, static_cast<std::uint32_t>(region.begin.column)};
}

// A clause for a number that would be in range in another unit, or "".
std::string range_hint(double value, double minimum, double maximum, std::string_view unit) {
    struct Slip {
        std::string_view unit, other;
        double factor;
    };
    constexpr std::array slips{
        Slip{"m", "mm", 1e-3},
        Slip{"s", "ms", 1e-3},
        Slip{"rad", "degrees", 0.017453292519943295},
        Slip{"s", "us", 1e-6},
        Slip{"bit/s", "kbit/s", 1e3},
        Slip{"bit/s", "Mbit/s", 1e6},
        Slip{"m/s", "km/h", 1 / 3.6},
        Slip{"kg", "g", 1e-3},
    };
    for (const Slip& slip : slips) {
        const double converted = value * slip.factor;
        if (slip.unit == unit && value != 0 && converted >= minimum && converted <= maximum) {
            std::array<char, 96> text{};
            std::snprintf(text.data(), text.size(), "; %.12g %.*s would be %.12g", value,
                          static_cast<int>(slip.other.size()), slip.other.data(), converted);
            return text.data();
        }
    }
    return "";
}

class Reader {
  public:
    explicit Reader(const std::string& file_name) : file_(file_name) {
        robot_.parameters = model::default_parameters();
        robot_.simulation = default_simulation();
    }

    RobotFileResult read(std::string_view text) {
        const toml::parse_result parsed = toml::parse(text, file_);
        if (!parsed) {
            problem(position_of(parsed.error().source()), "", std::string(parsed.error().description()));
            return finish();
        }
        walk(parsed.table(), "");
        finish_dynamics();
        check_drives();
        check_limits();
        check_lines();
        take_notes();
        note_effects_not_estimated();
        return finish();
    }

  private:
    void problem(Position at, std::string key, std::string message) {
        problems_.push_back({file_, at.line, at.column, std::move(key), std::move(message)});
    }
    void note(std::string key, std::string message) {
        const Position at = position(key);
        notes_.push_back({file_, at.line, at.column, std::move(key), std::move(message)});
    }

    bool given(std::string_view key) const { return seen_.find(key) != seen_.end(); }
    Position position(std::string_view key) const {
        const auto found = seen_.find(key);
        return found == seen_.end() ? Position{} : found->second;
    }

    void walk(const toml::table& table, const std::string& prefix) {
        for (const auto& [key, node] : table) {
            const std::string path = prefix + std::string(key.str());
            if (key.str().find('.') != std::string_view::npos) {
                problem(position_of(key.source()), path,
                        "unknown key, with a point inside quotes; write dotted keys without quotes");
                continue;
            }
            entry(path, position_of(key.source()), node);
        }
    }

    void entry(const std::string& path, Position key_at, const toml::node& node) {
        if (path == kEffects) {
            if (expect_table(path, node, "a table for each effect")) walk_effects(*node.as_table());
        } else if (const ParameterInfo* info = model::find_parameter(path)) {
            parameter(*info, node);
        } else if (const SimulationInfo* simulated = find_simulation(path)) {
            double value = 0;
            if (number(path, node, simulated->minimum, simulated->maximum, simulated->unit, simulated->whole,
                       value)) {
                simulated->set(robot_.simulation, value);
            }
        } else if (const MassInfo* mass = find_mass(path)) {
            double value = 0;
            if (number(path, node, mass->minimum, mass->maximum, mass->unit, false, value)) {
                mass_.*(mass->field) = value;
            }
        } else if (is_text(path)) {
            text(path, node);
        } else if (const std::string children = children_of(path); !children.empty()) {
            std::string what = "a table with " + children;
            if (node.is_number() && children == "left, right") {
                const std::string both = found_text(node);
                what.append(": { left = ").append(both).append(", right = ").append(both).append(" }");
            }
            if (expect_table(path, node, what)) walk(*node.as_table(), path + ".");
        } else {
            unknown(path, key_at, node);
        }
    }

    bool expect_table(const std::string& path, const toml::node& node, const std::string& what) {
        if (node.is_table()) return true;
        problem(position_of(node.source()), path, "found " + found_text(node) + ", expected " + what);
        return false;
    }

    void remember(const std::string& path, const toml::node& node) {
        seen_.emplace(path, position_of(node.source()));
    }

    bool number(const std::string& path, const toml::node& node, double minimum, double maximum,
                std::string_view unit, bool whole, double& value) {
        remember(path, node);
        const std::string expected = "expected " + range_text(minimum, maximum, unit, whole);
        const std::optional<double> found = number_of(node);
        const Position at = position_of(node.source());
        if (!found.has_value() || (whole && !node.is_integer())) {
            std::string message = "found " + found_text(node) + ", " + expected;
            if (node.is_string()) message += ", without quotes and unit";
            if (node.is_floating_point()) message += ", without a decimal point";
            if (const ParameterInfo* info = model::find_parameter(path); info != nullptr && whole) {
                message += " (" + std::string(info->meaning) + ")";
            }
            problem(at, path, message);
            return false;
        }
        if (!std::isfinite(*found) || *found < minimum || *found > maximum) {
            problem(at, path,
                    "found " + with_unit(plain_number(*found), std::isfinite(*found) ? unit : "") + ", " +
                        expected + range_hint(*found, minimum, maximum, unit));
            return false;
        }
        value = *found;
        return true;
    }

    void parameter(const ParameterInfo& info, const toml::node& node) {
        const std::string path(info.key);
        double value = 0;
        switch (info.kind) {
            case ParameterKind::real:
            case ParameterKind::integer:
                if (!number(path, node, info.minimum, info.maximum, info.unit,
                            info.kind == ParameterKind::integer, value)) {
                    return;
                }
                break;
            case ParameterKind::boolean:
                remember(path, node);
                if (!node.is_boolean()) {
                    problem(position_of(node.source()), path,
                            "found " + found_text(node) + ", expected true or false");
                    return;
                }
                value = node.as_boolean()->get() ? 1 : 0;
                break;
            case ParameterKind::choice: {
                remember(path, node);
                const auto name = node.is_string() ? std::find(info.choices.begin(), info.choices.end(),
                                                               std::string_view(node.as_string()->get()))
                                                   : info.choices.end();
                if (name == info.choices.end()) {
                    problem(position_of(node.source()), path,
                            "found " + found_text(node) + ", expected " + expected_text(info));
                    return;
                }
                value = static_cast<double>(name - info.choices.begin());
                break;
            }
        }
        info.set(robot_.parameters, value);
    }

    std::optional<std::string> text_of(const std::string& path, const toml::node& node) {
        remember(path, node);
        if (node.is_string()) return node.as_string()->get();
        if (path.ends_with(".date")) {
            if (node.is_date()) return date_text(node.as_date()->get());
            if (node.is_date_time()) return date_text(node.as_date_time()->get().date);
        }
        problem(position_of(node.source()), path, "found " + found_text(node) + ", expected text in quotes");
        return std::nullopt;
    }

    void text(const std::string& path, const toml::node& node) {
        const std::optional<std::string> value = text_of(path, node);
        if (!value.has_value()) return;
        if (path == "robot.name") robot_.name = *value;
        if (path == "lines.chip") robot_.lines_chip = *value;
        if (path == "dynamics.log") robot_.dynamics_provenance.log = *value;
        if (path == "dynamics.date") robot_.dynamics_provenance.date = *value;
    }

    void walk_effects(const toml::table& table) {
        for (const auto& [key, node] : table) {
            const std::string path = std::string(kEffects) + "." + std::string(key.str());
            const std::size_t index = model::find_effect(key.str());
            if (index == model::kEffectCount) {
                unknown(path, position_of(key.source()), node);
            } else if (expect_table(path, node, "a table with the effect's parameters")) {
                effect(index, path + ".", *node.as_table());
            }
        }
    }

    void effect(std::size_t index, const std::string& prefix, const toml::table& table) {
        const model::EffectInfo& info = model::kEffects[index];
        robot_.parameters.effects.active[index] = true;
        for (const auto& [key, node] : table) {
            const std::string path = prefix + std::string(key.str());
            const std::string_view name = key.str();
            if (name == "active") {
                remember(path, node);
                if (node.is_boolean()) {
                    robot_.parameters.effects.active[index] = node.as_boolean()->get();
                } else {
                    problem(position_of(node.source()), path,
                            "found " + found_text(node) + ", expected true or false");
                }
                continue;
            }
            if (name == "log" || name == "date") {
                const std::optional<std::string> value = text_of(path, node);
                Provenance& provenance = robot_.effect_provenance[index];
                if (value.has_value()) (name == "log" ? provenance.log : provenance.date) = *value;
                continue;
            }
            if (!effect_number(index, info, path, name, node)) {
                unknown(path, position_of(key.source()), node);
            }
        }
    }

    // False when the name is not a parameter of the effect or its standard error.
    bool effect_number(std::size_t index, const model::EffectInfo& info, const std::string& path,
                       std::string_view name, const toml::node& node) {
        for (std::size_t j = 0; j < info.parameters.size(); ++j) {
            const model::EffectParameterInfo& parameter_info = info.parameters[j];
            double value = 0;
            if (name == parameter_info.name) {
                if (number(path, node, parameter_info.minimum, parameter_info.maximum, parameter_info.unit,
                           false, value)) {
                    robot_.parameters.effects.parameter[index][j] = value;
                }
                return true;
            }
            if (name == std::string(parameter_info.name) + std::string(kErrorSuffix)) {
                if (number(path, node, 0, kLargestStandardError, parameter_info.unit, false, value)) {
                    robot_.parameters.effects_standard_error.parameter[index][j] = value;
                }
                return true;
            }
        }
        return false;
    }

    // Names of what a known table ("" is the root) may hold; "" when no known key lies below `path`.
    static std::string children_of(const std::string& path) {
        std::string text;
        const std::string prefix = path.empty() ? "" : path + ".";
        std::vector<std::string> names;
        for (const KnownKey& key : known_keys()) {
            if (!key.path.starts_with(prefix)) continue;
            const std::string name =
                key.path.substr(prefix.size(), key.path.find('.', prefix.size()) - prefix.size());
            if (std::find(names.begin(), names.end(), name) != names.end()) continue;
            if (!names.empty()) text += ", ";
            text += name;
            names.push_back(name);
        }
        return text;
    }

    void unknown(const std::string& path, Position at, const toml::node& node) {
        std::string message = node.is_table() ? "unknown table" : "unknown key";
        const std::string hint = hint_for_unknown(path, number_of(node), known_keys());
        if (!hint.empty()) {
            message += "; " + hint;
        } else if (path.starts_with(std::string(kEffects) + ".") &&
                   std::count(path.begin(), path.end(), '.') == 1) {
            message += "; the effects are " + children_of(std::string(kEffects));
        } else if (const std::size_t dot = path.rfind('.'); dot != std::string::npos) {
            message += "; [" + path.substr(0, dot) + "] may have " + children_of(path.substr(0, dot));
        } else {
            message += "; the tables are " + children_of("");
        }
        problem(at, path, message);
    }

    void finish_dynamics() {
        model::RobotParameters& p = robot_.parameters;
        const bool has_mass = std::any_of(kMassTable.begin(), kMassTable.end(),
                                          [&](const MassInfo& info) { return given(info.key); });
        if (has_mass) {
            for (const MassInfo& info : kMassTable) {
                if (!given(info.key)) {
                    problem({}, std::string(info.key), "missing; [mass] needs all of its four numbers");
                }
            }
            for (const std::string_view key :
                 {"dynamics.k5_m", "dynamics.k6_per_m", "dynamics.k7_per_kg_m", "dynamics.k8_per_kg_m2"}) {
                if (given(key)) {
                    problem(position(key), std::string(key),
                            "found beside [mass], from which K5..K8 follow; expected one of the two");
                }
            }
            if (problems_.empty()) {
                robot_.mass = mass_;
                p.dynamics = model::dynamics_from_mass(mass_, p.geometry);
                check_derived();
            }
            return;
        }
        if (!given("dynamics.k6_per_m")) {
            if (p.dynamics.k5_m == 0) return;  // K6's default is 0 too
            p.dynamics.k6_per_m = model::coupled_k6(p.dynamics.k5_m, p.dynamics.k7_per_kg_m,
                                                    p.dynamics.k8_per_kg_m2, p.geometry.track_m);
        } else if (!given("dynamics.k5_m")) {
            problem(position("dynamics.k6_per_m"), "dynamics.k5_m",
                    "missing beside k6_per_m; give both, or k5_m alone (K6 then follows from it)");
        }
    }

    // K5..K8 that follow from masses must lie in the ranges of those that are given.
    void check_derived() {
        for (const std::string_view key :
             {"dynamics.k5_m", "dynamics.k6_per_m", "dynamics.k7_per_kg_m", "dynamics.k8_per_kg_m2"}) {
            const ParameterInfo* info = model::find_parameter(key);
            const double value = info->get(robot_.parameters);
            if (value < info->minimum || value > info->maximum) {
                problem({}, std::string(key),
                        "follows from [mass] as " + with_unit(plain_number(value), info->unit) +
                            ", expected " + expected_text(*info));
            }
        }
    }

    void check_drives() {
        const auto& drive = robot_.parameters.drive;
        struct Side {
            const model::DriveParameters& drive;
            std::string name;
        };
        for (const Side& side : {Side{drive.left, "drive.left"}, Side{drive.right, "drive.right"}}) {
            if (side.drive.sign == 0) {
                problem(position(side.name + ".sign"), side.name + ".sign", "found 0, expected 1 or -1");
            }
            if (side.drive.node * 32 + 31 >= kFirstOwnId) {
                problem(position(side.name + ".node"), side.name + ".node",
                        "found " + std::to_string(side.drive.node) + ", expected a whole number from 0 to " +
                            std::to_string(kFirstOwnId / 32 - 1) +
                            "; nodes above use the identifiers from 0x600 on, which are the firmware's own");
            }
        }
        if (drive.left.node == drive.right.node) {
            const char* key = given("drive.right.node") ? "drive.right.node" : "drive.left.node";
            problem(position(key), key,
                    "found " + std::to_string(drive.left.node) +
                        " for both drives, expected two different nodes");
        }
        above("drive.heartbeat_timeout_s", drive.heartbeat_timeout_s, "drive.heartbeat_period_ms",
              drive.heartbeat_period_ms * 1e-3, "s");
        above("safety.stale_feedback_s", robot_.parameters.safety.stale_feedback_s, "drive.encoder_period_ms",
              drive.encoder_period_ms * 1e-3, "s");
    }

    // Reports unless `value` of `key` is larger than `bound` of `bound_key`.
    void above(const char* key, double value, const char* bound_key, double bound, std::string_view unit) {
        if (value > bound) return;
        const char* at = given(key) ? key : bound_key;
        problem(position(at), key,
                "found " + with_unit(plain_number(value), unit) + (given(key) ? "" : " (the default)") +
                    ", expected more than the " + with_unit(plain_number(bound), unit) + " of " + bound_key +
                    (given(bound_key) ? "" : " (the default)"));
    }

    void check_limits() {
        const model::RobotParameters& p = robot_.parameters;
        above("safety.over_speed_m_per_s", p.safety.over_speed_m_per_s, "limits.speed_m_per_s",
              p.limits.speed_m_per_s, "m/s");
        above("safety.over_yaw_rate_rad_per_s", p.safety.over_yaw_rate_rad_per_s, "limits.yaw_rate_rad_per_s",
              p.limits.yaw_rate_rad_per_s, "rad/s");
        above("safety.over_speed_m_per_s", p.safety.over_speed_m_per_s, "ident.speed_limit_m_per_s",
              p.ident.speed_limit_m_per_s, "m/s");
        above("safety.over_yaw_rate_rad_per_s", p.safety.over_yaw_rate_rad_per_s,
              "ident.yaw_rate_limit_rad_per_s", p.ident.yaw_rate_limit_rad_per_s, "rad/s");
        above("pose_control.rearm_radius_m", p.pose_control.rearm_radius_m, "pose_control.stop_radius_m",
              p.pose_control.stop_radius_m, "m");
    }

    void check_lines() {
        const auto& lines = robot_.parameters.lines;
        if (lines.emergency_stop >= 0 && lines.emergency_stop == lines.drive_enable) {
            problem(position("lines.drive_enable"), "lines.drive_enable",
                    "found " + std::to_string(lines.drive_enable) +
                        ", which is the emergency stop's line, expected another one");
        }
        if (robot_.lines_chip.empty()) {
            for (const char* key : {"lines.emergency_stop", "lines.drive_enable"}) {
                if (model::find_parameter(key)->get(robot_.parameters) >= 0) {
                    problem(position(key), "lines.chip",
                            std::string("missing beside ") + key + ", expected text such as " +
                                "\"/dev/gpiochip0\"");
                    break;
                }
            }
        }
    }

    void take_notes() {
        const model::RobotParameters& p = robot_.parameters;
        for (const char* key :
             {"geometry.wheel_radius_m.left", "geometry.wheel_radius_m.right", "geometry.track_m"}) {
            if (!given(key)) {
                const ParameterInfo* info = model::find_parameter(key);
                note(key, "not given; " + with_unit(plain_number(info->standard), info->unit) +
                              " is assumed, which is hardly your robot's");
            }
        }
        if (!robot_.mass.has_value() && (!given("dynamics.k7_per_kg_m") || !given("dynamics.k8_per_kg_m2"))) {
            note("dynamics", "K7 and K8 are not given: identify the robot before closing a loop on it");
        }
        if (!p.drive.watchdog_assured && (p.drive.generation == 5 || p.drive.watchdog_endpoint == 0)) {
            note("drive.watchdog_assured",
                 std::string("false, and ") +
                     (p.drive.generation == 5 ? "drives of generation 0.5 cannot be asked"
                                              : "drive.watchdog_endpoint is not given") +
                     ": arming will be refused until it is known that the drives' watchdogs are on");
        }
        if (p.drive.generation == 5 && given("drive.watchdog_endpoint")) {
            note("drive.watchdog_endpoint", "drives of generation 0.5 have no endpoints; it is not used");
        }
        not_above("ident.amplitude_Nm", p.ident.amplitude_Nm, "limits.torque_Nm", p.limits.torque_Nm, "Nm");
        not_above("pose_control.speed_m_per_s", p.pose_control.speed_m_per_s, "limits.speed_m_per_s",
                  p.limits.speed_m_per_s, "m/s");
        not_above("pose_control.yaw_rate_rad_per_s", p.pose_control.yaw_rate_rad_per_s,
                  "limits.yaw_rate_rad_per_s", p.limits.yaw_rate_rad_per_s, "rad/s");
        // Gerono's figure-8, x = L/2 sin wt, y = W/2 sin 2wt, is fastest in the middle.
        const double rate = 2 * 3.14159265358979323846 / p.trajectory.period_s;
        const double fastest = rate * std::hypot(p.trajectory.length_m / 2, p.trajectory.width_m);
        not_above("trajectory.period_s", fastest, "limits.speed_m_per_s", p.limits.speed_m_per_s, "m/s",
                  "the standard figure-8 asks for ");
    }

    void note_effects_not_estimated() {
        const std::array<bool, model::kEffectCount>& active = robot_.parameters.effects.active;
        const std::array<bool, model::kEffectCount> estimated = model::estimated_effects(active);
        std::string carried;
        for (std::size_t i = 0; i < model::kEffectCount; ++i) {
            if (!estimated[i]) continue;
            if (!carried.empty()) carried += ", ";
            carried += model::kEffects[i].name;
        }
        for (std::size_t i = 0; i < model::kEffectCount; ++i) {
            if (!active[i] || estimated[i]) continue;
            const std::string name(model::kEffects[i].name);
            note(std::string(kEffects) + "." + name,
                 model::kLinearInParameters[i]
                     ? "stays as it is written here: the estimators have room for " +
                           std::to_string(model::kMaxEstimatedColumns) + " parameters, which " + carried +
                           " take"
                     : "stays as it is written here: it is not linear in its parameters");
        }
    }

    void not_above(const char* key, double value, const char* bound_key, double bound, std::string_view unit,
                   std::string_view lead = "") {
        if (value <= bound) return;
        note(key, std::string(lead) + with_unit(plain_number(value), unit) + ", more than the " +
                      with_unit(plain_number(bound), unit) + " of " + bound_key +
                      ", which will be the limit");
    }

    RobotFileResult finish() {
        const auto by_place = [](const Diagnostic& a, const Diagnostic& b) {
            return std::tie(a.line, a.column) < std::tie(b.line, b.column);
        };
        std::stable_sort(problems_.begin(), problems_.end(), by_place);
        std::stable_sort(notes_.begin(), notes_.end(), by_place);
        RobotFileResult result;
        if (problems_.empty()) {
            std::vector<std::pair<Position, std::string>> order;
            for (const auto& [key, at] : seen_) order.emplace_back(at, key);
            std::sort(order.begin(), order.end(), [](const auto& a, const auto& b) {
                return std::tie(a.first.line, a.first.column) < std::tie(b.first.line, b.first.column);
            });
            for (auto& [at, key] : order) robot_.given.push_back(std::move(key));
            result.robot = std::move(robot_);
            result.notes = std::move(notes_);
        }
        result.problems = std::move(problems_);
        return result;
    }

    std::string file_;
    RobotFile robot_;
    model::MassProperties<double> mass_;
    std::map<std::string, Position, std::less<>> seen_;  // where each known key's value stands
    std::vector<Diagnostic> problems_;
    std::vector<Diagnostic> notes_;
};

}  // namespace

std::string to_text(const Diagnostic& diagnostic) {
    std::string text = diagnostic.file;
    if (diagnostic.line > 0) {
        text += ":" + std::to_string(diagnostic.line) + ":" + std::to_string(diagnostic.column);
    }
    if (!diagnostic.key.empty()) text += ": " + diagnostic.key;
    return text + ": " + diagnostic.message;
}

bool RobotFile::is_given(std::string_view key) const {
    return std::find(given.begin(), given.end(), key) != given.end();
}

std::span<const MassInfo> mass_table() { return kMassTable; }
std::span<const TextInfo> text_table() { return kTextTable; }

std::vector<KnownKey> known_keys() {
    std::vector<KnownKey> keys;
    for (const ParameterInfo& info : model::parameter_table()) {
        keys.push_back({std::string(info.key), info.unit});
    }
    for (const model::EffectInfo& effect : model::kEffects) {
        const std::string prefix = std::string(kEffects) + "." + std::string(effect.name) + ".";
        for (const model::EffectParameterInfo& info : effect.parameters) {
            keys.push_back({prefix + std::string(info.name), info.unit});
            keys.push_back({prefix + std::string(info.name) + std::string(kErrorSuffix), info.unit});
        }
        for (const char* name : {"active", "log", "date"}) keys.push_back({prefix + name, ""});
    }
    for (const MassInfo& info : kMassTable) keys.push_back({std::string(info.key), info.unit});
    for (const SimulationInfo& info : simulation_table()) keys.push_back({std::string(info.key), info.unit});
    for (const TextInfo& info : kTextTable) keys.push_back({std::string(info.key), ""});
    return keys;
}

RobotFileResult parse_robot_file(std::string_view text, const std::string& file_name) {
    return Reader(file_name).read(text);
}

RobotFileResult read_robot_file(const std::string& path) {
    std::string text;
    const std::string failed = read_whole_file(path, text);
    if (failed.empty()) return parse_robot_file(text, path);
    RobotFileResult result;
    result.problems.push_back({path, 0, 0, "", failed});
    return result;
}

std::string shortest_number(double value) {
    std::string text = plain_number(value);
    if (text.find_first_not_of("-0123456789") == std::string::npos) text += ".0";
    return text;
}

}  // namespace wheelwright::task
