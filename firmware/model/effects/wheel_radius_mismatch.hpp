#pragma once

#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// Wheels whose radii are not as the robot file says: right over left larger by `relative`, the mean kept.
struct WheelRadiusMismatch {
    static constexpr std::array<EffectParameterInfo, 1> parameters{{
        {"relative", "", -0.5, 1.0, "radius right over left, beyond the geometry's, minus one"},
    }};
    static constexpr EffectInfo info{"wheel_radius_mismatch", "one wheel is larger than the other",
                                     "unequal wheel diameters, Borenstein, Feng (1996)", parameters,
                                     "odometry and controllers take the radii as they are"};

    // The geometry as it is.
    template <typename Real>
    static constexpr Geometry<Real> geometry(const Parameters<Real>& p, const Geometry<Real>& nominal) {
        const Real ratio = nominal.wheel_radius_m.right / nominal.wheel_radius_m.left * (1 + p[0]);
        const Real left = 2 * nominal.mean_radius_m() / (1 + ratio);
        return {{left, ratio * left}, nominal.track_m};
    }
};

}  // namespace wheelwright::model
