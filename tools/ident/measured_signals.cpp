#include "tools/ident/measured_signals.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/cli/report.hpp"
#include "tools/logs/read_measured.hpp"

namespace wheelwright::tools {
namespace {

constexpr double kStandingShare = 0.02;  // of the fastest wheel speed: slower counts as standing still
constexpr double kStandingShareNoisy = 0.1;
constexpr double kFineReversal_s = 0.004;  // samples closer than this see a reversal well enough
constexpr double kMostReversals = 0.4;     // of the intervals
constexpr double kSteadyTorque = 1e-4;     // share of the largest torque by which a steady one may vary
constexpr double kStuckShare = 0.2;        // of a log: more readings at the sensor's limit make it useless
constexpr double kStuck_s = 0.1;
constexpr std::size_t kStuckSamples = 8;

using Side = double WheelPair<double>::*;
constexpr std::array<Side, 2> kSides{&WheelPair<double>::left, &WheelPair<double>::right};
constexpr std::array<const char*, 2> kSpeedColumns{"omega_left_rad_s", "omega_right_rad_s"};

class Signals {
  public:
    explicit Signals(Findings& findings) : findings_(findings) {}

    MeasuredSignals look(const std::vector<std::string>& paths, const LogReading& reading) {
        for (const std::string& path : paths) read(path, reading);
        if (good()) want_one_rate();
        if (good()) look_at_speeds();
        if (good()) look_at_torque();
        return std::move(found_);
    }

  private:
    bool good() const { return findings_.problems.empty(); }

    void problem(const std::string& path, std::size_t line, const std::string& text) {
        findings_.problems.push_back(to_text(path, {line, text}));
    }

    void read(const std::string& path, const LogReading& reading) {
        MeasuredLogs measured = read_measured_log(path, reading);
        for (const LineProblem& each : measured.problems) findings_.problems.push_back(to_text(path, each));
        for (const LineProblem& each : measured.notes) findings_.notes.push_back(to_text(path, each));
        if (measured.problem_count > measured.problems.size()) {
            problem(path, 0,
                    "and " + std::to_string(measured.problem_count - measured.problems.size()) + " more");
        }
        if (measured.problem_count > 0) return;
        LogFacts facts{path, log_form(path) == LogForm::sysid_json ? "SysId" : "CSV",
                       log_date(measured.segments.front().samples.front().t_s)};
        for (MeasuredLog& log : measured.segments) {
            facts.duration_s += log.period_s * static_cast<double>(log.samples.size() - 1);
            facts.rate_Hz = 1 / log.period_s;
            facts.samples += log.samples.size();
            found_.logs.push_back(std::move(log));
            found_.names.push_back(path);
        }
        findings_.logs.push_back(std::move(facts));
    }

    void want_one_rate() {
        for (std::size_t i = 1; good() && i < found_.logs.size(); ++i) {
            if (std::abs(found_.logs[i].period_s - found_.logs[0].period_s) >
                0.02 * found_.logs[0].period_s) {
                problem(found_.names[i], 0,
                        "is sampled every " + number_text(found_.logs[i].period_s) + " s and " +
                            found_.names[0] + " every " + number_text(found_.logs[0].period_s) +
                            " s; logs of one experiment need one rate");
            }
        }
    }

    // Sensor noise, wheels that stand, readings that are stuck.
    void look_at_speeds() {
        double peak = 0;
        std::array<double, 2> third_power{};
        double third_count = 0;
        for (const MeasuredLog& log : found_.logs) {
            const auto& s = log.samples;
            for (std::size_t i = 0; i < s.size(); ++i) {
                for (std::size_t w = 0; w < 2; ++w) {
                    const Side side = kSides[w];
                    peak = std::max(peak, std::abs(s[i].speed_rad_per_s.*side));
                    if (i < 3) continue;
                    const double third = s[i].speed_rad_per_s.*side - 3 * s[i - 1].speed_rad_per_s.*side +
                                         3 * s[i - 2].speed_rad_per_s.*side - s[i - 3].speed_rad_per_s.*side;
                    third_power[w] += third * third;
                }
                if (i >= 3) third_count += 1;
            }
        }
        for (std::size_t w = 0; w < 2; ++w) found_.speed_noise_power[w] = third_power[w] / third_count / 20;
        if (!(peak > 0)) {
            problem(found_.names[0], 0, "the wheels never turn: nothing can be identified");
            return;
        }
        const double noise = std::sqrt(std::max(found_.speed_noise_power[0], found_.speed_noise_power[1]));
        standing_ = std::clamp(2 * noise, kStandingShare * peak, kStandingShareNoisy * peak);
        for (std::size_t l = 0; l < found_.logs.size(); ++l) {
            SpeedRun run;
            run.log = &found_.logs[l];
            run.left_out.assign(found_.logs[l].samples.size() - 1, false);
            for (const Side side : kSides) leave_out_standing(run, side);
            for (std::size_t w = 0; w < 2; ++w) leave_out_stuck(run, l, w);
            found_.runs.push_back(std::move(run));
        }
        leave_out_reversals();
    }

    // Where a wheel reverses between two samples, dry friction steps at an instant that is hard to tell from
    // a slow log: such intervals are left out where enough remains.
    void leave_out_reversals() {
        if (found_.logs[0].period_s < kFineReversal_s) return;
        std::vector<std::vector<bool>> without;
        double usable = 0;
        double reversals = 0;
        for (const SpeedRun& run : found_.runs) {
            without.push_back(run.left_out);
            const auto& s = run.log->samples;
            for (std::size_t i = 0; i + 1 < s.size(); ++i) {
                if (run.left_out[i]) continue;
                usable += 1;
                for (const Side side : kSides) {
                    if (s[i].speed_rad_per_s.*side * s[i + 1].speed_rad_per_s.*side < 0)
                        without.back()[i] = true;
                }
                reversals += without.back()[i] ? 1 : 0;
            }
        }
        if (reversals > kMostReversals * usable) return;
        for (std::size_t r = 0; r < found_.runs.size(); ++r) found_.runs[r].left_out = without[r];
    }

    void leave_out_standing(SpeedRun& run, Side side) const {
        const auto& s = run.log->samples;
        for (std::size_t i = 0; i + 1 < s.size(); ++i) {
            if (std::max(std::abs(s[i].speed_rad_per_s.*side), std::abs(s[i + 1].speed_rad_per_s.*side)) <
                standing_) {
                run.left_out[i] = true;
            }
        }
    }

    // The same moving reading again and again while the torque changes: a sensor at its limit, or frozen.
    void leave_out_stuck(SpeedRun& run, std::size_t log_index, std::size_t wheel) {
        const auto& s = run.log->samples;
        const Side side = kSides[wheel];
        double largest_torque = 0;
        for (const MeasuredSample& each : s) {
            largest_torque = std::max(largest_torque, std::abs(each.torque_Nm.*side));
        }
        const auto least = std::max(kStuckSamples, static_cast<std::size_t>(kStuck_s / run.log->period_s));
        std::size_t stuck = 0;
        std::size_t first_line = 0;
        for (std::size_t begin = 0; begin < s.size();) {
            std::size_t end = begin;
            double low = s[begin].torque_Nm.*side;
            double high = low;
            while (end < s.size() && s[end].speed_rad_per_s.*side == s[begin].speed_rad_per_s.*side) {
                low = std::min(low, s[end].torque_Nm.*side);
                high = std::max(high, s[end].torque_Nm.*side);
                ++end;
            }
            const bool moving = std::abs(s[begin].speed_rad_per_s.*side) >= standing_;
            if (end - begin >= least && moving && high - low > 0.1 * largest_torque) {
                if (stuck == 0) first_line = run.log->lines[begin];
                stuck += end - begin;
                for (std::size_t i = begin; i < end && i < run.left_out.size(); ++i) run.left_out[i] = true;
            }
            begin = end;
        }
        if (stuck == 0) return;
        const std::string what =
            std::string(kSpeedColumns[wheel]) +
            " repeats one value while the torque changes: the sensor is saturated or frozen (" +
            std::to_string(stuck) + " samples)";
        if (static_cast<double>(stuck) > kStuckShare * static_cast<double>(s.size())) {
            problem(found_.names[log_index], first_line, what);
        } else {
            findings_.notes.push_back(to_text(found_.names[log_index], {first_line, what + ": left out"}));
        }
    }

    void look_at_torque() {
        constexpr double kInfinite = std::numeric_limits<double>::infinity();
        WheelPair<double> low{kInfinite, kInfinite};
        WheelPair<double> high{-kInfinite, -kInfinite};
        for (const MeasuredLog& log : found_.logs) {
            for (const MeasuredSample& s : log.samples) {
                for (const Side side : kSides) {
                    low.*side = std::min(low.*side, s.torque_Nm.*side);
                    high.*side = std::max(high.*side, s.torque_Nm.*side);
                }
            }
        }
        const double largest =
            std::max({std::abs(low.left), std::abs(low.right), std::abs(high.left), std::abs(high.right)});
        if (!(largest > 0)) {
            problem(found_.names[0], 2, "the torque is zero in every line: nothing can be identified");
        } else if (std::max(high.left - low.left, high.right - low.right) <= kSteadyTorque * largest) {
            problem(
                found_.names[0], 2,
                "the torque is constant (" + number_text(low.left, 4) + " Nm left, " +
                    number_text(low.right, 4) +
                    " Nm right in every line): inertia and friction cannot be told apart without changes");
        }
    }

    Findings& findings_;
    MeasuredSignals found_;
    double standing_ = 0;
};

}  // namespace

MeasuredSignals look_at_measured_logs(const std::vector<std::string>& paths, const LogReading& reading,
                                      Findings& findings) {
    return Signals(findings).look(paths, reading);
}

}  // namespace wheelwright::tools
