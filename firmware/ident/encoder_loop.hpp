// What a drive's encoder loop makes of a wheel's motion. It follows the encoder with a bandwidth b,
// critically damped, in periods T of the drive: reported position p and speed v are those of
//     p += T v;  p += 2 b T (angle - p);  v += b^2 T (angle - p), both by the angle's distance before them.
// A slow one (100 to 400 rad/s, as coarse encoders need) lags behind what accelerates the wheel, by no steady
// delay. So what is regressed on the reported positions goes through the same loop.
//
// EncoderLoopLag reads 1 / b from the reports: of both holds, whatever the wheel does and however noisy the
// encoder is, p' = v + 2 / b v'. Some ten operations for each frame. ThroughEncoderLoop: ten for each cycle.
// No allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace wheelwright::ident {

// From p(t) - p(0) - (integral of v) = 2 / b (v(t) - v(0)), over spans of 20 ms; what the integral between
// reports lacks is as likely to add to either end.
class EncoderLoopLag {
  public:
    // Each report once, `period_s` after the one before; after a longer time it begins anew.
    void take(double position_rad, double speed_rad_per_s, std::int64_t time_ns, double period_s) {
        if (time_ns == time_ns_) return;
        const double since_s = 1e-9 * static_cast<double>(time_ns - time_ns_);
        const bool follows = time_ns_ > 0 && std::abs(since_s - period_s) < period_s / 2;
        time_ns_ = time_ns;
        if (follows) path_rad_ += period_s * (last_rad_per_s_ + speed_rad_per_s) / 2;
        last_rad_per_s_ = speed_rad_per_s;
        passed_s_ += period_s;
        if (follows && passed_s_ < kSpan_s) return;
        if (follows) {
            const double gained = speed_rad_per_s - from_rad_per_s_;
            product_ += gained * (position_rad - from_rad_ - path_rad_);
            square_ += gained * gained;
        }
        from_rad_ = position_rad;
        from_rad_per_s_ = speed_rad_per_s;
        path_rad_ = passed_s_ = 0;
    }

    // 1 / b; 0: no lag is seen. A drive that computes its loop in periods of `loop_period_s` sums the speeds
    // from before each of them: its own sum is shorter than the integral.
    double lag_s(double loop_period_s) const {
        return square_ > 0 ? std::max(0.0, product_ / square_ + loop_period_s / 2) / 2 : 0.0;
    }

  private:
    static constexpr double kSpan_s = 0.02;  // long beside a period, short beside a clock's error
    std::int64_t time_ns_ = 0;
    double last_rad_per_s_ = 0, from_rad_ = 0, from_rad_per_s_ = 0;
    double path_rad_ = 0, passed_s_ = 0;
    double product_ = 0, square_ = 0;
};

// A torque that is constant in each cycle, as its mean over the cycle behind the loop.
template <typename Real>
class ThroughEncoderLoop {
  public:
    // `lag_s`: 1 / b; 0 or less than two loop periods: the loop follows at once. A cycle is a whole number of
    // loop periods; with `loop_period_s` 0 nothing is done to a torque.
    void configure(double lag_s, double loop_period_s, double cycle_s) {
        const double follows = lag_s > 0 ? std::min(1.0, 2 * loop_period_s / lag_s) : 1.0;
        const double turns = follows * follows / 4;
        const auto periods = loop_period_s > 0 ? std::lround(cycle_s / loop_period_s) : 0;
        // What is off (the torque less what has come through) and the slope, after each period of what they
        // were: (1 - follows) (off - slope), slope + turns (off - slope).
        std::array<double, 2> off{1, 0}, slope{0, 1}, sum{};
        for (long i = 0; i < periods; ++i) {
            for (std::size_t k = 0; k < 2; ++k) {
                const double ahead = off[k] - slope[k];
                off[k] = (1 - follows) * ahead;
                slope[k] += turns * ahead;
                sum[k] += off[k] / static_cast<double>(periods);
            }
        }
        const auto to_real = [](const std::array<double, 2>& from) {
            return std::array{static_cast<Real>(from[0]), static_cast<Real>(from[1])};
        };
        off_ = to_real(off);
        slope_by_ = to_real(slope);
        mean_ = to_real(sum);
    }
    void restart(Real torque) {
        torque_ = torque;
        slope_ = 0;
    }
    Real mean(Real torque) {
        const Real off = torque - torque_;
        const Real mean = torque - (mean_[0] * off + mean_[1] * slope_);
        torque_ = torque - (off_[0] * off + off_[1] * slope_);
        slope_ = slope_by_[0] * off + slope_by_[1] * slope_;
        return mean;
    }

  private:
    std::array<Real, 2> off_{}, slope_by_{}, mean_{};  // in a cycle, by what is off and by the slope
    Real torque_ = 0, slope_ = 0;                      // the latter in a period
};

}  // namespace wheelwright::ident
