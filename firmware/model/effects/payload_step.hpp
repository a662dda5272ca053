#pragma once

#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// A load that comes on board at one moment. With m = 1 / (K7 r), I of K8 and a = K5 (K7 holds no other mass,
// so a seems smaller by the share of the wheels' rotation), and d = a + ahead from the axle:
//   m + mass,  I + inertia + mass d^2,  K5 becomes (m a + mass d) / (m + mass),  K6's moment loses mass d.
struct PayloadStep {
    static constexpr std::array<EffectParameterInfo, 4> parameters{{
        {"time_s", "s", 0.0, 1e6, "when it comes, after the beginning"},
        {"mass_kg", "kg", -1000.0, 10000.0, "its mass"},
        {"inertia_kg_m2", "kg m^2", -1000.0, 10000.0, "its inertia about its own vertical axis"},
        {"ahead_m", "m", -10.0, 10.0, "how far ahead of the robot's centre of gravity it lies"},
    }};
    static constexpr EffectInfo info{"payload_step",
                                     "a load that is put on or taken off while the robot drives",
                                     "parallel-axis theorem",
                                     parameters,
                                     "",
                                     "nobody announces it; adaptive mode learns K5..K8 of the loaded robot"};

    // The robot with the load on board.
    template <typename Real>
    static constexpr Dynamics<Real> loaded(const Parameters<Real>& p, const Geometry<Real>& g,
                                           const Dynamics<Real>& k) {
        const Real r = g.mean_radius_m();
        const Real ahead_m = k.k5_m + p[3];  // of the axle
        const Real moment = p[1] * ahead_m;
        const Real mass = 1 / (k.k7_per_kg_m * r);
        const Real inertia = g.track_m / (2 * r * k.k8_per_kg_m2);
        const Real all_mass = mass + p[1];
        const Real all_inertia = inertia + p[2] + moment * ahead_m;
        return {(k.k5_m * mass + moment) / all_mass, (k.k6_per_m * inertia - moment) / all_inertia,
                1 / (all_mass * r), g.track_m / (2 * r * all_inertia)};
    }
};

}  // namespace wheelwright::model
