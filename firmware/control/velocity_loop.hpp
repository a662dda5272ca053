// The two velocity loops of Fig. 18 with two degrees of freedom, for speed and yaw rate, on the plant that
// feedback linearisation has made an integrator:
//
//   r'     = r + lead * rate                              feed-forward: no lag behind a ramp
//   nu     = Kp (b r' - y) + I                            kept within what the torque can reach
//   I     += T Ki (r' - y) - kappa (nu - nu_applied)      back-calculation on the applied torque
//
// loop_design.hpp chooses b and kappa so that the slow pole, which an integrator brings, is driven neither by
// the reference nor by saturation: b Kp kappa = T Ki. So there is no overshoot to wait for.
//
// One object per robot; one thread; no allocation. update(): about 230 instructions.
#pragma once

#include "firmware/control/feedback_linearisation.hpp"
#include "firmware/control/limits.hpp"
#include "firmware/control/reference.hpp"

namespace wheelwright::control {

template <typename Real>
struct LoopGains {
    Real kp_per_s{};
    Real ki_per_s2{};
    Real setpoint_weight = 1;   // b, share of the reference in the proportional term
    Real tracking_per_cycle{};  // kappa, back-calculation
    Real lead_s{};              // feed-forward of the reference's rate
};

template <typename Real>
struct VelocityLoopSettings {
    LoopGains<Real> gains;  // both axes: after linearisation they are the same plant
    Real torque_limit_Nm{};
    Real cycle_s{};
};

template <typename Real>
class VelocityLoop {
  public:
    // Takes new settings; while running the torque does not jump, for the integrators absorb the change.
    void configure(const VelocityLoopSettings<Real>& settings) {
        const LoopGains<Real>& old = settings_.gains;
        const LoopGains<Real>& next = settings.gains;
        if (running_) {
            integral_.v_m_per_s2 +=
                proportional(old, last_.twist.v_m_per_s, last_.rate.v_m_per_s2, last_speed_.v_m_per_s) -
                proportional(next, last_.twist.v_m_per_s, last_.rate.v_m_per_s2, last_speed_.v_m_per_s);
            integral_.omega_rad_per_s2 +=
                proportional(old, last_.twist.omega_rad_per_s, last_.rate.omega_rad_per_s2,
                             last_speed_.omega_rad_per_s) -
                proportional(next, last_.twist.omega_rad_per_s, last_.rate.omega_rad_per_s2,
                             last_speed_.omega_rad_per_s);
        }
        settings_ = settings;
    }

    // Starts from the torque now at the wheels, without a bump: with the reference at the present speed (zero
    // at rest) the first update returns this torque. Move the reference away from there by a rate limiter, or
    // step it. At rest, noise of the measured speed counts as rest.
    void start(const PlantModel<Real>& plant, const model::Motion<Real>& measured,
               const WheelPair<Real>& torque_Nm) {
        const TwistRate<Real> nu = linearised_acceleration(plant, measured, Twist<Real>{}, torque_Nm);
        const LoopGains<Real>& g = settings_.gains;
        integral_.v_m_per_s2 =
            nu.v_m_per_s2 - proportional(g, measured.twist.v_m_per_s, Real(0), measured.twist.v_m_per_s);
        integral_.omega_rad_per_s2 =
            nu.omega_rad_per_s2 -
            proportional(g, measured.twist.omega_rad_per_s, Real(0), measured.twist.omega_rad_per_s);
        last_ = {measured.twist, {}};
        last_speed_ = measured.twist;
        last_torque_ = torque_Nm;
        running_ = true;
    }

    void stop() {
        running_ = false;
        integral_ = {};
        last_torque_ = {};
        flags_ = {};
    }

    // The wheel torques for this cycle, within the limit. flags() names what limited them.
    WheelPair<Real> update(const PlantModel<Real>& plant, const model::Motion<Real>& measured,
                           const VelocityReference<Real>& reference) {
        const LoopGains<Real>& g = settings_.gains;
        const Twist<Real>& y = measured.twist;
        const Twist<Real> led{reference.twist.v_m_per_s + g.lead_s * reference.rate.v_m_per_s2,
                              reference.twist.omega_rad_per_s + g.lead_s * reference.rate.omega_rad_per_s2};
        const TwistRate<Real> nu{
            g.kp_per_s * (g.setpoint_weight * led.v_m_per_s - y.v_m_per_s) + integral_.v_m_per_s2,
            g.kp_per_s * (g.setpoint_weight * led.omega_rad_per_s - y.omega_rad_per_s) +
                integral_.omega_rad_per_s2};
        const WheelPair<Real> wanted = linearising_torque_Nm(plant, measured, reference.twist, nu);
        flags_ = {};
        const bool within = within_limit(wanted, settings_.torque_limit_Nm);
        const Real ki_t = g.ki_per_s2 * settings_.cycle_s;
        integral_.v_m_per_s2 += ki_t * (led.v_m_per_s - y.v_m_per_s);
        integral_.omega_rad_per_s2 += ki_t * (led.omega_rad_per_s - y.omega_rad_per_s);
        const WheelPair<Real> torque = within ? wanted : limited(plant, measured, reference.twist, nu);
        last_ = reference;
        last_speed_ = y;
        last_torque_ = torque;
        running_ = true;
        return torque;
    }

    // Tells that another torque than update()'s was sent; call it in the same cycle. The integrators follow.
    void applied(const PlantModel<Real>& plant, const WheelPair<Real>& torque_Nm) {
        track(plant, last_torque_, torque_Nm);
        last_torque_ = torque_Nm;
    }

    // change(plant) changes the plant's model; the torque of the last update would be the same again. Call
    // between updates, with the motion of the last one.
    template <typename Change>
    void change_model(PlantModel<Real>& plant, const model::Motion<Real>& measured, Change&& change) {
        if (!running_) {
            change(plant);
            return;
        }
        const TwistRate<Real> was = linearised_acceleration(plant, measured, last_.twist, last_torque_);
        change(plant);
        const TwistRate<Real> is = linearised_acceleration(plant, measured, last_.twist, last_torque_);
        integral_.v_m_per_s2 += is.v_m_per_s2 - was.v_m_per_s2;
        integral_.omega_rad_per_s2 += is.omega_rad_per_s2 - was.omega_rad_per_s2;
    }

    bool running() const { return running_; }
    LimiterFlags flags() const { return flags_; }
    const TwistRate<Real>& integral() const { return integral_; }
    const VelocityLoopSettings<Real>& settings() const { return settings_; }

  private:
    static Real proportional(const LoopGains<Real>& g, Real reference, Real rate, Real y) {
        return g.kp_per_s * (g.setpoint_weight * (reference + g.lead_s * rate) - y);
    }

    // Whatever torque a robot needs to keep its speed, twice the whole of its torque away from there it is at
    // the limit. What is asked beyond that does nothing, but where the two axes push each other, or the
    // drives' gains differ, it would be taken for a push that never comes, and turn the robot.
    [[gnu::noinline]] WheelPair<Real> limited(const PlantModel<Real>& plant,
                                              const model::Motion<Real>& measured,
                                              const Twist<Real>& reference, const TwistRate<Real>& asked) {
        const Real most_Nm = 2 * 2 * settings_.torque_limit_Nm;
        const Real most_m_per_s2 = plant.dynamics.k7_per_kg_m * most_Nm;
        const Real most_rad_per_s2 = plant.dynamics.k8_per_kg_m2 * most_Nm;
        const TwistRate<Real> nu{std::clamp(asked.v_m_per_s2, -most_m_per_s2, most_m_per_s2),
                                 std::clamp(asked.omega_rad_per_s2, -most_rad_per_s2, most_rad_per_s2)};
        const WheelPair<Real> wanted = linearising_torque_Nm(plant, measured, reference, nu);
        const WheelPair<Real> steady = linearising_torque_Nm(plant, measured, reference, TwistRate<Real>{});
        const auto holds = [](Real torque, Real speed) { return torque * speed < 0 ? torque : Real(0); };
        const Real s = holds(steady.sum(), measured.twist.v_m_per_s);
        const Real d = holds(steady.difference(), measured.twist.omega_rad_per_s);
        const WheelPair<Real> holding{(s - d) / 2, (s + d) / 2};
        const WheelPair<Real> torque = limit_torque(wanted, holding, settings_.torque_limit_Nm, flags_);
        lose({asked.v_m_per_s2 - nu.v_m_per_s2, asked.omega_rad_per_s2 - nu.omega_rad_per_s2});
        track(plant, wanted, torque);
        return torque;
    }

    void track(const PlantModel<Real>& plant, const WheelPair<Real>& wanted, const WheelPair<Real>& given) {
        lose(coupled_acceleration<Real>(
            plant, {plant.dynamics.k7_per_kg_m * (wanted.sum() - given.sum()),
                    plant.dynamics.k8_per_kg_m2 * (wanted.difference() - given.difference())}));
    }

    void lose(const TwistRate<Real>& not_applied) {
        const Real kappa = settings_.gains.tracking_per_cycle;
        integral_.v_m_per_s2 -= kappa * not_applied.v_m_per_s2;
        integral_.omega_rad_per_s2 -= kappa * not_applied.omega_rad_per_s2;
    }

    VelocityLoopSettings<Real> settings_;
    TwistRate<Real> integral_;
    VelocityReference<Real> last_;
    Twist<Real> last_speed_;
    WheelPair<Real> last_torque_;
    LimiterFlags flags_;
    bool running_ = false;
};

}  // namespace wheelwright::control
