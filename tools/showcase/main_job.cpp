#include "tools/showcase/main_job.hpp"

#include <cmath>

namespace wheelwright::tools {
namespace {

constexpr double kIdentificationAim = 0.02;  // relative
constexpr double kRmsAim_m = 0.005;
constexpr double kPeakAim_m = 0.015;
constexpr double kAdaptationAim = 0.05;  // relative, 3 s after the change
constexpr double kAdaptationTime_s = 3;

double relative(double value, double truth) { return value / truth - 1; }

// The robot is carried to the start of the figure-8, one metre beside it.
void carry_to_start(Simulation& sim) {
    sim.world().plant().place({0, 1, 0}, {0, 0});
    sim.run_for(0.2);
}

}  // namespace

void MainJob::begin(Simulation& sim, const model::RobotParameters& plant) {
    true_geometry = plant.geometry;
    believed_geometry = sim.parameters().geometry;
    truth = as_seen_with(plant.dynamics, true_geometry, believed_geometry);
    true_effects = plant.effects;
}

void MainJob::identify(Simulation& sim, const Progress& progress) {
    identification = tools::identify(sim, progress);
}

void MainJob::tune(Simulation& sim) {
    settling_aim_s = control::velocity_loop_speed(sim.parameters(), task::kCyclePeriod_s).settling_time_s;
    design = sim.cycle().control().design().result();
    speed_step = velocity_step(sim, {speed_step_m_per_s, 0});
    yaw_step = velocity_step(sim, {0, yaw_step_rad_per_s});
}

void MainJob::drive(Simulation& sim, const Progress& progress) {
    carry_to_start(sim);
    TrackingOptions options;
    options.path = control::standard_figure_eight<double>(sim.parameters());
    figure_eight = track(sim, options, progress);
}

void MainJob::adapt(Simulation& sim, const Progress& progress) {
    carry_to_start(sim);
    TrackingOptions options;
    options.mode = protocol::Mode::adaptive;
    options.path = control::standard_figure_eight<double>(sim.parameters());
    bool dropped = false;
    bool judged = false;
    std::int64_t cycle = 0;
    options.event = [&](Simulation& now, double time_s) {
        if (!dropped && time_s >= payload_time_s) {
            drop_payload(now.world(), payload_share);
            dropped = true;
        }
        const auto& estimate = now.cycle().learning().estimate();
        const bool due = !judged && time_s >= payload_time_s + kAdaptationTime_s;
        if (!due && cycle++ % 100 != 0) return;
        const model::Dynamics<double> real = as_seen_with(
            sim::plant_dynamics(now.world().plant().parameters()), true_geometry, believed_geometry);
        if (due) {
            judged = true;
            k7_error = relative(estimate.dynamics.k7_per_kg_m, real.k7_per_kg_m);
            k8_error = relative(estimate.dynamics.k8_per_kg_m2, real.k8_per_kg_m2);
            return;
        }
        adaptation_time_s.push_back(time_s);
        adapted.push_back(estimate.dynamics);
        adapted_error.push_back(estimate.standard_error);
        true_dynamics.push_back(real);
    };
    adaptive = track(sim, options, progress);
}

bool MainJob::settles_in_time() const {
    return speed_step.settling_s > 0 && speed_step.settling_s <= settling_aim_s && yaw_step.settling_s > 0 &&
           yaw_step.settling_s <= settling_aim_s;
}

bool MainJob::reached_its_aims() const {
    const model::Dynamics<double>& k = identification.estimate.dynamics;
    return identification.succeeded && std::abs(relative(k.k5_m, truth.k5_m)) <= kIdentificationAim &&
           std::abs(relative(k.k6_per_m, truth.k6_per_m)) <= kIdentificationAim &&
           std::abs(relative(k.k7_per_kg_m, truth.k7_per_kg_m)) <= kIdentificationAim &&
           std::abs(relative(k.k8_per_kg_m2, truth.k8_per_kg_m2)) <= kIdentificationAim &&
           settles_in_time() && figure_eight.entered && figure_eight.rms_m <= kRmsAim_m &&
           figure_eight.peak_m <= kPeakAim_m && adaptive.entered && std::abs(k7_error) <= kAdaptationAim &&
           std::abs(k8_error) <= kAdaptationAim;
}

Report MainJob::report() const {
    Report r("demo");
    const ident::DynamicsEstimate<double>& e = identification.estimate;
    r.section("identification", "What the firmware found out about the robot");
    r.table("parameters", {{"name", "parameter"},
                           {"true_value", "truth"},
                           {"value", "identified"},
                           {"standard_error", "standard error"},
                           {"error_percent", "error / %"}});
    const auto row = [&r](const std::string& name, double real, double value, double error) {
        r.row({name, real, value, error, 100 * relative(value, real)});
    };
    row("K5 / m", truth.k5_m, e.dynamics.k5_m, e.standard_error.k5_m);
    row("K6 / (1/m)", truth.k6_per_m, e.dynamics.k6_per_m, e.standard_error.k6_per_m);
    row("K7 / (1/(kg m))", truth.k7_per_kg_m, e.dynamics.k7_per_kg_m, e.standard_error.k7_per_kg_m);
    row("K8 / (1/(kg m^2))", truth.k8_per_kg_m2, e.dynamics.k8_per_kg_m2, e.standard_error.k8_per_kg_m2);
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (!e.effects.active[i] || !true_effects.active[i]) continue;
        const auto& parameters = model::kEffects[i].parameters;
        for (std::size_t j = 0; j < parameters.size(); ++j) {
            row(std::string(model::kEffects[i].name) + "." + std::string(parameters[j].name),
                true_effects.parameter[i][j], e.effects.parameter[i][j],
                e.effects_standard_error.parameter[i][j]);
        }
    }
    if (!identification.succeeded) return r;
    const std::string settling_aim = "aim " + number_text(1e3 * settling_aim_s);
    r.section("driving", "What it made of it");
    // Milliseconds and millimetres throughout, as in the lines printed on the way.
    r.add("settling_speed_ms", "step of 0.15 m/s settles to 1 % in", 1e3 * speed_step.settling_s, "ms",
          settling_aim);
    r.add("settling_yaw_ms", "step of 0.7 rad/s settles to 1 % in", 1e3 * yaw_step.settling_s, "ms",
          settling_aim);
    r.add("phase_margin_deg", "phase margin of the velocity loops", design.phase_margin_deg, "deg",
          "at least 45");
    r.add("sensitivity_peak", "peak of the sensitivity", design.sensitivity_peak, "", "at most 2");
    r.add("figure_eight_rms_mm", "figure-8, three laps, RMS error", 1e3 * figure_eight.rms_m, "mm", "aim 5");
    r.add("figure_eight_peak_mm", "figure-8, largest error", 1e3 * figure_eight.peak_m, "mm", "aim 15");
    r.add("largest_torque_Nm", "largest wheel torque", figure_eight.largest_torque_Nm, "Nm");
    r.add("payload_k7_error_percent", "K7, 3 s after +30 % payload, error", 100 * k7_error, "%", "aim 5");
    r.add("payload_k8_error_percent", "K8, 3 s after +30 % payload, error", 100 * k8_error, "%", "aim 5");
    r.add("adaptive_rms_mm", "figure-8 with the payload coming, RMS error", 1e3 * adaptive.rms_m, "mm");
    return r;
}

}  // namespace wheelwright::tools
