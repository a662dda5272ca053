// What the estimators report, and what the model guard and telemetry read.
#pragma once

#include <array>
#include <cstdint>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/effects.hpp"

namespace wheelwright::ident {

// Standard error of what is not known at all.
inline constexpr float kUnknownError = 1e9F;

template <typename Real>
struct DynamicsEstimate {
    model::Dynamics<Real> dynamics;
    model::Dynamics<Real> standard_error;       // honest for coloured residuals
    model::Dynamics<Real> covariance_diagonal;  // bare P_ii as in the paper's Table 1, for comparison
    model::Dynamics<Real> excitation;           // see excitation_monitor.hpp
    model::EffectSet<Real> effects;             // active: those that are estimated
    model::EffectSet<Real> effects_standard_error;
    std::uint32_t rows = 0;         // rows that were used
    std::uint32_t masked_rows = 0;  // rows that were not
    std::uint32_t changes = 0;      // detected changes of the robot (adaptive estimator)
    bool good_enough = false;       // K7 and K8 positive, and known to the wanted relative standard error
};

// Before there is a row.
template <typename Real>
DynamicsEstimate<Real> nothing_known(const std::array<bool, model::kEffectCount>& effects) {
    DynamicsEstimate<Real> estimate;
    estimate.effects.active = effects;
    const auto unknown = static_cast<Real>(kUnknownError);
    estimate.standard_error = {unknown, unknown, unknown, unknown};
    return estimate;
}

// Where in an EffectSet each column belongs, in catalogue order.
struct ColumnPlace {
    std::uint8_t effect = 0;
    std::uint8_t parameter = 0;
};

// The columns that model::for_each_column() makes for these effects: their number, and their places as far
// as `places` goes.
template <std::size_t kSize>
constexpr int column_places(const std::array<bool, model::kEffectCount>& active,
                            std::array<ColumnPlace, kSize>& places) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (!active[i] || !model::kLinearInParameters[i]) continue;
        for (std::size_t j = 0; j < model::kEffects[i].parameters.size(); ++j, ++count) {
            if (count < kSize) places[count] = {static_cast<std::uint8_t>(i), static_cast<std::uint8_t>(j)};
        }
    }
    return static_cast<int>(count);
}

}  // namespace wheelwright::ident
