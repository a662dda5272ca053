#include "tools/gap/report/held_out.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "tools/gap/logs/experiment.hpp"

namespace wheelwright::gap {
namespace {

using tools::MeasuredLog;

// Windows follow each other and share a sample; what is left at the end is not run.
struct Windows {
    std::size_t length = 0;  // in samples
    std::size_t count = 0;
};

SpeedError error_of(const SimulatedRobot& robot, const LogPart& part, const Windows& windows,
                    const std::vector<double>& heading_rad) {
    const MeasuredLog& log = *part.log;
    double both = 0;
    double forward = 0;
    for (std::size_t w = 0; w < windows.count; ++w) {
        const std::size_t from = part.first + w * (windows.length - 1);
        both += free_run(robot, {&log, from, from + windows.length, heading_rad[from - part.first]},
                         log.samples[from].speed_rad_per_s,
                         [&](std::size_t i, const WheelPair<double>& simulated) {
                             const WheelPair<double>& measured = log.samples[i].speed_rad_per_s;
                             forward += std::pow((simulated.sum() - measured.sum()) / 2, 2);
                         });
    }
    const auto count = static_cast<double>(windows.count * (windows.length - 1));
    return {std::sqrt(both / (2 * count)), std::sqrt(forward / count)};
}

// Samples `from` to before `to` of a log; there is one at `to`.
double torque_missing_Nm(const SimulatedRobot& robot, const MeasuredLog& log,
                         const std::vector<double>& heading_rad, std::size_t from, std::size_t to) {
    const model::Geometry<double>& geometry = robot.geometry;
    const model::Dynamics<double>& k = robot.dynamics;
    double torque = 0;
    double product = 0;
    for (std::size_t i = from; i < to; ++i) {
        model::Motion<double> m;
        m.wheel_speed_rad_per_s = log.samples[i].speed_rad_per_s;
        m.twist = model::twist_from_wheel_speeds(geometry, m.wheel_speed_rad_per_s);
        m.heading_rad = heading_rad[i];
        const model::EffectContext<double> context{m, log.samples[i].torque_Nm, geometry, k};
        const WheelPair<double> smooth = model::smooth_effect_torque_Nm(robot.effects, context);
        torque += model::delivered_torque_Nm(robot.effects, context).sum() + smooth.sum();
        model::for_each_dry(robot.effects, geometry,
                            [&](std::size_t, unsigned, const WheelPair<double>& d, double limit) {
                                const double s = model::sliding_speed(d, m.wheel_speed_rad_per_s);
                                torque -= limit * (s > 0 ? 1.0 : s < 0 ? -1.0 : 0.0) * d.sum();
                            });
        product += m.twist.omega_rad_per_s * m.twist.omega_rad_per_s;
    }
    const double n = double(to - from);
    const double gained =
        model::twist_from_wheel_speeds(geometry, log.samples[to].speed_rad_per_s).v_m_per_s -
        model::twist_from_wheel_speeds(geometry, log.samples[from].speed_rad_per_s).v_m_per_s;
    return ((gained / (n * log.period_s) - k.k5_m * product / n) / k.k7_per_kg_m - torque / n) / 2;
}

}  // namespace

std::vector<FreeRun> free_runs(const LogPart& part, const Models& models) {
    const std::size_t samples = part.end - part.first;
    const std::vector<double> heading = headings_rad(part, models.after.geometry);
    // Farther off than a robot that stands: it runs away, and how far is no figure.
    const double standing_rad_per_s = speed_rms_rad_per_s(part);
    const auto error = [&](const SimulatedRobot& robot, const Windows& windows) {
        const SpeedError e = error_of(robot, part, windows, heading);
        constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
        return e.both < standing_rad_per_s ? e : SpeedError{kNone, kNone};
    };
    std::vector<FreeRun> runs;
    for (const double window_s : {1.0, 5.0, 10.0, 0.0}) {
        Windows windows{samples};
        if (window_s > 0)
            windows.length = static_cast<std::size_t>(std::lround(window_s / part.log->period_s)) + 1;
        if (windows.length > samples) continue;
        windows.count = (samples - 1) / (windows.length - 1);
        FreeRun run;
        run.window_s = window_s;
        run.windows = windows.count;
        if (models.nominal) run.nominal = error(*models.nominal, windows);
        run.before = error(models.before, windows);
        run.after = error(models.after, windows);
        runs.push_back(run);
    }
    return runs;
}

void free_run_of(const LogPart& part, const SimulatedRobot& robot, const TakeSpeeds& take) {
    free_run(robot, {part.log, part.first, part.end, part.initial_heading_rad},
             part.log->samples[part.first].speed_rad_per_s, take);
}

Trace trace_of(const LogPart& part, const Models& models) {
    constexpr double kShown_s = 10;
    const MeasuredLog& log = *part.log;
    const std::size_t end =
        std::min(part.end, part.first + static_cast<std::size_t>(kShown_s / log.period_s));
    const Stretch shown{&log, part.first, end, part.initial_heading_rad};
    const WheelPair<double>& start = log.samples[part.first].speed_rad_per_s;
    Trace trace;
    free_run(models.before, shown, start, [&](std::size_t i, const WheelPair<double>& simulated) {
        trace.t_s.push_back(log.samples[i].t_s);
        trace.measured.push_back(log.samples[i].speed_rad_per_s.left);
        trace.before.push_back(simulated.left);
    });
    free_run(models.after, shown, start,
             [&](std::size_t, const WheelPair<double>& simulated) { trace.after.push_back(simulated.left); });
    return trace;
}

double speed_rms_rad_per_s(const LogPart& part) {
    double power = 0;
    for (std::size_t i = part.first; i < part.end; ++i) {
        const WheelPair<double>& speed = part.log->samples[i].speed_rad_per_s;
        power += speed.left * speed.left + speed.right * speed.right;
    }
    return std::sqrt(power / (2.0 * double(part.end - part.first)));
}

Curve torque_missing(std::span<const MeasuredLog> logs, const Models& models) {
    constexpr std::size_t kBins = 24;
    constexpr double kFewest = 5;  // points, that a bin is shown with
    constexpr double kSpan_s = 0.1;
    struct Point {
        double speed_rad_per_s = 0, before_Nm = 0, after_Nm = 0;
    };
    std::vector<Point> points;
    double fastest = 0;
    for (const MeasuredLog& log : logs) {
        const LogPart whole{&log, 0, 0, log.samples.size(), log.start_heading_rad};
        const std::vector<double> heading = headings_rad(whole, models.after.geometry);
        const auto span = static_cast<std::size_t>(std::max(1.0, std::round(kSpan_s / log.period_s)));
        for (std::size_t from = 0; from + span < log.samples.size(); from += span) {
            const std::size_t to = from + span;
            double speed = 0;
            for (std::size_t i = from; i < to; ++i) speed += log.samples[i].speed_rad_per_s.sum() / 2;
            speed /= double(span);
            fastest = std::max(fastest, std::abs(speed));
            points.push_back({speed, torque_missing_Nm(models.before, log, heading, from, to),
                              torque_missing_Nm(models.after, log, heading, from, to)});
        }
    }
    struct Bin {
        double count = 0;
        Point sum;
    };
    std::array<Bin, kBins> bins;
    for (const Point& p : points) {
        const double share = fastest > 0 ? (p.speed_rad_per_s / fastest + 1) / 2 : 0.5;
        Bin& bin = bins[std::min(kBins - 1, static_cast<std::size_t>(share * double(kBins)))];
        bin.count += 1;
        bin.sum.speed_rad_per_s += p.speed_rad_per_s;
        bin.sum.before_Nm += p.before_Nm;
        bin.sum.after_Nm += p.after_Nm;
    }
    Curve curve;
    for (const Bin& bin : bins) {
        if (bin.count < kFewest) continue;
        curve.x.push_back(bin.sum.speed_rad_per_s / bin.count);
        curve.before.push_back(bin.sum.before_Nm / bin.count);
        curve.after.push_back(bin.sum.after_Nm / bin.count);
    }
    return curve;
}

}  // namespace wheelwright::gap
