#include "tools/gap/hypotheses/contribution.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>
#include <utility>

#include "firmware/model/sine_cosine.hpp"
#include "tools/gap/hypotheses/tyre_slip.hpp"

namespace wheelwright::gap {
namespace {

using model::Parameters;

WheelPair<double> pair_of(double sum, double difference) {
    return {(sum - difference) / 2, (sum + difference) / 2};
}

// The pair of wheel torques that changes forward speed and yaw rate by so much over an interval.
WheelPair<double> pair_for(const Setting& s, double forward_m_per_s, double turning_rad_per_s, double dt_s) {
    return pair_of(forward_m_per_s / (s.dynamics.k7_per_kg_m * dt_s),
                   turning_rad_per_s / (s.dynamics.k8_per_kg_m2 * dt_s));
}

Twist<double> change(const Setting& s, const Interval& i) {
    return model::twist_from_wheel_speeds(
        s.geometry, WheelPair<double>{i.after.left - i.before.left, i.after.right - i.before.right});
}

template <typename Effect>
class PathTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = false;
    PathTerm(const Parameters<double>& p, const Setting&) : p_(p) {}
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

// A first-order lag: the mean over an interval in which the input is held. What it keeps is computed once for
// intervals of one length.
class Lag {
  public:
    explicit Lag(double time_s) : time_s_(time_s) {}
    double operator()(double& state, double input, double dt_s) {
        if (!(time_s_ > 0)) return input;
        if (dt_s != dt_s_) {
            dt_s_ = dt_s;
            keeps_ = model::exp_minus(dt_s / time_s_);
            mean_ = model::mean_exp_minus(dt_s / time_s_);
        }
        const double away = state - input;
        state = input + away * keeps_;
        return input + away * mean_;
    }

  private:
    double time_s_;
    double dt_s_ = 0, keeps_ = 1, mean_ = 1;
};

class ActuatorLagTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = false;
    ActuatorLagTerm(const Parameters<double>& p, const Setting&) : lagged_(p[0]) {}
    WheelPair<double> over(const Interval& i) override {
        return {lagged_(state_.left, i.torque.left, i.dt_s) - i.torque.left,
                lagged_(state_.right, i.torque.right, i.dt_s) - i.torque.right};
    }

  private:
    Lag lagged_;
    WheelPair<double> state_;
};

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

// Sine and cosine of both wheels' angles times 1, 2, ...: what ripples of all orders share.
class Harmonics {
  public:
    static constexpr std::size_t kMost = kMostOrder;
    using Wave = std::array<model::SineCosine<double>, kMost + 1>;

    const WheelPair<Wave>& at(const Interval& i) {
        if (i.t_s != at_s_) {
            fill(wave_.left, i.angle.left);
            fill(wave_.right, i.angle.right);
            at_s_ = i.t_s;
        }
        return wave_;
    }

  private:
    static void fill(Wave& wave, double angle_rad) {
        wave[0] = {0, 1};
        wave[1] = model::sine_cosine(angle_rad);
        for (std::size_t n = 2; n <= kMost; ++n) {
            wave[n] = {wave[n - 1].sine * wave[1].cosine + wave[n - 1].cosine * wave[1].sine,
                       wave[n - 1].cosine * wave[1].cosine - wave[n - 1].sine * wave[1].sine};
        }
    }
    double at_s_ = -1e300;
    WheelPair<Wave> wave_;
};

// What swings with the angle is best told by the middle of the interval.
class RippleTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = false;
    RippleTerm(const Parameters<double>& p, const Setting&)
        : amplitude_Nm_(p[0]),
          order_(p[1]),
          shared_(p[1] == std::floor(p[1]) && p[1] >= 0 && p[1] <= double(Harmonics::kMost)),
          phase_{model::sine_cosine(p[2]), model::sine_cosine(p[2] + p[3])},
          harmonics_(std::make_shared<Harmonics>()) {}
    WheelPair<double> over(const Interval& i) override {
        if (!shared_) {
            return {ripple(model::sine_cosine(order_ * i.angle.left), phase_.left),
                    ripple(model::sine_cosine(order_ * i.angle.right), phase_.right)};
        }
        const auto& wave = harmonics_->at(i);
        const auto n = static_cast<std::size_t>(order_);
        return {ripple(wave.left[n], phase_.left), ripple(wave.right[n], phase_.right)};
    }
    void share(const Contribution& other) override {
        const auto* ripple = dynamic_cast<const RippleTerm*>(&other);
        if (ripple != nullptr) harmonics_ = ripple->harmonics_;
    }

  private:
    using Phase = model::SineCosine<double>;
    double ripple(const Phase& wave, const Phase& phase) const {
        return amplitude_Nm_ * (wave.sine * phase.cosine + wave.cosine * phase.sine);
    }
    double amplitude_Nm_, order_;
    bool shared_;
    WheelPair<Phase> phase_;
    std::shared_ptr<Harmonics> harmonics_;
};

class CogLateralTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = true;
    CogLateralTerm(const Parameters<double>& p, const Setting& s) : p_(p), s_(s) {}
    bool slow() const override { return true; }
    WheelPair<double> over(const Interval& i) override {
        const Twist<double> d = change(s_, i);
        return model::wheel_torque_Nm(
            s_.geometry, model::CogLateral::push(p_, s_.geometry, s_.dynamics,
                                                 {d.v_m_per_s / i.dt_s, d.omega_rad_per_s / i.dt_s}));
    }

  private:
    Parameters<double> p_;
    Setting s_;
};

class RadiusMismatchTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = true;
    RadiusMismatchTerm(const Parameters<double>& p, const Setting& s)
        : s_(s), real_(model::WheelRadiusMismatch::geometry(p, s.geometry)) {}
    bool slow() const override { return true; }
    WheelPair<double> over(const Interval& i) override {
        const Twist<double> seen = model::twist_from_wheel_speeds(s_.geometry, i.speed());
        const Twist<double> is = model::twist_from_wheel_speeds(real_, i.speed());
        const Twist<double> seen_change = change(s_, i);
        Setting real = s_;
        real.geometry = real_;
        const Twist<double> is_change = change(real, i);
        const auto& k = s_.dynamics;
        const double forward =
            k.k5_m * (is.omega_rad_per_s * is.omega_rad_per_s - seen.omega_rad_per_s * seen.omega_rad_per_s);
        const double turning =
            k.k6_per_m * (is.v_m_per_s * is.omega_rad_per_s - seen.v_m_per_s * seen.omega_rad_per_s);
        WheelPair<double> pair =
            pair_for(s_, seen_change.v_m_per_s - is_change.v_m_per_s + i.dt_s * forward,
                     seen_change.omega_rad_per_s - is_change.omega_rad_per_s + i.dt_s * turning, i.dt_s);
        // the smaller wheel pushes harder
        pair.left += i.torque.left * (s_.geometry.wheel_radius_m.left / real_.wheel_radius_m.left - 1);
        pair.right += i.torque.right * (s_.geometry.wheel_radius_m.right / real_.wheel_radius_m.right - 1);
        return pair;
    }

  private:
    Setting s_;
    model::Geometry<double> real_;
};

// p[2], which the catalogue does not have: by how much the share of the wheels' rotation is larger than the
// usual one.
class SlipTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = true;
    SlipTerm(const Parameters<double>& p, const Setting& s)
        : s_(s), slip_(p, s.geometry, s.dynamics, model::kRotationShare + p[2]), rolls_(p[3] > 0) {}
    WheelPair<double> over(const Interval& i) override {
        if (rolls_) return as_it_rolls(i);
        // at the very first it has settled
        if (first_) slip_.advance(i.torque, i.dt_s);
        first_ = false;
        const double mean = slip_.mean_m_per_s();
        const double difference = slip_.difference_m_per_s();
        slip_.advance(i.torque, i.dt_s);
        const double forward = slip_.of_mean().bodys_share * (slip_.mean_m_per_s() - mean);
        const double turning = slip_.of_difference().bodys_share * (slip_.difference_m_per_s() - difference);
        // the body's speeds, not the wheels', make the products of speeds
        const Twist<double> wheels = model::twist_from_wheel_speeds(s_.geometry, i.speed());
        const double v = wheels.v_m_per_s - (mean + slip_.mean_m_per_s()) / 2;
        const double omega =
            wheels.omega_rad_per_s - (difference + slip_.difference_m_per_s()) / 2 / s_.geometry.track_m;
        const double square = omega * omega - wheels.omega_rad_per_s * wheels.omega_rad_per_s;
        const double product = v * omega - wheels.v_m_per_s * wheels.omega_rad_per_s;
        return pair_for(s_, forward + i.dt_s * s_.dynamics.k5_m * square,
                        turning / s_.geometry.track_m + i.dt_s * s_.dynamics.k6_per_m * product, i.dt_s);
    }

  private:
    // Slip in proportion to force and speed, settled. It has the size of the other law at half of the
    // largest speed.
    WheelPair<double> as_it_rolls(const Interval& i) const {
        const double usual_rad_per_s = s_.peak_speed_rad_per_s / 2;
        const auto changed = [&](double WheelPair<double>::*side) {
            return (std::abs(i.after.*side) * (i.torque.*side) -
                    std::abs(i.before.*side) * (i.torque_before.*side)) /
                   (s_.geometry.wheel_radius_m.*side * usual_rad_per_s);
        };
        const double left = changed(&WheelPair<double>::left);
        const double right = changed(&WheelPair<double>::right);
        const auto per_force = [](const TyreSlip::Settling& of) {
            return of.bodys_share * of.slip_per_force;
        };
        return pair_for(s_, per_force(slip_.of_mean()) * (left + right) / 2,
                        per_force(slip_.of_difference()) * (right - left) / s_.geometry.track_m, i.dt_s);
    }

    Setting s_;
    TyreSlip slip_;
    bool rolls_;
    bool first_ = true;
};

// What a load that comes at this time acts on along a log: what all the columns of it share.
class Loaded {
  public:
    Loaded(double time_s, const Setting& s) : time_s_(time_s), geometry_(s.geometry) {}

    // Of an interval, as much as there is load in it: omega^2, v omega, the torques' sum and difference.
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
        return at_ = {omega * u.omega_rad_per_s, omega * u.v_m_per_s, after * i.torque.sum(),
                      after * i.torque.difference()};
    }
    bool is(double time_s) const { return time_s == time_s_; }

  private:
    double time_s_;
    model::Geometry<double> geometry_;
    double at_s_ = -1e300;
    At at_;
};

// p[3], which the catalogue does not have: how far the load lies ahead of where the robot's mass seems to be.
class PayloadTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = true;
    PayloadTerm(const Parameters<double>& p, const Setting& s)
        : time_s_(p[0]), loaded_(std::make_shared<Loaded>(p[0], s)) {
        const model::Dynamics<double>& k = s.dynamics;
        const auto with_it = model::PayloadStep::loaded(p, s.geometry, k, k.k5_m + p[3]);
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

// A first-order lag of the speeds reported is one of all that accelerates them: the torque and the products
// of the speeds as they were, which are those reported and the lag's time of what accelerates these.
class MeasurementLagTerm : public Contribution {
  public:
    static constexpr bool kByDynamics = true;
    MeasurementLagTerm(const Parameters<double>& p, const Setting& s)
        : p_(p), s_(s), torque_(p, s), lagged_(p[0]) {}
    WheelPair<double> over(const Interval& i) override {
        const WheelPair<double> late = torque_.over(i);  // lagged less given
        const auto& k = s_.dynamics;
        const Twist<double> u = model::twist_from_wheel_speeds(s_.geometry, i.speed());
        const double v =
            u.v_m_per_s + p_[0] * (k.k5_m * square_ + k.k7_per_kg_m * (i.torque.sum() + late.sum()));
        const double omega =
            u.omega_rad_per_s +
            p_[0] * (k.k6_per_m * product_ + k.k8_per_kg_m2 * (i.torque.difference() + late.difference()));
        const double square = lagged_(square_, omega * omega, i.dt_s);
        const double product = lagged_(product_, v * omega, i.dt_s);
        const WheelPair<double> products =
            pair_for(s_, k.k5_m * (square - u.omega_rad_per_s * u.omega_rad_per_s),
                     k.k6_per_m * (product - u.v_m_per_s * u.omega_rad_per_s), 1);
        return {late.left + products.left, late.right + products.right};
    }

  private:
    Parameters<double> p_;
    Setting s_;
    ActuatorLagTerm torque_;
    Lag lagged_;
    double square_ = 0, product_ = 0;
};

// Those that regression on the wheel speeds cannot show have none.
template <typename Effect>
struct TermOf {
    using Type = void;
};
template <typename Effect>
    requires model::InTorquePath<Effect>
struct TermOf<Effect> {
    using Type = PathTerm<Effect>;
};
template <>
struct TermOf<model::ActuatorLag> {
    using Type = ActuatorLagTerm;
};
template <>
struct TermOf<model::TorqueRipple> {
    using Type = RippleTerm;
};
template <>
struct TermOf<model::StribeckFriction> {
    using Type = StribeckTerm;
};
template <>
struct TermOf<model::CastorDrag> {
    using Type = CastorTerm;
};
template <>
struct TermOf<model::CogLateral> {
    using Type = CogLateralTerm;
};
template <>
struct TermOf<model::WheelRadiusMismatch> {
    using Type = RadiusMismatchTerm;
};
template <>
struct TermOf<model::WheelSlip> {
    using Type = SlipTerm;
};
template <>
struct TermOf<model::PayloadStep> {
    using Type = PayloadTerm;
};
template <>
struct TermOf<model::MeasurementLag> {
    using Type = MeasurementLagTerm;
};

}  // namespace

bool by_dynamics(std::size_t effect) {
    bool yes = false;
    std::array<bool, model::kEffectCount> one{};
    one[effect] = true;
    model::for_each_active(one, [&]<typename Effect>(std::size_t) {
        using Type = typename TermOf<Effect>::Type;
        if constexpr (!std::is_void_v<Type>) {
            yes = Type::kByDynamics;
        } else {
            yes = model::ColumnsByDynamics<Effect>;
        }
    });
    return yes;
}

std::unique_ptr<Contribution> contribution(std::size_t effect, const Parameters<double>& parameters,
                                           const Setting& setting) {
    std::unique_ptr<Contribution> made;
    std::array<bool, model::kEffectCount> one{};
    one[effect] = true;
    model::for_each_active(one, [&]<typename Effect>(std::size_t) {
        if constexpr (!std::is_void_v<typename TermOf<Effect>::Type>) {
            made = std::make_unique<typename TermOf<Effect>::Type>(parameters, setting);
        }
    });
    return made;
}

}  // namespace wheelwright::gap
