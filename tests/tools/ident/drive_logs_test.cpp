// A robot that identified itself over CAN left a log; what the log says must be what the firmware found, and
// what the simulated robot really is. Spoilt logs are refused by line, or cost no more than what is spoilt.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "tests/tools/ident/temporary_file.hpp"
#include "tools/ident/drive_log.hpp"
#include "tools/ident/findings.hpp"
#include "tools/sim/experiments.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using tools::Findings;

namespace {

const std::string kRobots = WHEELWRIGHT_ROBOTS;

model::RobotParameters robot(const char* name) { return tools::load_robot(kRobots + name).parameters; }

tools::IdentSetup believed() {
    tools::IdentSetup s;
    s.robot = robot("/default.toml");
    s.effects = s.robot.effects.active;
    s.relative_standard_error = s.robot.ident.relative_standard_error;
    return s;
}

// One identification, made once for the whole group: frames as lines, and what the firmware found meanwhile.
struct Recording {
    tools::IdentificationResult online;
    model::Dynamics<double> truth;
    model::RobotParameters plant;
    double loop_rad_per_s = 0;  // of the drives' encoders
};

Recording record(const std::string& path) {
    Recording r;
    const task::RobotFile truth = tools::load_robot(kRobots + "/simulated.toml");
    r.plant = truth.parameters;
    r.loop_rad_per_s = truth.simulation.velocity_filter_rad_per_s;
    tools::SimulationOptions options;
    options.seed = 7;
    options.log_path = path;
    options.world = tools::world_options(truth.simulation, options.seed);
    tools::Simulation sim(robot("/default.toml"), truth.parameters, options);
    sim.run_for(0.3);  // the drives are heard
    r.online = tools::identify(sim);
    r.truth =
        tools::as_seen_with(truth.parameters.dynamics, truth.parameters.geometry, believed().robot.geometry);
    return r;
}

std::string read_text(const std::string& path) {
    std::ostringstream text;
    text << std::ifstream(path).rdbuf();
    return text.str();
}

// Views, not strings: CppUTest searches through all living allocations at each release.
using Lines = std::vector<std::string_view>;

Lines lines_of(std::string_view text) {
    Lines lines;
    for (std::size_t end = text.find('\n'); end != std::string_view::npos; end = text.find('\n')) {
        lines.push_back(text.substr(0, end));
        text.remove_prefix(end + 1);
    }
    return lines;
}

std::string join(const Lines& lines) {
    std::string text;
    for (const std::string_view line : lines) text.append(line).append("\n");
    return text;
}

double seconds(std::string_view line) { return std::strtod(line.data() + 1, nullptr); }

Findings identify(const std::string& path) { return tools::identify_logs({path}, believed()); }

void expect_problem(const std::string& text, const std::string& part) {
    const TemporaryFile file(text);
    const Findings f = identify(file.path);
    CHECK(!f.problems.empty());
    std::printf("  %s\n", f.problems.front().c_str());
    CHECK_TEXT(f.problems.front().find(part) != std::string::npos, f.problems.front().c_str());
}

}  // namespace

TEST_GROUP(DriveLogs){};

TEST(DriveLogs, TheLogTellsWhatTheFirmwareFoundAndWhatTheRobotIs) {
    const TemporaryFile log;
    const Recording r = record(log.path);
    CHECK(r.online.succeeded);
    const Findings f = identify(log.path);
    CHECK(f.problems.empty());
    const auto each = [](const model::Dynamics<double>& k) {
        return std::array{k.k5_m, k.k6_per_m, k.k7_per_kg_m, k.k8_per_kg_m2};
    };
    const auto truth = each(r.truth);
    const auto online = each(r.online.estimate.dynamics);
    const auto online_error = each(r.online.estimate.standard_error);
    for (std::size_t i = 0; i < 4; ++i) {
        const tools::DynamicsFigure& k = f.k[i];
        std::printf("  %s truth %.6g, online %.6g +- %.2g, log %.6g +- %.2g (%.2f %% off)\n", k.label.data(),
                    truth[i], online[i], online_error[i], k.value, k.standard_error,
                    100 * (k.value / truth[i] - 1));
        CHECK(k.known);
        CHECK(std::abs(k.value - online[i]) < 2 * std::hypot(k.standard_error, online_error[i]));
        CHECK(std::abs(k.value - truth[i]) < 4 * k.standard_error);
    }
    CHECK(std::abs(f.k7().value / truth[2] - 1) < 0.02);
    CHECK(std::abs(f.k8().value / truth[3] - 1) < 0.02);
    std::printf("  delay %.4f ms +- %.4f, online %.4f ms\n", 1e3 * f.delay_s.value,
                1e3 * f.delay_s.standard_error, 1e3 * r.online.delay_s);
    CHECK(f.delay_s.known);
    DOUBLES_EQUAL(r.online.delay_s, f.delay_s.value, 2e-4);
    LONGS_EQUAL(4, f.effects.size());
    for (const tools::EffectFigure& e : f.effects) {
        const double p = r.plant.effects.parameter[e.effect][e.parameter];
        std::printf("  %s.%s truth %.4g, log %.4g +- %.2g\n", model::kEffects[e.effect].name.data(),
                    model::kEffects[e.effect].parameters[e.parameter].name.data(), p, e.value,
                    e.standard_error);
        CHECK(e.known);
        CHECK(std::abs(e.value - p) < 4 * e.standard_error + 0.03 * p);
    }
    CHECK(f.notes.empty());
    // a drive computes its loop in periods of its own: read as a continuous one it would be 3 % off
    const WheelPair<double> lag_s = tools::read_drive_log(log.path, believed().robot).encoder_lag_s;
    DOUBLES_EQUAL(r.loop_rad_per_s, 1 / lag_s.left, 0.01 * r.loop_rad_per_s);
    DOUBLES_EQUAL(r.loop_rad_per_s, 1 / lag_s.right, 0.01 * r.loop_rad_per_s);

    // What follows spoils the same log.
    const std::string text = read_text(log.path);
    const Lines good = lines_of(text);

    // A drive that has counted far, and is told to count anew: it goes on where it was.
    const double order = seconds(good.front()) + r.online.duration_s / 2;
    std::string counted;
    bool told = false;
    for (const std::string_view line : good) {
        const std::size_t mark = line.find('#');
        if (!told && seconds(line) > order) {
            counted.append(line.substr(0, mark - 3)).append("039#00000000\n");
            told = true;
        }
        if (told || line.substr(mark - 3, 3) != "029") {
            counted.append(line).append("\n");
            continue;
        }
        const auto bits = static_cast<std::uint32_t>(
            std::strtoul(std::string(line.substr(mark + 1, 8)).c_str(), nullptr, 16));
        const float far = std::bit_cast<float>(__builtin_bswap32(bits)) + 1100;
        std::array<char, 9> text_of{};
        std::snprintf(text_of.data(), text_of.size(), "%08X",
                      __builtin_bswap32(std::bit_cast<std::uint32_t>(far)));
        counted.append(line.substr(0, mark + 1)).append(text_of.data()).append(line.substr(mark + 9));
        counted.append("\n");
    }
    const TemporaryFile anew(counted);
    const Findings of_counted = identify(anew.path);
    CHECK(of_counted.problems.empty());
    for (std::size_t i = 0; i < 4; ++i)
        CHECK(std::abs(of_counted.k[i].value - truth[i]) < 4 * of_counted.k[i].standard_error);
    CHECK(of_counted.k7().standard_error < 2 * f.k7().standard_error);
    DOUBLES_EQUAL(r.loop_rad_per_s, 1 / tools::read_drive_log(anew.path, believed().robot).encoder_lag_s.left,
                  0.03 * r.loop_rad_per_s);

    // The same order to a drive that has not counted far is nobody's of this firmware: no angle moves.
    std::string ordered(good.front().substr(0, good.front().find('#') - 3));
    ordered.append("039#00000000\n").append(text);
    const TemporaryFile near(ordered);
    const Findings of_near = identify(near.path);
    for (std::size_t i = 0; i < 4; ++i) DOUBLES_EQUAL(f.k[i].value, of_near.k[i].value, 0);

    // Two seconds torn out: the rest counts, and the place is named.
    Lines gap;
    const double cut = seconds(good.front()) + r.online.duration_s / 2;
    for (const std::string_view line : good) {
        if (seconds(line) < cut || seconds(line) > cut + 0.5) gap.push_back(line);
    }
    const TemporaryFile torn(join(gap));
    const Findings after = identify(torn.path);
    CHECK(after.problems.empty());
    std::printf("  torn: K7 %.6g, K8 %.6g, %zu notes\n", after.k7().value, after.k8().value,
                after.notes.size());
    CHECK(std::abs(after.k7().value - truth[2]) < 4 * after.k7().standard_error);
    CHECK(std::abs(after.k8().value - truth[3]) < 4 * after.k8().standard_error);
    CHECK(!after.notes.empty());

    // One wheel's encoder silent for 100 ms while the other frames go on.
    Lines deaf;
    for (const std::string_view line : good) {
        const bool encoder = line.find(" 029#") != std::string::npos;
        if (!encoder || seconds(line) < cut || seconds(line) > cut + 0.1) deaf.push_back(line);
    }
    const TemporaryFile silent(join(deaf));
    const Findings without = identify(silent.path);
    CHECK(without.problems.empty());
    LONGS_EQUAL(1, without.notes.size());
    std::printf("  %s\n", without.notes.front().c_str());
    CHECK(std::abs(without.k8().value - truth[3]) < 4 * without.k8().standard_error);

    // The torque multiplied by nothing at all from one drive: it reports what it does not deliver.
    Lines backward = good;
    std::swap(backward[1000], backward[1400]);
    expect_problem(join(backward), ":1002: time goes back");

    Lines broken = good;
    broken[2000].remove_suffix(1);
    expect_problem(join(broken), ":2001: data ends in the middle of a byte");

    // Torque commands of a 0 Nm robot.
    std::string still;
    for (const std::string_view line : good) {
        const std::size_t mark = line.find('#');
        const std::string_view id = line.substr(mark - 3, 3);
        const bool torque = id == "02E" || id == "04E";
        still.append(torque ? line.substr(0, mark + 1) : line).append(torque ? "00000000\n" : "\n");
    }
    expect_problem(still, "the commanded torque never changes");

    const auto first_second = std::find_if(good.begin(), good.end(), [&](std::string_view line) {
        return seconds(line) > seconds(good.front()) + 4.5;  // the probe, and then a little
    });
    expect_problem(join({good.begin(), first_second}), "too short");
}

// Wheels that only ever turn forward: dv/dt knows the sum of both dry frictions, domega/dt their difference.
TEST(DriveLogs, AFigureEightTellsTheFrictionOfEachWheel) {
    const TemporaryFile log;
    const task::RobotFile truth = tools::load_robot(kRobots + "/simulated.toml");
    {
        tools::SimulationOptions options;
        options.seed = 4;
        options.log_path = log.path;
        options.world = tools::world_options(truth.simulation, options.seed);
        tools::Simulation sim(robot("/default.toml"), truth.parameters, options);
        sim.run_for(0.3);
        tools::TrackingOptions track;
        track.duration_s = 20;
        track.path = control::standard_figure_eight<double>(sim.parameters());
        CHECK(tools::track(sim, track).entered);
    }
    const Findings f = identify(log.path);
    CHECK(f.problems.empty());
    CHECK(f.good_enough(0.01));
    for (const tools::EffectFigure& e : f.effects) {
        const double p = truth.parameters.effects.parameter[e.effect][e.parameter];
        std::printf("  %s.%s truth %.4g, log %.4g +- %.2g\n", model::kEffects[e.effect].name.data(),
                    model::kEffects[e.effect].parameters[e.parameter].name.data(), p, e.value,
                    e.standard_error);
        CHECK(e.known);
        CHECK(std::abs(e.value - p) < 4 * e.standard_error + 0.03 * p);
    }
}

// A centre of gravity beside the middle, which the file lists, and drives whose encoder loops are slow:
// K5..K8 stand beside the one, and the other is read from the log.
TEST(DriveLogs, AListedOffsetAndSlowEncoderLoopsLeaveTheFiguresTrue) {
    const TemporaryFile log;
    task::RobotFile truth = tools::load_robot(kRobots + "/simulated.toml");
    truth.simulation.velocity_filter_rad_per_s = 200;
    tools::IdentSetup setup = believed();
    for (model::EffectSet<double>* effects : {&truth.parameters.effects, &setup.robot.effects}) {
        effects->active[model::kCogLateral] = true;
        effects->parameter[model::kCogLateral][0] = 0.027;
    }
    setup.effects = setup.robot.effects.active;
    setup.effects[model::kCogLateral] = false;  // not looked for
    setup.robot.geometry = truth.parameters.geometry;
    {
        tools::SimulationOptions options;
        options.seed = 9;
        options.log_path = log.path;
        options.world = tools::world_options(truth.simulation, options.seed);
        tools::Simulation sim(setup.robot, truth.parameters, options);
        sim.run_for(0.3);
        CHECK(tools::identify(sim).succeeded);
    }
    const Findings f = tools::identify_logs({log.path}, setup);
    CHECK(f.problems.empty());
    const auto& k = truth.parameters.dynamics;
    const std::array<double, 4> true_value{k.k5_m, k.k6_per_m, k.k7_per_kg_m, k.k8_per_kg_m2};
    for (std::size_t i = 0; i < 4; ++i) {
        std::printf("  %s truth %.6g, log %.6g +- %.2g\n", f.k[i].label.data(), true_value[i], f.k[i].value,
                    f.k[i].standard_error);
        // the speeds in K5's and K6's products have come through the loops
        const double allowed = i < 2 ? 0.01 * std::abs(true_value[i]) : 4 * f.k[i].standard_error;
        CHECK(std::abs(f.k[i].value - true_value[i]) < allowed);
    }
    CHECK(std::abs(f.k7().value / k.k7_per_kg_m - 1) < 0.001);
    for (const tools::EffectFigure& e : f.effects) {
        const double p = truth.parameters.effects.parameter[e.effect][e.parameter];
        std::printf("  %s.%s truth %.4g, log %.4g +- %.2g\n", model::kEffects[e.effect].name.data(),
                    model::kEffects[e.effect].parameters[e.parameter].name.data(), p, e.value,
                    e.standard_error);
        CHECK(std::abs(e.value - p) < 4 * e.standard_error + 0.03 * p);
    }
}

TEST(DriveLogs, ALogOfAnotherRobotIsRefused) {
    expect_problem("(1.000000) can0 701#0102030405060708\n(1.100000) can0 702#01\n",
                   "holds no torque command to the drives of the robot file");
    expect_problem("(1.000000) can0 02E#0000803F\n(1.001000) can0 02E#0000803F\n",
                   "no cycle with commands to both");
}
