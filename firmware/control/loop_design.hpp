// Design of the velocity loops on the plant as it is: integrator, zero-order hold, actuation delay with its
// fraction of a cycle, and the wheel observer.
//
//   P(z) = T z^-m ((1 - f) + f z^-1) / (z - 1),  delay = (m + f) T        torque to speed
//   Q(z) = share of the speed estimate that comes from the measurement; 1 - Q comes from the model
//   L(z) = C P Q / (1 + C P (1 - Q)),  C = Kp + Ki T / (z - 1)            loop broken at the motors
//
// The observer's prediction is part of the controller, so L is what the real plant sees: phase margin and
// Ms = max 1 / |1 + L| are taken from it. With a right model the step response is that of C and P alone.
//
// method delayed_plant: given the weight b, the slow closed-loop pole z1 = 1 - kappa solves
//   kappa = Kp (1 - b) T z1^-m ((1 - f) + f / z1),   and   Ki T = kappa b Kp
// takes it out of the response (velocity_loop.hpp). Kp is the smallest that settles to 1 % within a
// share of the wanted time; the rest is kept for saturation, noise and a wrong model.
// method paper: eq (69)-(72) as printed, weight 1.
//
// The work is cut in steps of less than 1500 instructions, so that a 1 kHz cycle can carry it: about 150
// steps in all. One thread; no allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "firmware/control/velocity_loop.hpp"
#include "firmware/control/velocity_loop_speed.hpp"
#include "firmware/control/wheel_observer.hpp"
#include "firmware/model/robot_parameters.hpp"

namespace wheelwright::control {

enum class DesignStatus : std::uint8_t {
    none,                  // nothing asked yet
    running,               // step() has more to do
    accepted,              // gains() may be used
    refused_settling,      // no gain settles in time with this delay
    refused_phase_margin,  // less than asked for
    refused_sensitivity,   // Ms above the limit
};
inline constexpr std::array<std::string_view, 6> kDesignStatusNames{
    "none", "running", "accepted", "refused_settling", "refused_phase_margin", "refused_sensitivity"};

template <typename Real>
struct LoopDesignRequest {
    model::LoopDesignMethod method = model::LoopDesignMethod::delayed_plant;
    Real settling_time_s{};
    Real damping{};          // method paper
    Real setpoint_weight{};  // method delayed_plant; 0.5 .. 0.98 (clamped)
    Real phase_margin_deg{};
    Real sensitivity_peak{};
    Real cycle_s{};
    Real actuation_delay_s{};
    Real observer_bandwidth_rad_per_s{};
    Real encoder_period_s{};
};

template <typename Real>
LoopDesignRequest<Real> loop_design_request(const model::RobotParameters& from, Real cycle_s) {
    const auto& loop = from.velocity_loop;
    const double delay_s = loop.actuation_delay_s + model::effects_delay_s(from.effects);
    const VelocityLoopSpeed speed = velocity_loop_speed(from, double(cycle_s));
    return {loop.method,
            Real(speed.settling_time_s),
            Real(loop.damping),
            Real(loop.setpoint_weight),
            Real(loop.phase_margin_deg),
            Real(loop.sensitivity_peak),
            cycle_s,
            Real(delay_s),
            Real(speed.observer_bandwidth_rad_per_s),
            Real(from.drive.encoder_period_ms) / 1000};
}

template <typename Real>
struct LoopDesignResult {
    LoopGains<Real> gains;
    Real phase_margin_deg{};
    Real sensitivity_peak{};
    Real crossover_rad_per_s{};
    Real settling_s{};        // to 1 %, nominal plant, not saturated; 0 for method paper
    Real overshoot{};         // share of the step, likewise
    Real observer_delay_s{};  // phase lag that the observer adds at crossover, as a delay
};

template <typename Real>
class LoopDesign {
  public:
    static constexpr Real kSettlingShare = Real(0.66);  // of the wanted time, for the nominal response

    void begin(const LoopDesignRequest<Real>& request) {
        request_ = request;
        result_ = {};
        status_ = DesignStatus::running;
        const Real cycles = request.actuation_delay_s / request.cycle_s;
        const Real whole = std::clamp(std::floor(cycles), Real(0), Real(kMemory - 2));
        delay_cycles_ = static_cast<std::size_t>(whole);
        delay_fraction_ = std::clamp(cycles - whole, Real(0), Real(1));
        observer_ = observer_gains(request.observer_bandwidth_rad_per_s, request.encoder_period_s);
        LoopGains<Real>& g = result_.gains;
        if (request.method == model::LoopDesignMethod::paper) {
            const Real omega_n =
                Real(kTimeConstantsToOnePercent) / (request.damping * request.settling_time_s);
            g.kp_per_s = 2 * request.damping * omega_n;
            g.ki_per_s2 = omega_n * omega_n;
            g.setpoint_weight = 1;
            g.tracking_per_cycle = std::min(g.ki_per_s2 / g.kp_per_s * request.cycle_s, Real(1));
            g.lead_s = 0;
            begin_sweep();
        } else {
            begin_response(Real(kTimeConstantsToOnePercent) / (weight() * request.settling_time_s));
        }
    }

    // Does a bounded piece of the work. True while there is more to do.
    bool step() {
        if (status_ != DesignStatus::running) return false;
        if (stage_ == Stage::response) {
            step_response();
        } else {
            step_sweep();
        }
        return status_ == DesignStatus::running;
    }

    // begin() and all steps at once: some 100 000 instructions. For start-up and tools.
    DesignStatus run(const LoopDesignRequest<Real>& request) {
        begin(request);
        for (int n = 0; n < kMostSteps && step(); ++n) {
        }
        return status_;
    }

    DesignStatus status() const { return status_; }
    bool accepted() const { return status_ == DesignStatus::accepted; }
    // Complete unless none or running; after a refusal, the figures of the refused gains.
    const LoopDesignResult<Real>& result() const { return result_; }

    static constexpr int kMostSteps = 20000;

  private:
    static constexpr std::size_t kMemory = 32;     // cycles of delay the response can hold
    static constexpr int kSamplesPerStep = 24;     // of the response
    static constexpr int kLongestResponse = 1024;  // cycles; slower designs do not feel the delay
    static constexpr int kFrequencies = 120;
    static constexpr Real kLowestFrequency = Real(4);  // rad/s
    enum class Stage : std::uint8_t { response, sweep };

    struct Complex {
        Real re{};
        Real im{};
        friend Complex operator+(Complex a, Complex b) { return {a.re + b.re, a.im + b.im}; }
        friend Complex operator-(Complex a, Complex b) { return {a.re - b.re, a.im - b.im}; }
        friend Complex operator*(Complex a, Complex b) {
            return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
        }
        friend Complex operator*(Real a, Complex b) { return {a * b.re, a * b.im}; }
        friend Complex operator/(Complex a, Complex b) {
            const Real scale = 1 / (b.re * b.re + b.im * b.im);
            return {(a.re * b.re + a.im * b.im) * scale, (a.im * b.re - a.re * b.im) * scale};
        }
        Real size() const { return std::sqrt(re * re + im * im); }
    };

    Real weight() const { return std::clamp(request_.setpoint_weight, Real(0.5), Real(0.98)); }

    // Gains for this Kp, and the start of their response.
    void begin_response(Real kp) {
        const Real b = weight();
        const Real t = request_.cycle_s;
        Real kappa = kp * (1 - b) * t;
        for (int n = 0; n < 8; ++n) {
            const Real z1 = std::max(1 - kappa, Real(0.5));
            Real advance = (1 - delay_fraction_) + delay_fraction_ / z1;
            for (std::size_t i = 0; i < delay_cycles_; ++i) advance /= z1;
            kappa = std::min(kp * (1 - b) * t * advance, Real(0.5));
        }
        LoopGains<Real>& g = result_.gains;
        g.kp_per_s = kp;
        g.ki_per_s2 = kappa * b * kp / t;
        g.setpoint_weight = b;
        g.tracking_per_cycle = kappa;
        g.lead_s = kp * (1 - b) / g.ki_per_s2;
        stage_ = Stage::response;
        sent_ = {};
        at_ = 0;
        speed_ = 0;
        integral_ = 0;
        last_outside_ = 0;
        peak_ = 0;
        samples_ =
            static_cast<int>(std::min(Real(1.5) * request_.settling_time_s / t + 1, Real(kLongestResponse)));
    }

    void step_response() {
        const LoopGains<Real>& g = result_.gains;
        const Real t = request_.cycle_s;
        for (int n = 0; n < kSamplesPerStep && at_ < samples_; ++n, ++at_) {
            if (std::abs(speed_ - 1) > Real(0.01)) last_outside_ = at_;
            peak_ = std::max(peak_, speed_);
            const auto now = static_cast<std::size_t>(at_) % kMemory;
            sent_[now] = g.kp_per_s * (g.setpoint_weight - speed_) + integral_;
            integral_ += t * g.ki_per_s2 * (1 - speed_);
            const Real late = sent_[(now + kMemory - delay_cycles_) % kMemory];
            const Real early = sent_[(now + kMemory - delay_cycles_ - 1) % kMemory];
            speed_ += t * (late + delay_fraction_ * (early - late));
        }
        if (at_ < samples_) return;
        result_.settling_s = static_cast<Real>(last_outside_ + 1) * t;
        result_.overshoot = std::max(peak_ - 1, Real(0));
        const bool quick = result_.settling_s <= kSettlingShare * request_.settling_time_s;
        const bool smooth = result_.overshoot < Real(0.004);
        const bool slow_design = Real(1.5) * request_.settling_time_s / t + 1 > Real(kLongestResponse);
        if ((quick && smooth) || slow_design) {
            begin_sweep();
            return;
        }
        const Real next = g.kp_per_s * Real(1.03);
        if (next * (request_.actuation_delay_s + t / 2) > Real(1)) {
            status_ = DesignStatus::refused_settling;
            return;
        }
        begin_response(next);
    }

    void begin_sweep() {
        stage_ = Stage::sweep;
        at_ = 0;
        frequency_ = kLowestFrequency;
        const Real highest = Real(3.1) / request_.cycle_s;
        ratio_ = std::exp(std::log(highest / kLowestFrequency) / (kFrequencies - 1));
        result_.phase_margin_deg = 180;
        result_.sensitivity_peak = 1;
        last_size_ = 0;
    }

    // Share of the speed estimate that comes from the measured position, for z = e^(jwT); zi = 1/z. The
    // filter of wheel_observer.hpp, its samples one cycle old (the worst phase).
    Complex observer(Complex zi) const {
        const Real t = request_.cycle_s;
        const Real age = t;
        const Complex one{1, 0};
        const Complex sum = one / (one - zi);
        // states after the correction, per unit innovation
        const Complex error = observer_.error_per_s2 * sum;
        const Complex speed = (t * (zi * error) + Complex{observer_.speed_per_s, 0}) * sum;
        const Complex angle =
            (t * (zi * speed) + (t * t / 2) * (zi * error) + Complex{observer_.angle, 0}) * sum;
        // what the filter expected of the sample, per unit innovation
        const Complex expected = zi * (angle + t * speed + (t * t / 2) * error) -
                                 age * (zi * (speed + t * error)) + (age * age / 2) * (zi * error);
        // sampled position per unit speed
        const Complex sample =
            (t / 2) * ((one + zi) * sum) - Complex{age, 0} + (age * age / (2 * t)) * (one - zi);
        return speed * sample / (one + expected);
    }

    void step_sweep() {
        const Real t = request_.cycle_s;
        const Real wt = frequency_ * t;
        const Complex one{1, 0};
        const Complex zi{std::cos(wt), -std::sin(wt)};
        const Real lag = wt * static_cast<Real>(delay_cycles_ + 1);
        const Complex delay{std::cos(lag), -std::sin(lag)};
        const Complex between = (1 - delay_fraction_) * one + delay_fraction_ * zi;
        const Complex plant = t * (delay * between / (one - zi));  // z^-m / (z - 1) = z^-(m+1) / (1 - 1/z)
        const LoopGains<Real>& g = result_.gains;
        const Complex controller = g.kp_per_s * one + (g.ki_per_s2 * t) * (zi / (one - zi));
        const Complex open = controller * plant;
        const Complex q = observer(zi);
        const Complex loop = open * q / (one + open * (one - q));
        const Real size = loop.size();
        const Complex back = one + loop;
        result_.sensitivity_peak = std::max(result_.sensitivity_peak, 1 / back.size());
        // A positive phase margin is the angle above -180 degrees; taken where |L| falls below 1.
        const Real phase = std::atan2(-loop.im, -loop.re);  // of -L: 0 at the critical point
        if (at_ > 0 && last_size_ > 1 && size <= 1) {
            const Real share = (last_size_ - 1) / (last_size_ - size);
            const Real crossing = last_phase_ + share * wrap_angle_rad(phase - last_phase_);
            const Real margin_deg = crossing * Real(57.29577951308232);  // negative: unstable
            if (margin_deg < result_.phase_margin_deg) {
                result_.phase_margin_deg = margin_deg;
                result_.crossover_rad_per_s = frequency_;
                const Complex ideal = loop / open;
                result_.observer_delay_s = -std::atan2(ideal.im, ideal.re) / frequency_;
            }
        }
        last_size_ = size;
        last_phase_ = phase;
        frequency_ *= ratio_;
        if (++at_ < kFrequencies) return;
        if (result_.phase_margin_deg < request_.phase_margin_deg) {
            status_ = DesignStatus::refused_phase_margin;
        } else if (result_.sensitivity_peak > request_.sensitivity_peak) {
            status_ = DesignStatus::refused_sensitivity;
        } else {
            status_ = DesignStatus::accepted;
        }
    }

    LoopDesignRequest<Real> request_;
    LoopDesignResult<Real> result_;
    DesignStatus status_ = DesignStatus::none;
    Stage stage_ = Stage::response;
    std::size_t delay_cycles_ = 0;
    Real delay_fraction_{};
    ObserverGains<Real> observer_;
    std::array<Real, kMemory> sent_{};
    int at_ = 0;
    int samples_ = 0;
    int last_outside_ = 0;
    Real speed_{};
    Real integral_{};
    Real peak_{};
    Real frequency_{};
    Real ratio_{};
    Real last_size_{};
    Real last_phase_{};
};

}  // namespace wheelwright::control
