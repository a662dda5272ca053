#include "tools/gap/logs/experiment.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <limits>

#include "tools/ident/drive_samples.hpp"

namespace wheelwright::gap {
namespace {

using tools::MeasuredLog;
using tools::MeasuredSample;

constexpr double kTurningOverNoise = 9;  // power of the yaw rate over that of its noise
constexpr double kLeastOfTorques =
    0.01;  // sum over difference, or the reverse: with less none is driven, or turned
constexpr double kHeldOutShare = 0.2;
constexpr double kBackwards = 0.1;  // of the fastest: slower than this is noise, or a robot that rolls back
constexpr std::array kSides = {&WheelPair<double>::left, &WheelPair<double>::right};

std::string words_of(const LogFault& fault) {
    std::array<char, 160> text{};
    std::snprintf(text.data(), text.size(), "%s: %zu samples (%.3g %%), the first at %.3f s; %s",
                  fault.name.c_str(), fault.count, 100 * fault.rate, fault.first_s,
                  fault.name == "log_outliers" ? "put between their neighbours" : "left out");
    return text.data();
}

double duration_s(const MeasuredLog& log) { return log.period_s * double(log.samples.size() - 1); }

double turned_rad(const MeasuredLog& log, double WheelPair<double>::*side) {
    double angle = 0;
    double least = 0;
    double most = 0;
    for (const MeasuredSample& s : log.samples) {
        angle += log.period_s * s.speed_rad_per_s.*side;
        least = std::min(least, angle);
        most = std::max(most, angle);
    }
    return most - least;
}

// What the torques do, and noise does not. `overview` has the noise.
void set_motions(std::span<const MeasuredLog> logs, const model::Geometry<double>& geometry,
                 Overview& overview) {
    double yaw = 0;
    double apart = 0;
    double together = 0;
    double count = 0;
    for (const MeasuredLog& log : logs) {
        for (const MeasuredSample& s : log.samples) {
            yaw += std::pow(model::twist_from_wheel_speeds(geometry, s.speed_rad_per_s).omega_rad_per_s, 2);
            apart += std::pow(s.torque_Nm.difference(), 2);
            together += std::pow(s.torque_Nm.sum(), 2);
            ++count;
        }
    }
    const double noise = std::hypot(geometry.wheel_radius_m.left * overview.noise_rad_per_s.left,
                                    geometry.wheel_radius_m.right * overview.noise_rad_per_s.right) /
                         geometry.track_m;
    constexpr double kLeast = kLeastOfTorques * kLeastOfTorques;
    overview.driving = together > kLeast * apart;
    overview.turning = apart > kLeast * together && yaw / count > kTurningOverNoise * noise * noise;
}

// From when on the last file is held out.
double held_out_from_s(const Logs& logs, const HeldOutPart& held_out) {
    constexpr double kAll_s = std::numeric_limits<double>::lowest();
    if (held_out.whole_file) return kAll_s;
    double driven = 0;
    for (std::size_t i = logs.last_file; i < logs.logs.size(); ++i) driven += duration_s(logs.logs[i]);
    double left = kHeldOutShare * driven;
    double from = kAll_s;
    for (std::size_t i = logs.logs.size(); i-- > logs.last_file && left > 0;) {
        const MeasuredLog& log = logs.logs[i];
        from = log.samples.back().t_s - std::min(left, duration_s(log));
        left -= duration_s(log);
    }
    return held_out.from_s.value_or(from);
}

}  // namespace

Logs read_logs(const std::vector<std::string>& paths, const std::optional<model::RobotParameters>& robot,
               const tools::LogReading& reading) {
    Logs all;
    for (const std::string& path : paths) {
        tools::SampledLog read = tools::read_sampled_log(path, robot, reading);
        all.problems.insert(all.problems.end(), read.problems.begin(), read.problems.end());
        all.notes.insert(all.notes.end(), read.notes.begin(), read.notes.end());
        all.last_file = all.logs.size();
        std::move(read.logs.begin(), read.logs.end(), std::back_inserter(all.logs));
    }
    all.unusable.resize(all.logs.size());
    for (std::size_t i = 0; i < all.logs.size(); ++i) {
        const std::vector<LogFault> faults = repair(all.logs[i], all.unusable[i]);
        all.faults.insert(all.faults.end(), faults.begin(), faults.end());
        for (const LogFault& fault : faults) all.notes.push_back(words_of(fault));
    }
    return all;
}

Overview overview_of(std::span<const MeasuredLog> logs, const model::Geometry<double>& geometry) {
    Overview o;
    double torque = 0;
    double speed = 0;
    double samples = 0;
    bool negative_torque = false;
    double slowest = 0;  // backwards, below zero
    for (const MeasuredLog& log : logs) {
        o.duration_s += duration_s(log);
        o.span_s = std::max(o.span_s, log.samples.back().t_s - log.samples.front().t_s);
        samples += double(log.samples.size());
        for (const auto side : kSides) o.turned_rad = std::max(o.turned_rad, turned_rad(log, side));
        for (const MeasuredSample& s : log.samples) {
            torque += std::pow(s.torque_Nm.left, 2) + std::pow(s.torque_Nm.right, 2);
            speed += std::pow(s.speed_rad_per_s.left, 2) + std::pow(s.speed_rad_per_s.right, 2);
            for (const auto side : kSides) {
                o.peak_torque_Nm = std::max(o.peak_torque_Nm, std::abs(s.torque_Nm.*side));
                o.peak_speed_rad_per_s = std::max(o.peak_speed_rad_per_s, std::abs(s.speed_rad_per_s.*side));
            }
            negative_torque = negative_torque || s.torque_Nm.left < 0 || s.torque_Nm.right < 0;
            slowest = std::min({slowest, s.speed_rad_per_s.left, s.speed_rad_per_s.right});
        }
    }
    o.speed_rms_rad_per_s = std::sqrt(speed / (2 * samples));
    o.period_s = logs.front().period_s;
    if (torque == 0) o.problems.emplace_back("no excitation: the torque is zero throughout");
    if (speed == 0) o.problems.emplace_back("no motion: the wheel speeds are zero throughout");
    if (torque > 0 && slowest < -kBackwards * o.peak_speed_rad_per_s && !negative_torque) {
        o.problems.emplace_back(
            "the wheels turn backwards, yet the torque is never negative: has it lost its sign?");
    }
    if (!o.problems.empty()) return o;
    o.noise_rad_per_s = speed_noise(logs);
    set_motions(logs, geometry, o);
    return o;
}

Parts split(const Logs& logs, const model::Geometry<double>& geometry, const HeldOutPart& held_out) {
    Parts parts;
    const double from_s = held_out_from_s(logs, held_out);
    std::size_t longest = 0;
    for (std::size_t i = 0; i < logs.logs.size(); ++i) {
        const MeasuredLog& log = logs.logs[i];
        const std::size_t end = log.samples.size();
        std::size_t cut = 0;
        while (cut < end && (i < logs.last_file || log.samples[cut].t_s < from_s)) ++cut;
        const LogPart before{&log, i, 0, cut, log.start_heading_rad, &logs.unusable[i]};
        if (cut > 1) parts.training.push_back(before);
        if (i >= logs.last_file && end - cut > std::max<std::size_t>(longest, 2)) {
            const double heading = headings_rad(before, geometry).back();
            parts.held_out = LogPart{&log, i, cut, end, heading, &logs.unusable[i]};
            longest = end - cut;
        }
    }
    return parts;
}

std::vector<double> headings_rad(const LogPart& part, const model::Geometry<double>& geometry) {
    const MeasuredLog& log = *part.log;
    std::vector<double> headings{part.initial_heading_rad};
    for (std::size_t i = part.first; i < part.end; ++i) {
        const WheelPair<double>& speed = log.samples[i].speed_rad_per_s;
        headings.push_back(headings.back() +
                           log.period_s * model::twist_from_wheel_speeds(geometry, speed).omega_rad_per_s);
    }
    return headings;
}

}  // namespace wheelwright::gap
