#include "tools/strangers/report.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace wheelwright::tools {
namespace {

// What is demanded.
constexpr double kIdentifiedShare = 0.95;  // of the drawn robots
constexpr double kIdentificationAim = 0.02;
constexpr double kDurationAim_s = 90;
constexpr double kCoverageLeast = 0.90, kCoverageMost = 0.99;  // of the 95 % intervals
constexpr double kInterval_sigma = 1.96;
constexpr double kLargestZ = 6;

constexpr double kNoLimit = std::numeric_limits<double>::infinity();

double share_percent(std::size_t part, std::size_t all) {
    return all == 0 ? std::nan("") : 100 * static_cast<double>(part) / static_cast<double>(all);
}

}  // namespace

std::vector<Aim> aims_of(const std::vector<RobotResult>& results) {
    std::size_t identified = 0;
    std::size_t wrong = 0;
    std::size_t intervals = 0;
    std::size_t covered = 0;
    double worst = 0;
    double longest_s = 0;
    double largest_z = 0;
    for (const RobotResult& r : results) {
        if (!r.identified) continue;
        ++identified;
        worst = std::max(worst, r.worst_error());
        if (!(r.worst_error() <= kIdentificationAim)) ++wrong;
        longest_s = std::max(longest_s, r.duration_s);
        for (std::size_t k = 0; k < 4; ++k) {
            ++intervals;
            if (std::abs(r.z(k)) <= kInterval_sigma) ++covered;
            largest_z = std::max(largest_z, std::abs(r.z(k)));
        }
    }
    return {
        {"identified_percent", "identified", share_percent(identified, results.size()),
         100 * kIdentifiedShare, 100, "%", "of all robots"},
        {"wrong_successes", "identified with K7 or K8 wrong by more than 2 %", static_cast<double>(wrong), 0,
         0, "", ""},
        {"worst_error_percent", "worst error of K7, K8", 100 * worst, 0, 100 * kIdentificationAim, "%", ""},
        {"longest_s", "longest identification", longest_s, 0, kDurationAim_s, "s", ""},
        {"coverage_percent", "truth within the 95 % interval", share_percent(covered, intervals),
         100 * kCoverageLeast, 100 * kCoverageMost, "%", "K5 to K8"},
        {"largest_z", "largest error over its standard error", largest_z, 0, kLargestZ, "", "K5 to K8"},
    };
}

bool all_reached(const std::vector<Aim>& aims) {
    return std::all_of(aims.begin(), aims.end(), [](const Aim& aim) { return aim.reached(); });
}

Report robots_report(const std::vector<RobotResult>& results, std::uint64_t seed) {
    Report report("robots");
    report.section("robots", "Drawn robots, seed " + std::to_string(seed));
    report.table("robots", {{"robot", "robot"},
                            {"mass_kg", "kg"},
                            {"rotor_percent", "rotors %"},
                            {"friction_percent", "friction %"},
                            {"delay_ms", "delay ms"},
                            {"end", "end"},
                            {"duration_s", "s"},
                            {"farthest_m", "farthest m"},
                            {"k7_error_percent", "K7 %"},
                            {"k8_error_percent", "K8 %"},
                            {"z5", "z5"},
                            {"z6", "z6"},
                            {"z7", "z7"},
                            {"z8", "z8"},
                            {"remarks", ""}});
    for (const RobotResult& r : results) {
        const DrawnRobot& robot = r.robot;
        std::string remarks = r.problem;
        if (robot.clips) remarks += " clips";
        if (robot.weak_wheel) remarks += " weak";
        if (!robot.torque_feedback) remarks += " no_feedback";
        if (!robot.external_pose) remarks += " no_pose";
        const auto cell = [&](double value) { return Cell(number_text(value, 3)); };
        report.row({robot.number, cell(robot.truth.mass ? robot.truth.mass->mass_kg : 0),
                    cell(100 * robot.rotor_share), cell(100 * robot.friction_share),
                    cell(1e3 * robot.delay_s), r.end, cell(r.duration_s), cell(r.farthest_m),
                    cell(100 * r.error(2)), cell(100 * r.error(3)), cell(r.z(0)), cell(r.z(1)), cell(r.z(2)),
                    cell(r.z(3)), remarks});
    }
    std::map<std::string, std::int64_t> ends;
    for (const RobotResult& r : results) ++ends[r.problem.empty() ? r.end : "problem"];
    report.section("ends", "How the identification ended");
    for (const auto& [end, count] : ends) report.add(end, end, count);
    report.section("summary", "All together");
    for (const Aim& aim : aims_of(results)) {
        std::string remark = aim.reached() ? "good, aim " : "MISSED, aim ";
        if (aim.most == kNoLimit) {
            remark += "at least " + number_text(aim.least, 3);
        } else if (aim.least == 0) {
            remark += "at most " + number_text(aim.most, 3);
        } else {
            remark += number_text(aim.least, 3) + " to " + number_text(aim.most, 3);
        }
        if (!aim.remark.empty()) remark += "; " + aim.remark;
        report.add(aim.key, aim.label, aim.value, aim.unit, remark);
    }
    return report;
}

}  // namespace wheelwright::tools
