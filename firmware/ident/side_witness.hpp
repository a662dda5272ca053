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

    // What is wrong; none where nothing is, or nothing can be told. confirmed() says which.
    protocol::IdentCause judge() {
        using protocol::IdentCause;
        const std::uint32_t fewest = std::min({halts_[0].poses, halts_[1].poses, halts_[2].poses});
        if (fewest == 0) return IdentCause::none;
        const double shrink = std::sqrt(2.0 / fewest);
        const double sigma_m = pose_noise_m_ * shrink;
        const double sigma_rad = heading_noise_rad_ * shrink;
        const Way straight = seen(0), by_wheels = rolled(halts_[0].angle_rad, halts_[1].angle_rad);
        const Way spin = seen(1), spin_by_wheels = rolled(halts_[1].angle_rad, halts_[2].angle_rad);
        const double half_track = geometry_.track_m / 2;
        // Told to go straight, it turned: with one sign wrong, the rims' way is the turn's.
        const bool turn_would_show = std::abs(by_wheels.forward_m) / half_track > 2 * kSure * sigma_rad;
        const double turned = straight.turn_rad * half_track / by_wheels.forward_m;
        // and a weak drive's curve is the wheels' own: what was seen is nearer to the one or to the other
        const double wrong_turn_rad = std::copysign(by_wheels.forward_m / half_track, straight.turn_rad);
        const double off_rad = std::abs(straight.turn_rad - by_wheels.turn_rad);
        if (turn_would_show && std::abs(turned) > kHalf && off_rad > kSure * sigma_rad &&
            off_rad > std::abs(straight.turn_rad - wrong_turn_rad))
            return turned > 0 ? IdentCause::left_sign_wrong : IdentCause::right_sign_wrong;
        // From here on what is wrong turns a way round: less of it is enough, and each tells for itself.
        const double along =
            std::abs(by_wheels.forward_m) > kSure * sigma_m ? straight.forward_m / by_wheels.forward_m : 0;
        const double around = std::abs(spin_by_wheels.turn_rad) > kSure * sigma_rad
                                  ? spin.turn_rad / spin_by_wheels.turn_rad
                                  : 0;
        if (along < -kHalf) return IdentCause::both_signs_wrong;
        if (around < -kHalf && along > kHalf) return IdentCause::wheels_swapped;
        confirmed_ = along > kHalf && around > kHalf;
        return IdentCause::none;
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
    static constexpr double kHalf = 0.5;      // of what would be expected: half way between it and nothing

    struct Halt {
        Pose<double> pose;
        WheelPair<double> angle_rad;
        std::uint32_t poses = 0;
    };

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
