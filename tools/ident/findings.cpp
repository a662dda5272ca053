#include "tools/ident/findings.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <ctime>
#include <optional>

#include "firmware/ident/cross_gains.hpp"
#include "tools/logs/read_measured.hpp"

namespace wheelwright::tools {
namespace {

constexpr double kFirstDate_s = 946'684'800;   // 2000-01-01: earlier clocks were not set
constexpr double kLastDate_s = 4'102'444'800;  // 2100-01-01: a time in another unit

void judge_positive(DynamicsFigure& k) {
    if (!k.reason.empty()) return;
    if (!(k.standard_error > 0) || !(k.standard_error < k.value / 2)) {
        k.reason = "not excited: this needs " + std::string(k.excited_by);
        return;
    }
    k.known = true;
}

void judge_length(DynamicsFigure& k, double scale) {
    if (!k.reason.empty()) return;
    if (!(k.standard_error > 0) || !(k.standard_error < scale / 2)) {
        k.reason = "not excited: this needs " + std::string(k.excited_by);
        return;
    }
    k.known = true;
}

// The regressions know nothing of what couples forward and turning, and see K5..K8 together with it. In a
// robot file they stand beside it.
void stand_beside(const model::RobotParameters& robot, Findings& f) {
    const double mismatch = model::listed_mismatch(robot.effects);
    const double offset_m = model::listed_offset_m(robot.effects);
    if (mismatch == 0 && offset_m == 0) return;
    if (!f.k7().known || !f.k8().known) return;
    const auto beside = ident::told_apart<double>({f.k5().value, f.k6().value, f.k7().value, f.k8().value},
                                                  mismatch, offset_m, robot.geometry.track_m);
    const std::array<double, 4> value{beside.k5_m, beside.k6_per_m, beside.k7_per_kg_m, beside.k8_per_kg_m2};
    for (std::size_t i = 0; i < f.k.size(); ++i) {
        if (f.k[i].value == 0) continue;
        f.k[i].standard_error *= std::abs(value[i] / f.k[i].value);
        f.k[i].value = value[i];
    }
}

}  // namespace

bool Findings::good_enough(double relative_standard_error) const {
    const auto good = [&](const DynamicsFigure& figure) {
        return figure.known && figure.standard_error <= relative_standard_error * figure.value;
    };
    return problems.empty() && good(k7()) && good(k8());
}

void judge(Findings& f, const model::Geometry<double>& geometry) {
    judge_positive(f.k[2]);
    judge_positive(f.k[3]);
    judge_length(f.k[0], geometry.track_m);
    if (!f.k[3].known && f.k[1].reason.empty()) {
        f.k[1].reason = "not without K8: this needs " + std::string(f.k[1].excited_by);
    }
    judge_length(f.k[1], f.k[2].known ? 2 * f.k[3].value / f.k[2].value : 0);
}

std::string_view without_side(std::string_view name) {
    for (const std::string_view side : {"left_", "right_"}) {
        if (name.starts_with(side)) return name.substr(side.size());
    }
    return "";
}

Findings identify_logs(const std::vector<std::string>& paths, const IdentSetup& setup) {
    Findings failed;
    std::size_t candumps = 0;
    for (const std::string& path : paths) {
        const std::optional<LogForm> form = log_form(path);
        if (!form) {
            failed.problems.push_back(
                to_text(path, {0, std::string("cannot open: ") + std::strerror(errno)}));
            continue;
        }
        candumps += *form == LogForm::candump ? 1 : 0;
    }
    if (!failed.problems.empty()) return failed;
    if (candumps != 0 && candumps != paths.size()) {
        failed.problems.emplace_back("candump logs and others cannot be one experiment: name one form only");
        return failed;
    }
    Findings found = candumps == 0 ? identify_measured_logs(paths, setup) : identify_drive_logs(paths, setup);
    if (found.problems.empty()) stand_beside(setup.robot, found);
    return found;
}

std::string log_date(double first_time_s) {
    if (!(first_time_s >= kFirstDate_s && first_time_s < kLastDate_s)) return "";
    const auto seconds = static_cast<std::time_t>(first_time_s);
    std::tm date{};
    if (gmtime_r(&seconds, &date) == nullptr) return "";
    std::array<char, 16> text{};
    const std::size_t length = std::strftime(text.data(), text.size(), "%Y-%m-%d", &date);
    return {text.data(), length};
}

}  // namespace wheelwright::tools
