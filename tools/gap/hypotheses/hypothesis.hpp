// What the analysis knows of an effect beside what the catalogue says: the columns by which a log is searched
// for it, where the search starts, how usual it is, what it is confounded with, and how well its parameters
// can be known at best. An effect of which there is something to say has a file here that specialises
// HypothesisOf and is listed in hypotheses.cpp; all others are as Defaults says. An effect that is linear in
// coordinates (effect.hpp) needs none, one that only a sensor shows neither.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <string_view>
#include <type_traits>

#include "firmware/model/effects.hpp"
#include "tools/gap/hypotheses/contribution.hpp"
#include "tools/gap/hypotheses/starting_points.hpp"

namespace wheelwright::gap {

// Another effect that does the same to the wheel speeds in every motion, and what else would have to be
// measured to tell them apart. From this share of the torque on.
struct Confounder {
    std::string_view effect;
    double least_torque_share;
    std::string_view measurement;
};

// Standard error of a parameter beside what the spread between segments shows, as a share of its value and in
// its own unit; and what its value is to be multiplied by.
struct Uncertainty {
    double relative = 0, absolute = 0, scale = 1;
};
struct UncertaintyOf {
    std::size_t parameter;
    const Parameters<double>& at;  // all of the effect
    const Setting& setting;
    bool at_start;    // known as far as the starting points are apart
    double relative;  // of any effect's
};
// Two programs that integrate the same robot agree no better,
inline constexpr double kIntegration = 0.002;
// nor in the headings that they add up from the same wheel speeds.
inline constexpr double kDirection_rad = 0.02;
// Of the mass that K7 tells of, which is with the wheels' rotation.
inline constexpr double kBodysShare = 1 - model::kRotationShare;
// Of each of two parameters of which a log tells the product.
inline constexpr double kProductOnly = 0.7;

// What an effect in the torque's path takes from it.
template <typename Effect>
class PathColumns : public Contribution {
  public:
    static constexpr bool kByDynamics = false;
    PathColumns(const Parameters<double>& p, const Setting&) : p_(p) {}
    bool slow() const override { return std::is_same_v<Effect, model::GainDrift>; }
    WheelPair<double> over(const Interval& i) override {
        return {one(i, i.torque.left, i.speed().left, i.angle.left, memory_.left, false),
                one(i, i.torque.right, i.speed().right, i.angle.right, memory_.right, true)};
    }

  private:
    using Memory = typename Effect::template Memory<double>;
    double one(const Interval& i, double torque, double speed, double angle, Memory& memory, bool right) {
        const model::PathInstant<double> at{torque,   speed, angle - 0.5 * speed * i.dt_s, i.t_s, i.dt_s,
                                            i.span_s, right};
        if constexpr (requires { &Effect::template as_whole<double>; }) {
            return Effect::as_whole(p_, memory, at) - torque;
        } else {
            return Effect::deliver(p_, memory, at) - torque;
        }
    }
    Parameters<double> p_;
    WheelPair<Memory> memory_;
};

template <typename Effect>
struct Defaults {
    // A Contribution made from (parameters, setting), with kByDynamics: whether it depends on the setting's
    // K5..K8, and not on the log and the geometry alone. void: the catalogue's columns, or none.
    using Columns = std::conditional_t<model::InTorquePath<Effect> && model::kCoordinates<Effect> == 0,
                                       PathColumns<Effect>, void>;
    // Beside Columns, an effect has static StartingPoints starting_points(const Setting&): where each that is
    // not linear is tried first. None: it is linear, or shows in no wheel speed.
    // Prior plausibility: it belongs to the model that everything else is tried beside.
    static constexpr bool kInEveryDriveTrain = false;
    // What comes late by another law than this one has another size at each frequency, and is still late.
    static constexpr bool kLate = false;
    // Confounded with: the effect that does all this one can, and more; and those that no motion tells from
    // it.
    static constexpr std::string_view kSpecialCaseOf{};
    static constexpr std::array<Confounder, 0> kUnlessMeasured{};
    // The parameter that is the time of an event; none.
    static constexpr std::size_t kEvent = model::kMaxEffectParameters;
    static Uncertainty uncertainty(const UncertaintyOf& of) { return {of.relative}; }
};

template <typename Effect>
struct HypothesisOf : Defaults<Effect> {};

}  // namespace wheelwright::gap
