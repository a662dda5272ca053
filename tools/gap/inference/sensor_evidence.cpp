#include "tools/gap/inference/sensor_evidence.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tools/gap/inference/statistics.hpp"

namespace wheelwright::gap {
namespace {

constexpr std::size_t kCounts = model::find_effect("encoder_quantisation");
constexpr std::size_t kMismatch = model::find_effect("wheel_radius_mismatch");
constexpr double kSmallMismatch = 0.004;  // of the wheels' radii

bool is_among(std::span<const std::size_t> effects, std::size_t effect) {
    return std::find(effects.begin(), effects.end(), effect) != effects.end();
}

bool shows(const std::vector<SensorEffect>& effects, std::size_t effect) {
    return std::any_of(effects.begin(), effects.end(),
                       [&](const SensorEffect& e) { return e.effect == effect; });
}

ParameterEstimate estimate(double value, double error) {
    return {value, error, {value - kNormalQuantile * error, value + kNormalQuantile * error}, true};
}

// How much the robot turns as it drives straight on, as a difference of the radii over their mean.
struct Bend {
    double size = 0, error = 0;
};
Bend bend_of(const Sensors::Gyro& gyro, double track_m) {
    return {std::abs(gyro.bend_per_m) * track_m, gyro.bend_error * track_m};
}

}  // namespace

Known known_before(const Sensors& sensors, std::span<const std::size_t> excluded, double track_m) {
    constexpr double kShortLag_s = 0.003;
    Known known;
    known.excluded.assign(excluded.begin(), excluded.end());
    known.white_noise =
        !shows(sensors.effects, kCounts) && sensors.unknown_step_rad_per_s == 0 && !sensors.by_angles;
    if (!sensors.gyro) return known;
    for (const SensorEffect& e : sensors.effects) {
        if (e.effect != kMeasurementLag) continue;
        known.given[kMeasurementLag] = {e.value};
        known.large_gap = kPolicy.gap_behind_lag;
    }
    known.most_report_lag_s = sensors.gyro->lag_s + 3 * sensors.gyro->lag_error_s;
    if (known.given.empty() && 3 * sensors.gyro->lag_error_s < kShortLag_s)
        known.excluded.push_back(kMeasurementLag);
    const Bend bend = bend_of(*sensors.gyro, track_m);
    if (bend.size + 3 * bend.error < kSmallMismatch) known.excluded.push_back(kMismatch);
    if (bend.size > kSmallMismatch + 3 * bend.error && !is_among(excluded, kMismatch))
        known.shown.push_back(kMismatch);
    return known;
}

BesideSensors beside_sensors(std::vector<NamedEffect> found, const Sensors& sensors, const Known& known,
                             std::span<const std::size_t> excluded, double track_m) {
    BesideSensors result;
    for (NamedEffect& e : found) {
        if (!sensors.gyro || e.effect != kMismatch) continue;
        // gyro = omega + x v / b with x = relative / (1 + relative / 2), both wheels' mean radius kept
        const double bend = sensors.gyro->bend_per_m * track_m;
        const double value = bend / (1 - bend / 2);
        const double error = std::hypot(sensors.gyro->bend_error * track_m, 0.005 * value);
        if (std::abs(value - e.parameters[0].value) > 4 * e.parameters[0].standard_error) continue;
        e.parameters[0] = estimate(value, error);
    }
    for (const SensorEffect& e : sensors.effects) {
        if (e.effect == kMeasurementLag && !known.given.contains(kMeasurementLag)) continue;
        NamedEffect named;
        named.effect = e.effect;
        named.probability = 0;
        named.parameters.push_back(estimate(e.value, e.standard_error));
        found.push_back(named);
        result.shown = true;
    }
    result.effects = std::move(found);
    const auto deny = [&](const char* place, const char* what) {
        result.denied.insert(result.denied.begin(), {place, what});
    };
    if (sensors.late_report) deny("lag", "that the wheel speeds are reported late");
    if (sensors.gyro && is_among(excluded, kMismatch)) {
        const Bend bend = bend_of(*sensors.gyro, track_m);
        if (bend.size > kSmallMismatch + 3 * bend.error)
            deny("coupling of turning and driving", "that the robot turns as it drives straight on");
    }
    return result;
}

}  // namespace wheelwright::gap
