// The torque of the ident mode: one PRBS for each wheel, kept within limits of speed, yaw rate and distance
// by OVERRIDING the torque. Nothing smooth is fed back, for that would correlate the torque with the noise of
// the measurement and bias the estimate; an override only replaces some bits by others of the same size, and
// the estimator is told the torque that was really used.
//
// A limit is watched with the velocity that the robot may reach before an override acts: the largest
// acceleration seen so far times a reaction time. Away from the start the speed outward is limited by the
// remaining distance, so the robot turns back by itself. Where one wheel may go backwards, what looks like
// turning may be forward motion: the same holds for it and for the mirror image's pose (mirror_test.hpp).
//
// Cost: about 80 operations a cycle. No allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "firmware/ident/prbs.hpp"
#include "firmware/model/types.hpp"

namespace wheelwright::ident {

template <typename Real>
struct ExcitationOptions {
    Real amplitude_Nm{};
    double bit_time_s{};
    double sample_time_s{};
    Real speed_limit_m_per_s{};
    Real yaw_rate_limit_rad_per_s{};
    Real distance_limit_m{};
    Real reaction_time_s = Real(0.01);  // measurement, actuation and drive until an override is felt
    Real half_track_m{};                // for a pose of the mirror image
};

template <typename Real>
class Excitation {
  public:
    // Which limits replaced the torque in the last step.
    struct Overrides {
        bool speed = false, yaw_rate = false, distance = false;
    };

    void start(const ExcitationOptions<Real>& options, const Pose<Real>& pose, std::uint32_t seed) {
        options_ = options;
        level_ = 1;
        start_ = pose;
        const auto samples =
            static_cast<unsigned>(std::max(1L, std::lround(options.bit_time_s / options.sample_time_s)));
        left_ = Prbs(kPrbsLeft, seed, samples);
        right_ = Prbs(kPrbsRight, seed ^ 0x5bd1e995U, samples);
        velocities_ = {};
        count_ = 0;
        peak_ = {};
        forward_ = turn_ = 0;
        overrides_ = {};
        overridden_cycles_ = 0;
    }

    // From now on the torque is this share of the amplitude.
    void set_level(Real share) { level_ = share; }

    // From now on.
    void set_limits(const Twist<Real>& limits) {
        options_.speed_limit_m_per_s = limits.v_m_per_s;
        options_.yaw_rate_limit_rad_per_s = limits.omega_rad_per_s;
    }

    // The wheel torques for this cycle, from the robot's measured pose and velocity; `mirrored`: where its
    // mirror image would be, if it may be that.
    WheelPair<Real> step(const Pose<Real>& pose, const Twist<Real>& velocity,
                         const Pose<Real>* mirrored = nullptr) {
        const Real a = level_ * options_.amplitude_Nm;
        WheelPair<Real> torque{a * static_cast<Real>(left_.next()), a * static_cast<Real>(right_.next())};
        watch_acceleration(velocity);
        const Real t = options_.reaction_time_s;
        const Kept forward = keep_near(forward_, &pose, velocity.v_m_per_s, options_.speed_limit_m_per_s,
                                       peak_.v_m_per_s2 * t);
        const Real h = mirrored != nullptr ? options_.half_track_m : Real(1);
        const Kept turn = keep_near(turn_, mirrored, h * velocity.omega_rad_per_s,
                                    h * options_.yaw_rate_limit_rad_per_s, h * peak_.omega_rad_per_s2 * t);
        overrides_.speed = forward == Kept::by_speed;
        overrides_.yaw_rate = turn == Kept::by_speed;
        overrides_.distance = forward == Kept::by_distance || turn == Kept::by_distance;
        if (forward_ != 0 && turn_ != 0) {
            // one wheel does both: it lies on the side that turns the robot back
            const bool use_right = turn_ == forward_;
            torque = use_right ? WheelPair<Real>{0, a * static_cast<Real>(forward_)}
                               : WheelPair<Real>{a * static_cast<Real>(forward_), 0};
        } else if (forward_ != 0) {
            torque = {a * static_cast<Real>(forward_), a * static_cast<Real>(forward_)};
        } else if (turn_ != 0) {
            torque = {-a * static_cast<Real>(turn_), a * static_cast<Real>(turn_)};
        }
        if (forward_ != 0 || turn_ != 0) ++overridden_cycles_;
        return torque;
    }

    const Overrides& overrides() const { return overrides_; }
    std::uint32_t overridden_cycles() const { return overridden_cycles_; }
    Real distance_m(const Pose<Real>& pose) const {
        const Real dx = pose.x_m - start_.x_m;
        const Real dy = pose.y_m - start_.y_m;
        return std::sqrt(dx * dx + dy * dy);
    }

  private:
    static constexpr std::size_t kSpan = 8;              // samples over which acceleration is seen
    static constexpr Real kHysteresis = Real(0.85);      // an override ends at this share of the limit
    static constexpr Real kOutwardGain_per_s = Real(3);  // speed outward per remaining distance
    static constexpr Real kTurnBackShare = Real(0.8);    // of the distance limit: the robot turns back
    static constexpr Real kLeastRoom = Real(0.3);        // of a limit that the reaction may not take

    void watch_acceleration(const Twist<Real>& velocity) {
        Twist<Real>& oldest = velocities_[count_ % kSpan];
        if (count_ >= kSpan) {
            const Real span_s = static_cast<Real>(kSpan * options_.sample_time_s);
            peak_.v_m_per_s2 =
                std::max(peak_.v_m_per_s2, std::abs(velocity.v_m_per_s - oldest.v_m_per_s) / span_s);
            peak_.omega_rad_per_s2 = std::max(
                peak_.omega_rad_per_s2, std::abs(velocity.omega_rad_per_s - oldest.omega_rad_per_s) / span_s);
        }
        oldest = velocity;
        ++count_;
    }

    // Turns the override on when `value` may leave [low, high] before it acts; off when well inside again.
    static bool keep_within(int& override_sign, Real value, Real low, Real high, Real reach) {
        const Real room = (high - low) / 2;
        const Real margin = std::min(reach, (1 - kLeastRoom) * room);
        const Real middle = (high + low) / 2;
        const Real half = room - margin;
        const Real offset = value - middle;
        if (offset > half) {
            override_sign = -1;
        } else if (offset < -half) {
            override_sign = 1;
        } else if (std::abs(offset) < kHysteresis * half) {
            override_sign = 0;
        }
        return override_sign != 0;
    }

    enum class Kept : std::uint8_t { not_at_all, by_speed, by_distance };

    // Keeps the speed along a pose's heading within a limit, and within what the way to the edge allows.
    Kept keep_near(int& override_sign, const Pose<Real>* pose, Real speed, Real limit, Real reach) const {
        Real low = -limit;
        Real high = limit;
        const Real dx = pose != nullptr ? pose->x_m - start_.x_m : Real(0);
        const Real dy = pose != nullptr ? pose->y_m - start_.y_m : Real(0);
        const Real distance = std::sqrt(dx * dx + dy * dy);
        const Real remaining = kTurnBackShare * options_.distance_limit_m - distance;
        bool near_edge = false;
        if (distance > 0) {
            // share of the motion that leads outward
            const Real outward =
                (dx * std::cos(pose->heading_rad) + dy * std::sin(pose->heading_rad)) / distance;
            const Real outward_limit = kOutwardGain_per_s * remaining;
            if (std::abs(outward) * limit > std::max(Real(0), outward_limit)) {
                const Real bound =
                    std::clamp(outward_limit / std::max(std::abs(outward), Real(0.05)), -limit / 2, limit);
                if (outward > 0) {
                    high = std::min(high, bound);
                } else {
                    low = std::max(low, -bound);
                }
                near_edge = true;
            }
        }
        if (!keep_within(override_sign, speed, low, high, reach)) return Kept::not_at_all;
        return near_edge ? Kept::by_distance : Kept::by_speed;
    }

    ExcitationOptions<Real> options_{};
    Real level_ = 1;
    Pose<Real> start_{};
    Prbs left_{kPrbsLeft, 0, 1};
    Prbs right_{kPrbsRight, 0, 1};
    std::array<Twist<Real>, kSpan> velocities_{};
    std::size_t count_ = 0;
    TwistRate<Real> peak_{};
    int forward_ = 0;  // sign of the override now active, 0 for none
    int turn_ = 0;
    Overrides overrides_{};
    std::uint32_t overridden_cycles_ = 0;
};

}  // namespace wheelwright::ident
