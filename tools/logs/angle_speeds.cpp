#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <functional>

#include "tools/logs/raw_log.hpp"

namespace wheelwright::tools {
namespace {

// A parabola reaches this many fresh angles to each side, and at least so long: a robot's speed settles in a
// tenth of a second and more.
constexpr std::size_t kReach = 3;
constexpr double kShortestReach_s = 0.03;
constexpr std::size_t kFewestPoints = 4;

using Value = std::function<double(const RawSample&)>;

// Samples from one fresh value to the next while it moves fast: of the intervals between changes the short
// ones.
std::size_t samples_between_changes(const std::vector<RawSample>& samples, const Value& value) {
    std::vector<std::size_t> intervals;
    std::size_t last = 0;
    for (std::size_t i = 1; i < samples.size(); ++i) {
        if (value(samples[i]) == value(samples[i - 1])) continue;
        if (last > 0) intervals.push_back(i - last);
        last = i;
    }
    if (intervals.empty()) return 1;
    const auto quarter = intervals.begin() + static_cast<std::ptrdiff_t>(intervals.size() / 4);
    std::nth_element(intervals.begin(), quarter, intervals.end());
    return *quarter;
}

// Samples that say something: changed, or steady for so long that a change would have shown.
std::vector<std::size_t> fresh(const std::vector<RawSample>& samples, const Value& value, std::size_t every) {
    std::vector<std::size_t> points{0};
    for (std::size_t i = 1; i < samples.size(); ++i) {
        if (value(samples[i]) != value(samples[i - 1]) || i - points.back() >= every) points.push_back(i);
    }
    return points;
}

class Slopes {
  public:
    Slopes(const std::vector<RawSample>& samples, Value value, std::size_t every, double period_s)
        : samples_(samples),
          value_(std::move(value)),
          points_(fresh(samples, value_, every)),
          reach_s_(std::max(static_cast<double>(kReach * every) * period_s, kShortestReach_s) * (1 + 1e-6)) {}

    // Of a parabola through the points around sample `i`.
    double at(std::size_t i) const {
        const double t_s = samples_[i].t_s;
        const auto before = [&](std::size_t point, double limit_s) { return samples_[point].t_s < limit_s; };
        auto from = std::lower_bound(points_.begin(), points_.end(), t_s - reach_s_, before);
        auto to = std::lower_bound(from, points_.end(), t_s + reach_s_, before);
        while (static_cast<std::size_t>(to - from) < std::min(kFewestPoints, points_.size())) {
            if (from != points_.begin()) --from;
            if (to != points_.end()) ++to;
        }
        Eigen::Matrix3d products = Eigen::Matrix3d::Zero();
        Eigen::Vector3d right = Eigen::Vector3d::Zero();
        const double base = value_(samples_[i]);
        for (auto point = from; point != to; ++point) {
            const double x = (samples_[*point].t_s - t_s) / reach_s_;
            const Eigen::Vector3d powers(1, x, x * x);
            products += powers * powers.transpose();
            right += powers * (value_(samples_[*point]) - base);
        }
        return products.ldlt().solve(right)(1) / reach_s_;
    }

  private:
    const std::vector<RawSample>& samples_;
    Value value_;
    std::vector<std::size_t> points_;
    double reach_s_;
};

double left_of(const RawSample& s) { return s.wheel.left; }
double right_of(const RawSample& s) { return s.wheel.right; }

}  // namespace

std::size_t refreshed_every(const RawLog& raw) {
    return std::max(samples_between_changes(raw.samples, left_of),
                    samples_between_changes(raw.samples, right_of));
}

MeasuredLog speeds_from_angles(const RawLog& raw, double period_s) {
    const std::vector<RawSample>& samples = raw.samples;
    const std::size_t every = raw.refreshed_every > 0 ? raw.refreshed_every : refreshed_every(raw);
    const Slopes of_left(samples, left_of, every, period_s);
    const Slopes of_right(samples, right_of, every, period_s);
    const Slopes of_gyro(
        samples, [](const RawSample& s) { return s.gyro; }, every, period_s);
    MeasuredLog log;
    log.period_s = period_s * static_cast<double>(every);
    for (std::size_t i = 0; i + every <= samples.size(); i += every) {
        MeasuredSample sample;
        sample.t_s = samples[i].t_s;
        for (std::size_t n = i; n < i + every; ++n) {
            sample.torque_Nm.left += samples[n].torque_Nm.left / static_cast<double>(every);
            sample.torque_Nm.right += samples[n].torque_Nm.right / static_cast<double>(every);
        }
        sample.speed_rad_per_s = {of_left.at(i), of_right.at(i)};
        sample.gyro_rad_per_s = raw.gyro_is_angle ? of_gyro.at(i) : samples[i].gyro;
        sample.accel_m_per_s2 = samples[i].accel_m_per_s2;
        log.samples.push_back(sample);
        log.lines.push_back(samples[i].line);
    }
    return log;
}

}  // namespace wheelwright::tools
