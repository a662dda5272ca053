#include "firmware/task/learning.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

namespace wheelwright::task {
namespace {

// Another sequence for each run, so that repeated runs differ as their standard errors say; the same when a
// recorded run is replayed: drawn from the time and from the last digits of what the encoders read.
std::uint32_t excitation_seed(const Observed& now) {
    std::uint64_t x = static_cast<std::uint64_t>(now.now_ns);
    for (const double angle : {now.motion.wheel_angle_rad.left, now.motion.wheel_angle_rad.right}) {
        x = (x ^ std::bit_cast<std::uint64_t>(angle)) *
            0x9e3779b97f4a7c15U;  // golden ratio: scatters the bits
        x ^= x >> 32U;
    }
    return static_cast<std::uint32_t>(x);
}

// A lobe of a figure-8 holds what the figure can tell; what is remembered should be most of one.
constexpr double kLapsRemembered = 0.4;
// The rows' averaging weight: long beside the noise, which falls with its length to the power of 2.5, and
// short beside what is remembered, which then is 60 rows. What happens within a row is averaged alike in
// motion and torque.
constexpr double kKernelsRemembered = 40;
// Samples that a speed is taken over: driving is slow beside the longest span that the filter has.
constexpr int kAdaptiveSpeedSpan = 24;

// The dither's torque is at most this share of the limit, its way at a rim this share of the track. Its
// period is the one at which it may use both: a shorter one would accelerate less on the way that it has. So
// many rows are in a period: fewer, and each averages the dither away. Its amplitudes are what tells mass and
// inertia to adaptation.dither_error within the memory, beside the rows' noise.
constexpr double kDitherTorqueShare = 0.15;
constexpr double kDitherWayShare = 0.006;
constexpr double kRowsADither = 3.618;
constexpr double kDitherOverSettling = 3;  // the loops then follow it

constexpr double kKernelOverRow = 1.5;  // regression_filter.hpp

double planned_dither_s(const model::RobotParameters& p, const model::Dynamics<double>& k) {
    const double rim_m_per_s2 = 2 * kDitherTorqueShare * p.limits.torque_Nm *
                                std::min(k.k7_per_kg_m, k.k8_per_kg_m2 * p.geometry.track_m / 2);
    return std::max(2 * std::numbers::pi * std::sqrt(kDitherWayShare * p.geometry.track_m / rim_m_per_s2),
                    kDitherOverSettling * control::velocity_loop_speed(p, kCyclePeriod_s).settling_time_s);
}

double chosen(double asked, double standard) { return asked > 0 ? asked : standard; }

}  // namespace

void Learning::start_identification(const model::RobotParameters& p, const protocol::IdentSettings& settings,
                                    double encoder_loop_period_s, const Observed& now) {
    encoder_period_s_ = 1e-3 * p.drive.encoder_period_ms;
    encoder_loop_period_s_ = encoder_loop_period_s;
    encoder_lag_ = {};
    filed_encoder_lag_s_ = {p.drive.left.encoder_lag_s, p.drive.right.encoder_lag_s};
    ident::IdentificationOptions<Real> options;
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
    sizing.report_period_s = encoder_period_s_;
    sizing.distance_limit_m = chosen(settings.distance_limit_m, p.ident.distance_limit_m);
    sizing.torque_limit_Nm = p.limits.torque_Nm;
    sizing.robot_speed_limit_m_per_s = p.limits.speed_m_per_s;
    sizing.robot_yaw_rate_limit_rad_per_s = p.limits.yaw_rate_rad_per_s;

    auto& excitation = options.excitation;
    excitation.sample_time_s = kCyclePeriod_s;
    const double speed_limit_m_per_s = ident::speed_limit_m_per_s(sizing);
    const double yaw_rate_limit_rad_per_s = ident::yaw_rate_limit_rad_per_s(sizing, speed_limit_m_per_s);
    excitation.speed_limit_m_per_s = Real(speed_limit_m_per_s);
    excitation.yaw_rate_limit_rad_per_s = Real(yaw_rate_limit_rad_per_s);
    excitation.distance_limit_m = Real(sizing.distance_limit_m);
    options.estimator.filter = regression_filter_options<Real>(p, 0);
    options.estimator.relative_standard_error = Real(p.ident.relative_standard_error);

    options.probe = true;
    ident::ProbeOptions& probing = options.probing;
    probing.geometry = options.estimator.filter.geometry;
    probing.sample_time_s = kCyclePeriod_s;
    probing.sample_age_s = Senses::sample_age_s(p);
    probing.report_period_s = encoder_period_s_;
    probing.torque_limit_Nm = p.limits.torque_Nm;
    probing.amplitude_Nm = sizing.amplitude_Nm;
    probing.speed_limit_m_per_s = speed_limit_m_per_s;
    probing.yaw_rate_limit_rad_per_s = yaw_rate_limit_rad_per_s;
    probing.distance_limit_m = sizing.distance_limit_m;
    probing.pose_noise_m = p.odometry.external_pose_noise_m;
    probing.heading_noise_rad = p.odometry.external_heading_noise_rad;
    options.delay_phase_s = p.ident.delay_phase_s;
    options.duration_s = chosen(settings.duration_s, p.ident.duration_s);
    run_.start(options, now.pose, excitation_seed(now));
    sample_age_s_ = Senses::sample_age_s(p);
    duration_s_ = options.duration_s;
    relative_standard_error_ = p.ident.relative_standard_error;
    minimum_excitation_ = p.adaptation.minimum_excitation;
    started_ = true;
    adapting_ = false;
}

WheelPair<Real> Learning::identify(const Observed& seen,
                                   const std::array<const drivers::DriveFeedback*, 2>& feedback) {
    ident::ProbeSample senses;
    senses.angle_rad = seen.sample.angle_rad;
    senses.usable = seen.angles_known;  // swapped wheels look like slip; the probe tells them apart
    senses.reported_Nm = {feedback[0]->torque_Nm, feedback[1]->torque_Nm};
    for (std::size_t i = 0; i < 2; ++i) {
        senses.report_is_new[i] = feedback[i]->torque_time_ns != report_ns_[i];
        report_ns_[i] = feedback[i]->torque_time_ns;
        encoder_lag_[i].take(encoder_sample(*feedback[i]), encoder_period_s_);
    }
    const WheelPair<double> lag_s = encoder_lag_s();
    senses.encoder_lag_s = std::max(lag_s.left, lag_s.right);
    senses.pose_is_new = seen.external_pose != nullptr;
    if (senses.pose_is_new) senses.pose = *seen.external_pose;
    return run_.step(seen.sample, seen.pose, seen.motion.twist, senses);
}

WheelPair<double> Learning::encoder_lag_s() const {
    const auto lag_s = [this](std::size_t drive, double filed_s) {
        return encoder_lag_[drive].lag_s(encoder_loop_period_s_, encoder_period_s_, filed_s);
    };
    return {lag_s(0, filed_encoder_lag_s_.left), lag_s(1, filed_encoder_lag_s_.right)};
}

model::Dynamics<Real> Learning::probed_dynamics() const {
    const ident::ProbeFindings& found = run_.findings();
    constexpr Real kPredictsNothing = Real(1e-5);
    if (!probed()) return {0, 0, kPredictsNothing, kPredictsNothing};
    return {0, 0, Real(found.k7_per_kg_m), Real(found.k8_per_kg_m2)};
}

// What couples forward and turning. Returns what is K5..K8 beside it.
model::Dynamics<double> Learning::record_asymmetry(const ident::Asymmetry& found, ParameterService& service,
                                                   model::RobotParameters& live) const {
    constexpr std::size_t gains = model::find_effect(model::TorqueGainMismatch::info.name);
    const auto put = [&](std::size_t effect, double value, double error) {
        if (value == 0 && !live.effects.active[effect]) return;
        live.effects_standard_error.parameter[effect][0] = error;
        const model::EffectParameterInfo& info = model::kEffects[effect].parameters[0];
        if (!live.effects.active[effect])
            service.record(model::effect_index(effect, model::kEffectActiveSlot), 1);
        service.record(model::effect_index(effect, 0), std::clamp(value, info.minimum, info.maximum));
    };
    model::Dynamics<double> k = ident::told_apart<double>(run_.estimate().dynamics, found.mismatch,
                                                          found.offset_m, live.geometry.track_m);
    // The run took the torque that the file's mismatch lets arrive, so it has found what is to be added.
    const double listed = model::listed_mismatch(live.effects);
    const double beside = 1 + listed * found.mismatch;
    k.k7_per_kg_m *= beside;
    k.k8_per_kg_m2 *= beside;
    const double mismatch = (listed + found.mismatch) / beside;
    put(gains, model::TorqueGainMismatch::from_coordinates(model::Parameters<double>{mismatch})[0],
        2 * found.mismatch_error);
    put(model::kCogLateral, found.offset_m, found.offset_error_m);
    return k;
}

void Learning::record(ParameterService& service, model::RobotParameters& live) const {
    const auto& e = run_.estimate();
    const ident::Asymmetry found = run_.asymmetry();
    const model::Dynamics<double> k = record_asymmetry(found, service, live);
    const auto put = [&service](std::string_view key, double value) {
        if (const model::ParameterInfo* info = model::find_parameter(key)) {
            service.record(info->index, std::clamp(value, info->minimum, info->maximum));
        }
    };
    if (run_.coupling_known()) {
        put("dynamics.k5_m", k.k5_m);
        put("dynamics.k6_per_m", k.k6_per_m);
        put("dynamics_standard_error.k5_m", e.standard_error.k5_m);
        put("dynamics_standard_error.k6_per_m", e.standard_error.k6_per_m);
    }
    if (run_.findings().clipped) put("limits.torque_Nm", run_.findings().torque_limit_Nm);
    put("dynamics.k7_per_kg_m", k.k7_per_kg_m);
    put("dynamics.k8_per_kg_m2", k.k8_per_kg_m2);
    put("dynamics_standard_error.k7_per_kg_m", e.standard_error.k7_per_kg_m);
    put("dynamics_standard_error.k8_per_kg_m2", e.standard_error.k8_per_kg_m2);
    if (run_.delay().valid)
        put("velocity_loop.actuation_delay_s",
            run_.delay().delay_s - sample_age_s_ - model::effects_delay_s(live.effects));
    put("velocity_loop.angle_noise_rad", run_.findings().angle_noise_rad);
    const WheelPair<double> lag_s = encoder_lag_s();
    put("drive.left.encoder_lag_s", lag_s.left);
    put("drive.right.encoder_lag_s", lag_s.right);
    // The others are as the file has them, or have just been recorded.
    const std::array<bool, model::kEffectCount> estimated = model::estimated_effects(e.effects.active);
    const model::EffectSet<Real> effects = run_.effects_beside(found);
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (!estimated[i]) continue;
        if (!live.effects.active[i]) service.record(model::effect_index(i, model::kEffectActiveSlot), 1);
        const auto& parameters = model::kEffects[i].parameters;
        for (std::size_t j = 0; j < parameters.size(); ++j) {
            service.record(
                model::effect_index(i, j),
                std::clamp<double>(effects.parameter[i][j], parameters[j].minimum, parameters[j].maximum));
            live.effects_standard_error.parameter[i][j] = e.effects_standard_error.parameter[i][j];
        }
    }
}

void Learning::start_adaptation(const model::RobotParameters& p, MotionControl& control) {
    const control::PlantModel<Real>& plant = control.plant();
    ident::AdaptiveEstimatorOptions<Real> options;
    const double memory_s = std::max(p.adaptation.memory_s, kLapsRemembered * control.lap_s());
    options.memory_s = Real(memory_s);
    double kernel_s = memory_s / kKernelsRemembered;
    if (p.adaptation.dither_error > 0)
        kernel_s = std::min(kernel_s, kKernelOverRow * planned_dither_s(p, plant.dynamics) / kRowsADither);
    options.filter = regression_filter_options<Real>(p, kernel_s);
    const double noise_rad = p.velocity_loop.angle_noise_rad;
    if (noise_rad > 0) {
        options.angle_noise_rad = Real(noise_rad);
        options.filter.speed_span = kAdaptiveSpeedSpan;
        options.filter.standing_speed_rad_per_s = Real(ident::standing_speed_rad_per_s(
            ident::kStillNoises * noise_rad, kAdaptiveSpeedSpan, kCyclePeriod_s));
    }
    options.dynamics = plant.dynamics;
    track_m_ = plant.geometry.track_m;
    options.standard_error = model::Dynamics<Real>(p.dynamics_standard_error);
    options.effects = plant.effects;
    options.effects_standard_error = model::EffectSet<Real>(p.effects_standard_error);
    options.minimum_excitation = Real(p.adaptation.minimum_excitation);
    options.trust_relative_error = Real(p.adaptation.trust_relative_error);
    options.range = Real(p.adaptation.range);
    adaptive_.configure(options);
    guard_.configure({Real(p.adaptation.dwell_s), Real(p.adaptation.rate_per_s), options.trust_relative_error,
                      options.range, Real(kCyclePeriod_s), Real(p.geometry.track_m)},
                     ident::seen_together(plant.dynamics, model::listed_mismatch(plant.effects),
                                          model::listed_offset_m(plant.effects), track_m_),
                     plant.effects);
    minimum_excitation_ = p.adaptation.minimum_excitation;
    dither_period_s_ = Real(kRowsADither) * adaptive_.row_interval_s();
    const Real error = Real(p.adaptation.dither_error);
    dither_over_noise_ = error > 0 ? std::sqrt(2 * adaptive_.row_interval_s() / options.memory_s) / error : 0;
    torque_limit_Nm_ = Real(p.limits.torque_Nm);
    adapting_ = true;
    adapted_since_ = 0;
    was_long_ = false;
    control.dither().configure(dither_period_s_, Real(kCyclePeriod_s), track_m_,
                               {Real(p.limits.speed_m_per_s), Real(p.limits.yaw_rate_rad_per_s)});
}

bool Learning::adapt(const Observed& seen, bool saturated, MotionControl& control) {
    // Fusing a pose, learning and handing over are all long: the model follows some cycles later.
    const bool busy = seen.external_pose != nullptr;
    const bool waited = adapted_since_ > 0;
    if (waited && (!busy || ++adapted_since_ > 3)) {
        control.change_model(adapted_dynamics(), guard_.effects(), seen.motion);
        adapted_since_ = 0;
    }
    const bool estimate_is_new = adaptive_.push(seen.sample, busy);
    const bool changed = guard_.update(adaptive_.estimate(), !saturated && !seen.slipping);
    if (changed && adapted_since_ == 0) adapted_since_ = 1;
    if (estimate_is_new) {
        const WheelPair<Real> rim = dither_m_per_s2();
        control.dither().set_amplitudes(rim.left, rim.right);
    }
    // not for poses that come in every cycle
    was_long_ = waited || adapted_since_ == 1 || (busy && !was_long_);
    return was_long_;
}

model::Dynamics<Real> Learning::adapted_dynamics() const {
    return ident::told_apart(guard_.dynamics(), model::listed_mismatch(guard_.effects()),
                             model::listed_offset_m(guard_.effects()), track_m_);
}

WheelPair<Real> Learning::dither_m_per_s2() const {
    const WheelPair<Real> noise = adaptive_.row_noise_m_per_s2();
    const model::Dynamics<Real>& k = guard_.dynamics();
    const Real rate = 2 * std::numbers::pi_v<Real> / dither_period_s_;
    const Real by_way = Real(kDitherWayShare) * track_m_ * rate * rate;
    const Real torque_Nm = Real(kDitherTorqueShare) * torque_limit_Nm_;
    return {std::min({dither_over_noise_ * noise.left, by_way, 2 * torque_Nm * k.k7_per_kg_m}),
            std::min({dither_over_noise_ * noise.right, by_way, torque_Nm * k.k8_per_kg_m2 * track_m_})};
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
    status.delay_s = std::max<double>(run_.delay().delay_s - sample_age_s_, 0);
    status.samples = estimate().rows;
    const auto& x = estimate().excitation;
    status.excitation_percent = 100 * std::min<double>(std::min(x.k7_per_kg_m, x.k8_per_kg_m2), 1);
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
    const double by_error =
        std::min(worst > 0 ? 1 / (worst * worst) : 0, run_.elapsed_s() / run_.shortest_s());
    const double by_time = run_.elapsed_s() / duration_s_;
    // The wheels' signs may show until time is up.
    const double share = std::max(std::isfinite(by_error) && run_.signs_known() ? by_error : 0.0, by_time);
    return std::clamp(share, 0.0, 0.99);
}

bool Learning::excited() const {
    if (!started_ && !adapting_) return false;
    const auto& x = estimate().excitation;
    return x.k7_per_kg_m >= minimum_excitation_ && x.k8_per_kg_m2 >= minimum_excitation_;
}

}  // namespace wheelwright::task
