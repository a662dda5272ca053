// What a drive's encoder loop makes of a wheel's motion, and how that is undone. The loop follows the encoder
// with a bandwidth b, critically damped, in periods T of the drive: reported position p and speed v are those
// of
//     p += T v;  p += 2 b T (angle - p);  v += b^2 T (angle - p), both by the angle's distance before them.
// A slow one (100 to 400 rad/s, as coarse encoders need) lags behind what accelerates the wheel, by no steady
// delay: a wheel that stops goes on in its reports for some eight times 1 / b.
//
// EncoderLoopLag reads 1 / b from the reports: of both holds, whatever the wheel does and however noisy the
// encoder is, p' = v + 2 / b v'. EncoderBehindLoop gives the angle: between two reports it was off p by
// v' / b^2, in the mean. Its noise is that of the encoder, which the loop would have smoothed. EncoderScale
// tells positions and speeds that cannot be of one encoder.
//
// Some ten operations each for a report, and 60 more for each span of EncoderScale. No allocation.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>

namespace wheelwright::control {

struct EncoderSample {
    double position_rad = 0;     // wheel angle, unwrapped
    double speed_rad_per_s = 0;  // the drive's own estimate
    std::int64_t time_ns = 0;    // receive time stamp; 0: none yet. A repeated time is the same sample
};

// What a drive has told last: its position, the angle before its loop, and by how much that may be wrong.
struct EncoderAngle {
    double position_rad = 0, angle_rad = 0, unsure_rad = 0;
    std::int64_t time_ns = 0;
};

// Slower loops no drive needs.
inline constexpr double kLongestEncoderLag_s = 0.02;

inline double seconds_between(const EncoderSample& from, const EncoderSample& to) {
    return 1e-9 * static_cast<double>(to.time_ns - from.time_ns);
}

// From p(t) - p(0) - (integral of v) = 2 / b (v(t) - v(0)), over spans of 20 ms; what the integral between
// reports lacks is as likely to add to either end.
class EncoderLoopLag {
  public:
    // Each report once. After a time without any it begins anew: who reads them once in a cycle may miss one
    // of two that fall into one.
    void take(const EncoderSample& reported, double period_s) {
        if (reported.time_ns == last_.time_ns) return;
        const double since_s = period_s * std::round(seconds_between(last_, reported) / period_s);
        const bool follows = last_.time_ns > 0 && since_s > 0 && since_s < kMostMissed * period_s;
        if (follows) path_rad_ += since_s * (last_.speed_rad_per_s + reported.speed_rad_per_s) / 2;
        last_ = reported;
        passed_s_ += since_s;
        if (follows && passed_s_ < kSpan_s) return;
        if (follows) {
            const double gained = reported.speed_rad_per_s - from_.speed_rad_per_s;
            const double ahead = reported.position_rad - from_.position_rad - path_rad_;
            product_ += gained * ahead;
            gained_square_ += gained * gained;
            ahead_square_ += ahead * ahead;
            ++spans_;
        }
        from_ = reported;
        path_rad_ = passed_s_ = 0;
    }

    // 1 / b; `unless_known_s` while its standard error is more than a fiftieth of it and of a period. A
    // drive that computes its loop in periods of `loop_period_s` sums the speeds from before each of them:
    // its own sum is shorter than the integral.
    double lag_s(double loop_period_s, double period_s, double unless_known_s = 0) const {
        if (spans_ < kFewestSpans || !(gained_square_ > 0)) return unless_known_s;
        const double slope_s = product_ / gained_square_;
        const double lag_s = std::clamp((slope_s + loop_period_s / 2) / 2, 0.0, kLongestEncoderLag_s);
        const double unexplained = std::max(ahead_square_ / gained_square_ - slope_s * slope_s, 0.0);
        const double sure_s = std::max(lag_s, period_s) / 50;
        return unexplained <= 4 * sure_s * sure_s * (spans_ - 1) ? lag_s : unless_known_s;
    }

  private:
    static constexpr int kFewestSpans = 5;
    static constexpr double kMostMissed = 2.5;  // periods
    static constexpr double kSpan_s = 0.02;     // long beside a period, short beside a clock's error
    EncoderSample last_, from_;
    double path_rad_ = 0, passed_s_ = 0;
    double product_ = 0, gained_square_ = 0, ahead_square_ = 0;
    int spans_ = 0;
};

// Whether a drive's positions and speeds are of two scales: by the same equation the one is another multiple
// of the other, again and again. Then one of them is no motion of the wheel, and nobody knows which.
// Speeds that have nothing to do with the positions are none of its business.
class EncoderScale {
  public:
    static constexpr int kReportsInASpan = 5;  // or a few more

    // `lag_s`: 1 / b; 0: not known.
    void configure(double lag_s, double report_period_s) {
        span_ns_ = std::llround(1e9 * kReportsInASpan * report_period_s);
        ahead_s_ = 2 * lag_s;
        unsure_s_ = lag_s > 0 ? kLagUnsure * ahead_s_ : 2 * kLongestEncoderLag_s;
    }
    // A report, again or not; some may be left out, but not always those at the same time of a motion that
    // repeats itself. True: it was the last of a span; not where `may_end` is false, but the next one then.
    bool take(const EncoderSample& reported, bool may_end = true) {
        if (reported.time_ns == last_ns_) return false;
        last_ns_ = reported.time_ns;
        speeds_rad_per_s_ += reported.speed_rad_per_s;
        ++reports_;
        if (!may_end || reported.time_ns - from_.time_ns < span_ns_) return false;
        end_span(reported);
        return true;
    }
    // Of what has been told in about the last ten spans.
    bool differs() const { return differs_; }

  private:
    [[gnu::noinline]] void end_span(const EncoderSample& reported) {
        const EncoderSample from = from_;
        from_ = reported;
        const double gained = reported.speed_rad_per_s - from.speed_rad_per_s;
        const double mean = (speeds_rad_per_s_ - gained / 2) / reports_;  // each end counts half
        speeds_rad_per_s_ = 0;
        reports_ = 0;
        if (from.time_ns == 0 || reported.time_ns - from.time_ns > 2 * span_ns_) return;
        const double by_speed = seconds_between(from, reported) * mean + ahead_s_ * gained;
        const double off = reported.position_rad - from.position_rad - by_speed;
        const auto add = [](double& sum, double value) { sum = kKept * sum + value; };
        // The speed that a quick loop tells of a coarse encoder leaps with each count and falls until the
        // next. Reports in step with the counts are all too fast for a while, or too slow: by half of a leap.
        add(leaps_rad_per_s_, std::abs(gained));
        const double unsure = unsure_s_ * std::abs(gained) +
                              seconds_between(from, reported) * (1 - kKept) / 2 * leaps_rad_per_s_;
        const double by_position = by_speed + std::copysign(std::max(std::abs(off) - unsure, 0.0), off);
        add(size_, std::abs(by_speed));
        add(speed_square_, by_speed * by_speed);
        add(position_square_, by_position * by_position);
        add(product_, by_speed * by_position);
        const double scale = product_ / speed_square_;
        differs_ = speed_square_ >= kLeast_rad * kLeast_rad &&
                   size_ * size_ >= kFewestSpans * speed_square_ &&  // no single one of them
                   std::abs(scale) >= kUnlike && std::abs(scale - 1) >= kUnlike &&
                   scale * product_ >= kAlike * position_square_;
    }

    static constexpr double kKept = 0.85;       // from span to span
    static constexpr double kFewestSpans = 6;   // of the twelve that are remembered
    static constexpr double kUnlike = 0.25;     // of each other: no clock and no lag is so far off
    static constexpr double kAlike = 0.98;      // of the positions' squares
    static constexpr double kLeast_rad = 0.03;  // a sixth of a coarse encoder's step in each span
    static constexpr double kLagUnsure = 0.1;   // of the lag
    EncoderSample from_;
    std::int64_t last_ns_ = 0, span_ns_ = 0;
    double speeds_rad_per_s_ = 0;  // sum since `from_`
    int reports_ = 0;
    double ahead_s_ = 0, unsure_s_ = 2 * kLongestEncoderLag_s;
    double leaps_rad_per_s_ = 0, size_ = 0, speed_square_ = 0, position_square_ = 0, product_ = 0;
    bool differs_ = false;
};

// The angle that the encoder itself has shown.
class EncoderBehindLoop {
  public:
    // `lag_s`: 1 / b. A loop that follows within four of its own periods is left as it is.
    // `count_rad`: of the encoder, as an angle of the wheel; 0: not known.
    void configure(double lag_s, double loop_period_s, double report_period_s, double count_rad = 0) {
        count_rad_ = count_rad;
        report_period_s_ = report_period_s;
        loop_period_s_ = loop_period_s;
        half_period_ns_ = std::llround(1e9 * report_period_s / 2);
        most_off_beat_ns_ = std::llround(1e9 * std::max(kWaits_s, kOffBeat * report_period_s));
        off_s2_ = lag_s > kQuickLoop * loop_period_s ? lag_s * (lag_s - 2 * loop_period_s) : 0;
        ahead_s_ = 2 * lag_s - loop_period_s / 2;
        unsure_rad_ = 0;
    }
    bool undone() const { return off_s2_ != 0; }

    // The mean angle in the period before a report, at the middle of it. Where position and speed are not of
    // one loop, the mean of the positions.
    EncoderSample sample(const EncoderSample& reported) { return undone() ? undo(reported) : reported; }
    // Of that angle, where the lag is known to a hundredth: two hundredths by its square, one by the time.
    // And a count while the loop has more than one to go: it knows its own position to whole counts only.
    // Until the next count comes it goes on at its speed, and tells nothing: infinite, where the speed is the
    // same to the digit and the way no more than two counts.
    double unsure_rad() const { return unsure_rad_; }

  private:
    [[gnu::noinline]] EncoderSample undo(const EncoderSample& reported) {
        if (reported.time_ns == last_.time_ns || reported.time_ns == 0) return angle_;
        const std::int64_t since_ns = reported.time_ns - last_.time_ns;
        const std::int64_t periods = (since_ns + half_period_ns_) / (2 * half_period_ns_);
        // One off the others' beat someone has asked for; not where none has come in the beat for long.
        const bool off_beat =
            periods == 0 || std::abs(since_ns - 2 * half_period_ns_ * periods) > most_off_beat_ns_;
        if (last_.time_ns > 0 && since_ns > 0 && off_beat && since_ns < kNewBeat * half_period_ns_)
            return angle_;
        const auto reports = static_cast<double>(periods);
        double half_way_rad = 0, off_rad = 0;
        if (last_.time_ns > 0 && reports >= 1 && reports <= kMostReports) {
            const double way_rad = reported.position_rad - last_.position_rad;
            const double gained = reported.speed_rad_per_s - last_.speed_rad_per_s;
            const double speed = (reported.speed_rad_per_s + last_.speed_rad_per_s) / 2;
            const double by_speed_rad = way_rad - ahead_s_ * gained;
            double passed_s = reports * report_period_s_;
            half_way_rad = way_rad / (2 * reports);
            agreed_ = agree(by_speed_rad, speed, gained, passed_s) ? std::min(agreed_ + 1, kNotByChance) : 0;
            if (agreed_ == kNotByChance) {
                // a loop period more or less, by the way that it has gone
                if (speed != 0 && reports == 1)
                    passed_s = std::clamp(by_speed_rad / speed, passed_s - loop_period_s_,
                                          passed_s + loop_period_s_);
                const double rate = gained / passed_s;
                off_rad = off_s2_ * rate;
                if (reports > 1)
                    half_way_rad = report_period_s_ / 2 * (reported.speed_rad_per_s + ahead_s_ * rate);
            }
        }
        const double size_rad = std::abs(off_rad);
        unsure_rad_ = size_rad / 30 + (size_rad > count_rad_ ? count_rad_ : 0);
        if (reported.speed_rad_per_s == last_.speed_rad_per_s &&
            std::abs(reported.position_rad - last_.position_rad) <= 2 * count_rad_)
            unsure_rad_ = std::numeric_limits<double>::infinity();
        last_ = reported;
        angle_ = {reported.position_rad - half_way_rad + off_rad, reported.speed_rad_per_s,
                  reported.time_ns - half_period_ns_};
        return angle_;
    }
    // Position and speed are of one loop: but for a period of it at either end, the curve of the speed
    // between the reports, a twentieth of the lag, and a float's last digit after a thousand turns.
    bool agree(double by_speed_rad, double speed, double gained, double passed_s) const {
        constexpr double kDigit_rad = 4e-4;
        return std::abs(by_speed_rad - speed * passed_s) <=
               2 * loop_period_s_ * std::abs(speed) + (passed_s / 3 + ahead_s_ / 20) * std::abs(gained) +
                   kDigit_rad;
    }

    static constexpr double kQuickLoop = 4;   // of its periods
    static constexpr double kWaits_s = 5e-4;  // a frame for others, at most
    static constexpr double kOffBeat = 0.1;   // of a period: what a drive's clock and its tasks are late
    static constexpr int kNewBeat = 5;        // half periods
    static constexpr double kMostReports = 4;
    static constexpr int kNotByChance = 3;  // reports in a row
    double report_period_s_ = 0, loop_period_s_ = 0, off_s2_ = 0, ahead_s_ = 0, count_rad_ = 0;
    std::int64_t half_period_ns_ = 0, most_off_beat_ns_ = 0;
    EncoderSample last_, angle_;
    double unsure_rad_ = 0;
    int agreed_ = kNotByChance;
};

}  // namespace wheelwright::control
