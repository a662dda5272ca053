#include "tools/check/parameter_reference.hpp"

#include <array>
#include <cstdio>

#include "firmware/task/robot_file.hpp"
#include "tools/cli/parameter_names.hpp"
#include "tools/cli/report.hpp"

namespace wheelwright::tools {
namespace {

std::string number(double value) { return number_text(value, 9); }

std::string row(std::initializer_list<std::string> cells) {
    std::string line = "|";
    for (const std::string& cell : cells) line.append(" ").append(cell).append(" |");
    return line + "\n";
}

std::string code(const std::string& text) { return "`" + text + "`"; }

std::string range(const NamedParameter& parameter) {
    if (parameter.kind == model::ParameterKind::boolean) return "true, false";
    if (parameter.kind == model::ParameterKind::choice) {
        std::string text;
        for (const std::string& choice : parameter.choices) {
            if (!text.empty()) text += ", ";
            text.append("\"").append(choice).append("\"");
        }
        return text;
    }
    return number(parameter.minimum) + " to " + number(parameter.maximum) +
           (parameter.kind == model::ParameterKind::integer ? ", whole" : "") +
           (parameter.automatic ? ", \"auto\"" : "");
}

std::string standard(const NamedParameter& parameter) {
    if (!parameter.standard.has_value()) {
        return parameter.kind == model::ParameterKind::boolean ? "true" : "0";
    }
    if (parameter.kind == model::ParameterKind::boolean) return *parameter.standard != 0 ? "true" : "false";
    if (parameter.kind == model::ParameterKind::choice) {
        return "\"" + parameter.choices[static_cast<std::size_t>(*parameter.standard)] + "\"";
    }
    if (parameter.key == "dynamics.k6_per_m") return "from K5, K7, K8";
    if (parameter.automatic) return "\"auto\"";
    return number(*parameter.standard);
}

std::string index_text(std::uint16_t index) {
    std::array<char, 16> text{};
    std::snprintf(text.data(), text.size(), "0x%04X", unsigned{index});
    return text.data();
}

}  // namespace

std::string parameter_reference() {
    std::string page =
        "## Parameters\n\n"
        "The index is the parameter's number on CAN (`ParameterRequest`). *May change* says when a running\n"
        "firmware takes a new value over CAN: `start` never, as only the file sets it; `idle` in the idle "
        "mode;\n"
        "`any` in every mode.\n\n";
    page += row({"index", "key", "unit", "default", "range", "may change", "meaning"});
    page += row({"---", "---", "---", "---", "---", "---", "---"});
    const std::vector<NamedParameter> all = all_parameters();
    for (const NamedParameter& parameter : all) {
        if (parameter.index >= model::kEffectIndexBase) continue;
        page += row({index_text(parameter.index), code(parameter.key), parameter.unit, standard(parameter),
                     range(parameter), std::string(change_text(parameter.when)), parameter.meaning});
    }
    page +=
        "\n## Effects\n\n"
        "A table `[effects.NAME]` says that the robot has this effect: the controllers undo it, and the "
        "estimators\n"
        "carry it where it is linear in its parameters and they have room for it (`wheelwright check` says "
        "which\n"
        "stay as they are written). A parameter left out is 0, that is, not known yet. Beside each parameter "
        "may "
        "stand\n"
        "`<parameter>_standard_error`, and in each table `log` and `date`: where the numbers come from.\n"
        "`active = false` keeps the numbers but not the effect.\n\n";
    page += row({"index", "key", "unit", "default", "range", "may change", "meaning"});
    page += row({"---", "---", "---", "---", "---", "---", "---"});
    for (const NamedParameter& parameter : all) {
        if (parameter.index < model::kEffectIndexBase) continue;
        page += row({index_text(parameter.index), code(parameter.key), parameter.unit, standard(parameter),
                     range(parameter), std::string(change_text(parameter.when)), parameter.meaning});
    }
    page +=
        "\n## Masses instead of K5..K8\n\n"
        "All four together, and then no `dynamics.k*`: K5..K8 follow from them.\n\n";
    page += row({"key", "unit", "range", "meaning"});
    page += row({"---", "---", "---", "---"});
    for (const task::MassInfo& info : task::mass_table()) {
        page += row({code(std::string(info.key)), std::string(info.unit),
                     number(info.minimum) + " to " + number(info.maximum), std::string(info.meaning)});
    }
    page +=
        "\n## Simulation\n\n"
        "Read by the simulator from the file that says what the robot really is; the firmware never looks "
        "at\n"
        "it.\n\n";
    page += row({"key", "unit", "default", "range", "meaning"});
    page += row({"---", "---", "---", "---", "---"});
    for (const task::SimulationInfo& info : task::simulation_table()) {
        page += row({code(std::string(info.key)), std::string(info.unit), number(info.standard),
                     number(info.minimum) + " to " + number(info.maximum) + (info.whole ? ", whole" : ""),
                     std::string(info.meaning)});
    }
    page += "\n## Texts\n\n";
    page += row({"key", "meaning"});
    page += row({"---", "---"});
    for (const task::TextInfo& info : task::text_table()) {
        page += row({code(std::string(info.key)), std::string(info.meaning)});
    }
    return page;
}

}  // namespace wheelwright::tools
