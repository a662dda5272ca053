#include "tools/logs/log_reading.hpp"

#include <algorithm>
#include <numbers>

#include "tools/cli/report.hpp"

namespace wheelwright::tools {
namespace {

enum class Through { nothing, wheel_radius, volts, amperes };  // what else a unit needs

struct Unit {
    std::string_view name;
    Quantity quantity;
    double factor;
    Through through = Through::nothing;
};
constexpr double kTurn_rad = 2 * std::numbers::pi;
constexpr double kDegree_rad = std::numbers::pi / 180;
constexpr double kFoot_m = 0.3048;
constexpr double kInch_m = 0.0254;
// The first of each quantity is its SI unit.
constexpr std::array kUnits{
    Unit{"s", Quantity::time, 1},
    Unit{"ms", Quantity::time, 1e-3},
    Unit{"us", Quantity::time, 1e-6},
    Unit{"ns", Quantity::time, 1e-9},
    Unit{"Nm", Quantity::torque, 1},
    Unit{"mNm", Quantity::torque, 1e-3},
    Unit{"N", Quantity::torque, 1, Through::wheel_radius},
    Unit{"V", Quantity::torque, 1, Through::volts},
    Unit{"mV", Quantity::torque, 1e-3, Through::volts},
    Unit{"A", Quantity::torque, 1, Through::amperes},
    Unit{"mA", Quantity::torque, 1e-3, Through::amperes},
    Unit{"rad/s", Quantity::speed, 1},
    Unit{"deg/s", Quantity::speed, kDegree_rad},
    Unit{"rpm", Quantity::speed, kTurn_rad / 60},
    Unit{"rot/s", Quantity::speed, kTurn_rad},
    Unit{"m/s", Quantity::speed, 1, Through::wheel_radius},
    Unit{"mm/s", Quantity::speed, 1e-3, Through::wheel_radius},
    Unit{"ft/s", Quantity::speed, kFoot_m, Through::wheel_radius},
    Unit{"in/s", Quantity::speed, kInch_m, Through::wheel_radius},
    Unit{"rad", Quantity::angle, 1},
    Unit{"deg", Quantity::angle, kDegree_rad},
    Unit{"rot", Quantity::angle, kTurn_rad},
    Unit{"m", Quantity::angle, 1, Through::wheel_radius},
    Unit{"mm", Quantity::angle, 1e-3, Through::wheel_radius},
    Unit{"ft", Quantity::angle, kFoot_m, Through::wheel_radius},
    Unit{"in", Quantity::angle, kInch_m, Through::wheel_radius},
    Unit{"m/s^2", Quantity::acceleration, 1},
    Unit{"g", Quantity::acceleration, 9.80665},
    Unit{"rad/s", Quantity::yaw_rate, 1},
    Unit{"deg/s", Quantity::yaw_rate, kDegree_rad},
};

struct Motor {
    std::string_view name;
    double stall_torque_Nm;  // at 12 V
};
// Vex, CTR Electronics, REV Robotics.
constexpr std::array kMotors{
    Motor{"CIM", 2.42},      Motor{"MiniCIM", 1.41},   Motor{"BAG", 0.43},
    Motor{"775pro", 0.71},   Motor{"NEO", 2.6},        Motor{"NEO550", 0.97},
    Motor{"NEOVortex", 3.6}, Motor{"Falcon500", 4.69}, Motor{"KrakenX60", 7.09},
};
constexpr double kDataSheet_V = 12;

}  // namespace

std::string parse_mapping(std::string_view text, ColumnMapping& out) {
    const auto wrong = [&](const std::string& why) {
        return std::string("\"").append(text).append("\": ").append(why);
    };
    const std::size_t equals = text.find('=');
    if (equals == std::string_view::npos) return wrong("expected KEY=COLUMN or KEY=COLUMN[UNIT]");
    const std::string_view key = text.substr(0, equals);
    const auto* const signal =
        std::find_if(kSignals.begin(), kSignals.end(), [&](const Signal& s) { return s.key == key; });
    if (signal == kSignals.end()) {
        std::string keys;
        for (const Signal& s : kSignals) keys.append(" ").append(s.key);
        return wrong("no key is called " + std::string(key) + "; there are:" + keys);
    }
    std::string_view column = text.substr(equals + 1);
    out = {static_cast<std::size_t>(signal - kSignals.begin()), "", "", column.starts_with('-')};
    if (out.turned) column.remove_prefix(1);
    const std::size_t bracket = column.rfind('[');
    if (bracket != std::string_view::npos && column.ends_with(']')) {
        out.unit = column.substr(bracket + 1, column.size() - bracket - 2);
        column = column.substr(0, bracket);
    }
    out.column = column;
    if (out.column.empty()) return wrong("no column is named");
    if (out.unit.empty()) return "";
    std::string units;
    for (const Unit& unit : kUnits) {
        if (unit.quantity != signal->quantity) continue;
        if (unit.name == out.unit) return "";
        units.append(" ").append(unit.name);
    }
    return wrong("no unit of it is called " + out.unit + "; there are:" + units);
}

Factor factor_to_si(Quantity quantity, std::string_view unit, const LogReading& reading,
                    double wheel_radius_m) {
    const auto* const found = std::find_if(kUnits.begin(), kUnits.end(), [&](const Unit& u) {
        return u.quantity == quantity && (unit.empty() || u.name == unit);
    });
    if (found == kUnits.end()) return {0, "no such unit: " + std::string(unit)};
    switch (found->through) {
        case Through::nothing:
            return {found->factor, ""};
        case Through::wheel_radius:
            if (!(wheel_radius_m > 0))
                return {0, "it is measured along the ground: the wheels' radius is needed"};
            // a torque is a force on a lever, an angle a length over it
            return {quantity == Quantity::torque ? found->factor * wheel_radius_m
                                                 : found->factor / wheel_radius_m,
                    ""};
        case Through::volts:
            if (reading.torque_per_volt_Nm) return {found->factor * *reading.torque_per_volt_Nm, ""};
            return {
                0,
                "torque is given in volts: say --volts-are-torque, --torque-per-volt, or --motor with --gear "
                "and --motors-per-side"};
        case Through::amperes:
            if (reading.torque_per_ampere_Nm) return {found->factor * *reading.torque_per_ampere_Nm, ""};
            return {0, "torque is given in amperes: say --torque-per-ampere"};
    }
    return {};
}

std::optional<double> motor_torque_per_volt_Nm(std::string_view name) {
    for (const Motor& motor : kMotors) {
        if (motor.name == name) return motor.stall_torque_Nm / kDataSheet_V;
    }
    return std::nullopt;
}

std::string motor_names() {
    std::string names;
    for (const Motor& motor : kMotors) names += (names.empty() ? "" : ", ") + std::string(motor.name);
    return names;
}

std::string volts_assumption(double torque_per_volt_Nm) {
    return "assumed: 1 V is " + number_text(torque_per_volt_Nm) +
           " Nm at each wheel; back-EMF is not taken off, and shows as a drag that grows with speed";
}

}  // namespace wheelwright::tools
