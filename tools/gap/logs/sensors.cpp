#include "tools/gap/logs/sensors.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "firmware/model/exponential.hpp"

namespace wheelwright::gap {
namespace {

using tools::MeasuredLog;
using tools::MeasuredSample;
using Side = double WheelPair<double>::*;
constexpr std::array<Side, 2> kSides{&WheelPair<double>::left, &WheelPair<double>::right};

constexpr double kSpike = 15;               // robust standard deviations of what neighbours do not tell
constexpr double kSpikeShare = 0.4;         // of the usual speed, at least
constexpr double kMovingShare = 0.05;       // of the RMS speed: slower than this is no usual speed
constexpr std::size_t kHeld = 3;            // repeats in a row
constexpr double kChance = 1e-3;            // that a log repeats so by itself
constexpr double kCoarse_rad_per_s = 0.02;  // a smaller step of the speeds is noise like any other
constexpr double kFine_rad_per_s = 1e-4;    // but for speeds that repeat, down to what a log's digits tell
constexpr double kBiasOfInterest_rad_per_s = 0.003;
constexpr double kLagOfInterest_s = 0.004;
constexpr double kSure = 5;  // standard errors
constexpr double kGyroBlock_s = 1;
constexpr double kDrivesCycle_s = 0.0005;  // of a filter that is known as if it ran continuously
constexpr double kNoiseDoubt = 0.25;       // share of the gyro's noise that may be none, or coloured

double median(std::vector<double> values) {
    if (values.empty()) return 0;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}
constexpr double kDeviationOverMedian = 1.4826;

double middle_of_five(const MeasuredLog& log, std::size_t i, Side side) {
    std::array<double, 5> near{};
    const std::size_t first = std::min(i < 2 ? 0 : i - 2, log.samples.size() - near.size());
    for (std::size_t k = 0; k < near.size(); ++k) near[k] = log.samples[first + k].speed_rad_per_s.*side;
    std::nth_element(near.begin(), near.begin() + 2, near.end());
    return near[2];
}

// Two in five may be wrong.
void repair_spikes(MeasuredLog& log, std::vector<LogFault>& faults) {
    std::size_t count = 0;
    double first_s = 0;
    for (const Side side : kSides) {
        double power = 0;
        for (const MeasuredSample& s : log.samples) power += std::pow(s.speed_rad_per_s.*side, 2);
        const double moving = kMovingShare * std::sqrt(power / double(log.samples.size()));
        std::vector<double> off, off_moving, size_moving;  // what is usual says no standstill
        for (std::size_t i = 0; i < log.samples.size(); ++i) {
            const double size = std::abs(log.samples[i].speed_rad_per_s.*side);
            off.push_back(std::abs(log.samples[i].speed_rad_per_s.*side - middle_of_five(log, i, side)));
            if (size < moving) continue;
            off_moving.push_back(off.back());
            size_moving.push_back(size);
        }
        const double limit = std::max(kSpike * kDeviationOverMedian * median(off_moving),
                                      kSpikeShare * kDeviationOverMedian * median(size_moving));
        if (!(limit > 0)) continue;
        const auto speed = [&](std::size_t i) -> double& { return log.samples[i].speed_rad_per_s.*side; };
        for (std::size_t begin = 0; begin < off.size(); ++begin) {
            std::size_t end = begin;  // of a run of wrong ones
            while (end < off.size() && off[end] > limit) ++end;
            if (end == begin) continue;
            const double low = speed(begin > 0 ? begin - 1 : std::min(end, off.size() - 1));
            const double high = end < off.size() ? speed(end) : low;
            for (std::size_t i = begin; i < end; ++i)
                speed(i) = low + double(i - begin + 1) / double(end - begin + 1) * (high - low);
            if (count == 0 || log.samples[begin].t_s < first_s) first_s = log.samples[begin].t_s;
            count += end - begin;
            begin = end;
        }
    }
    if (count > 0) {
        faults.push_back({"log_outliers", double(count) / double(2 * log.samples.size()), count, first_s});
    }
}

// Of both wheels.
template <typename Take>
void for_each_speed(std::span<const MeasuredLog> logs, const Take& take) {
    for (const MeasuredLog& log : logs) {
        for (const MeasuredSample& s : log.samples) {
            for (const Side side : kSides) take(s.speed_rad_per_s.*side);
        }
    }
}

// The step that all speeds are whole multiples of; 0: none that is not finer than `finest`.
double common_step(std::span<const MeasuredLog> logs, double finest_rad_per_s) {
    double least = std::numeric_limits<double>::infinity();
    double largest = 0;
    for (const MeasuredLog& log : logs) {
        for (std::size_t i = 1; i < log.samples.size(); ++i) {
            for (const Side side : kSides) {
                const double b = log.samples[i].speed_rad_per_s.*side;
                const double size = std::abs(b - log.samples[i - 1].speed_rad_per_s.*side);
                if (size > finest_rad_per_s / 2) least = std::min(least, size);
                largest = std::max(largest, std::abs(b));
            }
        }
    }
    if (!(least <= largest) || least < finest_rad_per_s) return 0;
    // the step from ever larger multiples, which know it better
    double step = least;
    for (double reach = 8; reach * step < 2 * largest; reach *= 4) {
        double product = 0;
        double square = 0;
        for_each_speed(logs, [&](double speed) {
            const double n = std::round(speed / step);
            if (std::abs(n) > reach) return;
            product += n * speed;
            square += n * n;
        });
        if (square > 0) step = product / square;
    }
    double off = 0;
    double all = 0;
    for_each_speed(logs, [&](double speed) {
        off += std::abs(speed / step - std::round(speed / step)) > 0.02 ? 1 : 0;
        ++all;
    });
    return off < 0.05 * all ? step : 0.0;
}

bool repeats(const MeasuredLog& log, std::size_t i) {
    const MeasuredSample& a = log.samples[i - 1];
    const MeasuredSample& b = log.samples[i];
    return a.speed_rad_per_s.left == b.speed_rad_per_s.left &&
           a.speed_rad_per_s.right == b.speed_rad_per_s.right &&
           (!log.has_gyro || a.gyro_rad_per_s == b.gyro_rad_per_s);
}

// Samples of the log for one of the sensor's, where that is slower; else 1. Samples between two changes then
// come in multiples of that, but for few that jitter.
std::size_t samples_together(const MeasuredLog& log) {
    constexpr std::size_t kSlowest = 20;  // samples for one of the sensor's
    constexpr double kRegular = 0.75;     // by chance half of them are even
    std::array<std::size_t, kSlowest + 1> multiples{};
    std::size_t changes = 0;
    for (std::size_t i = 1, last = 0; i < log.samples.size(); ++i) {
        if (repeats(log, i)) continue;
        ++changes;
        for (std::size_t n = 2; n <= kSlowest; ++n) multiples[n] += (i - last) % n == 0;
        last = i;
    }
    std::size_t together = kSlowest;
    while (together > 1 && !(double(multiples[together]) > kRegular * double(changes))) --together;
    return std::max<std::size_t>(1, together);
}

// `step`: that the speeds are reported in; 0: none.
void mark_held(const MeasuredLog& log, double step, std::vector<bool>& unusable,
               std::vector<LogFault>& faults) {
    const auto still = [&](std::size_t i) {
        const WheelPair<double>& w = log.samples[i].speed_rad_per_s;
        return w.left == 0 && w.right == 0;
    };
    if (samples_together(log) > 1) return;
    // how often one sample repeats the other by itself: where not both neighbours do, lest the runs count
    double alone = 0;
    double moving = 0;
    std::vector<std::pair<std::size_t, std::size_t>> runs;  // first repeated, one past
    for (std::size_t i = 1; i < log.samples.size();) {
        if (still(i)) {
            ++i;
            continue;
        }
        std::size_t end = i;
        while (end < log.samples.size() && repeats(log, end) && !still(end)) ++end;
        moving += double(std::max<std::size_t>(1, end - i));
        if (end - i >= kHeld)
            runs.emplace_back(i, end);
        else
            alone += double(end - i);
        i = std::max(end, i + 1);
    }
    const double chance = moving > 0 ? alone / moving : 1.0;
    // reported in steps a steady speed repeats, and goes on by one of them, or as fast as it goes on from
    // there: behind samples that were lost it leaps by what all of them lacked
    const auto goes_on = [&](std::size_t end) {
        if (step == 0 || end >= log.samples.size()) return step > 0;
        return std::all_of(kSides.begin(), kSides.end(), [&](const Side side) {
            const auto speed = [&](std::size_t i) { return log.samples[i].speed_rad_per_s.*side; };
            const double next = end + 1 < log.samples.size() ? speed(end + 1) - speed(end) : 0.0;
            return std::abs(speed(end) - speed(end - 1)) < 1.5 * step + 2 * std::abs(next);
        });
    };
    std::erase_if(runs, [&](const auto& run) {
        const auto [begin, end] = run;
        return goes_on(end) || std::pow(chance, double(end - begin)) * moving > kChance;
    });
    std::size_t count = 0;
    double first_s = 0;
    for (const auto& [begin, end] : runs) {
        if (count == 0) first_s = log.samples[begin].t_s;
        count += end - begin;
        for (std::size_t i = begin - 1; i < std::min(end + 1, unusable.size()); ++i) unusable[i] = true;
    }
    if (count > 0) {
        faults.push_back({"log_dropouts", double(count) / double(log.samples.size()), count, first_s});
    }
}

// gyro = bias + slope omega + bend v, with the gyro delayed by a first-order lag of `lag_s`; and how much is
// left over.
struct GyroFit {
    Eigen::Vector3d value = Eigen::Vector3d::Zero();
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    std::vector<double> squares;  // of each block
    double total = 0;
};
// What the wheels' noise adds to a sample's squares of (1, omega, v): where a robot hardly turns it would
// flatten the slope, and a mean yaw rate would pass for a bias. At most half of what was measured.
Eigen::Matrix3d wheels_noise(const std::vector<MeasuredLog>& logs, const model::Geometry<double>& g) {
    const WheelPair<double> sigma = speed_noise(logs);
    const double left = std::pow(g.wheel_radius_m.left * sigma.left, 2);
    const double right = std::pow(g.wheel_radius_m.right * sigma.right, 2);
    Eigen::Matrix3d noise = Eigen::Matrix3d::Zero();
    noise(1, 1) = (left + right) / (g.track_m * g.track_m);
    noise(2, 2) = (left + right) / 4;
    noise(1, 2) = noise(2, 1) = (right - left) / (2 * g.track_m);
    double turning = 0;
    double driving = 0;
    double count = 0;
    for (const MeasuredLog& log : logs) {
        for (const MeasuredSample& s : log.samples) {
            const Twist<double> u = model::twist_from_wheel_speeds(g, s.speed_rad_per_s);
            turning += u.omega_rad_per_s * u.omega_rad_per_s;
            driving += u.v_m_per_s * u.v_m_per_s;
            ++count;
        }
    }
    const double share = std::max(noise(1, 1) * count / std::max(1e-12, turning),
                                  noise(2, 2) * count / std::max(1e-12, driving));
    return share > 0.5 ? Eigen::Matrix3d(noise * (0.5 / share)) : noise;
}

// Variance of a log's white gyro noise, from third differences.
double gyro_variance(const MeasuredLog& log) {
    double sum = 0;
    double count = 0;
    for (std::size_t i = 3; i < log.samples.size(); ++i, ++count) {
        sum += std::pow(log.samples[i].gyro_rad_per_s - log.samples[i - 3].gyro_rad_per_s +
                            3 * (log.samples[i - 2].gyro_rad_per_s - log.samples[i - 1].gyro_rad_per_s),
                        2);
    }
    return count > 0 ? sum / (20 * count) : 0.0;
}

// Sensors' white noise.
struct Noise {
    Eigen::Matrix3d wheels;    // of the regressors
    std::vector<double> gyro;  // by log
};

// A first-order lag of what goes straight from sample to sample.
struct Lag {
    double keeps = 0, of_last = 0, of_this = 1;
    Lag(double lag_s, double period_s) {
        if (!(lag_s > 0)) return;
        const double steps = period_s / lag_s;
        keeps = model::exp_minus(steps);
        const double mean = model::mean_exp_minus(steps);
        of_last = mean - keeps;
        of_this = 1 - mean;
    }
    // of the variance of white noise
    double share_remaining() const {
        return (of_last * of_last + of_this * of_this + 2 * keeps * of_last * of_this) / (1 - keeps * keeps);
    }
};

// Squares of the gyros' noise that a lag leaves, over the logs.
double noise_squares(const std::vector<MeasuredLog>& logs, const Noise& noise, double lag_s) {
    double sum = 0;
    for (std::size_t l = 0; l < logs.size(); ++l)
        sum += noise.gyro[l] * Lag(lag_s, logs[l].period_s).share_remaining() *
               static_cast<double>(logs[l].samples.size());
    return sum;
}

// Of how far the gyro, lagged so, is from the wheels. What noise makes is taken off: a lag smooths that of
// the gyro, which would gain something without any lag in the wheels' report.
GyroFit fit_gyro(const std::vector<MeasuredLog>& logs, const model::Geometry<double>& g, const Noise& noise,
                 double lag_s) {
    struct Sum {
        Eigen::Matrix3d xx = Eigen::Matrix3d::Zero();
        Eigen::Vector3d xy = Eigen::Vector3d::Zero();
        double yy = 0;
    };
    std::vector<Sum> blocks;
    for (std::size_t l = 0; l < logs.size(); ++l) {
        const MeasuredLog& log = logs[l];
        const Lag lag(lag_s, log.period_s);
        const double noise_remaining = noise.gyro[l] * lag.share_remaining();
        double late = log.samples.front().gyro_rad_per_s;
        const auto length = static_cast<std::size_t>(std::max(4.0, kGyroBlock_s / log.period_s));
        for (std::size_t i = 0; i < log.samples.size(); ++i) {
            const MeasuredSample& s = log.samples[i];
            const double last = log.samples[i > 0 ? i - 1 : 0].gyro_rad_per_s;
            late = lag.keeps * late + lag.of_last * last + lag.of_this * s.gyro_rad_per_s;
            if (i % length == 0) blocks.emplace_back();
            const Twist<double> u = model::twist_from_wheel_speeds(g, s.speed_rad_per_s);
            const Eigen::Vector3d x(1, u.omega_rad_per_s, u.v_m_per_s);
            blocks.back().xx += x * x.transpose() - noise.wheels;
            blocks.back().xy += late * x;
            blocks.back().yy += late * late - noise_remaining;
        }
    }
    GyroFit fit;
    Sum all;
    for (const Sum& b : blocks) {
        all.xx += b.xx;
        all.xy += b.xy;
    }
    Eigen::Matrix3d normal = all.xx;
    normal.diagonal() *= 1 + 1e-9;
    const Eigen::Matrix3d inverse = normal.ldlt().solve(Eigen::Matrix3d::Identity());
    fit.value = inverse * all.xy;
    Eigen::Matrix3d meat = Eigen::Matrix3d::Zero();
    for (const Sum& b : blocks) {
        const Eigen::Vector3d score = b.xy - b.xx * fit.value;
        meat += score * score.transpose();
        fit.squares.push_back(b.yy - 2 * fit.value.dot(b.xy) + fit.value.dot(b.xx * fit.value));
        fit.total += fit.squares.back();
    }
    fit.covariance = inverse * meat * inverse;
    return fit;
}

// The lag at which the gyro looks most like the wheels, from a parabola through the best of a grid that is
// refined.
void find_lag(const std::vector<MeasuredLog>& logs, const model::Geometry<double>& g, const Noise& noise,
              Sensors::Gyro& gyro) {
    const auto left = [&](double lag_s) { return fit_gyro(logs, g, noise, lag_s).total; };
    constexpr double kMost_s = 0.4;
    double best = 0;
    double least = left(0);
    for (double lag = 0.002; lag < kMost_s; lag *= 1.5) {
        const double now = left(lag);
        if (now < least) {
            least = now;
            best = lag;
        }
    }
    const std::vector<double> without = fit_gyro(logs, g, noise, 0).squares;
    if (best == 0) {
        gyro.lag_error_s = kLagOfInterest_s / kSure;
        return;
    }
    double width = 0.25 * best;
    for (int pass = 0; pass < 6; ++pass, width /= 2) {
        const double low = left(best - width);
        const double high = left(best + width);
        const double bend = low + high - 2 * least;
        if (!(bend > 0)) break;
        best = std::max(1e-4, best + std::clamp(width / 2 * (low - high) / bend, -width, width));
        least = left(best);
    }
    // one standard error: where each block's own loss, as noisy as the blocks are, balances the bend
    const double step = 0.1 * best;
    const std::vector<double> low = fit_gyro(logs, g, noise, best - step).squares;
    const std::vector<double> high = fit_gyro(logs, g, noise, best + step).squares;
    double bend = 0;
    double scores = 0;
    for (std::size_t i = 0; i < low.size(); ++i) {
        bend += low[i] + high[i];
        scores += std::pow((high[i] - low[i]) / (2 * step), 2);
    }
    bend = (bend - 2 * least) / (step * step);
    gyro.lag_s = best;
    gyro.lag_error_s = bend > 0 ? std::sqrt(scores) / bend : best;
    double gained = 0;
    double spread = 0;
    const std::vector<double> with = fit_gyro(logs, g, noise, best).squares;
    for (std::size_t i = 0; i < with.size(); ++i) {
        gained += without[i] - with[i];
        spread += std::pow(without[i] - with[i], 2);
    }
    // The noise is known to no more than this, beside what it makes.
    const double doubt = kNoiseDoubt * noise_squares(logs, noise, 0);
    // sure of it by all blocks, and more than the noise may make
    if (gained <= kSure * std::sqrt(spread) / 2 || gained < doubt) {
        gyro.lag_s = 0;
        gyro.lag_error_s = std::max(gyro.lag_error_s, best / kSure);
        if (bend > 0) gyro.lag_error_s = std::max(gyro.lag_error_s, std::sqrt(0.4 * doubt / bend));
    } else if (bend > 0) {
        // by as much as the noise may be off, more or less of it seems smoothed
        const double slope =
            (noise_squares(logs, noise, best + step) - noise_squares(logs, noise, best - step)) / (2 * step);
        gyro.lag_error_s = std::hypot(gyro.lag_error_s, kNoiseDoubt * slope / bend, kDrivesCycle_s / 2);
    }
}

}  // namespace

WheelPair<double> speed_noise(std::span<const MeasuredLog> logs) {
    const auto one = [&](Side side) {
        // variances of the second, third and fourth difference of white noise: 6, 20, 70
        std::array<double, 3> sum{};
        double power = 0;
        std::size_t count = 0;
        for (const MeasuredLog& log : logs) {
            for (std::size_t i = 4; i < log.samples.size(); ++i) {
                const auto w = [&](std::size_t back) { return log.samples[i - back].speed_rad_per_s.*side; };
                const double second = w(0) - 2 * w(1) + w(2);
                const double third = second - (w(1) - 2 * w(2) + w(3));
                const double fourth = third - (w(1) - 3 * w(2) + 3 * w(3) - w(4));
                sum[0] += second * second / 6;
                sum[1] += third * third / 20;
                sum[2] += fourth * fourth / 70;
                power += w(0) * w(0);
                ++count;
            }
        }
        if (count == 0) return 1.0;
        const double least = *std::min_element(sum.begin(), sum.end());
        return std::sqrt(std::max(least, 1e-8 * power) / double(count));
    };
    return {one(&WheelPair<double>::left), one(&WheelPair<double>::right)};
}

std::vector<LogFault> repair(MeasuredLog& log, std::vector<bool>& unusable) {
    std::vector<LogFault> faults;
    unusable.assign(log.samples.size(), false);
    if (log.samples.size() < 10) return faults;
    const double step =
        common_step(std::span(&log, 1), kFine_rad_per_s);  // before speeds are put between others
    repair_spikes(log, faults);
    mark_held(log, step, unusable, faults);
    return faults;
}

Sensors sensors_of(const std::vector<MeasuredLog>& logs, const model::Geometry<double>& geometry,
                   bool turning, std::span<const std::size_t> excluded) {
    Sensors sensors;
    sensors.by_angles =
        std::any_of(logs.begin(), logs.end(), [](const MeasuredLog& log) { return log.by_angles; });
    const auto add = [&](const char* name, double value, double error) {
        const std::size_t effect = model::find_effect(name);
        const bool is_excluded = std::find(excluded.begin(), excluded.end(), effect) != excluded.end();
        if (!is_excluded) sensors.effects.push_back({effect, value, error});
        return !is_excluded;
    };
    if (const double step = common_step(logs, kCoarse_rad_per_s); step > 0) {
        constexpr double kCounting_s = model::EncoderQuantisation::kCountingTime_s;
        // a sensor slower than that counts for longer, and for how long nobody knows
        double samples = 0;
        double seldom = 0;
        for (const MeasuredLog& log : logs) {
            const auto count = double(log.samples.size());
            samples += count;
            if (double(samples_together(log)) * log.period_s > 1.5 * kCounting_s) seldom += count;
        }
        const double counts = 2 * std::numbers::pi / (step * kCounting_s);
        if (seldom > samples / 2) {
            sensors.unknown_step_rad_per_s = step;
        } else {
            add("encoder_quantisation", counts, 1e-4 * counts);
        }
    }
    if (!std::all_of(logs.begin(), logs.end(), [](const MeasuredLog& log) { return log.has_gyro; })) {
        return sensors;
    }
    Sensors::Gyro gyro;
    Noise noise{wheels_noise(logs, geometry), {}};
    for (const MeasuredLog& log : logs) noise.gyro.push_back(gyro_variance(log));
    find_lag(logs, geometry, noise, gyro);
    const GyroFit fit = fit_gyro(logs, geometry, noise, gyro.lag_s);
    const auto take = [&](Eigen::Index i, double& value, double& error) {
        value = fit.value(i);
        error = std::sqrt(std::max(0.0, fit.covariance(i, i)));
    };
    take(0, gyro.bias_rad_per_s, gyro.bias_error);
    take(1, gyro.slope, gyro.slope_error);
    take(2, gyro.bend_per_m, gyro.bend_error);
    if (std::abs(gyro.bias_rad_per_s) > std::max(kBiasOfInterest_rad_per_s, kSure * gyro.bias_error))
        add("gyro_bias", gyro.bias_rad_per_s, gyro.bias_error);
    if (gyro.lag_s > std::max(kLagOfInterest_s, kSure * gyro.lag_error_s))
        sensors.late_report = !add("measurement_lag", gyro.lag_s, gyro.lag_error_s);
    if (turning) sensors.gyro = gyro;
    return sensors;
}

std::optional<std::string> wrong_beside_gyro(const Sensors::Gyro& gyro) {
    const auto near = [&](double factor) { return std::abs(gyro.slope / factor - 1) < 0.2; };
    if (gyro.slope < 0 && std::abs(gyro.slope) > kSure * gyro.slope_error)
        return "gyro and wheels turn in opposite senses: are left and right swapped?";
    if (near(2 * std::numbers::pi) || near(1 / (2 * std::numbers::pi))) {
        return "the wheels' yaw rate is off the gyro's by a factor near 2 pi: turns instead of radians?";
    }
    if (near(1000) || near(0.001) || near(180 / std::numbers::pi) || near(std::numbers::pi / 180)) {
        return "the wheels' yaw rate is off the gyro's by a factor of a unit: rad/s are expected";
    }
    return std::nullopt;
}

}  // namespace wheelwright::gap
