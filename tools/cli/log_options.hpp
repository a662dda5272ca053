// How measured logs are to be read, on the command line.
#pragma once

#include <string>
#include <vector>

#include "tools/cli/command_line.hpp"
#include "tools/cli/report.hpp"
#include "tools/logs/log_reading.hpp"

namespace wheelwright::tools {

struct LogOptions {
    std::vector<std::string> columns;
    bool volts_are_torque = false;
    double torque_per_volt_Nm = 0, torque_per_ampere_Nm = 0;  // 0: not given
    std::string motor;
    double gear_ratio = 0;
    int motors_per_side = 1;
    std::string position_unit;
    bool reported_speeds = false;

    void add_to(const CommandLine& command) {
        command
            .add_option(
                "--columns", columns,
                "CSV with other columns: KEY=COLUMN or KEY=COLUMN[UNIT], with commas between; -COLUMN turns "
                "the sign (docs/logs.md)")
            .delimiter(',');
        command.add_flag("--volts-are-torque", volts_are_torque, "Where a log has volts: 1 V counts as 1 Nm");
        command.add_option("--torque-per-volt", torque_per_volt_Nm, "... or as so many Nm at the wheel")
            .check(greater_than_zero());
        command.add_option("--motor", motor, "... or as this motor's stall torque gives: " + motor_names());
        command.add_option("--gear", gear_ratio, "With --motor: motor turns for a wheel's")
            .check(greater_than_zero());
        command.add_option("--motors-per-side", motors_per_side, "With --motor")
            .check(from_to("1", "20"))
            .show_default();
        command
            .add_option("--torque-per-ampere", torque_per_ampere_Nm,
                        "Where a log has currents: 1 A is so many Nm at the wheel")
            .check(greater_than_zero());
        command
            .add_option("--position-unit", position_unit,
                        "Of a SysId file that does not say: rot of the wheel, m, ft, in (default: m)")
            .check(one_of({"rot", "m", "ft", "in"}));
        command.add_flag(
            "--reported-speeds", reported_speeds,
            "Of a SysId file, take the speeds that the motor controllers report, which come late, "
            "instead of the positions' slopes");
    }

    // As they stand on a command line.
    [[nodiscard]] std::vector<std::string> words() const {
        std::vector<std::string> words;
        const auto add = [&](const char* name, const std::string& value) {
            words.emplace_back(name);
            words.push_back(value);
        };
        for (const std::string& column : columns) add("--columns", column);
        if (volts_are_torque) words.emplace_back("--volts-are-torque");
        if (torque_per_volt_Nm > 0) add("--torque-per-volt", number_text(torque_per_volt_Nm, 17));
        if (!motor.empty()) {
            add("--motor", motor);
            add("--gear", number_text(gear_ratio, 17));
            add("--motors-per-side", std::to_string(motors_per_side));
        }
        if (torque_per_ampere_Nm > 0) add("--torque-per-ampere", number_text(torque_per_ampere_Nm, 17));
        if (!position_unit.empty()) add("--position-unit", position_unit);
        if (reported_speeds) words.emplace_back("--reported-speeds");
        return words;
    }

    // "" or what is wrong.
    [[nodiscard]] std::string apply(LogReading& reading) const {
        for (const std::string& text : columns) {
            ColumnMapping mapping;
            const std::string wrong = parse_mapping(text, mapping);
            if (!wrong.empty()) return "--columns " + wrong;
            reading.columns.push_back(std::move(mapping));
        }
        if (int(volts_are_torque) + int(torque_per_volt_Nm > 0) + int(!motor.empty()) > 1)
            return "--volts-are-torque, --torque-per-volt and --motor exclude each other";
        if (volts_are_torque) reading.torque_per_volt_Nm = 1;
        if (torque_per_volt_Nm > 0) reading.torque_per_volt_Nm = torque_per_volt_Nm;
        if (!motor.empty()) {
            const std::optional<double> one = motor_torque_per_volt_Nm(motor);
            if (!one) return "--motor " + motor + ": not known; there are " + motor_names();
            if (!(gear_ratio > 0)) return "--motor needs --gear: motor turns for a wheel's";
            reading.torque_per_volt_Nm = *one * gear_ratio * motors_per_side;
        }
        if (torque_per_ampere_Nm > 0) reading.torque_per_ampere_Nm = torque_per_ampere_Nm;
        reading.position_unit = position_unit;
        reading.reported_speeds = reported_speeds;
        return "";
    }
};

}  // namespace wheelwright::tools
