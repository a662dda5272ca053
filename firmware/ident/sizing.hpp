// How an identification is laid out for the robot that the probe found: amplitude, bits, averaging, limits. A
// number that was given is obeyed; 0 means that it follows from here.
//
// Every constant is a share of something the robot or its file says, or a time in cycles.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "firmware/ident/mirror_test.hpp"
#include "firmware/ident/probe.hpp"
#include "firmware/model/effects.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"

namespace wheelwright::ident {

struct SizingRequest {
    // 0: to be chosen
    double amplitude_Nm{}, bit_time_s{}, kernel_s{}, speed_limit_m_per_s{}, yaw_rate_limit_rad_per_s{},
        coupling_standard_error_m{};
    // given
    double track_m{}, radius_m{}, sample_time_s{}, report_period_s{}, distance_limit_m{}, torque_limit_Nm{},
        robot_speed_limit_m_per_s{}, robot_yaw_rate_limit_rad_per_s{};
};

struct Sizing {
    protocol::IdentCause obstacle = protocol::IdentCause::none;  // why there can be none
    double amplitude_Nm{}, bit_time_s{}, kernel_s{}, coupling_standard_error_m{};
    double speed_limit_m_per_s{}, yaw_rate_limit_rad_per_s{};  // when the wheels' signs are known
    double dry_share{};                                        // friction over amplitude
    double standing_speed_rad_per_s{};                         // below it a wheel may be held by friction
    int speed_span{};        // samples that a speed is taken over; see RegressionFilterOptions
    int standing_samples{};  // and for longer than this
};

// The room is crossed from its middle to its edge in about two seconds: time to turn back without hurry.
inline constexpr double kSpeedPerRoom_per_s = 8.0 / 15;
// Braking from the speed limit takes this share of the room.
inline constexpr double kBrakingShare = 0.15;
// Of the speed limit that one bit changes the speed by: less wastes the room that the limit gives, more makes
// the overrides choose the torque instead of the sequence.
inline constexpr double kBitShare = 0.48;
// Bits: the shortest still pass through 5 ms of delay and lag; the longest leave enough rows in a minute.
inline constexpr double kShortestBit_s = 0.016;
inline constexpr double kLongestBit_s = 0.050;
// And reports of the encoders: a parabola goes through three.
inline constexpr double kReportsInABit = 3;
// And lags of the drives' encoder loops: how a wheel turns round is what a slow one shows least of, and in
// short bits all is turning round.
inline constexpr double kLagsInABit = 3;
// Torque: what fills the limits in so long a bit, or so many times the friction.
inline constexpr double kCalmBit_s = 0.055;
inline constexpr double kOverFriction = 12;
// Below the torque at which a drive clips, as it says itself, and as the motion says.
inline constexpr double kBelowReported = 0.95;
inline constexpr double kBelowSeen = 0.9;

// Speed limits by themselves, before anything is known of the robot but its file.
inline double speed_limit_m_per_s(const SizingRequest& r) {
    const double auto_limit = kSpeedPerRoom_per_s * r.distance_limit_m;
    return std::min(r.speed_limit_m_per_s > 0 ? r.speed_limit_m_per_s : auto_limit,
                    r.robot_speed_limit_m_per_s);
}
// As fast at the wheels as straight on.
inline double yaw_rate_limit_rad_per_s(const SizingRequest& r, double speed_limit) {
    const double auto_limit = 2 * speed_limit / r.track_m;
    return std::min(r.yaw_rate_limit_rad_per_s > 0 ? r.yaw_rate_limit_rad_per_s : auto_limit,
                    r.robot_yaw_rate_limit_rad_per_s);
}

// Kernels are blocks of two thirds of them, without a common factor with a bit's samples (see
// DynamicsEstimatorOptions). Short blocks lose less of the time in which a wheel stands and keep the fast
// part of the motion; they are made longer, up to a bit, where the encoders' noise asks for it.
inline constexpr double kShortestBlock = 0.7;  // of a bit
inline constexpr double kLongestBlock = 1.0;
inline double kernel_for_bit_s(double bit_time_s, double sample_time_s, double quiet_block_s = 0) {
    const auto bit = static_cast<int>(std::lround(bit_time_s / sample_time_s));
    int block = std::max(6, static_cast<int>(std::lround(std::clamp(
                                quiet_block_s / sample_time_s, kShortestBlock * bit, kLongestBlock * bit))));
    const auto share_a_factor = [](int a, int b) {  // Euclid
        while (b != 0) a = std::exchange(b, a % b);
        return a != 1;
    };
    while (share_a_factor(block, bit)) ++block;
    return 1.5 * block * sample_time_s;
}

// The block over which an angle's noise, as the second difference of means over blocks, sqrt(6 dt / B) noise
// / B^2, is this share of an acceleration.
inline constexpr double kQuietShare = 0.005;
inline double quiet_block_s(double angle_noise_rad, double acceleration_rad_per_s2, double sample_time_s) {
    return std::pow(
        Real(std::sqrt(6 * sample_time_s) * angle_noise_rad / (kQuietShare * acceleration_rad_per_s2)),
        Real(2.0 / 5));
}

// A limit that the measured speed's own noise would cross is none. The noise is the observer's, as
// feedback_linearisation.hpp has it for one wheel, of the mean of two; with the largest bandwidth that
// velocity_loop_speed.hpp gives, 12.5 in fifty cycles.
inline constexpr double kLeastSpeedOverNoise = 10;
inline double speed_noise_m_per_s(const SizingRequest& r, const ProbeFindings& found) {
    constexpr double kFastestObserver = 12.5 / 50;  // over a cycle
    return r.radius_m * found.angle_noise_rad * kFastestObserver / r.sample_time_s *
           std::sqrt(kFastestObserver / 2);
}

// A wheel that turns by no more than `still_rad`, such as the noise, in the time that a speed is taken over,
// may stand.
inline constexpr double kStillNoises = 3 * 1.4142135623730951;  // three standard deviations of a difference
// And a whole step where the encoder is coarse. That is noise while a wheel turns and none while it stands,
// half of which a drive's own loop may have taken away. Noise at rest counts double, for both are measured in
// tenths of a second.
inline double hidden_by_noise_rad(double noise_rad, double rest_noise_rad) {
    const double of_steps = std::max(noise_rad * noise_rad - 2 * rest_noise_rad * rest_noise_rad, 0.0);
    return kStillNoises * noise_rad + 2 * kStepPerNoise * std::sqrt(of_steps);
}
inline double standing_speed_rad_per_s(double still_rad, int speed_span, double sample_time_s) {
    return still_rad / ((speed_span + 2) * sample_time_s);
}

// Over how many samples a speed is taken, and what stands: so long that a wheel which turns round with the
// slowest acceleration, theta = a t^2 / 2, shows its sign about as long as the noise hides it, or the time
// between reports: an angle is the mean of two reports, half a period old, and lies on a parabola to the
// next. One that stays within that for longer stands.
struct SpeedSpan {
    int samples{}, standing_samples{};  // as in RegressionFilterOptions
    double standing_speed_rad_per_s{};
};
// `noise_still_rad`: hidden_by_noise_rad(); `slowest_rad_per_s2`: of a wheel that turns round, > 0;
// `report_period_s`: of the encoders, 0 where it hides nothing.
inline SpeedSpan speed_span(double noise_still_rad, double slowest_rad_per_s2, double sample_time_s,
                            double report_period_s) {
    constexpr double kTurningShare = 0.8;
    constexpr double kSpanShare = 0.6;
    constexpr double kHiddenReports = 1.5;
    const double hidden_s = kHiddenReports * report_period_s;
    const double still_rad = std::max(noise_still_rad, slowest_rad_per_s2 * hidden_s * hidden_s / 2);
    const double turning_samples =
        kTurningShare * std::sqrt(2 * still_rad / slowest_rad_per_s2) / sample_time_s;
    SpeedSpan span;
    span.samples = 2 * static_cast<int>(std::clamp(std::round(kSpanShare * turning_samples / 2), 1.0, 12.0));
    span.standing_samples = static_cast<int>(std::max(4.0, std::ceil(turning_samples)));
    span.standing_speed_rad_per_s = standing_speed_rad_per_s(still_rad, span.samples, sample_time_s);
    return span;
}

// Friction that the robot file does not list gets columns where they are worth it: without them K7 and K8 are
// off by its share of the torque at most, and that may be more than their wanted standard error. Only as far
// as there is room beside what is listed, not where dry friction is listed in another form, and not where the
// file keeps numbers of it but says that they are not active.
template <typename Real>
void add_friction(model::EffectSet<Real>& effects, double dry_share, double relative_standard_error) {
    constexpr std::size_t kDry = model::find_effect("coulomb_friction");
    constexpr std::size_t kViscous = model::find_effect("viscous_friction");
    constexpr std::size_t kOtherDry = model::find_effect("stribeck_friction");
    static_assert(std::max({kDry, kViscous, kOtherDry}) < model::kEffectCount);
    if (dry_share <= relative_standard_error || effects.active[kOtherDry]) return;
    for (const std::size_t i : {kDry, kViscous}) {
        const model::Parameters<Real>& kept = effects.parameter[i];
        if (std::any_of(kept.begin(), kept.end(), [](Real value) { return value != 0; })) continue;
        std::array<bool, model::kEffectCount> with = effects.active;
        with[i] = true;
        std::array<bool, model::kEffectCount> expected = model::estimated_effects(effects.active);
        expected[i] = true;
        if (model::estimated_effects(with) == expected) effects.active = with;
    }
}

inline Sizing size_identification(const SizingRequest& r, const ProbeFindings& found) {
    using protocol::IdentCause;
    Sizing s;
    const double k7 = found.k7_per_kg_m;
    const double k8 = found.k8_per_kg_m2;
    const double friction = found.friction_Nm;
    const double arrives = !found.clipped ? 1 : found.clipped_by_report ? kBelowReported : kBelowSeen;
    s.amplitude_Nm =
        std::min(r.amplitude_Nm > 0 ? r.amplitude_Nm : r.torque_limit_Nm, arrives * found.torque_limit_Nm);
    if (!(s.amplitude_Nm > kMovesEnough * friction)) {
        s.obstacle = found.clipped ? IdentCause::torque_not_followed : IdentCause::too_heavy;
        return s;
    }
    const double braking = 2 * (s.amplitude_Nm + friction) * k7;
    s.speed_limit_m_per_s = speed_limit_m_per_s(r);
    if (r.speed_limit_m_per_s <= 0)
        s.speed_limit_m_per_s =
            std::min(s.speed_limit_m_per_s, std::sqrt(2 * braking * kBrakingShare * r.distance_limit_m));
    s.yaw_rate_limit_rad_per_s = yaw_rate_limit_rad_per_s(r, s.speed_limit_m_per_s);
    // What follows is laid out for what the run begins with.
    Twist<double> limits{s.speed_limit_m_per_s, s.yaw_rate_limit_rad_per_s};
    if (!found.pose_seen) limits = within_either(limits, r.track_m / 2);
    if (limits.v_m_per_s < kLeastSpeedOverNoise * speed_noise_m_per_s(r, found)) {
        s.obstacle = IdentCause::no_room;
        return s;
    }

    const auto bit_at = [&](double amplitude) {
        return kBitShare * std::min(limits.v_m_per_s / k7, limits.omega_rad_per_s / k8) / (2 * amplitude);
    };
    // No more torque than fills the limits in kCalmBit_s, unless friction would take much of that: longer
    // bits leave more of the motion below the encoders' noise, and less of it rests on the delay.
    if (r.amplitude_Nm <= 0)
        s.amplitude_Nm = std::min(s.amplitude_Nm, std::max(bit_at(1) / kCalmBit_s, kOverFriction * friction));
    double bit = bit_at(s.amplitude_Nm);
    const double shortest_s =
        std::max({kShortestBit_s, kReportsInABit * r.report_period_s, kLagsInABit * found.encoder_lag_s});
    if (bit < shortest_s && r.amplitude_Nm <= 0) {
        const double gentle = s.amplitude_Nm * bit / shortest_s;
        if (gentle < kMovesEnough * friction) {
            s.obstacle = IdentCause::no_room;
            return s;
        }
        s.amplitude_Nm = gentle;
        bit = shortest_s;
    }
    s.dry_share = friction / s.amplitude_Nm;
    bit = std::clamp(bit, shortest_s, std::max(shortest_s, kLongestBit_s));
    s.bit_time_s = r.bit_time_s > 0 ? r.bit_time_s : r.sample_time_s * std::round(bit / r.sample_time_s);
    const double weakest_per_Nm = std::min(2 * k7, k8 * r.track_m) / r.radius_m;  // at a wheel
    const double quiet_s =
        quiet_block_s(found.angle_noise_rad, weakest_per_Nm * s.amplitude_Nm, r.sample_time_s);
    s.kernel_s = r.kernel_s > 0 ? r.kernel_s : kernel_for_bit_s(s.bit_time_s, r.sample_time_s, quiet_s);

    // K5 matters by K5 omega^2 beside the acceleration that the torque gives: known to so small a share of
    // it, or to a length that no ruler tells.
    constexpr double kCouplingShare = 0.00035;
    constexpr double kCouplingLength = 1.0 / 3000;  // of the track
    const double omega = limits.omega_rad_per_s;
    s.coupling_standard_error_m = r.coupling_standard_error_m > 0
                                      ? r.coupling_standard_error_m
                                      : std::max(kCouplingLength * r.track_m,
                                                 kCouplingShare * 2 * s.amplitude_Nm * k7 / (omega * omega));

    const SpeedSpan span =
        speed_span(hidden_by_noise_rad(found.angle_noise_rad, found.rest_noise_rad),
                   weakest_per_Nm * (s.amplitude_Nm - friction), r.sample_time_s, r.report_period_s);
    s.speed_span = span.samples;
    s.standing_samples = span.standing_samples;
    s.standing_speed_rad_per_s = span.standing_speed_rad_per_s;
    return s;
}

}  // namespace wheelwright::ident
