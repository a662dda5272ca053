// What the controllers gain by knowing an effect: a figure-8 on the independent plant of the blind trials,
// the robot's controllers once without the effect in their file and once with it. And the page about the
// effects.
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <string_view>

#include "firmware/control/loop_design.hpp"
#include "firmware/control/odometry.hpp"
#include "firmware/control/tracking.hpp"
#include "firmware/control/trajectory.hpp"
#include "firmware/control/velocity_loop.hpp"
#include "firmware/model/torque_path.hpp"
#include "tools/gap_trials/hidden/electronics.hpp"
#include "tools/gap_trials/hidden/ode_plant.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

constexpr double kCycle_s = 0.001;
constexpr double kLap_s = 6;
constexpr double kRamp_s = 1;

hidden::Robot robot() {
    hidden::Robot r;
    r.wheel_radius_m = 0.081;
    r.track_m = 0.41;
    r.mass_kg = 11.7;
    r.yaw_inertia_kg_m2 = 0.43;
    r.cog_ahead_m = 0.032;
    r.cog_height_m = 0.11;
    r.wheel_mass_kg = 0.7;
    r.wheel_inertia_kg_m2 = 0.006;
    r.castor_ahead_m = 0.171;
    r.torque_limit_Nm = 2.0;
    return r;
}

// The controllers' file, identified without error and without any effect.
model::RobotParameters file_of(const hidden::Robot& r) {
    model::RobotParameters p = model::default_parameters();
    p.geometry = {{r.wheel_radius_m, r.wheel_radius_m}, r.track_m};
    p.dynamics = model::dynamics_from_mass<double>(
        {r.mass_kg, r.yaw_inertia_kg_m2, r.cog_ahead_m, r.wheel_inertia_kg_m2}, p.geometry);
    p.limits.torque_Nm = r.torque_limit_Nm;
    p.velocity_loop.actuation_delay_s = 0.0005;  // the torque is held over the cycle, and nothing else
    p.trajectory.length_m = 2.2;
    p.trajectory.width_m = 0.45;  // so tight that the inner wheel reverses
    p.trajectory.period_s = kLap_s;
    return p;
}

// RMS distance between axle and reference, from standstill over two laps. The integrators begin empty.
double figure_eight_error_m(const hidden::HiddenSet& hidden, const model::RobotParameters& file) {
    const hidden::Robot body = robot();
    const std::unique_ptr<hidden::Plant> plant = hidden::make_ode_plant(body, hidden);
    hidden::TorquePath electronics(hidden, kRamp_s + 2 * kLap_s);

    control::LoopDesign<double> design;
    CHECK(design.run(control::loop_design_request<double>(file, kCycle_s)) ==
          control::DesignStatus::accepted);
    const control::PlantModel<double> model = control::plant_model<double>(file);
    control::VelocityLoop<double> loop;
    loop.configure({design.result().gains, file.limits.torque_Nm, kCycle_s});
    control::TrajectoryTracker<double> tracker;
    tracker.configure(control::tracking_settings<double>(file));
    control::PathSettings<double> path = control::standard_figure_eight<double>(file);
    path.ramp_s = kRamp_s;

    hidden::PlantState state = plant->state();
    const double start_x_m = state.x_m;
    const double start_y_m = state.y_m;
    Pose<double> pose = control::path_point(path, 0.0).pose;
    const double start_heading_rad = pose.heading_rad;
    hidden::Pair angle = state.wheel_angle_rad;
    double squares = 0;
    const int cycles = static_cast<int>((kRamp_s + 2 * kLap_s) / kCycle_s);
    for (int i = 0; i < cycles; ++i) {
        const double t_s = i * kCycle_s;
        // what encoders tell
        const double left = model.geometry.wheel_radius_m.left * (state.wheel_angle_rad.left - angle.left);
        const double right =
            model.geometry.wheel_radius_m.right * (state.wheel_angle_rad.right - angle.right);
        angle = state.wheel_angle_rad;
        pose = model::advance_along_arc(pose, (right + left) / 2, (right - left) / model.geometry.track_m);
        model::Motion<double> motion;
        motion.wheel_speed_rad_per_s = {state.wheel_speed_rad_per_s.left, state.wheel_speed_rad_per_s.right};
        motion.wheel_angle_rad = {angle.left, angle.right};
        motion.twist = model::twist_from_wheel_speeds(model.geometry, motion.wheel_speed_rad_per_s);
        motion.heading_rad = pose.heading_rad - start_heading_rad;
        const auto reference = control::path_point(path, t_s);
        const auto command = tracker.update(reference, pose, kCycle_s);
        const WheelPair<double> torque = loop.update(model, motion, command.reference);
        // in the reference's frame, where the robot began at its start
        const double dx = state.x_m - start_x_m;
        const double dy = state.y_m - start_y_m;
        const double x_m = std::cos(start_heading_rad) * dx - std::sin(start_heading_rad) * dy;
        const double y_m = std::sin(start_heading_rad) * dx + std::cos(start_heading_rad) * dy;
        squares += std::pow(x_m - reference.pose.x_m, 2) + std::pow(y_m - reference.pose.y_m, 2);
        electronics.command(t_s, {torque.left, torque.right});
        for (const double h_s : {0.0, kCycle_s / 2}) {
            const hidden::Pair shaft = electronics.shaft_torque_Nm(t_s + h_s, kCycle_s / 2, state);
            plant->advance(kCycle_s / 2, shaft);
            state = plant->state();
        }
        if (!(std::abs(state.x_m) < 50 && std::abs(state.y_m) < 50)) return 50;
    }
    return std::sqrt(squares / cycles);
}

struct Case {
    const char* effect;
    model::Parameters<double> parameters;
    double at_most;  // of the error before
};

// Sizes as in the blind trials, medium to strong.
constexpr std::array kCases{
    Case{"viscous_friction", {0.03, 0.03}, 0.6},
    Case{"coulomb_friction", {0.25, 0.25}, 0.6},
    Case{"quadratic_drag", {4.0}, 0.85},
    Case{"turning_scrub", {0.9}, 0.7},
    Case{"torque_bias", {0.2, -0.15}, 0.95},
    Case{"slope", {0.06, 0.7}, 0.6},
    Case{"torque_gain_mismatch", {0.2}, 0.9},
    Case{"stribeck_friction", {0.1, 0.25, 1.5}, 0.8},
    Case{"cog_lateral", {0.04}, 0.75},
    Case{"transport_delay", {0.015}, 0.4},
    Case{"dead_zone", {0.2}, 0.6},
    Case{"wheel_radius_mismatch", {0.03}, 0.1},
    Case{"torque_ripple", {0.2, 8, 0.4}, 0.95},
};

}  // namespace

TEST_GROUP(Compensation){};

TEST(Compensation, each_known_effect_lessens_the_figure_eights_error_on_the_independent_plant) {
    const model::RobotParameters bare = file_of(robot());
    std::printf(
        "\nFigure-8 on the independent plant, RMS distance from the path\n"
        "%-24s %12s %12s %8s\n",
        "effect", "unknown, mm", "known, mm", "left");
    std::printf("%-24s %12.3f\n", "none", 1e3 * figure_eight_error_m({}, bare));
    for (const Case& c : kCases) {
        const std::size_t i = model::find_effect(c.effect);
        CHECK(i < model::kEffectCount);
        hidden::HiddenSet hidden{{{c.effect, {}}}};
        for (std::size_t j = 0; j < model::kEffects[i].parameters.size(); ++j)
            hidden.effects[0].parameters[std::string(model::kEffects[i].parameters[j].name)] =
                c.parameters[j];
        model::RobotParameters informed = bare;
        informed.effects.active[i] = true;
        informed.effects.parameter[i] = c.parameters;
        const double before = figure_eight_error_m(hidden, bare);
        const double after = figure_eight_error_m(hidden, informed);
        std::printf("%-24s %12.3f %12.3f %6.0f %%\n", c.effect, 1e3 * before, 1e3 * after,
                    100 * after / before);
        CHECK_TEXT(after < c.at_most * before, c.effect);
    }
}

// The page docs/effects.md is made from the catalogue; with WHEELWRIGHT_WRITE_PAGE set this writes it.
TEST(Compensation, the_page_about_the_effects_is_up_to_date) {
    std::ostringstream page;
    page << "# The effects\n\nWhat the simulated robot can have and the controllers can know, beside the "
            "rigid body "
            "with K5..K8. Made from\n[the catalogue](../firmware/model/effects.hpp), where each effect's "
            "equation "
            "stands in its file; "
            "[extending.md](extending.md) says how to add one.\nA robot file switches an effect on by its "
            "table, "
            "`[effects.NAME]`.\n\n"
            "`ctest -R compensation -V` prints what each compensation gains: a figure-8 on the independent "
            "plant of "
            "the blind trials,\nthe controllers without and with the effect in their file.\n";
    for (const model::EffectInfo& info : model::kEffects) {
        page << "\n## " << info.name << "\n\n"
             << info.meaning << ". Equation: [" << info.name << ".hpp](../firmware/model/effects/"
             << info.name << ".hpp); " << info.source
             << ".\n\n| parameter | unit | range | meaning |\n| --- | --- | --- | --- |\n";
        for (const model::EffectParameterInfo& p : info.parameters) {
            page << "| `" << p.name << "` | " << p.unit << " | " << p.minimum << " to " << p.maximum << " | "
                 << p.meaning << " |\n";
        }
        if (info.compensation.empty()) {
            page << "\nNot compensated: " << info.uncompensated_because << ".\n";
        } else {
            page << "\nCompensated: " << info.compensation << ".\n";
        }
    }
    const char* path = WHEELWRIGHT_EFFECTS_PAGE;
    if (std::getenv("WHEELWRIGHT_WRITE_PAGE") != nullptr) std::ofstream(path) << page.str();
    std::ostringstream there;
    there << std::ifstream(path).rdbuf();
    CHECK_TEXT(
        there.str() == page.str(),
        "docs/effects.md: WHEELWRIGHT_WRITE_PAGE=1 build/release/tests/test_compensation writes it anew");
}

TEST(Compensation, the_table_above_holds_every_effect_that_the_catalogue_says_is_compensated) {
    std::size_t compensated = 0;
    for (const model::EffectInfo& info : model::kEffects) {
        CHECK_TEXT(info.compensation.empty() != info.uncompensated_because.empty(), info.name.data());
        if (info.compensation.empty()) continue;
        ++compensated;
        bool there = false;
        for (const Case& c : kCases) there = there || info.name == c.effect;
        CHECK_TEXT(there, info.name.data());
    }
    LONGS_EQUAL(compensated, kCases.size());
}
