#include "firmware/task/learning.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "firmware/task/cycle_schedule.hpp"

namespace wheelwright::task {
namespace {

// Another sequence for each run, so that repeated runs differ as their standard errors say; the same when a
// recorded run is replayed: drawn from the time and from the last digits of what the encoders read.
std::uint32_t excitation_seed(const MotionInputs& now) {
    std::uint64_t x = static_cast<std::uint64_t>(now.now_ns);
    for (const double angle : {now.motion.wheel_angle_rad.left, now.motion.wheel_angle_rad.right}) {
        x = (x ^ std::bit_cast<std::uint64_t>(angle)) *
            0x9e3779b97f4a7c15U;  // golden ratio: scatters the bits
        x ^= x >> 32U;
    }
    return static_cast<std::uint32_t>(x);
}

ident::RegressionFilterOptions<double> filter_options(const model::RobotParameters& p, double kernel_s) {
    ident::RegressionFilterOptions<double> options;
    options.geometry = model::actual_geometry(p.effects, p.geometry);
    options.effects = p.effects;
    options.dynamics = p.dynamics;
    options.sample_time_s = kCyclePeriod_s;
    options.kernel_s = kernel_s;
    options.sample_age_s = Learning::sample_age_s(p);
    options.delay_s =
        p.velocity_loop.actuation_delay_s + model::effects_delay_s(p.effects) + options.sample_age_s;
    return options;
}

// A lobe of a figure-8 holds what the figure can tell; what is remembered should be most of one.
constexpr double kLapsRemembered = 0.4;
// The rows' averaging weight: long beside the noise, which falls with its length to the power of 2.5, and
// short beside what is remembered, which then is 60 rows. What happens within a row is averaged alike in
// motion and torque.
constexpr double kKernelsRemembered = 40;
// Samples that a speed is taken over: driving is slow beside the longest span that the filter has.
constexpr int kAdaptiveSpeedSpan = 24;

double chosen(double asked, double standard) { return asked > 0 ? asked : standard; }

}  // namespace

void Learning::start_identification(const model::RobotParameters& p, const protocol::IdentSettings& settings,
                                    const MotionInputs& now) {
    ident::IdentificationOptions<double> options;
    ident::SizingRequest& sizing = options.sizing;
    sizing.amplitude_Nm = chosen(settings.amplitude_Nm, p.ident.amplitude_Nm);
    sizing.bit_time_s = chosen(1e-3 * settings.bit_time_ms, p.ident.bit_time_s);
    sizing.kernel_s = p.ident.kernel_s;
    sizing.speed_limit_m_per_s = chosen(settings.speed_limit_m_per_s, p.ident.speed_limit_m_per_s);
    sizing.yaw_rate_limit_rad_per_s =
        chosen(settings.yaw_rate_limit_rad_per_s, p.ident.yaw_rate_limit_rad_per_s);
    sizing.coupling_standard_error_m = p.ident.coupling_standard_error_m;
    sizing.track_m = p.geometry.track_m;
    sizing.radius_m = p.geometry.mean_radius_m();
    sizing.sample_time_s = kCyclePeriod_s;
    sizing.distance_limit_m = chosen(settings.distance_limit_m, p.ident.distance_limit_m);
    sizing.torque_limit_Nm = p.limits.torque_Nm;
    sizing.robot_speed_limit_m_per_s = p.limits.speed_m_per_s;
    sizing.robot_yaw_rate_limit_rad_per_s = p.limits.yaw_rate_rad_per_s;

    auto& excitation = options.excitation;
    excitation.sample_time_s = kCyclePeriod_s;
    excitation.speed_limit_m_per_s = ident::speed_limit_m_per_s(sizing);
    excitation.yaw_rate_limit_rad_per_s =
        ident::yaw_rate_limit_rad_per_s(sizing, excitation.speed_limit_m_per_s);
    excitation.distance_limit_m = sizing.distance_limit_m;
    options.estimator.filter = filter_options(p, 0);
    options.estimator.relative_standard_error = p.ident.relative_standard_error;

    options.probe = true;
    ident::ProbeOptions& probing = options.probing;
    probing.geometry = options.estimator.filter.geometry;
    probing.sample_time_s = kCyclePeriod_s;
    probing.torque_limit_Nm = p.limits.torque_Nm;
    probing.amplitude_Nm = sizing.amplitude_Nm;
    probing.speed_limit_m_per_s = excitation.speed_limit_m_per_s;
    probing.yaw_rate_limit_rad_per_s = excitation.yaw_rate_limit_rad_per_s;
    probing.distance_limit_m = sizing.distance_limit_m;
    probing.pose_noise_m = p.odometry.external_pose_noise_m;
    probing.heading_noise_rad = p.odometry.external_heading_noise_rad;
    options.delay_phase_s = p.ident.delay_phase_s;
    options.duration_s = chosen(settings.duration_s, p.ident.duration_s);
    run_.start(options, now.pose, excitation_seed(now));
    sample_age_s_ = sample_age_s(p);
    duration_s_ = options.duration_s;
    relative_standard_error_ = p.ident.relative_standard_error;
    minimum_excitation_ = p.adaptation.minimum_excitation;
    started_ = true;
    adapting_ = false;
}

model::Dynamics<double> Learning::probed_dynamics() const {
    const ident::ProbeFindings& found = run_.findings();
    constexpr double kPredictsNothing = 1e-5;
    if (!probed()) return {0, 0, kPredictsNothing, kPredictsNothing};
    return {0, 0, found.k7_per_kg_m, found.k8_per_kg_m2};
}

void Learning::record(ParameterService& service, model::RobotParameters& live) const {
    const auto& e = run_.estimate();
    const auto put = [&service](std::string_view key, double value) {
        if (const model::ParameterInfo* info = model::find_parameter(key)) {
            service.record(info->index, std::clamp(value, info->minimum, info->maximum));
        }
    };
    if (run_.coupling_known()) {
        put("dynamics.k5_m", e.dynamics.k5_m);
        put("dynamics.k6_per_m", e.dynamics.k6_per_m);
        put("dynamics_standard_error.k5_m", e.standard_error.k5_m);
        put("dynamics_standard_error.k6_per_m", e.standard_error.k6_per_m);
    }
    if (run_.findings().clipped) put("limits.torque_Nm", run_.findings().torque_limit_Nm);
    put("dynamics.k7_per_kg_m", e.dynamics.k7_per_kg_m);
    put("dynamics.k8_per_kg_m2", e.dynamics.k8_per_kg_m2);
    put("dynamics_standard_error.k7_per_kg_m", e.standard_error.k7_per_kg_m);
    put("dynamics_standard_error.k8_per_kg_m2", e.standard_error.k8_per_kg_m2);
    if (run_.delay().valid)
        put("velocity_loop.actuation_delay_s",
            run_.delay().delay_s - sample_age_s_ - model::effects_delay_s(live.effects));
    put("velocity_loop.angle_noise_rad", run_.findings().angle_noise_rad);
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (!e.effects.active[i]) continue;
        if (!live.effects.active[i]) service.record(model::effect_index(i, model::kEffectActiveSlot), 1);
        const auto& parameters = model::kEffects[i].parameters;
        for (std::size_t j = 0; j < parameters.size(); ++j) {
            service.record(
                model::effect_index(i, j),
                std::clamp(e.effects.parameter[i][j], parameters[j].minimum, parameters[j].maximum));
            live.effects_standard_error.parameter[i][j] = e.effects_standard_error.parameter[i][j];
        }
    }
}

void Learning::start_adaptation(const model::RobotParameters& p, const control::PlantModel<double>& plant,
                                double lap_s) {
    ident::AdaptiveEstimatorOptions<double> options;
    options.memory_s = std::max(p.adaptation.memory_s, kLapsRemembered * lap_s);
    options.filter = filter_options(p, options.memory_s / kKernelsRemembered);
    const double noise_rad = p.velocity_loop.angle_noise_rad;
    if (noise_rad > 0) {
        options.angle_noise_rad = noise_rad;
        options.filter.speed_span = kAdaptiveSpeedSpan;
        options.filter.standing_speed_rad_per_s =
            ident::standing_speed_rad_per_s(noise_rad, kAdaptiveSpeedSpan, kCyclePeriod_s);
    }
    options.dynamics = plant.dynamics;
    options.standard_error = p.dynamics_standard_error;
    options.effects = plant.effects;
    options.effects_standard_error = p.effects_standard_error;
    options.minimum_excitation = p.adaptation.minimum_excitation;
    options.trust_relative_error = p.adaptation.trust_relative_error;
    options.range = p.adaptation.range;
    adaptive_.configure(options);
    guard_.configure({p.adaptation.dwell_s, p.adaptation.rate_per_s, p.adaptation.trust_relative_error,
                      p.adaptation.range, kCyclePeriod_s, p.geometry.track_m},
                     plant.dynamics, plant.effects);
    minimum_excitation_ = p.adaptation.minimum_excitation;
    adapting_ = true;
}

bool Learning::adapt(const Sample& sample, bool may_adapt, bool busy) {
    adaptive_.push(sample, busy);
    return guard_.update(adaptive_.estimate(), may_adapt);
}

bool Learning::adaptation_frozen() const {
    const auto frozen = adaptive_.frozen();
    return adapting_ && (frozen.k7 || frozen.k8);
}

protocol::IdentStatus Learning::status() const {
    protocol::IdentStatus status;
    if (!started_) return status;
    status.phase = static_cast<protocol::IdentPhase>(static_cast<unsigned>(run_.state()) + 1);
    status.cause = run_.cause();
    status.model_incomplete = run_.model_incomplete();
    status.torque_clipped = run_.findings().clipped;
    status.sides_confirmed = run_.findings().pose_seen;
    status.signs_agree = run_.signs_agree();
    status.delay_s = std::max(run_.delay().delay_s - sample_age_s_, 0.0);
    status.samples = estimate().rows;
    const auto& x = estimate().excitation;
    status.excitation_percent = 100 * std::min(std::min(x.k7_per_kg_m, x.k8_per_kg_m2), 1.0);
    return status;
}

// Standard errors fall with the square root of time, so the share of time that is done is the square of
// theirs.
double Learning::progress() const {
    if (!started_) return 0;
    if (identification_succeeded()) return 1;
    const auto& e = run_.estimate();
    const double worst = std::max(
        {e.standard_error.k7_per_kg_m / std::abs(e.dynamics.k7_per_kg_m) / relative_standard_error_,
         e.standard_error.k8_per_kg_m2 / std::abs(e.dynamics.k8_per_kg_m2) / relative_standard_error_,
         run_.coupling_error_m() / run_.sizing().coupling_standard_error_m});
    const double by_error = worst > 0 ? 1 / (worst * worst) : 0;
    const double by_time = run_.elapsed_s() / duration_s_;
    const double share = std::max(std::isfinite(by_error) ? by_error : 0.0, by_time);
    return std::clamp(share, 0.0, 0.99);
}

bool Learning::excited() const {
    if (!started_ && !adapting_) return false;
    const auto& x = estimate().excitation;
    return x.k7_per_kg_m >= minimum_excitation_ && x.k8_per_kg_m2 >= minimum_excitation_;
}

}  // namespace wheelwright::task
