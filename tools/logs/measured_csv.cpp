#include "tools/logs/measured_csv.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <istream>
#include <string_view>

#include "firmware/task/robot_file_hints.hpp"
#include "tools/logs/raw_log.hpp"

namespace wheelwright::tools {
namespace {

constexpr std::size_t kAbsent = SIZE_MAX;

// Places in kSignals.
constexpr std::size_t place_of(std::string_view key) {
    std::size_t i = 0;
    while (kSignals[i].key != key) ++i;
    return i;
}
constexpr std::size_t kTime = place_of("t");
constexpr std::size_t kGyro = place_of("gyro_z");
constexpr std::size_t kAccel = place_of("accel_x");
// A pair of wheels: left, right, or both in one.
constexpr std::array kTorque{place_of("tau_left"), place_of("tau_right"), place_of("tau")};
constexpr std::array kSpeed{place_of("omega_left"), place_of("omega_right"), place_of("omega")};
constexpr std::array kAngle{place_of("angle_left"), place_of("angle_right"), place_of("angle")};
using Pair = std::array<std::size_t, 3>;

std::string_view trim(std::string_view text) {
    const std::size_t begin = text.find_first_not_of(" \t\r");
    if (begin == std::string_view::npos) return "";
    return text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1);
}

void split(std::string_view line, std::vector<std::string_view>& cells) {
    cells.clear();
    for (;;) {
        const std::size_t comma = line.find(',');
        std::string_view cell = trim(line.substr(0, comma));
        if (cell.size() >= 2 && cell.front() == '"' && cell.back() == '"')
            cell = cell.substr(1, cell.size() - 2);
        cells.push_back(cell);
        if (comma == std::string_view::npos) return;
        line.remove_prefix(comma + 1);
    }
}

bool is_missing(std::string_view cell) {
    return cell.empty() || (cell.size() == 3 && (cell[0] | 0x20) == 'n' && (cell[1] | 0x20) == 'a' &&
                            (cell[2] | 0x20) == 'n');
}

class Reader {
  public:
    explicit Reader(const LogReading& reading) : reading_(reading) {}

    MeasuredLogs read(std::istream& in) {
        std::string line;
        std::size_t number = 0;
        while (std::getline(in, line)) {
            ++number;
            if (number == 1) {
                if (line.starts_with("\xEF\xBB\xBF")) line.erase(0, 3);
                if (!header(line)) return std::move(logs_);
            } else if (!trim(line).empty()) {
                short_row();
                row(number, line);
            }
        }
        if (in.bad()) logs_.problem(0, "cannot be read to its end");
        if (number == 0) logs_.problem(0, "is empty");
        if (logs_.problem_count == 0) finish();
        return std::move(logs_);
    }

  private:
    struct Column {
        std::string name;
        std::size_t place = kAbsent;
        WheelPair<double> factor;  // to SI; the same twice where it is not a wheel's
    };

    const Column& column(std::size_t signal) const { return columns_[signal]; }
    bool has(std::size_t signal) const { return columns_[signal].place != kAbsent; }
    bool has_pair(const Pair& pair) const { return (has(pair[0]) && has(pair[1])) || has(pair[2]); }

    bool header(std::string_view line) {
        std::vector<std::string_view> names;
        split(line, names);
        if (names.size() == 1 && line.find_first_of(";\t") != std::string_view::npos) {
            logs_.problem(1, "columns must be separated by commas");
            return false;
        }
        column_count_ = names.size();
        for (std::size_t s = 0; s < kSignals.size(); ++s) find(s, names);
        const auto need = [&](bool there, std::size_t signal, const char* or_else) {
            if (!there) logs_.problem(1, missing(signal, names) + or_else);
        };
        const bool summed_torque = has(kTorque[2]);
        const bool motion = has_pair(kSpeed) || has_pair(kAngle);
        need(has(kTime), kTime, "");
        for (const std::size_t side : {0, 1}) need(summed_torque || has(kTorque[side]), kTorque[side], "");
        for (const std::size_t side : {0, 1}) need(motion || has(kSpeed[side]), kSpeed[side], "");
        return logs_.problem_count == 0;
    }

    void find(std::size_t signal, const std::vector<std::string_view>& names) {
        Column& column = columns_[signal];
        const auto stated = std::find_if(reading_.columns.begin(), reading_.columns.end(),
                                         [&](const ColumnMapping& m) { return m.signal == signal; });
        const bool mapped = stated != reading_.columns.end();
        column.name = mapped ? stated->column : std::string(kSignals[signal].standard);
        if (column.name.empty()) return;
        if (std::count(names.begin(), names.end(), column.name) > 1) {
            logs_.problem(1, "column " + column.name + " appears twice");
        }
        const auto found = std::find(names.begin(), names.end(), column.name);
        if (found == names.end()) {
            if (mapped) logs_.problem(1, missing(signal, names));
            return;
        }
        column.place = static_cast<std::size_t>(found - names.begin());
        for (double WheelPair<double>::*side : {&WheelPair<double>::left, &WheelPair<double>::right}) {
            const Factor factor = factor_to_si(kSignals[signal].quantity, mapped ? stated->unit : "",
                                               reading_, reading_.wheel_radius_m.*side);
            if (!factor.problem.empty()) {
                logs_.problem(1, "column " + column.name + ": " + factor.problem);
                return;
            }
            column.factor.*side = (mapped && stated->turned ? -1 : 1) * factor.value;
        }
        if (mapped && stated->unit.ends_with('V') && !said_volts_) {
            logs_.note(0, volts_assumption(*reading_.torque_per_volt_Nm));
            said_volts_ = true;
        }
    }

    std::string missing(std::size_t signal, const std::vector<std::string_view>& names) const {
        std::string message = "column " + columns_[signal].name + " is missing";
        for (const std::string_view name : names) {
            const bool taken = std::any_of(columns_.begin(), columns_.end(), [&](const Column& c) {
                return c.place != kAbsent && c.name == name;
            });
            if (!taken && task::edit_distance(name, columns_[signal].name) <= 3)
                return message + "; there is " + std::string(name);
        }
        return message + "; --columns says which column stands for it (" + std::string(kSignals[signal].key) +
               "=...)";
    }

    void row(std::size_t number, std::string_view line) {
        split(line, cells_);
        if (cells_.size() != column_count_) {
            short_row_ = number;
            short_row_cells_ = cells_.size();
            return;
        }
        std::array<double, kSignals.size()> value{};
        bool missing = false;
        for (std::size_t s = 0; s < kSignals.size(); ++s) {
            if (!has(s)) continue;
            std::string_view text = cells_[columns_[s].place];
            if (is_missing(text)) {
                missing = true;
                continue;
            }
            if (text.starts_with('+')) text.remove_prefix(1);
            const auto parsed = std::from_chars(text.data(), text.data() + text.size(), value[s]);
            if (parsed.ec != std::errc{} || parsed.ptr != text.data() + text.size() ||
                !std::isfinite(value[s])) {
                logs_.problem(number, "column " + columns_[s].name + ": found \"" +
                                          std::string(cells_[columns_[s].place]) +
                                          "\", expected a finite number");
                return;
            }
        }
        if (missing) {
            if (missing_++ == 0) first_missing_ = number;
            return;
        }
        RawSample sample;
        sample.t_s = value[kTime] * column(kTime).factor.left;
        sample.torque_Nm = pair(kTorque, value, 0.5);
        sample.wheel = pair(has_pair(kAngle) ? kAngle : kSpeed, value, 1);
        if (has(kGyro)) sample.gyro = value[kGyro] * column(kGyro).factor.left;
        if (has(kAccel)) sample.accel_m_per_s2 = value[kAccel] * column(kAccel).factor.left;
        sample.line = number;
        raw_.samples.push_back(sample);
    }

    // `share` of what is given for both wheels.
    WheelPair<double> pair(const Pair& signals, const std::array<double, kSignals.size()>& value,
                           double share) const {
        const std::size_t left = has(signals[2]) ? signals[2] : signals[0];
        const std::size_t right = has(signals[2]) ? signals[2] : signals[1];
        const double of_both = has(signals[2]) ? share : 1;
        return {of_both * value[left] * column(left).factor.left,
                of_both * value[right] * column(right).factor.right};
    }

    // A last row that was cut short belongs to a logger that was switched off; any other is a problem.
    void short_row() {
        if (short_row_ == 0) return;
        logs_.problem(short_row_, "found " + std::to_string(short_row_cells_) + " columns, expected " +
                                      std::to_string(column_count_));
        short_row_ = 0;
    }

    void finish() {
        if (short_row_ != 0) {
            if (short_row_cells_ > column_count_) return short_row();
            logs_.note(short_row_, "the last row is cut short: left out");
        }
        if (missing_ > 0) {
            logs_.note(first_missing_, "a cell is empty or nan in " + std::to_string(missing_) +
                                           " rows, here first: these rows are taken as missing");
        }
        if (has(kTorque[2]))
            logs_.note(0, "assumed: " + column(kTorque[2]).name + " is shared by both wheels alike");
        raw_.angles = has_pair(kAngle);  // nobody names them who wants others
        raw_.has_gyro = has(kGyro);
        raw_.has_accel = has(kAccel);
        add_segments(std::move(raw_), logs_);
    }

    const LogReading& reading_;
    MeasuredLogs logs_;
    RawLog raw_;
    std::array<Column, kSignals.size()> columns_;
    std::vector<std::string_view> cells_;
    std::size_t column_count_ = 0;
    std::size_t short_row_ = 0, short_row_cells_ = 0;
    std::size_t missing_ = 0, first_missing_ = 0;
    bool said_volts_ = false;
};

}  // namespace

MeasuredLogs read_measured_csv(std::istream& in, const LogReading& reading) {
    return Reader(reading).read(in);
}

}  // namespace wheelwright::tools
