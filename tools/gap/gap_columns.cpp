#include "tools/gap/gap_columns.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <functional>
#include <numbers>
#include <utility>

#include "firmware/model/sine_cosine.hpp"
#include "tools/gap/gap_places.hpp"
#include "tools/gap/tyre_slip.hpp"

namespace wheelwright::gap {
namespace {

using model::Parameters;

// The pair of wheel torques that changes forward speed and yaw rate by so much over an interval.
WheelPair<double> pair_for(const Setting& s, double forward_m_per_s, double turning_rad_per_s, double dt_s) {
    const double sum = forward_m_per_s / (s.dynamics.k7_per_kg_m * dt_s);
    const double difference = turning_rad_per_s / (s.dynamics.k8_per_kg_m2 * dt_s);
    return {(sum - difference) / 2, (sum + difference) / 2};
}

// Mean sign of a speed that goes straight from a to b; less of one where it is below `least`.
double mean_sign(double a, double b, double least = 0) {
    const double size = std::abs(a) + std::abs(b) + 2 * least;
    return size > 0 ? (a + b) / size : 0.0;
}

Twist<double> change(const Setting& s, const Interval& i) {
    return model::twist_from_wheel_speeds(
        s.geometry, WheelPair<double>{i.after.left - i.before.left, i.after.right - i.before.right});
}

template <typename Effect>
class PathTerm : public Contribution {
  public:
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

class StribeckTerm : public Contribution {
  public:
    StribeckTerm(const Parameters<double>& p, const Setting&) : p_(p) {}
    WheelPair<double> over(const Interval& i) override {
        return {one(i.before.left, i.after.left), one(i.before.right, i.after.right)};
    }

  private:
    double one(double a, double b) const {
        return -mean_sign(a, b) * model::StribeckFriction::dry_limit(p_, (a + b) / 2);
    }
    Parameters<double> p_;
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
    SlipTerm(const Parameters<double>& p, const Setting& s)
        : s_(s), slip_(p, s.geometry, s.dynamics, model::kRotationShare + p[2]) {}
    WheelPair<double> over(const Interval& i) override {
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
    Setting s_;
    TyreSlip slip_;
    bool first_ = true;
};

// p[3], which the catalogue does not have: how far the load lies ahead of where the robot's mass seems to be.
class PayloadTerm : public Contribution {
  public:
    PayloadTerm(const Parameters<double>& p, const Setting& s)
        : p_(p),
          s_(s),
          loaded_(model::PayloadStep::loaded(p, s.geometry, s.dynamics, s.dynamics.k5_m + p[3])) {}
    bool slow() const override { return true; }
    WheelPair<double> over(const Interval& i) override {
        const double after = std::clamp((i.t_s + i.dt_s - p_[0]) / i.dt_s, 0.0, 1.0);
        if (after == 0) return {};
        const Twist<double> u = model::twist_from_wheel_speeds(s_.geometry, i.speed());
        const auto& k = s_.dynamics;
        const double forward = (loaded_.k5_m - k.k5_m) * u.omega_rad_per_s * u.omega_rad_per_s +
                               (loaded_.k7_per_kg_m - k.k7_per_kg_m) * i.torque.sum();
        const double turning = (loaded_.k6_per_m - k.k6_per_m) * u.v_m_per_s * u.omega_rad_per_s +
                               (loaded_.k8_per_kg_m2 - k.k8_per_kg_m2) * i.torque.difference();
        return pair_for(s_, after * forward, after * turning, 1);
    }

  private:
    Parameters<double> p_;
    Setting s_;
    model::Dynamics<double> loaded_;
};

// A first-order lag of the speeds reported is one of all that accelerates them. The products of speeds are
// lagged too, at the speeds as they were.
class MeasurementLagTerm : public Contribution {
  public:
    MeasurementLagTerm(const Parameters<double>& p, const Setting& s) : p_(p), s_(s), torque_(p, s) {}
    WheelPair<double> over(const Interval& i) override {
        const WheelPair<double> late = torque_.over(i);  // lagged less given
        const auto& k = s_.dynamics;
        const Twist<double> u = model::twist_from_wheel_speeds(s_.geometry, i.speed());
        const double v = u.v_m_per_s + p_[0] * k.k7_per_kg_m * (i.torque.sum() + late.sum());
        const double omega =
            u.omega_rad_per_s + p_[0] * k.k8_per_kg_m2 * (i.torque.difference() + late.difference());
        const double share = p_[0] > 0 ? -std::expm1(-i.dt_s / p_[0]) : 1.0;
        square_ += share * (omega * omega - square_);
        product_ += share * (v * omega - product_);
        const WheelPair<double> products =
            pair_for(s_, k.k5_m * (square_ - u.omega_rad_per_s * u.omega_rad_per_s),
                     k.k6_per_m * (product_ - u.v_m_per_s * u.omega_rad_per_s), 1);
        return {late.left + products.left, late.right + products.right};
    }

  private:
    Parameters<double> p_;
    Setting s_;
    PathTerm<model::ActuatorLag> torque_;
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

// Points at which an effect is tried.
struct Grid {
    std::vector<Parameters<double>> points;
    // At a point: parameters whose contributions are the columns; what the point's amounts multiply.
    std::function<std::vector<Parameters<double>>(const Parameters<double>&)> units;
    std::function<Parameters<double>(const Parameters<double>&, const Eigen::VectorXd&)> parameters;
    std::function<bool(const Eigen::VectorXd&)> plausible;
    std::array<double, model::kMaxEffectParameters> step{};  // for slopes at a focus; 0: this one is not free
    // At a focus: a change of what is no parameter of the effect, but unknown too, and how many of it may be
    // expected; 0: nothing is.
    Parameters<double> beside{};
    double expected = 0;
    // Foci around what was found, that itself last: for a parameter that slopes are too short-sighted for.
    std::function<std::vector<Parameters<double>>(const Parameters<double>&)> closer = {};
    // At a focus: still this effect, and not the special case of it that another one is.
    std::function<bool(const Parameters<double>&)> itself = [](const Parameters<double>&) { return true; };
    // The parameter whose 0 is a case by itself: no slope is taken there.
    std::size_t apart_at_zero = model::kMaxEffectParameters;
};

Parameters<double> as_it_is(const Parameters<double>& at, const Eigen::VectorXd&) { return at; }
std::vector<Parameters<double>> alone(const Parameters<double>& at) { return {at}; }
// The one parameter grows with the amount.
Parameters<double> scaled(const Parameters<double>& at, const Eigen::VectorXd& a) { return {at[0] * a(0)}; }
bool any_size(const Eigen::VectorXd&) { return true; }
bool near_one(const Eigen::VectorXd& a) { return a(0) > 0.45 && a(0) < 2.2; }
bool roughly_one(const Eigen::VectorXd& a) { return a(0) > 0.2 && a(0) < 4; }

// NOLINTBEGIN(readability-magic-numbers): points
template <typename Effect>
Grid grid_of(const Setting&) {
    return {};
}
template <>
Grid grid_of<model::StribeckFriction>(const Setting&) {
    return {{{0, 0, 0.4}, {0, 0, 0.8}, {0, 0, 1.6}, {0, 0, 3.2}},
            [](const Parameters<double>& at) {
                return std::vector<Parameters<double>>{{1, 1, at[2]}, {0, 1, at[2]}};
            },
            [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                return Parameters<double>{a(0), a(0) + a(1), at[2]};
            },
            [](const Eigen::VectorXd& a) { return a(0) > 0 && a(1) > 0.1 * a(0); },
            {0.01, 0.01, 0.05}};
}
template <>
Grid grid_of<model::CastorDrag>(const Setting& s) {
    Grid grid{{},
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
            grid.points.push_back({0, 0, arm * s.geometry.track_m, trail});
    }
    // the trail has minima beside the right one
    if (s.closer_looks > 0) {
        const double spread = std::pow(4.0, -s.closer_looks);
        grid.closer = [=](const Parameters<double>& at) {
            std::vector<Parameters<double>> points{at};
            if (spread > 0.01) {
                for (const double factor : {1 - spread, 1 + spread})
                    points.insert(points.begin(), {at[0], at[1], at[2], factor * at[3]});
            }
            return points;
        };
    }
    return grid;
}
template <>
Grid grid_of<model::CogLateral>(const Setting&) {
    return {{{1}}, alone, scaled, any_size, {0.001}};
}
template <>
Grid grid_of<model::WheelRadiusMismatch>(const Setting&) {
    return {{{0.02}}, alone, scaled, any_size, {0.002}};
}
template <>
Grid grid_of<model::ActuatorLag>(const Setting&) {
    return {{{0.006}, {0.012}, {0.025}, {0.05}, {0.1}}, alone, scaled, near_one, {0.0005}};
}
template <>
Grid grid_of<model::TransportDelay>(const Setting&) {
    return {{{0.002}, {0.004}, {0.008}, {0.016}, {0.03}}, alone, scaled, near_one, {0.0005}};
}
template <>
Grid grid_of<model::DeadZone>(const Setting& s) {
    Grid grid{{}, alone, scaled, near_one, {0.01 * s.peak_torque_Nm}};
    for (const double share : {0.03, 0.06, 0.12, 0.24}) grid.points.push_back({share * s.peak_torque_Nm});
    return grid;
}
template <>
Grid grid_of<model::Backlash>(const Setting& s) {
    const double r = s.geometry.mean_radius_m();
    const double whole = s.effective_mass_kg() * r * r / 2;
    // How long the gap lasts is told by gap times inertia alone; the inertia is a usual one.
    constexpr double kMotorsShare = 0.75 * model::kRotationShare;
    Grid grid{{}, alone, as_it_is, roughly_one, {0.001, 0}};
    for (const double gap : {0.006, 0.0085, 0.012, 0.017, 0.024, 0.034, 0.048, 0.068, 0.096})
        grid.points.push_back({gap, kMotorsShare * whole});
    return grid;
}
template <>
Grid grid_of<model::TorqueSaturation>(const Setting& s) {
    Grid grid{{}, alone, as_it_is, roughly_one, {0.01 * s.peak_torque_Nm}};
    for (const double share : {0.93, 0.85, 0.72, 0.55, 0.4})
        grid.points.push_back({share * s.peak_torque_Nm});
    return grid;
}
template <>
Grid grid_of<model::BackEmfLimit>(const Setting& s) {
    Grid grid{{}, alone, as_it_is, roughly_one, {0.01 * s.peak_torque_Nm, 0.01 * s.peak_speed_rad_per_s}};
    for (const double stall : {0.7, 0.85, 1.0, 1.2, 1.5}) {
        for (const double speed : {1.05, 1.25, 1.5, 1.9})
            grid.points.push_back({stall * s.peak_torque_Nm, speed * s.peak_speed_rad_per_s});
    }
    grid.itself = [most = 4 * s.peak_speed_rad_per_s](const Parameters<double>& p) { return p[1] < most; };
    return grid;
}
template <>
Grid grid_of<model::WheelSlip>(const Setting&) {
    // how much force is the limit does not show where none is reached
    return {{{1, 0.3}},
            alone,
            [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                return Parameters<double>{at[0], at[1] * a(0)};
            },
            [](const Eigen::VectorXd& a) { return a(0) > 0; },
            {0, 0.005},
            {0, 0, 0.01},
            model::kRotationShareError};
}
template <>
Grid grid_of<model::PayloadStep>(const Setting& s) {
    const double mass = s.effective_mass_kg();
    const double inertia = s.effective_inertia_kg_m2();
    constexpr double kUnit = 0.1;  // of the robot's own
    // what is lost of the gain by a unit, and what load loses so much of it
    constexpr double kLost = kUnit / (1 + kUnit);
    const auto load = [](double amount) {
        const double lost = std::clamp(kLost * amount, -0.6, 0.6);
        return lost / (1 - lost);
    };
    Grid grid{
        {},
        [=](const Parameters<double>& at) {
            return std::vector<Parameters<double>>{{at[0], kUnit * mass, 0}, {at[0], 0, kUnit * inertia}};
        },
        [=](const Parameters<double>& at, const Eigen::VectorXd& a) {
            return Parameters<double>{at[0], mass * load(a(0)), inertia * load(a(1))};
        },
        // what more than doubles the robot is no load
        [=](const Eigen::VectorXd& a) {
            return a(0) > -5 && a(1) > -5 && a(0) + a(1) > 0 && kLost * std::max(a(0), a(1)) < 0.5;
        },
        {0, mass / 100, inertia / 100}};
    for (int i = 2; i <= 16; ++i) grid.points.push_back({s.span_s * i * kEventSpacing});
    grid.beside = {0, 0, 0, 0.01};
    grid.expected = 0.03;
    if (s.event_spacing_s == 0) return grid;
    grid.closer = [=](const Parameters<double>& at) {
        std::vector<Parameters<double>> points;
        for (const int i : {-4, 4, -3, 3, -2, 2, -1, 1, 0}) {
            points.push_back(
                {std::clamp(at[0] + i * s.event_spacing_s, 0.02 * s.span_s, 0.98 * s.span_s), at[1], at[2]});
        }
        return points;
    };
    return grid;
}
template <>
Grid grid_of<model::GainDrift>(const Setting& s) {
    Grid grid{{{0.1, 0}, {0.1, 0.15 * s.span_s}, {0.1, 0.4 * s.span_s}},
              alone,
              [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                  return Parameters<double>{at[0] * a(0), at[1]};
              },
              [](const Eigen::VectorXd& a) { return a(0) > 0 && a(0) < 9; },
              {0.01, 0.02 * s.span_s}};
    grid.apart_at_zero = 1;
    return grid;
}
template <>
Grid grid_of<model::TorqueRipple>(const Setting& s) {
    // the wheels alike, and one against the other
    constexpr double kPi = std::numbers::pi;
    Grid grid{{},
              [](const Parameters<double>& at) {
                  const double n = at[1];
                  return std::vector<Parameters<double>>{
                      {1, n, 0, 0}, {1, n, kPi / 2, 0}, {1, n, 0, kPi}, {1, n, kPi / 2, kPi}};
              },
              [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                  const std::complex<double> left{a(0) + a(2), a(1) + a(3)};
                  const std::complex<double> right{a(0) - a(2), a(1) - a(3)};
                  return Parameters<double>{(std::abs(left) + std::abs(right)) / 2, at[1], std::arg(left),
                                            std::arg(right * std::conj(left))};
              },
              any_size,
              {}};
    // less than two periods are like anything that changes slowly
    constexpr double kLeast_rad = 4 * std::numbers::pi;
    for (int order = 1; order <= kMostOrder; ++order) {
        if (order * s.turned_rad >= kLeast_rad) grid.points.push_back({0, double(order), 0});
    }
    return grid;
}
template <>
Grid grid_of<model::MeasurementLag>(const Setting&) {
    return {{{0.01}, {0.025}, {0.06}, {0.15}}, alone, scaled, near_one, {0.001}};
}
// NOLINTEND(readability-magic-numbers)

Grid grid_of(std::size_t effect, const Setting& s) {
    Grid grid;
    std::array<bool, model::kEffectCount> one{};
    one[effect] = true;
    model::for_each_active(one, [&]<typename Effect>(std::size_t) {
        if constexpr (model::kCoordinates<Effect> == 0) grid = grid_of<Effect>(s);
    });
    return grid;
}

// A function of motion and torque that stands for no effect.
struct Instant {
    WheelPair<double> torque, speed, slow_torque, angle;
    Twist<double> twist;
    double heading = 0, time = 0;
};
struct Rich {
    std::string_view place;
    WheelPair<double> (*value)(const Instant&);
};
WheelPair<double> each(const WheelPair<double>& a, double (*f)(double)) { return {f(a.left), f(a.right)}; }

// NOLINTBEGIN(readability-magic-numbers): shapes, not quantities
constexpr std::array kRich{
    Rich{"wheel speed",
         [](const Instant& i) {
             return WheelPair<double>{i.speed.left, 0};
         }},
    Rich{"wheel speed",
         [](const Instant& i) {
             return WheelPair<double>{0, i.speed.right};
         }},
    Rich{"wheel speed",
         [](const Instant& i) { return each(i.speed, [](double w) { return w * std::abs(w) / 10; }); }},
    Rich{"wheel speed",
         [](const Instant& i) { return each(i.speed, [](double w) { return w * w * w / 100; }); }},
    Rich{"direction of turning of the wheels",
         [](const Instant& i) {
             return WheelPair<double>{sign_of(i.speed.left), 0};
         }},
    Rich{"direction of turning of the wheels",
         [](const Instant& i) {
             return WheelPair<double>{0, sign_of(i.speed.right)};
         }},
    Rich{"low wheel speed",
         [](const Instant& i) {
             return each(i.speed, [](double w) { return sign_of(w) * std::exp(-w * w); });
         }},
    Rich{"yaw rate",
         [](const Instant& i) {
             const double s = sign_of(i.twist.omega_rad_per_s);
             return WheelPair<double>{-s, s};
         }},
    Rich{"yaw rate",
         [](const Instant& i) {
             const double w = i.twist.omega_rad_per_s * std::abs(i.twist.omega_rad_per_s);
             return WheelPair<double>{-w, w};
         }},
    Rich{"torque",
         [](const Instant& i) {
             return WheelPair<double>{i.torque.left, 0};
         }},
    Rich{"torque", [](const Instant& i) { return each(i.torque, [](double t) { return t * std::abs(t); }); }},
    Rich{"torque", [](const Instant& i) { return each(i.torque, sign_of); }},
    Rich{"torque times speed",
         [](const Instant& i) {
             return WheelPair<double>{i.torque.left * std::abs(i.speed.left) / 10,
                                      i.torque.right * std::abs(i.speed.right) / 10};
         }},
    Rich{"lag",
         [](const Instant& i) {
             return WheelPair<double>{i.slow_torque.left - i.torque.left,
                                      i.slow_torque.right - i.torque.right};
         }},
    Rich{"constant",
         [](const Instant&) {
             return WheelPair<double>{1, 0};
         }},
    Rich{"constant",
         [](const Instant&) {
             return WheelPair<double>{0, 1};
         }},
    Rich{"heading",
         [](const Instant& i) {
             const double c = std::cos(i.heading);
             return WheelPair<double>{c, c};
         }},
    Rich{"heading",
         [](const Instant& i) {
             const double s = std::sin(i.heading);
             return WheelPair<double>{s, s};
         }},
    Rich{"heading",
         [](const Instant& i) {
             const double c = std::cos(i.heading);
             return WheelPair<double>{-c, c};
         }},
    Rich{"heading",
         [](const Instant& i) {
             const double s = std::sin(i.heading);
             return WheelPair<double>{-s, s};
         }},
    Rich{"wheel angle", [](const Instant& i) { return each(i.angle, [](double a) { return std::sin(a); }); }},
    Rich{"wheel angle", [](const Instant& i) { return each(i.angle, [](double a) { return std::cos(a); }); }},
    Rich{"time",
         [](const Instant& i) {
             return WheelPair<double>{i.torque.left * i.time / 30, i.torque.right * i.time / 30};
         }},
    Rich{"coupling of turning and driving",
         [](const Instant& i) {
             const double w = i.twist.omega_rad_per_s * i.twist.omega_rad_per_s;
             return WheelPair<double>{-w, w};
         }},
    Rich{"coupling of turning and driving",
         [](const Instant& i) {
             const double w = i.twist.omega_rad_per_s * i.twist.v_m_per_s;
             return WheelPair<double>{w, w};
         }},
};
// NOLINTEND(readability-magic-numbers)

}  // namespace

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

std::pair<Parameters<double>, bool> parameters_of(const Way& way, const Eigen::VectorXd& amounts,
                                                  const Setting& setting) {
    Parameters<double> p{};
    switch (way.kind) {
        case Way::Kind::linear: {
            for (std::size_t i = 0; i < way.amounts.size(); ++i) {
                if (way.together) {
                    p[0] = p[1] = amounts(0);
                } else {
                    p[way.coordinate[i]] = amounts(Eigen::Index(i));
                }
            }
            std::array<bool, model::kEffectCount> one{};
            one[way.effect] = true;
            model::for_each_active(one, [&]<typename Effect>(std::size_t) {
                if constexpr (model::HasOwnCoordinates<Effect>) p = Effect::from_coordinates(p);
            });
            return {p, true};
        }
        case Way::Kind::grid: {
            const Grid grid = grid_of(way.effect, setting);
            return {grid.parameters(way.at, amounts), grid.plausible(amounts)};
        }
        case Way::Kind::focus:
            p = way.at;
            for (std::size_t i = 0; i < way.free.size(); ++i) p[way.free[i]] += amounts(Eigen::Index(i));
            return {p, grid_of(way.effect, setting).itself(p)};
    }
    return {p, true};
}

Dictionary::Dictionary(const Setting& setting, const Points& focus, bool grids, bool places)
    : setting_(setting), linear_(model::kEffectCount), ways_(model::kEffectCount) {
    columns_.resize(kFirstEffect);
    std::array<bool, model::kEffectCount> all{};
    all.fill(true);
    model::for_each_active(all, [&]<typename Effect>(std::size_t i) {
        const auto first = static_cast<int>(columns_.size());
        for (unsigned k = 0; k < model::kCoordinates<Effect>; ++k) columns_.push_back({i, ""});
        linear_[i] = {first, static_cast<int>(columns_.size())};
    });
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (linear_[i].first != linear_[i].second) continue;
        const auto found = focus.find(i);
        const Grid grid = grid_of(i, setting_);
        if (found != focus.end() && grid.closer) {
            for (const Parameters<double>& at : grid.closer(found->second)) add_focus(i, at);
            continue;
        }
        if (grids || found != focus.end()) add_grid(i);
        if (found != focus.end() && can_focus(i)) add_focus(i, found->second);
    }
    rich_.first = static_cast<int>(columns_.size());
    for (const Rich& rich : kRich) columns_.push_back({model::kEffectCount, rich.place});
    rich_.second = static_cast<int>(columns_.size());
    places_.first = rich_.second;
    if (places) {
        for (const PlaceColumns::Kind& kind : PlaceColumns::kinds())
            columns_.push_back({model::kEffectCount, kind.place});
    }
    places_.second = static_cast<int>(columns_.size());
}

bool Dictionary::can_focus(std::size_t effect) const {
    return grid_of(effect, setting_).step != decltype(Grid::step){};
}

std::size_t Dictionary::term(std::size_t effect, const Parameters<double>& p) {
    terms_.push_back({effect, p});
    return terms_.size() - 1;
}

int Dictionary::add(std::size_t effect, const Probe& probe) {
    probes_.push_back(probe);
    columns_.push_back({effect, ""});
    return static_cast<int>(columns_.size()) - 1;
}

void Dictionary::add_grid(std::size_t effect) {
    const Grid grid = grid_of(effect, setting_);
    for (const Parameters<double>& at : grid.points) {
        Way way;
        way.effect = effect;
        way.kind = Way::Kind::grid;
        way.at = at;
        for (const Parameters<double>& unit : grid.units(at)) {
            way.amounts.push_back({{add(effect, {term(effect, unit)})}});
        }
        ways_[effect].push_back(way);
    }
}

// Slopes are taken to one side where the other is out of the parameter's range.
void Dictionary::add_focus(std::size_t effect, const Parameters<double>& at) {
    const Grid grid = grid_of(effect, setting_);
    const auto& info = model::kEffects[effect].parameters;
    Way way;
    way.effect = effect;
    way.kind = Way::Kind::focus;
    way.at = at;
    const std::size_t here = term(effect, at);
    way.fixed.push_back(add(effect, {here}));
    for (std::size_t j = 0; j < info.size(); ++j) {
        if (grid.step[j] == 0 || (j == grid.apart_at_zero && at[j] == 0)) continue;
        Parameters<double> up = at;
        Parameters<double> down = at;
        up[j] = std::min(info[j].maximum, at[j] + grid.step[j]);
        down[j] = std::max(info[j].minimum, at[j] - grid.step[j]);
        way.free.push_back(j);
        way.amounts.push_back({{add(effect, {term(effect, up), term(effect, down), 1 / (up[j] - down[j])})}});
    }
    if (grid.beside != Parameters<double>{}) {
        Parameters<double> up = at;
        Parameters<double> down = at;
        double step = 0;
        for (std::size_t j = 0; j < at.size(); ++j) {
            up[j] += grid.beside[j];
            down[j] -= grid.beside[j];
            step += 2 * grid.beside[j];
        }
        way.amounts.push_back(
            {{add(effect, {term(effect, up), term(effect, down), 1 / step})}, grid.expected});
    }
    ways_[effect].push_back(way);
}

Dictionary::Walker::Walker(const Dictionary& dictionary) : dictionary_(dictionary) {
    for (const Term& t : dictionary.terms_) {
        term_.push_back(contribution(t.effect, t.parameters, dictionary.setting_));
        for (std::size_t i = 0; i + 1 < term_.size(); ++i) {
            if (dictionary.terms_[i].effect == t.effect) term_.back()->share(*term_[i]);
        }
    }
    for (std::size_t t = 0; t < term_.size(); ++t) (term_[t]->slow() ? slow_ : quick_).push_back(t);
    term_sums_.resize(term_.size());
    columns_.resize(dictionary.columns_.size() - kTorque);
    const auto [first, end] = dictionary.places_;
    if (first != end) places_ = std::make_shared<PlaceColumns>(dictionary.setting_);
}

void Dictionary::Walker::forget() {
    std::fill(term_sums_.begin(), term_sums_.end(), WheelPair<double>{});
    std::fill(columns_.begin(), columns_.end(), WheelPair<double>{});
}

void Dictionary::Walker::put_together(const Interval& i) {
    if (together_++ == 0) {
        whole_ = i;
        return;
    }
    const double share = 1 / double(together_);
    const auto mean = [&](double& of, double next) { of += share * (next - of); };
    whole_.dt_s += i.dt_s;
    whole_.after = i.after;
    mean(whole_.torque.left, i.torque.left);
    mean(whole_.torque.right, i.torque.right);
    mean(whole_.angle.left, i.angle.left);
    mean(whole_.angle.right, i.angle.right);
    mean(whole_.heading_rad, i.heading_rad);
}

void Dictionary::Walker::close() {
    for (const std::size_t t : slow_) {
        if (together_ == 0) break;
        const WheelPair<double> pair = term_[t]->over(whole_);
        term_sums_[t] = {double(acting_) * pair.left, double(acting_) * pair.right};
    }
    together_ = acting_ = 0;
}

void Dictionary::Walker::add(const WheelPair<double>& pair) {
    columns_[at_].left += pair.left;
    columns_[at_].right += pair.right;
    ++at_;
}

void Dictionary::Walker::step(const Interval& i, bool standing) {
    if (first_) slow_torque_ = i.torque;
    first_ = false;
    for (const std::size_t t : quick_) {
        const WheelPair<double> pair = term_[t]->over(i);
        if (standing) continue;
        term_sums_[t].left += pair.left;
        term_sums_[t].right += pair.right;
    }
    if (!slow_.empty()) put_together(i);
    acting_ += standing ? 0 : 1;
    if (!standing) {
        at_ = 0;
        add(i.torque);
        add({i.torque_before.left - i.torque.left, i.torque_before.right - i.torque.right});
        add_effects(i);
        at_ += dictionary_.probes_.size();
        Instant at;
        at.torque = i.torque;
        at.speed = i.speed();
        at.slow_torque = slow_torque_;
        at.angle = i.angle;
        at.twist = model::twist_from_wheel_speeds(dictionary_.setting_.geometry, at.speed);
        at.heading = i.heading_rad;
        at.time = i.t_s;
        for (const Rich& rich : kRich) add(rich.value(at));
    }
    if (places_ && !standing) {
        place_values_.clear();
        places_->append(i, place_values_);
        for (const WheelPair<double>& pair : place_values_) add(pair);
    }
    if (places_) places_->advance(i);
    constexpr double kSlow_s = 0.02;
    const double share = i.dt_s / (i.dt_s + kSlow_s);
    slow_torque_.left += share * (i.torque.left - slow_torque_.left);
    slow_torque_.right += share * (i.torque.right - slow_torque_.right);
}

// The points' columns are differences of contributions.
void Dictionary::Walker::combine() {
    std::size_t column = std::size_t(dictionary_.rich_.first) - kTorque - dictionary_.probes_.size();
    for (const Probe& probe : dictionary_.probes_) {
        WheelPair<double> pair = term_sums_[probe.plus];
        if (probe.minus != kNone) {
            pair.left -= term_sums_[probe.minus].left;
            pair.right -= term_sums_[probe.minus].right;
        }
        columns_[column++] = {probe.scale * pair.left, probe.scale * pair.right};
    }
}

// The wheel torque of one unit of each coordinate of each linear effect.
void Dictionary::Walker::add_effects(const Interval& i) {
    const Setting& s = dictionary_.setting_;
    const WheelPair<double> speed = i.speed();
    const model::Motion<double> motion{speed, i.angle, model::twist_from_wheel_speeds(s.geometry, speed),
                                       i.heading_rad};
    const model::EffectContext<double> context{motion, i.torque, s.geometry, s.dynamics};
    std::array<bool, model::kEffectCount> all{};
    all.fill(true);
    model::for_each_active(all, [&]<typename Effect>(std::size_t) {
        for (unsigned k = 0; k < model::kCoordinates<Effect>; ++k) {
            if constexpr (model::Dry<Effect>) {
                const WheelPair<double> d =
                    model::wheel_torque_Nm(s.geometry, Effect::template dry_direction<double>(k));
                const double amount =
                    -mean_sign(model::sliding_speed(d, i.before), model::sliding_speed(d, i.after));
                add({amount * d.left, amount * d.right});
            } else if constexpr (model::kCoordinates<Effect> > 0) {
                add(model::smooth_column<Effect>(k, context));
            }
        }
    });
}

}  // namespace wheelwright::gap
