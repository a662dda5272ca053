// Friction that falls as the wheel starts to turn.
#pragma once

#include <memory>
#include <vector>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

// By how much friction that falls over this speed has fallen along a log: what all the columns of it share.
class StribeckFall {
  public:
    explicit StribeckFall(const Parameters<double>& p) : p_(p) {}

    struct At {
        WheelPair<double> sign, share;  // of the sliding, and of friction at rest
    };
    const At& over(const Interval& i) {
        if (i.t_s == at_s_) return at_;
        at_s_ = i.t_s;
        const WheelPair<double> speed = i.speed();
        at_.sign = {mean_sign(i.before.left, i.after.left), mean_sign(i.before.right, i.after.right)};
        at_.share = {model::StribeckFriction::share_of_static(p_, speed.left),
                     model::StribeckFriction::share_of_static(p_, speed.right)};
        return at_;
    }
    bool is(const Parameters<double>& p) const { return p[2] == p_[2]; }

  private:
    Parameters<double> p_;
    double at_s_ = -1e300;
    At at_;
};

class StribeckTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = false;
    StribeckTerm(const Parameters<double>& p, const Setting&)
        : p_(p), fall_(std::make_shared<StribeckFall>(p)) {}
    WheelPair<double> over(const Interval& i) override {
        const auto& [sign, share] = fall_->over(i);
        return {-sign.left * model::StribeckFriction::limit_of_share(p_, share.left),
                -sign.right * model::StribeckFriction::limit_of_share(p_, share.right)};
    }
    void share(const Contribution& other) override {
        const auto* stribeck = dynamic_cast<const StribeckTerm*>(&other);
        if (stribeck != nullptr && stribeck->fall_->is(p_)) fall_ = stribeck->fall_;
    }

  private:
    Parameters<double> p_;
    std::shared_ptr<StribeckFall> fall_;
};

template <>
struct HypothesisOf<model::StribeckFriction> : Defaults<model::StribeckFriction> {
    using Columns = StribeckTerm;
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting&) {
        // Friction that is less as a wheel creeps is Coulomb's, whose sign no real wheel changes at once.
        constexpr double kLeastRise = 0.1;
        StartingPoints from{{{0, 0, 0.4}, {0, 0, 0.8}, {0, 0, 1.6}, {0, 0, 3.2}},
                            [](const Parameters<double>& at) {
                                return std::vector<Parameters<double>>{{1, 1, at[2]}, {0, 1, at[2]}};
                            },
                            [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                                return Parameters<double>{a(0), a(0) + a(1), at[2]};
                            },
                            [](const Eigen::VectorXd& a) { return a(0) > 0 && a(1) > kLeastRise * a(0); },
                            {0.01, 0.01, 0.05}};
        from.itself = [](const Parameters<double>& at) { return at[1] > (1 + kLeastRise) * at[0]; };
        return from;
    }
    // NOLINTEND(readability-magic-numbers)
};

}  // namespace wheelwright::gap
