// Turns samples of the cycle (wheel angles, torque told to the drives) into rows of the two regressions,
// paper eq (50)-(55), without differentiating noise.
//
// Time is cut into blocks of m samples. With S_b the sum of the wheel angle over block b, exactly
//     y = (S_b+1 - 2 S_b + S_b-1) / (m^3 dt^2)
// is the wheel acceleration averaged with the weight box * box * box (each m samples long; a quadratic
// B-spline of 3 m samples). The regressors are averaged with the same weight, so both sides stay equal
// whatever happens between the samples. Sensor noise that is white in the angle is white in S, so a row
// carries the second difference of white noise: that colour is what coloured_errors.hpp is told.
//
// All sums start anew in each block: ten hours of running drift no more than ten milliseconds.
//
// Everything is evaluated at one instant a few samples in the past (half the speed's span, and two): there
// the wheel speed is a central difference, the torque is the piecewise constant one that the drives applied
// after `delay_s` (fractions too), averaged over the sample, and the sign of a sliding speed is averaged with
// its zero crossing interpolated.
//
// Cost: per sample about 25 + 6 (2 + 2 taps + 2 columns) operations and two divisions for each dry parameter;
// a row (every m samples) about 10 for each signal. No allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/effects.hpp"

namespace wheelwright::ident {

// What the cycle hands over, once per cycle.
template <typename Real>
struct IdentSample {
    WheelPair<double> angle_rad;     // both wheels at the cycle's time base, unwrapped; double: it grows
    WheelPair<Real> last_torque_Nm;  // what the drives were told at the end of the previous cycle
    Real heading_rad{};              // for effects that depend on it
    bool usable = true;              // false: slip, a torque that was not followed: masks the rows it touches
};

// One row of both regressions. Sums and differences are right + left and right - left.
template <typename Real, int kTaps = 1>
struct RegressionRow {
    TwistRate<Real> acceleration;  // y1, y2
    Real omega_squared{};          // K5's regressor
    Real v_omega{};                // K6's regressor
    Real v_squared{};              // with several taps only: what unlike wheels and a mirrored robot show
    std::array<WheelPair<Real>, kTaps> torque_Nm{};                     // one for each tap
    std::array<WheelPair<Real>, model::kMaxEstimatedColumns> column{};  // torque per unit of a parameter
    // Of three taps only: the middle tap's torque while a dry parameter's sign of sliding is not known for
    // sure, else zero.
    WheelPair<Real> slow_torque_Nm{};
    bool usable = false;  // no wheel stood still, no sample was marked unusable
};

template <typename Real>
struct RegressionFilterOptions {
    model::Geometry<double> geometry;
    // Columns are made for model::estimated_effects(); the torque of the other active ones is known by their
    // values, and part of the rows' torque.
    model::EffectSet<Real> effects;
    model::Dynamics<Real> dynamics;  // used by known effects only
    double sample_time_s{};
    double kernel_s{};       // half the averaging weight's length
    double delay_s{};        // from a cycle's start to the centroid of its torque
    double sample_age_s{};   // the part of it that the samples are known to be old
    double tap_spacing_s{};  // between torque columns, if there are several
    int speed_span = 2;  // samples over which a speed is taken: even, 2 to 24. More where encoders are coarse
    // A wheel slower than this for more than so many samples may be held by dry friction: the row is not
    // usable.
    Real standing_speed_rad_per_s = Real(0.2);
    int standing_samples = 5;
};

// The torque columns are kTaps wide, evenly spaced about `delay_s`: one for a known actuator, three where the
// drive's lag is estimated too, four where the delay is.

template <typename Real, int kTaps = 1>
class RegressionFilter {
  public:
    static constexpr int kMinimumBlock = 6;  // samples: the estimators spread a row over five cycles

    void configure(const RegressionFilterOptions<Real>& options) {
        sample_time_s_ = options.sample_time_s;
        dynamics_ = options.dynamics;
        standing_speed_rad_per_s_ = options.standing_speed_rad_per_s;
        standing_samples_ = options.standing_samples;
        const double dt = options.sample_time_s;
        block_ = std::max(kMinimumBlock, static_cast<int>(std::lround(2 * options.kernel_s / (3 * dt))));
        inverse_block_ = Real(1) / static_cast<Real>(block_);
        const double m = block_;
        row_scale_ = static_cast<Real>(1 / (m * (m * dt) * (m * dt)));
        span_ = static_cast<unsigned>(options.speed_span);
        latency_ = static_cast<int>(span_ / 2) + 2;
        history_ = static_cast<unsigned>(latency_) + static_cast<unsigned>(kMaximumDelay) + 2;
        speed_scale_ = static_cast<Real>(1 / (span_ * dt));
        weight_scale_ = Real(1) / static_cast<Real>(2 * block_ * block_);
        geometry_ = {{static_cast<Real>(options.geometry.wheel_radius_m.left),
                      static_cast<Real>(options.geometry.wheel_radius_m.right)},
                     static_cast<Real>(options.geometry.track_m)};
        inverse_track_ = static_cast<Real>(1 / options.geometry.track_m);
        estimated_ = model::estimated_effects(options.effects.active);
        known_ = options.effects;
        columns_ = 0;
        have_known_ = false;
        for (std::size_t i = 0; i < model::kEffectCount; ++i) {
            if (estimated_[i]) columns_ += static_cast<int>(model::kEffects[i].parameters.size());
            known_.active[i] = options.effects.active[i] && !estimated_[i];
            have_known_ = have_known_ || known_.active[i];
        }
        set_delay(options.delay_s, options.tap_spacing_s);
        restart();
    }

    // Each tap is clipped to what the history holds (-2 to 27 samples). The rows under way mix both delays.
    void set_delay(double delay_s, double tap_spacing_s = 0) {
        for (int k = 0; k < kTaps; ++k) {
            const double at_s = delay_s + (k - (kTaps - 1) / 2.0) * tap_spacing_s;
            const double samples = std::clamp(at_s / sample_time_s_, kMinimumDelay, kMaximumDelay);
            Tap& tap = tap_[static_cast<std::size_t>(k)];
            const double whole = std::floor(samples);
            tap.back = static_cast<unsigned>(latency_ - 1 + static_cast<int>(whole));
            const auto f = static_cast<Real>(samples - whole);
            tap.newest = (1 - f) * (1 - f) / 2;
            tap.oldest = f * f / 2;
            tap.middle = 1 - tap.newest - tap.oldest;
        }
    }

    // Forgets all samples: after a gap, a reset of the angles, or when the torque was not what was told.
    void restart() {
        warm_up_ = 0;
        position_in_block_ = 0;
        blocks_ = 0;
        standing_now_ = {};
        masked_blocks_ = 0;
        clear_block();
        pending_ = {};
        last_early_ = {};
        angle_sum_ = {};
        angle_sum_before_ = {};
    }

    // True when row() is new: every block_samples() samples, after three blocks.
    bool push(const IdentSample<Real>& sample) {
        const unsigned now = now_++;  // may wrap: the rings' sizes are powers of two
        angle_[now % kAngles] = sample.angle_rad;
        torque_[now % kTorques] = sample.last_torque_Nm;
        bool warm = warm_up_ >= history_;
        if (!warm) {
            if (++warm_up_ <= span_ + 1) return false;
            warm = warm_up_ >= history_;
        }

        // speed two samples ago; everything else three samples ago, between the speeds before and after
        const WheelPair<double>& newest = angle_[(now - 1) % kAngles];
        const WheelPair<double>& oldest = angle_[(now - 1 - span_) % kAngles];
        speed_[0] = speed_[1];
        speed_[1] = speed_[2];
        speed_[2] = {static_cast<Real>(newest.left - oldest.left) * speed_scale_,
                     static_cast<Real>(newest.right - oldest.right) * speed_scale_};
        if (!warm) return false;  // history not yet filled
        if (!sample.usable) masked_in_block_ = true;
        return take_instant(now, sample.heading_rad);
    }

    const RegressionRow<Real, kTaps>& row() const { return row_; }
    int block_samples() const { return block_; }
    int columns() const { return columns_; }  // those of the estimated effects, in catalogue order
    const std::array<bool, model::kEffectCount>& estimated() const { return estimated_; }

  private:
    static constexpr unsigned kAngles = 32;
    static constexpr unsigned kTorques = 64;
    static constexpr double kMinimumDelay = -2;
    static constexpr double kMaximumDelay = 27;
    static constexpr bool kSeesErrors = kTaps == 3;
    static constexpr std::size_t kFirstTap = kTaps > 1 ? 3 : 2;  // behind the products of the speeds
    static constexpr std::size_t kSlow = kFirstTap + 2 * static_cast<std::size_t>(kTaps);
    static constexpr std::size_t kFirstColumn = kSeesErrors ? kSlow + 2 : kSlow;
    static constexpr std::size_t kSignals = kFirstColumn + 2 * model::kMaxEstimatedColumns;
    using Signals = std::array<Real, kSignals>;

    struct Tap {
        unsigned back = 0;  // torques ago, at the row's instant
        Real newest{}, middle{}, oldest{};
    };
    // A block's share in the three rows it is part of.
    struct AngleSum {
        WheelPair<double> reference;  // angle at the block's first sample
        WheelPair<Real> above;        // sum of the angles less the reference
    };

    // Mean sign of a speed that goes linearly from `a` to `b`.
    static Real mean_sign(Real a, Real b) {
        const Real size = std::abs(a) + std::abs(b);
        return size > 0 ? (a + b) / size : Real(0);
    }

    bool take_instant(unsigned now, Real heading_rad) {
        // twice the span, half the noise: for everything but the signs, which must not miss a short reversal
        const WheelPair<Real> speed{(speed_[0].left + speed_[2].left) / 2,
                                    (speed_[0].right + speed_[2].right) / 2};
        Signals g{};
        fill_signals(now, heading_rad, speed, g);
        if (have_known_) add_known_torque(now, heading_rad, speed, g);

        const int j = position_in_block_;
        const Real early = static_cast<Real>(j * (j + 1)) * weight_scale_;
        const Real late = static_cast<Real>((block_ - 1 - j) * (block_ - j)) * weight_scale_;
        const std::size_t used = kFirstColumn + 2 * static_cast<std::size_t>(columns_);
        for (std::size_t i = 0; i < used; ++i) {
            plain_[i] += g[i];
            early_[i] += early * g[i];
            late_[i] += late * g[i];
        }

        const WheelPair<double>& angle = angle_[(now - static_cast<unsigned>(latency_)) % kAngles];
        if (j == 0) angle_sum_now_ = {angle, {}};
        angle_sum_now_.above.left += static_cast<Real>(angle.left - angle_sum_now_.reference.left);
        angle_sum_now_.above.right += static_cast<Real>(angle.right - angle_sum_now_.reference.right);

        count_standing(standing_now_.left, speed.left);
        count_standing(standing_now_.right, speed.right);

        if (++position_in_block_ < block_) return false;
        position_in_block_ = 0;
        return finish_block();
    }

    void fill_signals(unsigned now, Real heading_rad, const WheelPair<Real>& speed, Signals& g) {
        const model::Motion<Real> motion = motion_at(now, heading_rad, speed);
        g[0] = motion.twist.omega_rad_per_s * motion.twist.omega_rad_per_s;
        g[1] = motion.twist.v_m_per_s * motion.twist.omega_rad_per_s;
        if constexpr (kTaps > 1) g[2] = motion.twist.v_m_per_s * motion.twist.v_m_per_s;
        for (std::size_t k = 0; k < static_cast<std::size_t>(kTaps); ++k) {
            const Tap& tap = tap_[k];
            // torque_[n] was told in cycle n - 1
            const unsigned n = now - tap.back;
            const WheelPair<Real>& a = torque_[n % kTorques];
            const WheelPair<Real>& b = torque_[(n - 1) % kTorques];
            const WheelPair<Real>& c = torque_[(n - 2) % kTorques];
            g[kFirstTap + 2 * k] = tap.newest * a.left + tap.middle * b.left + tap.oldest * c.left;
            g[kFirstTap + 1 + 2 * k] = tap.newest * a.right + tap.middle * b.right + tap.oldest * c.right;
        }
        const model::EffectContext<Real> context{motion, {}, geometry_, dynamics_};
        std::size_t at = kFirstColumn;
        model::for_each_column(estimated_, context,
                               [&](std::size_t, unsigned, const WheelPair<Real>& column, bool dry) {
                                   const Real amount = dry ? -mean_sliding_sign(column) : Real(1);
                                   g[at++] = amount * column.left;
                                   g[at++] = amount * column.right;
                                   if constexpr (kSeesErrors) {
                                       if (dry && unsure(column, speed, amount)) add_slow_torque(column, g);
                                   }
                               });
    }

    // Whether the sign of sliding changes about now, or is lost in the noise.
    bool unsure(const WheelPair<Real>& direction, const WheelPair<Real>& speed, Real sign) const {
        return std::abs(sign) < 1 ||
               std::abs(model::sliding_speed(direction, speed)) < standing_speed_rad_per_s_;
    }
    static void add_slow_torque(const WheelPair<Real>& direction, Signals& g) {
        constexpr std::size_t kMiddle = kFirstTap + 2 * (static_cast<std::size_t>(kTaps) / 2);
        const Real along = direction.left * g[kMiddle] + direction.right * g[kMiddle + 1];
        g[kSlow] += along * direction.left;
        g[kSlow + 1] += along * direction.right;
    }

    model::Motion<Real> motion_at(unsigned now, Real heading_rad, const WheelPair<Real>& speed) const {
        const WheelPair<double>& angle = angle_[(now - static_cast<unsigned>(latency_)) % kAngles];
        const Real left = geometry_.wheel_radius_m.left * speed.left;
        const Real right = geometry_.wheel_radius_m.right * speed.right;
        return {speed,
                {static_cast<Real>(angle.left), static_cast<Real>(angle.right)},
                {(right + left) / 2, (right - left) * inverse_track_},
                heading_rad};
    }

    // Every tap's torque becomes what arrives of it at the wheels, and what the known effects add there.
    [[gnu::noinline]] void add_known_torque(unsigned now, Real heading_rad, const WheelPair<Real>& speed,
                                            Signals& g) const {
        const model::Motion<Real> motion = motion_at(now, heading_rad, speed);
        model::EffectContext<Real> context{motion, {}, geometry_, dynamics_};
        WheelPair<Real> known = model::smooth_effect_torque_Nm(known_, context);
        model::for_each_dry(known_, geometry_, speed,
                            [&](std::size_t, unsigned, const WheelPair<Real>& d, Real limit_Nm) {
                                const Real amount = -limit_Nm * mean_sliding_sign(d);
                                known.left += amount * d.left;
                                known.right += amount * d.right;
                            });
        for (std::size_t k = 0; k < static_cast<std::size_t>(kTaps); ++k) {
            context.applied_torque_Nm = {g[kFirstTap + 2 * k], g[kFirstTap + 1 + 2 * k]};
            const WheelPair<Real> delivered = model::delivered_torque_Nm(known_, context);
            g[kFirstTap + 2 * k] = delivered.left + known.left;
            g[kFirstTap + 1 + 2 * k] = delivered.right + known.right;
        }
    }

    Real mean_sliding_sign(const WheelPair<Real>& direction) const {
        const Real before = model::sliding_speed(direction, speed_[0]);
        const Real here = model::sliding_speed(direction, speed_[1]);
        const Real after = model::sliding_speed(direction, speed_[2]);
        return (mean_sign(before, here) + mean_sign(here, after)) / 2;
    }

    void count_standing(int& run, Real speed) {
        if (std::abs(speed) >= standing_speed_rad_per_s_) {
            run = 0;
        } else if (++run > standing_samples_) {
            masked_in_block_ = true;
        }
    }

    bool finish_block() {
        masked_blocks_ = (masked_blocks_ << 1U | (masked_in_block_ ? 1U : 0U)) & 7U;
        const bool complete = blocks_ >= 2;
        if (complete) make_row();
        // this block is the middle of the next row and the oldest of the one after
        const std::size_t used = kFirstColumn + 2 * static_cast<std::size_t>(columns_);
        for (std::size_t i = 0; i < used; ++i) {
            pending_[i] = last_early_[i] + plain_[i] - early_[i] - late_[i];
            last_early_[i] = early_[i];
        }
        angle_sum_before_ = angle_sum_;
        angle_sum_ = angle_sum_now_;
        clear_block();
        if (blocks_ < 2) ++blocks_;
        return complete;
    }

    void make_row() {
        Signals g{};
        const std::size_t used = kFirstColumn + 2 * static_cast<std::size_t>(columns_);
        for (std::size_t i = 0; i < used; ++i) g[i] = (pending_[i] + late_[i]) * inverse_block_;
        const Real left = geometry_.wheel_radius_m.left *
                          angle_acceleration(&WheelPair<double>::left, &WheelPair<Real>::left);
        const Real right = geometry_.wheel_radius_m.right *
                           angle_acceleration(&WheelPair<double>::right, &WheelPair<Real>::right);
        row_.acceleration = {(right + left) / 2, (right - left) * inverse_track_};
        row_.omega_squared = g[0];
        row_.v_omega = g[1];
        if constexpr (kTaps > 1) row_.v_squared = g[2];
        for (std::size_t k = 0; k < static_cast<std::size_t>(kTaps); ++k)
            row_.torque_Nm[k] = {g[kFirstTap + 2 * k], g[kFirstTap + 1 + 2 * k]};
        for (std::size_t c = 0; c < static_cast<std::size_t>(columns_); ++c)
            row_.column[c] = {g[kFirstColumn + 2 * c], g[kFirstColumn + 2 * c + 1]};
        if constexpr (kSeesErrors) {
            row_.slow_torque_Nm = {g[kSlow], g[kSlow + 1]};
        }
        row_.usable = masked_blocks_ == 0;
    }

    Real angle_acceleration(double WheelPair<double>::*reference, Real WheelPair<Real>::*above) const {
        const double turned = (angle_sum_now_.reference.*reference - angle_sum_.reference.*reference) -
                              (angle_sum_.reference.*reference - angle_sum_before_.reference.*reference);
        const Real rest = (angle_sum_now_.above.*above - angle_sum_.above.*above) -
                          (angle_sum_.above.*above - angle_sum_before_.above.*above);
        return (static_cast<Real>(block_) * static_cast<Real>(turned) + rest) * row_scale_;
    }

    void clear_block() {
        plain_ = {};
        early_ = {};
        late_ = {};
        masked_in_block_ = false;
    }

    double sample_time_s_{};
    model::Dynamics<Real> dynamics_;
    Real standing_speed_rad_per_s_{};
    int standing_samples_ = 0;
    int block_ = kMinimumBlock;
    int columns_ = 0;
    unsigned span_ = 2;      // samples
    int latency_ = 3;        // samples
    unsigned history_ = 32;  // samples before the first row
    Real inverse_block_{}, row_scale_{}, speed_scale_{}, weight_scale_{}, inverse_track_{};
    model::Geometry<Real> geometry_{};
    std::array<bool, model::kEffectCount> estimated_{};
    model::EffectSet<Real> known_;
    bool have_known_ = false;
    std::array<Tap, kTaps> tap_{};

    unsigned now_ = 0;
    unsigned warm_up_ = 0;
    std::array<WheelPair<double>, kAngles> angle_{};
    std::array<WheelPair<Real>, kTorques> torque_{};
    std::array<WheelPair<Real>, 3> speed_{};  // before, at and after the instant

    int position_in_block_ = 0;
    int blocks_ = 0;
    Signals plain_{}, early_{}, late_{};  // of the block under way
    Signals pending_{}, last_early_{};    // of the two blocks before
    AngleSum angle_sum_now_{}, angle_sum_{}, angle_sum_before_{};
    WheelPair<int> standing_now_{};
    unsigned masked_blocks_ = 0;
    bool masked_in_block_ = false;
    RegressionRow<Real, kTaps> row_{};
};

}  // namespace wheelwright::ident
