// Measured logs of robots whose truth is known, integrated here step by step with equations written down
// anew: every rate, noise, unequal wheels, and what a log cannot tell.
#include <cmath>
#include <cstdio>
#include <functional>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/seeds.hpp"
#include "tests/tools/ident/temporary_file.hpp"
#include "tools/ident/findings.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using tools::Findings;

namespace {

// The robot of these logs; no number is shared with an example robot.
struct Truth {
    double radius_left = 0.061, radius_right = 0.059, track = 0.41;
    double k5 = 0.031, k7 = 0.93, k8 = 4.2;
    double k6 = -k5 * 2 * k8 / (track * k7);
    double viscous_left = 0.05, viscous_right = 0.08, dry_left = 0.25, dry_right = 0.15;
    double delay_s = 0.013;
};

struct LogOptions {
    double rate_Hz = 50;
    double duration_s = 60;
    double noise_rad_per_s = 0.05;
    unsigned seed = 1;
    bool straight = false;
    double bit_s = 0.2;
    bool measured_torque = false;  // the column is the torque that acts at the sample, not a command
};

std::string make_log(const Truth& t, const LogOptions& o) {
    std::mt19937 random(o.seed);
    std::normal_distribution<double> noise(0, o.noise_rad_per_s);
    std::uniform_real_distribution<double> torque(-1.6, 1.6);
    const int steps = static_cast<int>(std::ceil(20000 / o.rate_Hz / 20));  // about 50 us
    const double h = 1 / o.rate_Hz / steps;
    const int samples = static_cast<int>(o.duration_s * o.rate_Hz);
    const int bit = std::max(1, static_cast<int>(o.bit_s * o.rate_Hz));
    const auto delay_steps = static_cast<std::size_t>(std::lround(t.delay_s / h));
    std::vector<std::pair<double, double>> told(delay_steps + 1, {0.0, 0.0});
    std::size_t newest = 0;
    double v = 0;
    double w = 0;
    std::pair<double, double> command{0, 0};
    std::ostringstream out;
    out.precision(10);
    out << "t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s\n";
    const auto friction = [](double wheel, double viscous, double dry) {
        return viscous * wheel + dry * std::tanh(wheel / 0.01);
    };
    for (int i = 0; i < samples; ++i) {
        const auto wheel_left = [&] { return (v - w * t.track / 2) / t.radius_left; };
        const auto wheel_right = [&] { return (v + w * t.track / 2) / t.radius_right; };
        if (i % bit == 0) {
            command.first = torque(random);
            command.second = o.straight ? command.first : torque(random);
        }
        const double drawn_left = noise(random);
        const double drawn_right = noise(random);
        out << i / o.rate_Hz << ',' << command.first << ',' << command.second << ','
            << wheel_left() + drawn_left << ',' << wheel_right() + drawn_right << '\n';
        for (int s = 0; s < steps; ++s) {
            told[newest] = command;
            newest = (newest + 1) % told.size();
            const auto [left, right] = told[newest];  // the oldest
            const double tau_left = left - friction(wheel_left(), t.viscous_left, t.dry_left);
            const double tau_right = right - friction(wheel_right(), t.viscous_right, t.dry_right);
            const double v_rate = t.k5 * w * w + t.k7 * (tau_right + tau_left);
            const double w_rate = t.k6 * v * w + t.k8 * (tau_right - tau_left);
            v += h * v_rate;
            w += h * w_rate;
        }
    }
    return out.str();
}

tools::IdentSetup believed(const Truth& t) {
    tools::IdentSetup s;
    s.robot = model::default_parameters();
    s.robot.geometry = {{t.radius_left, t.radius_right}, t.track};
    for (const char* name : {"viscous_friction", "coulomb_friction"}) {
        s.effects[model::find_effect(name)] = true;
    }
    s.relative_standard_error = 0.01;
    return s;
}

Findings identify(const std::string& text, const Truth& t = {}) {
    const TemporaryFile file(text);
    return tools::identify_logs({file.path}, believed(t));
}

void expect_problem(const std::string& text, const std::string& part) {
    const Findings f = identify(text);
    CHECK(!f.problems.empty());
    std::printf("  %s\n", f.problems.front().c_str());
    CHECK_TEXT(f.problems.front().find(part) != std::string::npos, f.problems.front().c_str());
}

// Changes a log cell by cell: change(row from 0, column from 0, value).
std::string edit(const std::string& text, const std::function<double(int, int, double)>& change) {
    std::istringstream in(text);
    std::ostringstream out;
    out.precision(10);
    std::string line;
    std::getline(in, line);
    out << line << '\n';
    for (int row = 0; std::getline(in, line); ++row) {
        std::istringstream cells(line);
        std::string cell;
        for (int column = 0; std::getline(cells, cell, ','); ++column) {
            out << (column > 0 ? "," : "") << change(row, column, std::stod(cell));
        }
        out << '\n';
    }
    return out.str();
}

}  // namespace

TEST_GROUP(MeasuredLogs){};

TEST(MeasuredLogs, EveryRateTellsTheSameRobot) {
    const Truth t;
    for (const double rate : {20.0, 50.0, 200.0, 1000.0, 2000.0}) {
        if (rate > 50 && !test::all_seeds()) break;
        LogOptions o;
        o.rate_Hz = rate;
        o.duration_s = rate > 500 ? 10 : 60;
        o.noise_rad_per_s = 0.02;
        const Findings f = identify(make_log(t, o));
        CHECK(f.problems.empty());
        const double truth[4] = {t.k5, t.k6, t.k7, t.k8};
        std::printf("  %4.0f Hz:", rate);
        for (std::size_t i = 0; i < 4; ++i) {
            std::printf(" %s %.4g +- %.2g (%.4g)", f.k[i].label.data(), f.k[i].value, f.k[i].standard_error,
                        truth[i]);
        }
        std::printf(" delay %.2f +- %.2g ms\n", 1e3 * f.delay_s.value, 1e3 * f.delay_s.standard_error);
        const double friction[4] = {t.viscous_left, t.viscous_right, t.dry_left, t.dry_right};
        for (std::size_t i = 0; i < 4; ++i) {
            std::printf("           %.4g +- %.2g (%.4g)", f.effects[i].value, f.effects[i].standard_error,
                        friction[i]);
        }
        std::printf("\n");
        for (std::size_t i = 0; i < 4; ++i) {
            CHECK(f.k[i].known);
            // straight lines between samples: a share of a per cent besides
            CHECK(std::abs(f.k[i].value - truth[i]) < 4 * f.k[i].standard_error + 0.005 * std::abs(truth[i]));
            CHECK(f.effects[i].known);
            CHECK_FALSE(f.effects[i].common);
            CHECK(std::abs(f.effects[i].value - friction[i]) <
                  4 * f.effects[i].standard_error + 0.02 * friction[i]);
        }
        CHECK(std::abs(f.k7().value / t.k7 - 1) < 0.02);
        CHECK(std::abs(f.k8().value / t.k8 - 1) < 0.02);
        CHECK(f.delay_s.known);
        DOUBLES_EQUAL(t.delay_s, f.delay_s.value, 4 * f.delay_s.standard_error + 0.0005);
    }
}

TEST(MeasuredLogs, IntervalsHoldTheTruth) {
    const Truth t;
    constexpr unsigned kSeeds = test::seeds(25);
    int inside = 0;
    int count = 0;
    double mean[4]{};
    double square[4]{};
    for (unsigned seed = 1; seed <= kSeeds; ++seed) {
        LogOptions o;
        o.seed = seed;
        o.duration_s = 30;
        o.noise_rad_per_s = 0.1;
        const Findings f = identify(make_log(t, o));
        CHECK(f.problems.empty());
        const double truth[4] = {t.k5, t.k6, t.k7, t.k8};
        for (std::size_t i = 0; i < 4; ++i) {
            ++count;
            const double z = (f.k[i].value - truth[i]) / f.k[i].standard_error;
            mean[i] += z / kSeeds;
            square[i] += z * z / kSeeds;
            inside += std::abs(f.k[i].value - truth[i]) < 1.96 * f.k[i].standard_error ? 1 : 0;
        }
    }
    for (std::size_t i = 0; i < 4; ++i) {
        std::printf("  K%zu: mean z %.2f, rms z %.2f\n", i + 5, mean[i], std::sqrt(square[i]));
    }
    std::printf("  95 %% intervals hold the truth in %.1f %% of %d\n", 100.0 * inside / count, count);
    if (test::all_seeds()) CHECK(inside > 0.88 * count);
}

TEST(MeasuredLogs, DrivenStraightTurningStaysUnknown) {
    Truth t;
    t.radius_left = t.radius_right = 0.06;
    t.viscous_left = t.viscous_right = 0.06;
    t.dry_left = t.dry_right = 0.2;
    LogOptions o;
    o.straight = true;
    const Findings f = identify(make_log(t, o), t);
    CHECK(f.problems.empty());
    std::printf("  K7 %.5g +- %.2g (%.5g), delay %.3f ms\n", f.k7().value, f.k7().standard_error, t.k7,
                1e3 * f.delay_s.value);
    CHECK(f.k7().known);
    CHECK(std::abs(f.k7().value - t.k7) < 4 * f.k7().standard_error);
    for (const tools::DynamicsFigure* k : {&f.k5(), &f.k6(), &f.k8()}) {
        CHECK_FALSE(k->known);
        std::printf("  %s: %s\n", k->label.data(), k->reason.c_str());
        CHECK(!k->reason.empty());
    }
    CHECK_FALSE(f.good_enough(0.5));
    for (const tools::EffectFigure& e : f.effects) {
        CHECK(e.common);
        const double truth = model::kEffects[e.effect].name == "viscous_friction" ? 0.06 : 0.2;
        CHECK(std::abs(e.value - truth) < 4 * e.standard_error + 0.02 * truth);
    }
}

TEST(MeasuredLogs, TimeThatIsNotEvenCostsANoteAndNoPrecision) {
    const Truth t;
    const std::string good = make_log(t, {});
    const double whole = identify(good).k7().value;
    struct Case {
        double (*edit)(int row, int column, double x);
        const char* note;
    };
    for (const Case& each : {
             Case{[](int row, int column, double x) { return column == 0 && row >= 700 ? x + 1 : x; },
                  ":702: rows are missing 1 time"},
             Case{[](int row, int column, double x) { return column == 0 && row == 700 ? x - 0.02 : x; },
                  ":702: a time stamp is repeated 1 time"},
             Case{[](int row, int column, double x) { return column == 0 && row >= 700 ? x - 3 : x; },
                  ":702: time starts anew 1 time"},
             Case{[](int row, int column, double x) { return column == 0 && row == 700 ? x + 0.015 : x; },
                  ":702: time stamps jitter by more than half a step 2 times"},
         }) {
        const Findings f = identify(edit(good, each.edit));
        CHECK(f.problems.empty());
        CHECK(!f.notes.empty());
        std::printf("  %s: K7 %.6g\n", f.notes.front().c_str(), f.k7().value);
        STRCMP_CONTAINS(each.note, f.notes.front().c_str());
        LONGS_EQUAL(1, f.logs.size());
        DOUBLES_EQUAL(whole, f.k7().value, 0.002 * whole);
    }
}

TEST(MeasuredLogs, SpoiltLogsAreRefusedByLine) {
    const std::string good = make_log({}, {});
    expect_problem(edit(good, [](int, int column, double x) { return column == 1 || column == 2 ? 1.5 : x; }),
                   ":2: the torque is constant (1.5 Nm left, 1.5 Nm right in every line)");
    expect_problem(edit(good, [](int, int column, double x) { return column == 1 || column == 2 ? 0 : x; }),
                   ":2: the torque is zero in every line");
    expect_problem(edit(good, [](int, int column, double x) { return column >= 3 ? 0 : x; }),
                   "the wheels never turn");
    // half of all readings of one wheel at the sensor's limit
    expect_problem(
        edit(good, [](int, int column, double x) { return column == 3 ? std::clamp(x, -1.0, 1.0) : x; }),
        "omega_left_rad_s repeats one value while the torque changes");
    LogOptions short_log;
    short_log.duration_s = 0.9;
    expect_problem(make_log({}, short_log), "too short");
    expect_problem("t_s,tau_left_Nm,omega_left_rad_s\n0,1,2\n", ":1: column tau_right_Nm is missing");
}

TEST(MeasuredLogs, LogsOfOneExperimentNeedOneFormAndOneRate) {
    const Truth t;
    LogOptions o;
    o.duration_s = 20;
    o.noise_rad_per_s = 0.5;
    const TemporaryFile first(make_log(t, o));
    o.seed = 2;
    const TemporaryFile second(make_log(t, o));
    o.rate_Hz = 100;
    const TemporaryFile faster(make_log(t, o));
    const TemporaryFile frames("(1.000000) can0 02E#0000803F\n");
    const Findings one = tools::identify_logs({first.path}, believed(t));
    const Findings two = tools::identify_logs({first.path, second.path}, believed(t));
    std::printf("  K7 +- %.2g from one log, %.2g from two\n", one.k7().standard_error,
                two.k7().standard_error);
    CHECK(two.k7().standard_error < 0.9 * one.k7().standard_error);
    CHECK(std::abs(two.k7().value - t.k7) < 4 * two.k7().standard_error);
    CHECK(tools::identify_logs({first.path, faster.path}, believed(t)).problems.front().find("one rate") !=
          std::string::npos);
    CHECK(tools::identify_logs({first.path, frames.path}, believed(t))
              .problems.front()
              .find("one experiment") != std::string::npos);
    CHECK(tools::identify_logs({"/no/such/log.csv"}, believed(t)).problems.front().find("cannot open") !=
          std::string::npos);
}
