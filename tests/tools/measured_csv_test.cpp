// Measured logs in CSV form: good ones are read, repaired where that is safe, and refused with the line where
// not.
#include <cmath>
#include <cstdio>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

#include "tools/logs/measured_csv.hpp"
#include "tools/logs/read_measured.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

const std::string kHeader = "t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s";

// A log of `rows` lines at `rate`, line 2 being the first sample; its left speed grows by 1 each row.
std::vector<std::string> lines_of(std::size_t rows, double rate_Hz) {
    std::vector<std::string> lines{kHeader};
    for (std::size_t i = 0; i < rows; ++i) {
        std::ostringstream line;
        line.precision(9);
        line << static_cast<double>(i) / rate_Hz << ",0.5,-0.25," << i << ",-2." << i;
        lines.push_back(line.str());
    }
    return lines;
}

// The same line at another time.
std::string at_time(const std::string& line, double t_s) {
    std::ostringstream other;
    other.precision(9);
    other << t_s << line.substr(line.find(','));
    return other.str();
}

tools::MeasuredLogs read(const std::vector<std::string>& lines, const char* newline = "\n",
                         const tools::LogReading& reading = {}) {
    std::string text;
    for (const std::string& line : lines) text.append(line).append(newline);
    std::istringstream in(text);
    return tools::read_measured_csv(in, reading);
}

void expect_problem(const std::vector<std::string>& lines, std::size_t line, const std::string& part,
                    const tools::LogReading& reading = {}) {
    const tools::MeasuredLogs result = read(lines, "\n", reading);
    CHECK(result.segments.empty());
    CHECK(!result.problems.empty());
    const tools::LineProblem& problem = result.problems.front();
    std::printf("  %s\n", to_text("log.csv", problem).c_str());
    LONGS_EQUAL(line, problem.line);
    CHECK_TEXT(problem.message.find(part) != std::string::npos, problem.message.c_str());
}

void expect_note(const tools::MeasuredLogs& result, std::size_t line, const std::string& part) {
    LONGS_EQUAL(0, result.problem_count);
    LONGS_EQUAL(1, result.notes.size());
    std::printf("  %s\n", to_text("log.csv", result.notes.front()).c_str());
    LONGS_EQUAL(line, result.notes.front().line);
    CHECK_TEXT(result.notes.front().message.find(part) != std::string::npos,
               result.notes.front().message.c_str());
}

tools::LogReading reading_of(const std::vector<std::string>& mappings) {
    tools::LogReading reading;
    reading.wheel_radius_m = {0.1, 0.2};
    for (const std::string& text : mappings) {
        tools::ColumnMapping mapping;
        const std::string wrong = tools::parse_mapping(text, mapping);
        CHECK_TEXT(wrong.empty(), wrong.c_str());
        reading.columns.push_back(mapping);
    }
    return reading;
}

std::string complaint_about(const std::string& mapping) {
    tools::ColumnMapping unused;
    return tools::parse_mapping(mapping, unused);
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
    const tools::MeasuredLogs result = read(lines, "\r\n");
    LONGS_EQUAL(1, result.segments.size());
    LONGS_EQUAL(0, result.notes.size());
    const tools::MeasuredLog& log = result.segments.front();
    LONGS_EQUAL(40, log.samples.size());
    LONGS_EQUAL(2, log.lines.front());
    DOUBLES_EQUAL(0.02, log.period_s, 1e-12);
    DOUBLES_EQUAL(10.0, log.samples[0].t_s, 0);
    DOUBLES_EQUAL(1, log.samples[0].torque_Nm.left, 0);
    DOUBLES_EQUAL(2, log.samples[0].torque_Nm.right, 0);
    DOUBLES_EQUAL(3, log.samples[0].speed_rad_per_s.left, 0);
    DOUBLES_EQUAL(4, log.samples[0].speed_rad_per_s.right, 0);
    CHECK(log.has_gyro && log.has_accel);
    DOUBLES_EQUAL(0.5, log.samples[0].gyro_rad_per_s, 0);
    DOUBLES_EQUAL(-9.5, log.samples[0].accel_m_per_s2, 0);
}

TEST(MeasuredCsv, RatesFrom20HzTo2kHzAreAccepted) {
    for (const double rate : {20.0, 50.0, 123.0, 1000.0, 2000.0}) {
        const tools::MeasuredLogs result = read(lines_of(60, rate));
        LONGS_EQUAL(1, result.segments.size());
        DOUBLES_EQUAL(1 / rate, result.segments.front().period_s, 1e-8);
        CHECK_FALSE(result.segments.front().has_gyro);
    }
    expect_problem(lines_of(60, 10), 0, "expected 20 to 2000");
    expect_problem(lines_of(60, 5000), 0, "expected 20 to 2000");
}

TEST(MeasuredCsv, MissingColumnsAreNamed) {
    std::vector<std::string> lines = lines_of(40, 100);
    lines[0] = "t_s,tau_left_mNm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s";
    expect_problem(lines, 1, "column tau_left_Nm is missing; there is tau_left_mNm");
    lines[0] = "t_s,x,tau_right_Nm,omega_left_rad_s,omega_right_rad_s";
    expect_problem(lines, 1,
                   "column tau_left_Nm is missing; --columns says which column stands for it (tau_left=...)");
    lines[0] = "t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_left_rad_s";
    expect_problem(lines, 1, "column omega_left_rad_s appears twice");
    lines[0] = "t_s;tau_left_Nm;tau_right_Nm;omega_left_rad_s;omega_right_rad_s";
    expect_problem(lines, 1, "commas");
    expect_problem({}, 0, "is empty");
    expect_problem(lines_of(5, 100), 0, "has 5 samples");
}

TEST(MeasuredCsv, ARowThatIsMissingIsPutBetweenItsNeighbours) {
    std::vector<std::string> lines = lines_of(60, 100);
    lines.erase(lines.begin() + 40);
    const tools::MeasuredLogs result = read(lines);
    expect_note(result, 41, "one row is missing 1 time");
    LONGS_EQUAL(1, result.segments.size());
    const tools::MeasuredLog& log = result.segments.front();
    LONGS_EQUAL(60, log.samples.size());
    for (std::size_t i = 0; i < 60; ++i) {
        DOUBLES_EQUAL(static_cast<double>(i), log.samples[i].speed_rad_per_s.left, 1e-12);
        DOUBLES_EQUAL(0.01 * static_cast<double>(i), log.samples[i].t_s, 1e-12);
    }
    LONGS_EQUAL(0, log.lines[39]);
    LONGS_EQUAL(41, log.lines[40]);
    DOUBLES_EQUAL(0.01, log.period_s, 1e-12);
}

TEST(MeasuredCsv, AsAreMoreForTenMilliseconds) {
    std::vector<std::string> lines = lines_of(100, 1000);
    lines.erase(lines.begin() + 40, lines.begin() + 50);
    const tools::MeasuredLogs filled = read(lines);
    expect_note(filled, 41, "up to 10 rows are missing 1 time");
    LONGS_EQUAL(100, filled.segments.front().samples.size());
    for (std::size_t i = 0; i < 100; ++i)
        DOUBLES_EQUAL(static_cast<double>(i), filled.segments.front().samples[i].speed_rad_per_s.left, 1e-9);
    lines.erase(lines.begin() + 40);
    LONGS_EQUAL(2, read(lines).segments.size());
}

TEST(MeasuredCsv, EmptyAndNanCellsAreMissingRows) {
    std::vector<std::string> lines = lines_of(60, 100);
    lines[10] = "0.09,0.5,nan,9,1";
    lines[30] = "0.29,0.5,,29,1";
    lines[31] = "";
    const tools::MeasuredLogs result = read(lines);
    LONGS_EQUAL(3, result.notes.size());
    STRCMP_CONTAINS("a cell is empty or nan in 2 rows", result.notes[0].message.c_str());
    LONGS_EQUAL(11, result.notes[0].line);
    STRCMP_CONTAINS("one row is missing 1 time", result.notes[1].message.c_str());
    STRCMP_CONTAINS("rows are missing 1 time", result.notes[2].message.c_str());
    LONGS_EQUAL(2, result.segments.size());
    LONGS_EQUAL(29, result.segments[0].samples.size());
    LONGS_EQUAL(29, result.segments[1].samples.size());
}

TEST(MeasuredCsv, LongerGapsAndTimeThatStartsAnewCutTheLog) {
    std::vector<std::string> lines = lines_of(90, 100);
    lines.erase(lines.begin() + 40, lines.begin() + 43);
    const tools::MeasuredLogs cut = read(lines);
    expect_note(cut, 41,
                "rows are missing 1 time, before this one first, for up to 0.04 s: the log is cut there");
    LONGS_EQUAL(2, cut.segments.size());
    LONGS_EQUAL(39, cut.segments[0].samples.size());
    LONGS_EQUAL(48, cut.segments[1].samples.size());
    DOUBLES_EQUAL(0.42, cut.segments[1].samples.front().t_s, 1e-12);
    DOUBLES_EQUAL(0.01, cut.segments[1].period_s, 1e-12);

    lines = lines_of(60, 100);
    for (std::size_t i = 31; i <= 60; ++i) lines[i] = at_time(lines[i], 0.01 * static_cast<double>(i - 31));
    const tools::MeasuredLogs anew = read(lines);
    expect_note(anew, 32, "time starts anew 1 time");
    LONGS_EQUAL(2, anew.segments.size());

    // where a row in ten is left and another ten are missing, nothing can be used
    std::vector<std::string> shreds{kHeader};
    const std::vector<std::string> whole = lines_of(400, 100);
    for (std::size_t i = 1; i < whole.size(); ++i) {
        if ((i / 10) % 2 == 0) shreds.push_back(whole[i]);
    }
    expect_problem(shreds, 0, "no 20 samples follow each other");
}

TEST(MeasuredCsv, JitteringStampsAreNoGaps) {
    std::vector<std::string> lines = lines_of(200, 100);
    // late stamps, by up to 1.8 steps, in a few places; one is early
    for (const std::size_t i : {20, 50, 51, 120, 199})
        lines[i] = at_time(lines[i], 0.01 * double(i - 1) + 0.008);
    lines[80] = at_time(lines[80], 0.79 + 0.0095);
    lines[150] = at_time(lines[150], 1.49 - 0.007);
    const tools::MeasuredLogs result = read(lines);
    expect_note(result, 21, "time stamps jitter by more than half a step");
    LONGS_EQUAL(1, result.segments.size());
    LONGS_EQUAL(200, result.segments.front().samples.size());
    for (std::size_t i = 0; i < 200; ++i)
        DOUBLES_EQUAL(static_cast<double>(i), result.segments.front().samples[i].speed_rad_per_s.left, 1e-12);
}

TEST(MeasuredCsv, DroppedRowsAreFoundAmongJitter) {
    // 3000 rows whose stamps jitter by 0.2 steps rms, a known twentieth of them dropped, some side by side
    std::vector<std::string> lines{kHeader};
    std::uint32_t state = 7;
    const auto uniform = [&] {
        state = state * 1664525 + 1013904223;
        return static_cast<double>(state >> 8) / (1 << 24);
    };
    std::size_t written = 0;
    for (std::size_t i = 0; i < 3000; ++i) {
        const double jitter = (uniform() + uniform() + uniform() - 1.5) * 0.4;
        const bool dropped = uniform() < 0.05;
        if (dropped && i > 0 && i < 2999) continue;
        std::ostringstream line;
        line.precision(12);
        line << 0.01 * (static_cast<double>(i) + jitter) << ",0.5,0.5," << i << ",1";
        lines.push_back(line.str());
        ++written;
    }
    const tools::MeasuredLogs result = read(lines);
    LONGS_EQUAL(0, result.problem_count);
    std::size_t wrong = 0;
    std::size_t samples = 0;
    for (const tools::MeasuredLog& log : result.segments) {
        for (std::size_t i = 1; i < log.samples.size(); ++i) {
            // the speed says which row it was
            wrong += std::abs(log.samples[i].speed_rad_per_s.left - log.samples[i - 1].speed_rad_per_s.left -
                              1) > 1e-9;
        }
        samples += log.samples.size();
    }
    std::printf("  %zu rows written, %zu samples in %zu segments, %zu steps wrong\n", written, samples,
                result.segments.size(), wrong);
    CHECK(wrong < 20);
    CHECK(samples > written * 8 / 10);
}

TEST(MeasuredCsv, RowsOutOfOrderAndRepeatedOnes) {
    std::vector<std::string> lines = lines_of(60, 100);
    std::swap(lines[30], lines[31]);
    const tools::MeasuredLogs swapped = read(lines);
    expect_note(swapped, 32, "rows are out of order 1 time");
    LONGS_EQUAL(60, swapped.segments.front().samples.size());
    DOUBLES_EQUAL(29, swapped.segments.front().samples[29].speed_rad_per_s.left, 0);
    lines = lines_of(60, 100);
    lines.insert(lines.begin() + 20, lines[19]);
    const tools::MeasuredLogs twice = read(lines);
    expect_note(twice, 21, "a time stamp is repeated 1 time");
    LONGS_EQUAL(60, twice.segments.front().samples.size());
}

TEST(MeasuredCsv, WhatIsNotANumberIsSaidByLineAndColumn) {
    for (const char* cell : {"inf", "1.2abc", "0x10", "--1", "1e999"}) {
        std::vector<std::string> lines = lines_of(40, 100);
        lines[7] = std::string("0.06,0.5,").append(cell).append(",1,1");
        const tools::MeasuredLogs result = read(lines);
        CHECK(result.segments.empty());
        LONGS_EQUAL(8, result.problems.front().line);
    }
    std::vector<std::string> lines = lines_of(40, 100);
    lines[7] = "0.06,0.5,oops,1,1";
    expect_problem(lines, 8, "column tau_right_Nm: found \"oops\", expected a finite number");
    lines[7] = "0.06,0.5,1,5,1,1";
    expect_problem(lines, 8, "found 6 columns, expected 5");
    lines[7] = "0.06,0.5,1,1";
    expect_problem(lines, 8, "found 4 columns, expected 5");
    // the last row of a logger that was switched off
    lines = lines_of(40, 100);
    lines.emplace_back("0.40,0.5,1");
    expect_note(read(lines), 42, "the last row is cut short");
}

TEST(MeasuredCsv, ManyProblemsAreCountedAndTheFirstAreKept) {
    std::vector<std::string> lines = lines_of(60, 100);
    for (std::size_t i = 1; i < lines.size(); ++i) lines[i] = "x,x,x,x,x";
    const tools::MeasuredLogs result = read(lines);
    LONGS_EQUAL(60, result.problem_count);
    LONGS_EQUAL(20, result.problems.size());
}

TEST(MeasuredCsv, AFileThatCannotBeOpenedSaysSo) {
    const tools::MeasuredLogs result = tools::read_measured_log("/nowhere.csv");
    LONGS_EQUAL(1, result.problem_count);
    STRCMP_CONTAINS("No such file", result.problems.front().message.c_str());
}

TEST(MeasuredCsv, OtherColumnsAndUnitsAreMapped) {
    std::vector<std::string> lines{"\"time\",volts left,volts right,rate left,v right,yaw"};
    for (int i = 0; i < 40; ++i) lines.push_back(std::to_string(10 * i) + ",2,-3,60,1.5,90");
    tools::LogReading reading =
        reading_of({"t=time[ms]", "tau_left=volts left[V]", "tau_right=-volts right[V]",
                    "omega_left=rate left[rpm]", "omega_right=v right[m/s]", "gyro_z=yaw[deg/s]"});
    expect_problem(lines, 1, "torque is given in volts: say --volts-are-torque", reading);
    reading.torque_per_volt_Nm = 0.5;
    const tools::MeasuredLogs result = read(lines, "\n", reading);
    expect_note(result, 0, "assumed: 1 V is 0.5 Nm at each wheel; back-EMF is not taken off");
    const tools::MeasuredLog& log = result.segments.front();
    DOUBLES_EQUAL(0.01, log.period_s, 1e-12);
    DOUBLES_EQUAL(1, log.samples[3].torque_Nm.left, 1e-12);
    DOUBLES_EQUAL(1.5, log.samples[3].torque_Nm.right, 1e-12);
    DOUBLES_EQUAL(2 * std::numbers::pi, log.samples[3].speed_rad_per_s.left, 1e-12);
    DOUBLES_EQUAL(7.5, log.samples[3].speed_rad_per_s.right, 1e-12);  // 1.5 m/s on a wheel of 0.2 m
    DOUBLES_EQUAL(std::numbers::pi / 2, log.samples[3].gyro_rad_per_s, 1e-12);
    reading.wheel_radius_m = {};
    expect_problem(lines, 1, "column v right: it is measured along the ground: the wheels' radius is needed",
                   reading);
}

TEST(MeasuredCsv, CurrentsAndWhatBothWheelsShare) {
    std::vector<std::string> lines{"t_s,iq,v"};
    for (int i = 0; i < 40; ++i) lines.push_back(std::to_string(0.01 * i) + ",4,1");
    tools::LogReading reading = reading_of({"tau=iq[A]", "omega=v[m/s]"});
    expect_problem(lines, 1, "column iq: torque is given in amperes: say --torque-per-ampere", reading);
    reading.torque_per_ampere_Nm = 0.3;
    const tools::MeasuredLogs result = read(lines, "\n", reading);
    expect_note(result, 0, "assumed: iq is shared by both wheels alike");
    DOUBLES_EQUAL(0.6, result.segments.front().samples[0].torque_Nm.left, 1e-12);
    DOUBLES_EQUAL(0.6, result.segments.front().samples[0].torque_Nm.right, 1e-12);
    DOUBLES_EQUAL(10, result.segments.front().samples[0].speed_rad_per_s.left, 1e-12);
    DOUBLES_EQUAL(5, result.segments.front().samples[0].speed_rad_per_s.right, 1e-12);
}

TEST(MeasuredCsv, MappingsThatAreWrongSayWhatIsExpected) {
    STRCMP_CONTAINS("expected KEY=COLUMN", complaint_about("tau_left").c_str());
    STRCMP_CONTAINS("no key is called torque; there are: t tau_left", complaint_about("torque=x").c_str());
    STRCMP_CONTAINS("no unit of it is called kg; there are: Nm mNm N V",
                    complaint_about("tau_left=x[kg]").c_str());
    STRCMP_CONTAINS("no column is named", complaint_about("tau_left=[V]").c_str());
    std::vector<std::string> lines = lines_of(40, 100);
    expect_problem(lines, 1, "column tau_lefd_Nm is missing; there is tau_left_Nm",
                   reading_of({"tau_left=tau_lefd_Nm"}));
}

// Speeds from angles: of a motion that is known.
TEST(MeasuredCsv, AnglesBecomeSpeeds) {
    constexpr double kRate_Hz = 200;
    constexpr double kCount_rad = 2 * std::numbers::pi / 4096;
    const auto speed = [](double t_s) { return 8 * std::sin(2 * t_s); };
    const auto angle = [](double t_s) { return 4 * (1 - std::cos(2 * t_s)); };
    // each sample, or held until every fourth; counted
    for (const std::size_t every : {std::size_t{1}, std::size_t{4}}) {
        std::vector<std::string> lines{"t_s,tau_left_Nm,tau_right_Nm,left,right"};
        for (std::size_t i = 0; i < 800; ++i) {
            const double fresh_s = static_cast<double>(i - i % every) / kRate_Hz;
            const double counted = kCount_rad * std::round(angle(fresh_s) / kCount_rad);
            std::ostringstream line;
            line.precision(12);
            line << static_cast<double>(i) / kRate_Hz << "," << i % every << ",1," << counted << ","
                 << counted / 2;
            lines.push_back(line.str());
        }
        const tools::MeasuredLogs result =
            read(lines, "\n", reading_of({"angle_left=left", "angle_right=right"}));
        LONGS_EQUAL(0, result.problem_count);
        const tools::MeasuredLog& log = result.segments.front();
        DOUBLES_EQUAL(static_cast<double>(every) / kRate_Hz, log.period_s, 1e-9);
        // what is held for a step is the mean of what was
        DOUBLES_EQUAL(static_cast<double>(every - 1) / 2, log.samples[5].torque_Nm.left, 1e-12);
        double worst = 0;
        double mean = 0;
        for (const tools::MeasuredSample& s : log.samples) {
            worst = std::max(worst, std::abs(s.speed_rad_per_s.left - speed(s.t_s)));
            mean += (s.speed_rad_per_s.right - speed(s.t_s) / 2) / static_cast<double>(log.samples.size());
        }
        std::printf("  fresh every %zu: worst error %.3f of 8 rad/s, mean %.4f\n", every, worst, mean);
        CHECK(worst < 0.15);
        CHECK(std::abs(mean) < 0.005);
    }
}
