#include "tools/gap/inference/rivals.hpp"

#include <algorithm>
#include <array>
#include <string_view>

namespace wheelwright::gap {

void name_unmeasured(std::vector<NamedEffect>& effects, std::span<const std::size_t> excluded) {
    constexpr double kMostOfTheTorque = 0.5;
    struct Alike {
        std::size_t effect, rival;
        double least_share;
        std::string_view measurement;
    };
    constexpr std::array kAlikes{
        Alike{model::find_effect("viscous_friction"), model::find_effect("back_emf_limit"), kMostOfTheTorque,
              "torque from the motors' currents: this one may be made from voltage, back-EMF not taken off"},
        Alike{model::find_effect("transport_delay"), model::find_effect("measurement_lag"), 0,
              "a gyro or an accelerometer: the speeds may be told late, as late as the torque seems"}};
    for (NamedEffect& e : effects) {
        for (const Alike& alike : kAlikes) {
            if (e.effect != alike.effect || e.torque_share < alike.least_share) continue;
            const auto is_rival = [&](const Rival& r) { return r.effect == alike.rival; };
            std::erase_if(e.rivals, is_rival);
            std::erase_if(e.ruled_out, is_rival);
            if (std::find(excluded.begin(), excluded.end(), alike.rival) != excluded.end()) continue;
            Rival rival;
            rival.effect = alike.rival;
            rival.alike = true;
            rival.measurement = alike.measurement;
            rival.keeps = 1;
            e.rivals.push_back(rival);
        }
    }
}

void advise_motions(std::vector<NamedEffect>& effects, Confusion robot) {
    for (NamedEffect& e : effects) {
        for (Rival& r : e.rivals) {
            if (!r.measurement.empty()) continue;
            robot.effect = e.effect;
            robot.rival = r.effect;
            const Separation found = separating_motion(robot);
            r.motion = found.motion;
            r.motion_size_Nm = found.size_Nm;
        }
    }
}

}  // namespace wheelwright::gap
