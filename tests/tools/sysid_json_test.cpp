// WPILib's characterisation logs of both generations, written here by the layouts that their tools document.
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <numbers>
#include <sstream>
#include <string>

#include "tools/logs/sysid_json.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

constexpr double kRadius_m = 0.0762;
constexpr double kPerRotation_m = 2 * std::numbers::pi * kRadius_m;

// The tests' motion: volts that rise, and a wheel that turns with 3 rad/s per volt.
double volts(double t_s) { return 1 + 0.5 * t_s; }
double speed_rad_per_s(double t_s) { return 3 * volts(t_s); }
double angle_rad(double t_s) { return 3 * (t_s + 0.25 * t_s * t_s); }

using WriteRow = std::function<void(std::ostream& out, double t_s, double direction)>;

std::string file(const WriteRow& row, const std::string& more) {
    std::ostringstream out;
    out.precision(9);
    out << "{";
    for (const char* test : {"slow-forward", "slow-backward", "fast-forward", "fast-backward"}) {
        out << "\"" << test << "\": [";
        for (int i = 0; i < 120; ++i) {
            out << (i == 0 ? "[" : ",[");
            row(out, 100 + 0.02 * i, std::string(test).find("forward") != std::string::npos ? 1 : -1);
            out << "]";
        }
        out << "],";
    }
    out << more << "}";
    return out.str();
}

// SysId: rotations; the left motor is mounted turned, and so is its sensor.
void sysid_row(std::ostream& out, double t_s, double direction) {
    const double t = t_s - 100;
    const double turns = direction * angle_rad(t) / (2 * std::numbers::pi);
    const double rate = direction * speed_rad_per_s(t) / (2 * std::numbers::pi);
    out << t_s << "," << -direction * volts(t) << "," << direction * volts(t) << "," << -turns << "," << turns
        << "," << -rate << "," << rate << "," << 0.1 * t << ",0.1";
}

// frc-characterization: metres, and volts without their sign.
void old_row(std::ostream& out, double t_s, double direction) {
    const double t = t_s - 100;
    const double metres = direction * angle_rad(t) * kRadius_m;
    const double rate = direction * speed_rad_per_s(t) * kRadius_m;
    out << t_s << ",12.1," << direction * volts(t) / 12 << "," << volts(t) << "," << volts(t) << "," << metres
        << "," << metres << "," << rate << "," << rate << "," << -0.1 * t;
}

tools::LogReading reading() {
    tools::LogReading reading;
    reading.torque_per_volt_Nm = 2;
    reading.wheel_radius_m = {kRadius_m, kRadius_m};
    return reading;
}

const std::string kSysIdEnd =
    R"("sysid": true, "test": "Drivetrain", "units": "Meters", "unitsPerRotation": )" +
    std::to_string(kPerRotation_m);

void expect_motion(const tools::MeasuredLogs& logs, double gyro) {
    for (const tools::LineProblem& note : logs.notes)
        std::printf("  %s\n", to_text("log.json", note).c_str());
    for (const tools::LineProblem& problem : logs.problems)
        std::printf("  %s\n", to_text("log.json", problem).c_str());
    LONGS_EQUAL(4, logs.segments.size());
    constexpr std::array kRuns{"slow_forward", "slow_backward", "fast_forward", "fast_backward"};
    for (std::size_t i = 0; i < 4; ++i) {
        const tools::MeasuredLog& log = logs.segments[i];
        const double direction = i % 2 == 0 ? 1 : -1;
        STRCMP_EQUAL(kRuns[i], log.run.c_str());
        LONGS_EQUAL(120, log.samples.size());
        DOUBLES_EQUAL(0.02, log.period_s, 1e-9);
        for (const tools::MeasuredSample& s : log.samples) {
            const double t = s.t_s - 100;
            for (double WheelPair<double>::*side : {&WheelPair<double>::left, &WheelPair<double>::right}) {
                DOUBLES_EQUAL(direction * 2 * volts(t), s.torque_Nm.*side, 1e-5);
                DOUBLES_EQUAL(direction * speed_rad_per_s(t), s.speed_rad_per_s.*side, 2e-3);
            }
            CHECK(log.has_gyro);
            DOUBLES_EQUAL(gyro, s.gyro_rad_per_s, 1e-3);
        }
    }
}

bool noted(const tools::MeasuredLogs& logs, const std::string& part) {
    for (const tools::LineProblem& note : logs.notes) {
        if (note.message.find(part) != std::string::npos) return true;
    }
    return false;
}

void expect_problem(const std::string& text, std::size_t line, const std::string& part,
                    const tools::LogReading& how = reading(), const std::string& run = "") {
    const tools::MeasuredLogs logs = tools::read_sysid_json(text, how, run);
    CHECK(logs.segments.empty());
    CHECK(logs.problem_count > 0);
    std::printf("  %s\n", to_text("log.json", logs.problems.front()).c_str());
    LONGS_EQUAL(line, logs.problems.front().line);
    STRCMP_CONTAINS(part.c_str(), logs.problems.front().message.c_str());
}

}  // namespace

TEST_GROUP(SysIdJson){};

TEST(SysIdJson, SysIdFilesAreReadWithTurnedMotorsAndSensors) {
    const tools::MeasuredLogs logs = tools::read_sysid_json(file(sysid_row, kSysIdEnd), reading());
    expect_motion(logs, 0.1);
    CHECK(noted(logs, "assumed: the left sensor is turned"));
    CHECK(noted(logs, "assumed: the left volts are turned"));
    CHECK(noted(logs, "assumed: 1 V is 2 Nm at each wheel"));
    CHECK_FALSE(noted(logs, "right"));
}

TEST(SysIdJson, ReportedSpeedsAreTakenOnDemand) {
    tools::LogReading how = reading();
    how.reported_speeds = true;
    expect_motion(tools::read_sysid_json(file(sysid_row, kSysIdEnd), how), 0.1);
}

TEST(SysIdJson, TheOlderLayoutIsReadWithMagnitudesForVolts) {
    const tools::MeasuredLogs logs = tools::read_sysid_json(file(old_row, "\"x\": 0"), reading());
    expect_motion(logs, -0.1);
    CHECK(noted(logs, "assumed: positions are in m, as the file does not say"));
    CHECK(
        noted(logs, "assumed: the left volts, which are never negative, drive the way of the tests' names"));
    CHECK(noted(logs, "assumed: the right volts, which are never negative"));
}

TEST(SysIdJson, UnitsThatTheFileDoesNotSayAreStated) {
    tools::LogReading how = reading();
    how.position_unit = "rot";
    const tools::MeasuredLogs logs = tools::read_sysid_json(file(old_row, "\"x\": 0"), how);
    DOUBLES_EQUAL(2 * std::numbers::pi * kRadius_m * speed_rad_per_s(1),
                  logs.segments.front().samples[50].speed_rad_per_s.left, 1e-3);
}

TEST(SysIdJson, OneTestOfAFile) {
    const tools::MeasuredLogs logs =
        tools::read_sysid_json(file(sysid_row, kSysIdEnd), reading(), "fast_backward");
    LONGS_EQUAL(1, logs.segments.size());
    STRCMP_EQUAL("fast_backward", logs.segments.front().run.c_str());
    CHECK(logs.segments.front().samples.front().torque_Nm.left < 0);
    expect_problem(file(sysid_row, kSysIdEnd), 0, "has no test called fast-sideways", reading(),
                   "fast-sideways");
}

TEST(SysIdJson, ARadiusThatIsNotTheFilesIsNoted) {
    tools::LogReading how = reading();
    how.wheel_radius_m = {0.1, 0.1};
    CHECK(noted(tools::read_sysid_json(file(sysid_row, kSysIdEnd), how), "0.762 turns of the left wheel"));
}

TEST(SysIdJson, WhatIsWrongIsNamedWithItsRow) {
    expect_problem("{\"slow-forward\": [[1,2", 0, "is not JSON");
    expect_problem("{\"slow-forward\": [[1e999,2,3,4,5,6,7,8,9]]}", 0, "number overflow parsing '1e999'");
    expect_problem("{\"a\": 1}", 0, "has no test of WPILib SysId, expected one of slow-forward");
    expect_problem("{\"slow-forward\": [[1,2,3,4,5,6,7,8,9],[1,2,3]]}", 2,
                   "slow-forward: found 3 numbers, expected a row of 9 (SysId) or 10 (frc-characterization)");
    expect_problem("{\"slow-forward\": [[1,2,3,4,5,6,7,8,9],[1,2,null,4,5,6,7,8,9]]}", 2,
                   "slow-forward: column 3: found null, expected a number");
    expect_problem("{\"slow-forward\": [[1,2,3,4,5,6,7,8,9],[1,2,3,4,5,6,7,8,9,10]]}", 2,
                   "found 10 numbers, expected 9 as in the rows before");
    expect_problem(file(sysid_row, R"("units": "Cubits", "unitsPerRotation": 1)"), 0,
                   "\"units\" is \"Cubits\", expected Meters, Feet");
    tools::LogReading how = reading();
    how.torque_per_volt_Nm.reset();
    expect_problem(file(sysid_row, kSysIdEnd), 0, "torque is given in volts: say --volts-are-torque", how);
}
