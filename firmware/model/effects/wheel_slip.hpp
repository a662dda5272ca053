#pragma once

#include <array>

#include "firmware/model/effect.hpp"
#include "firmware/model/exponential.hpp"

namespace wheelwright::model {

// Tyres that creep over the floor as they push: slip = slip_speed * force / (mu load), the rim's speed less
// the floor's, and never more force than mu load. The load of each wheel is half the robot's weight, with the
// mass 1 / (K7 r) and no share for a castor.
//
// So each wheel has a motion of its own, I w' = torque - r force, with kRotationShare of the robot's mass in
// both. Below the limit that makes slip go after the torque, as Settling says.
struct WheelSlip {
    static constexpr std::array<EffectParameterInfo, 2> parameters{{
        {"friction_coefficient", "", 0.0, 5.0, "largest force of a tyre over its load"},
        {"slip_speed_m_per_s", "m/s", 0.0, 10.0, "slip at which a tyre reaches its largest force"},
    }};
    static constexpr EffectInfo info{
        "wheel_slip",
        "tyres that slip along their rolling direction",
        "linear slip up to Coulomb's limit, the small-slip part of Pacejka's tyre",
        parameters,
        "",
        "speed over the floor is not measured; an external pose corrects where it leads"};

    template <typename Real>
    static constexpr Real load_N(const Geometry<Real>& geometry, const Dynamics<Real>& dynamics) {
        return Real(kGravity_m_per_s2) / (2 * dynamics.k7_per_kg_m * geometry.mean_radius_m());
    }
    // Slip of a tyre that pushes with this force, |force| <= mu load.
    template <typename Real>
    static constexpr Real slip_m_per_s(const Parameters<Real>& p, Real load_N, Real force_N) {
        return p[1] * force_N / (p[0] * load_N);
    }
    // Force of a tyre that slips so.
    template <typename Real>
    static constexpr Real force_N(const Parameters<Real>& p, Real load_N, Real slip_m_per_s) {
        const Real most = p[0] * load_N;
        if (slip_m_per_s >= p[1]) return most;
        return slip_m_per_s <= -p[1] ? -most : most * slip_m_per_s / p[1];
    }

    // Two wheels that push alike, or against each other: with J = I / r^2 and R the share of rotation in what
    // the motors accelerate (in M = 1 / (K7 r), or in the inertia that K8 tells),
    //   J u' = torque / r - force,  slip = u - floor's speed = k force,  k = slip_speed / (mu load)
    // give  T slip' = (1 - R) k torque / r - slip,  T = (1 - R) k J,  and the rims accelerate as without slip
    // and by (1 - R) slip' more.
    template <typename Real>
    struct Settling {
        Real slip_per_force{};  // m/s per N of torque / r, settled
        Real time_constant_s{};
        Real bodys_share{};  // 1 - R

        // How much of the way to the settled slip is gone after time_s >= 0; 0..1.
        Real share_of(Real time_s) const {
            if (!(time_constant_s > 0)) return 1;
            const Real x = time_s / time_constant_s;
            return x * mean_exp_minus(x);
        }
    };
    // Of two wheels that push alike; rotation_share is of the robot's mass.
    template <typename Real>
    static constexpr Settling<Real> forward(const Parameters<Real>& p, const Geometry<Real>& g,
                                            const Dynamics<Real>& k,
                                            Real rotation_share = Real(kRotationShare)) {
        return settling(p, g, k, rotation_share, rotation_share);
    }
    // Of two wheels that push against each other; the same share of the mass, which is another one of what K8
    // tells.
    template <typename Real>
    static constexpr Settling<Real> turning(const Parameters<Real>& p, const Geometry<Real>& g,
                                            const Dynamics<Real>& k,
                                            Real rotation_share = Real(kRotationShare)) {
        return settling(p, g, k, rotation_share, rotation_share_turning(k, g.track_m, rotation_share));
    }

  private:
    template <typename Real>
    static constexpr Settling<Real> settling(const Parameters<Real>& p, const Geometry<Real>& g,
                                             const Dynamics<Real>& k, Real of_mass, Real of_what_moves) {
        const Real rim_kg = of_mass / (2 * k.k7_per_kg_m * g.mean_radius_m());
        const Real bodys = 1 - of_what_moves;
        const Real give = bodys * slip_m_per_s(p, load_N(g, k), Real(1));
        return {give, give * rim_kg, bodys};
    }
};

}  // namespace wheelwright::model
