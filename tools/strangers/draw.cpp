#include "tools/strangers/draw.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>
#include <vector>

#include "sim_hal/random.hpp"
#include "tools/strangers/files.hpp"

namespace wheelwright::tools {
namespace {

constexpr double kTwoPi = 2 * std::numbers::pi;

class Draw {
  public:
    Draw(std::uint64_t seed, std::int64_t number)
        : random_(seed, 1000 + static_cast<std::uint64_t>(number)) {}
    double uniform(double low, double high) { return low + (high - low) * random_.uniform(); }
    double log_uniform(double low, double high) { return low * std::pow(high / low, random_.uniform()); }
    // Between the two; in the middle of the decades more often than at the ends.
    double log_triangular(double low, double high) {
        return low * std::pow(high / low, (random_.uniform() + random_.uniform()) / 2);
    }
    double spread(double factor) { return log_uniform(1 / factor, factor); }
    double normal(double deviation) { return deviation * random_.gaussian(); }
    bool share(double of_all) { return random_.uniform() < of_all; }
    int sign() { return share(0.5) ? 1 : -1; }

  private:
    sim::Random random_;
};

// As people write a number down.
double rounded(double value, int digits) {
    if (value == 0) return 0;
    const double scale = std::pow(10.0, digits - 1 - std::floor(std::log10(std::abs(value))));
    return std::round(value * scale) / scale;
}

// A builder whose robot is slow leaves ident's limits out too, so his safety limits must lie above their
// defaults: `wheelwright check` tells him.
double above_default(double value, std::string_view key) {
    return std::max(value, 1.1 * model::find_parameter(key)->standard);
}

// The template without what stands there for ident, and perhaps without the frictions.
std::string template_for(bool lists_friction) {
    std::string text(files::template_toml);
    const auto without = [&text](const char* from, const char* to) {
        const std::size_t begin = text.find(from);
        if (begin != std::string::npos) text.erase(begin, text.find(to, begin + 1) - begin);
    };
    without("\n[ident]", "\n[");
    if (!lists_friction) without("\n# What the ident mode looks for beside K5..K8", "\n[safety]");
    return text;
}

// The figure-8 is six tracks long, and as quick as 60 % of the speed limits and a quarter of the acceleration
// allow. Its own formulas: the firmware's generator is not asked.
struct FigureEight {
    double length_m, width_m, period_s;
};
FigureEight figure_eight(double track_m, double speed_m_per_s, double yaw_rate_rad_per_s,
                         double acceleration_m_per_s2) {
    FigureEight path{std::max(0.8, rounded(6 * track_m, 2)), 0, 1};
    path.width_m = path.length_m / 2;
    for (int i = 0; i < 400; ++i) {
        const double s = kTwoPi * i / 400;  // with the period T: phase rate w = 2 pi / T
        const double x1 = path.length_m / 2 * std::cos(s);
        const double y1 = path.width_m * std::cos(2 * s);
        const double x2 = -path.length_m / 2 * std::sin(s);
        const double y2 = -2 * path.width_m * std::sin(2 * s);
        const double speed = std::hypot(x1, y1);  // per w
        const double turn = (x1 * y2 - y1 * x2) / (speed * speed);
        const double along = std::abs(x1 * x2 + y1 * y2) / speed;  // per w^2
        path.period_s = std::max({path.period_s, kTwoPi * speed / (0.6 * speed_m_per_s),
                                  kTwoPi * std::abs(turn) / (0.6 * yaw_rate_rad_per_s),
                                  kTwoPi * std::sqrt(along / (0.25 * acceleration_m_per_s2))});
    }
    path.period_s = rounded(path.period_s, 3);
    return path;
}

// The text with this comment in place of its own first one.
std::string headed(const std::string& comment, std::string_view text) {
    return comment + std::string(text.substr(text.find("\n[robot]")));
}

task::RobotFile read(const std::string& text, const std::string& name) {
    task::RobotFileResult result = task::parse_robot_file(text, name);
    if (result.robot) return std::move(*result.robot);
    std::string message;
    for (const task::Diagnostic& problem : result.problems) message += task::to_text(problem) + "\n";
    throw std::runtime_error(message);
}

std::string with_values(std::string_view text, const std::vector<task::FileChange>& changes) {
    task::EditResult result = task::set_values(text, changes);
    if (!result.text) throw std::runtime_error(result.error);
    return std::move(*result.text);
}

}  // namespace

// The order of the draws is part of what a seed means: new ones come last.
DrawnRobot draw_robot(std::uint64_t seed, std::int64_t number, RobotFault fault) {
    Draw draw(seed, number);
    DrawnRobot robot;
    robot.number = number;
    robot.simulation_seed = 1000 * seed + static_cast<std::uint64_t>(number);
    robot.fault = fault;

    // ---- body
    const double mass_kg = draw.log_uniform(1, 200);
    const double size = std::cbrt(mass_kg / 10);  // robots of one kind: mass goes with the cube of lengths
    const double radius_m = std::clamp(0.06 * size * draw.spread(1.5), 0.025, 0.2);
    const double track_m = std::max(0.32 * size * draw.spread(1.4), 2 * radius_m);
    const double length_m = track_m * draw.log_uniform(0.8, 1.8);
    const double width_m = track_m * draw.log_uniform(0.8, 1.2);
    const double yaw_inertia_kg_m2 =
        mass_kg * (length_m * length_m + width_m * width_m) / 12 * draw.spread(1.3);
    robot.rotor_share = draw.log_uniform(0.02, 0.6);
    const double effective_kg = mass_kg / (1 - robot.rotor_share);
    const double wheel_inertia_kg_m2 = (effective_kg - mass_kg) / 2 * radius_m * radius_m;
    const double cog_ahead_m = draw.uniform(-0.4, 0.4) * track_m;

    // ---- limits
    double peak_m_per_s2 = draw.log_triangular(0.5, 8);  // net of friction at low speed
    const double per_wheel_m_per_s = radius_m;           // at 1 rad/s
    double speed_m_per_s =
        std::clamp(draw.log_uniform(0.3, 3), 4 * per_wheel_m_per_s, 30 * per_wheel_m_per_s);
    const double yaw_rate_rad_per_s =
        std::clamp(draw.log_uniform(1, 8), 1.0, std::max(1.0, 2 * speed_m_per_s / track_m));
    if (fault == RobotFault::no_room) {
        peak_m_per_s2 = std::max(peak_m_per_s2, 6.0);
        speed_m_per_s = std::max(speed_m_per_s, 20 * per_wheel_m_per_s);
    }
    robot.friction_share = draw.log_uniform(0.01, 0.25);
    const double coulomb_share = robot.friction_share * draw.uniform(0.5, 0.95);
    const double torque_Nm =
        rounded(std::max(peak_m_per_s2 * radius_m * effective_kg / 2 / (1 - coulomb_share), 0.012), 3);
    const double coulomb_Nm = coulomb_share * torque_Nm;
    const double viscous_Nm_s_per_rad =
        (robot.friction_share - coulomb_share) * torque_Nm / (speed_m_per_s / radius_m);
    const std::array<double, 2> unlike{draw.uniform(0.85, 1.15), draw.uniform(0.85, 1.15)};

    // ---- drives
    std::array<int, 2> sign{draw.sign(), draw.sign()};
    const double gear = rounded(draw.log_uniform(1, 50), 3);
    const std::int64_t counts = std::llround(draw.log_uniform(1000, 65536));
    const double count_rad = kTwoPi / static_cast<double>(counts) / gear;  // at the wheel
    const double encoder_noise_rad = count_rad * draw.log_uniform(0.1, 2);
    robot.delay_s = draw.log_uniform(0.3e-3, 4e-3);
    const double latency_s = robot.delay_s * draw.uniform(0.1, 0.9);
    const double current_A = draw.log_uniform(1, 40);  // at the torque limit
    const double constant_Nm_per_A = rounded(std::clamp(torque_Nm / gear / current_A, 5e-4, 10.0), 3);
    const std::array<double, 2> constant_error{draw.uniform(0.995, 1.005), draw.uniform(0.995, 1.005)};
    robot.clips = draw.share(0.15);
    const double clips_at = draw.uniform(0.5, 0.95);
    robot.weak_wheel = draw.share(0.15);
    const std::size_t weak_side = draw.share(0.5) ? 1 : 0;
    const double weak_scale = draw.uniform(0.7, 0.95);
    robot.torque_feedback = draw.share(0.8);
    const double torque_noise_Nm = torque_Nm * draw.log_uniform(0.0005, 0.01);
    const std::int64_t generation = draw.share(0.5) ? 6 : 5;
    const auto left_node = static_cast<std::int64_t>(draw.uniform(0, 20));
    std::array<std::int64_t, 2> node{left_node,
                                     left_node + 1 + static_cast<std::int64_t>(draw.uniform(0, 20))};
    robot.external_pose = draw.share(0.5);
    // Without a look from outside a robot whose sides are exchanged is like any other.
    if (fault == RobotFault::swapped_wheels) robot.external_pose = true;

    // ---- what a tape measure gets wrong
    const double radius_error = draw.uniform(-0.004, 0.004);
    const std::array<double, 2> wheel_error{draw.uniform(-0.001, 0.001), draw.uniform(-0.001, 0.001)};
    const double track_error = draw.uniform(-0.005, 0.005);
    robot.fault_side = draw.share(0.5) ? 1 : 0;
    const double how_bad = draw.uniform(0, 1);

    // ---- payload: a box anywhere on the robot
    robot.payload.mass_kg = mass_kg * draw.uniform(0.2, 0.3);
    robot.payload.ahead_m = track_m * draw.uniform(-1, 1) / 3;
    robot.payload.left_m = track_m * draw.uniform(-1, 1) / 3;
    robot.payload.inertia_kg_m2 = robot.payload.mass_kg * std::pow(track_m * draw.uniform(0.2, 0.5), 2) / 6;
    // 1000 as drives are sold, 100 as their makers advise for Hall sensors
    const double encoder_loop_rad_per_s = draw.log_uniform(100, 2000);

    robot.lists_friction = draw.share(0.5);
    const double cog_left_m = std::clamp(draw.normal(0.05), -0.15, 0.15) * track_m;
    // each cycle, as the documents advise, to ten milliseconds, as drives are sold
    constexpr std::array<std::int64_t, 8> kReportPeriods_ms{1, 1, 1, 1, 1, 2, 5, 10};
    robot.report_period_ms =
        kReportPeriods_ms[static_cast<std::size_t>(draw.uniform(0, kReportPeriods_ms.size()))];
    const double stale_s = stale_feedback_s(robot.report_period_ms);

    // ---- what the builder writes
    const std::int64_t torque_period_ms = robot.torque_feedback ? 10 : 0;
    const double half_track_m = track_m / 2;
    const double yaw_effective_kg_m2 = yaw_inertia_kg_m2 +
                                       mass_kg * std::pow(std::hypot(cog_ahead_m, cog_left_m), 2) +
                                       (effective_kg - mass_kg) * half_track_m * half_track_m;
    const double yaw_peak_rad_per_s2 =
        2 * torque_Nm * (1 - coulomb_share) / radius_m * half_track_m / yaw_effective_kg_m2;
    const FigureEight path = figure_eight(track_m, speed_m_per_s, yaw_rate_rad_per_s,
                                          std::min(peak_m_per_s2, yaw_peak_rad_per_s2 * half_track_m));
    const std::string name = "stranger-" + std::to_string(seed) + "-" + std::to_string(number);
    const double believed_radius_m = rounded(radius_m, 4);
    const double believed_track_m = rounded(track_m, 4);
    std::vector<task::FileChange> believed{
        {"robot.name", name},
        {"geometry.wheel_radius_m.left", believed_radius_m},
        {"geometry.wheel_radius_m.right", believed_radius_m},
        {"geometry.track_m", believed_track_m},
        {"limits.torque_Nm", torque_Nm},
        {"limits.speed_m_per_s", rounded(speed_m_per_s, 2)},
        {"limits.yaw_rate_rad_per_s", rounded(yaw_rate_rad_per_s, 2)},
        {"limits.acceleration_m_per_s2", rounded(3 * peak_m_per_s2, 2)},
        {"limits.yaw_acceleration_rad_per_s2", rounded(3 * yaw_peak_rad_per_s2, 2)},
        {"drive.generation", generation},
        {"drive.encoder_period_ms", robot.report_period_ms},
        {"drive.torque_period_ms", torque_period_ms},
        {"drive.watchdog_assured", true},
        {"safety.stale_feedback_s", stale_s},
        {"pose_control.speed_m_per_s", rounded(speed_m_per_s / 2, 2)},
        {"pose_control.yaw_rate_rad_per_s", rounded(yaw_rate_rad_per_s / 2, 2)},
        {"trajectory.length_m", path.length_m},
        {"trajectory.width_m", path.width_m},
        {"trajectory.period_s", path.period_s},
        {"safety.over_speed_m_per_s",
         rounded(above_default(1.5 * speed_m_per_s, "ident.speed_limit_m_per_s"), 2)},
        {"safety.over_yaw_rate_rad_per_s",
         rounded(above_default(2 * yaw_rate_rad_per_s, "ident.yaw_rate_limit_rad_per_s"), 2)},
    };
    if (fault == RobotFault::no_room) believed.push_back({"ident.distance_limit_m", 0.1});
    constexpr std::array<std::string_view, 2> kSides{"left", "right"};
    for (std::size_t side = 0; side < 2; ++side) {
        const std::string drive = "drive." + std::string(kSides[side]) + ".";
        believed.push_back({drive + "node", node[side]});
        believed.push_back({drive + "sign", std::int64_t{sign[side]}});
        believed.push_back({drive + "gear_ratio", gear});
        believed.push_back({drive + "torque_constant_Nm_per_A", constant_Nm_per_A});
    }
    const std::string who =
        "robot " + std::to_string(number) + " of `wheelwright robots --seed " + std::to_string(seed) + "`";
    robot.robot_toml = headed("# What a builder could write about " + who + ", made from template.toml.\n",
                              with_values(template_for(robot.lists_friction), believed));
    robot.believed = read(robot.robot_toml, name + "/robot.toml");

    // ---- the truth
    if (fault != RobotFault::none) robot.clips = robot.weak_wheel = false;  // one thing at a time
    if (fault == RobotFault::clipping) robot.torque_share = 0.3 + 0.2 * how_bad;
    if (robot.clips) robot.torque_share = clips_at;
    if (fault == RobotFault::wrong_sign) sign[robot.fault_side] *= -1;
    if (fault == RobotFault::swapped_wheels) {  // whoever looked that both turn forward has turned the signs
        std::swap(node[0], node[1]);            // with the nodes
        std::swap(sign[0], sign[1]);
    }
    const double unclipped = robot.torque_share < 1 ? robot.torque_share : 1.5;
    std::vector<task::FileChange> truth{
        {"robot.name", name},
        {"geometry.track_m", believed_track_m * (1 + track_error)},
        {"drive.generation", generation},
        {"drive.encoder_period_ms", robot.report_period_ms},
        {"safety.stale_feedback_s", stale_s},
        {"drive.torque_period_ms", torque_period_ms},
        {"mass.mass_kg", mass_kg},
        // the plant knows of the parallel axis ahead only
        {"mass.yaw_inertia_kg_m2", yaw_inertia_kg_m2 + mass_kg * cog_left_m * cog_left_m},
        {"mass.cog_ahead_m", cog_ahead_m},
        // of all that is accelerated, rotors included
        {"effects.cog_lateral.offset_m", cog_left_m * (1 - robot.rotor_share)},
        {"mass.wheel_inertia_kg_m2", wheel_inertia_kg_m2},
        {"simulation.encoder_counts_per_turn", counts},
        {"simulation.encoder_noise_rad", encoder_noise_rad},
        {"simulation.velocity_filter_rad_per_s", encoder_loop_rad_per_s},
        {"simulation.torque_lag_s", robot.delay_s - latency_s},
        {"simulation.command_latency_s", latency_s},
        {"simulation.torque_noise_Nm", torque_noise_Nm},
        {"simulation.current_limit_A", unclipped * torque_Nm / gear / constant_Nm_per_A},
        {"simulation.external_pose_rate_Hz", robot.external_pose ? 20.0 : 0.0},
    };
    if (fault == RobotFault::wheel_in_air) {  // the other tyre has to be one
        truth.push_back({"effects.wheel_slip.friction_coefficient", 1.0});
        truth.push_back({"effects.wheel_slip.slip_speed_m_per_s", 0.02});
    }
    const std::size_t coulomb = model::find_effect("coulomb_friction");
    const double most_dry_Nm = model::kEffects[coulomb].parameters[0].maximum;  // in a file
    std::array<double, 2> dry_friction_Nm{};
    for (std::size_t side = 0; side < 2; ++side) {
        const std::string which(kSides[side]);
        const std::string drive = "drive." + which + ".";
        truth.push_back(
            {"geometry.wheel_radius_m." + which, believed_radius_m * (1 + radius_error + wheel_error[side])});
        truth.push_back({drive + "node", node[side]});
        truth.push_back({drive + "sign", std::int64_t{sign[side]}});
        truth.push_back({drive + "gear_ratio", gear});
        truth.push_back({drive + "torque_constant_Nm_per_A", constant_Nm_per_A * constant_error[side]});
        truth.push_back({drive + "torque_scale", robot.weak_wheel && side == weak_side ? weak_scale : 1.0});
        double dry_Nm = coulomb_Nm * unlike[side];
        if (fault == RobotFault::too_heavy) dry_Nm = torque_Nm * (1.2 + 0.8 * how_bad);
        // so much that no motor turns it: the tyre would slide, and that is another fault
        if (fault == RobotFault::wheel_blocked && side == robot.fault_side) dry_Nm = 1000 * torque_Nm;
        dry_friction_Nm[side] = dry_Nm;
        truth.push_back({"effects.coulomb_friction." + which + "_Nm", std::min(dry_Nm, most_dry_Nm)});
        truth.push_back(
            {"effects.viscous_friction." + which + "_Nm_s_per_rad", viscous_Nm_s_per_rad * unlike[side]});
    }
    robot.plant_toml = headed("# The truth about " + who + ". Again, without the program that drew it:\n" +
                                  "#   wheelwright sim --robot robot.toml --plant plant.toml --seed " +
                                  std::to_string(robot.simulation_seed) + " ident figure-eight\n",
                              with_values(files::simulated_toml, truth));
    robot.truth = read(robot.plant_toml, name + "/plant.toml");
    for (std::size_t side = 0; side < 2; ++side)
        robot.truth.parameters.effects.parameter[coulomb][side] = dry_friction_Nm[side];
    return robot;
}

}  // namespace wheelwright::tools
