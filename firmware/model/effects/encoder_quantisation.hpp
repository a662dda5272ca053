#pragma once

#include <array>
#include <cmath>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// Speeds that an encoder counts: whole counts within 10 ms, whatever the rate of the reports.
struct EncoderQuantisation {
    static constexpr double kCountingTime_s = 0.010;
    static constexpr double kUsualCountsPerTurn = 65536;
    static constexpr std::array<EffectParameterInfo, 1> parameters{{
        {"counts_per_turn", "", 0.0, 1e9, "counts in a turn of the wheel; 0: not rounded"},
    }};
    static constexpr EffectInfo info{
        "encoder_quantisation",
        "wheel speeds in steps, from a coarse encoder",
        "uniform quantiser, Widrow, Kollar (2008)",
        parameters,
        "",
        "the observer uses positions over time, which are finer than the reports"};

    template <typename Real>
    static constexpr Real step_rad_per_s(const Parameters<Real>& p) {
        return p[0] > 0 ? Real(6.283185307179586) / (p[0] * Real(kCountingTime_s)) : Real(0);
    }

    template <typename Real>
    struct Memory {};
    // The wheel speed that is reported at the end of this step.
    template <typename Real>
    static Real report_speed(const Parameters<Real>& p, Memory<Real>&, Real speed_rad_per_s,
                             Real /*step_s*/) {
        const Real step = step_rad_per_s(p);
        return step > 0 ? step * std::round(speed_rad_per_s / step) : speed_rad_per_s;
    }
};

}  // namespace wheelwright::model
