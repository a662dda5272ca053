// A small motion beside the one that is driven, forward and turning, so that mass and inertia can be told
// from the torque it takes, however calm the path is: accelerations at a wheel's rim that are sines of two
// periods without a common multiple. They are part of the reference and of its feed-forward, so the loops do
// not fight them. Where the path turns a wheel more slowly than the dither would, it fades away: dry friction
// would hold the wheel, or turn with it. Where it would pass a limit of speed, it is cut off there.
//
// One thread; no allocation. step(): about 50 instructions.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "firmware/control/reference.hpp"

namespace wheelwright::control {

template <typename Real>
class Dither {
  public:
    // None until amplitudes are set. `period_s`: of the forward motion. `limit`: of speed and yaw rate.
    void configure(Real period_s, Real cycle_s, Real track_m, const Twist<Real>& limit) {
        // the golden ratio keeps the two apart
        constexpr Real kTurningPeriod = Real(1.2360679774997898);
        constexpr Real kTwoPi = Real(6.283185307179586);
        half_track_m_ = track_m / 2;
        limit_ = limit;
        fade_per_cycle_ = cycle_s / period_s;
        for (std::size_t i = 0; i < 2; ++i) {
            Wave& w = wave_[i];
            w = {};
            w.rate_rad_per_s = kTwoPi / (i == 0 ? period_s : kTurningPeriod * period_s);
            w.turn_cosine = std::cos(w.rate_rad_per_s * cycle_s);
            w.turn_sine = std::sin(w.rate_rad_per_s * cycle_s);
        }
        slowest_m_per_s_ = 0;
        share_ = 0;
    }

    void set_amplitudes(Real forward_m_per_s2, Real turning_m_per_s2) {
        const std::array<Real, 2> rim{forward_m_per_s2, turning_m_per_s2};
        slowest_m_per_s_ = 0;
        for (std::size_t i = 0; i < 2; ++i) {
            Wave& w = wave_[i];
            w.acceleration = i == 0 ? rim[i] : rim[i] / half_track_m_;
            w.speed = w.acceleration / w.rate_rad_per_s;
            slowest_m_per_s_ += kSlowestOverDither * rim[i] / w.rate_rad_per_s;
        }
    }

    // Adds to the reference.
    void step(VelocityReference<Real>& reference) {
        const Real v = std::abs(reference.twist.v_m_per_s);
        const Real rim = half_track_m_ * std::abs(reference.twist.omega_rad_per_s);
        const bool on = std::abs(v - rim) > slowest_m_per_s_;
        share_ = std::clamp(share_ + (on ? fade_per_cycle_ : -fade_per_cycle_), Real(0), Real(1));
        for (Wave& w : wave_) w.step();
        add(wave_[0], limit_.v_m_per_s, reference.twist.v_m_per_s, reference.rate.v_m_per_s2);
        add(wave_[1], limit_.omega_rad_per_s, reference.twist.omega_rad_per_s,
            reference.rate.omega_rad_per_s2);
    }

  private:
    static constexpr Real kSlowestOverDither = 2;  // a wheel's speed then never comes near zero
    struct Wave {
        Real rate_rad_per_s = 1, turn_cosine = 1, turn_sine{}, cosine = 1, sine{};
        Real speed{}, acceleration{};  // amplitudes, of v or omega

        void step() {
            const Real c = cosine * turn_cosine - sine * turn_sine;
            const Real s = sine * turn_cosine + cosine * turn_sine;
            const Real scale = (3 - c * c - s * s) / 2;  // back to a length of 1
            cosine = c * scale;
            sine = s * scale;
        }
    };

    void add(const Wave& wave, Real limit, Real& speed, Real& rate) const {
        const Real wanted = speed + share_ * wave.speed * wave.sine;
        if (std::abs(wanted) <= limit) {
            speed = wanted;
            rate += share_ * wave.acceleration * wave.cosine;
        } else {
            const Real most = std::max(limit, std::abs(speed));
            speed = std::clamp(wanted, -most, most);
        }
    }

    std::array<Wave, 2> wave_{};
    Twist<Real> limit_;
    Real slowest_m_per_s_{};  // of a wheel, that the dither is let beside
    Real half_track_m_ = 1, fade_per_cycle_{}, share_{};
};

}  // namespace wheelwright::control
