#include "tools/gap/inference/rivals.hpp"

#include <algorithm>

#include "tools/gap/hypotheses/hypotheses.hpp"

namespace wheelwright::gap {

std::vector<NamedEffect> with_unmeasured_rivals(std::vector<NamedEffect> effects,
                                                std::span<const std::size_t> excluded,
                                                double most_report_lag_s) {
    for (NamedEffect& e : effects) {
        for (const Confounder& confounder : hypothesis_of(e.effect).unless_measured) {
            if (e.torque_share < confounder.least_torque_share) continue;
            Rival rival;
            rival.effect = model::find_effect(confounder.effect);
            const auto is_rival = [&](const Rival& r) { return r.effect == rival.effect; };
            std::erase_if(e.rivals, is_rival);
            std::erase_if(e.ruled_out, is_rival);
            if (std::find(excluded.begin(), excluded.end(), rival.effect) != excluded.end()) continue;
            if (rival.effect == kMeasurementLag && e.parameters[0].value > most_report_lag_s) continue;
            rival.confounded = true;
            rival.measurement = confounder.measurement;
            rival.keeps = 1;
            e.rivals.push_back(rival);
        }
    }
    return effects;
}

std::vector<NamedEffect> with_motions(std::vector<NamedEffect> effects, Confusion robot) {
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
    return effects;
}

}  // namespace wheelwright::gap
