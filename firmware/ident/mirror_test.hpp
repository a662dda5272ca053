// Whether the robot moves like the one of its file or like that one's mirror image, in which one wheel goes
// backwards. Each drive turns torque and encoder together, so to the encoders both look alike; but forward
// and turning have changed places, and what couples them stands at other products of the speeds. With half
// the track h:
//     as filed    v' = K5 omega^2 + ...     omega' = K6 v omega + ...     K6 = -K5 K8 / (h K7)
//     mirrored    v' = c v omega + ...      omega' = d v^2 + ...          c = -k K7 / (h^2 K8),  d = k / h^3
// K7 and K8 are those that the run sees. k is the true robot's K5 if the left wheel goes backwards, and less
// that if the right one does: as the sign of K5 is not known, the wheels cannot tell which of them it is. A
// centre of gravity above the axle couples nothing and tells nothing. One that is beside the middle gives v'
// a term with v omega too, but omega' none with v^2: the mirror image has to show in both.
//
// The estimators have columns for both products. judge_mirror(): about 100 operations, no allocation.
//
// Until it is known which of the two moves, limits have to hold for both.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "firmware/model/types.hpp"

namespace wheelwright::ident {

// What the mirror image does when the wheels, as filed, say this; up to the sign, which depends on the wheel
// that goes backwards: with the other one its path lies on the other side of the start, as far away.
template <typename Real>
Twist<Real> mirrored(const Twist<Real>& filed, Real half_track_m) {
    return {half_track_m * filed.omega_rad_per_s, filed.v_m_per_s / half_track_m};
}

// The largest speed and yaw rate at which neither the robot nor its mirror image is beyond the limits: at the
// rims the same.
template <typename Real>
Twist<Real> within_either(const Twist<Real>& limits, Real half_track_m) {
    const Real rim = std::min(limits.v_m_per_s, half_track_m * limits.omega_rad_per_s);
    return {rim, rim / half_track_m};
}

// What an estimator found, of v' (0) and of omega' (1): K5 and K6, c and d.
template <typename Real>
struct CouplingTerms {
    struct Term {
        Real value{}, standard_error{};
    };
    std::array<Term, 2> filed{}, mirrored{};
    Real k7_per_kg_m{}, k8_per_kg_m2{};
};

enum class Mirror : std::uint8_t { unknown, as_filed, mirrored };

template <typename Real>
Mirror judge_mirror(const CouplingTerms<Real>& found, Real half_track_m) {
    constexpr Real kSure = 6;        // standard deviations
    constexpr Real kSureInEach = 4;  // so that something else would have to be missing twice
    constexpr Real kSameLength = 2;  // within this factor
    struct Length {                  // K5, or k
        Real value_m, variance_m2;
        Real sigmas_squared() const { return value_m * value_m / variance_m2; }
    };
    const auto length = [](const typename CouplingTerms<Real>::Term& term, Real unit) {
        return Length{unit * term.value, unit * unit * term.standard_error * term.standard_error};
    };
    const auto mean = [](const Length& a, const Length& b) {
        const Real both = a.variance_m2 + b.variance_m2;
        return Length{(a.value_m * b.variance_m2 + b.value_m * a.variance_m2) / both,
                      a.variance_m2 * b.variance_m2 / both};
    };
    const auto known = [](const auto& terms) {
        return terms[0].standard_error > 0 && terms[1].standard_error > 0;
    };
    if (!(found.k7_per_kg_m > 0) || !(found.k8_per_kg_m2 > 0) || !known(found.filed) ||
        !known(found.mirrored))
        return Mirror::unknown;
    const Real h = half_track_m;
    const Real ratio = h * found.k8_per_kg_m2 / found.k7_per_kg_m;
    const Length filed = mean(length(found.filed[0], 1), length(found.filed[1], -h * h / ratio));
    const Length c = length(found.mirrored[0], -h * ratio);
    const Length d = length(found.mirrored[1], h * h * h);
    const Length mirrored = mean(c, d);
    const Real sure_m = kSure * std::sqrt(filed.variance_m2 + mirrored.variance_m2);
    const Real more_m = std::abs(filed.value_m) - std::abs(mirrored.value_m);
    if (more_m > sure_m) return Mirror::as_filed;
    const bool in_each = std::min(c.sigmas_squared(), d.sigmas_squared()) > kSureInEach * kSureInEach &&
                         c.value_m * d.value_m > 0 &&
                         std::abs(std::log(c.value_m / d.value_m)) < std::log(kSameLength);
    return in_each && more_m < -sure_m ? Mirror::mirrored : Mirror::unknown;
}

}  // namespace wheelwright::ident
