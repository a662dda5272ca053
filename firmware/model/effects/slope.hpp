#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "firmware/model/effect.hpp"
#include "firmware/model/sine_cosine.hpp"

namespace wheelwright::model {

// Gravity on a tilted floor. With the downhill parts of gravity's acceleration along the fixed frame's axes,
// (g_x, g_y) = -g sin(angle) (cos uphill, sin uphill), it pulls at the centre of gravity:
//   F = m (g_x cos heading + g_y sin heading),  N = a m (g_y cos heading - g_x sin heading),
// where K7 and K5 tell of mass and moment: with m_eff = 1 / (K7 r), a m = K5 m_eff and, as gravity does not
// pull at the wheels' rotation, m = (1 - kRotationShare) m_eff. g_x and g_y are the coordinates.
struct Slope {
    static constexpr std::array<EffectParameterInfo, 2> parameters{{
        {"angle_rad", "rad", 0.0, 0.7, "steepness of the floor"},
        {"uphill_rad", "rad", -3.15, 3.15, "heading that points straight uphill"},
    }};
    static constexpr EffectInfo info{"slope", "a floor that is not level",
                                     "Newton's law, gravity on an incline", parameters,
                                     "gravity's pull is taken from the command, by the heading"};

    static constexpr bool columns_by_dynamics = true;  // ColumnsByDynamics: mass and moment are K7's and K5's
    template <typename Real>
    static constexpr BodyForce<Real> column(unsigned k, const EffectContext<Real>& at) {
        const auto [sine, cosine] = sine_cosine(at.motion.heading_rad);
        const Real accelerated = 1 / (at.dynamics.k7_per_kg_m * at.geometry.mean_radius_m());
        const Real mass = (1 - Real(kRotationShare)) * accelerated;
        const Real moment = at.dynamics.k5_m * accelerated;
        return k == 0 ? BodyForce<Real>{mass * cosine, -moment * sine}
                      : BodyForce<Real>{mass * sine, moment * cosine};
    }

    static constexpr std::size_t coordinate_count = 2;
    template <typename Real>
    static constexpr Parameters<Real> coordinates(const Parameters<Real>& p) {
        const Real pull = -Real(kGravity_m_per_s2) * sine_cosine(p[0]).sine;
        const auto [sine, cosine] = sine_cosine(p[1]);
        return {pull * cosine, pull * sine};
    }
    template <typename Real>
    static Parameters<Real> from_coordinates(const Parameters<Real>& c) {
        return {std::asin(std::hypot(c[0], c[1]) / Real(kGravity_m_per_s2)), std::atan2(-c[1], -c[0])};
    }
};

}  // namespace wheelwright::model
