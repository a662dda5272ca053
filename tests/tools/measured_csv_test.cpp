// Measured logs in CSV form: good ones are read, doubtful ones are refused with the line.
#include <cmath>
#include <cstdio>
#include <sstream>
#include <string>
#include <vector>

#include "tools/logs/measured_csv.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

const std::string kHeader = "t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s";

// A log of `rows` lines at `rate`, line 2 being the first sample.
std::vector<std::string> lines_of(std::size_t rows, double rate_Hz) {
    std::vector<std::string> lines{kHeader};
    for (std::size_t i = 0; i < rows; ++i) {
        std::ostringstream line;
        line.precision(9);
        line << static_cast<double>(i) / rate_Hz << ",0.5,-0.25,1." << i << ",-2." << i;
        lines.push_back(line.str());
    }
    return lines;
}

tools::MeasuredLogResult read(const std::vector<std::string>& lines, const char* newline = "\n") {
    std::string text;
    for (const std::string& line : lines) text.append(line).append(newline);
    std::istringstream in(text);
    return tools::read_measured_csv(in);
}

void expect_problem(const std::vector<std::string>& lines, std::size_t line, const std::string& part) {
    const tools::MeasuredLogResult result = read(lines);
    CHECK_FALSE(result.log.has_value());
    CHECK(!result.problems.empty());
    const tools::LineProblem& problem = result.problems.front();
    std::printf("  %s\n", to_text("log.csv", problem).c_str());
    LONGS_EQUAL(line, problem.line);
    CHECK_TEXT(problem.message.find(part) != std::string::npos, problem.message.c_str());
}

}  // namespace

TEST_GROUP(MeasuredCsv){};

TEST(MeasuredCsv, ColumnsAreFoundByNameInAnyOrder) {
    std::vector<std::string> lines{
        "battery_V, gyro_z_rad_s "
        ",omega_right_rad_s,omega_left_rad_s,tau_right_Nm,tau_left_Nm,t_s,accel_x_m_s2"};
    for (int i = 0; i < 40; ++i) {
        std::ostringstream line;
        line << "24.1,0.5,4,3,2,+1e0," << 10 + i * 0.02 << ",-9.5";
        lines.push_back(line.str());
    }
    const tools::MeasuredLogResult result = read(lines, "\r\n");
    CHECK(result.log.has_value());
    const tools::MeasuredLog& log = *result.log;
    LONGS_EQUAL(40, log.samples.size());
    DOUBLES_EQUAL(0.02, log.period_s, 1e-12);
    DOUBLES_EQUAL(10.0, log.samples[0].t_s, 0);
    DOUBLES_EQUAL(1, log.samples[0].torque_Nm.left, 0);
    DOUBLES_EQUAL(2, log.samples[0].torque_Nm.right, 0);
    DOUBLES_EQUAL(3, log.samples[0].speed_rad_per_s.left, 0);
    DOUBLES_EQUAL(4, log.samples[0].speed_rad_per_s.right, 0);
    CHECK(log.has_gyro && log.has_accel);
    DOUBLES_EQUAL(0.5, log.samples[0].gyro_rad_per_s, 0);
    DOUBLES_EQUAL(-9.5, log.samples[0].accel_m_per_s2, 0);
    LONGS_EQUAL(1, log.ignored_columns.size());
}

TEST(MeasuredCsv, RatesFrom20HzTo2kHzAreAccepted) {
    for (const double rate : {20.0, 50.0, 123.0, 1000.0, 2000.0}) {
        const tools::MeasuredLogResult result = read(lines_of(60, rate));
        CHECK(result.log.has_value());
        DOUBLES_EQUAL(1 / rate, result.log->period_s, 1e-8);
        CHECK_FALSE(result.log->has_gyro);
    }
    expect_problem(lines_of(60, 10), 0, "expected 20 to 2000");
    expect_problem(lines_of(60, 5000), 0, "expected 20 to 2000");
}

TEST(MeasuredCsv, MissingColumnsAreNamed) {
    std::vector<std::string> lines = lines_of(40, 100);
    lines[0] = "t_s,tau_left_mNm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s";
    expect_problem(lines, 1, "column tau_left_Nm is missing; there is tau_left_mNm");
    lines[0] = "t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_left_rad_s";
    expect_problem(lines, 1, "column omega_left_rad_s appears twice");
    lines[0] = "t_s;tau_left_Nm;tau_right_Nm;omega_left_rad_s;omega_right_rad_s";
    expect_problem(lines, 1, "commas");
    expect_problem({}, 0, "is empty");
    expect_problem(lines_of(5, 100), 0, "has 5 samples");
}

TEST(MeasuredCsv, TimeThatStopsGoesBackOrLeapsIsSaidByLine) {
    std::vector<std::string> lines = lines_of(60, 100);
    lines[20] = lines[19];
    expect_problem(lines, 21, "appears twice");
    lines = lines_of(60, 100);
    std::swap(lines[30], lines[31]);
    const tools::MeasuredLogResult swapped = read(lines);
    CHECK_FALSE(swapped.log.has_value());
    CHECK(swapped.problems[1].message.find("goes back by 0.01 s") != std::string::npos);
    LONGS_EQUAL(32, swapped.problems[1].line);
    lines = lines_of(60, 100);
    lines.erase(lines.begin() + 40);
    expect_problem(lines, 41, "gap: 0.02 s after the line before, where 0.01 s is usual");
}

TEST(MeasuredCsv, WhatIsNotANumberIsSaidByLineAndColumn) {
    for (const char* cell : {"nan", "inf", "", "1.2abc", "0x10", "1,5", "--1", "1e999"}) {
        std::vector<std::string> lines = lines_of(40, 100);
        lines[7] = std::string("0.06,0.5,").append(cell).append(",1,1");
        const tools::MeasuredLogResult result = read(lines);
        CHECK_FALSE(result.log.has_value());
        LONGS_EQUAL(8, result.problems.front().line);
    }
    std::vector<std::string> lines = lines_of(40, 100);
    lines[7] = "0.06,0.5,oops,1,1";
    expect_problem(lines, 8, "column tau_right_Nm: found \"oops\", expected a finite number");
    lines[7] = "0.06,0.5,1,1";
    expect_problem(lines, 8, "found 4 columns, expected 5");
    lines[7] = "";
    expect_problem(lines, 8, "blank line");
}

TEST(MeasuredCsv, ManyProblemsAreCountedAndTheFirstAreKept) {
    std::vector<std::string> lines = lines_of(60, 100);
    for (std::size_t i = 1; i < lines.size(); ++i) lines[i].assign(1, 'x');
    const tools::MeasuredLogResult result = read(lines);
    LONGS_EQUAL(60, result.problem_count);
    LONGS_EQUAL(20, result.problems.size());
}

TEST(MeasuredCsv, AFileThatCannotBeOpenedSaysSo) {
    const tools::MeasuredLogResult result = tools::read_measured_csv(std::string("/nowhere.csv"));
    LONGS_EQUAL(1, result.problem_count);
    CHECK(result.problems.front().message.find("No such file") != std::string::npos);
}
