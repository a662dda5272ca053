#include "tools/gap_trials/advised.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "firmware/task/robot_file.hpp"

namespace wheelwright::tools {
namespace {

// Each motion once, of the largest size that it is advised with.
std::vector<excite::Advice> motions_of(const excite::AdviceFile& file) {
    std::vector<excite::Advice> motions;
    for (const excite::Advice& advice : file.advice) {
        const auto same = std::find_if(motions.begin(), motions.end(), [&](const excite::Advice& other) {
            return other.motion == advice.motion;
        });
        if (same == motions.end()) {
            motions.push_back(advice);
        } else {
            same->torque_Nm = std::max(same->torque_Nm, advice.torque_Nm);
        }
    }
    return motions;
}

}  // namespace

hidden::TorqueProgramme programme_of(const excite::Excitation& excitation) {
    hidden::TorqueProgramme programme;
    programme.halt_s = excite::kHalt_s;
    programme.fastest_m_per_s = excitation.speed_limit_m_per_s;
    programme.fastest_yaw_rad_per_s = excitation.yaw_rate_limit_rad_per_s;
    for (int round = 0; round < excitation.rounds; ++round) {
        const auto torque_Nm = [excitation, round](double t_s) {
            // the last set-point, also where a rounding error lies between it and the time
            const double setpoint_s =
                excite::kSetpointPeriod_s * std::floor(t_s / excite::kSetpointPeriod_s + 1e-6);
            const WheelPair<double> torque = excitation.torque_at(round, setpoint_s);
            return hidden::Pair{torque.left, torque.right};
        };
        programme.pushes.push_back({torque_Nm, excite::kMotion_s});
    }
    return programme;
}

void drive_advised(const Asked& asked, Further& further) {
    const hidden::Trial& trial = asked.trial;
    if (trial.plan.kind == hidden::Kind::fault || trial.hidden.find("payload_step") != nullptr ||
        trial.hidden.find("gain_drift") != nullptr) {
        return;
    }
    const excite::AdviceFile file = excite::read_advice((asked.analysis / "gap.json").string());
    if (file.advice.empty()) return;
    std::set<std::string> apart;
    for (const excite::Advice& advice : file.advice) apart.insert({advice.tell, advice.from});
    further.apart.assign(apart.begin(), apart.end());
    further.can_tell = std::any_of(apart.begin(), apart.end(), [&](const std::string& name) {
        return trial.hidden.find(name) != nullptr;
    });
    further.answers.push_back(asked.finding);
    const task::RobotFileResult robot =
        task::read_robot_file((asked.analysis / "robot.extended.toml").string());
    if (!robot.robot) {
        further.driven = "no robot file to drive by";
        return;
    }
    std::vector<std::filesystem::path> logs{asked.log};
    for (const excite::Advice& advice : motions_of(file)) {
        const excite::Excitation excitation =
            excite::plan_excitation(advice, robot.robot->parameters, excite::kUsualRounds);
        std::array<char, 100> text{};
        std::snprintf(text.data(), text.size(), "%s%s %.3g of %.3g Nm", further.driven.empty() ? "" : ", ",
                      std::string(advice.motion->name).c_str(), excitation.size_Nm, advice.torque_Nm);
        further.driven += text.data();
        const hidden::Trial again = hidden::driven_through(trial, programme_of(excitation), asked.make_plant);
        logs.push_back(
            asked.write("advised-" + std::to_string(logs.size()) + ".csv", hidden::csv_text(again)));
    }
    further.answers.push_back(asked.analyse("advised", logs, {}));
}

}  // namespace wheelwright::tools
