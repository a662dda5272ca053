// What a person states of logs that others have written: which column is what, in which unit, and what torque
// is made from.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/model/types.hpp"

namespace wheelwright::tools {

enum class Quantity { time, torque, speed, angle, acceleration, yaw_rate };

// What a column can be. One wheel's, or that of both: then torque is the sum, and speed and angle are the
// mean.
struct Signal {
    std::string_view key;       // in --columns
    std::string_view standard;  // the column's name where nothing is stated; "": there is none
    Quantity quantity;
};
inline constexpr std::array<Signal, 12> kSignals{{
    {"t", "t_s", Quantity::time},
    {"tau_left", "tau_left_Nm", Quantity::torque},
    {"tau_right", "tau_right_Nm", Quantity::torque},
    {"tau", "", Quantity::torque},
    {"omega_left", "omega_left_rad_s", Quantity::speed},
    {"omega_right", "omega_right_rad_s", Quantity::speed},
    {"omega", "", Quantity::speed},
    {"angle_left", "", Quantity::angle},
    {"angle_right", "", Quantity::angle},
    {"angle", "", Quantity::angle},
    {"gyro_z", "gyro_z_rad_s", Quantity::yaw_rate},
    {"accel_x", "accel_x_m_s2", Quantity::acceleration},
}};

// KEY=[-]COLUMN[UNIT], as in "omega_left=left rate[rpm]" or "tau_right=-right volts[V]".
struct ColumnMapping {
    std::size_t signal = 0;  // of kSignals
    std::string column;
    std::string unit;  // "": SI
    bool turned = false;
};

struct LogReading {
    std::vector<ColumnMapping> columns;
    std::optional<double> torque_per_volt_Nm, torque_per_ampere_Nm;  // at the wheel
    WheelPair<double> wheel_radius_m;  // for what is measured along the ground; 0: not known
    std::string position_unit;         // of a SysId file that does not say; "": metres
    bool reported_speeds = false;      // of a SysId file, instead of speeds from its positions
};

// Reads a mapping. "" or what is wrong with it.
std::string parse_mapping(std::string_view text, ColumnMapping& out);

// How one of a unit becomes SI, for one wheel.
struct Factor {
    double value = 0;
    std::string problem;  // what has to be stated first; or no such unit
};
Factor factor_to_si(Quantity quantity, std::string_view unit, const LogReading& reading,
                    double wheel_radius_m);

// Nm per volt at the shaft of one motor: stall torque over 12 V, of the makers' data sheets. Nothing: not
// known.
std::optional<double> motor_torque_per_volt_Nm(std::string_view name);
std::string motor_names();

// What is assumed where volts stand for torque.
std::string volts_assumption(double torque_per_volt_Nm);

}  // namespace wheelwright::tools
