// A run as its file has it, in SI units, before anything is repaired; and how it becomes evenly sampled
// segments.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "tools/logs/measured_log.hpp"

namespace wheelwright::tools {

struct RawSample {
    double t_s = 0;
    WheelPair<double> torque_Nm;
    WheelPair<double> wheel;  // speeds, rad/s; or angles, rad
    double gyro = 0;          // rad/s; or rad
    double accel_m_per_s2 = 0;
    std::size_t line = 0;
};

struct RawLog {
    std::string run;
    std::vector<RawSample> samples;
    bool angles = false;
    bool has_gyro = false;
    bool gyro_is_angle = false;
    bool has_accel = false;
    std::size_t refreshed_every = 0;  // samples from one fresh angle to the next; 0: as the samples show
};

// As the samples show.
std::size_t refreshed_every(const RawLog& raw);

// Adds the run's segments to `logs`, and what was done to it to the notes.
//   Rows out of order are put in order and repeated ones are left out. One that is missing, or more for up to
//   10 ms, are put between their neighbours; where rows are missing for longer, or time starts anew, the run
//   is cut. Time stamps that jitter are taken for even: what a dropped row does to all later stamps, a late
//   stamp does to itself. Angles become speeds (speeds_from_angles).
void add_segments(RawLog raw, MeasuredLogs& logs);

// Speeds as slopes of local parabolas through the angles, nothing late. Where an angle is refreshed less
// often than it is logged, its repetitions say nothing: samples are then as far apart as fresh angles are,
// and torque is the mean until the next. `period_s`: of the samples.
MeasuredLog speeds_from_angles(const RawLog& raw, double period_s);

}  // namespace wheelwright::tools
