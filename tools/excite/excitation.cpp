#include "tools/excite/excitation.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "sim_hal/plant.hpp"
#include "tools/sim/experiments.hpp"

namespace wheelwright::excite {
namespace {

constexpr double kOfLimit = 0.7;        // of speed and yaw rate, foretold
constexpr double kEndOfLimit = 0.9;     // measured: the round ends
constexpr double kSmallestShare = 0.1;  // of the size advised
constexpr double kSmaller = 0.93;       // step of the search for a size that fits
constexpr double kStep_s = 0.001;

// The rounds by the robot file's model, without halts: what follows a round comes to rest in no time.
void foretell(Excitation& e, const model::RobotParameters& robot) {
    e.speed_m_per_s = e.yaw_rate_rad_per_s = e.torque_Nm = e.farthest_m = 0;
    sim::Plant plant(sim::plant_from_dynamics(robot.geometry, robot.dynamics, robot.effects));
    for (int round = 0; round < std::min(e.rounds, 2); ++round) {
        for (double t = 0; t < kMotion_s; t += kStep_s) {
            const WheelPair<double> torque = e.torque_at(round, t);
            plant.advance(kStep_s, torque);
            const Twist<double> u = plant.twist();
            if (e.too_fast(u)) break;
            e.speed_m_per_s = std::max(e.speed_m_per_s, std::abs(u.v_m_per_s));
            e.yaw_rate_rad_per_s = std::max(e.yaw_rate_rad_per_s, std::abs(u.omega_rad_per_s));
            e.torque_Nm = std::max({e.torque_Nm, std::abs(torque.left), std::abs(torque.right)});
            e.farthest_m = std::max(e.farthest_m, std::hypot(plant.pose().x_m, plant.pose().y_m));
        }
        plant.place(plant.pose(), {});
    }
}

}  // namespace

AdviceFile read_advice(const std::string& path) {
    AdviceFile read;
    std::ifstream in(path);
    if (!in) {
        read.problem = path + " cannot be read";
        return read;
    }
    const nlohmann::json root = nlohmann::json::parse(in, nullptr, false);
    if (root.is_discarded() || !root.is_object() || !root.contains("advice") || !root["advice"].is_array()) {
        read.problem = path + " is no gap.json with an advice";
        return read;
    }
    for (const nlohmann::json& one : root["advice"]) {
        if (!one.is_object() || !one.contains("name") || !one.contains("torque_Nm")) continue;
        if (!one["name"].is_string() || !one["torque_Nm"].is_number()) continue;
        const Motion* motion = find_motion(one["name"].get<std::string>());
        const double size = one["torque_Nm"].get<double>();
        if (motion == nullptr || !(size > 0)) {
            read.problem = path + ": the advice " + one.dump() + " names no motion of this version";
            return read;
        }
        const auto text = [&](const char* key) {
            return one.contains(key) && one[key].is_string() ? one[key].get<std::string>() : std::string();
        };
        read.advice.push_back({text("tell"), text("from"), motion, size});
    }
    if (read.advice.empty()) read.problem = path + " advises no motion: there is nothing to tell apart";
    return read;
}

WheelPair<double> Excitation::torque_at(int round, double t_s) const {
    const WheelPair<double> torque = motion->torque_Nm(t_s, size_Nm);
    const double sign = round % 2 == 0 ? 1 : -1;
    return {sign * torque.left, sign * torque.right};
}

bool Excitation::too_fast(const Twist<double>& u) const {
    return std::abs(u.v_m_per_s) > speed_limit_m_per_s ||
           std::abs(u.omega_rad_per_s) > yaw_rate_limit_rad_per_s;
}

double Excitation::duration_s() const { return rounds * (kMotion_s + kHalt_s); }

Excitation plan_excitation(const Advice& advice, const model::RobotParameters& robot, int rounds) {
    Excitation e;
    e.motion = advice.motion;
    e.size_Nm = advice.torque_Nm;
    e.rounds = rounds;
    const auto fits = [&] {
        return e.speed_m_per_s <= kOfLimit * robot.limits.speed_m_per_s &&
               e.yaw_rate_rad_per_s <= kOfLimit * robot.limits.yaw_rate_rad_per_s &&
               e.torque_Nm <= robot.limits.torque_Nm;
    };
    e.speed_limit_m_per_s = kEndOfLimit * robot.limits.speed_m_per_s;
    e.yaw_rate_limit_rad_per_s = kEndOfLimit * robot.limits.yaw_rate_rad_per_s;
    for (foretell(e, robot); !fits() && e.size_Nm > kSmallestShare * advice.torque_Nm; foretell(e, robot)) {
        e.size_Nm *= kSmaller;
    }
    if (!fits()) {
        // With a bias or on a slope it rolls away whatever the size: rounds will end early.
        e.size_Nm = advice.torque_Nm;
        for (foretell(e, robot); e.torque_Nm > robot.limits.torque_Nm; foretell(e, robot))
            e.size_Nm *= kSmaller;
    }
    return e;
}

std::string drive_excitation(tools::Simulation& sim, const Excitation& e,
                             const std::function<void(double)>& progress) {
    std::string stopped;
    const auto left = [&](protocol::Mode mode) {
        const auto& supervisor = sim.cycle().supervisor();
        if (supervisor.mode() == mode) return false;
        stopped = "the robot left the mode " + std::string(to_string_view(mode));
        if (supervisor.fault() != protocol::Fault::none) {
            stopped += ": fault " + std::string(to_string_view(supervisor.fault()));
        }
        return true;
    };
    const auto setpoints = static_cast<int>(std::lround(kMotion_s / kSetpointPeriod_s));
    for (int round = 0; round < e.rounds && stopped.empty(); ++round) {
        sim.host().torque({});
        if (!tools::enter_mode(sim, protocol::Mode::torque)) {
            left(protocol::Mode::torque);
            break;
        }
        for (int i = 0; i < setpoints; ++i) {
            sim.host().torque(e.torque_at(round, i * kSetpointPeriod_s));
            sim.run_for(kSetpointPeriod_s);
            if (left(protocol::Mode::torque) || e.too_fast(sim.cycle().observer().motion().twist)) break;
        }
        if (!stopped.empty()) break;
        sim.host().velocity({});
        tools::enter_mode(sim, protocol::Mode::velocity);
        sim.run_for(kHalt_s);
        if (progress) progress(double(round + 1) / e.rounds);
    }
    sim.host().silence();
    if (stopped.empty()) tools::enter_mode(sim, protocol::Mode::idle);
    return stopped;
}

}  // namespace wheelwright::excite
