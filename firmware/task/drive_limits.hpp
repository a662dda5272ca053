// What the drives report of their supply and their heat, against the robot file's limits. Only what is
// reported can be watched: a drive that sends none of these frames is never out of limits.
//
// A report beyond its limit counts when the next two of this drive agree (one alone may be nonsense). Near
// the limit (by 5 % of the voltage, 10 degC) it is told and nothing else: an ODrive that gets hot reduces its
// current by itself, and a limit that moved under the velocity loops would surprise them. What was beyond is
// over when three reports in a row are half of that way back.
//
// Threads: the cycle's. No call allocates, blocks or throws. Cost: about 20 instructions where nothing is
// new.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "drivers/motor_drive.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"

namespace wheelwright::task {

class DriveLimits {
  public:
    struct Verdict {
        bool supply_low = false, supply_high = false, overheated = false;
        bool near = false;  // or beyond
    };

    void configure(const model::RobotParameters& from, const drivers::DriveRatings& ratings) {
        const auto given = [](double value, double automatic) { return value > 0 ? value : automatic; };
        const auto& safety = from.safety;
        const double low_V = given(safety.lowest_supply_V, ratings.least_supply_V);
        const double high_V = given(safety.highest_supply_V, ratings.most_supply_V);
        limits_ = {{{-1, -low_V, kNearVoltage * low_V},
                    {1, high_V, kNearVoltage * high_V},
                    {1, given(safety.inverter_temperature_degC, ratings.most_temperature_degC), kNear_degC},
                    {1, given(safety.motor_temperature_degC, ratings.most_temperature_degC), kNear_degC}}};
        const auto patience_ns = [](std::int32_t period_ms) {
            return std::max(std::int64_t{3'000'000} * period_ms, kForgotten_ns);
        };
        patience_ns_ = {patience_ns(from.drive.supply_period_ms),
                        patience_ns(from.drive.temperature_period_ms)};
        expected_ = from.drive.supply_period_ms > 0 || from.drive.temperature_period_ms > 0;
    }

    // Once in each cycle.
    const Verdict& look(std::int64_t now_ns, const drivers::DriveFeedback& left,
                        const drivers::DriveFeedback& right) {
        const bool changes = take(drives_[0], now_ns, left);
        if (take(drives_[1], now_ns, right) || changes) conclude();
        return verdict_;
    }

    const Verdict& verdict() const { return verdict_; }
    // Whether a drive reports anything, or the robot file says that it does.
    bool told() const { return expected_ || drives_[0].any() || drives_[1].any(); }
    protocol::DriveHealth health(std::size_t side) const {
        const Drive& drive = drives_[side];
        protocol::DriveHealth health;
        health.wheel = static_cast<protocol::Wheel>(side);
        const auto put = [](bool reported, double from, bool& told, double& to) {
            told = reported && std::isfinite(from);
            to = told ? from : 0;
        };
        put(drive.reported[kSupply], drive.supply_V, health.supply_reported, health.supply_V);
        put(drive.reported[kHeat], drive.inverter_degC, health.inverter_reported,
            health.inverter_temperature_degC);
        put(drive.reported[kHeat], drive.motor_degC, health.motor_reported, health.motor_temperature_degC);
        return health;
    }

  private:
    static constexpr double kNearVoltage = 0.05;
    static constexpr double kNear_degC = 10;
    static constexpr int kReports = 3;
    static constexpr std::int64_t kForgotten_ns = 1'000'000'000;
    enum Report : std::size_t { kSupply, kHeat };
    enum Level : std::uint8_t { inside, close, beyond };

    struct Limit {
        double sign = 1;  // 1: an upper one
        double at = 0;    // with the sign
        double margin = 0;
    };

    // Of one quantity against one limit.
    struct Line {
        Level level = inside;
        int others = 0;  // reports in a row that say another level

        bool take(const Limit& limit, double value) {
            const double over = limit.sign * value - limit.at;  // no number: inside
            const auto level_at = [&](double x) {
                return x > 0 ? beyond : x > -limit.margin ? close : inside;
            };
            const Level up = level_at(over);
            const Level told = up > level ? up : std::min(level, level_at(over + limit.margin / 2));
            others = told == level ? 0 : others + 1;
            if (others < kReports) return false;
            level = told;
            others = 0;
            return true;
        }
    };

    struct Drive {
        std::array<std::int64_t, 2> time_ns{};
        std::array<bool, 2> reported{};
        double supply_V = 0, inverter_degC = 0, motor_degC = 0;
        std::array<Line, 4> lines{};  // supply low, high, inverter, motor
        bool any() const { return reported[kSupply] || reported[kHeat]; }
    };

    bool take(Drive& drive, std::int64_t now_ns, const drivers::DriveFeedback& told) {
        bool changes = false;
        if (told.supply_time_ns != drive.time_ns[kSupply]) {
            drive.time_ns[kSupply] = told.supply_time_ns;
            drive.reported[kSupply] = true;
            drive.supply_V = told.bus_voltage_V;
            changes |= drive.lines[0].take(limits_[0], drive.supply_V);
            changes |= drive.lines[1].take(limits_[1], drive.supply_V);
        }
        if (told.temperature_time_ns != drive.time_ns[kHeat]) {
            drive.time_ns[kHeat] = told.temperature_time_ns;
            drive.reported[kHeat] = true;
            drive.inverter_degC = told.inverter_temperature_degC;
            drive.motor_degC = told.motor_temperature_degC;
            changes |= drive.lines[2].take(limits_[2], drive.inverter_degC);
            changes |= drive.lines[3].take(limits_[3], drive.motor_degC);
        }
        for (const Report report : {kSupply, kHeat}) {
            if (!drive.reported[report] || now_ns - drive.time_ns[report] <= patience_ns_[report]) continue;
            drive.reported[report] = false;
            drive.lines[2 * report] = drive.lines[2 * report + 1] = {};
            changes = true;
        }
        return changes;
    }

    void conclude() {
        const auto either = [&](std::size_t line, Level level) {
            return std::max(drives_[0].lines[line].level, drives_[1].lines[line].level) >= level;
        };
        verdict_ = {either(0, beyond), either(1, beyond), either(2, beyond) || either(3, beyond),
                    either(0, close) || either(1, close) || either(2, close) || either(3, close)};
    }

    std::array<Limit, 4> limits_{};
    std::array<std::int64_t, 2> patience_ns_{};
    bool expected_ = false;
    std::array<Drive, 2> drives_{};
    Verdict verdict_;
};

}  // namespace wheelwright::task
