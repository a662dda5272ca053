// What a trial may hide: names, parameters and sizes, by the table that the analysis is judged by. Nothing
// here comes from the firmware's catalogue; that both speak of the same effects is what the trials find out.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace wheelwright::hidden {

struct Pair {
    double left = 0;
    double right = 0;
};

// How the three sizes of an effect are meant.
enum class SizeKind {
    share,         // RMS of the effect's wheel torque over RMS of the commanded torque, in that log
    travel_share,  // distance the wheels slip over distance travelled
    peak_share,    // a torque over the largest commanded torque of that log
    value,         // the parameter itself
};

struct ParameterInfo {
    std::string_view name;  // with its unit
    bool linear = false;    // the motion is linear in it: judged more strictly
};

struct EffectInfo {
    std::string_view name;
    std::array<ParameterInfo, 4> parameter_list;  // the last ones may be empty
    SizeKind kind;
    // mild, medium, strong: the ends of the range for shares of torque, the middle for the others
    std::array<std::array<double, 2>, 3> sizes;
    bool needs_gyro = false;
    bool fault_of_log = false;  // a damaged log, not an effect: no name may be given for it
    bool gyro_tells = false;    // from its nearest rival; such robots have a gyro
    bool quick = false;         // shows in quick motions only: such logs hold prbs and chirp, and last 60 s

    std::span<const ParameterInfo> parameters() const {
        std::size_t count = 0;
        while (count < parameter_list.size() && !parameter_list[count].name.empty()) ++count;
        return {parameter_list.data(), count};
    }
};

enum class Size { mild, medium, strong };
std::string_view name_of(Size size);

// All effects, faults of the log last.
std::span<const EffectInfo> all_effects();
const EffectInfo* find_effect(std::string_view name);

struct HiddenEffect {
    std::string name;
    std::map<std::string, double, std::less<>> parameters;

    double operator[](std::string_view parameter) const { return parameters.find(parameter)->second; }
};

// The effects of one robot; at most one of each name.
struct HiddenSet {
    std::vector<HiddenEffect> effects;

    const HiddenEffect* find(std::string_view name) const {
        for (const HiddenEffect& effect : effects) {
            if (effect.name == name) return &effect;
        }
        return nullptr;
    }
};

}  // namespace wheelwright::hidden
