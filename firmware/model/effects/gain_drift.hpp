#pragma once

#include <array>

#include "firmware/model/effect.hpp"
#include "firmware/model/exponential.hpp"

namespace wheelwright::model {

// A drive that weakens as it warms up: tau = u (1 - loss share), with the share t / span, at most 1, for time
// constant 0, else 1 - exp(-t / T).
struct GainDrift {
    static constexpr std::array<EffectParameterInfo, 2> parameters{{
        {"loss", "", -1.0, 0.95, "share of the torque that is lost in the end"},
        {"time_constant_s", "s", 0.0, 1e5, "of the loss; 0: evenly over the whole run"},
    }};
    static constexpr EffectInfo info{
        "gain_drift",
        "torque per ampere that falls while magnets warm up",
        "first-order warming; torque constant linear in temperature",
        parameters,
        "",
        "when the warming began is not known; adaptive mode follows it as K7 and K8"};

    static constexpr int path_place = 40;
    template <typename Real>
    struct Memory {};
    template <typename Real>
    static constexpr Real deliver(const Parameters<Real>& p, Memory<Real>&, const PathInstant<Real>& at) {
        return at.torque_Nm * (1 - p[0] * share(p, at.time_s, at.span_s));
    }

    // How much of the loss has come by now.
    template <typename Real>
    static constexpr Real share(const Parameters<Real>& p, Real time_s, Real span_s) {
        if (!(time_s > 0)) return 0;
        if (p[1] > 0) return 1 - exp_minus(time_s / p[1]);
        return time_s < span_s ? time_s / span_s : Real(1);
    }
};

}  // namespace wheelwright::model
