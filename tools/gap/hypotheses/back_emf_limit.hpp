// A limit of the torque that falls with the speed.
#pragma once

#include <algorithm>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

template <>
struct HypothesisOf<model::BackEmfLimit> : Defaults<model::BackEmfLimit> {
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting& s) {
        // what loses so many times as much of the largest torque, at any speed
        const auto limit = [peak = s.peak_torque_Nm](const Parameters<double>& at, const Eigen::VectorXd& a) {
            const double stall = peak - a(0) * (peak - at[0]);
            return Parameters<double>{stall, at[1] * stall / (a(0) * at[0])};
        };
        StartingPoints from{
            {}, alone, limit, roughly_one, {0.01 * s.peak_torque_Nm, 0.01 * s.peak_speed_rad_per_s}};
        const auto add = [&](double stall, double no_load) {
            from.points.push_back({stall * s.peak_torque_Nm, no_load * s.peak_speed_rad_per_s});
        };
        for (const double stall : {0.7, 0.85, 1.0, 1.2, 1.5}) {
            for (const double no_load : {1.05, 1.25, 1.5, 1.9}) add(stall, no_load);
        }
        // what is far below the torque that is asked for keeps the robot slow
        for (const double stall : {0.45, 0.57}) {
            for (const double no_load : {1.25, 1.7, 2.3}) add(stall, no_load);
        }
        look_beside(from, s);
        from.itself = [most = 4 * s.peak_speed_rad_per_s](const Parameters<double>& p) {
            return p[1] < most;
        };
        return from;
    }
    // NOLINTEND(readability-magic-numbers)
};

}  // namespace wheelwright::gap
