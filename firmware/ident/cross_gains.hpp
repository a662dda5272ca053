// What makes the sum of the wheels' torques turn a robot, and their difference drive it forward: drives whose
// gains are not equal, and a centre of gravity beside the middle line. With c (half of the relative gain
// mismatch), p (the offset to the left) and the track b:
//
//     v'     = (K7 + p c K8) S + (K7 c + p K8) D
//     omega' = K8 (1 + 2 p c / b) D + K8 (c + 2 p / b) S
//
// S, D: sum and difference (right - left) of the torques asked (cog_lateral.hpp, torque_gain_mismatch.hpp).
// The two cross gains tell the two causes apart, but for a robot whose yaw inertia is that of its mass over
// its wheels (K8 / K7 = 2 / b): there both do the same. So the smaller explanation is taken, and one cause
// where one will do; what the loops make of it is the same.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/effects/cog_lateral.hpp"

namespace wheelwright::ident {

struct CrossGain {
    double value{}, standard_error{};
};

struct Asymmetry {
    double mismatch = 0, mismatch_error = 0;  // c, and its standard error
    double offset_m = 0, offset_error_m = 0;  // p
};

// From K5..K8 as they stand beside c and p in a robot file to those that a regression sees which does not
// know of c and p: of S in v', of D in omega'.
template <typename Real>
model::Dynamics<Real> seen_together(const model::Dynamics<Real>& k, Real mismatch, Real offset_m,
                                    Real track_m) {
    const Real scale = 1 / (1 - model::CogLateral::share(offset_m, track_m, k));
    const Real k8 = k.k8_per_kg_m2 * scale;
    return {k.k5_m * scale, k.k6_per_m * scale, k.k7_per_kg_m * scale + mismatch * offset_m * k8,
            k8 * (1 + 2 * mismatch * offset_m / track_m)};
}

// And back.
template <typename Real>
model::Dynamics<Real> told_apart(const model::Dynamics<Real>& seen, Real mismatch, Real offset_m,
                                 Real track_m) {
    const Real k8 = seen.k8_per_kg_m2 / (1 + 2 * mismatch * offset_m / track_m);
    const Real k7 = seen.k7_per_kg_m - mismatch * offset_m * k8;
    const Real scale = 1 - model::CogLateral::share(offset_m, track_m, {0, 0, k7, k8});
    return {seen.k5_m * scale, seen.k6_per_m * scale, k7 * scale, k8 * scale};
}

// What a torque that the drives do not make, such as a friction, at the right wheel alone (`side` 1) or the
// left one (-1) seems to be to such regressions, over what it is: in v', in omega'. They take its sum for
// what drives forward and its difference for what turns, and it does both. 0: it is not of one wheel.
inline std::array<double, 2> seen_of_one_wheel(int side, double k8_over_k7_per_m, double mismatch,
                                               double offset_m, double track_m) {
    const double forward = offset_m * k8_over_k7_per_m;
    const double turning = 2 * offset_m / track_m;
    return {(1 + side * forward) / (1 + mismatch * forward), (1 + side * turning) / (1 + mismatch * turning)};
}

// Shares of K7 (K8) below this are not worth an effect: a tenth of it would be left of a step's settling
// band, which is 1 %.
inline constexpr double kWorthAnEffect = 0.01;

// `cross[0]`: of D in v', `cross[1]`: of S in omega'. K7 and K8 in `seen` are those of S in v', of D in
// omega'. Zeros where the cross gains are not sure or too small. Some 200 operations, no allocation.
inline Asymmetry asymmetry(const model::Dynamics<double>& seen, const std::array<CrossGain, 2>& cross,
                           double track_m) {
    constexpr double kSure = 4;              // standard errors
    constexpr double kLikelyMismatch = 0.1;  // motors of one kind, a weak drive
    constexpr double kLikelyOffset = 0.05;   // of the track: batteries, a motor on one side
    constexpr double kExplained = 0.0025;    // of K7, K8: what is left then matters to nobody
    constexpr double kSecondCause = 4;       // of chi squared
    Asymmetry none;
    const std::array<double, 2> own{seen.k7_per_kg_m, seen.k8_per_kg_m2};
    bool worth = false;
    std::array<double, 2> variance{};  // of the shares
    for (std::size_t i = 0; i < 2; ++i) {
        const double size = std::abs(cross[i].value);
        worth = worth || (size > kSure * cross[i].standard_error && size > kWorthAnEffect * own[i]);
        const double error = cross[i].standard_error / own[i];
        variance[i] = error * error + kExplained * kExplained;
    }
    none.mismatch_error = std::sqrt(std::max(variance[0], variance[1]));
    none.offset_error_m = none.mismatch_error * track_m / 2;
    if (!worth) return none;

    // In shares of K7 and K8: c + forward q and c + q, with q = 2 p / b.
    const double forward = seen.k8_per_kg_m2 * track_m / (2 * seen.k7_per_kg_m);
    const double believed_c = 1 / (kLikelyMismatch * kLikelyMismatch);
    const double believed_q = 1 / (4 * kLikelyOffset * kLikelyOffset);
    Asymmetry best = none;
    double least = HUGE_VAL;
    for (const auto& [with_c, with_q] : {std::array{true, false}, {false, true}, {true, true}}) {
        double k7 = seen.k7_per_kg_m, k8 = seen.k8_per_kg_m2, c = 0, q = 0;
        std::array<double, 2> share{};
        for (int round = 0; round < 4; ++round) {
            share = {cross[0].value / k7, cross[1].value / k8};
            const double f = forward * (k8 / seen.k8_per_kg_m2) * (seen.k7_per_kg_m / k7);
            const double w0 = 1 / variance[0], w1 = 1 / variance[1];
            const double cc = w0 + w1 + believed_c, qq = f * f * w0 + w1 + believed_q;
            const double cq = with_c && with_q ? f * w0 + w1 : 0;
            const double c1 = w0 * share[0] + w1 * share[1], q1 = f * w0 * share[0] + w1 * share[1];
            const double determinant = cc * qq - cq * cq;
            c = with_c ? (qq * c1 - cq * q1) / determinant : 0;
            q = with_q ? (cc * q1 - cq * c1) / determinant : 0;
            k8 = seen.k8_per_kg_m2 / (1 + q * c);
            k7 = seen.k7_per_kg_m - q * c * track_m / 2 * k8;
            const double off0 = share[0] - c - f * q, off1 = share[1] - c - q;
            const double cost = w0 * off0 * off0 + w1 * off1 * off1 + believed_c * c * c +
                                believed_q * q * q + (with_c && with_q ? kSecondCause : 0);
            if (round == 3 && cost < least) {
                least = cost;
                const double error_c = with_c ? std::sqrt(qq / determinant) : none.mismatch_error;
                const double error_q = with_q ? std::sqrt(cc / determinant) : 2 * none.mismatch_error;
                best = {c, error_c, q * track_m / 2, error_q * track_m / 2};
            }
        }
    }
    return best;
}

}  // namespace wheelwright::ident
