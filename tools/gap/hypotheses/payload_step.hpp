// A load that comes at a time.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

// What a load that comes at this time acts on along a log: what all the columns of it share.
class Loaded {
  public:
    Loaded(double time_s, const Setting& s) : time_s_(time_s), geometry_(s.geometry), friction_(s.friction) {}

    // Of an interval, as much as there is load in it: omega^2, v omega, sum and difference of the torques
    // less the wheels' own friction, which moves no load.
    struct At {
        double omega_squared = 0, v_omega = 0, torque_sum = 0, torque_difference = 0;
    };
    const At& over(const Interval& i) {
        if (i.t_s == at_s_) return at_;
        at_s_ = i.t_s;
        const double since_s = i.t_s + i.dt_s - time_s_;
        if (since_s <= 0) return at_ = {};
        const double after = since_s < i.dt_s ? since_s / i.dt_s : 1.0;
        const Twist<double> u = model::twist_from_wheel_speeds(geometry_, i.speed());
        const double omega = after * u.omega_rad_per_s;
        const WheelPair<double> moves = friction_.leaves_Nm(i.torque, i.before, i.after);
        return at_ = {omega * u.omega_rad_per_s, omega * u.v_m_per_s, after * moves.sum(),
                      after * moves.difference()};
    }
    bool is(double time_s) const { return time_s == time_s_; }

  private:
    double time_s_;
    model::Geometry<double> geometry_;
    WheelFriction friction_;
    double at_s_ = -1e300;
    At at_;
};

class PayloadTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = true;
    PayloadTerm(const Parameters<double>& p, const Setting& s)
        : time_s_(p[0]), loaded_(std::make_shared<Loaded>(p[0], s)) {
        const model::Dynamics<double>& k = s.dynamics;
        const auto with_it = model::PayloadStep::loaded(p, s.geometry, k);
        k5_ = (with_it.k5_m - k.k5_m) / k.k7_per_kg_m;
        k7_ = (with_it.k7_per_kg_m - k.k7_per_kg_m) / k.k7_per_kg_m;
        k6_ = (with_it.k6_per_m - k.k6_per_m) / k.k8_per_kg_m2;
        k8_ = (with_it.k8_per_kg_m2 - k.k8_per_kg_m2) / k.k8_per_kg_m2;
    }
    bool slow() const override { return true; }
    WheelPair<double> over(const Interval& i) override {
        const Loaded::At& at = loaded_->over(i);
        return pair_of(k5_ * at.omega_squared + k7_ * at.torque_sum,
                       k6_ * at.v_omega + k8_ * at.torque_difference);
    }
    void share(const Contribution& other) override {
        const auto* payload = dynamic_cast<const PayloadTerm*>(&other);
        if (payload != nullptr && payload->loaded_->is(time_s_)) loaded_ = payload->loaded_;
    }

  private:
    double time_s_;
    std::shared_ptr<Loaded> loaded_;
    double k5_, k6_, k7_, k8_;  // what the load changes, as torque
};

template <>
struct HypothesisOf<model::PayloadStep> : Defaults<model::PayloadStep> {
    using Columns = PayloadTerm;
    static constexpr std::size_t kEvent = 0;
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting& s) {
        const double mass = s.effective_mass_kg();
        const double inertia = s.effective_inertia_kg_m2();
        constexpr double kUnit = 0.1;  // of the robot's own
        // what is lost of the gain by a unit, and what load loses so much of it
        constexpr double kLost = kUnit / (1 + kUnit);
        const auto load = [](double amount) {
            const double lost = std::clamp(kLost * amount, -0.6, 0.6);
            return lost / (1 - lost);
        };
        StartingPoints from{
            {},
            [=](const Parameters<double>& at) {
                return std::vector<Parameters<double>>{{at[0], kUnit * mass, 0}, {at[0], 0, kUnit * inertia}};
            },
            [=](const Parameters<double>& at, const Eigen::VectorXd& a) {
                return Parameters<double>{at[0], mass * load(a(0)), inertia * load(a(a.size() - 1))};
            },
            // what more than doubles the robot is no load
            [=](const Eigen::VectorXd& a) {
                return a.minCoeff() > -5 && a.sum() > 0 && kLost * a.maxCoeff() < 0.5;
            },
            {0, mass / 100, inertia / 100, s.geometry.track_m / 50}};
        for (int i = 2; i <= 16; ++i) from.points.push_back({s.span_s * i * kEventSpacing});
        // a load's inertia does not show where the robot goes straight before or behind: then it is like the
        // robot's
        from.hidden = 2;
        from.itself = [=](const Parameters<double>& p) { return p[2] > -inertia / 2 && p[2] < 2 * inertia; };
        constexpr double kLikely = 0.5;  // of the robot's own
        from.likely_amount = kLikely / kUnit;
        constexpr double kLikelyAhead = 0.1;  // of the track
        from.likely_move = {0, kLikely * mass, kLikely * inertia, kLikelyAhead * s.geometry.track_m};
        if (s.event_spacing_s == 0) return from;
        from.closer = [=](const Parameters<double>& at) {
            std::vector<Parameters<double>> points;
            for (const int i : {-4, 4, -3, 3, -2, 2, -1, 1, 0}) {
                points.push_back({std::clamp(at[0] + i * s.event_spacing_s, 0.02 * s.span_s, 0.98 * s.span_s),
                                  at[1], at[2], at[3]});
            }
            return points;
        };
        return from;
    }
    // NOLINTEND(readability-magic-numbers)
    static Uncertainty uncertainty(const UncertaintyOf& of) {
        if (of.parameter != kEvent) return {of.relative};
        const double spacing_s = of.at_start ? kEventSpacing * of.setting.span_s : of.setting.event_spacing_s;
        return {std::max(spacing_s, of.setting.period_s) / of.at[kEvent]};
    }
};

}  // namespace wheelwright::gap
