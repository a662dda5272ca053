#include "tools/ident/findings.hpp"
#include "tools/logs/read_measured.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <ctime>
#include <optional>

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
    if (candumps == paths.size()) return identify_drive_logs(paths, setup);
    if (candumps == 0) return identify_measured_logs(paths, setup);
    failed.problems.emplace_back("candump logs and others cannot be one experiment: name one form only");
    return failed;
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
