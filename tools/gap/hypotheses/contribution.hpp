// What an effect of the catalogue does along a measured log: the wheel torque that would do the same to the
// measured speeds.
#pragma once

#include <cmath>
#include <cstddef>
#include <memory>

#include "firmware/model/effects.hpp"

namespace wheelwright::gap {

using model::Parameters;

// One sample's interval of a log.
struct Interval {
    double t_s = 0, dt_s = 0, span_s = 0;     // since the log's start; the log's length
    WheelPair<double> torque, torque_before;  // held over this interval and the one before
    WheelPair<double> before, after;          // wheel speeds at its ends
    WheelPair<double> angle;                  // at its middle, from the log's start
    double heading_rad = 0;                   // at its middle

    WheelPair<double> speed() const {
        return {(before.left + after.left) / 2, (before.right + after.right) / 2};
    }
};

inline double sign_of(double x) { return x > 0 ? 1.0 : x < 0 ? -1.0 : 0.0; }

// Mean sign of a speed that goes straight from a to b; less of one where it is below `least`.
inline double mean_sign(double a, double b, double least = 0) {
    const double size = std::abs(a) + std::abs(b) + 2 * least;
    return size > 0 ? (a + b) / size : 0.0;
}

// Of the catalogue; what the sensors say of it is known before the rows are looked at.
inline constexpr std::size_t kMeasurementLag = model::find_effect(model::MeasurementLag::info.name);

// What a wheel's own friction takes of its torque: of both wheels, the mean.
struct WheelFriction {
    double dry_Nm = 0, viscous_Nm_s_per_rad = 0;

    // What it leaves of a torque, over a speed that goes straight from one to the other.
    WheelPair<double> leaves_Nm(const WheelPair<double>& torque, const WheelPair<double>& before,
                                const WheelPair<double>& after) const {
        const auto taken = [&](double from, double to) {
            return dry_Nm * mean_sign(from, to) + viscous_Nm_s_per_rad * (from + to) / 2;
        };
        return {torque.left - taken(before.left, after.left),
                torque.right - taken(before.right, after.right)};
    }
};

struct Setting {
    model::Geometry<double> geometry;
    model::Dynamics<double> dynamics;
    WheelFriction friction;
    double peak_torque_Nm = 1, peak_speed_rad_per_s = 1;
    double span_s = 60, period_s = 0.001;
    double turned_rad = 1e9;     // from the least to the greatest angle of a wheel
    int refinements = 0;         // so far, with this one
    double event_spacing_s = 0;  // between times at which an event is tried in a closer evaluation

    double effective_mass_kg() const { return 1 / (dynamics.k7_per_kg_m * geometry.mean_radius_m()); }
    double effective_inertia_kg_m2() const {
        return geometry.track_m / (2 * geometry.mean_radius_m() * dynamics.k8_per_kg_m2);
    }
};

// The wheel torque that an effect adds, interval by interval from a log's start. Whatever an effect changes
// is expressed as the torque that would do the same to the measured speeds.
class Contribution {
  public:
    virtual ~Contribution() = default;
    virtual WheelPair<double> over(const Interval& interval) = 0;
    // What both need is computed once; both are then given the same intervals.
    virtual void share(const Contribution& /*other*/) {}
    // Changes so slowly, or so nearly in proportion to the motion, that short intervals may be put together
    // before.
    virtual bool slow() const { return false; }
};

inline WheelPair<double> pair_of(double sum, double difference) {
    return {(sum - difference) / 2, (sum + difference) / 2};
}

// The pair of wheel torques that changes forward speed and yaw rate by so much over an interval.
inline WheelPair<double> pair_for(const Setting& s, double forward_m_per_s, double turning_rad_per_s,
                                  double dt_s) {
    return pair_of(forward_m_per_s / (s.dynamics.k7_per_kg_m * dt_s),
                   turning_rad_per_s / (s.dynamics.k8_per_kg_m2 * dt_s));
}

inline Twist<double> change(const model::Geometry<double>& g, const Interval& i) {
    return model::twist_from_wheel_speeds(
        g, WheelPair<double>{i.after.left - i.before.left, i.after.right - i.before.right});
}

}  // namespace wheelwright::gap
