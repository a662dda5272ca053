// The drives' electronics as formulas: what becomes of a commanded torque, and what the encoders tell.
// Angles, speeds and torques are the wheel's.
#pragma once

#include <array>
#include <deque>
#include <string_view>

#include "tools/gap_trials/hidden/effects.hpp"
#include "tools/gap_trials/hidden/plant.hpp"

namespace wheelwright::hidden {

// From command to shaft, in this order:
//   transport_delay        u(t - delay)
//   dead_zone              sign(u) max(|u| - width, 0)
//   torque_gain_mismatch   left u / sqrt(1 + relative), right u sqrt(1 + relative)
//   gain_drift             u (1 - loss t / duration), or u (1 - loss (1 - exp(-t / time_constant)))
//   torque_bias            u + bias
//   torque_saturation      |u| <= limit
//   back_emf_limit         driving: |u| <= stall (1 - |speed| / no_load), never below 0; braking: |u| <=
//   stall (1 +
//                          |speed| / no_load)
//   actuator_lag           time_constant u' = command - u
//   torque_ripple          u + amplitude sin(order angle + phase), angle of that wheel
//   backlash               the motor, motor_inertia, moves freely by half_gap to either side of the wheel and
//                          pushes it by a stiff, damped contact; the encoder sits on the wheel
class TorquePath {
  public:
    // duration_s: over which a linear gain_drift runs. `hidden` must live longer.
    TorquePath(const HiddenSet& hidden, double duration_s);

    // A new command, held from t_s on. Call with growing t_s.
    void command(double t_s, const Pair& torque_Nm);

    // Mean shaft torque of the step that begins at t_s with the wheels as they are then.
    Pair shaft_torque_Nm(double t_s, double step_s, const PlantState& wheels);

    // RMS over both wheels and all steps so far of what torque_bias, back_emf_limit or torque_ripple did.
    double effect_rms_Nm(std::string_view effect) const;

  private:
    struct Command {
        double t_s;
        Pair torque_Nm;
    };
    double held(double t_s, double step_s, bool right);
    double one_wheel(double u, double t_s, double step_s, double speed, double angle, bool right);
    double through_gap(double u, double step_s, double speed, double angle, bool right);

    const HiddenEffect* delay_;
    const HiddenEffect* dead_zone_;
    const HiddenEffect* mismatch_;
    const HiddenEffect* drift_;
    const HiddenEffect* bias_;
    const HiddenEffect* saturation_;
    const HiddenEffect* back_emf_;
    const HiddenEffect* lag_;
    const HiddenEffect* ripple_;
    const HiddenEffect* backlash_;
    double duration_s_;
    std::deque<Command> commands_;
    struct Motor {
        double lagged_Nm = 0;
        double angle_rad = 0;
        double speed_rad_per_s = 0;
    };
    std::array<Motor, 2> motor_;
    double bias_squares_ = 0, back_emf_squares_ = 0, ripple_squares_ = 0;
    double wheel_steps_ = 0;
};

// The drive's speed filter where there is measurement_lag: time_constant reported' = speed - reported.
class SpeedReport {
  public:
    explicit SpeedReport(const HiddenSet& hidden) : lag_(hidden.find("measurement_lag")) {}
    void advance(double step_s, const Pair& speed_rad_per_s);
    Pair reported(const Pair& speed_rad_per_s) const { return lag_ != nullptr ? reported_ : speed_rad_per_s; }

  private:
    const HiddenEffect* lag_;
    Pair reported_;
};

// The step in which a drive can tell speeds: one count per 10 ms, the time over which it counts.
inline constexpr double kCountingTime_s = 0.010;
inline constexpr double kUsualCountsPerTurn = 65536;
double speed_step_rad_per_s(double counts_per_turn);

}  // namespace wheelwright::hidden
