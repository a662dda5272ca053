// A castor's rolling and swivelling friction, which remembers where its fork points.
#pragma once

#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

// Where the fork of a castor of this arm and trail points along a log: what all the columns of it share.
class CastorPath {
  public:
    CastorPath(const Parameters<double>& p, const Setting& s) : p_(p), geometry_(s.geometry) {}

    // Wheel torques of one unit of friction in wheel (0) and pivot (1) over an interval, the one after the
    // last.
    const std::array<WheelPair<double>, 2>& over(const Interval& i) {
        if (i.t_s == at_s_) return torque_;
        if (at_s_ < 0) sliding_ = sliding(i.before);
        const std::array before = sliding_;
        const Fork start = fork_;
        Castor::advance(p_, fork_, model::twist_from_wheel_speeds(geometry_, i.speed()), i.dt_s);
        sliding_ = sliding(i.after);
        Fork middle{start.sine + fork_.sine, start.cosine + fork_.cosine};
        const double length = std::sqrt(middle.sine * middle.sine + middle.cosine * middle.cosine);
        middle = length > 0 ? Fork{middle.sine / length, middle.cosine / length} : start;
        for (unsigned j = 0; j < 2; ++j) {
            const double friction =
                -mean_sign(before[j], sliding_[j], j == 0 ? 0.0 : kHardlyTurning_rad_per_s);
            const model::BodyForce<double> direction = Castor::direction(j, p_, middle);
            torque_[j] = model::wheel_torque_Nm(
                geometry_,
                model::BodyForce<double>{friction * direction.force_N, friction * direction.yaw_torque_Nm});
        }
        at_s_ = i.t_s;
        return torque_;
    }
    bool is(const Parameters<double>& p) const { return p[2] == p_[2] && p[3] == p_[3]; }

  private:
    using Castor = model::CastorDrag;
    using Fork = Castor::Memory<double>;
    // A fork that trails straight turns by what the wheels' noise makes of a yaw rate, to and fro.
    static constexpr double kHardlyTurning_rad_per_s = 0.05;

    std::array<double, 2> sliding(const WheelPair<double>& w) const {
        const Twist<double> u = model::twist_from_wheel_speeds(geometry_, w);
        return {Castor::sliding(Castor::direction(0, p_, fork_), u),
                Castor::sliding(Castor::direction(1, p_, fork_), u)};
    }

    Parameters<double> p_;
    model::Geometry<double> geometry_;
    Fork fork_;
    std::array<double, 2> sliding_{};
    double at_s_ = -1;
    std::array<WheelPair<double>, 2> torque_;
};

class CastorTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = false;
    CastorTerm(const Parameters<double>& p, const Setting& s)
        : p_(p), path_(std::make_shared<CastorPath>(p, s)) {}
    WheelPair<double> over(const Interval& i) override {
        const auto& unit = path_->over(i);
        return {p_[0] * unit[0].left + p_[1] * unit[1].left, p_[0] * unit[0].right + p_[1] * unit[1].right};
    }
    bool slow() const override { return true; }
    void share(const Contribution& other) override {
        const auto* castor = dynamic_cast<const CastorTerm*>(&other);
        if (castor != nullptr && castor->path_->is(p_)) path_ = castor->path_;
    }

  private:
    Parameters<double> p_;
    std::shared_ptr<CastorPath> path_;
};

template <>
struct HypothesisOf<model::CastorDrag> : Defaults<model::CastorDrag> {
    using Columns = CastorTerm;
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting& s) {
        StartingPoints from{
            {},
            [](const Parameters<double>& at) {
                return std::vector<Parameters<double>>{{1, 0, at[2], at[3]}, {0, 1, at[2], at[3]}};
            },
            [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                return Parameters<double>{a(0), a(1), at[2], at[3]};
            },
            [](const Eigen::VectorXd& a) { return a(0) > 0; },
            {0.01, 0.001, 0.01, 0.002}};
        for (const double arm : {-0.6, 0.45, 0.65, 0.9}) {
            for (const double trail : {0.02, 0.03, 0.042})
                from.points.push_back({0, 0, arm * s.geometry.track_m, trail});
        }
        // Nearer to the axle it holds no robot up: with the centre of gravity half of the track high that
        // tips over at a quarter of g. What is found there is any resistance of the floor, soft stripes for
        // one.
        from.itself = [least_m = s.geometry.track_m / 4](const Parameters<double>& at) {
            return std::abs(at[2]) > least_m;
        };
        // of the trail
        look_beside(from, s, [](const Parameters<double>& at, double amount) {
            return Parameters<double>{at[0], at[1], at[2], amount * at[3]};
        });
        return from;
    }
    // NOLINTEND(readability-magic-numbers)
    // Its own inertia and the give of its contact, which the model leaves out; friction of the pivot is seen
    // beside the moment of the wheel's. By how much, development logs of a robot that has both (wheelwright
    // gap-trials) say.
    static Uncertainty uncertainty(const UncertaintyOf& of) {
        constexpr std::array kOfModel{0.01, 0.15, 0.02, 0.04};
        constexpr double kPivotOfWheel = 0.1;
        return {std::hypot(of.relative, kOfModel[of.parameter]),
                of.parameter == 1 ? kPivotOfWheel * of.at[0] * of.at[3] : 0.0};
    }
};

}  // namespace wheelwright::gap
