// A differential-drive robot for the tests of the identification library: its own integrator (RK4 at 0.1 ms,
// no code shared with the firmware or the simulator), torque delay with a fraction and a first-order lag,
// Coulomb and viscous friction, encoder counts and noise. Odometry as a firmware would make it.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <random>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/effects.hpp"
#include "tests/support/seeds.hpp"

namespace wheelwright::test {

struct RobotTruth {
    double radius_m = 0.075;
    double track_m = 0.32;
    // the notes' robot
    double k5 = 0.0413, k6 = -0.0413 * 2 * 6.74245 / (0.32 * 1.40855), k7 = 1.40855, k8 = 6.74245;
    double coulomb_left_Nm = 0.3, coulomb_right_Nm = 0.3;
    double viscous_left = 0, viscous_right = 0;
    double offset_m = 0;                   // of the centre of gravity, to the left
    double gain_left = 1, gain_right = 1;  // torque delivered per torque told
    double delay_s = 0.0017, lag_s = 0.001;
    double counts_per_turn = 65536;
    double angle_noise_rad = 0.0002;
};

// The notes' robot with its centre of gravity elsewhere; K6 goes with K5.
inline RobotTruth with_k5(double k5_m) {
    RobotTruth truth;
    truth.k5 = k5_m;
    truth.k6 = -k5_m * 2 * truth.k8 / (truth.track_m * truth.k7);
    return truth;
}

class TestRobot {
  public:
    TestRobot(const RobotTruth& truth, std::uint64_t seed) : truth_(truth), random_(seed) { measure(); }

    // One cycle of 1 ms in which `left`, `right` [Nm] are told at the cycle's start.
    void step(double left_Nm, double right_Nm) {
        constexpr double kStep = 1e-4;
        for (int i = 0; i < 10; ++i) {
            // a command told now acts delay_s later: one slot for each sub-step
            const auto ahead = static_cast<std::uint64_t>(std::lround(truth_.delay_s / kStep));
            const std::uint64_t slot = (now_ + ahead) % kSlots;
            slots_[slot] = {left_Nm, right_Nm};
            const WheelPair<double> told = slots_[now_ % kSlots];
            const double keep = truth_.lag_s > 0 ? std::exp(-kStep / truth_.lag_s) : 0.0;
            // mean of the lagged torque over the sub-step, exact
            const double share = truth_.lag_s > 0 ? truth_.lag_s * (1 - keep) / kStep : 0.0;
            const WheelPair<double> mean{told.left + (torque_.left - told.left) * share,
                                         told.right + (torque_.right - told.right) * share};
            torque_ = {told.left + (torque_.left - told.left) * keep,
                       told.right + (torque_.right - told.right) * keep};
            runge_kutta(kStep, mean);
            ++now_;
        }
        measure();
    }

    const WheelPair<double>& angle_rad() const { return measured_; }
    const Pose<double>& odometry() const { return odometry_; }
    const Twist<double>& velocity() const { return estimate_; }
    Twist<double> true_velocity() const { return {state_[0], state_[1]}; }
    double true_distance_m() const { return std::hypot(state_[4], state_[5]); }
    const RobotTruth& truth() const { return truth_; }

    // A payload: mass and inertia become `factor` times what they were; speeds stay.
    void load(double factor) {
        truth_.k7 /= factor;
        truth_.k8 /= factor;
    }
    // A payload that is small beside its place, `ahead_m` of the axle and `left_m` of the middle; speeds
    // stay. Newton-Euler about the middle of the axle: masses, first and second moments add up.
    void load_at(double share, double ahead_m, double left_m) {
        const double mass = 1 / (truth_.k7 * truth_.radius_m);
        const double inertia = truth_.track_m / (2 * truth_.radius_m * truth_.k8);
        const double load = share * mass;
        const double loaded = mass + load;
        const double turning = inertia + load * (ahead_m * ahead_m + left_m * left_m);
        truth_.k5 = (truth_.k5 * mass + load * ahead_m) / loaded;
        truth_.offset_m = (truth_.offset_m * mass + load * left_m) / loaded;
        truth_.k6 = -truth_.k5 * loaded / turning;
        truth_.k7 = 1 / (loaded * truth_.radius_m);
        truth_.k8 = truth_.track_m / (2 * truth_.radius_m * turning);
    }
    // Of v' that omega' makes, times that of omega' that v' makes.
    double coupling() const {
        return truth_.offset_m * truth_.offset_m * 2 * truth_.k8 / (truth_.track_m * truth_.k7);
    }
    // As load(), but the payload was at rest: momentum stays.
    void drop_load_at_rest(double factor) {
        load(factor);
        state_[0] /= factor;
        state_[1] /= factor;
    }
    void set_motion(double v, double omega) {
        state_[0] = v;
        state_[1] = omega;
        estimate_ = {v, omega};
        wheel_speed_ = {(v - omega * truth_.track_m / 2) / truth_.radius_m,
                        (v + omega * truth_.track_m / 2) / truth_.radius_m};
    }

  private:
    using State = std::array<double, 7>;  // v, omega, wheel angles left and right, x, y, heading
    static constexpr std::uint64_t kSlots = 512;

    State derivative(const State& s, const WheelPair<double>& torque) const {
        const double left = (s[0] - s[1] * truth_.track_m / 2) / truth_.radius_m;
        const double right = (s[0] + s[1] * truth_.track_m / 2) / truth_.radius_m;
        // dry friction with a steep slope through zero, so that it holds the wheel
        const double tl = truth_.gain_left * torque.left - truth_.viscous_left * left -
                          truth_.coulomb_left_Nm * std::clamp(left * 100, -1.0, 1.0);
        const double tr = truth_.gain_right * torque.right - truth_.viscous_right * right -
                          truth_.coulomb_right_Nm * std::clamp(right * 100, -1.0, 1.0);
        const double forward = truth_.k5 * s[1] * s[1] + truth_.k7 * (tr + tl);
        const double turning = truth_.k6 * s[0] * s[1] + truth_.k8 * (tr - tl);
        const double back = truth_.offset_m * 2 * truth_.k8 / (truth_.track_m * truth_.k7);
        const double alone = 1 - coupling();
        return {(forward + truth_.offset_m * turning) / alone,
                (turning + back * forward) / alone,
                left,
                right,
                s[0] * std::cos(s[6]),
                s[0] * std::sin(s[6]),
                s[1]};
    }

    void runge_kutta(double h, const WheelPair<double>& torque) {
        const auto add = [](const State& a, const State& b, double f) {
            State c;
            for (std::size_t i = 0; i < c.size(); ++i) c[i] = a[i] + f * b[i];
            return c;
        };
        const State k1 = derivative(state_, torque);
        const State k2 = derivative(add(state_, k1, h / 2), torque);
        const State k3 = derivative(add(state_, k2, h / 2), torque);
        const State k4 = derivative(add(state_, k3, h), torque);
        for (std::size_t i = 0; i < state_.size(); ++i)
            state_[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    }

    double encode(double angle) {
        const double count = 2 * M_PI / truth_.counts_per_turn;
        return std::floor(angle / count) * count + truth_.angle_noise_rad * normal_(random_);
    }

    void measure() {
        const WheelPair<double> before = measured_;
        measured_ = {encode(state_[2]), encode(state_[3])};
        // wheel speeds by a second-order tracker of 400 rad/s, critically damped
        track(tracked_.left, wheel_speed_.left, measured_.left);
        track(tracked_.right, wheel_speed_.right, measured_.right);
        estimate_ = {(wheel_speed_.right + wheel_speed_.left) * truth_.radius_m / 2,
                     (wheel_speed_.right - wheel_speed_.left) * truth_.radius_m / truth_.track_m};
        const double left = (measured_.left - before.left) * truth_.radius_m;
        const double right = (measured_.right - before.right) * truth_.radius_m;
        odometry_.heading_rad += (right - left) / truth_.track_m;
        odometry_.x_m += (right + left) / 2 * std::cos(odometry_.heading_rad);
        odometry_.y_m += (right + left) / 2 * std::sin(odometry_.heading_rad);
    }

    static void track(double& angle, double& speed, double measured) {
        constexpr double kPole = 0.67032004603563930;  // exp(-400 * 0.001)
        angle += speed * 1e-3;
        const double error = measured - angle;
        angle += (1 - kPole * kPole) * error;
        speed += (1 - kPole) * (1 - kPole) / 1e-3 * error;
    }

    RobotTruth truth_;
    std::mt19937_64 random_;
    std::normal_distribution<double> normal_;
    State state_{};
    WheelPair<double> torque_{};
    std::array<WheelPair<double>, kSlots> slots_{};
    std::uint64_t now_ = 0;
    WheelPair<double> measured_{}, tracked_{}, wheel_speed_{};
    Pose<double> odometry_{};
    Twist<double> estimate_{};
};

// The firmware's geometry of that robot, and its effects: both frictions.
inline model::Geometry<double> geometry_of(const RobotTruth& truth) {
    return {{truth.radius_m, truth.radius_m}, truth.track_m};
}
template <typename Real>
model::EffectSet<Real> both_frictions() {
    model::EffectSet<Real> set;
    for (const char* name : {"viscous_friction", "coulomb_friction"}) {
        set.active[model::find_effect(name)] = true;
    }
    return set;
}

}  // namespace wheelwright::test
