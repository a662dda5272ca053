// Notices that the wheels and an outside observer disagree about how the robot turns: a wheel slips, or is
// pushed. The estimators then do not learn from the wheels (note: indirect adaptation learns nonsense from a
// slipping robot).
//
// Threads: the cycle's. No call allocates or blocks. About 20 instructions with an external pose, 2 without.
#pragma once

#include <cmath>
#include <cstdint>

#include "firmware/model/robot_parameters.hpp"
#include "firmware/model/types.hpp"

namespace wheelwright::task {

class SlipWatch {
  public:
    // The robot file's limit. "auto": the difference of two external headings a window apart is within six of
    // its standard deviations, and wheels that do not slip are wrong by less than a 20th of the yaw rate
    // (track and radii are measured to half a percent).
    static double limit_rad_per_s(const model::RobotParameters& from) {
        constexpr double kSigmas = 6;
        constexpr double kGeometryShare = 0.05;
        const double given = from.adaptation.slip_yaw_rate_rad_per_s;
        const double noise = 1.4142135623730951 * from.odometry.external_heading_noise_rad;
        return given > 0 ? given
                         : kSigmas * noise / (1e-9 * double(kWindow_ns)) +
                               kGeometryShare * from.limits.yaw_rate_rad_per_s;
    }

    // An external heading and the heading by wheels alone, both at `now_ns`. Over windows of kWindow_ns, so
    // that the external pose's noise does not look like slip.
    void compare(double external_heading_rad, double wheels_heading_rad, std::int64_t now_ns,
                 double limit_rad_per_s) {
        const double gap = wrap_angle_rad(external_heading_rad - wheels_heading_rad);
        if (since_ns_ == 0 || now_ns - since_ns_ > kLongestWindow_ns) {
            since_ns_ = now_ns;
            gap_rad_ = gap;
            return;
        }
        if (now_ns - since_ns_ < kWindow_ns) return;
        const double rate = std::abs(wrap_angle_rad(gap - gap_rad_)) / (1e-9 * double(now_ns - since_ns_));
        if (rate > limit_rad_per_s) until_ns_ = now_ns + kHold_ns;
        since_ns_ = now_ns;
        gap_rad_ = gap;
    }

    bool slipping(std::int64_t now_ns) const { return now_ns < until_ns_; }

  private:
    static constexpr std::int64_t kWindow_ns = 200'000'000;
    static constexpr std::int64_t kLongestWindow_ns = 2'000'000'000;
    static constexpr std::int64_t kHold_ns = 1'000'000'000;

    std::int64_t since_ns_ = 0;
    std::int64_t until_ns_ = 0;
    double gap_rad_ = 0;
};

}  // namespace wheelwright::task
