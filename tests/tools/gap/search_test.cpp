// The gap analysis on logs whose hidden effect is known here and nowhere else.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/seeds.hpp"
#include "tests/tools/gap/hidden_effect.hpp"
#include "tests/tools/ident/temporary_file.hpp"
#include "tools/gap/analysis.hpp"
#include "tools/gap/inference/sensor_evidence.hpp"
#include "tools/gap/logs/experiment.hpp"
#include "tools/gap/logs/sensors.hpp"
#include "tools/gap/report/held_out.hpp"
#include "tools/gap/report/injection.hpp"
#include "tools/gap/report/output.hpp"
#include "tools/gap/report/robot_files.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using test::HiddenEffect;
using test::HiddenLog;

namespace {

constexpr double kDuration_s = 40;
constexpr double kRate_Hz = 250;

gap::Findings analyse(const HiddenLog& hidden, std::string* json = nullptr) {
    const TemporaryFile file;
    const std::string& path = file.path;
    test::write_csv(hidden.log, path);
    gap::Request request;
    request.logs = {path};
    request.geometry = hidden.geometry;
    gap::Findings findings = gap::analyse(request);
    if (json != nullptr) *json = gap::json(findings, request);
    return findings;
}

std::string names_of(const gap::Findings& f) {
    std::string names;
    for (const auto& e : f.effects) names.append(" ").append(model::kEffects[e.effect].name);
    return names;
}

std::vector<HiddenEffect> medium() {
    return {{"viscous_friction", 0.08, {0.02, 0.02}}, {"coulomb_friction", 0.08, {0.1, 0.1}},
            {"quadratic_drag", 0.08, {2.0}},          {"turning_scrub", 0.08, {0.2}},
            {"torque_bias", 0.08, {0.1, -0.04}},      {"slope", 0, {0.03, 0.7}},
            {"torque_gain_mismatch", 0, {0.08}}};
}

}  // namespace

TEST_GROUP(GapSearch){};

TEST(GapSearch, names_each_effect_of_medium_size) {
    int right = 0, all = 0, extra = 0;
    for (const HiddenEffect& effect : medium()) {
        for (int seed = 1; seed <= test::seeds(3); ++seed) {
            const HiddenLog hidden =
                test::hidden_log(effect, static_cast<std::uint64_t>(seed), 0.01, kDuration_s, kRate_Hz);
            const gap::Findings f = analyse(hidden);
            const std::string names = names_of(f);
            const bool exact = f.conclusion.verdict == gap::Verdict::named && f.effects.size() == 1 &&
                               model::kEffects[f.effects[0].effect].name == effect.name;
            right += exact;
            extra += f.effects.size() > 1;
            ++all;
            std::printf("%-22s seed %d: %s:%s", effect.name.c_str(), seed,
                        gap::verdict_name(f.conclusion.verdict), names.c_str());
            for (const auto& e : f.effects) {
                for (const auto& p : e.parameters) std::printf("  %.4g+-%.2g", p.value, p.standard_error);
                for (const auto& r : e.rivals)
                    std::printf(" [rival %s keeps %.3f]", model::kEffects[r.effect].name.data(), r.keeps);
            }
            std::printf(
                " (truth %.4g %.4g) closed %.3f, gap %.3g -> %.3g floor %.3g, left %.4f, late %.2f+-%.2f, "
                "run %.3g -> %.3g\n",
                hidden.parameters[0], hidden.parameters[1], f.closable_share, f.search.gap_refit,
                f.search.gap_after, f.search.floor, f.search.residual_torque_share, f.search.timing_samples,
                f.search.timing_error, f.heldout.empty() ? 0.0 : f.heldout.back().before.both,
                f.heldout.empty() ? 0.0 : f.heldout.back().after.both);
            for (const auto& p : f.problems) std::printf("  problem: %s\n", p.c_str());
        }
    }
    std::printf("%d of %d named exactly, %d with a name too many\n", right, all, extra);
    CHECK(right >= all * 9 / 10);
    CHECK(extra <= all / 20);
}

TEST(GapSearch, names_nothing_where_nothing_is_hidden) {
    int alarms = 0;
    int unexplained = 0;
    constexpr int kLogs = test::seeds(30);
    for (std::uint64_t seed = 101; seed < 101 + kLogs; ++seed) {
        const double noise = seed % 3 == 0 ? 0.002 : seed % 3 == 1 ? 0.01 : 0.05;
        const gap::Findings f = analyse(test::hidden_log({}, seed, noise, kDuration_s, kRate_Hz));
        alarms += !f.effects.empty();
        unexplained += f.conclusion.verdict != gap::Verdict::nothing_missing;
        if (f.conclusion.verdict != gap::Verdict::nothing_missing) {
            std::printf("seed %d noise %g: %s, %s; gap %.3g floor %.3g left %.4f late %.2f+-%.2f\n",
                        int(seed), noise, gap::verdict_name(f.conclusion.verdict),
                        f.effects.empty() ? "" : model::kEffects[f.effects[0].effect].name.data(),
                        f.search.gap_refit, f.search.floor, f.search.residual_torque_share,
                        f.search.timing_samples, f.search.timing_error);
        }
    }
    std::printf("%d logs with nothing hidden: %d false alarms, %d not called nothing_missing\n", kLogs,
                alarms, unexplained);
    LONGS_EQUAL(0, alarms);
    CHECK(unexplained <= 1);
}

// Driven straight both do the same. What tells is a short log beside a long one, and its pieces are few.
TEST(GapSearch, a_short_log_that_tells_is_not_outvoted_by_a_long_one_that_does_not) {
    const std::vector<HiddenEffect> effects{{"torque_bias", 0, {0.07, 0.05}}, {"slope", 0, {0.03, 2.9}}};
    for (const HiddenEffect& effect : effects) {
        const HiddenLog straight = test::hidden_log(effect, 6, 0.01, 50, 100, true);
        const HiddenLog turning = test::hidden_log(effect, 6, 0.01, 20, 100);
        const TemporaryFile first;
        const TemporaryFile second;
        test::write_csv(straight.log, first.path);
        test::write_csv(turning.log, second.path);
        gap::Request request;
        request.logs = {first.path, second.path};
        request.geometry = straight.geometry;
        const gap::Findings findings = gap::analyse(request);
        STRCMP_EQUAL((" " + effect.name).c_str(), names_of(findings).c_str());
        STRCMP_EQUAL("named", gap::verdict_name(findings.conclusion.verdict));
        CHECK(findings.effects.front().rivals.empty());
    }
}

// Also in a block that is to confirm what others chose, and between the times that are tried first.
TEST(GapSearch, a_load_is_found_whenever_it_is_put_on) {
    int found = 0, all = 0;
    for (double time_s = 4.5; time_s < 40; time_s += 1.5) {
        const HiddenLog hidden = test::hidden_log({"payload_step", 0, {time_s, 4.4, 0.12}}, 5, 0.003, 50, 50);
        const gap::Findings f = analyse(hidden);
        const bool right = names_of(f) == " payload_step" && f.conclusion.verdict == gap::Verdict::named &&
                           std::abs(f.search.points.at(model::find_effect("payload_step"))[0] - time_s) < 1.0;
        if (!right) {
            std::printf("load at %g s: %s:%s\n", time_s, gap::verdict_name(f.conclusion.verdict),
                        names_of(f).c_str());
        }
        found += right;
        ++all;
    }
    LONGS_EQUAL(all, found);
}

// Its inertia does not show in a log that goes straight until long after: one that turns behind it.
TEST(GapSearch, a_load_is_found_though_its_inertia_does_not_show) {
    const HiddenEffect load{"payload_step", 0, {15, 1.6, 0.05}};
    HiddenLog hidden = test::hidden_log(load, 8, 0.01, 26, kRate_Hz, true);
    const HiddenLog turning =
        test::hidden_log({"payload_step", 0, {0.001, 1.6, 0.05}}, 8, 0.01, 20, kRate_Hz);
    const double from_s = hidden.log.samples.back().t_s + hidden.log.period_s;
    for (tools::MeasuredSample s : turning.log.samples) {
        s.t_s += from_s;
        hidden.log.samples.push_back(s);
    }
    const gap::Findings f = analyse(hidden);
    STRCMP_EQUAL(" payload_step", names_of(f).c_str());
    STRCMP_EQUAL("named", gap::verdict_name(f.conclusion.verdict));
    const auto& p = f.effects.front().parameters;
    CHECK(p[0].standard_error < 1 && p[1].standard_error < 0.12);
    DOUBLES_EQUAL(15, p[0].value, 3 * p[0].standard_error);
    DOUBLES_EQUAL(1.6, p[1].value, 4 * p[1].standard_error);
    DOUBLES_EQUAL(0.05, p[2].value, 3 * p[2].standard_error);
}

// Half a per cent of the torque, where it is all that is missing.
TEST(GapSearch, radii_that_differ_by_little_are_named_without_a_gyro) {
    const gap::Findings f =
        analyse(test::hidden_log({"wheel_radius_mismatch", 0, {0.006}}, 12, 0.01, kDuration_s, kRate_Hz));
    STRCMP_EQUAL(" wheel_radius_mismatch", names_of(f).c_str());
    CHECK(f.effects[0].torque_share < gap::kPolicy.effect);
    DOUBLES_EQUAL(0.006, f.effects[0].parameters[0].value, 0.001);
}

// In noise no piece alone tells them apart, and all together do.
TEST(GapSearch, a_delay_in_noise_is_no_lag) {
    for (const std::uint64_t seed : {21, 22, 23}) {
        const gap::Findings f =
            analyse(test::hidden_log({"transport_delay", 0, {0.006}}, seed, 0.05, kDuration_s, kRate_Hz));
        STRCMP_EQUAL(" transport_delay", names_of(f).c_str());
        STRCMP_EQUAL("named", gap::verdict_name(f.conclusion.verdict));
    }
}

TEST_GROUP(GapSensors){};

// Speeds in steps of 0.12 rad/s, told anew every 20 ms or with each row of 5 ms.
TEST(GapSensors, a_sensor_slower_than_the_log_loses_no_rows_and_its_counts_are_not_known) {
    for (const int together : {4, 1}) {
        tools::MeasuredLog log;
        log.period_s = 0.005;
        for (int i = 0; i < 2000; ++i) {
            tools::MeasuredSample s;
            s.t_s = i * log.period_s;
            const double found_s = (i - i % together) * log.period_s;
            const double speed = 0.12 * std::round((9 + 6 * std::sin(1.3 * found_s)) / 0.12);
            s.speed_rad_per_s = {speed, speed};
            s.torque_Nm = {1, 1};
            log.samples.push_back(s);
        }
        std::vector<bool> unusable;
        CHECK(gap::repair(log, unusable).empty());
        const gap::Sensors sensors = gap::sensors_of({log}, {{0.08, 0.08}, 0.4});
        CHECK_EQUAL(together == 1 ? 1U : 0U, sensors.effects.size());
        DOUBLES_EQUAL(together == 1 ? 0 : 0.12, sensors.unknown_step_rad_per_s, 1e-9);
        CHECK_FALSE(gap::known_before(sensors, {}, 0.4).white_noise);
        log.by_angles = true;  // as fine as the speeds may look then: an encoder's steps
        for (tools::MeasuredSample& s : log.samples)
            s.speed_rad_per_s.left = s.speed_rad_per_s.right = 9 + 6 * std::sin(1.3 * s.t_s);
        CHECK_FALSE(gap::known_before(gap::sensors_of({log}, {{0.08, 0.08}, 0.4}), {}, 0.4).white_noise);
        log.by_angles = false;
        CHECK(gap::known_before(gap::sensors_of({log}, {{0.08, 0.08}, 0.4}), {}, 0.4).white_noise);
    }
}

// The wheels' speeds are sums of sines, late by a first-order lag whose gain and phase are known; the gyro is
// in time, and noisier than what the lag makes.
TEST(GapSensors, a_lag_of_the_report_is_known_from_a_noisy_gyro) {
    const model::Geometry<double> geometry{{0.081, 0.081}, 0.37};
    for (const double rate_Hz : {100.0, 250.0, 500.0}) {
        for (const double lag_s : {0.0, 0.009, 0.04}) {
            std::mt19937_64 random(static_cast<std::uint64_t>(rate_Hz + 1e6 * lag_s));
            std::normal_distribution<double> normal;
            tools::MeasuredLog log;
            log.period_s = 1 / rate_Hz;
            log.has_gyro = true;
            for (int i = 0; i < 40 * static_cast<int>(rate_Hz); ++i) {
                const double t_s = i * log.period_s;
                double yaw = 0, late_yaw = 0;
                for (const double frequency_rad_per_s : {0.9, 2.3, 5.1, 11.7, 23.0}) {
                    const double angle = frequency_rad_per_s * (t_s + 0.3);
                    const double turned = lag_s * frequency_rad_per_s;
                    yaw += 0.3 * std::sin(angle);
                    late_yaw += 0.3 * std::sin(angle - std::atan(turned)) / std::hypot(1.0, turned);
                }
                const double late_forward =
                    0.6 * std::sin(1.7 * t_s - std::atan(1.7 * lag_s)) / std::hypot(1.0, 1.7 * lag_s);
                tools::MeasuredSample s;
                s.t_s = t_s;
                s.gyro_rad_per_s = yaw + 0.02 * normal(random);
                const double radius_m = geometry.wheel_radius_m.left;
                const double difference = late_yaw * geometry.track_m / 2;
                s.speed_rad_per_s = {(late_forward - difference) / radius_m + 0.05 * normal(random),
                                     (late_forward + difference) / radius_m + 0.05 * normal(random)};
                log.samples.push_back(s);
            }
            const gap::Sensors sensors = gap::sensors_of({log}, geometry);
            CHECK(sensors.gyro.has_value());
            std::printf("%.0f Hz, lag %.3f s: %.5f +- %.5f s\n", rate_Hz, lag_s, sensors.gyro->lag_s,
                        sensors.gyro->lag_error_s);
            const bool named =
                std::any_of(sensors.effects.begin(), sensors.effects.end(), [](const gap::SensorEffect& e) {
                    return model::kEffects[e.effect].name == "measurement_lag";
                });
            CHECK_EQUAL(lag_s > 0, named);
            if (named) {
                DOUBLES_EQUAL(lag_s, sensors.gyro->lag_s, 3 * sensors.gyro->lag_error_s);
                CHECK(sensors.gyro->lag_error_s < 0.1 * lag_s);
            }
        }
    }
}

TEST_GROUP(GapFindings){};

TEST(GapFindings, parameters_lie_within_their_intervals_and_the_free_run_comes_down_to_the_noise) {
    std::string json;
    const HiddenLog hidden = test::hidden_log({"quadratic_drag", 0.1, {2.0}}, 7, 0.01, kDuration_s, kRate_Hz);
    const gap::Findings f = analyse(hidden, &json);
    STRCMP_EQUAL(" quadratic_drag", names_of(f).c_str());
    const gap::ParameterEstimate& drag = f.effects[0].parameters[0];
    CHECK(std::abs(drag.value - hidden.parameters[0]) < 5 * drag.standard_error);
    DOUBLES_EQUAL(hidden.parameters[0], drag.value, 0.01 * hidden.parameters[0]);
    const gap::FreeRun& whole = f.heldout.back();
    DOUBLES_EQUAL(0, whole.window_s, 0);
    CHECK(whole.before.both > 10 * whole.after.both);
    CHECK(whole.after.both < 3 * f.floor_rad_per_s);
    for (const char* field :
         {"\"verdict\": \"named\"", "\"drag_N_s2_per_m2\"", "\"interval_95\"", "\"closes\"", "\"rivals\"",
          "\"parameter_shift\"", "\"unknowable\"", "\"where\"", "\"detectable\"", "\"advice\"",
          "\"wheel_speed_rms_rad_s\"", "\"closable_share\""}) {
        CHECK_TEXT(json.find(field) != std::string::npos, field);
    }
}

// The held-out part begins somewhere on the wheels' turn.
TEST(GapFindings, a_ripple_goes_on_in_the_held_out_part) {
    const gap::Findings f =
        analyse(test::hidden_log({"torque_ripple", 0, {0.05, 3, 1}}, 8, 0.01, kDuration_s, kRate_Hz));
    STRCMP_EQUAL(" torque_ripple", names_of(f).c_str());
    CHECK(f.closable_share > 0.98);
}

// K5..K8 are those of the robot with its motors, as the model with backlash wants them.
TEST(GapFindings, backlash_leaves_the_mass_as_it_is_and_makes_the_free_run_better) {
    const gap::Findings f =
        analyse(test::hidden_log({"backlash", 0, {0.08, 0.003}}, 9, 0.005, kDuration_s, kRate_Hz));
    STRCMP_EQUAL(" backlash", names_of(f).c_str());
    DOUBLES_EQUAL(f.before.k7_per_kg_m, f.after.k7_per_kg_m, 0.01 * f.before.k7_per_kg_m);
    const gap::FreeRun& whole = f.heldout.back();
    CHECK(whole.after.both < whole.before.both);
    // told is their product
    const auto& p = f.effects[0].parameters;
    DOUBLES_EQUAL(1, p[0].value * p[1].value / (0.08 * 0.003), 0.5);
}

TEST(GapFindings, the_written_file_alone_makes_the_free_run_that_is_claimed) {
    for (const HiddenEffect& effect :
         {HiddenEffect{"cog_lateral", 0, {0.02}}, HiddenEffect{"wheel_radius_mismatch", 0, {0.03}},
          HiddenEffect{"coulomb_friction", 0.08, {0.1, 0.1}}}) {
        const HiddenLog hidden = test::hidden_log(effect, 12, 0.01, kDuration_s, kRate_Hz);
        const TemporaryFile csv;
        test::write_csv(hidden.log, csv.path);
        gap::Request request;
        request.logs = {csv.path};
        request.geometry = hidden.geometry;
        const gap::Findings f = gap::analyse(request);
        STRCMP_EQUAL((" " + effect.name).c_str(), names_of(f).c_str());
        const gap::ReadBack read = gap::read_back(f.extended_file, "robot.extended.toml");
        STRCMP_EQUAL("", read.problem.c_str());
        const gap::Logs logs = gap::read_logs(request.logs, std::nullopt, request.reading);
        const gap::Parts parts = gap::split(logs, request.geometry, {});
        const gap::FreeRun whole =
            gap::free_runs(*parts.held_out, {std::nullopt, *read.robot, *read.robot}).back();
        const double told = f.heldout.back().after.both;
        DOUBLES_EQUAL(told, whole.after.both, 0);
    }
}

TEST(GapFindings, a_log_that_nothing_is_put_on_is_itself) {
    const HiddenLog hidden = test::hidden_log({"coulomb_friction", 0.08, {0.1, 0.1}}, 12, 0.01, 5, kRate_Hz);
    const gap::SimulatedRobot robot{hidden.geometry, {0.05, -1, 0.9, 4.2}, {}, true};  // quite another
    const tools::MeasuredLog same = gap::inject(hidden.log, robot, robot.effects, 0);
    model::EffectSet<double> drag;
    drag.active[model::find_effect("quadratic_drag")] = true;
    drag.parameter[model::find_effect("quadratic_drag")][0] = 5;
    const tools::MeasuredLog other = gap::inject(hidden.log, robot, drag, 0);
    double apart = 0;
    for (std::size_t i = 0; i < hidden.log.samples.size(); ++i) {
        const WheelPair<double>& was = hidden.log.samples[i].speed_rad_per_s;
        DOUBLES_EQUAL(was.left, same.samples[i].speed_rad_per_s.left, 1e-6);
        DOUBLES_EQUAL(hidden.log.samples[i].torque_Nm.right, same.samples[i].torque_Nm.right, 1e-6);
        apart = std::max(apart, std::abs(was.left - other.samples[i].speed_rad_per_s.left));
    }
    CHECK(apart > 0.1);
}

TEST(GapFindings, driven_straight_nothing_is_said_of_turning) {
    HiddenLog hidden =
        test::hidden_log({"coulomb_friction", 0.1, {0.1, 0.1}}, 4, 0.01, kDuration_s, kRate_Hz, true);
    const gap::Findings f = analyse(hidden);
    CHECK_FALSE(f.turning);
    STRCMP_EQUAL(" coulomb_friction", names_of(f).c_str());
    for (const char* of_turning : {"K5", "K6", "K8"}) {
        CHECK(std::find(f.search.unknowable.begin(), f.search.unknowable.end(), of_turning) !=
              f.search.unknowable.end());
    }
    // the wheels' sum is known, its shares are not
    const gap::ParameterEstimate& left = f.effects[0].parameters[0];
    CHECK(left.standard_error > 0.1 * left.value);
}

TEST(GapFindings, a_gyro_that_turns_with_the_speed_shows_unequal_radii) {
    constexpr double kTrack_m = 0.4;
    const std::size_t mismatch = model::find_effect("wheel_radius_mismatch");
    gap::Sensors sensors;
    sensors.gyro = gap::Sensors::Gyro{};
    sensors.gyro->bend_per_m = 0.05;
    sensors.gyro->bend_error = 0.01;
    const std::vector<std::size_t> shown = gap::known_before(sensors, {}, kTrack_m).shown;
    LONGS_EQUAL(1, shown.size());
    LONGS_EQUAL(mismatch, shown.front());
    CHECK(gap::known_before(sensors, std::vector{mismatch}, kTrack_m).shown.empty());
    sensors.gyro->bend_error = 0.02;  // it may be none
    CHECK(gap::known_before(sensors, {}, kTrack_m).shown.empty());
}

TEST(GapFindings, a_bias_driven_straight_names_the_slope_as_its_rival) {
    const HiddenLog hidden =
        test::hidden_log({"torque_bias", 0.1, {0.1, 0.1}}, 5, 0.01, kDuration_s, kRate_Hz, true);
    const gap::Findings f = analyse(hidden);
    STRCMP_EQUAL(" torque_bias", names_of(f).c_str());
    LONGS_EQUAL(1, f.effects[0].rivals.size());
    CHECK(f.effects[0].rivals[0].confounded);
    LONGS_EQUAL(model::find_effect("slope"), f.effects[0].rivals[0].effect);
}

TEST(GapFindings, a_steady_speed_in_coarse_steps_is_no_dropout) {
    constexpr double kStep_rad_per_s = 0.6;
    const auto told = [](double t_s) {
        const double w = 6 + 3 * std::sin(0.4 * t_s);
        return kStep_rad_per_s * std::round(w / kStep_rad_per_s);
    };
    tools::MeasuredLog log;
    log.period_s = 0.004;
    for (int i = 0; i < 5000; ++i) {
        const double t_s = 0.004 * i;
        log.samples.push_back({t_s, {0.1, 0.1}, {told(t_s), told(t_s + 1)}});
    }
    std::vector<bool> unusable;
    CHECK(gap::repair(log, unusable).empty());
    for (int i = 1000; i < 1400; ++i)
        log.samples[std::size_t(i)].speed_rad_per_s = log.samples[1000].speed_rad_per_s;
    const auto faults = gap::repair(log, unusable);
    CHECK_EQUAL(1, faults.size());
    STRCMP_EQUAL("log_dropouts", faults.front().name.c_str());
}

// An encoder of 65536 counts, told over 10 ms: finer than what `encoder_quantisation` is named for.
TEST(GapFindings, a_robot_that_waits_and_starts_again_loses_no_samples) {
    constexpr double kStep_rad_per_s = 0.0095874;
    const auto told = [](double t_s) {  // held by friction, faster and faster, steady, and to a halt
        const double w = std::clamp(std::min(4 * (t_s - 2), 4 * (8 - t_s)), 0.0, 6.0);
        return kStep_rad_per_s * std::round(w / kStep_rad_per_s);
    };
    tools::MeasuredLog log;
    log.period_s = 0.004;
    for (int i = 0; i < 2500; ++i) {
        const double t_s = 0.004 * i;
        log.samples.push_back({t_s, {0.1, 0.1}, {3 * kStep_rad_per_s + told(t_s), told(t_s + 0.2)}});
    }
    std::vector<bool> unusable;
    CHECK(gap::repair(log, unusable).empty());
    // on its way up
    const WheelPair<double> held = log.samples[625].speed_rad_per_s;
    for (std::size_t i = 625; i < 665; ++i) log.samples[i].speed_rad_per_s = held;
    const auto faults = gap::repair(log, unusable);
    CHECK_EQUAL(1, faults.size());
    STRCMP_EQUAL("log_dropouts", faults.front().name.c_str());
    CHECK_EQUAL(39, faults.front().count);
}

TEST(GapFindings, unusable_logs_say_why) {
    const HiddenLog good = test::hidden_log({}, 9, 0.01, kDuration_s, kRate_Hz);
    const auto problem = [&](auto&& spoil) {
        HiddenLog spoilt = good;
        for (tools::MeasuredSample& s : spoilt.log.samples) spoil(s);
        const gap::Findings f = analyse(spoilt);
        return f.problems.empty() ? std::string() : f.problems.front();
    };
    STRCMP_CONTAINS("sign", problem([](tools::MeasuredSample& s) {
                                s.torque_Nm = {std::abs(s.torque_Nm.left), std::abs(s.torque_Nm.right)};
                            }).c_str());
    STRCMP_CONTAINS("swapped", problem([](tools::MeasuredSample& s) {
                                   std::swap(s.speed_rad_per_s.left, s.speed_rad_per_s.right);
                               }).c_str());
    STRCMP_CONTAINS("swapped", problem([](tools::MeasuredSample& s) {
                                   std::swap(s.torque_Nm.left, s.torque_Nm.right);
                               }).c_str());
    STRCMP_CONTAINS("2 pi",
                    problem([](tools::MeasuredSample& s) {
                        s.speed_rad_per_s = {s.speed_rad_per_s.left / 6.283, s.speed_rad_per_s.right / 6.283};
                    }).c_str());
    STRCMP_CONTAINS("excitation", problem([](tools::MeasuredSample& s) { s.torque_Nm = {}; }).c_str());
    HiddenLog brief = good;
    brief.log.samples.resize(500);
    STRCMP_CONTAINS("too short", analyse(brief).problems.front().c_str());
}
