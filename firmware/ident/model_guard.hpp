// Stands between the adaptive estimator and the controller: decides when, how fast and how far the
// controller's model follows the estimate (paper Fig 22, with the guards of indirect adaptation).
//
//   trust   an estimate is followed when K7 and K8 are known to `trust_relative_error` and lie within `range`
//   of
//           the robot file's values; it then becomes the trusted set
//   hold    otherwise the model stays on its way to the last trusted set
//   revert  an estimate that is not finite or out of range: back to the robot file's set
//   dwell   the model changes at most every `dwell_s`
//   rate    and by at most `rate_per_s` of its value a second (K5: of 1/32 of the track, if that is more)
//   couple  K6 always follows from the other three
//
// Cost: about 15 operations a cycle, 60 when the model may change. No allocation.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "firmware/ident/dynamics_estimate.hpp"
#include "firmware/model/dynamics.hpp"
#include "firmware/model/effects.hpp"

namespace wheelwright::ident {

enum class GuardState : std::uint8_t { following, holding, reverting };

template <typename Real>
struct ModelGuardOptions {
    Real dwell_s{};
    Real rate_per_s{};
    Real trust_relative_error{};
    Real range{};
    Real sample_time_s{};
    Real track_m{};
};

template <typename Real>
class ModelGuard {
  public:
    // `dynamics` and `effects` are the robot file's: the first trusted set and the one to revert to.
    void configure(const ModelGuardOptions<Real>& options, const model::Dynamics<Real>& dynamics,
                   const model::EffectSet<Real>& effects) {
        options_ = options;
        dwell_cycles_ = static_cast<std::uint32_t>(
            std::max(Real(1), std::round(options.dwell_s / options.sample_time_s)));
        dynamics_ = trusted_ = original_ = dynamics;
        effects_ = trusted_effects_ = original_effects_ = effects;
        cycles_ = 0;
        changes_ = 0;
        state_ = GuardState::holding;
    }

    // Once in each cycle. `may_adapt` false holds the model where it is (not excited, slip, saturation,
    // fault). True when dynamics() or effects() has changed: the controller then rescales its integrators, so
    // that the torque does not jump.
    bool update(const DynamicsEstimate<Real>& estimate, bool may_adapt) {
        if (++cycles_ < dwell_cycles_) return false;
        cycles_ = 0;
        if (!may_adapt) {
            state_ = GuardState::holding;
            return false;
        }
        judge(estimate);
        return approach();
    }

    const model::Dynamics<Real>& dynamics() const { return dynamics_; }
    const model::EffectSet<Real>& effects() const { return effects_; }
    const model::Dynamics<Real>& trusted() const { return trusted_; }
    GuardState state() const { return state_; }
    std::uint32_t changes() const { return changes_; }

  private:
    bool in_range(Real value, Real original) const {
        return value > original / options_.range && value < original * options_.range;
    }

    void judge(const DynamicsEstimate<Real>& estimate) {
        const model::Dynamics<Real>& k = estimate.dynamics;
        const model::Dynamics<Real>& e = estimate.standard_error;
        if (!std::isfinite(k.k5_m) || !in_range(k.k7_per_kg_m, original_.k7_per_kg_m) ||
            !in_range(k.k8_per_kg_m2, original_.k8_per_kg_m2)) {
            state_ = GuardState::reverting;
            trusted_ = original_;
            trusted_effects_ = original_effects_;
        } else if (e.k7_per_kg_m <= options_.trust_relative_error * k.k7_per_kg_m &&
                   e.k8_per_kg_m2 <= options_.trust_relative_error * k.k8_per_kg_m2) {
            state_ = GuardState::following;
            trusted_ = k;
            model::for_each_active_index(estimate.effects.active, [&](std::size_t i) {
                trusted_effects_.parameter[i] = estimate.effects.parameter[i];
            });
        } else {
            state_ = GuardState::holding;
        }
    }

    // Moves one value towards its target, by a share of its original size at most.
    static bool step(Real& value, Real target, Real largest) {
        const Real before = value;
        value += std::clamp(target - value, -largest, largest);
        return value != before;
    }

    bool approach() {
        const Real share = options_.rate_per_s * options_.dwell_s;
        bool changed = step(dynamics_.k7_per_kg_m, trusted_.k7_per_kg_m, share * original_.k7_per_kg_m);
        changed |= step(dynamics_.k8_per_kg_m2, trusted_.k8_per_kg_m2, share * original_.k8_per_kg_m2);
        changed |= step(dynamics_.k5_m, trusted_.k5_m,
                        share * std::max(std::abs(original_.k5_m), kLeastK5Share * options_.track_m));
        if (changed)
            dynamics_.k6_per_m = model::coupled_k6(dynamics_.k5_m, dynamics_.k7_per_kg_m,
                                                   dynamics_.k8_per_kg_m2, options_.track_m);
        model::for_each_active_index(effects_.active, [&](std::size_t i) {
            for (std::size_t j = 0; j < model::kEffects[i].parameters.size(); ++j)
                changed |= step(effects_.parameter[i][j], trusted_effects_.parameter[i][j],
                                share * std::max(std::abs(original_effects_.parameter[i][j]),
                                                 std::abs(trusted_effects_.parameter[i][j])));
        });
        if (changed) ++changes_;
        return changed;
    }

    // Of the track: a robot's K5 counts as so much at least, for a share of nothing never gets anywhere.
    static constexpr Real kLeastK5Share = Real(1) / 32;

    ModelGuardOptions<Real> options_{};
    model::Dynamics<Real> dynamics_{}, trusted_{}, original_{};
    model::EffectSet<Real> effects_{}, trusted_effects_{}, original_effects_{};
    std::uint32_t dwell_cycles_ = 1;
    std::uint32_t cycles_ = 0;
    std::uint32_t changes_ = 0;
    GuardState state_ = GuardState::holding;
};

}  // namespace wheelwright::ident
