#include "firmware/task/robot_file_checks.hpp"

#include <algorithm>
#include <cmath>

#include "firmware/model/effects.hpp"
#include "firmware/task/robot_file_keys.hpp"
#include "firmware/task/robot_file_text.hpp"

namespace wheelwright::task {
namespace {

using model::ParameterInfo;

// Identifiers from here on are the firmware's own; a drive uses 32 from node * 32.
constexpr int kFirstOwnId = 0x600;

constexpr std::array<std::string_view, 4> kDynamicsKeys{"dynamics.k5_m", "dynamics.k6_per_m",
                                                        "dynamics.k7_per_kg_m", "dynamics.k8_per_kg_m2"};

// K5..K8 that follow from masses must lie in the ranges of those that are given.
void check_derived(const RobotFile& robot, Diagnostics& diagnostics) {
    for (const std::string_view key : kDynamicsKeys) {
        const ParameterInfo* info = model::find_parameter(key);
        const double value = info->get(robot.parameters);
        if (value < info->minimum || value > info->maximum) {
            diagnostics.problem(std::string(key), "follows from [mass] as " +
                                                      quantity_text(value, info->unit) + ", expected " +
                                                      range_text(range_of(*info)));
        }
    }
}

// A robot that was described by its masses, then identified: what was measured counts before what was
// weighed.
bool measured_beside_masses(const Diagnostics& diagnostics) {
    constexpr std::array<const char*, 4> kMeasured{"dynamics.k7_per_kg_m", "dynamics.k8_per_kg_m2",
                                                   "dynamics_standard_error.k7_per_kg_m",
                                                   "dynamics_standard_error.k8_per_kg_m2"};
    return std::all_of(kMeasured.begin(), kMeasured.end(),
                       [&](const char* key) { return diagnostics.is_given(key); });
}

void dynamics_from_masses(RobotFile& robot, Diagnostics& diagnostics) {
    for (const MassInfo& info : mass_table()) {
        if (!diagnostics.is_given(info.key)) {
            diagnostics.problem(std::string(info.key), "missing; [mass] needs all of its four numbers");
        }
    }
    const bool measured = measured_beside_masses(diagnostics);
    for (const std::string_view key : kDynamicsKeys) {
        if (!measured && diagnostics.is_given(key)) {
            diagnostics.problem(std::string(key),
                                "found beside [mass], from which K5..K8 follow; expected one of the "
                                "two, or standard errors that say it has been measured");
        }
    }
    if (diagnostics.has_problems()) return;
    model::Dynamics<double>& k = robot.parameters.dynamics;
    const model::Dynamics<double> guess = model::dynamics_from_mass(*robot.mass, robot.parameters.geometry);
    if (!measured) {
        k = guess;
        check_derived(robot, diagnostics);
        return;
    }
    if (!diagnostics.is_given("dynamics.k5_m")) k.k5_m = guess.k5_m;
    if (!diagnostics.is_given("dynamics.k6_per_m"))
        k.k6_per_m =
            model::coupled_k6(k.k5_m, k.k7_per_kg_m, k.k8_per_kg_m2, robot.parameters.geometry.track_m);
}

// A number and the key it belongs to.
struct Quantity {
    const char* key;
    double value;
};

// A problem unless `quantity` is larger than `bound`.
void above(Diagnostics& diagnostics, const Quantity& quantity, const Quantity& bound, std::string_view unit) {
    if (quantity.value > bound.value) return;
    const auto origin = [&](const char* key) { return diagnostics.is_given(key) ? "" : " (the default)"; };
    const char* at = diagnostics.is_given(quantity.key) ? quantity.key : bound.key;
    diagnostics.problem_at(diagnostics.position(at), quantity.key,
                           "found " + quantity_text(quantity.value, unit) + origin(quantity.key) +
                               ", expected more than the " + quantity_text(bound.value, unit) + " of " +
                               bound.key + origin(bound.key));
}

// A note when `quantity` is larger than `bound`.
void not_above(Diagnostics& diagnostics, const Quantity& quantity, const Quantity& bound,
               std::string_view unit) {
    if (quantity.value <= bound.value) return;
    diagnostics.note(quantity.key, quantity_text(quantity.value, unit) + ", more than the " +
                                       quantity_text(bound.value, unit) + " of " + bound.key +
                                       ", which will be the limit");
}

void check_drives(const model::RobotParameters& p, Diagnostics& diagnostics) {
    struct Side {
        const model::DriveParameters& drive;
        std::string name;
    };
    for (const Side& side : {Side{p.drive.left, "drive.left"}, Side{p.drive.right, "drive.right"}}) {
        if (side.drive.sign == 0) diagnostics.problem(side.name + ".sign", "found 0, expected 1 or -1");
        if (side.drive.node * 32 + 31 >= kFirstOwnId) {
            diagnostics.problem(
                side.name + ".node",
                "found " + std::to_string(side.drive.node) + ", expected a whole number from 0 to " +
                    std::to_string(kFirstOwnId / 32 - 1) +
                    "; nodes above use the identifiers from 0x600 on, which are the firmware's own");
        }
    }
    if (p.drive.left.node == p.drive.right.node) {
        diagnostics.problem(
            diagnostics.is_given("drive.right.node") ? "drive.right.node" : "drive.left.node",
            "found " + std::to_string(p.drive.left.node) + " for both drives, expected two different nodes");
    }
    above(diagnostics, {"drive.heartbeat_timeout_s", p.drive.heartbeat_timeout_s},
          {"drive.heartbeat_period_ms", p.drive.heartbeat_period_ms * 1e-3}, "s");
    above(diagnostics, {"safety.stale_feedback_s", p.safety.stale_feedback_s},
          {"drive.encoder_period_ms", p.drive.encoder_period_ms * 1e-3}, "s");
}

void check_limits(const model::RobotParameters& p, Diagnostics& diagnostics) {
    for (const model::OrderRule& rule : model::kOrderRules) {
        const ParameterInfo* larger = model::find_parameter(rule.larger);
        const ParameterInfo* smaller = model::find_parameter(rule.smaller);
        const double least = smaller->get(p);
        if (larger->get(p) == 0 || least == 0) continue;  // automatic
        above(diagnostics, {rule.larger.data(), larger->get(p)}, {rule.smaller.data(), least}, larger->unit);
    }
}

void check_lines(const RobotFile& robot, Diagnostics& diagnostics) {
    const auto& lines = robot.parameters.lines;
    if (lines.emergency_stop >= 0 && lines.emergency_stop == lines.drive_enable) {
        diagnostics.problem("lines.drive_enable",
                            "found " + std::to_string(lines.drive_enable) +
                                ", which is the emergency stop's line, expected another one");
    }
    if (!robot.lines_chip.empty()) return;
    for (const char* key : {"lines.emergency_stop", "lines.drive_enable"}) {
        if (model::find_parameter(key)->get(robot.parameters) >= 0) {
            diagnostics.problem_at(
                diagnostics.position(key), "lines.chip",
                std::string("missing beside ") + key + ", expected text such as \"/dev/gpiochip0\"");
            break;
        }
    }
}

void note_missing(const RobotFile& robot, Diagnostics& diagnostics) {
    for (const char* key :
         {"geometry.wheel_radius_m.left", "geometry.wheel_radius_m.right", "geometry.track_m"}) {
        if (!diagnostics.is_given(key)) {
            const ParameterInfo* info = model::find_parameter(key);
            diagnostics.note(key, "not given; " + quantity_text(info->standard, info->unit) +
                                      " is assumed, which is hardly your robot's");
        }
    }
    if (robot.mass.has_value() && measured_beside_masses(diagnostics)) {
        diagnostics.note("mass", "not used for what [dynamics] gives, as that has been measured");
    }
    if (!robot.mass.has_value() &&
        (!diagnostics.is_given("dynamics.k7_per_kg_m") || !diagnostics.is_given("dynamics.k8_per_kg_m2"))) {
        diagnostics.note(
            "dynamics",
            "K7 and K8 are not given: velocity, pose, trajectory and adaptive are refused (not_identified) "
            "until the robot has been identified: wheelwright ctl mode ident");
    }
}

void note_watchdogs(const model::RobotParameters& p, Diagnostics& diagnostics) {
    if (!p.drive.watchdog_assured && (p.drive.generation == 5 || p.drive.watchdog_endpoint == 0)) {
        diagnostics.note("drive.watchdog_assured",
                         std::string("false, and ") +
                             (p.drive.generation == 5 ? "drives of generation 0.5 cannot be asked"
                                                      : "drive.watchdog_endpoint is not given") +
                             ": arming will be refused until it is known that the drives' watchdogs are on");
    }
    if (p.drive.generation == 5 && diagnostics.is_given("drive.watchdog_endpoint")) {
        diagnostics.note("drive.watchdog_endpoint",
                         "drives of generation 0.5 have no endpoints; it is not used");
    }
}

// What the drives do not report cannot be watched. A zero that the file states has been thought of.
void note_unwatched(const model::RobotParameters& p, Diagnostics& diagnostics) {
    if (p.drive.supply_period_ms == 0 && !diagnostics.is_given("drive.supply_period_ms")) {
        diagnostics.note("drive.supply_period_ms",
                         "not given: the drives' supply is not watched, unless they report it all the same");
    }
    if (p.drive.temperature_period_ms == 0 && p.drive.generation != 5 &&
        !diagnostics.is_given("drive.temperature_period_ms")) {
        diagnostics.note(
            "drive.temperature_period_ms",
            "not given: the drives' temperatures are not watched, unless they report them all the same");
    }
    if (p.drive.temperature_period_ms != 0 && p.drive.generation == 5) {
        diagnostics.note("drive.temperature_period_ms",
                         "drives of generation 0.5 report no temperature; it is not used");
    }
}

void note_limited(const model::RobotParameters& p, Diagnostics& diagnostics) {
    const Quantity speed{"limits.speed_m_per_s", p.limits.speed_m_per_s};
    const Quantity yaw_rate{"limits.yaw_rate_rad_per_s", p.limits.yaw_rate_rad_per_s};
    not_above(diagnostics, {"ident.amplitude_Nm", p.ident.amplitude_Nm},
              {"limits.torque_Nm", p.limits.torque_Nm}, "Nm");
    not_above(diagnostics, {"pose_control.speed_m_per_s", p.pose_control.speed_m_per_s}, speed, "m/s");
    not_above(diagnostics, {"pose_control.yaw_rate_rad_per_s", p.pose_control.yaw_rate_rad_per_s}, yaw_rate,
              "rad/s");
}

void note_effects_not_estimated(const model::RobotParameters& p, Diagnostics& diagnostics) {
    const std::array<bool, model::kEffectCount>& active = p.effects.active;
    const std::array<bool, model::kEffectCount> estimated = model::estimated_effects(active);
    std::string carried;
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (!estimated[i]) continue;
        if (!carried.empty()) carried += ", ";
        carried += model::kEffects[i].name;
    }
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (!active[i] || estimated[i]) continue;
        const std::string name(model::kEffects[i].name);
        diagnostics.note(std::string(kEffectsTable) + "." + name,
                         model::kLinearInParameters[i]
                             ? "stays as it is written here: the estimators have room for " +
                                   std::to_string(model::kMaxEstimatedColumns) + " parameters, which " +
                                   carried + " take"
                             : "stays as it is written here: it is not linear in its parameters");
    }
}

}  // namespace

void complete_dynamics(RobotFile& robot, Diagnostics& diagnostics) {
    if (robot.mass.has_value()) {
        dynamics_from_masses(robot, diagnostics);
        return;
    }
    auto& dynamics = robot.parameters.dynamics;
    if (!diagnostics.is_given("dynamics.k6_per_m")) {
        if (dynamics.k5_m == 0) return;  // K6's default is 0 too
        dynamics.k6_per_m = model::coupled_k6(dynamics.k5_m, dynamics.k7_per_kg_m, dynamics.k8_per_kg_m2,
                                              robot.parameters.geometry.track_m);
    } else if (!diagnostics.is_given("dynamics.k5_m")) {
        diagnostics.problem_at(diagnostics.position("dynamics.k6_per_m"), "dynamics.k5_m",
                               "missing beside k6_per_m; give both, or k5_m alone (K6 then follows from it)");
    }
}

void find_contradictions(const RobotFile& robot, Diagnostics& diagnostics) {
    check_drives(robot.parameters, diagnostics);
    check_limits(robot.parameters, diagnostics);
    check_lines(robot, diagnostics);
}

void take_notes(const RobotFile& robot, Diagnostics& diagnostics) {
    note_missing(robot, diagnostics);
    note_watchdogs(robot.parameters, diagnostics);
    note_unwatched(robot.parameters, diagnostics);
    note_limited(robot.parameters, diagnostics);
    note_effects_not_estimated(robot.parameters, diagnostics);
}

}  // namespace wheelwright::task
