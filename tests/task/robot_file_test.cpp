// What a robot file says, and what is said about a bad one.
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "firmware/task/robot_file.hpp"
#include "firmware/task/robot_file_hints.hpp"
#include "firmware/task/write_file.hpp"
#include "sim_hal/world.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using task::Diagnostic;
using task::parse_robot_file;
using task::RobotFileResult;

namespace {

const std::string kRobots = std::string(WHEELWRIGHT_SOURCE_DIR) + "/tools/robots/";

bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

// The text must give exactly one problem, at this place, whose message has all these parts.
void expect_problem(const std::string& text, unsigned line, unsigned column, const std::string& key,
                    const std::vector<std::string>& parts) {
    const RobotFileResult result = parse_robot_file(text, "r.toml");
    CHECK_FALSE(result.robot.has_value());
    for (const Diagnostic& problem : result.problems) std::printf("  %s\n", task::to_text(problem).c_str());
    LONGS_EQUAL(1, result.problems.size());
    const Diagnostic& problem = result.problems.front();
    LONGS_EQUAL(line, problem.line);
    LONGS_EQUAL(column, problem.column);
    STRCMP_EQUAL(key.c_str(), problem.key.c_str());
    for (const std::string& part : parts) {
        CHECK_TEXT(has(problem.message, part), (problem.message + " lacks: " + part).c_str());
    }
}

model::RobotParameters read_good(const std::string& text) {
    const RobotFileResult result = parse_robot_file(text, "r.toml");
    for (const Diagnostic& problem : result.problems) std::printf("  %s\n", task::to_text(problem).c_str());
    CHECK(result.robot.has_value());
    return result.robot->parameters;
}

std::string toml_value(const model::ParameterInfo& info, double value) {
    switch (info.kind) {
        case model::ParameterKind::boolean:
            return value != 0 ? "true" : "false";
        case model::ParameterKind::choice:
            return std::string("\"").append(info.choices[static_cast<std::size_t>(value)]).append("\"");
        case model::ParameterKind::integer:
            return std::to_string(static_cast<long>(value));
        case model::ParameterKind::real:
            break;
    }
    return task::shortest_number(value);
}

}  // namespace

TEST_GROUP(RobotFile){};

TEST(RobotFile, EveryExampleIsGood) {
    for (const char* name : {"default", "simulated", "light", "heavy"}) {
        const RobotFileResult result = task::read_robot_file(kRobots + name + ".toml");
        for (const Diagnostic& problem : result.problems) std::printf("%s\n", task::to_text(problem).c_str());
        CHECK_TEXT(result.robot.has_value(), name);
        CHECK(!result.robot->name.empty());
    }
}

// Numbers of the notes on the paper: m_eff 9.466 kg, I_eff 0.3164 kg m2, r 0.075 m, b 0.32 m.
TEST(RobotFile, DefaultRobotIsTheOneOfThePaper) {
    const RobotFileResult result = task::read_robot_file(kRobots + "default.toml");
    CHECK(result.robot.has_value());
    const model::RobotParameters& p = result.robot->parameters;
    DOUBLES_EQUAL(1 / (9.466 * 0.075), p.dynamics.k7_per_kg_m, 2e-4);
    DOUBLES_EQUAL(0.32 / (2 * 0.075 * 0.3164), p.dynamics.k8_per_kg_m2, 2e-3);
    DOUBLES_EQUAL(-1.2356, p.dynamics.k6_per_m, 1e-4);
}

TEST(RobotFile, SimulatedRobotDiffersFromTheBelievedOneInEveryMeasuredNumber) {
    const RobotFileResult believed = task::read_robot_file(kRobots + "default.toml");
    const RobotFileResult truth = task::read_robot_file(kRobots + "simulated.toml");
    CHECK(believed.robot.has_value() && truth.robot.has_value());
    for (const char* key :
         {"geometry.wheel_radius_m.left", "geometry.wheel_radius_m.right", "geometry.track_m",
          "dynamics.k5_m", "dynamics.k6_per_m", "dynamics.k7_per_kg_m", "dynamics.k8_per_kg_m2",
          "drive.left.torque_constant_Nm_per_A", "drive.right.torque_constant_Nm_per_A"}) {
        const model::ParameterInfo* info = model::find_parameter(key);
        CHECK_TEXT(info->get(believed.robot->parameters) != info->get(truth.robot->parameters), key);
    }
    for (const char* key : {"drive.left.node", "drive.right.node", "drive.left.sign", "drive.right.sign",
                            "drive.generation", "drive.left.gear_ratio"}) {
        const model::ParameterInfo* info = model::find_parameter(key);
        CHECK_TEXT(info->get(believed.robot->parameters) == info->get(truth.robot->parameters), key);
    }
}

// Expected numbers: the formulas of dynamics.hpp worked out by hand in another program.
TEST(RobotFile, MassesGiveTheDynamics) {
    const RobotFileResult result = task::read_robot_file(kRobots + "simulated.toml");
    CHECK(result.robot.has_value() && result.robot->mass.has_value());
    const model::Dynamics<double>& k = result.robot->parameters.dynamics;
    DOUBLES_EQUAL(0.04324105657651159, k.k5_m, 1e-12);
    DOUBLES_EQUAL(-1.4655451122698644, k.k6_per_m, 1e-11);
    DOUBLES_EQUAL(1.2847809474455287, k.k7_per_kg_m, 1e-12);
    DOUBLES_EQUAL(6.980162033180087, k.k8_per_kg_m2, 1e-11);
}

TEST(RobotFile, EmptyFileGivesTheDefaultsAndSaysWhatIsAssumed) {
    const RobotFileResult result = parse_robot_file("", "r.toml");
    CHECK(result.robot.has_value());
    const model::RobotParameters standard = model::default_parameters();
    for (const model::ParameterInfo& info : model::parameter_table()) {
        DOUBLES_EQUAL(info.get(standard), info.get(result.robot->parameters), 0);
    }
    LONGS_EQUAL(7, result.notes.size());
    CHECK(has(result.notes.front().message, "not given"));
    LONGS_EQUAL(0, result.robot->given.size());
}

TEST(RobotFile, TablesInlineTablesAndDottedKeysMeanTheSame) {
    const std::vector<std::string> spellings{
        "[geometry]\ntrack_m = 0.317\n[geometry.wheel_radius_m]\nleft = 0.0731\nright = 0.0729\n",
        "[geometry]\nwheel_radius_m = { left = 0.0731, right = 0.0729 }\ntrack_m = 0.317\n",
        "geometry.wheel_radius_m.left = 731e-4\ngeometry.wheel_radius_m.right = 0.0729\ngeometry.track_m = "
        "0.317",
        "geometry = { wheel_radius_m = { left = 0.0731, right = 0.0729 }, track_m = 0.317 }\n",
    };
    for (const std::string& spelling : spellings) {
        const model::RobotParameters p = read_good(spelling);
        DOUBLES_EQUAL(0.0731, p.geometry.wheel_radius_m.left, 0);
        DOUBLES_EQUAL(0.0729, p.geometry.wheel_radius_m.right, 0);
        DOUBLES_EQUAL(0.317, p.geometry.track_m, 0);
    }
}

// Each key of the table by itself: a value inside its range arrives, one just outside is refused by name.
TEST(RobotFile, EveryParameterIsReadAndItsRangeIsKept) {
    unsigned read = 0;
    for (const model::ParameterInfo& info : model::parameter_table()) {
        const std::string key(info.key);
        const bool real = info.kind == model::ParameterKind::real;
        double inside = info.minimum + 0.37 * (info.maximum - info.minimum);
        if (!real) inside = std::floor(inside);
        const RobotFileResult good = parse_robot_file(key + " = " + toml_value(info, inside), "r.toml");
        if (good.robot.has_value()) {
            DOUBLES_EQUAL(inside, info.get(good.robot->parameters), 0);
            CHECK(good.robot->is_given(key));
            ++read;
        }
        if (info.kind == model::ParameterKind::boolean || info.kind == model::ParameterKind::choice) continue;
        for (const double outside : {real ? std::nextafter(info.minimum, -HUGE_VAL) : info.minimum - 1,
                                     real ? std::nextafter(info.maximum, HUGE_VAL) : info.maximum + 1}) {
            const RobotFileResult bad = parse_robot_file(key + " = " + toml_value(info, outside), "r.toml");
            CHECK_TEXT(!bad.problems.empty(), key.c_str());
            STRCMP_EQUAL(key.c_str(), bad.problems.front().key.c_str());
            LONGS_EQUAL(1, bad.problems.front().line);
            CHECK(has(bad.problems.front().message, "expected"));
        }
    }
    std::printf("%u of %zu keys read alone\n", read, model::parameter_table().size());
    CHECK(read + 16 > model::parameter_table().size());  // the others clash with a default, as they should
}

TEST(RobotFile, EverySimulationNumberIsRead) {
    for (const task::SimulationInfo& info : task::simulation_table()) {
        double inside = info.minimum + 0.37 * (info.maximum - info.minimum);
        if (info.whole) inside = std::floor(inside);
        const std::string value =
            info.whole ? std::to_string(static_cast<long>(inside)) : task::shortest_number(inside);
        const RobotFileResult good = parse_robot_file(std::string(info.key) + " = " + value, "r.toml");
        CHECK_TEXT(good.robot.has_value(), std::string(info.key).c_str());
        DOUBLES_EQUAL(inside, info.get(good.robot->simulation), 0);
    }
}

// The simulated world has defaults for those who use it without a file; they must not drift apart.
TEST(RobotFile, SimulationDefaultsAreTheWorlds) {
    const task::SimulationParameters file = task::default_simulation();
    const sim::WorldOptions world;
    DOUBLES_EQUAL(world.encoder_counts_per_turn, file.encoder_counts_per_turn, 0);
    DOUBLES_EQUAL(world.encoder_noise_rad, file.encoder_noise_rad, 0);
    DOUBLES_EQUAL(world.filter_bandwidth_rad_per_s, file.velocity_filter_rad_per_s, 0);
    DOUBLES_EQUAL(world.torque_lag_s, file.torque_lag_s, 0);
    DOUBLES_EQUAL(world.torque_noise_Nm, file.torque_noise_Nm, 0);
    DOUBLES_EQUAL(world.torque_ripple_Nm, file.torque_ripple_Nm, 0);
    DOUBLES_EQUAL(world.current_limit_A, file.current_limit_A, 0);
    DOUBLES_EQUAL(world.command_latency_s, file.command_latency_s, 0);
    DOUBLES_EQUAL(world.external_pose_rate_Hz, file.external_pose_rate_Hz, 0);
    DOUBLES_EQUAL(world.external_pose_noise_m, file.external_pose_noise_m, 0);
    DOUBLES_EQUAL(world.external_heading_noise_rad, file.external_heading_noise_rad, 0);
    DOUBLES_EQUAL(world.external_pose_delay_s, file.external_pose_delay_s, 0);
}

TEST(RobotFile, UnknownKeysAreRefusedWithWhatWasMeant) {
    expect_problem("[geometry]\ntrack_mm = 320\n", 2, 1, "geometry.track_mm",
                   {"unknown key", "geometry.track_m?", "320 mm is 0.32 m"});
    expect_problem("[geometry]\nwheel_radius_mm = 75\n", 2, 1, "geometry.wheel_radius_mm",
                   {"geometry.wheel_radius_m?", "left, right", "75 mm is 0.075 m"});
    expect_problem("[geometry]\ntrakc_m = 0.3\n", 2, 1, "geometry.trakc_m", {"geometry.track_m?"});
    expect_problem("[geometry]\ntrack = 0.3\n", 2, 1, "geometry.track", {"geometry.track_m?"});
    expect_problem("[limits]\n  yaw_rate_deg_per_s = 90\n", 2, 3, "limits.yaw_rate_deg_per_s",
                   {"limits.yaw_rate_rad_per_s?", "90 deg/s is 1.57079632679 rad/s"});
    expect_problem("[limits]\ntrack_m = 0.3\n", 2, 1, "limits.track_m", {"track_m belongs in [geometry]"});
    expect_problem("[limits]\ntorque_nm = 4\n", 2, 1, "limits.torque_nm", {"limits.torque_Nm?"});
    expect_problem("\n\n[geometri]\ntrack_m = 0.3\n", 3, 2, "geometri", {"unknown table", "geometry?"});
    expect_problem("[drive.middle]\nnode = 1\n", 1, 8, "drive.middle", {"unknown table", "[drive] may have"});
    expect_problem("xyzzy = 1\n", 1, 1, "xyzzy", {"unknown key", "the tables are geometry, limits"});
    expect_problem("[effects.couloumb_friction]\n", 1, 10, "effects.couloumb_friction",
                   {"effects.coulomb_friction?"});
    expect_problem("[effects.magic]\n", 1, 10, "effects.magic",
                   {"the effects are viscous_friction, coulomb_friction"});
    expect_problem("\"geometry.track_m\" = 0.3\n", 1, 1, "geometry.track_m", {"without quotes"});
}

TEST(RobotFile, WrongTypesAreRefused) {
    expect_problem("[geometry]\ntrack_m = \"0.32\"\n", 2, 11, "geometry.track_m",
                   {"found the text \"0.32\"", "a number from 0.02 to 5 m", "without quotes"});
    expect_problem("[geometry]\ntrack_m = true\n", 2, 11, "geometry.track_m", {"found true"});
    expect_problem("[geometry]\ntrack_m = [0.3]\n", 2, 11, "geometry.track_m", {"found an array"});
    expect_problem("geometry = 3\n", 1, 12, "geometry", {"found 3", "a table with wheel_radius_m, track_m"});
    expect_problem("[geometry]\nwheel_radius_m = 0.075\n", 2, 18, "geometry.wheel_radius_m",
                   {"a table with left, right"});
    expect_problem("[geometry.track_m]\n", 1, 1, "geometry.track_m", {"found a table"});
    expect_problem("[drive]\ngeneration = 0.5\n", 2, 14, "drive.generation",
                   {"a whole number from 5 to 6", "5 for 0.5.x"});
    expect_problem("[drive]\nwatchdog_assured = 1\n", 2, 20, "drive.watchdog_assured", {"true or false"});
    expect_problem("[safety]\nover_speed_reaction = \"brake\"\n", 2, 23, "safety.over_speed_reaction",
                   {"\"coast\" or \"ramp\""});
    expect_problem("[robot]\nname = 3\n", 2, 8, "robot.name", {"text in quotes"});
    expect_problem("[effects]\ncoulomb_friction = 0.3\n", 2, 20, "effects.coulomb_friction", {"a table"});
}

TEST(RobotFile, WhatIsNotFiniteOrOutOfRangeIsRefused) {
    expect_problem("[geometry]\ntrack_m = nan\n", 2, 11, "geometry.track_m", {"found nan"});
    expect_problem("[geometry]\ntrack_m = -inf\n", 2, 11, "geometry.track_m", {"found -inf"});
    expect_problem("[geometry]\ntrack_m = 320\n", 2, 11, "geometry.track_m",
                   {"found 320 m", "from 0.02 to 5 m", "320 mm would be 0.32"});
    expect_problem("[effects.coulomb_friction]\nleft_Nm = -0.1\n", 2, 11, "effects.coulomb_friction.left_Nm",
                   {"from 0 to 100 Nm"});
    expect_problem("[effects.coulomb_friction]\nleft_Nm_standard_error = -1\n", 2, 26,
                   "effects.coulomb_friction.left_Nm_standard_error", {"from 0"});
}

TEST(RobotFile, SyntaxErrorsAndDuplicatesHaveTheirLine) {
    const RobotFileResult twice = parse_robot_file("[geometry]\ntrack_m = 0.3\ntrack_m = 0.4\n", "r.toml");
    LONGS_EQUAL(1, twice.problems.size());
    LONGS_EQUAL(3, twice.problems.front().line);
    CHECK(has(task::to_text(twice.problems.front()), "r.toml:3:"));
    CHECK(has(twice.problems.front().message, "track_m"));
    const RobotFileResult open = parse_robot_file("[geometry]\ntrack_m =\n", "r.toml");
    LONGS_EQUAL(1, open.problems.size());
    LONGS_EQUAL(2, open.problems.front().line);
}

TEST(RobotFile, EveryProblemIsReportedInTheFilesOrder) {
    const RobotFileResult result = parse_robot_file(
        "[limits]\ntorque_Nm = -1\nspeed = 1\n[geometry]\ntrack_m = \"x\"\n[bus]\nload_limit = 2\n",
        "r.toml");
    LONGS_EQUAL(4, result.problems.size());
    const std::vector<unsigned> lines{2, 3, 5, 7};
    for (std::size_t i = 0; i < 4; ++i) LONGS_EQUAL(lines[i], result.problems[i].line);
}

TEST(RobotFile, ContradictionsAreRefused) {
    expect_problem("[drive]\nleft.node = 7\nright.node = 7\n", 3, 14, "drive.right.node", {"two different"});
    expect_problem("[drive.left]\nnode = 2\n", 2, 8, "drive.left.node", {"for both drives"});
    expect_problem("[drive.left]\nsign = 0\n", 2, 8, "drive.left.sign", {"1 or -1"});
    expect_problem("[drive.left]\nnode = 48\n", 2, 8, "drive.left.node", {"from 0 to 47", "0x600"});
    CHECK(parse_robot_file("[drive.left]\nnode = 47\n", "r.toml").robot.has_value());
    expect_problem("[pose_control]\nstop_radius_m = 0.02\nrearm_radius_m = 0.01\n", 3, 18,
                   "pose_control.rearm_radius_m", {"more than the 0.02 m of pose_control.stop_radius_m"});
    expect_problem("[limits]\nspeed_m_per_s = 4.0\n", 2, 17, "safety.over_speed_m_per_s",
                   {"3.2 m/s (the default)", "limits.speed_m_per_s"});
    expect_problem("[safety]\nover_yaw_rate_rad_per_s = 6\n", 2, 27, "safety.over_yaw_rate_rad_per_s",
                   {"limits.yaw_rate_rad_per_s"});
    expect_problem("[drive]\nheartbeat_period_ms = 500\n", 2, 23, "drive.heartbeat_timeout_s",
                   {"drive.heartbeat_period_ms"});
    expect_problem("[lines]\nemergency_stop = 3\n", 2, 18, "lines.chip", {"missing", "/dev/gpiochip0"});
    expect_problem("[lines]\nchip = \"c\"\nemergency_stop = 3\ndrive_enable = 3\n", 4, 16,
                   "lines.drive_enable", {"emergency stop's line"});
    expect_problem("[dynamics]\nk6_per_m = -1\n", 2, 12, "dynamics.k5_m", {"missing beside k6_per_m"});
}

TEST(RobotFile, MassAndDynamicsExcludeEachOtherAndMassIsWhole) {
    const std::string mass =
        "[mass]\nmass_kg = 9.0\nyaw_inertia_kg_m2 = 0.3\ncog_ahead_m = 0.04\nwheel_inertia_kg_m2 = 0.001\n";
    CHECK(parse_robot_file(mass, "r.toml").robot.has_value());
    expect_problem(mass + "[dynamics]\nk7_per_kg_m = 1.4\n", 7, 15, "dynamics.k7_per_kg_m",
                   {"found beside [mass]"});
    // What was measured counts, and K5 is still the masses'.
    const std::string measured =
        "[dynamics]\nk7_per_kg_m = 1.4\nk8_per_kg_m2 = 6.5\n"
        "[dynamics_standard_error]\nk7_per_kg_m = 0.01\nk8_per_kg_m2 = 0.1\n";
    const RobotFileResult both = parse_robot_file(mass + measured, "r.toml");
    CHECK(both.robot.has_value());
    DOUBLES_EQUAL(1.4, both.robot->parameters.dynamics.k7_per_kg_m, 0);
    DOUBLES_EQUAL(parse_robot_file(mass, "r.toml").robot->parameters.dynamics.k5_m,
                  both.robot->parameters.dynamics.k5_m, 0);
    const RobotFileResult part = parse_robot_file("[mass]\nmass_kg = 9.0\n", "r.toml");
    LONGS_EQUAL(3, part.problems.size());
    CHECK(has(part.problems.front().message, "all of its four"));
}

TEST(RobotFile, MissingK6FollowsFromTheOthers) {
    const model::RobotParameters p = read_good(
        "geometry.track_m = 0.41\n[dynamics]\nk5_m = -0.021\nk7_per_kg_m = 0.9\nk8_per_kg_m2 = 3.3\n");
    DOUBLES_EQUAL(0.021 * 2 * 3.3 / (0.41 * 0.9), p.dynamics.k6_per_m, 1e-12);
    const model::RobotParameters given = read_good("[dynamics]\nk5_m = 0.02\nk6_per_m = -0.7\n");
    DOUBLES_EQUAL(-0.7, given.dynamics.k6_per_m, 0);
}

TEST(RobotFile, EffectsCarryParametersErrorsAndProvenance) {
    const RobotFileResult result = parse_robot_file(
        "[effects.coulomb_friction]\nleft_Nm = 0.31\nleft_Nm_standard_error = 0.02\nright_Nm = 0.29\n"
        "log = \"a.log\"\ndate = 2024-02-29\n[effects.viscous_friction]\nactive = false\n"
        "right_Nm_s_per_rad = 0.02\n",
        "r.toml");
    CHECK(result.robot.has_value());
    const std::size_t coulomb = model::find_effect("coulomb_friction");
    const std::size_t viscous = model::find_effect("viscous_friction");
    const model::RobotParameters& p = result.robot->parameters;
    CHECK(p.effects.active[coulomb]);
    CHECK_FALSE(p.effects.active[viscous]);
    DOUBLES_EQUAL(0.31, p.effects.parameter[coulomb][0], 0);
    DOUBLES_EQUAL(0.29, p.effects.parameter[coulomb][1], 0);
    DOUBLES_EQUAL(0.02, p.effects_standard_error.parameter[coulomb][0], 0);
    DOUBLES_EQUAL(0.02, p.effects.parameter[viscous][1], 0);
    STRCMP_EQUAL("a.log", result.robot->effect_provenance[coulomb].log.c_str());
    STRCMP_EQUAL("2024-02-29", result.robot->effect_provenance[coulomb].date.c_str());
}

TEST(RobotFile, FileThatCannotBeReadSaysSo) {
    const RobotFileResult result = task::read_robot_file("/nowhere/robot.toml");
    LONGS_EQUAL(1, result.problems.size());
    STRCMP_EQUAL("/nowhere/robot.toml: cannot open: No such file or directory",
                 task::to_text(result.problems.front()).c_str());
    CHECK(has(task::to_text(task::read_robot_file("/").problems.front()), "is a directory"));
}

TEST(RobotFile, EditDistanceCountsSingleMistakes) {
    LONGS_EQUAL(0, task::edit_distance("track", "track"));
    LONGS_EQUAL(1, task::edit_distance("track", "trakc"));  // swap
    LONGS_EQUAL(1, task::edit_distance("track", "trak"));
    LONGS_EQUAL(1, task::edit_distance("track", "tracks"));
    LONGS_EQUAL(3, task::edit_distance("kitten", "sitting"));
    LONGS_EQUAL(5, task::edit_distance("", "abcde"));
}
