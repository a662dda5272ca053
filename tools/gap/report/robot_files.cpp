#include "tools/gap/report/robot_files.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <span>
#include <sstream>
#include <string_view>

namespace wheelwright::gap {
namespace {

using task::FileChange;

std::string names_of(const std::vector<std::string>& logs) {
    std::string names;
    for (const std::string& log : logs)
        names += (names.empty() ? "" : ", ") + std::filesystem::path(log).filename().string();
    return names;
}

// The given robot file, or one with the geometry alone.
std::string text_to_extend(const Request& request) {
    if (!request.robot_text.empty()) return request.robot_text;
    const model::Geometry<double>& g = request.geometry;
    return "[geometry]\nwheel_radius_m = { left = " + task::shortest_number(g.wheel_radius_m.left) +
           ", right = " + task::shortest_number(g.wheel_radius_m.right) +
           " }\ntrack_m = " + task::shortest_number(g.track_m) + "\n";
}

// Where another geometry was given beside the robot file.
std::vector<FileChange> geometry_changes(const Request& request) {
    if (!request.robot || request.robot_text.empty()) return {};
    const model::Geometry<double>& g = request.geometry;
    const model::Geometry<double>& in_file = request.robot->geometry;
    if (in_file.wheel_radius_m.left == g.wheel_radius_m.left &&
        in_file.wheel_radius_m.right == g.wheel_radius_m.right && in_file.track_m == g.track_m)
        return {};
    return {{"geometry.wheel_radius_m.left", g.wheel_radius_m.left},
            {"geometry.wheel_radius_m.right", g.wheel_radius_m.right},
            {"geometry.track_m", g.track_m}};
}

// A robot file holds what lies in the table's ranges, and no K6 without K5.
void add_dynamics(const std::vector<KFigure>& known, const std::string& logs, std::vector<FileChange>& all) {
    bool has_k5 = false;
    for (const KFigure& k : known) {
        const std::string key = "dynamics." + std::string(k.key);
        const model::ParameterInfo* info = model::find_parameter(key);
        if (info == nullptr || !(k.value >= info->minimum && k.value <= info->maximum)) continue;
        if (k.key == std::string_view("k6_per_m") && !has_k5) continue;
        has_k5 = has_k5 || k.key == std::string_view("k5_m");
        all.push_back({key, k.value});
        if (std::isfinite(k.error)) all.push_back({"dynamics_standard_error." + std::string(k.key), k.error});
    }
    all.push_back({"dynamics.log", logs});
}

// As the simulated robot had them; `but` those that stand there already.
void add_effects(const model::EffectSet<double>& effects, std::span<const NamedEffect> but,
                 std::vector<FileChange>& all) {
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        const bool there =
            std::any_of(but.begin(), but.end(), [&](const NamedEffect& e) { return e.effect == i; });
        if (there || !effects.active[i]) continue;
        for (std::size_t j = 0; j < model::kEffects[i].parameters.size(); ++j) {
            const model::EffectParameterInfo& info = model::kEffects[i].parameters[j];
            all.push_back({"effects." + std::string(model::kEffects[i].name) + "." + std::string(info.name),
                           std::clamp(effects.parameter[i][j], info.minimum, info.maximum)});
        }
    }
}

// The model without what was found, all of it: what is unknown beside a missing effect was fitted too, and
// this file is for no robot. But what nothing moves is no number.
std::vector<FileChange> changes_before(const Findings& f, const Request& request) {
    std::vector<FileChange> all = geometry_changes(request);
    std::vector<std::string> none;
    if (!f.turning) none = {"K6", "K8"};
    if (f.search.base.shape.held_gain[kLinear]) none.emplace_back("K7");
    add_dynamics(known_k(f.before, f.before_error, none), names_of(request.logs), all);
    add_effects(f.effects_before, {}, all);
    return all;
}

std::string write_text(const std::string& path, const std::string& text) {
    std::ofstream file(path);
    file << text;
    file.close();
    return file ? "" : path + " cannot be written";
}

}  // namespace

std::vector<KFigure> known_k(const model::Dynamics<double>& value, const model::Dynamics<double>& error,
                             const std::vector<std::string>& unknowable) {
    std::vector<KFigure> all{{"k5_m", "m", value.k5_m, error.k5_m},
                             {"k6_per_m", "1/m", value.k6_per_m, error.k6_per_m},
                             {"k7_per_kg_m", "1/(kg m)", value.k7_per_kg_m, error.k7_per_kg_m},
                             {"k8_per_kg_m2", "1/(kg m^2)", value.k8_per_kg_m2, error.k8_per_kg_m2}};
    std::erase_if(all, [&](const KFigure& k) {
        return std::any_of(unknowable.begin(), unknowable.end(), [&](const std::string& name) {
            return std::string_view(k.key).substr(1, 1) == name.substr(1);
        });
    });
    return all;
}

std::vector<FileChange> changes(const Findings& f, const Request& request) {
    const std::string logs = names_of(request.logs);
    std::vector<FileChange> all = geometry_changes(request);
    add_dynamics(known_k(f.after, f.after_error, f.search.unknowable), logs, all);
    for (const NamedEffect& e : f.effects) {
        if (!e.in_file) continue;
        const model::EffectInfo& info = model::kEffects[e.effect];
        const std::string table = "effects." + std::string(info.name) + ".";
        for (std::size_t j = 0; j < e.parameters.size(); ++j) {
            // beside this K7 the wheels' rotation belongs to the mass
            const double value = f.effects_after.active[e.effect] ? f.effects_after.parameter[e.effect][j]
                                                                  : e.parameters[j].value;
            all.push_back({table + std::string(info.parameters[j].name), value});
            all.push_back({table + std::string(info.parameters[j].name) + "_standard_error",
                           e.parameters[j].standard_error});
        }
        all.push_back({table + "log", logs});
    }
    // Effects that the given model had already were fitted anew with the rest.
    add_effects(f.effects_after, f.effects, all);
    return all;
}

void make_files(Findings& f, const Request& request) {
    const std::string given = text_to_extend(request);
    const auto make = [&](const std::vector<FileChange>& all, std::string& text) {
        task::EditResult edited = task::set_values(given, all);
        if (edited.text)
            text = std::move(*edited.text);
        else
            f.file_problem = edited.error;
    };
    make(changes(f, request), f.extended_file);
    make(changes_before(f, request), f.before_file);
}

ReadBack read_back(const std::string& text, const std::string& name) {
    ReadBack back;
    task::RobotFileResult read = task::parse_robot_file(text, name);
    if (!read.robot) {
        back.problem = task::to_text(read.problems.front());
        return back;
    }
    back.file = std::move(*read.robot);
    back.robot = simulated_robot(*back.file);
    if (!back.robot) back.problem = name + ": neither K7 nor K8 is known";
    return back;
}

std::string text_of_file(const std::string& path) {
    std::ostringstream text;
    text << std::ifstream(path).rdbuf();
    return text.str();
}

std::string write_robots(const Findings& f, const std::string& folder) {
    if (!f.file_problem.empty()) return f.file_problem;
    std::string problem = write_text(folder + "/robot.extended.toml", f.extended_file);
    if (problem.empty()) problem = write_text(folder + "/robot.before.toml", f.before_file);
    return problem;
}

}  // namespace wheelwright::gap
