// The drives that show what the firmware can do, each as one function from a Simulation to figures: used by
// the demo, by the pages and by the tests, so that all of them speak of the same thing. Only the judge in
// here looks at the simulated robot's truth; the firmware is spoken to by CAN frames alone.
//
// Each function starts from a robot at rest in the idle mode and leaves it so, unless it says otherwise.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "firmware/control/trajectory.hpp"
#include "tools/sim/simulation.hpp"

namespace wheelwright::tools {

// Told how far a long drive is, 0..1; may be empty.
using Progress = std::function<void(double share)>;

// K5..K8 as an observer with the controller's geometry must see them: speeds measured with its radius and
// track.
model::Dynamics<double> as_seen_with(const model::Dynamics<double>& truth,
                                     const model::Geometry<double>& true_geometry,
                                     const model::Geometry<double>& believed_geometry);

struct IdentificationResult {
    bool succeeded = false;
    double duration_s = 0;
    double farthest_m = 0;       // from the start, by the truth
    double fastest_m_per_s = 0;  // of a wheel's rim, by the truth
    Twist<double> fastest;       // the robot's own speed and yaw rate, by the truth, each at its highest
    double probe_s = 0;          // when the probe was over; the whole duration where it never was
    double clipped_s = 0;        // when the firmware first said that less torque arrives; 0: never
    double delay_s = 0;
    ident::DynamicsEstimate<double> estimate;
    // For plots, ten a second: estimates and standard errors over time.
    std::vector<double> time_s;
    std::vector<model::Dynamics<double>> value, standard_error;
};
IdentificationResult identify(Simulation& sim, const Progress& progress = {});

struct StepResponse {
    double settling_s = 0;  // from the first frame that carries the step, to 1 % for good
    double overshoot = 0;   // share of the step
    std::vector<double> time_s, v_m_per_s, omega_rad_per_s;  // truth, each millisecond
};
// Velocity mode at rest, then a step of the set-point. True speeds are judged: v where twist.v is not zero,
// else omega.
StepResponse velocity_step(Simulation& sim, const Twist<double>& step, double hold_s = 0.5);

struct PathSample {
    double time_s = 0;
    Pose<double> reference, truth, believed;
    Pose<double> bare_odometry;  // wheels alone, from the true start of this drive
    double error_m = 0;          // truth against the reference point at that time
    WheelPair<double> torque_Nm;
};
struct TrackingOptions {
    protocol::Mode mode = protocol::Mode::trajectory;
    control::PathSettings<double> path;
    // At the pace that the path asks for; longer by as much as the firmware drives it slower.
    double duration_s = 42;
    double judge_from_s = 12;
    bool external_poses = true;                             // after the first one, which tells the start
    std::function<void(Simulation&, double time_s)> event;  // called after each cycle
};
struct TrackingResult {
    bool entered = false;
    protocol::TrajectoryPace pace;  // as the firmware says it
    double rms_m = 0, peak_m = 0;
    double largest_torque_Nm = 0;
    std::vector<PathSample> samples;  // a hundred a second
};
TrackingResult track(Simulation& sim, const TrackingOptions& options, const Progress& progress = {});

struct GoalResult {
    bool reached = false;   // within the tolerance and 1 degree by the truth, held for 2 s, within the time
    double time_s = 0;      // until it was there for good
    double distance_m = 0;  // at the end
    double heading_error_rad = 0;
    double quiet_torque_Nm = 0;  // largest change of torque between cycles while holding
};
GoalResult drive_to(Simulation& sim, const Pose<double>& goal, protocol::PoseDirection direction,
                    double at_most_s = 60, double tolerance_m = 0.01);

// The +share payload of the issue: mass and inertia grow together, the centre of gravity stays.
void drop_payload(sim::World& world, double share);

// Asks for a mode and waits until it is entered (or until the fault mode, or 3 s). True: entered.
bool enter_mode(Simulation& sim, protocol::Mode mode);

// The example robots, read from the folder of robot files. Throws std::runtime_error with all diagnostics.
task::RobotFile load_robot(const std::string& path);

}  // namespace wheelwright::tools
