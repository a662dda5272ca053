// How fast the wheels have turned, by the encoders alone: the mean over some hundredths of a second. The
// observer's speed is quicker and smoother, and it is what its model makes of the encoders: where the model's
// parameters are wild, so is the speed. This one needs none.
//
// One thread; no allocation. step(): some 3 instructions; look(): 50.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/control/wheel_observer.hpp"
#include "firmware/model/types.hpp"

namespace wheelwright::control {

class EncoderSpeed {
  public:
    // A step of the coarsest encoder, or a new origin that is no further away, is a speed of 2.5 rad/s over
    // this time: less than what a tenth of a second of full torque adds to a wheel's.
    static constexpr int kStrideCycles = 10;
    static constexpr int kStrides = 4;
    static constexpr std::int64_t kSpan_ns = std::int64_t{kStrideCycles} * kStrides * 1'000'000;

    // In each cycle, whether look() is due.
    bool step() { return ++cycles_ >= kStrideCycles; }

    // `angle_rad`: the newest that are believed; `time_ns`: when they came.
    void look(const WheelPair<double>& angle_rad, const std::array<std::int64_t, 2>& time_ns) {
        cycles_ = 0;
        const Instant now{angle_rad, time_ns};
        const Instant from = instants_[oldest_];
        instants_[oldest_] = now;
        oldest_ = (oldest_ + 1) % kStrides;
        known_ = from.time_ns[0] > 0 && from.time_ns[1] > 0 &&
                 mean(now.time_ns[0] - from.time_ns[0], angle_rad.left - from.angle_rad.left, speed_.left) &&
                 mean(now.time_ns[1] - from.time_ns[1], angle_rad.right - from.angle_rad.right, speed_.right);
    }

    // False where the clock has been set, or frames are few.
    bool known() const { return known_; }
    const WheelPair<double>& rad_per_s() const { return speed_; }
    // By which a wheel's speed may be wrong: an encoder's step.
    static constexpr double kDoubt_rad_per_s = kCoarsestStep_rad / (1e-9 * kSpan_ns);

  private:
    struct Instant {
        WheelPair<double> angle_rad;
        std::array<std::int64_t, 2> time_ns{};
    };

    static bool mean(std::int64_t since_ns, double gone_rad, double& rad_per_s) {
        if (since_ns < kSpan_ns / 2) return false;
        rad_per_s = gone_rad / (1e-9 * static_cast<double>(since_ns));
        return true;
    }

    std::array<Instant, kStrides> instants_;
    std::size_t oldest_ = 0;
    WheelPair<double> speed_;
    int cycles_ = 0;
    bool known_ = false;
};

}  // namespace wheelwright::control
