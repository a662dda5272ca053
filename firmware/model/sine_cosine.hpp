// Sine and cosine in plain arithmetic: the same bits on every machine, where mathematical libraries differ in
// the last one. For what simulation and firmware share.
#pragma once

#include <cstdint>

namespace wheelwright::model {

template <typename Real>
struct SineCosine {
    Real sine;
    Real cosine;
};

// For any angle of reasonable size (below 1e9); in double within 1e-14 plus the angle's own rounding.
// Cost: about 60 operations.
template <typename Real>
[[gnu::noinline]] constexpr SineCosine<Real> sine_cosine(Real angle_rad) {
    constexpr Real kHalfPi = Real(1.5707963267948966);
    constexpr Real kTurnsPerRad = 1 / kHalfPi;
    constexpr int kTerms =
        sizeof(Real) == sizeof(float) ? 5 : 8;  // of Taylor's series, up to an eighth of a turn
    const Real turns = angle_rad * kTurnsPerRad;
    const auto quadrant = static_cast<std::int64_t>(turns < 0 ? turns - Real(0.5) : turns + Real(0.5));
    const Real x = angle_rad - static_cast<Real>(quadrant) * kHalfPi;
    const Real square = x * x;
    Real s = 1;
    Real c = 1;
#pragma GCC unroll 8
    for (int k = kTerms; k > 0; --k) {
        s = 1 - s * square * (1 / static_cast<Real>(2 * k * (2 * k + 1)));
        c = 1 - c * square * (1 / static_cast<Real>(2 * k * (2 * k - 1)));
    }
    s *= x;
    switch (quadrant & 3) {
        case 0:
            return {s, c};
        case 1:
            return {c, -s};
        case 2:
            return {-s, -c};
        default:
            return {-c, s};
    }
}

}  // namespace wheelwright::model
