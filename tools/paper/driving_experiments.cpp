#include "tools/paper/driving_experiments.hpp"

#include <algorithm>
#include <cmath>

#include "firmware/control/pose_control.hpp"
#include "firmware/model/dynamics.hpp"
#include "sim_hal/plant.hpp"
#include "tools/paper/velocity_experiments.hpp"

namespace wheelwright::paper {
namespace {

constexpr double kCycle_s = 0.001;

// Those that the robot file gives, and the paper's where it leaves them to the firmware.
control::PoseControlSettings<double> paper_gains(const model::RobotParameters& robot) {
    auto settings = control::pose_control_settings<double>(robot);
    if (robot.pose_control.gamma1 <= 0) settings.gamma1 = kPaperGamma1_per_s;
    if (robot.pose_control.gamma2 <= 0) settings.gamma2 = kPaperGamma2_per_s;
    return settings;
}

// The paper's whole controller and its robot.
class PaperRobot {
  public:
    PaperRobot(const model::RobotParameters& believed, const model::RobotParameters& truth,
               const Pose<double>& start)
        : geometry_(believed.geometry),
          settings_(paper_gains(believed)),
          limit_Nm_(believed.limits.torque_Nm),
          plant_(sim::plant_from_dynamics(truth.geometry, truth.dynamics, {}), start),
          dynamics_(sim::plant_dynamics(plant_.parameters())),
          odometry_(start),
          angle_(plant_.wheel_angle_rad()) {}

    void step(const Pose<double>& goal, bool forward) {
        const WheelPair<double> angle = plant_.wheel_angle_rad();
        const double left = geometry_.wheel_radius_m.left * (angle.left - angle_.left);
        const double right = geometry_.wheel_radius_m.right * (angle.right - angle_.right);
        angle_ = angle;
        odometry_ =
            model::advance_along_arc(odometry_, (right + left) / 2, (right - left) / geometry_.track_m);
        const Twist<double> u = model::twist_from_wheel_speeds(geometry_, plant_.wheel_speed_rad_per_s());
        command_ =
            control::paper_pose_law(settings_, control::polar_error(odometry_, goal, forward), forward);
        const double ev = command_.v_m_per_s - u.v_m_per_s;
        const double ew = command_.omega_rad_per_s - u.omega_rad_per_s;
        const TwistRate<double> nu{kPaperKp_per_s * ev + integral_.v_m_per_s2,
                                   kPaperKp_per_s * ew + integral_.omega_rad_per_s2};
        WheelPair<double> torque = model::inverse_dynamics(dynamics_, u, nu);
        const bool free = std::abs(torque.left) <= limit_Nm_ && std::abs(torque.right) <= limit_Nm_;
        torque.left = std::clamp(torque.left, -limit_Nm_, limit_Nm_);
        torque.right = std::clamp(torque.right, -limit_Nm_, limit_Nm_);
        if (free) {  // the print has no limit; the simplest anti-windup keeps it from mattering
            integral_.v_m_per_s2 += kPaperKi_per_s2 * kCycle_s * ev;
            integral_.omega_rad_per_s2 += kPaperKi_per_s2 * kCycle_s * ew;
        }
        plant_.advance(kCycle_s / 2, torque);
        plant_.advance(kCycle_s / 2, torque);
    }

    const Pose<double>& truth() const { return plant_.pose(); }
    const Pose<double>& odometry() const { return odometry_; }
    const Twist<double>& twist() const { return plant_.twist(); }

  private:
    model::Geometry<double> geometry_;
    control::PoseControlSettings<double> settings_;
    double limit_Nm_;
    sim::Plant plant_;
    model::Dynamics<double> dynamics_;
    Pose<double> odometry_;
    WheelPair<double> angle_;
    Twist<double> command_;
    TwistRate<double> integral_;
};

double along(const Pose<double>& reference, const Pose<double>& robot) {
    return std::cos(reference.heading_rad) * (reference.x_m - robot.x_m) +
           std::sin(reference.heading_rad) * (reference.y_m - robot.y_m);
}

double across(const Pose<double>& reference, const Pose<double>& robot) {
    return std::cos(reference.heading_rad) * (reference.y_m - robot.y_m) -
           std::sin(reference.heading_rad) * (reference.x_m - robot.x_m);
}

}  // namespace

PaperDrive drive_paper_law(const model::RobotParameters& believed, const model::RobotParameters& truth,
                           const PaperDriveOptions& options) {
    PaperDrive result;
    PaperRobot robot(believed, truth, options.start);
    const auto cycles = static_cast<int>(std::lround(options.duration_s / kCycle_s));
    double squares = 0;
    int judged = 0;
    int backwards = 0;
    for (int n = 0; n <= cycles; ++n) {
        const double t = n * kCycle_s;
        const Pose<double> goal = control::path_point(options.path, t).pose;
        const double error = std::hypot(robot.truth().x_m - goal.x_m, robot.truth().y_m - goal.y_m);
        if (n % 10 == 0) result.samples.push_back({t, goal, robot.truth(), robot.odometry(), error});
        if (t >= options.judge_from_s) {
            squares += error * error;
            result.peak_m = std::max(result.peak_m, error);
            result.along_m += along(goal, robot.odometry());
            result.across_m += std::abs(across(goal, robot.odometry()));
            if (robot.twist().v_m_per_s < 0) ++backwards;
            ++judged;
        }
        robot.step(goal, options.forward);
    }
    if (judged > 0) {
        result.rms_m = std::sqrt(squares / judged);
        result.along_m /= judged;
        result.across_m /= judged;
        result.reverse_share = static_cast<double>(backwards) / judged;
    }
    result.odometry_error_m =
        std::hypot(robot.truth().x_m - robot.odometry().x_m, robot.truth().y_m - robot.odometry().y_m);
    return result;
}

PaperLag paper_law_on_a_line(const model::RobotParameters& believed, const model::RobotParameters& truth,
                             bool forward) {
    PaperRobot robot(believed, truth, {});
    constexpr int kCycles = 20000;
    constexpr int kLast = 5000;
    PaperLag lag;
    for (int n = 0; n < kCycles; ++n) {
        const Pose<double> goal{0.3 * kCycle_s * n, 0, 0};
        robot.step(goal, forward);
        if (n < kCycles - kLast) continue;
        lag.behind_m += along(goal, robot.odometry()) / kLast;
        lag.aside_m += across(goal, robot.odometry()) / kLast;
    }
    lag.aside_m = std::abs(lag.aside_m);
    lag.backwards = robot.twist().v_m_per_s < 0;
    return lag;
}

}  // namespace wheelwright::paper
