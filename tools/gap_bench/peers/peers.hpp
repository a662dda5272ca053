// What others learn from a robot's runs, to compare ours with: written from their published equations, with
// Eigen alone and nothing of our estimators or simulator. They know the robot going forward only: speed and
// torque are the means of both wheels, and one step of the log is one step of theirs.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace wheelwright::peers {

// Evenly sampled, with one period for all runs of a robot.
struct ForwardRun {
    Eigen::VectorXd speed_rad_per_s;
    Eigen::VectorXd torque_Nm;  // from a sample to the next
};

// speed[k+1] = keeps speed[k] + gain torque[k] + offset - friction sign(speed), where dry friction holds what
// it can hold.
struct OneStepLaw {
    double keeps = 1;
    double gain = 0;
    double friction = 0;
    double offset = 0;
};

// Over two samples in a row: where the wheel stands, dry friction holds with a torque that nobody knows.
std::vector<Eigen::Index> moving_steps(const ForwardRun& run, double threshold_rad_per_s);

// The inertia alone: speed differences on torque.
OneStepLaw torque_alone(std::span<const ForwardRun> runs);

// WPILib SysId's: speed[k+1] on speed[k], sign(speed[k]) and voltage[k] (wpilibsuite/allwpilib, sysid,
// FeedforwardAnalysis.cpp).
OneStepLaw sysid_regression(std::span<const ForwardRun> runs, double wheel_radius_m);

// Torque, speed, its sign and 1, all at once, and nothing else.
OneStepLaw plain_least_squares(std::span<const ForwardRun> runs);

// From the run's first speed, over its torques.
Eigen::VectorXd simulate(const OneStepLaw& law, const ForwardRun& run);

// Sum of the squared differences to the run's speeds, over all samples but the first, which the law is given.
double squared_error(const OneStepLaw& law, const ForwardRun& run);

// The same law in time: acceleration = gain (torque - viscous speed - coulomb sign(speed) + offset), of a law
// that slows down. NaN where it does not.
struct ContinuousLaw {
    double gain_per_Nm_s2 = 0;
    double viscous_Nm_s_per_rad = 0;
    double coulomb_Nm = 0;
    double offset_Nm = 0;
};
ContinuousLaw in_time(const OneStepLaw& law, double period_s);

}  // namespace wheelwright::peers
