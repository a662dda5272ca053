#include "tools/strangers/report.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "tools/report/column.hpp"
#include "tools/report/page.hpp"

namespace wheelwright::tools {
namespace {

// ---- what is demanded
constexpr double kIdentifiedShare = 0.95;    // of the drawn robots
constexpr double kIdentificationAim = 0.02;  // K7 and K8, relative; a success beyond it is wrong
constexpr double kDurationAim_s = 90;
constexpr double kCoverageLeast = 0.90, kCoverageMost = 0.99;  // of the 95 % intervals
constexpr double kCoverageRoom_sigma = 2;  // so much beyond these is chance, among few robots
constexpr double kLargestZ = 6;
constexpr double kDrivenShare = 0.95;  // of the identified robots, for each of the three that follow
constexpr double kOvershootAim = 0.1;  // of a step, which settles in the time it is designed for
constexpr double kRippleAim = 0.03;    // its noise, as a share of the step
constexpr double kFigureEightAim = 0.01;
constexpr double kAdaptationAim = 0.05;  // K7 and K8, relative, with the load and without
constexpr double kAdaptiveRmsAim =
    1.1;  // RMS error with a load in adaptive mode over that in trajectory mode
constexpr double kPoseNoiseShare = 0.1;  // of the figure-8's aim: as much more is chance
constexpr double kNoBound = std::numeric_limits<double>::infinity();  // a figure, nothing is asked of it
constexpr double kFaultSpeedAim = 1;  // speed_over_limit(): the file's limits hold, whatever is wrong

constexpr double kInterval_sigma = 1.96;
constexpr std::array<const char*, 4> kNames{"K5", "K6", "K7", "K8"};
constexpr std::array<const char*, 4> kUnits{"m", "1/m", "1/(kg m)", "1/(kg m^2)"};

double percent(std::size_t part, std::size_t all) {
    return all == 0 ? 100 : 100 * static_cast<double>(part) / static_cast<double>(all);
}

// Three digits: what a table has room for.
Cell cell(double value) {
    if (!std::isfinite(value)) return std::string("-");
    const double size = std::abs(value);
    const double unit = size == 0 ? 1 : std::pow(10.0, std::min(2.0, 2 - std::floor(std::log10(size))));
    return std::round(value * std::max(unit, 1.0)) / std::max(unit, 1.0);
}

bool good_step(const StepJudged& step, double settling_aim_s) {
    return step.settling_s > 0 && step.settling_s <= settling_aim_s && step.overshoot <= kOvershootAim &&
           step.ripple <= kRippleAim;
}
bool good_steps(const Driving& d) {
    return good_step(d.forward, d.settling_aim_s) && good_step(d.turning, d.settling_aim_s);
}
bool good_figure_eight(const Driving& d) { return d.tracked && d.rms_share <= kFigureEightAim; }
bool good_adaptation(const Driving& d) { return d.adapted && d.adaptation_error() <= kAdaptationAim; }
bool sure_and_wrong(const Driving& d) {
    return d.adapted && (d.loaded.wrong(kAdaptationAim) || d.unloaded.wrong(kAdaptationAim));
}
bool knows_load(const Driving& d) { return d.adapted && d.loaded.known() && d.unloaded.known(); }
// An external pose's noise makes two drives unlike, by a small part of what a figure-8 may be off.
bool tracks_load(const Driving& d) {
    return d.adaptive_rms_share <=
           std::max(kAdaptiveRmsAim * d.load_rms_share, d.load_rms_share + kPoseNoiseShare * kFigureEightAim);
}

// With these nothing that is identified can be right: the signs, the sides or a wheel are wrong.
bool cannot_be_right(RobotFault fault) {
    return fault != RobotFault::none && fault != RobotFault::clipping && fault != RobotFault::no_room;
}
// One wheel that goes backwards, without an external pose and with a centre of gravity above the axle, moves
// its encoders as a robot without a fault would: to say so is all that can be asked.
bool said_to_be_unverified(const RobotResult& r) {
    return r.robot.fault == RobotFault::wrong_sign && r.end == "direction_unverified";
}
bool wrong_success(const RobotResult& r) {
    if (!r.identified || said_to_be_unverified(r)) return false;
    return cannot_be_right(r.robot.fault) || !(r.worst_error() <= kIdentificationAim);
}

// The robot's true speed and yaw rate over the file's limits, and a wheel's rim, which at both limits at once
// is the quicker one's: one in the air runs away by itself.
double speed_over_limit(const RobotResult& r) {
    const model::RobotParameters& p = r.robot.believed.parameters;
    const double v = p.limits.speed_m_per_s;
    const double omega = p.limits.yaw_rate_rad_per_s;
    return std::max({r.fastest.v_m_per_s / v, r.fastest.omega_rad_per_s / omega,
                     r.fastest_m_per_s / (v + omega * p.geometry.track_m / 2)});
}

double mass_kg(const RobotResult& r) { return r.robot.truth.mass->mass_kg; }

std::string remarks(const RobotResult& r) {
    std::string text;
    const auto add = [&text](bool yes, const std::string& word) {
        if (yes) text += (text.empty() ? "" : ", ") + word;
    };
    add(!r.problem.empty(), r.problem);
    add(wrong_success(r), "WRONG");
    add(r.robot.clips, "clips");
    add(r.robot.weak_wheel, "weak wheel");
    add(!r.robot.torque_feedback, "no torque feedback");
    add(!r.robot.external_pose, "no pose");
    add(!r.robot.lists_friction, "friction not listed");
    add(r.robot.report_period_ms > 1, "reports each " + std::to_string(r.robot.report_period_ms) + " ms");
    add(r.driving && !r.driving->blocker.empty(), r.driving ? r.driving->blocker : "");
    return text;
}

std::map<std::string, std::int64_t> ends_of(const std::vector<RobotResult>& results) {
    std::map<std::string, std::int64_t> ends;
    for (const RobotResult& r : results) ++ends[r.problem.empty() ? r.end : "problem"];
    return ends;
}

// A share of so many cases that is asked for, with the room that chance takes.
double with_room(double share, double sigmas, std::size_t cases) {
    const double sigma =
        std::sqrt(share * (1 - share) / static_cast<double>(std::max<std::size_t>(1, cases)));
    return 100 * std::clamp(share + sigmas * sigma, 0.0, 1.0);
}

std::vector<Aim> fault_aims(const std::vector<RobotResult>& results) {
    std::size_t wrong = 0;
    std::size_t problems = 0;
    double fastest = 0;
    for (const RobotResult& r : results) {
        if (wrong_success(r)) ++wrong;
        if (!r.problem.empty()) ++problems;
        fastest = std::max(fastest, speed_over_limit(r));
    }
    return {{"problems", "could not be simulated", static_cast<double>(problems), 0, 0, "", ""},
            {"wrong_successes", "identified although it is not what the file says",
             static_cast<double>(wrong), 0, 0, "", ""},
            {"fastest", "fastest true speed or yaw rate over its limit", fastest, 0, kFaultSpeedAim, "",
             "until the mode was left"}};
}

// A table whose rows people and programs read: heading, key, cells.
struct TableColumn {
    Report::Column column;
    Cell (*get)(const RobotResult&);
};

Cell driven(const RobotResult& r, double (*get)(const Driving&)) {
    return r.driving && r.driving->blocker.empty() ? cell(get(*r.driving)) : Cell(std::string("-"));
}

using R = RobotResult;
const std::vector<TableColumn> kRobot{
    {{"robot", "robot"}, [](const R& r) { return Cell(r.robot.number); }},
    {{"mass_kg", "kg"}, [](const R& r) { return cell(mass_kg(r)); }},
};
const std::vector<TableColumn> kFault{
    {{"fault", "fault"},
     [](const R& r) { return Cell(std::string(kRobotFaultNames[static_cast<std::size_t>(r.robot.fault)])); }},
};
const std::vector<TableColumn> kDrawn{
    {{"rotor_percent", "rotors %"}, [](const R& r) { return cell(100 * r.robot.rotor_share); }},
    {{"friction_percent", "friction %"}, [](const R& r) { return cell(100 * r.robot.friction_share); }},
    {{"delay_ms", "delay ms"}, [](const R& r) { return cell(1e3 * r.robot.delay_s); }},
};
const std::vector<TableColumn> kIdentified{
    {{"end", "end"}, [](const R& r) { return Cell(r.end); }},
    {{"duration_s", "s"}, [](const R& r) { return cell(r.duration_s); }},
    {{"farthest_m", "far m"}, [](const R& r) { return cell(r.farthest_m); }},
    {{"k7_error_percent", "K7 %"}, [](const R& r) { return cell(100 * r.error(2)); }},
    {{"k8_error_percent", "K8 %"}, [](const R& r) { return cell(100 * r.error(3)); }},
};
const std::vector<TableColumn> kDriven{
    {{"z5", "z5"}, [](const R& r) { return cell(r.z(0)); }},
    {{"z6", "z6"}, [](const R& r) { return cell(r.z(1)); }},
    {{"z7", "z7"}, [](const R& r) { return cell(r.z(2)); }},
    {{"z8", "z8"}, [](const R& r) { return cell(r.z(3)); }},
    {{"settling_speed_ms", "v ms"},
     [](const R& r) { return driven(r, [](const Driving& d) { return 1e3 * d.forward.settling_s; }); }},
    {{"ripple_speed_percent", "ripple %"},
     [](const R& r) { return driven(r, [](const Driving& d) { return 100 * d.forward.ripple; }); }},
    {{"overshoot_speed_percent", "over %"},
     [](const R& r) { return driven(r, [](const Driving& d) { return 100 * d.forward.overshoot; }); }},
    {{"settling_yaw_ms", "yaw ms"},
     [](const R& r) { return driven(r, [](const Driving& d) { return 1e3 * d.turning.settling_s; }); }},
    {{"ripple_yaw_percent", "ripple %"},
     [](const R& r) { return driven(r, [](const Driving& d) { return 100 * d.turning.ripple; }); }},
    {{"overshoot_yaw_percent", "over %"},
     [](const R& r) { return driven(r, [](const Driving& d) { return 100 * d.turning.overshoot; }); }},
    {{"figure_eight_rms_percent", "8 %"},
     [](const R& r) {
         return driven(r, [](const Driving& d) { return d.tracked ? 100 * d.rms_share : NAN; });
     }},
    {{"adaptation_error_percent", "load %"},
     [](const R& r) {
         return driven(r, [](const Driving& d) { return d.adapted ? 100 * d.adaptation_error() : NAN; });
     }},
    {{"adaptive_rms_ratio", "8 ratio"},
     [](const R& r) {
         return driven(r, [](const Driving& d) { return d.adaptive_rms_share / d.load_rms_share; });
     }},
    {{"adaptation_sigma_percent", "told %"},
     [](const R& r) {
         return driven(r, [](const Driving& d) {
             return d.adapted ? 100 * std::max({d.loaded.sigma[2], d.loaded.sigma[3], d.unloaded.sigma[2],
                                                d.unloaded.sigma[3]})
                              : NAN;
         });
     }},
};
const std::vector<TableColumn> kSpeed{
    {{"probe_s", "probe s"}, [](const R& r) { return cell(r.probe_s); }},
    {{"clipped_s", "less torque s"}, [](const R& r) { return cell(r.clipped_s > 0 ? r.clipped_s : NAN); }},
    {{"speed_over_limit", "speed/limit"}, [](const R& r) { return cell(speed_over_limit(r)); }},
};
const std::vector<TableColumn> kRemarks{
    {{"remarks", ""}, [](const R& r) { return Cell(remarks(r)); }},
};

std::vector<TableColumn> table_of(const RobotsRun& run) {
    std::vector<TableColumn> all;
    const auto add = [&all](const std::vector<TableColumn>& some) {
        all.insert(all.end(), some.begin(), some.end());
    };
    add(kRobot);
    add(run.faults ? kFault : kDrawn);
    add(kIdentified);
    add(kSpeed);
    if (!run.faults) add(kDriven);
    add(kRemarks);
    return all;
}

std::string cell_text(const Cell& value) {
    if (const double* number = std::get_if<double>(&value)) return number_text(*number, 4);
    if (const auto* whole = std::get_if<std::int64_t>(&value)) return std::to_string(*whole);
    return std::get<std::string>(value);
}

}  // namespace

std::string Aim::asked() const {
    if (most == kNoBound) return "-";
    if (least == most) return number_text(least, 3);
    if (least == 0) return "at most " + number_text(most, 3);
    if (most == 100 && unit == "%") return "at least " + number_text(least, 3);
    return number_text(least, 3) + " to " + number_text(most, 3);
}

std::vector<Aim> aims_of(const std::vector<RobotResult>& results, const RobotsRun& run) {
    if (run.faults) return fault_aims(results);
    std::size_t problems = 0;
    std::size_t identified = 0;
    std::size_t wrong = 0;
    std::size_t intervals = 0;
    std::size_t covered = 0;
    std::size_t steps = 0;
    std::size_t tracked = 0;
    std::size_t adapted = 0;  // K7 and K8 right
    std::size_t with_load = 0;
    std::size_t sure = 0;
    std::size_t knowing = 0;
    std::size_t tracking_load = 0;
    double worst = 0;
    double longest_s = 0;
    double largest_z = 0;
    for (const RobotResult& r : results) {
        if (!r.problem.empty()) ++problems;
        if (!r.identified) continue;
        ++identified;
        worst = std::max(worst, r.worst_error());
        if (wrong_success(r)) ++wrong;
        longest_s = std::max(longest_s, r.duration_s);
        for (std::size_t k = 0; k < 4; ++k) {
            ++intervals;
            if (std::abs(r.z(k)) <= kInterval_sigma) ++covered;
            largest_z = std::max(largest_z, std::abs(r.z(k)));
        }
        if (!r.driving) continue;
        if (good_steps(*r.driving)) ++steps;
        if (good_figure_eight(*r.driving)) ++tracked;
        if (good_adaptation(*r.driving)) ++adapted;
        if (!r.driving->adapted) continue;
        ++with_load;
        if (sure_and_wrong(*r.driving)) ++sure;
        if (knows_load(*r.driving)) ++knowing;
        if (tracks_load(*r.driving)) ++tracking_load;
    }
    return {
        {"problems", "could not be simulated", static_cast<double>(problems), 0, 0, "", ""},
        {"identified_percent", "identified", percent(identified, results.size()), 100 * kIdentifiedShare, 100,
         "%", "of all robots"},
        {"wrong_successes", "identified with K7 or K8 wrong by more than 2 %", static_cast<double>(wrong), 0,
         0, "", ""},
        {"worst_error_percent", "worst error of K7, K8", 100 * worst, 0, 100 * kIdentificationAim, "%", ""},
        {"longest_s", "longest identification", longest_s, 0, kDurationAim_s, "s", ""},
        {"coverage_percent", "truth within the 95 % interval", percent(covered, intervals),
         with_room(kCoverageLeast, -kCoverageRoom_sigma, intervals),
         with_room(kCoverageMost, kCoverageRoom_sigma, intervals), "%", "K5 to K8"},
        {"largest_z", "largest error over its standard error", largest_z, 0, kLargestZ, "", "K5 to K8"},
        {"steps_percent", "velocity steps settle in time", percent(steps, identified), 100 * kDrivenShare,
         100, "%", "of those identified; overshoot at most 10 %, ripple 3 %"},
        {"figure_eight_percent", "figure-8 within 1 % of its length", percent(tracked, identified),
         100 * kDrivenShare, 100, "%", "of those identified"},
        {"adaptation_percent", "K7, K8 within 5 % with a load and without it again",
         percent(adapted, identified), 100 * kDrivenShare, 100, "%", "of those identified"},
        {"adaptation_wrong", "says it knows K7 or K8, which is off by more than 5 %",
         static_cast<double>(sure), 0, 0, "", "with a load or without it again"},
        {"adaptation_known_percent", "says it knows K7 and K8 then", percent(knowing, with_load), -kNoBound,
         kNoBound, "%", "of those driven with a load; standard errors within 2.5 %"},
        {"adaptation_tracking_percent", "RMS error in adaptive mode as good as without adapting",
         percent(tracking_load, with_load), 100 * kDrivenShare, 100, "%",
         "of those driven with a load; at most 1.1 of it, or 0.1 % of the length more"},
    };
}

bool all_reached(const std::vector<Aim>& aims) {
    return std::all_of(aims.begin(), aims.end(), [](const Aim& aim) { return aim.reached(); });
}

Report robots_report(const std::vector<RobotResult>& results, const RobotsRun& run) {
    Report report("robots");
    report.section("robots", std::string(run.faults ? "Robots with faults" : "Robots") + ", seed " +
                                 std::to_string(run.seed));
    const std::vector<TableColumn> table = table_of(run);
    std::vector<Report::Column> columns;
    for (const TableColumn& one : table) columns.push_back(one.column);
    report.table("robots", columns);
    for (const RobotResult& r : results) {
        std::vector<Cell> row;
        for (const TableColumn& one : table) row.push_back(one.get(r));
        report.row(std::move(row));
    }
    report.section("ends", "How the identification ended");
    for (const auto& [end, count] : ends_of(results)) report.add(end, end, count);
    report.section("summary", "All together");
    for (const Aim& aim : aims_of(results, run)) {
        std::string remark =
            aim.most == kNoBound ? "no aim" : (aim.reached() ? "good, aim " : "MISSED, aim ") + aim.asked();
        if (!aim.remark.empty()) remark += "; " + aim.remark;
        report.add(aim.key, aim.label, aim.value, aim.unit, remark);
    }
    return report;
}

Report robot_report(const RobotResult& r) {
    const DrawnRobot& robot = r.robot;
    const model::RobotParameters& truth = robot.truth.parameters;
    const model::RobotParameters& believed = robot.believed.parameters;
    Report report("robots");
    report.section("robot", robot.believed.name);
    report.add("fault", "fault on purpose",
               std::string(kRobotFaultNames[static_cast<std::size_t>(robot.fault)]));
    report.add("remarks", "has", remarks(r));
    report.add("mass_kg", "mass", mass_kg(r), "kg");
    report.add("wheel_radius_m", "wheel radius", believed.geometry.mean_radius_m(), "m");
    report.add("track_m", "track", believed.geometry.track_m, "m");
    report.add("rotor_percent", "rotors' share of the effective mass", 100 * robot.rotor_share, "%");
    report.add("cog_ahead_m", "centre of gravity ahead of the axle", robot.truth.mass->cog_ahead_m, "m");
    report.add("torque_limit_Nm", "torque limit", believed.limits.torque_Nm, "Nm");
    report.add("torque_share_percent", "of which the drives can give",
               100 * std::min(robot.torque_share, 1.0), "%");
    report.add("friction_percent", "friction at full speed, of the torque limit", 100 * robot.friction_share,
               "%");
    report.add("speed_limit_m_per_s", "speed limit", believed.limits.speed_m_per_s, "m/s");
    report.add("yaw_rate_limit_rad_per_s", "yaw rate limit", believed.limits.yaw_rate_rad_per_s, "rad/s");
    report.add("gear_ratio", "gear", believed.drive.left.gear_ratio);
    report.add("encoder_counts", "encoder counts a motor turn",
               robot.truth.simulation.encoder_counts_per_turn);
    report.add("report_period_ms", "encoder reports each", robot.report_period_ms, "ms");
    report.add("delay_ms", "latency and lag of the drives", 1e3 * robot.delay_s, "ms");
    report.add("left_gain", "torque delivered, left", truth.drive.left.torque_scale);
    report.add("right_gain", "torque delivered, right", truth.drive.right.torque_scale);
    report.add("generation", "CANSimple generation", std::int64_t{believed.drive.generation});

    report.section("identification", "Identification");
    if (!r.problem.empty()) report.add("problem", "problem", r.problem);
    report.add("end", "ended with", r.end);
    report.add("duration_s", "after", r.duration_s, "s");
    report.add("farthest_m", "farthest from the start", r.farthest_m, "m");
    report.add("fastest_m_per_s", "fastest, at a wheel's rim", r.fastest_m_per_s, "m/s");
    report.add("identified_delay_ms", "actuation delay", 1e3 * r.delay_s, "ms");
    report.table("parameters", {{"name", "parameter"},
                                {"unit", "unit"},
                                {"true_value", "truth"},
                                {"value", "identified"},
                                {"standard_error", "standard error"},
                                {"error_percent", "error %"},
                                {"z", "z"}});
    for (std::size_t k = 0; k < 4; ++k) {
        report.row({std::string(kNames[k]), std::string(kUnits[k]), r.truth[k], r.estimate[k],
                    r.standard_error[k], 100 * r.error(k), r.z(k)});
    }
    if (!r.driving) return report;
    const Driving& d = *r.driving;
    report.section("driving", "Driving");
    if (!d.blocker.empty()) {
        report.add("blocker", "refused", d.blocker);
        return report;
    }
    const std::string aim = "aim " + number_text(1e3 * d.settling_aim_s);
    report.add("step_m_per_s", "step forward", d.forward.step, "m/s");
    report.add("settling_speed_ms", "settles to 1 % and the ripple in", 1e3 * d.forward.settling_s, "ms",
               aim);
    report.add("overshoot_speed_percent", "overshoot", 100 * d.forward.overshoot, "%", "aim 10");
    report.add("ripple_speed_percent", "ripple", 100 * d.forward.ripple, "%", "aim 3");
    report.add("step_rad_per_s", "step turning", d.turning.step, "rad/s");
    report.add("settling_yaw_ms", "settles to 1 % and the ripple in", 1e3 * d.turning.settling_s, "ms", aim);
    report.add("overshoot_yaw_percent", "overshoot", 100 * d.turning.overshoot, "%", "aim 10");
    report.add("ripple_yaw_percent", "ripple", 100 * d.turning.ripple, "%", "aim 3");
    report.add("figure_eight_m", "figure-8, length", believed.trajectory.length_m, "m");
    report.add("figure_eight_s", "a lap in", believed.trajectory.period_s, "s");
    report.add("figure_eight_entered", "driven", d.tracked);
    report.add("figure_eight_rms_percent", "RMS error, of its length", 100 * d.rms_share, "%", "aim 1");
    report.add("figure_eight_true_rms_percent", "where the robot really is", 100 * d.true_rms_share, "%");
    report.add("payload_kg", "payload", robot.payload.mass_kg, "kg");
    report.add("payload_ahead_m", "ahead of the axle", robot.payload.ahead_m, "m");
    report.add("payload_left_m", "left of the middle", robot.payload.left_m, "m");
    report.add("adapted", "adaptive mode driven to the end", d.adapted);
    if (!d.adapted) return report;
    const auto load = [&](const std::string& key, const std::string& when, const LoadJudged& judged) {
        report.add(key + "_frozen", "K7 or K8 held " + when + ", as not excited", judged.frozen);
        for (const std::size_t k : {std::size_t{2}, std::size_t{3}}) {
            report.add(key + (k == 2 ? "_k7_error_percent" : "_k8_error_percent"),
                       std::string(kNames[k]) + " " + when + ", error", 100 * judged.error[k], "%",
                       "aim 5; its own standard error " + number_text(100 * judged.sigma[k], 2) + " %");
        }
    };
    load("loaded", "with it", d.loaded);
    load("unloaded", "without it again", d.unloaded);
    report.add("load_rms_percent", "RMS error with the payload, trajectory mode", 100 * d.load_rms_share,
               "%");
    report.add("adaptive_rms_percent", "the same, adaptive mode", 100 * d.adaptive_rms_share, "%",
               "aim " + number_text(110 * d.load_rms_share, 3));
    return report;
}

void write_robots_page(const std::vector<RobotResult>& results, const RobotsRun& run,
                       const std::string& path) {
    report::Page page(
        run.faults ? "Robots with faults" : "Strangers' robots",
        "Robots drawn at random, each identified and driven by the firmware with nothing but what "
        "its builder could know. Judged by the simulated robots' truth.");
    const auto tone = [](const Aim& aim) {
        if (aim.most == kNoBound) return report::Tone::plain;
        return aim.reached() ? report::Tone::good : report::Tone::bad;
    };
    const auto value = [](const Aim& aim) {
        return number_text(aim.value, 4) + (aim.unit.empty() ? "" : " " + aim.unit);
    };
    const std::vector<Aim> aims = aims_of(results, run);
    std::vector<report::KeyFigure> key;
    report::Table summary;
    summary.columns = {{"measure"}, {"value", true}, {"aim", true}, {"of"}};
    summary.stack_when_narrow = true;
    for (const Aim& aim : aims) {
        summary.rows.push_back({aim.label, {value(aim), tone(aim)}, aim.asked(), aim.remark});
        if (aim.key == "identified_percent" || aim.key == "wrong_successes" ||
            aim.key == "worst_error_percent")
            key.push_back({aim.label, value(aim), "aim " + aim.asked(), tone(aim)});
    }
    page.figures(key);
    page.section("All together").table(std::move(summary));

    report::Section& ends = page.section("How the identification ended");
    report::Table by_end;
    by_end.columns = {{"end"}, {"robots", true}};
    for (const auto& [end, count] : ends_of(results)) by_end.rows.push_back({end, std::to_string(count)});
    ends.table(std::move(by_end));

    std::vector<RobotResult> known;
    for (const RobotResult& r : results) {
        if (r.identified) known.push_back(r);
    }
    if (!known.empty()) {
        report::Section& section = page.section("What was identified");
        const std::vector<double> mass =
            report::column(known, [](const RobotResult& r) { return mass_kg(r); });
        const auto of = [&](std::size_t k) {
            return report::column(
                known, [k](const RobotResult& r) { return std::max(100 * std::abs(r.error(k)), 1e-4); });
        };
        section.charts(
            {{.title = "Errors of K7 and K8",
              .x = {.label = "mass / kg", .logarithmic = true},
              .y = {.label = "error / %", .logarithmic = true},
              .series = {{"K7", mass, of(2), report::Draw::points},
                         {"K8", mass, of(3), report::Draw::points}},
              .levels = {{"aim", 100 * kIdentificationAim}},
              .caption = "K7 and K8 of each identified robot; those below 0.0001 % are drawn there.",
              .summary = "Relative errors of K7 and K8 of each identified robot over its mass."},
             {.title = "Time",
              .x = {.label = "mass / kg", .logarithmic = true},
              .y = {.label = "time / s"},
              .series = {{"identification", mass,
                          report::column(known, [](const RobotResult& r) { return r.duration_s; }),
                          report::Draw::points}},
              .levels = {{"aim", kDurationAim_s}},
              .caption = "From the mode's begin to its end.",
              .summary = "Duration of each successful identification over the robot's mass."}});
    }

    report::Section& robots = page.section("Robot by robot");
    report::Table table;
    const std::vector<TableColumn> columns = table_of(run);
    for (const TableColumn& one : columns) table.columns.push_back({one.column.label, true});
    for (const RobotResult& r : results) {
        std::vector<report::Cell> row;
        for (const TableColumn& one : columns) row.emplace_back(cell_text(one.get(r)));
        table.rows.push_back(std::move(row));
    }
    robots.table(std::move(table));
    page.footer("wheelwright robots --seed " + std::to_string(run.seed) + " --count " +
                std::to_string(results.size()) + (run.faults ? " --faults" : ""));
    page.write(path);
}

}  // namespace wheelwright::tools
