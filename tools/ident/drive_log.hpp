// What a robot's drives were told and what they answered, from a candump log: the same samples that the
// firmware's cycle gave its estimators, made from the frames alone.
//
// Cycles are found in the torque commands, one pair in each; their times are smoothed as frames only ever
// come late. A cycle's start is its commands' time less the sending phase and the time of one frame on the
// bus. Angles come from the encoder frames as the firmware's WheelObserver gives them, before the drives'
// encoder loops, whose bandwidth the log itself tells (firmware/control/encoder_loop.hpp).
//
// A sample is not usable where an axis was not in closed loop, where its encoder was not heard, where a
// command is missing, or where the drive reported another torque than commanded.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "firmware/ident/regression_filter.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "tools/logs/candump.hpp"

namespace wheelwright::tools {

struct DriveLog {
    struct Cycle {
        ident::IdentSample<double> sample;
        std::int64_t start_ns = 0;
        bool restart = false;  // a gap before it
    };
    std::vector<Cycle> cycles;
    std::int64_t first_time_ns = 0, last_time_ns = 0;
    std::uint64_t frames = 0;
    std::uint64_t reports = 0;       // torques reported while armed
    std::uint64_t not_followed = 0;  // those that differ from the command
    double largest_torque_Nm = 0;
    WheelPair<bool> torque_changes, turns;
    WheelPair<double> encoder_lag_s;    // 1 / b of the drives' encoder loops; 0: none is seen
    std::vector<LineProblem> notes;     // left out, and why
    std::vector<LineProblem> problems;  // set: unusable
};

DriveLog read_drive_log(const std::string& path, const model::RobotParameters& robot);

}  // namespace wheelwright::tools
