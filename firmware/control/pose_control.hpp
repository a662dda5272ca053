// Drives to a pose and holds it: the law of eq (74)-(83) in polar coordinates, with what the print leaves
// out (notes 1, 8, 10).
//
// With e, psi, alpha of eq (75)-(77) and c = cos(alpha):
//   u1 = -g e c
//   u2 = -gamma2 alpha - g c sin(alpha) + g (lambda3 / lambda2) c sinc(alpha) psi
// Printed, e and psi run from the goal to the robot, so alpha = 0 faces away from the goal and the robot
// backs in. Mirroring (x, y) -> (-x, -y) and negating u1 drives forward. Ours differs from the print so:
//   - alpha is wrapped; psi is kept continuous across +-pi with some hysteresis, so that the law does not
//   chatter
//     behind the goal;
//   - c is taken as max(cos alpha, 0): the robot turns before it drives, and never moves against its
//   direction.
//     The Lyapunov function (79) still falls: V' = -g lambda1 e^2 c cos(alpha) - gamma2 lambda2 alpha^2;
//   - g = gamma1 near the goal and falls to speed / e far from it, which (84) allows, for it holds at every
//     instant with the g of that instant;
//   - speed and yaw rate are scaled jointly to their limits and limited in acceleration;
//   - close to the goal, where noise of the pose turns alpha about, the yaw rate shrinks with e, and the
//     direction is free;
//   - finishing: v = 0 inside stop_radius, turn onto the heading, hold; pursue again outside rearm_radius.
//
// One thread; no allocation; about 810 instructions. Paper law: exactly (75)-(83) with alpha wrapped.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "firmware/control/feedback_linearisation.hpp"
#include "firmware/control/limits.hpp"
#include "firmware/control/reference.hpp"
#include "firmware/model/robot_parameters.hpp"

namespace wheelwright::control {

enum class PosePhase : std::uint8_t {
    none,      // no goal
    approach,  // drives to the position
    turn,      // position reached, turns onto the heading
    reached,   // holds; leaves when pushed away
};

template <typename Real>
struct PoseControlSettings {
    Real gamma1{};        // 1/s
    Real gamma2{};        // 1/s
    Real lambda_ratio{};  // lambda3 / lambda2
    Real speed_m_per_s{};
    Real yaw_rate_rad_per_s{};
    Real acceleration_m_per_s2{};
    Real yaw_acceleration_rad_per_s2{};
    Real stop_radius_m{};
    Real rearm_radius_m{};  // > stop_radius_m
    Real heading_tolerance_rad{};
};

// Settings from the robot file. What it leaves at "auto":
// - a quarter of the usual acceleration, half of the usual yaw acceleration: turning comes first;
// - half of the speed limit, and a third of the yaw rate limit;
// - gamma2 a twelfth of the velocity loops' rate, and so low that a bearing error of 0.8 rad asks for no more
//   than the usual yaw acceleration; gamma1 a third of it, for the bearing has to be right before the way is
//   driven;
// - where it stops: a hundredth of the track, or twice the noise of the poses from outside; the heading, by
// theirs.
template <typename Real>
PoseControlSettings<Real> pose_control_settings(const model::RobotParameters& from) {
    const auto& p = from.pose_control;
    const auto given = [](double value, double automatic) { return value > 0 ? value : automatic; };
    const auto [usual, usual_yaw] = usual_acceleration(from);
    const double yaw_acceleration = std::min(given(p.yaw_acceleration_rad_per_s2, usual_yaw / 2),
                                             from.limits.yaw_acceleration_rad_per_s2);
    const double loop_per_s =
        kTimeConstantsToOnePercent / velocity_loop_speed(from, kObserverCycle_s).settling_time_s;
    const double gamma2 = given(p.gamma2, std::min(loop_per_s / 12, std::sqrt(1.2 * usual_yaw)));
    const double stop = given(p.stop_radius_m,
                              std::max(from.geometry.track_m / 100, 2 * from.odometry.external_pose_noise_m));
    PoseControlSettings<Real> to;
    to.gamma1 = Real(given(p.gamma1, gamma2 / 3));
    to.gamma2 = Real(gamma2);
    to.lambda_ratio = Real(p.lambda_ratio);
    to.speed_m_per_s =
        Real(std::min(given(p.speed_m_per_s, from.limits.speed_m_per_s / 2), from.limits.speed_m_per_s));
    to.yaw_rate_rad_per_s = Real(std::min(given(p.yaw_rate_rad_per_s, from.limits.yaw_rate_rad_per_s / 3),
                                          from.limits.yaw_rate_rad_per_s));
    to.acceleration_m_per_s2 =
        Real(std::min(given(p.acceleration_m_per_s2, usual / 4), from.limits.acceleration_m_per_s2));
    to.yaw_acceleration_rad_per_s2 = Real(yaw_acceleration);
    to.stop_radius_m = Real(stop);
    to.rearm_radius_m = Real(std::max(given(p.rearm_radius_m, 2.25 * stop), stop));
    to.heading_tolerance_rad =
        Real(given(p.heading_tolerance_rad, 1.25 * from.odometry.external_heading_noise_rad));
    return to;
}

// Robot against goal in polar coordinates, eq (74)-(77); mirrored for driving forward.
template <typename Real>
struct PolarError {
    Real distance_m{};
    Real psi_rad{};    // (-pi, pi]
    Real alpha_rad{};  // (-pi, pi]
};

template <typename Real>
PolarError<Real> polar_error(const Pose<Real>& robot, const Pose<Real>& goal, bool forward) {
    const Real sign = forward ? Real(-1) : Real(1);
    const Real c = std::cos(goal.heading_rad);
    const Real s = std::sin(goal.heading_rad);
    const Real dx = robot.x_m - goal.x_m;
    const Real dy = robot.y_m - goal.y_m;
    const Real x = sign * (c * dx + s * dy);
    const Real y = sign * (c * dy - s * dx);
    PolarError<Real> error;
    error.distance_m = std::sqrt(x * x + y * y);
    error.psi_rad = error.distance_m > 0 ? std::atan2(y, x) : Real(0);
    error.alpha_rad = wrap_angle_rad(robot.heading_rad - goal.heading_rad - error.psi_rad);
    return error;
}

// sin(a) / a, given sin(a), with its series near zero.
template <typename Real>
Real sine_over_angle(Real angle_rad, Real sine) {
    return std::abs(angle_rad) < Real(0.02) ? 1 - angle_rad * angle_rad / 6 : sine / angle_rad;
}

// The paper's law (82), (83) with the goal moving or at rest, as printed (forward = false) or mirrored.
// Nothing is limited. For the paper's figures and comparisons.
template <typename Real>
Twist<Real> paper_pose_law(const PoseControlSettings<Real>& settings, const PolarError<Real>& error,
                           bool forward) {
    const Real c = std::cos(error.alpha_rad);
    const Real s = std::sin(error.alpha_rad);
    const Real g = settings.gamma1;
    const Real v = -g * error.distance_m * c;
    const Real w = -settings.gamma2 * error.alpha_rad - g * c * s +
                   g * settings.lambda_ratio * c * sine_over_angle(error.alpha_rad, s) * error.psi_rad;
    return {forward ? -v : v, w};
}

template <typename Real>
struct PoseCommand {
    VelocityReference<Real> reference;
    PosePhase phase = PosePhase::none;
    bool goal_reached = false;  // position and heading within their tolerances, and standing
    bool forward = true;        // direction driven now
    Real distance_m{};
    Real heading_error_rad{};  // robot less goal
    LimiterFlags flags;
};

template <typename Real>
class PoseController {
  public:
    void configure(const PoseControlSettings<Real>& settings) {
        settings_ = settings;
        limiter_.configure(settings.acceleration_m_per_s2, settings.yaw_acceleration_rad_per_s2);
    }

    // Forgets the goal; the commanded twist starts at the robot's present one.
    void start(const Twist<Real>& present) {
        limiter_.reset(present);
        phase_ = PosePhase::none;
    }

    // Sets or moves the goal; the commanded twist stays continuous. Repeating the same goal changes nothing.
    void set_goal(const Pose<Real>& goal, model::GoalDirection direction) {
        const bool same = phase_ != PosePhase::none && goal.x_m == goal_.x_m && goal.y_m == goal_.y_m &&
                          goal.heading_rad == goal_.heading_rad && direction == direction_;
        if (same) return;
        goal_ = goal;
        direction_ = direction;
        phase_ = PosePhase::approach;
        fresh_ = true;
    }

    bool has_goal() const { return phase_ != PosePhase::none; }

    // The velocity reference for this cycle; at rest when there is no goal.
    PoseCommand<Real> update(const Pose<Real>& robot, Real dt_s) {
        PoseCommand<Real> out;
        Twist<Real> wanted{};
        if (phase_ != PosePhase::none) wanted = pursue(robot, out);
        wanted = scale_jointly(wanted, settings_.speed_m_per_s, settings_.yaw_rate_rad_per_s, out.flags);
        const Twist<Real> before = limiter_.now();
        LimiterFlags slow;
        const Twist<Real> now = limiter_.step(wanted, dt_s, slow);
        out.flags.add(slow);
        out.reference.twist = now;
        if (slow.bits != 0) {  // a ramp whose slope is known
            out.reference.rate = {(now.v_m_per_s - before.v_m_per_s) / dt_s,
                                  (now.omega_rad_per_s - before.omega_rad_per_s) / dt_s};
        }
        out.phase = phase_;
        out.forward = forward_;
        out.goal_reached = phase_ == PosePhase::reached && now.v_m_per_s == 0 && now.omega_rad_per_s == 0;
        return out;
    }

  private:
    Twist<Real> pursue(const Pose<Real>& robot, PoseCommand<Real>& out) {
        const Real dx = robot.x_m - goal_.x_m;
        const Real dy = robot.y_m - goal_.y_m;
        const Real distance = std::sqrt(dx * dx + dy * dy);
        const Real heading_error = wrap_angle_rad(robot.heading_rad - goal_.heading_rad);
        out.distance_m = distance;
        out.heading_error_rad = heading_error;
        choose_phase(distance, heading_error);
        if (phase_ == PosePhase::approach) return approach(robot, distance);
        if (phase_ == PosePhase::turn) {
            return {0, -turning_rate(heading_error)};
        }
        return {};
    }

    // gamma2 times the error, and no faster than the yaw acceleration can stop (with some reserve).
    Real turning_rate(Real error_rad) const {
        const Real size = std::abs(error_rad);
        const Real stopping = std::sqrt(settings_.yaw_acceleration_rad_per_s2 * size);
        return std::copysign(std::min(settings_.gamma2 * size, stopping), error_rad);
    }

    void choose_phase(Real distance, Real heading_error) {
        const Real tolerance = settings_.heading_tolerance_rad;
        if (phase_ != PosePhase::approach && distance > settings_.rearm_radius_m) {
            phase_ = PosePhase::approach;
            fresh_ = true;
        }
        if (phase_ == PosePhase::approach && distance < settings_.stop_radius_m) phase_ = PosePhase::turn;
        if (phase_ == PosePhase::turn && std::abs(heading_error) < tolerance / 2) phase_ = PosePhase::reached;
        if (phase_ == PosePhase::reached && std::abs(heading_error) > 2 * tolerance) phase_ = PosePhase::turn;
    }

    static Real effort(const PolarError<Real>& error) {
        return std::abs(error.alpha_rad) + std::abs(error.psi_rad);
    }

    void choose_direction(const Pose<Real>& robot, bool near, PolarError<Real>& error) {
        constexpr Real decided = Real(0.8);  // rad of turning saved that justify a change of direction
        const bool was = forward_;
        if (direction_ == model::GoalDirection::automatic || near) {
            if (fresh_ && !near) forward_ = true;
            error = polar_error(robot, goal_, forward_);
            // The other direction sees the goal from the other side: both angles turn by half a turn.
            const PolarError<Real> other{error.distance_m, wrap_angle_rad(error.psi_rad + Real(kPi)),
                                         wrap_angle_rad(error.alpha_rad - Real(kPi))};
            // Near the goal only the way there counts, for the turn at the end is made in place.
            const Real gain =
                near ? std::abs(error.alpha_rad) - std::abs(other.alpha_rad) : effort(error) - effort(other);
            if (gain > (fresh_ ? Real(0) : decided)) {
                forward_ = !forward_;
                error = other;
            }
        } else {
            forward_ = direction_ == model::GoalDirection::forward;
            error = polar_error(robot, goal_, forward_);
        }
        if (fresh_ || forward_ != was) last_psi_ = error.psi_rad;
        fresh_ = false;
    }

    Twist<Real> approach(const Pose<Real>& robot, Real distance) {
        const Real close = 3 * settings_.rearm_radius_m;
        PolarError<Real> error;
        choose_direction(robot, distance < close, error);
        Real psi = last_psi_ + wrap_angle_rad(error.psi_rad - last_psi_);
        if (std::abs(psi) > Real(kPi + 0.5)) psi = error.psi_rad;
        last_psi_ = psi;

        const Real c = std::max(std::cos(error.alpha_rad), Real(0));
        const Real s = std::sin(error.alpha_rad);
        // Braking from the speed g e at 0.7 of the acceleration: v <= sqrt(2 a e).
        const Real e = std::max(distance, Real(1e-6));
        const Real braking = std::sqrt(Real(1.4) * settings_.acceleration_m_per_s2 * e);
        const Real g = std::min(settings_.gamma1, std::min(settings_.speed_m_per_s, braking) / e);
        const Real v = -g * e * c;
        const Real calm = std::min(e / close, Real(1));
        const Real w = calm * (-turning_rate(error.alpha_rad) - g * c * s +
                               g * settings_.lambda_ratio * c * sine_over_angle(error.alpha_rad, s) * psi);
        return {forward_ ? -v : v, w};
    }

    static constexpr double kPi = 3.14159265358979323846;

    PoseControlSettings<Real> settings_;
    TwistRateLimiter<Real> limiter_;
    Pose<Real> goal_;
    model::GoalDirection direction_ = model::GoalDirection::forward;
    PosePhase phase_ = PosePhase::none;
    Real last_psi_{};
    bool forward_ = true;
    bool fresh_ = true;
};

}  // namespace wheelwright::control
