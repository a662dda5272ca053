// What the tyres of a robot with the effect wheel_slip slip under a log's torques.
#pragma once

#include <algorithm>

#include "firmware/model/effects.hpp"

namespace wheelwright::gap {

// Of both wheels: their mean slip, and the right one's less the left one's.
class TyreSlip {
  public:
    using Parameters = model::Parameters<double>;
    using Settling = model::WheelSlip::Settling<double>;

    TyreSlip(const Parameters& p, const model::Geometry<double>& geometry,
             const model::Dynamics<double>& dynamics, double rotation_share = model::kRotationShare)
        : geometry_(geometry),
          most_N_(p[0] * model::WheelSlip::load_N(geometry, dynamics)),
          mean_(model::WheelSlip::forward(p, geometry, dynamics, rotation_share)),
          difference_(model::WheelSlip::turning(p, geometry, dynamics, rotation_share)) {}

    // Holds this torque for `dt_s`. At first the slip is taken to have settled under it.
    void advance(const WheelPair<double>& torque_Nm, double dt_s) {
        const double left = force_N(torque_Nm.left, geometry_.wheel_radius_m.left);
        const double right = force_N(torque_Nm.right, geometry_.wheel_radius_m.right);
        const double mean = mean_.slip_per_force * (left + right) / 2;
        const double difference = difference_.slip_per_force * (right - left);
        if (first_) {
            mean_m_per_s_ = mean;
            difference_m_per_s_ = difference;
            first_ = false;
        }
        if (dt_s != dt_s_) {
            dt_s_ = dt_s;
            share_of_mean_ = mean_.share_of(dt_s);
            share_of_difference_ = difference_.share_of(dt_s);
        }
        mean_m_per_s_ += share_of_mean_ * (mean - mean_m_per_s_);
        difference_m_per_s_ += share_of_difference_ * (difference - difference_m_per_s_);
    }

    double mean_m_per_s() const { return mean_m_per_s_; }
    double difference_m_per_s() const { return difference_m_per_s_; }
    const Settling& of_mean() const { return mean_; }
    const Settling& of_difference() const { return difference_; }

  private:
    double force_N(double torque_Nm, double radius_m) const {
        return std::clamp(torque_Nm / radius_m, -most_N_, most_N_);
    }

    model::Geometry<double> geometry_;
    double most_N_;
    Settling mean_, difference_;
    double mean_m_per_s_ = 0, difference_m_per_s_ = 0;
    double dt_s_ = 0, share_of_mean_ = 0, share_of_difference_ = 0;
    bool first_ = true;
};

}  // namespace wheelwright::gap
