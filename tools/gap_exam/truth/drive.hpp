// How the exam's robots are driven, and what their sensors make of it.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "tools/gap_exam/truth/simulator.hpp"

namespace wheelwright::exam {

enum class Motion { quasi_static, dynamic, steps, teleoperation, spin, figure_eight, excitation };
inline constexpr std::array<std::string_view, 7> kMotionNames{
    "quasi-static", "dynamic", "steps", "teleoperation", "spin", "figure-8", "excitation"};

// Speeds wanted of the wheels, and torques on top of the loop, sample by sample.
struct Wanted {
    std::vector<Sides<double>> speed_rad_per_s, torque_Nm;
};

struct Sensors {
    double period_s = 0.01;                           // of commands and rows
    double counts_per_turn = 4096;                    // of a wheel
    double tracking_rad_per_s = 300;                  // the drive's encoder loop, critically damped
    double noise_rad_per_s = 0, noise_time_s = 0.01;  // coloured, of the wheel speeds
    bool gyro = false;
    double gyro_bias_rad_per_s = 0, gyro_noise_rad_per_s = 0, gyro_wander_rad_per_s = 0, gyro_time_s = 1;
    double torque_step_Nm = 0;  // the current's, as torque
    double jitter_s = 0;        // of the time stamps
    double dropped = 0;         // share of the rows
};

struct Driving {
    std::vector<Motion> motions;
    double each_s = 12;
    double loop_rad_per_s = 5;  // bandwidth of the speed loop
};

Sensors draw_sensors(Random& random, const Robot& robot);
Driving draw_driving(Random& random, const Sensors& sensors);
Wanted draw_motion(Random& random, const Robot& robot, const Driving& driving, double period_s);

// The speed report of a drive that filters: two links, the second a quarter of the first.
class LateReport {
  public:
    explicit LateReport(double lag_s) : lag_s_(lag_s) {}
    Sides<double> operator()(const Sides<double>& speed, double step_s);
    void begin(const Sides<double>& speed) { first_ = second_ = speed; }

  private:
    double lag_s_;
    Sides<double> first_{}, second_{};
};

// A drive's encoder loop: follows the angle, and its integrator is the speed (a phase-locked loop).
class Tracking {
  public:
    explicit Tracking(double bandwidth_rad_per_s) : bandwidth_(bandwidth_rad_per_s) {}
    void take(double angle_rad, double step_s);
    double speed_rad_per_s() const { return speed_; }
    void begin(double angle_rad, double speed_rad_per_s) {
        angle_ = angle_rad;
        speed_ = speed_rad_per_s;
    }

  private:
    double bandwidth_, angle_ = 0, speed_ = 0;
};

struct Row {
    // at the row's time: what is logged
    double t_s = 0;
    Sides<double> torque_Nm{}, speed_rad_per_s{};
    double gyro_rad_per_s = 0;
    bool dropped = false;
    // The truth: the command itself, from this row on to the next; motion at the row, as an encoder without
    // errors reports it; and resistance from this row to the next.
    Sides<double> asked_Nm{}, true_rad_per_s{};
    Resistance resistance;
};

struct Drive {
    double period_s = 0;
    bool gyro = false;
    std::vector<Row> rows;
};

// Drives the robot in a loop on what its sensors report.
Drive drive(const Robot& robot, const Sensors& sensors, const Driving& driving, const Wanted& wanted,
            std::uint64_t seed);

// RMS of both wheels' speeds that the robot itself misses the logged ones by when its logged torques run it
// from the first logged speeds, on even ground.
double true_free_run_rms(const Robot& robot, const Sensors& sensors, const Drive& drive);

// As `wheelwright gap` reads it.
std::string csv(const Drive& drive);

}  // namespace wheelwright::exam
