// Tyres that slip as they push: then the wheels and a gyro disagree under force, and the more the faster the
// robot rolls. So it shows without a law of the tyre's limit, and beside friction and loads, about which no
// gyro disagrees.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "tools/gap/inference/residual.hpp"
#include "tools/logs/measured_log.hpp"

namespace wheelwright::gap {

inline constexpr std::size_t kSlip = model::find_effect("wheel_slip");

// Of a rolling tyre, in proportion to torque and speed: slip in m/s per Nm and rad/s of its wheel.
struct RollingSlip {
    double value = 0, error = 0;
};

// By the gyro alone: nothing where that is not sure. Logs without a gyro tell nothing.
std::optional<RollingSlip> slip_by_gyro(const std::vector<tools::MeasuredLog>& logs,
                                        const model::Geometry<double>& geometry);

// By the search; and neither that nor given, nor left out by who asks.
bool found_slip(const Search& search);
bool may_slip(const Search& search, const Known& known);

// By how the wheels accelerate, beside what was found: of the slip that the search found, or else of a
// rolling tyre's. Below a tyre's limit slip makes the wheels lead, and beside a lag that is a lag of another
// order: `surely` after Holm over the catalogue, and again beside free shapes that are no slip, what comes
// late by any law among them.
struct SlipInRows {
    RollingSlip rolling{};
    bool surely = false;
    double torque_share = 0;
};
SlipInRows slip_in_rows(const Search& search, const ResidualOptions& options);

// Where gyro and rows say so and agree, or the gyro says it twice as surely and the rows do not deny it, or
// the rows by themselves: the effect's parameters, and the standard error of its slip speed. The limit of the
// force shows in neither.
struct SlipFound {
    model::Parameters<double> parameters{};
    double error = 0;
};
std::optional<SlipFound> slip_of(const std::optional<RollingSlip>& gyro, const SlipInRows& rows,
                                 const Setting& setting);

// As an effect that is named. No model has it: the catalogue's slip does not grow with the speed.
NamedEffect named_slip(const SlipFound& slip, const Setting& setting);

}  // namespace wheelwright::gap
