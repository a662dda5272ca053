#include "tools/gap/gap_rivals.hpp"

#include <algorithm>

namespace wheelwright::gap {

void name_voltage_drag(std::vector<NamedEffect>& effects, std::span<const std::size_t> excluded) {
    constexpr double kMostOfTheTorque = 0.5;
    constexpr std::size_t kViscous = model::find_effect("viscous_friction");
    constexpr std::size_t kBackEmf = model::find_effect("back_emf_limit");
    const bool left_out = std::find(excluded.begin(), excluded.end(), kBackEmf) != excluded.end();
    const auto is_back_emf = [](const Rival& r) { return r.effect == kBackEmf; };
    for (NamedEffect& e : effects) {
        if (e.effect != kViscous || e.torque_share < kMostOfTheTorque) continue;
        std::erase_if(e.rivals, is_back_emf);
        std::erase_if(e.ruled_out, is_back_emf);
        if (left_out) continue;
        Rival rival;
        rival.effect = kBackEmf;
        rival.alike = rival.torque_is_voltage = true;
        rival.keeps = 1;
        e.rivals.push_back(rival);
    }
}

void advise_motions(std::vector<NamedEffect>& effects, Confusion robot) {
    for (NamedEffect& e : effects) {
        for (Rival& r : e.rivals) {
            if (r.torque_is_voltage) continue;
            robot.effect = e.effect;
            robot.rival = r.effect;
            const Separation found = separating_motion(robot);
            r.motion = found.motion;
            r.motion_size_Nm = found.size_Nm;
        }
    }
}

}  // namespace wheelwright::gap
