#include "tools/logs/sysid_json.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <string_view>

#include "tools/cli/report.hpp"
#include "tools/logs/raw_log.hpp"

namespace wheelwright::tools {
namespace {

using Json = nlohmann::json;

// Which way a test drives: as its key says, or by the commanded share's sign.
enum class Direction { forward, backward, commanded };
struct Test {
    std::string_view key;
    Direction direction;
    bool turns;  // left against right, counter-clockwise where forward
};
constexpr std::array<Test, 5> kTests{{
    {"slow-forward", Direction::forward, false},
    {"slow-backward", Direction::backward, false},
    {"fast-forward", Direction::forward, false},
    {"fast-backward", Direction::backward, false},
    {"track-width", Direction::commanded, true},
}};

// Places in a row.
struct Layout {
    std::size_t width, command, left_V, right_V, left_position, right_position, left_rate, right_rate, angle,
        yaw_rate;
};
constexpr std::size_t kNone = SIZE_MAX;
constexpr Layout kLayout2020{10, 2, 3, 4, 5, 6, 7, 8, 9, kNone};
constexpr Layout kLayoutSysId{9, kNone, 1, 2, 3, 4, 5, 6, 7, 8};

using Row = std::vector<double>;
struct Run {
    const Test* test = nullptr;
    bool turns = false;
    std::vector<Row> rows;
};

class SysIdReader {
  public:
    SysIdReader(const LogReading& reading, std::string run) : reading_(reading), run_(std::move(run)) {
        std::replace(run_.begin(), run_.end(), '_', '-');
    }

    MeasuredLogs read(const std::string& text) {
        Json file;
        try {
            file = Json::parse(text);
        } catch (const Json::exception& error) {  // a number may also be too large for a double
            logs_.problem(0, std::string("is not JSON: ") + error.what());
            return std::move(logs_);
        }
        find_tests(file);
        if (good()) find_units(file);
        if (good() && !reading_.torque_per_volt_Nm)
            logs_.problem(0, factor_to_si(Quantity::torque, "V", reading_, 0).problem);
        if (good()) find_signs();
        if (!good()) return std::move(logs_);
        logs_.note(0, volts_assumption(*reading_.torque_per_volt_Nm));
        std::vector<RawLog> raws;
        for (const Run& run : runs_) raws.push_back(raw_log(run));
        // the fast tests show best how often an angle is refreshed, and it is the same in all
        std::size_t every = SIZE_MAX;
        for (const RawLog& raw : raws) every = std::min(every, refreshed_every(raw));
        for (std::size_t i = 0; i < raws.size(); ++i) {
            raws[i].refreshed_every = every;
            if (run_.empty() || run_ == runs_[i].test->key) add_segments(std::move(raws[i]), logs_);
        }
        if (!good()) logs_.segments.clear();  // nothing of a file that is partly wrong
        return std::move(logs_);
    }

  private:
    bool good() const { return logs_.problem_count == 0; }

    void find_tests(const Json& file) {
        const bool angular = file.value("test", Json()) == "Drivetrain (Angular)";
        std::string all;
        for (const Test& test : kTests) {
            all += (all.empty() ? "" : ", ") + std::string(test.key);
            const auto found = file.find(test.key);
            if (found == file.end() || !found->is_array() || found->empty()) continue;
            Run run{&test, test.turns || angular, {}};
            take_rows(*found, run);
            if (!run.rows.empty()) runs_.push_back(std::move(run));
        }
        if (runs_.empty() && good()) logs_.problem(0, "has no test of WPILib SysId, expected one of " + all);
        const bool there =
            std::any_of(runs_.begin(), runs_.end(), [&](const Run& r) { return r.test->key == run_; });
        if (good() && !run_.empty() && !there)
            logs_.problem(0, "has no test called " + run_ + ", expected one of " + all);
    }

    void take_rows(const Json& rows, Run& run) {
        const auto wrong = [&](std::size_t row, const std::string& what) {
            logs_.problem(row, std::string(run.test->key) + ": " + what);
        };
        for (std::size_t r = 0; r < rows.size(); ++r) {
            const Json& row = rows[r];
            if (!row.is_array() || (row.size() != kLayout2020.width && row.size() != kLayoutSysId.width)) {
                wrong(
                    r + 1,
                    "found " + (row.is_array() ? std::to_string(row.size()) + " numbers" : row.dump()) +
                        ", expected a row of 9 (SysId) or 10 (frc-characterization) numbers of a drivetrain");
                return;
            }
            const Layout& layout = row.size() == kLayout2020.width ? kLayout2020 : kLayoutSysId;
            if (layout_ != nullptr && layout_ != &layout) {
                wrong(r + 1, "found " + std::to_string(row.size()) + " numbers, expected " +
                                 std::to_string(layout_->width) + " as in the rows before");
                return;
            }
            layout_ = &layout;
            Row values;
            for (std::size_t c = 0; c < row.size(); ++c) {
                if (!row[c].is_number()) {
                    wrong(r + 1, "column " + std::to_string(c + 1) + ": found " + row[c].dump() +
                                     ", expected a number");
                    return;
                }
                values.push_back(row[c].get<double>());
            }
            run.rows.push_back(std::move(values));
        }
    }

    // How many radians one of the file's positions is, for each wheel.
    void find_units(const Json& file) {
        const Json units = file.value("units", Json());
        const Json per_rotation = file.value("unitsPerRotation", Json());
        if (units.is_null() && per_rotation.is_null()) {
            const std::string unit = reading_.position_unit.empty() ? "m" : reading_.position_unit;
            logs_.note(0, "assumed: positions are in " + unit +
                              ", as the file does not say; --position-unit says otherwise");
            set_unit(unit);
            return;
        }
        if (!units.is_string() || !per_rotation.is_number() || !(per_rotation.get<double>() > 0)) {
            logs_.problem(0, "\"units\" is " + units.dump() + " and \"unitsPerRotation\" " +
                                 per_rotation.dump() + ", expected a text and a number greater than 0");
            return;
        }
        static constexpr std::array<std::pair<std::string_view, std::string_view>, 6> kUnits{{
            {"Meters", "m"},
            {"Feet", "ft"},
            {"Inches", "in"},
            {"Degrees", "deg"},
            {"Radians", "rad"},
            {"Rotations", "rot"},
        }};
        const std::string name = units.get<std::string>();
        const auto* const unit =
            std::find_if(kUnits.begin(), kUnits.end(), [&](const auto& u) { return u.first == name; });
        if (unit == kUnits.end()) {
            logs_.problem(0, "\"units\" is " + units.dump() +
                                 ", expected Meters, Feet, Inches, Degrees, Radians or Rotations");
            return;
        }
        set_unit(unit->second);
        const double turn = per_rotation.get<double>() * rad_per_unit_.left / (2 * std::numbers::pi);
        if (good() && std::abs(turn - 1) > 0.02) {
            logs_.note(0, "one rotation is " + number_text(per_rotation.get<double>(), 4) + " " + name +
                              " in this file, which is " + number_text(turn, 4) +
                              " turns of the left wheel with the radius given");
        }
        rad_per_unit_.left *= per_rotation.get<double>();
        rad_per_unit_.right *= per_rotation.get<double>();
    }

    void set_unit(std::string_view unit) {
        for (double WheelPair<double>::*side : {&WheelPair<double>::left, &WheelPair<double>::right}) {
            const Factor factor =
                factor_to_si(Quantity::angle, unit, reading_, reading_.wheel_radius_m.*side);
            if (!factor.problem.empty()) {
                logs_.problem(0, "positions: " + factor.problem);
                return;
            }
            rad_per_unit_.*side = factor.value;
        }
    }

    // +1 or -1: where a wheel has to go in a row of a run.
    double direction(const Run& run, const Row& row, std::size_t side) const {
        const bool back = run.test->direction == Direction::backward ||
                          (run.test->direction == Direction::commanded && layout_->command != kNone &&
                           row[layout_->command] < 0);
        return (back ? -1 : 1) * (run.turns && side == 0 ? -1 : 1);
    }

    // The tools log what motors and sensors say, which are often mounted turned; and some robots logged the
    // volts' magnitude. The tests' names say which way the wheels went.
    void find_signs() {
        static constexpr std::array kSides{"left", "right"};
        const std::array positions{layout_->left_position, layout_->right_position};
        const std::array volts{layout_->left_V, layout_->right_V};
        for (std::size_t side = 0; side < 2; ++side) {
            double travelled = 0;
            double driven = 0;
            bool negative = false;
            for (const Run& run : runs_) {
                travelled += direction(run, run.rows.back(), side) *
                             (run.rows.back()[positions[side]] - run.rows.front()[positions[side]]);
                for (const Row& row : run.rows) {
                    driven += direction(run, row, side) * row[volts[side]];
                    negative = negative || row[volts[side]] < 0;
                }
            }
            const bool both_ways = std::any_of(runs_.begin(), runs_.end(), [&](const Run& run) {
                return direction(run, run.rows.back(), side) < 0;
            });
            sensor_sign_[side] = travelled < 0 ? -1 : 1;
            volts_sign_[side] = driven < 0 ? -1 : 1;
            volts_are_magnitudes_[side] = both_ways && !negative;
            const std::string wheel = kSides[side];
            if (sensor_sign_[side] < 0)
                logs_.note(0, "assumed: the " + wheel +
                                  " sensor is turned, as the wheel goes against the tests' names");
            if (volts_are_magnitudes_[side]) {
                logs_.note(0, "assumed: the " + wheel +
                                  " volts, which are never negative, drive the way of the tests' names");
            } else if (volts_sign_[side] < 0) {
                logs_.note(
                    0, "assumed: the " + wheel + " volts are turned, as they go against the tests' names");
            }
        }
    }

    RawLog raw_log(const Run& run) const {
        const Layout& l = *layout_;
        RawLog raw;
        raw.run = run.test->key;
        std::replace(raw.run.begin(), raw.run.end(), '-', '_');
        raw.angles = !reading_.reported_speeds;
        raw.gyro_is_angle = l.yaw_rate == kNone && raw.angles;
        const std::size_t gyro = l.yaw_rate == kNone ? l.angle : l.yaw_rate;
        const double first_angle = run.rows.front()[l.angle];
        // a gyro that never moves is none
        raw.has_gyro = (raw.gyro_is_angle || l.yaw_rate != kNone) &&
                       std::any_of(run.rows.begin(), run.rows.end(),
                                   [&](const Row& row) { return row[l.angle] != first_angle; });
        const auto volts = [&](const Row& row, std::size_t side, std::size_t place) {
            const double there = *reading_.torque_per_volt_Nm * row[place];
            return volts_are_magnitudes_[side] ? direction(run, row, side) * std::abs(there)
                                               : volts_sign_[side] * there;
        };
        for (std::size_t r = 0; r < run.rows.size(); ++r) {
            const Row& row = run.rows[r];
            RawSample sample;
            sample.t_s = row[0];
            sample.torque_Nm = {volts(row, 0, l.left_V), volts(row, 1, l.right_V)};
            const std::size_t left = raw.angles ? l.left_position : l.left_rate;
            const std::size_t right = raw.angles ? l.right_position : l.right_rate;
            sample.wheel = {sensor_sign_[0] * rad_per_unit_.left * row[left],
                            sensor_sign_[1] * rad_per_unit_.right * row[right]};
            if (raw.has_gyro) sample.gyro = row[gyro];
            sample.line = r + 1;
            raw.samples.push_back(sample);
        }
        return raw;
    }

    const LogReading& reading_;
    std::string run_;
    MeasuredLogs logs_;
    std::vector<Run> runs_;
    const Layout* layout_ = nullptr;
    WheelPair<double> rad_per_unit_;
    std::array<double, 2> sensor_sign_{1, 1}, volts_sign_{1, 1};
    std::array<bool, 2> volts_are_magnitudes_{};
};

}  // namespace

MeasuredLogs read_sysid_json(const std::string& text, const LogReading& reading, const std::string& run) {
    return SysIdReader(reading, run).read(text);
}

}  // namespace wheelwright::tools
