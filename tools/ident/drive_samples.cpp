#include "tools/ident/drive_samples.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <span>

#include "drivers/odrive/odrive_drive.hpp"
#include "firmware/ident/delay_estimator.hpp"
#include "firmware/ident/sizing.hpp"
#include "firmware/task/cycle_schedule.hpp"
#include "firmware/task/learning.hpp"
#include "tools/logs/read_measured.hpp"

namespace wheelwright::tools {
namespace {

constexpr std::ptrdiff_t kFewestCyclesPerSample = 4;  // of 1 ms, each with its encoder's noise
constexpr double kShortestStretch_s = 1;
constexpr double kUsualBit_s = 0.02;  // a log does not say which bits it was driven with

// Integral from -inf of the triangle of width 2 and area 1 around 0.
double below_triangle(double x) {
    if (x <= -1) return 0;
    if (x >= 1) return 1;
    return x < 0 ? (1 + x) * (1 + x) / 2 : 1 - (1 - x) * (1 - x) / 2;
}

// Weights of the torques told in a run of cycles, counted from the sample's angle.
struct TorqueWeights {
    std::ptrdiff_t first = 0;
    std::vector<double> weight;

    // An angle is `age` cycles older than its cycle; a command acts for one cycle, from `delay` on.
    TorqueWeights(std::ptrdiff_t period, double age, double delay) {
        const auto p = static_cast<double>(period);
        const double centre = p / 2 - age - delay;
        first = static_cast<std::ptrdiff_t>(std::floor(centre - p - 1));
        const auto last = static_cast<std::ptrdiff_t>(std::ceil(centre + p));
        for (std::ptrdiff_t m = first; m <= last; ++m) {
            const double from = (static_cast<double>(m) - centre) / p;
            weight.push_back(below_triangle(from + 1 / p) - below_triangle(from));
        }
    }
};

// What a first-order lag makes of a torque that each cycle holds, as means over cycles.
class TorqueLag {
  public:
    explicit TorqueLag(double lag_s)
        : cycles_(task::kCyclePeriod_s / std::max(lag_s, 1e-9)), end_(std::exp(-cycles_)) {}
    void restart(double torque) {
        torque_ = torque;
        off_ = 0;
    }
    double mean(double torque) {
        off_ += torque_ - torque;
        torque_ = torque;
        const double mean = off_ * (1 - end_) / cycles_;
        off_ *= end_;
        return torque + mean;
    }

  private:
    double cycles_, end_, torque_ = 0, off_ = 0;
};

// Cycles for one sample: long enough that the encoders' noise, which is shared out over them, is small beside
// the usual speed, for friction, centripetal terms and standstill are made of speeds. No longer than a bit.
std::ptrdiff_t cycles_per_sample(const DriveLog& log, std::ptrdiff_t fewest) {
    constexpr double kSmall = 0.05;
    constexpr auto kMost =
        static_cast<std::ptrdiff_t>((kUsualBit_s + task::kCyclePeriod_s / 2) / task::kCyclePeriod_s);
    const AngleNoise seen = angle_noise(log, fewest);
    // the difference of two angles has twice the variance of one
    const double speed =
        std::sqrt(std::max(0.0, seen.moved_rad2 - 2 * seen.noise_rad2)) / static_cast<double>(fewest);
    if (!(kSmall * speed > 0)) return fewest;
    const double wanted = std::sqrt(2 * seen.noise_rad2) / (kSmall * speed);
    const auto even = 2 * static_cast<std::ptrdiff_t>(std::ceil(std::min(wanted, double(kMost)) / 2));
    return std::max(fewest, even);
}

// What was told in each cycle, through the drives' lag.
std::vector<WheelPair<double>> torques_Nm(const DriveLog& log, double lag_s) {
    std::vector<WheelPair<double>> made;
    made.reserve(log.cycles.size());
    WheelPair<TorqueLag> lag{TorqueLag(lag_s), TorqueLag(lag_s)};
    for (const DriveLog::Cycle& cycle : log.cycles) {
        const WheelPair<double>& told = cycle.sample.last_torque_Nm;
        if (cycle.restart) {
            lag.left.restart(told.left);
            lag.right.restart(told.right);
        }
        made.push_back({lag.left.mean(told.left), lag.right.mean(told.right)});
    }
    return made;
}

}  // namespace

AngleNoise angle_noise(const DriveLog& log, std::ptrdiff_t spacing) {
    const std::span<const DriveLog::Cycle> cycles = log.cycles;
    AngleNoise seen;
    double count = 0;
    std::ptrdiff_t run = 0;
    for (std::size_t i = 0; i < cycles.size(); ++i) {
        run = !cycles[i].sample.usable ? 0 : cycles[i].restart ? 1 : run + 1;
        if (run <= 3 * spacing) continue;
        const auto angle = [&](std::ptrdiff_t back) {
            return cycles[i - static_cast<std::size_t>(back * spacing)].sample.angle_rad;
        };
        for (double WheelPair<double>::*side : {&WheelPair<double>::left, &WheelPair<double>::right}) {
            const double first = angle(0).*side - angle(1).*side;
            // third differences: 20 times the variance of what is white
            const double third =
                first - 2 * (angle(1).*side - angle(2).*side) + angle(2).*side - angle(3).*side;
            seen.noise_rad2 += third * third / 20;
            seen.moved_rad2 += first * first;
            ++count;
        }
    }
    seen.noise_rad2 /= std::max(count, 1.0);
    seen.moved_rad2 /= std::max(count, 1.0);
    return seen;
}

ident::RegressionFilterOptions<double> filter_options(const model::RobotParameters& robot) {
    return task::regression_filter_options<double>(
        robot, robot.ident.kernel_s > 0 ? robot.ident.kernel_s
                                        : ident::kernel_for_bit_s(kUsualBit_s, task::kCyclePeriod_s));
}

Arrival arrival_of(const DriveLog& log, const model::RobotParameters& robot) {
    const Arrival filed{robot.velocity_loop.actuation_delay_s, 0, false};
    if (model::effects_delay_s(robot.effects) > 0) return filed;
    ident::RegressionFilterOptions<double> options = filter_options(robot);
    // beside friction, whether the file has it or not
    for (const char* name : {"viscous_friction", "coulomb_friction"})
        options.effects.active[model::find_effect(name)] = true;
    ident::DelayEstimator<double> estimator;
    estimator.configure(options);
    for (const DriveLog::Cycle& cycle : log.cycles) {
        if (cycle.restart) estimator.restart();
        estimator.push(cycle.sample);
    }
    const ident::DelayEstimate<double> found = estimator.estimate();
    const double delay_s = found.delay_s - options.sample_age_s;
    if (!found.valid || std::abs(delay_s - filed.delay_s) > task::kCyclePeriod_s) return filed;
    return {delay_s, std::min(found.lag_s, delay_s), true};
}

std::vector<MeasuredLog> even_samples(const DriveLog& log, const model::RobotParameters& robot,
                                      const Arrival& arrival) {
    std::vector<MeasuredLog> made;
    const double cycle_s = task::kCyclePeriod_s;
    const double age = task::Senses::sample_age_s(robot) / cycle_s;
    const auto encoder =
        static_cast<std::ptrdiff_t>(std::ceil(1e-3 * robot.drive.encoder_period_ms / cycle_s));
    const std::ptrdiff_t period = cycles_per_sample(log, std::max(kFewestCyclesPerSample, 2 * encoder));
    const std::ptrdiff_t half = period / 2;
    const TorqueWeights torque(period, age, (arrival.delay_s - arrival.lag_s) / cycle_s);
    const auto before = std::max(half, -torque.first);  // cycles needed before a sample
    const std::span<const DriveLog::Cycle> cycles = log.cycles;
    const std::vector<WheelPair<double>> told_Nm = torques_Nm(log, arrival.lag_s);
    bool any = false;
    double first_heading_rad = 0;
    for (std::size_t begin = 0; begin < cycles.size();) {
        std::size_t end = begin;
        while (end < cycles.size() && cycles[end].sample.usable && (end == begin || !cycles[end].restart))
            ++end;
        const std::span<const DriveLog::Cycle> run = cycles.subspan(begin, end - begin);
        const std::span run_Nm = std::span(told_Nm).subspan(begin, end - begin);
        begin = std::max(end, begin + 1);
        const auto length = static_cast<std::ptrdiff_t>(run.size());
        if (static_cast<double>(length) * cycle_s < kShortestStretch_s) continue;
        MeasuredLog stretch;
        stretch.by_angles = true;
        stretch.period_s = static_cast<double>(period) * cycle_s;
        const auto angle = [&](std::ptrdiff_t n) {
            return run[static_cast<std::size_t>(n)].sample.angle_rad;
        };
        for (std::ptrdiff_t n = before; n + half < length; n += period) {
            MeasuredSample sample;
            const DriveLog::Cycle& cycle = run[static_cast<std::size_t>(n)];
            sample.t_s = 1e-9 * static_cast<double>(cycle.start_ns - log.first_time_ns) - age * cycle_s;
            const WheelPair<double> a = angle(n - half);
            const WheelPair<double> b = angle(n + half);
            sample.speed_rad_per_s = {(b.left - a.left) / stretch.period_s,
                                      (b.right - a.right) / stretch.period_s};
            for (std::size_t i = 0; i < torque.weight.size(); ++i) {
                // what was told in a cycle stands in the one after it
                const std::ptrdiff_t told = n + torque.first + static_cast<std::ptrdiff_t>(i) + 1;
                const std::ptrdiff_t at = std::clamp<std::ptrdiff_t>(told, 0, length - 1);
                const WheelPair<double>& t = run_Nm[static_cast<std::size_t>(at)];
                sample.torque_Nm.left += torque.weight[i] * t.left;
                sample.torque_Nm.right += torque.weight[i] * t.right;
            }
            if (stretch.samples.empty()) {
                if (!any) first_heading_rad = cycle.sample.heading_rad;
                any = true;
                stretch.start_heading_rad = cycle.sample.heading_rad - first_heading_rad;
            }
            stretch.samples.push_back(sample);
        }
        made.push_back(std::move(stretch));
    }
    return made;
}

SampledLog read_sampled_log(const std::string& path, const std::optional<model::RobotParameters>& robot,
                            const LogReading& reading) {
    SampledLog read;
    const auto say = [&](std::vector<std::string>& to, const std::vector<LineProblem>& from) {
        for (const LineProblem& line : from) to.push_back(to_text(path, line));
    };
    if (!is_candump(path).value_or(false)) {
        MeasuredLogs measured = read_measured_log(path, reading);
        say(read.problems, measured.problems);
        say(read.notes, measured.notes);
        if (read.problems.empty()) read.logs = std::move(measured.segments);
        return read;
    }
    if (!robot) {
        read.problems.push_back(
            path + ": a candump log needs --model ROBOT.toml: nodes, signs and gears stand there");
        return read;
    }
    const DriveLog log = read_drive_log(path, *robot);
    say(read.notes, log.notes);
    say(read.problems, log.problems);
    if (!read.problems.empty()) return read;
    const auto note = [&](const char* format, double first, double second) {
        std::array<char, 160> text{};
        std::snprintf(text.data(), text.size(), format, first, second);
        read.notes.push_back(path + ": " + text.data());
    };
    if (const WheelPair<double>& lag = log.encoder_lag_s; lag.left > 0 && lag.right > 0) {
        note(
            "the drives' encoder loops have %.3g (left) and %.3g rad/s (right), by what they report: "
            "the angles are those before them",
            1 / lag.left, 1 / lag.right);
    }
    const Arrival arrival = arrival_of(log, *robot);
    if (arrival.by_log) {
        note(
            "the torques act %.3g ms after their cycles' starts, %.3g ms of which are a lag, by what the "
            "wheels do",
            1e3 * arrival.delay_s, 1e3 * arrival.lag_s);
    }
    read.logs = even_samples(log, *robot, arrival);
    if (read.logs.empty()) {
        read.problems.push_back(path +
                                ": holds no second in which both drives were in closed loop, heard and told");
    }
    return read;
}

}  // namespace wheelwright::tools
