// Torque that swings with the wheel's angle.
#pragma once

#include <array>
#include <cmath>
#include <complex>
#include <memory>
#include <numbers>
#include <vector>

#include "tools/gap/hypotheses/hypothesis.hpp"

namespace wheelwright::gap {

// Periods in a turn of the wheel that a ripple is looked for with, from one on.
inline constexpr int kMostOrder = 14;

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

// What swings with the angle shows best at the middle of the interval.
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

template <>
struct HypothesisOf<model::TorqueRipple> : Defaults<model::TorqueRipple> {
    using Columns = RippleTerm;
    // NOLINTBEGIN(readability-magic-numbers): points
    static StartingPoints starting_points(const Setting& s) {
        // the wheels alike, and one against the other
        constexpr double kPi = std::numbers::pi;
        StartingPoints from{{},
                            [](const Parameters<double>& at) {
                                const double n = at[1];
                                return std::vector<Parameters<double>>{
                                    {1, n, 0, 0}, {1, n, kPi / 2, 0}, {1, n, 0, kPi}, {1, n, kPi / 2, kPi}};
                            },
                            [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                                const std::complex<double> left{a(0) + a(2), a(1) + a(3)};
                                const std::complex<double> right{a(0) - a(2), a(1) - a(3)};
                                return Parameters<double>{(std::abs(left) + std::abs(right)) / 2, at[1],
                                                          std::arg(left), std::arg(right * std::conj(left))};
                            },
                            any_size,
                            {}};
        // less than two periods are like anything that changes slowly
        constexpr double kLeast_rad = 4 * std::numbers::pi;
        for (int order = 1; order <= kMostOrder; ++order) {
            if (order * s.turned_rad >= kLeast_rad) from.points.push_back({0, double(order), 0});
        }
        return from;
    }
    // NOLINTEND(readability-magic-numbers)
    // Its order is a whole number; its phases count from headings that two programs add up from the same
    // speeds.
    static Uncertainty uncertainty(const UncertaintyOf& of) {
        return {kIntegration, of.parameter >= 2 ? kDirection_rad : 0.0};
    }
};

}  // namespace wheelwright::gap
