#include "tools/logs/measured_csv.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <string_view>

#include "firmware/task/robot_file_hints.hpp"

namespace wheelwright::tools {
namespace {

constexpr std::size_t kKeptProblems = 20;
constexpr std::size_t kFewestSamples = 20;
constexpr double kSlowest_Hz = 20;
constexpr double kFastest_Hz = 2000;
constexpr double kRateTolerance = 0.01;
// A step may differ from the median by this share; clocks of loggers jitter, lost samples do not.
constexpr double kStepTolerance = 0.5;

struct ColumnInfo {
    std::string_view name;
    bool needed;
};
// Places in kColumns.
constexpr std::size_t kTime = 0;
constexpr std::size_t kTorqueLeft = 1;
constexpr std::size_t kTorqueRight = 2;
constexpr std::size_t kSpeedLeft = 3;
constexpr std::size_t kSpeedRight = 4;
constexpr std::size_t kGyro = 5;
constexpr std::size_t kAccel = 6;
constexpr std::array<ColumnInfo, 7> kColumns{{
    {"t_s", true},
    {"tau_left_Nm", true},
    {"tau_right_Nm", true},
    {"omega_left_rad_s", true},
    {"omega_right_rad_s", true},
    {"gyro_z_rad_s", false},
    {"accel_x_m_s2", false},
}};
constexpr std::size_t kAbsent = SIZE_MAX;

std::string_view trim(std::string_view text) {
    const std::size_t begin = text.find_first_not_of(" \t\r");
    if (begin == std::string_view::npos) return "";
    return text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1);
}

void split(std::string_view line, std::vector<std::string_view>& cells) {
    cells.clear();
    for (;;) {
        const std::size_t comma = line.find(',');
        cells.push_back(trim(line.substr(0, comma)));
        if (comma == std::string_view::npos) return;
        line.remove_prefix(comma + 1);
    }
}

class Reader {
  public:
    MeasuredLogResult read(std::istream& in) {
        std::string line;
        std::size_t number = 0;
        while (std::getline(in, line)) {
            ++number;
            if (number == 1) {
                if (line.starts_with("\xEF\xBB\xBF")) line.erase(0, 3);
                if (!header(line)) return finish();
            } else if (!trim(line).empty()) {
                if (blank_line_ != 0) {
                    problem(blank_line_, "blank line inside the log");
                    blank_line_ = 0;
                }
                row(number, line);
            } else if (blank_line_ == 0) {
                blank_line_ = number;  // fine at the end of the file
            }
        }
        if (in.bad()) problem(0, "cannot be read to its end");
        if (number == 0) problem(0, "is empty");
        if (result_.problem_count == 0) check_time();
        return finish();
    }

  private:
    void problem(std::size_t line, std::string message) {
        ++result_.problem_count;
        if (result_.problems.size() < kKeptProblems) result_.problems.push_back({line, std::move(message)});
    }

    bool header(std::string_view line) {
        std::vector<std::string_view> names;
        split(line, names);
        if (names.size() == 1 && line.find_first_of(";\t") != std::string_view::npos) {
            problem(1, "columns must be separated by commas");
            return false;
        }
        for (std::string_view& name : names) {
            if (name.size() >= 2 && name.front() == '"' && name.back() == '"') {
                name = name.substr(1, name.size() - 2);
            }
        }
        column_count_ = names.size();
        where_.fill(kAbsent);
        for (std::size_t i = 0; i < names.size(); ++i) {
            const auto known = std::find_if(kColumns.begin(), kColumns.end(),
                                            [&](const ColumnInfo& info) { return info.name == names[i]; });
            if (known == kColumns.end()) {
                log_.ignored_columns.emplace_back(names[i]);
                continue;
            }
            std::size_t& place = where_[static_cast<std::size_t>(known - kColumns.begin())];
            if (place != kAbsent) problem(1, "column " + std::string(names[i]) + " appears twice");
            place = i;
        }
        for (std::size_t c = 0; c < kColumns.size(); ++c) {
            if (!kColumns[c].needed || where_[c] != kAbsent) continue;
            std::string message = "column " + std::string(kColumns[c].name) + " is missing";
            for (const std::string_view name : names) {
                const bool known = std::any_of(kColumns.begin(), kColumns.end(),
                                               [&](const ColumnInfo& info) { return info.name == name; });
                if (!known && task::edit_distance(name, kColumns[c].name) <= 3) {
                    message += "; there is " + std::string(name);
                    break;
                }
            }
            problem(1, message);
        }
        log_.has_gyro = where_[kGyro] != kAbsent;
        log_.has_accel = where_[kAccel] != kAbsent;
        return result_.problem_count == 0;
    }

    void row(std::size_t number, std::string_view line) {
        split(line, cells_);
        if (cells_.size() != column_count_) {
            problem(number, "found " + std::to_string(cells_.size()) + " columns, expected " +
                                std::to_string(column_count_));
            return;
        }
        std::array<double, kColumns.size()> value{};
        bool good = true;
        for (std::size_t c = 0; c < kColumns.size(); ++c) {
            if (where_[c] == kAbsent) continue;
            std::string_view text = cells_[where_[c]];
            if (text.starts_with('+')) text.remove_prefix(1);
            const auto parsed = std::from_chars(text.data(), text.data() + text.size(), value[c]);
            if (text.empty() || parsed.ec != std::errc{} || parsed.ptr != text.data() + text.size() ||
                !std::isfinite(value[c])) {
                problem(number, "column " + std::string(kColumns[c].name) + ": found \"" +
                                    std::string(cells_[where_[c]]) + "\", expected a finite number");
                good = false;
            }
        }
        if (!good) return;
        lines_.push_back(number);
        log_.samples.push_back({value[kTime],
                                {value[kTorqueLeft], value[kTorqueRight]},
                                {value[kSpeedLeft], value[kSpeedRight]},
                                value[kGyro],
                                value[kAccel]});
    }

    void check_time() {
        if (log_.samples.size() < kFewestSamples) {
            problem(0, "has " + std::to_string(log_.samples.size()) + " samples, expected at least " +
                           std::to_string(kFewestSamples));
            return;
        }
        std::vector<double> steps;
        for (std::size_t i = 1; i < log_.samples.size(); ++i) {
            steps.push_back(log_.samples[i].t_s - log_.samples[i - 1].t_s);
        }
        std::vector<double> sorted = steps;
        const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
        std::nth_element(sorted.begin(), middle, sorted.end());
        const double period = *middle;
        for (std::size_t i = 0; i < steps.size(); ++i) {
            if (!(steps[i] > 0)) {
                problem(lines_[i + 1], step_text(steps[i], log_.samples[i + 1].t_s));
            } else if (period > 0 && steps[i] > period * (1 + kStepTolerance)) {
                problem(lines_[i + 1], "gap: " + seconds(steps[i]) + " after the line before, where " +
                                           seconds(period) + " is usual");
            } else if (period > 0 && steps[i] < period * (1 - kStepTolerance)) {
                problem(lines_[i + 1], "only " + seconds(steps[i]) + " after the line before, where " +
                                           seconds(period) + " is usual");
            }
        }
        if (period > 0 && (1 / period < kSlowest_Hz * (1 - kRateTolerance) ||
                           1 / period > kFastest_Hz * (1 + kRateTolerance))) {
            problem(0, "is sampled every " + seconds(period) + ", expected 20 to 2000 samples a second");
        }
        log_.period_s =
            (log_.samples.back().t_s - log_.samples.front().t_s) / static_cast<double>(steps.size());
    }

    static std::string step_text(double step, double t_s) {
        if (step == 0) return "time " + seconds(t_s) + " appears twice";
        return "time goes back by " + seconds(-step);
    }

    static std::string seconds(double value) {
        std::array<char, 40> text{};
        std::snprintf(text.data(), text.size(), "%.9g s", value);
        return text.data();
    }

    MeasuredLogResult finish() {
        if (result_.problem_count == 0) result_.log = std::move(log_);
        return std::move(result_);
    }

    MeasuredLogResult result_;
    MeasuredLog log_;
    std::array<std::size_t, kColumns.size()> where_{};
    std::vector<std::size_t> lines_;  // of each sample
    std::vector<std::string_view> cells_;
    std::size_t column_count_ = 0;
    std::size_t blank_line_ = 0;
};

}  // namespace

MeasuredLogResult read_measured_csv(std::istream& in) { return Reader().read(in); }

MeasuredLogResult read_measured_csv(const std::string& path) {
    std::ifstream in(path);
    if (in) return read_measured_csv(in);
    MeasuredLogResult result;
    result.problem_count = 1;
    result.problems.push_back({0, std::string("cannot open: ") + std::strerror(errno)});
    return result;
}

}  // namespace wheelwright::tools
