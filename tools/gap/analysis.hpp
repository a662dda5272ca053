// `wheelwright gap`: from logs to findings. Everything it finds is in Findings;
// what is written about it is output.hpp's.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "firmware/model/robot_parameters.hpp"
#include "tools/gap/inference/search.hpp"
#include "tools/gap/logs/sensors.hpp"
#include "tools/gap/report/closed_loop.hpp"
#include "tools/gap/report/held_out.hpp"
#include "tools/logs/log_reading.hpp"

namespace wheelwright::gap {

struct Request {
    std::vector<std::string> logs;         // measured, or candump of the drives' bus (then `robot` is needed)
    tools::LogReading reading;             // of measured logs
    std::string heldout_log;               // or
    std::optional<double> heldout_from_s;  // of the last log; else the last fifth of it
    model::Geometry<double> geometry;
    std::optional<model::RobotParameters> robot;  // the given model
    std::string robot_text;                       // of the robot file that it was read from
    std::vector<std::size_t> without;             // effects known not to be there; none of `robot`'s
    std::function<void(const std::string&)> progress = [](const std::string&) {};
};

struct Findings {
    // Why a log cannot be used, or is suspect. Then nothing else is set but what was read of the logs: notes,
    // faults, length, rate and noise, and what the gyro says.
    std::vector<std::string> problems;
    std::vector<std::string> notes;  // of what was left out of a log or the search, and why
    Conclusion conclusion;
    std::vector<NamedEffect> effects;  // by importance
    std::vector<Place> where;          // what is missing shows, by importance
    // Of the closable gap, closed, by closed_share(). NaN: only sensors err.
    double closable_share = 0;
    Search search;
    bool turning = false;  // the turning equation was used
    double duration_s = 0, rate_Hz = 0;
    std::size_t blocks = 0;
    WheelPair<double> noise_rad_per_s;
    std::optional<Sensors::Gyro> gyro;
    std::vector<LogFault> faults;
    std::vector<std::size_t> denied;  // effects that were found, and are not named; a note says why
    std::vector<FreeRun> heldout;
    double heldout_s = 0, heldout_from_s = 0, floor_rad_per_s = 0, heldout_rms_rad_per_s = 0;
    std::optional<double> gap_nominal;  // mean squared whitened residual of the given model
    model::Dynamics<double> before, before_error, after, after_error;
    model::EffectSet<double> effects_before, effects_after;
    // The texts of robot.extended.toml and robot.before.toml (robot_files.hpp), and why there are none.
    std::string extended_file, before_file, file_problem;
    Curve against_speed;
    Trace trace;
    std::optional<ClosedLoop> closed_loop;  // on request, by who asks
};

Findings analyse(const Request& request);

}  // namespace wheelwright::gap
