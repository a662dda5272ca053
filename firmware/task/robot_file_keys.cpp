#include "firmware/task/robot_file_keys.hpp"

#include <algorithm>

#include "firmware/model/effects.hpp"

namespace wheelwright::task {
namespace {

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
    TextInfo{"arming.key_file",
             "file of the key without which nobody arms the robot; beside the robot file, or a "
             "whole path. wheelwrightd alone reads it"},
    TextInfo{"dynamics.log", "the log K5..K8 were identified from"},
    TextInfo{"dynamics.date", "the day that log was made, as text or as a date"},
};

}  // namespace

std::span<const MassInfo> mass_table() { return kMassTable; }
std::span<const TextInfo> text_table() { return kTextTable; }

std::vector<KnownKey> known_keys() {
    std::vector<KnownKey> keys;
    for (const model::ParameterInfo& info : model::parameter_table()) {
        keys.push_back({std::string(info.key), info.unit});
    }
    for (const model::EffectInfo& effect : model::kEffects) {
        const std::string prefix = std::string(kEffectsTable) + "." + std::string(effect.name) + ".";
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

std::string names_below(const std::string& path) {
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

bool is_text_key(std::string_view key) {
    return std::any_of(kTextTable.begin(), kTextTable.end(),
                       [&](const TextInfo& info) { return info.key == key; });
}

}  // namespace wheelwright::task
