// The quantities every part of the firmware talks in, with their frames and signs. They are said here once.
//
// Body frame: x forward, y left, z up, origin at the middle of the wheel axle. Angles and rates are positive
// counter-clockwise. A positive wheel torque or wheel speed drives the robot forward, on either wheel.
// All types are plain aggregates: no invariants, no allocation, trivially copyable. Each becomes the same in
// other numbers, by itself where nothing is lost.
#pragma once

#include <cmath>
#include <cstdint>
#include <type_traits>

namespace wheelwright {

// A bare target: a processor that has only float in hardware, and little memory.
#ifdef WHEELWRIGHT_BARE
inline constexpr bool kBare = true;
#else
inline constexpr bool kBare = false;
#endif

// What a cycle computes in.
using Real = std::conditional_t<kBare, float, double>;

// No encoder tells fewer places of a wheel's turn: the Hall sensors of a wheel motor tell 90.
inline constexpr double kCoarsestStep_rad = 6.283185307179586 / 64;
// What a wheel whose encoder tells the truth has turned at most, while what is told has not changed by a
// digit: a step, and where in a step it began.
inline constexpr double kMostUnseenSteps = 1.5;
inline constexpr double kMostUnseen_rad = kMostUnseenSteps * kCoarsestStep_rad;
// An encoder's step over the standard deviation of an angle that may be anywhere within it: the root of
// twelve.
inline constexpr double kStepPerNoise = 3.4641016151377544;

// One value per wheel.
template <typename Real>
struct WheelPair {
    Real left{};
    Real right{};

    template <typename Other>
    // NOLINTNEXTLINE(google-explicit-constructor): clang-tidy 16 does not read the condition
    explicit(sizeof(Other) < sizeof(Real)) constexpr operator WheelPair<Other>() const {
        return {Other(left), Other(right)};
    }
    constexpr Real sum() const { return right + left; }         // drives the robot forward
    constexpr Real difference() const { return right - left; }  // turns the robot counter-clockwise
    constexpr bool is_zero() const { return left == 0 && right == 0; }
};

// Velocity of the robot: u = (v, ω) of the paper.
template <typename Real>
struct Twist {
    Real v_m_per_s{};
    Real omega_rad_per_s{};

    template <typename Other>
    // NOLINTNEXTLINE(google-explicit-constructor): clang-tidy 16 does not read the condition
    explicit(sizeof(Other) < sizeof(Real)) constexpr operator Twist<Other>() const {
        return {Other(v_m_per_s), Other(omega_rad_per_s)};
    }
};

// Acceleration of the robot: time derivative of Twist.
template <typename Real>
struct TwistRate {
    Real v_m_per_s2{};
    Real omega_rad_per_s2{};
};

// Position of the axle's middle in a fixed frame, and heading against that frame's x axis.
template <typename Real>
struct Pose {
    Real x_m{};
    Real y_m{};
    Real heading_rad{};

    template <typename Other>
    // NOLINTNEXTLINE(google-explicit-constructor): clang-tidy 16 does not read the condition
    explicit(sizeof(Other) < sizeof(Real)) constexpr operator Pose<Other>() const {
        return {Other(x_m), Other(y_m), Other(heading_rad)};
    }
};

// Wraps an angle to (-pi, pi]. Not finite in, not finite out.
template <typename Real>
Real wrap_angle_rad(Real angle_rad) {
    constexpr Real two_pi = Real(6.283185307179586476925286766559);
    return angle_rad - two_pi * std::ceil((angle_rad - two_pi / 2) / two_pi);
}

}  // namespace wheelwright
