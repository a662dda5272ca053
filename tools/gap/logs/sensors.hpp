// What a log tells of its own making, before any dynamics: samples that are wrong, and sensors that do not
// say what is.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "firmware/model/effects.hpp"
#include "tools/logs/measured_log.hpp"

namespace wheelwright::gap {

// Something wrong with the log and not with the robot.
struct LogFault {
    std::string name;       // log_outliers or log_dropouts
    double rate = 0;        // share of the samples
    std::size_t count = 0;  // of samples
    double first_s = 0;     // where the first one is
};

// Single speeds that no robot drives: put between their neighbours. Runs of samples that repeat the one
// before: marked in `unusable`, one for each sample.
std::vector<LogFault> repair(tools::MeasuredLog& log, std::vector<bool>& unusable);

// Standard deviation of white noise on each wheel's speed, from higher differences: what no smooth motion
// makes.
WheelPair<double> speed_noise(std::span<const tools::MeasuredLog> logs);

struct SensorEffect {
    std::size_t effect = model::kEffectCount;
    double value = 0, standard_error = 0;  // of its only parameter
};

struct Sensors {
    std::vector<SensorEffect> effects;
    double unknown_step_rad_per_s = 0;  // of the speeds, by counts over an unknown time
    bool by_angles = false;             // the speeds are: their noise is an encoder's steps, and not white
    bool late_report = false;           // of the wheel speeds: the gyro says so, and it is excluded
    // gyro = bias + slope (wheels' yaw rate) + bend v, behind the wheels by `lag_s`
    struct Gyro {
        double bias_rad_per_s = 0, bias_error = 0;
        double slope = 1, slope_error = 0;
        double bend_per_m = 0, bend_error = 0;
        // of the wheels' report behind the gyro's; standard error 0: not known
        double lag_s = 0, lag_error_s = 0;
    };
    std::optional<Gyro> gyro;  // where the robot turns
};

// At least one log. `excluded`: effects known not to be there.
Sensors sensors_of(const std::vector<tools::MeasuredLog>& logs, const model::Geometry<double>& geometry,
                   bool turning = true, std::span<const std::size_t> excluded = {});

// Why the wheels' speeds cannot be what they are said to be, as the gyro has it: sides or units.
std::optional<std::string> wrong_beside_gyro(const Sensors::Gyro& gyro);

}  // namespace wheelwright::gap
