#pragma once

#include <array>

#include "firmware/model/effect.hpp"
#include "firmware/model/exponential.hpp"

namespace wheelwright::model {

// A drive that reports speed late, through a filter of its own: T reported' = speed - reported.
struct MeasurementLag {
    static constexpr std::array<EffectParameterInfo, 1> parameters{{
        {"time_constant_s", "s", 0.0, 10.0, "of the filter in the drive's speed report"},
    }};
    static constexpr EffectInfo info{"measurement_lag",
                                     "wheel speeds that the drive reports late",
                                     "first-order lag",
                                     parameters,
                                     "",
                                     "the controllers use positions, not the drive's speed"};

    template <typename Real>
    struct Memory {
        Real reported_rad_per_s{};
    };
    // The wheel speed that is reported at the end of this step, over which the wheel had this speed.
    template <typename Real>
    static constexpr Real report_speed(const Parameters<Real>& p, Memory<Real>& memory, Real speed_rad_per_s,
                                       Real step_s) {
        if (!(p[0] > 0)) return speed_rad_per_s;
        memory.reported_rad_per_s =
            speed_rad_per_s + (memory.reported_rad_per_s - speed_rad_per_s) * exp_minus(step_s / p[0]);
        return memory.reported_rad_per_s;
    }
};

}  // namespace wheelwright::model
