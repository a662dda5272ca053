// Which motor is left and which way is forward: the wheels' own encoders cannot tell, for each drive turns
// torque and encoder together. External poses can. They are averaged while the robot stands, before and after
// a motion that by the wheels was straight, and one that by the wheels was a turn.
//
// About 20 operations a pose; judge() about 100. No allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/types.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"

namespace wheelwright::ident {

class SideWitness {
  public:
    // A motion of the robot between two halts.
    struct Way {
        double forward_m, turn_rad;
    };

    void start(const model::Geometry<double>& geometry, double pose_noise_m, double heading_noise_rad) {
        *this = SideWitness{};
        geometry_ = geometry;
        pose_noise_m_ = pose_noise_m;
        heading_noise_rad_ = heading_noise_rad;
    }

    void add(const Pose<double>& pose) {
        // whole turns count: a wheel that goes backwards makes them of a way straight on
        heading_rad_ += wrap_angle_rad(pose.heading_rad - heading_rad_);
        sum_.x_m += pose.x_m;
        sum_.y_m += pose.y_m;
        sum_.heading_rad += heading_rad_;
        ++count_;
    }
    // The robot has moved: what came before is of another place.
    void forget() {
        sum_ = {};
        count_ = 0;
    }
    // The robot stands: before the straight motion (0), between the two (1), after the turn (2).
    void halt(std::size_t at, const WheelPair<double>& angle_rad) {
        Halt& halt = halts_[at];
        halt.poses = count_;
        halt.angle_rad = angle_rad;
        if (count_ > 0) {
            const double n = count_;
            halt.pose = {sum_.x_m / n, sum_.y_m / n, sum_.heading_rad / n};
        }
        forget();
    }

    // What the wheels say.
    Way rolled(const WheelPair<double>& from_rad, const WheelPair<double>& to_rad) const {
        const Twist<double> way = model::twist_from_wheel_speeds(
            geometry_, WheelPair<double>{to_rad.left - from_rad.left, to_rad.right - from_rad.right});
        return {way.v_m_per_s, way.omega_rad_per_s};
    }
    // Whether a straight way, or a turn, stands out of the poses' noise; true where there are none.
    bool would_tell(const Way& way, bool turning) const {
        if (halts_[0].poses == 0) return true;
        const double least = kTells / std::sqrt(static_cast<double>(halts_[0].poses));
        return turning ? std::abs(way.turn_rad) > least * heading_noise_rad_
                       : std::abs(way.forward_m) > least * pose_noise_m_;
    }

    // What is wrong; none where nothing is, or nothing can be told. confirmed() says which. Each mistake, and
    // none, says where the wheels led the robot: the one that is nearest to the poses, and clearly.
    protocol::IdentCause judge() {
        using protocol::IdentCause;
        const std::uint32_t fewest = std::min({halts_[0].poses, halts_[1].poses, halts_[2].poses});
        if (fewest == 0) return IdentCause::none;
        constexpr std::array kMistakes{IdentCause::none, IdentCause::left_sign_wrong,
                                       IdentCause::right_sign_wrong, IdentCause::both_signs_wrong,
                                       IdentCause::wheels_swapped};
        IdentCause nearest = IdentCause::none;
        double least = 1e300, next = 1e300;
        for (const IdentCause mistake : kMistakes) {
            const double off = off_by(mistake, fewest, 0) + off_by(mistake, fewest, 1);
            next = std::min(next, std::max(off, least));
            if (off < least) {
                least = off;
                nearest = mistake;
            }
        }
        const bool sure = next - least > kSure * kSure;
        confirmed_ = sure && nearest == IdentCause::none;
        return sure ? nearest : IdentCause::none;
    }
    // There have been some before the straight motion.
    bool poses_come() const { return halts_[0].poses > 0; }
    bool confirmed() const { return confirmed_; }

    // By the poses a wheel's rim (0 left, 1 right) has gone, straight on and in the turn, as far as its
    // encoder says: it rolls on the floor. One in the air turns faster than the other, and backwards in the
    // turn. False tells nothing.
    bool rolls(std::size_t wheel) const {
        const double side_m = (wheel == 0 ? -1 : 1) * geometry_.track_m / 2;
        const auto rim_m = [&](const Halt& halt) {
            return wheel == 0 ? geometry_.wheel_radius_m.left * halt.angle_rad.left
                              : geometry_.wheel_radius_m.right * halt.angle_rad.right;
        };
        for (const std::size_t from : {0, 1}) {
            const Halt &a = halts_[from], &b = halts_[from + 1];
            if (std::min(a.poses, b.poses) == 0) return false;
            const Way way = seen(from);
            const double rolled_m = rim_m(b) - rim_m(a);
            const double sigma_m = std::sqrt(1.0 / a.poses + 1.0 / b.poses) *
                                   std::hypot(Real(pose_noise_m_), Real(side_m * heading_noise_rad_));
            const double off_m = std::abs(way.forward_m + side_m * way.turn_rad - rolled_m);
            if (!(off_m + kClear * sigma_m < kMostSlip * std::abs(rolled_m))) return false;
        }
        return true;
    }

  private:
    static constexpr double kSure = 6;  // standard deviations: once in a hundred million runs by chance
    static constexpr double kTells =
        20;  // so many of an averaged pose's: twice kSure, and three tenths for slip
    static constexpr double kClear = 3;
    static constexpr double kMostSlip = 0.3;  // less than a third of what a wheel in the air turns too far
    static constexpr double kSlips = 0.1;     // of a rim's way: standard deviation

    struct Halt {
        Pose<double> pose;
        WheelPair<double> angle_rad;
        std::uint32_t poses = 0;
    };

    // Squared standard deviations between what a motion was and what it would have been with this mistake.
    double off_by(protocol::IdentCause mistake, std::uint32_t poses, std::size_t from) const {
        using enum protocol::IdentCause;
        const Halt &a = halts_[from], &b = halts_[from + 1];
        WheelPair<double> went_rad{b.angle_rad.left - a.angle_rad.left,
                                   b.angle_rad.right - a.angle_rad.right};
        if (mistake == left_sign_wrong || mistake == both_signs_wrong) went_rad.left = -went_rad.left;
        if (mistake == right_sign_wrong || mistake == both_signs_wrong) went_rad.right = -went_rad.right;
        if (mistake == wheels_swapped) std::swap(went_rad.left, went_rad.right);
        const Way would_be = rolled({}, went_rad), was = seen(from);
        const double slip_m =
            kSlips * geometry_.mean_radius_m() * std::max(std::abs(went_rad.left), std::abs(went_rad.right));
        const double slip_rad = slip_m / (geometry_.track_m / 2);
        const double shrink = 2.0 / poses;
        const double forward_m = would_be.forward_m - was.forward_m;
        const double turn_rad = would_be.turn_rad - was.turn_rad;
        return forward_m * forward_m / (shrink * pose_noise_m_ * pose_noise_m_ + slip_m * slip_m) +
               turn_rad * turn_rad / (shrink * heading_noise_rad_ * heading_noise_rad_ + slip_rad * slip_rad);
    }
    Way seen(std::size_t from) const {
        const Pose<double>& a = halts_[from].pose;
        const Pose<double>& b = halts_[from + 1].pose;
        const double turn = b.heading_rad - a.heading_rad;
        const double along = a.heading_rad + turn / 2;
        return {(b.x_m - a.x_m) * std::cos(Real(along)) + (b.y_m - a.y_m) * std::sin(Real(along)), turn};
    }

    model::Geometry<double> geometry_;
    double pose_noise_m_ = 0, heading_noise_rad_ = 0;
    Pose<double> sum_;
    double heading_rad_ = 0;  // with whole turns
    std::uint32_t count_ = 0;
    std::array<Halt, 3> halts_{};
    bool confirmed_ = false;
};

}  // namespace wheelwright::ident
