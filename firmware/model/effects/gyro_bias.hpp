#pragma once

#include <array>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// A gyro that reports a turn when there is none.
struct GyroBias {
    static constexpr std::array<EffectParameterInfo, 1> parameters{{
        {"bias_rad_per_s", "rad/s", -10.0, 10.0, "yaw rate that is reported at rest"},
    }};
    static constexpr EffectInfo info{"gyro_bias", "offset of the gyro",         "definition", parameters,
                                     "",          "the controllers use no gyro"};

    template <typename Real>
    static constexpr Real report_yaw_rate(const Parameters<Real>& p, Real yaw_rate_rad_per_s) {
        return yaw_rate_rad_per_s + p[0];
    }
};

}  // namespace wheelwright::model
