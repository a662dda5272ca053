// Notices that the wheels and an outside observer disagree about how the robot turns: a wheel slips, or is
// pushed. The estimators then do not learn from the wheels (note: indirect adaptation learns nonsense from a
// slipping robot).
//
// Threads: the cycle's. No call allocates or blocks. About 20 instructions with an external pose, 2 without.
#pragma once

#include <cmath>
#include <cstdint>

#include "firmware/model/types.hpp"

namespace wheelwright::task {

class SlipWatch {
  public:
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
