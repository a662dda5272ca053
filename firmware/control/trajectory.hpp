// Reference paths as functions of time: where the robot shall be, how fast, and how that changes. Pure; about
// 470 instructions (figure-8); defined for every time, so the reference point *at that time* has one meaning
// for controller and judge.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "firmware/control/reference.hpp"
#include "firmware/model/dynamics.hpp"
#include "firmware/model/robot_parameters.hpp"

namespace wheelwright::control {

enum class PathKind : std::uint8_t {
    figure_eight,  // Gerono's lemniscate, as Fig. 20: x = length/2 sin p, y = width/2 sin 2p, p = 2 pi t /
                   // period
    line,          // length_m forward along x in period_s, then at rest (the end is as smooth as the start)
    circle,        // to the left with diameter length_m (to the right if negative), a lap in period_s
    spin,          // in place, one turn in period_s (counter-clockwise; negative length_m: clockwise)
};

template <typename Real>
struct PathSettings {
    PathKind kind = PathKind::figure_eight;
    Real length_m{};
    Real width_m{};   // figure_eight only
    Real period_s{};  // > 0
    Real ramp_s{};    // the path's own time starts smoothly over this time; 0: at full speed at once.
                    // During the ramp the path runs at half its mean pace: afterwards it is ramp_s / 2 late.
    Pose<Real> origin;  // where the path's frame lies
};

template <typename Real>
PathSettings<Real> standard_figure_eight(const model::RobotParameters& from) {
    PathSettings<Real> to;
    to.length_m = Real(from.trajectory.length_m);
    to.width_m = Real(from.trajectory.width_m);
    to.period_s = Real(from.trajectory.period_s);
    return to;
}

namespace detail {
// Whole part of a number that is not negative.
template <typename Real>
Real whole(Real number) {
    return static_cast<Real>(static_cast<std::int64_t>(number));
}
}  // namespace detail

// The reference at time_s since the path's start; before the start, its beginning at rest.
template <typename Real>
ReferencePoint<Real> path_point(const PathSettings<Real>& path, Real time_s) {
    constexpr Real two_pi = Real(6.283185307179586476925286766559);
    // Path time s(t) with rates s1, s2: a half cosine from rest to the pace of the clock. A line ends as it
    // begins, its second half is the first one backwards.
    const Real ramp_s = path.kind == PathKind::line ? std::min(path.ramp_s, path.period_s) : path.ramp_s;
    const Real whole_line_s = path.period_s + ramp_s;
    const bool from_end = path.kind == PathKind::line && time_s > whole_line_s / 2;
    const Real since_s = from_end ? whole_line_s - time_s : time_s;
    Real s = std::max(since_s, Real(0));
    Real s1 = since_s < 0 ? Real(0) : Real(1);
    Real s2 = 0;
    if (ramp_s > 0) {
        if (s < ramp_s) {
            const Real w = two_pi / (2 * ramp_s);
            const Real sine = std::sin(w * s);
            if (since_s >= 0) {
                s1 = (1 - std::cos(w * s)) / 2;
                s2 = w * sine / 2;
            }
            s = s / 2 - sine / (2 * w);
        } else {
            s -= ramp_s / 2;
        }
    }
    if (from_end) {
        s = path.period_s - s;
        s2 = -s2;
    }
    ReferencePoint<Real> local;
    switch (path.kind) {
        case PathKind::figure_eight: {
            const Real laps = s / path.period_s;
            const Real pace = two_pi / path.period_s;
            const Real p = two_pi * (laps - detail::whole(laps));
            const Real a = path.length_m / 2;
            const Real b = path.width_m / 2;
            const Real sp = std::sin(p);
            const Real cp = std::cos(p);
            const Real s2p = 2 * sp * cp;
            const Real c2p = 1 - 2 * sp * sp;
            // derivatives by p, then by time
            const Real x1 = a * cp, x2 = -a * sp, x3 = -a * cp;
            const Real y1 = 2 * b * c2p, y2 = -4 * b * s2p, y3 = -8 * b * c2p;
            const Real p1 = pace * s1, p2 = pace * s2;
            const Real way2 = x1 * x1 + y1 * y1;  // never zero: cos p and cos 2p have no common zero
            const Real way = std::sqrt(way2);
            const Real per = 1 / way2;
            const Real turn = (x1 * y2 - y1 * x2) * per;  // heading by p
            const Real stretch = (x1 * x2 + y1 * y2) * per;
            const Real turn2 = (x1 * y3 - y1 * x3) * per - 2 * turn * stretch;
            local.pose = {a * sp, b * s2p, std::atan2(y1, x1)};
            local.twist = {way * p1, turn * p1};
            local.rate = {way * (stretch * p1 * p1 + p2), turn2 * p1 * p1 + turn * p2};
            break;
        }
        case PathKind::line: {
            const Real speed = path.length_m / path.period_s;
            local.pose = {speed * s, 0, 0};
            local.twist = {speed * s1, 0};
            local.rate = {speed * s2, 0};
            break;
        }
        case PathKind::circle: {
            const Real radius = std::abs(path.length_m) / 2;
            const Real side = std::copysign(Real(1), path.length_m);
            const Real pace = two_pi / path.period_s;
            const Real laps = s / path.period_s;
            const Real p = two_pi * (laps - detail::whole(laps));
            local.pose = {radius * std::sin(p), side * radius * (1 - std::cos(p)), side * p};
            local.twist = {radius * pace * s1, side * pace * s1};
            local.rate = {radius * pace * s2, side * pace * s2};
            break;
        }
        case PathKind::spin: {
            const Real side = std::copysign(Real(1), path.length_m);
            const Real pace = two_pi / path.period_s;
            const Real laps = s / path.period_s;
            local.pose = {0, 0, side * two_pi * (laps - detail::whole(laps))};
            local.twist = {0, side * pace * s1};
            local.rate = {0, side * pace * s2};
            break;
        }
    }
    if (path.origin.heading_rad == 0) {  // mostly
        local.pose.x_m += path.origin.x_m;
        local.pose.y_m += path.origin.y_m;
        local.pose.heading_rad = wrap_angle_rad(local.pose.heading_rad);
        return local;
    }
    const Real c = std::cos(path.origin.heading_rad);
    const Real n = std::sin(path.origin.heading_rad);
    return {{path.origin.x_m + c * local.pose.x_m - n * local.pose.y_m,
             path.origin.y_m + n * local.pose.x_m + c * local.pose.y_m,
             wrap_angle_rad(path.origin.heading_rad + local.pose.heading_rad)},
            local.twist,
            local.rate};
}

// A reference that somebody streams: pose with velocities, at some cycle time. Between two samples it moves
// on along an arc with the sample's velocities and their last known trend; a new sample does not make it
// jump, for the difference fades over one interval. It never runs on for more than 1.5 intervals: then it
// stands (and the supervisor's time-out stops the robot).
template <typename Real>
class StreamedReference {
  public:
    void reset() { count_ = 0; }

    // A sample that is valid at time_ns. Times must increase; others are ignored.
    void push(const Pose<Real>& pose, const Twist<Real>& twist, std::int64_t time_ns) {
        if (count_ > 0 && time_ns <= time_ns_) return;
        TwistRate<Real> trend{};
        Pose<Real> off{};
        if (count_ > 0) {
            interval_s_ = std::clamp(seconds(time_ns - time_ns_), Real(0.001), Real(0.5));
            trend = {(twist.v_m_per_s - twist_.v_m_per_s) / interval_s_,
                     (twist.omega_rad_per_s - twist_.omega_rad_per_s) / interval_s_};
            const ReferencePoint<Real> expected = at(time_ns);
            off = {expected.pose.x_m - pose.x_m, expected.pose.y_m - pose.y_m,
                   wrap_angle_rad(expected.pose.heading_rad - pose.heading_rad)};
            if (off.x_m * off.x_m + off.y_m * off.y_m > Real(0.01) || std::abs(off.heading_rad) > Real(0.3)) {
                off = {};  // a leap that is meant
                trend = {};
            }
        }
        pose_ = pose;
        twist_ = twist;
        trend_ = trend;
        off_ = off;
        time_ns_ = time_ns;
        count_ = std::min(count_ + 1, 2);
    }

    bool valid() const { return count_ > 0; }

    ReferencePoint<Real> at(std::int64_t now_ns) const {
        const Real reach = Real(1.5) * interval_s_;
        const Real t = std::clamp(seconds(now_ns - time_ns_), Real(0), reach);
        const bool stands = seconds(now_ns - time_ns_) > reach;
        ReferencePoint<Real> out;
        out.pose = model::advance_along_arc(pose_, t * (twist_.v_m_per_s + trend_.v_m_per_s2 * t / 2),
                                            t * (twist_.omega_rad_per_s + trend_.omega_rad_per_s2 * t / 2));
        const Real left = interval_s_ > 0 ? std::max(1 - t / interval_s_, Real(0)) : Real(0);
        out.pose.x_m += left * off_.x_m;
        out.pose.y_m += left * off_.y_m;
        out.pose.heading_rad = wrap_angle_rad(out.pose.heading_rad + left * off_.heading_rad);
        if (!stands) {
            out.twist = {twist_.v_m_per_s + trend_.v_m_per_s2 * t,
                         twist_.omega_rad_per_s + trend_.omega_rad_per_s2 * t};
            out.rate = trend_;
        }
        return out;
    }

  private:
    static Real seconds(std::int64_t ns) { return Real(1e-9) * static_cast<Real>(ns); }

    Pose<Real> pose_;
    Twist<Real> twist_;
    TwistRate<Real> trend_;
    Pose<Real> off_;
    std::int64_t time_ns_ = 0;
    Real interval_s_ = Real(0.1);  // until two samples are known
    int count_ = 0;
};

}  // namespace wheelwright::control
