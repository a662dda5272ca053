// What an identification from logs is asked and what it answers. A number comes with its evidence, or it does
// not come at all: where a log cannot tell a parameter, `known` is false and `reason` says why.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/effects.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "tools/logs/candump.hpp"
#include "tools/logs/log_reading.hpp"

namespace wheelwright::tools {

struct IdentSetup {
    model::RobotParameters robot;                     // geometry, drives and ident settings
    std::array<bool, model::kEffectCount> effects{};  // to be found; all of model::estimated_effects()
    double relative_standard_error = 0;               // at which K7 and K8 are good enough
    LogReading reading;                               // of measured logs; the radii are the robot's
};

struct Estimate {
    double value = 0;
    double standard_error = 0;
    bool known = false;
    std::string reason;  // why it is not known, or what it rests on

    // Half the value is noise at worst.
    bool significant() const { return known && standard_error < std::abs(value) / 2; }
};

struct DynamicsFigure : Estimate {
    std::string_view key, label, unit;
    std::string_view excited_by;  // what has to happen in a log for this parameter to show
    std::string_view excitation_unit;
    double covariance_diagonal = 0;  // bare P_ii, per unit of noise variance
    double excitation = 0;           // rms of its regressor, less what the other columns explain
};

struct EffectFigure : Estimate {
    std::size_t effect = 0, parameter = 0;
    bool common = false;  // the log does not tell left from right: one value serves both
};

// One log that took part.
struct LogFacts {
    std::string name;
    std::string form;  // "candump", "CSV", "SysId"
    std::string date;  // of the recording, YYYY-MM-DD; "" where the log does not tell
    double duration_s = 0;
    double rate_Hz = 0;
    std::uint64_t samples = 0;
};

struct Findings {
    std::array<DynamicsFigure, 4> k{{
        {{}, "k5_m", "K5", "m", "turning", "rad^2/s^2"},
        {{}, "k6_per_m", "K6", "1/m", "turning while driving", "m rad/s^2"},
        {{}, "k7_per_kg_m", "K7", "1/(kg m)", "equal torques that change", "Nm"},
        {{}, "k8_per_kg_m2", "K8", "1/(kg m^2)", "opposite torques that change", "Nm"},
    }};
    std::vector<EffectFigure> effects;
    Estimate delay_s;
    std::string delay_meaning;
    TwistRate<double> residual_rms;     // of rows
    TwistRate<double> explained_share;  // of the rows' power, 0..1
    std::uint64_t rows = 0, masked_rows = 0;
    double averaged_over_s = 0;  // length of a row's averaging weight
    std::vector<LogFacts> logs;
    std::vector<std::string> notes;     // "log:line: what was left out and why"
    std::vector<std::string> problems;  // set: nothing above counts

    const DynamicsFigure& k5() const { return k[0]; }
    const DynamicsFigure& k6() const { return k[1]; }
    const DynamicsFigure& k7() const { return k[2]; }
    const DynamicsFigure& k8() const { return k[3]; }
    bool good_enough(double relative_standard_error) const;
};

// Decides which of the K's the standard errors leave known (k5..k8 hold values and errors; `reason` that is
// already set stays). K5 is a length: it is known when its error is below half the track; K6 in the same
// way through K6 = -K5 2 K8 / (b K7). K7 and K8 are positive: their errors must be below half their value.
void judge(Findings& findings, const model::Geometry<double>& geometry);

// "" for a parameter name without a side, else the name without it: "left_Nm" -> "Nm".
std::string_view without_side(std::string_view parameter_name);

// Identifies from logs of one form; several logs are one experiment.
Findings identify_drive_logs(const std::vector<std::string>& paths, const IdentSetup& setup);
Findings identify_measured_logs(const std::vector<std::string>& paths, const IdentSetup& setup);

// The form is told by the first character: '(' begins a candump line. Not to be mixed.
Findings identify_logs(const std::vector<std::string>& paths, const IdentSetup& setup);

// YYYY-MM-DD in UTC of a log's first time stamp; "" when that does not count from 1970. When the file was
// changed last says nothing of the measurement.
std::string log_date(double first_time_s);

}  // namespace wheelwright::tools
