// A log without its noise, and how it looks to whoever believes in an effect: with the torques that such
// drives would have passed on, and the speeds that such wheels would have had. Formulas of the oracle's own;
// what is linear in a parameter is in oracle_columns.hpp instead.
#pragma once

#include <vector>

#include "tools/gap_trials/hidden/trial.hpp"

namespace wheelwright::hidden {

// One value for each sample.
using Series = std::vector<double>;

struct WheelSeries {
    Series left, right;
};

// Of the robot as a whole.
struct AxisSeries {
    Series forward, turning;
};

struct CleanLog {
    double period_s = 0;
    double duration_s = 0;
    double wheel_radius_m = 0;  // as the robot was meant to be, like the other lengths
    double track_m = 0;
    double castor_ahead_m = 0;
    double wheel_inertia_kg_m2 = 0;
    double peak_torque_Nm = 0;
    double peak_speed_rad_per_s = 0;  // of a wheel
    // Standard deviations that the noisy log has; the speeds' with their counts.
    double speed_noise_rad_per_s = 0;
    double gyro_noise_rad_per_s = 0;
    bool gyro = false;
    WheelSeries torque_Nm;  // commanded, held until the next sample
    WheelSeries speed_rad_per_s;
    Series gyro_rad_per_s;
    std::vector<char> standing;  // not 0: at least one wheel stands, or nearly
};
CleanLog clean_log(const Trial& trial);

// An effect that may be the hidden one. Of its parameters only those are needed in which the motion is not
// linear.
using Candidate = HiddenEffect;

// Radii of two wheels of which the right one is larger by a share of the left one.
struct Radii {
    double relative = 0;

    double left_m(double mean_m) const { return 2 * mean_m / (2 + relative); }
    double right_m(double mean_m) const { return left_m(mean_m) * (1 + relative); }
};

// The log as a set of candidates sees it.
struct View {
    Radii radii;
    WheelSeries speed_rad_per_s;  // that the wheels had
    WheelSeries torque_Nm;        // that reached them, mean until the next sample
    Series v_m_per_s;             // of the robot, from the wheels
    Series w_rad_per_s;
    AxisSeries sums_Nm;  // of the torques

    // What torques at the wheels come to: right + left and right - left, each as a wheel of the mean radius
    // would need it for the same force.
    AxisSeries sums_of(const WheelSeries& wheels_Nm) const;
};
View view_of(const CleanLog& log, const std::vector<Candidate>& candidates);

}  // namespace wheelwright::hidden
