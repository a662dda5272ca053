#include "tools/ident/speed_rows.hpp"

#include <algorithm>
#include <cmath>

namespace wheelwright::tools {
namespace {

// Right + left and right - left of everything that enters, over one interval.
using Signals = std::vector<double>;
// accelerations of v and omega, both velocity products; then torque and its slip, each as sum and difference;
// then the effects' columns in the same way
enum Signal : std::size_t { kV, kOmega, kOmegaSquared, kVOmega, kFirstPair };

double mean_product(double a0, double a1, double b0, double b1) {
    return (2 * a0 * b0 + a0 * b1 + a1 * b0 + 2 * a1 * b1) / 6;
}

// Mean sign of a speed that goes straight from a to b.
double mean_sign(double a, double b) {
    const double size = std::abs(a) + std::abs(b);
    return size > 0 ? (a + b) / size : 0.0;
}

// The torque as steps, each sample held until the next, and its integral. Sample times are taken as even.
class TorqueTrack {
  public:
    TorqueTrack(const MeasuredLog& log, double WheelPair<double>::*side)
        : log_(log), side_(side), integral_(log.samples.size() + 1) {
        for (std::size_t i = 1; i < integral_.size(); ++i) integral_[i] = integral_[i - 1] + at(i - 1);
    }

    // `where` in samples from the first; 0 .. size.
    double value(double where) const { return at(below(where)); }
    double mean_over_interval(double from) const { return integral(from + 1) - integral(from); }

  private:
    double at(std::size_t i) const { return log_.samples[i].torque_Nm.*side_; }
    std::size_t below(double where) const {
        return std::min(static_cast<std::size_t>(std::max(where, 0.0)), log_.samples.size() - 1);
    }
    double integral(double where) const {
        const std::size_t i = below(where);
        return integral_[i] + (where - static_cast<double>(i)) * at(i);
    }

    const MeasuredLog& log_;
    double WheelPair<double>::*side_;
    std::vector<double> integral_;
};

class RunReader {
  public:
    RunReader(const SpeedRun& run, const SpeedRowOptions& options)
        : run_(run),
          options_(options),
          left_(*run.log, &WheelPair<double>::left),
          right_(*run.log, &WheelPair<double>::right),
          delay_samples_(options.delay_s / run.log->period_s) {}

    // False where the interval cannot be used. Intervals in their order: angles are summed up.
    bool read(std::size_t i, Signals& out) {
        const MeasuredLog& log = *run_.log;
        const WheelPair<double>& before = log.samples[i].speed_rad_per_s;
        const WheelPair<double>& after = log.samples[i + 1].speed_rad_per_s;
        const double dt = log.period_s;
        const Twist<double> u0 = model::twist_from_wheel_speeds(options_.geometry, before);
        const Twist<double> u1 = model::twist_from_wheel_speeds(options_.geometry, after);
        const double from = static_cast<double>(i) - delay_samples_;
        const bool torque_known = from >= 0 && from + 1 <= static_cast<double>(log.samples.size());
        WheelPair<double> torque;
        WheelPair<double> slip;
        Twist<double> bend;  // mean speed less the mean of both ends
        if (torque_known) {
            torque = {left_.mean_over_interval(from), right_.mean_over_interval(from)};
            slip = {(left_.value(from) - left_.value(from + 1)) / dt,
                    (right_.value(from) - right_.value(from + 1)) / dt};
            // the torque steps where `from` passes the next sample
            const double step_at = 1 - (from - std::floor(from));
            const double shape = step_at * (1 - step_at) / 2 * dt * dt;
            bend = {options_.k7_per_kg_m * slip.sum() * shape,
                    options_.k8_per_kg_m2 * slip.difference() * shape};
        }
        const double v = (u0.v_m_per_s + u1.v_m_per_s) / 2;
        const double omega = (u0.omega_rad_per_s + u1.omega_rad_per_s) / 2;
        out.clear();
        out.push_back((u1.v_m_per_s - u0.v_m_per_s) / dt);
        out.push_back((u1.omega_rad_per_s - u0.omega_rad_per_s) / dt);
        out.push_back(
            mean_product(u0.omega_rad_per_s, u1.omega_rad_per_s, u0.omega_rad_per_s, u1.omega_rad_per_s) +
            2 * omega * bend.omega_rad_per_s);
        out.push_back(mean_product(u0.v_m_per_s, u1.v_m_per_s, u0.omega_rad_per_s, u1.omega_rad_per_s) +
                      v * bend.omega_rad_per_s + omega * bend.v_m_per_s);
        push(torque, out);
        push(slip, out);
        push_effects(before, after, u0, u1, bend, out);
        return torque_known && !run_.left_out[i];
    }

  private:
    static void push(const WheelPair<double>& pair, Signals& out) {
        out.push_back(pair.sum());
        out.push_back(pair.difference());
    }

    void push_effects(const WheelPair<double>& before, const WheelPair<double>& after,
                      const Twist<double>& u0, const Twist<double>& u1, const Twist<double>& bend,
                      Signals& out) {
        const double dt = run_.log->period_s;
        // speeds and angles along the interval; Simpson's rule takes their start, middle and end
        const auto motion_at = [&](double f) {
            model::Motion<double> m;
            m.wheel_speed_rad_per_s = {before.left + f * (after.left - before.left),
                                       before.right + f * (after.right - before.right)};
            m.wheel_angle_rad = {
                angle_.left + f * dt * (before.left + f / 2 * (after.left - before.left)),
                angle_.right + f * dt * (before.right + f / 2 * (after.right - before.right))};
            m.twist = {u0.v_m_per_s + f * (u1.v_m_per_s - u0.v_m_per_s),
                       u0.omega_rad_per_s + f * (u1.omega_rad_per_s - u0.omega_rad_per_s)};
            m.heading_rad = heading_rad_ +
                            f * dt * (u0.omega_rad_per_s + f / 2 * (u1.omega_rad_per_s - u0.omega_rad_per_s));
            return m;
        };
        const model::Motion<double> end = motion_at(1);
        const std::size_t first = out.size();
        const auto add = [&](const model::Motion<double>& motion, double weight) {
            std::size_t at = first;
            const model::Dynamics<double> unknown;  // no linear effect asks for it
            model::for_each_column<double>(
                options_.effects.active, {motion, {}, options_.geometry, unknown},
                [&](std::size_t, unsigned, const WheelPair<double>& column, bool dry) {
                    const double amount = dry ? -weight * mean_sign(model::sliding_speed(column, before),
                                                                    model::sliding_speed(column, after))
                                              : weight;
                    if (at == out.size()) out.insert(out.end(), 2, 0.0);
                    out[at++] += amount * column.sum();
                    out[at++] += amount * column.difference();
                });
        };
        add(motion_at(0), 1.0 / 6);
        model::Motion<double> middle = motion_at(0.5);
        const double peak = 1.5;  // of a parabola with the mean 1
        const WheelPair<double> bent = model::wheel_speeds_from_twist(options_.geometry, bend);
        middle.wheel_speed_rad_per_s.left += peak * bent.left;
        middle.wheel_speed_rad_per_s.right += peak * bent.right;
        middle.twist.v_m_per_s += peak * bend.v_m_per_s;
        middle.twist.omega_rad_per_s += peak * bend.omega_rad_per_s;
        add(middle, 4.0 / 6);
        add(end, 1.0 / 6);
        angle_ = end.wheel_angle_rad;
        heading_rad_ = end.heading_rad;
    }

    const SpeedRun& run_;
    const SpeedRowOptions& options_;
    TorqueTrack left_, right_;
    double delay_samples_;
    WheelPair<double> angle_;
    double heading_rad_ = 0;
};

}  // namespace

SpeedRows make_speed_rows(std::span<const SpeedRun> runs, const SpeedRowOptions& options) {
    std::array<std::vector<double>, 2> phi;
    std::array<std::vector<double>, 2> y;
    SpeedRows rows;
    std::vector<std::size_t> place;
    std::size_t columns = 0;
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (options.effects.active[i] && model::kLinearInParameters[i]) {
            columns += model::kEffects[i].parameters.size();
        }
    }
    const std::size_t pairs = 2 + columns;
    const std::size_t m = options.block;
    const double scale = 1.0 / static_cast<double>(m * m);
    std::size_t next_place = 0;
    for (const SpeedRun& run : runs) {
        const std::size_t intervals = run.log->samples.size() - 1;
        RunReader reader(run, options);
        Signals signals;
        Signals sum;
        const std::size_t width = kFirstPair + 2 * pairs;
        std::vector<double> all(intervals * width);
        std::vector<bool> usable(intervals);
        for (std::size_t i = 0; i < intervals; ++i) {
            usable[i] = reader.read(i, signals);
            std::copy(signals.begin(), signals.end(), all.begin() + static_cast<std::ptrdiff_t>(i * width));
        }
        for (std::size_t begin = 0; begin + 2 * m - 1 <= intervals; begin += m, ++next_place) {
            const auto first = usable.begin() + static_cast<std::ptrdiff_t>(begin);
            if (std::find(first, first + static_cast<std::ptrdiff_t>(2 * m - 1), false) !=
                first + static_cast<std::ptrdiff_t>(2 * m - 1)) {
                ++rows.masked;
                continue;
            }
            sum.assign(width, 0.0);
            for (std::size_t k = 0; k < 2 * m - 1; ++k) {
                const double weight = scale * static_cast<double>(k < m ? k + 1 : 2 * m - 1 - k);
                const double* at = &all[(begin + k) * width];
                for (std::size_t s = 0; s < width; ++s) sum[s] += weight * at[s];
            }
            for (std::size_t e = 0; e < 2; ++e) {
                y[e].push_back(sum[kV + e]);
                phi[e].push_back(sum[kOmegaSquared + e]);
                for (std::size_t p = 0; p < pairs; ++p) phi[e].push_back(sum[kFirstPair + 2 * p + e]);
            }
            place.push_back(next_place);
        }
        next_place += 1'000'000;  // far beyond every lag
    }
    const auto fill = [&](std::size_t e, Rows& to) {
        using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
        const auto count = static_cast<Eigen::Index>(y[e].size());
        to.phi = Eigen::Map<const RowMajor>(phi[e].data(), count, static_cast<Eigen::Index>(1 + pairs));
        to.y = Eigen::Map<const Eigen::VectorXd>(y[e].data(), count);
        to.place = place;
    };
    fill(0, rows.linear);
    fill(1, rows.turning);
    return rows;
}

}  // namespace wheelwright::tools
