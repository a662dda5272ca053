#include "tools/gap_trials/hidden/motion.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace wheelwright::hidden {
namespace {

constexpr double kTwoPi = 2 * std::numbers::pi;
constexpr double kRest_s = 0.4;  // stands still at the beginning of a log

// +-1, anew every bit.
double binary(std::uint64_t seed, double t_s, double bit_s) {
    return (Random(seed, static_cast<std::uint64_t>(std::max(0.0, t_s) / bit_s)).bits() >> 40U) % 2 == 0 ? 1
                                                                                                         : -1;
}

// A wave between -1 and 1 that rests at its ends and ramps between them: `ramp` is the share of the time on
// ramps.
double trapezoid(double phase, double ramp) {
    const double x = phase - std::floor(phase);
    const double triangle = x < 0.5 ? 4 * x - 1 : 3 - 4 * x;
    return std::clamp(triangle / ramp, -1.0, 1.0);
}

}  // namespace

std::string_view name_of(Motion motion) {
    constexpr std::array<std::string_view, 7> kNames{"prbs",      "multisine", "chirp", "figure_eight",
                                                     "reversals", "straight",  "spin"};
    return kNames[static_cast<std::size_t>(motion)];
}

Driver::Driver(const Robot& robot, std::vector<Motion> motions, double duration_s, bool quick, Random& random)
    : robot_(robot),
      segment_s_(duration_s / static_cast<double>(motions.size())),
      gain_per_s_(random.uniform(3.0, 5.0)) {
    for (const Motion motion : motions) segments_.push_back(draw(motion, quick, random));
}

Driver::Segment Driver::draw(Motion motion, bool quick, Random& random) const {
    Segment s;
    s.motion = motion;
    s.amplitude = random.uniform(0.5, 0.9);
    s.pull_per_s = random.uniform(0.5, 1.0);
    s.speed_m_per_s = random.uniform(0.7, 1.3);
    s.yaw_rate_rad_per_s = random.uniform(1.5, 3.0);
    s.bits_seed = random.bits();
    switch (motion) {
        case Motion::prbs:
            s.bit_s = quick ? random.log_uniform(0.03, 0.1) : random.log_uniform(0.05, 0.25);
            break;
        case Motion::multisine:
            for (auto* sines : {&s.forward, &s.turning}) {
                for (int i = 0; i < 8; ++i) {
                    sines->push_back({random.log_uniform(0.1, 9.0), 0.3, random.uniform(0, kTwoPi)});
                }
            }
            break;
        case Motion::chirp:
            s.chirp_from_Hz = random.uniform(0.1, 0.2);
            s.chirp_to_Hz = random.uniform(8, 14);
            break;
        case Motion::figure_eight:
            s.period_s = random.uniform(5, 8);
            break;
        case Motion::reversals:
            s.period_s = random.uniform(3.2, 4.5);
            s.second_period_s = s.period_s * random.uniform(1.25, 1.6);
            break;
        case Motion::straight:
        case Motion::spin:
            s.period_s = random.uniform(4, 6);
            break;
    }
    return s;
}

Pair Driver::from_torques(double forward, double turning) const {
    const double limit = robot_.torque_limit_Nm;
    return {std::clamp(forward - turning, -limit, limit), std::clamp(forward + turning, -limit, limit)};
}

Driver::Twist Driver::reference(const Segment& s, double t) const {
    // three levels of speed, one after the other, so that what grows with speed shows its power
    constexpr std::array<double, 4> kLevels{1.0, 0.35, 0.7, 0.08};
    const auto level = [&](double period_s) {
        return kLevels[static_cast<std::size_t>(std::max(0.0, t / period_s)) % kLevels.size()];
    };
    switch (s.motion) {
        case Motion::figure_eight: {
            const double phase = kTwoPi * t / s.period_s;
            return {s.speed_m_per_s * (0.75 + 0.25 * std::cos(2 * phase)),
                    s.yaw_rate_rad_per_s * std::sin(phase)};
        }
        case Motion::reversals:
            return {s.speed_m_per_s * level(s.period_s) * trapezoid(t / s.period_s + 0.25, 0.35),
                    s.yaw_rate_rad_per_s * level(s.second_period_s) *
                        trapezoid(t / s.second_period_s + 0.25, 0.35)};
        case Motion::straight:
            return {s.speed_m_per_s * level(s.period_s) * trapezoid(t / s.period_s + 0.25, 0.4), 0};
        case Motion::spin:
            return {0,
                    1.4 * s.yaw_rate_rad_per_s * level(s.period_s) * trapezoid(t / s.period_s + 0.25, 0.4)};
        case Motion::prbs:
        case Motion::multisine:
        case Motion::chirp:
            break;
    }
    return {};
}

Driver::Twist Driver::twist(const Pair& measured) const {
    const double r = robot_.wheel_radius_m;
    return {r * (measured.left + measured.right) / 2, r * (measured.right - measured.left) / robot_.track_m};
}

double TorqueProgramme::duration_s() const {
    double sum = kRest_s;
    for (const Push& push : pushes) sum += push.duration_s + halt_s;
    return sum;
}

Pair Driver::command(const TorqueProgramme& programme, double t_s, const Pair& measured) {
    double t = t_s - kRest_s;
    if (t < 0) return {0, 0};
    const Twist now = twist(measured);
    for (std::size_t i = 0; i < programme.pushes.size(); ++i) {
        const TorqueProgramme::Push& push = programme.pushes[i];
        if (t < push.duration_s) {
            if (std::abs(now.v_m_per_s) > programme.fastest_m_per_s ||
                std::abs(now.yaw_rad_per_s) > programme.fastest_yaw_rad_per_s) {
                too_fast_ = i + 1;
            }
            if (too_fast_ > i) break;
            const Pair torque = push.torque_Nm(t);
            const double limit = robot_.torque_limit_Nm;
            return {std::clamp(torque.left, -limit, limit), std::clamp(torque.right, -limit, limit)};
        }
        t -= push.duration_s + programme.halt_s;
        if (t < 0) break;
    }
    return from_torques(-torque_per_forward() * gain_per_s_ * now.v_m_per_s,
                        -torque_per_yaw() * gain_per_s_ * now.yaw_rad_per_s);
}

Pair Driver::command(double t_s, const Pair& measured) {
    if (t_s < kRest_s) return {0, 0};
    const double since_s = t_s - kRest_s;
    const auto index = std::min(segments_.size() - 1, static_cast<std::size_t>(since_s / segment_s_));
    const Segment& s = segments_[index];
    const double t = since_s - static_cast<double>(index) * segment_s_;
    const auto [v, yaw] = twist(measured);
    const double per_forward = torque_per_forward();
    const double per_yaw = torque_per_yaw();
    // A turn at full torque would be far quicker than a push: half of it is enough, and the tyres hold.
    const double push = s.amplitude * robot_.torque_limit_Nm * 0.6;
    const double turn = s.amplitude * robot_.torque_limit_Nm * 0.3;
    const double pull_v = -per_forward * s.pull_per_s * v;
    const double pull_yaw = -per_yaw * 1.5 * s.pull_per_s * yaw;
    switch (s.motion) {
        case Motion::prbs:
            return from_torques(push * binary(s.bits_seed, t, s.bit_s) + pull_v,
                                turn * binary(s.bits_seed + 1, t, 1.37 * s.bit_s) + pull_yaw);
        case Motion::multisine: {
            const auto sum = [&](const std::vector<Sine>& sines) {
                double total = 0;
                for (const Sine& sine : sines) {
                    total += sine.amplitude * std::sin(kTwoPi * sine.frequency_Hz * t + sine.phase_rad);
                }
                return total;
            };
            return from_torques(push * sum(s.forward) + pull_v, turn * sum(s.turning) + pull_yaw);
        }
        case Motion::chirp: {
            // the logarithm of the frequency grows with time; the turn runs the same way backwards
            const auto phase = [&](double from_Hz, double to_Hz) {
                const double rate = std::log(to_Hz / from_Hz) / segment_s_;
                return kTwoPi * from_Hz * std::expm1(rate * t) / rate;
            };
            return from_torques(push * std::sin(phase(s.chirp_from_Hz, s.chirp_to_Hz)) + pull_v,
                                turn * std::sin(phase(s.chirp_to_Hz, s.chirp_from_Hz)) + pull_yaw);
        }
        case Motion::figure_eight:
        case Motion::reversals:
        case Motion::straight:
        case Motion::spin:
            break;
    }
    const Twist wanted = reference(s, t);
    const double step_s = 1e-3;
    const Twist soon = reference(s, t + step_s);
    const double forward =
        per_forward * ((soon.v_m_per_s - wanted.v_m_per_s) / step_s + gain_per_s_ * (wanted.v_m_per_s - v));
    const double turning = per_yaw * ((soon.yaw_rad_per_s - wanted.yaw_rad_per_s) / step_s +
                                      gain_per_s_ * (wanted.yaw_rad_per_s - yaw));
    return from_torques(forward, turning);
}

}  // namespace wheelwright::hidden
