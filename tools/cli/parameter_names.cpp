#include "tools/cli/parameter_names.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "tools/cli/report.hpp"

namespace wheelwright::tools {

std::optional<double> parse_number(std::string_view text) {
    if (text.starts_with('+')) text.remove_prefix(1);
    double value = 0;
    const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
    if (result.ec != std::errc{} || result.ptr != text.data() + text.size() || !std::isfinite(value)) {
        return std::nullopt;
    }
    return value;
}

std::vector<NamedParameter> all_parameters() {
    std::vector<NamedParameter> all;
    for (const model::ParameterInfo& info : model::parameter_table()) {
        NamedParameter named;
        named.index = info.index;
        named.key = info.key;
        named.unit = info.unit;
        named.minimum = info.minimum;
        named.maximum = info.maximum;
        named.standard = info.standard;
        named.automatic = info.automatic();
        named.when = info.when;
        named.kind = info.kind;
        for (const std::string_view choice : info.choices) named.choices.emplace_back(choice);
        named.meaning = info.meaning;
        all.push_back(std::move(named));
    }
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        const model::EffectInfo& effect = model::kEffects[i];
        const std::string prefix = "effects." + std::string(effect.name) + ".";
        for (std::size_t j = 0; j < effect.parameters.size(); ++j) {
            const model::EffectParameterInfo& info = effect.parameters[j];
            NamedParameter named;
            named.index = model::effect_index(i, j);
            named.key = prefix + std::string(info.name);
            named.unit = info.unit;
            named.minimum = info.minimum;
            named.maximum = info.maximum;
            named.when = model::changeable(named.index);
            named.meaning = info.meaning;
            all.push_back(std::move(named));
        }
        NamedParameter active;
        active.index = model::effect_index(i, model::kEffectActiveSlot);
        active.key = prefix + "active";
        active.maximum = 1;
        active.when = model::changeable(active.index);
        active.kind = model::ParameterKind::boolean;
        active.meaning = "the robot has this effect: " + std::string(effect.meaning);
        all.push_back(std::move(active));
    }
    return all;
}

std::optional<NamedParameter> find_named_parameter(std::uint16_t index) {
    for (NamedParameter& named : all_parameters()) {
        if (named.index == index) return std::move(named);
    }
    return std::nullopt;
}

std::optional<NamedParameter> find_named_parameter(std::string_view key_or_index) {
    for (NamedParameter& named : all_parameters()) {
        if (named.key == key_or_index) return std::move(named);
    }
    const bool hexadecimal = key_or_index.starts_with("0x") || key_or_index.starts_with("0X");
    const std::string_view digits = hexadecimal ? key_or_index.substr(2) : key_or_index;
    std::uint16_t index = 0;
    const auto result =
        std::from_chars(digits.data(), digits.data() + digits.size(), index, hexadecimal ? 16 : 10);
    if (digits.empty() || result.ec != std::errc{} || result.ptr != digits.data() + digits.size()) {
        return std::nullopt;
    }
    return find_named_parameter(index);
}

std::optional<double> parse_parameter_value(const NamedParameter& parameter, std::string_view text,
                                            std::string& expected) {
    using model::ParameterKind;
    if (parameter.kind == ParameterKind::boolean) {
        if (text == "true" || text == "1") return 1.0;
        if (text == "false" || text == "0") return 0.0;
        expected = "true or false";
        return std::nullopt;
    }
    if (parameter.kind == ParameterKind::choice) {
        expected.clear();
        for (std::size_t i = 0; i < parameter.choices.size(); ++i) {
            if (text == parameter.choices[i]) return static_cast<double>(i);
            expected += (i > 0 ? " or " : "") + parameter.choices[i];
        }
        return std::nullopt;
    }
    const bool whole = parameter.kind == ParameterKind::integer;
    if (parameter.automatic && text == "auto") return 0;
    const std::optional<double> value = parse_number(text);
    if (value.has_value() && *value >= parameter.minimum && *value <= parameter.maximum &&
        (!whole || *value == std::floor(*value))) {
        return value;
    }
    expected = std::string(whole ? "a whole number" : "a number") + " from " +
               number_text(parameter.minimum) + " to " + number_text(parameter.maximum);
    if (!parameter.unit.empty()) expected.append(" ").append(parameter.unit);
    if (parameter.automatic) expected += ", or auto";
    return std::nullopt;
}

std::string parameter_value_text(const NamedParameter& parameter, float value) {
    if (parameter.kind == model::ParameterKind::boolean) return value != 0 ? "true" : "false";
    if (parameter.kind == model::ParameterKind::choice && value >= 0 &&
        static_cast<std::size_t>(value) < parameter.choices.size()) {
        return parameter.choices[static_cast<std::size_t>(value)];
    }
    if (parameter.automatic && value == 0) return "auto";
    std::array<char, 40> digits{};
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    return {digits.data(), end};
}

std::string_view change_text(model::ChangeWhen when) {
    switch (when) {
        case model::ChangeWhen::start:
            return "start";
        case model::ChangeWhen::idle:
            return "idle";
        case model::ChangeWhen::any:
            return "any";
    }
    return "";
}

}  // namespace wheelwright::tools
