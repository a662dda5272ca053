#include "tools/gap/model/free_run.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "sim_hal/plant.hpp"
#include "tools/gap/hypotheses/contribution.hpp"
#include "tools/gap/hypotheses/tyre_slip.hpp"

namespace wheelwright::gap {
namespace {

// By which the tyres slip at the stretch's begin, from the torques before it.
WheelPair<double> slip_at_start(const SimulatedRobot& robot, const Stretch& stretch) {
    constexpr std::size_t kSlip = model::find_effect("wheel_slip");
    if (!robot.effects.active[kSlip]) return {};
    TyreSlip slip(robot.effects.parameter[kSlip], robot.geometry, robot.dynamics);
    // so long that what was before is forgotten
    constexpr double kRemembered = 10;
    const tools::MeasuredLog& log = *stretch.log;
    const double longest_s =
        kRemembered * std::max(slip.of_mean().time_constant_s, slip.of_difference().time_constant_s);
    const std::size_t before =
        std::min(stretch.first, 1 + static_cast<std::size_t>(longest_s / log.period_s));
    if (before == 0) slip.advance(log.samples[stretch.first].torque_Nm, log.period_s);
    for (std::size_t i = stretch.first - before; i < stretch.first; ++i)
        slip.advance(log.samples[i].torque_Nm, log.period_s);
    const double half = slip.difference_m_per_s() / 2;
    return {slip.mean_m_per_s() - half, slip.mean_m_per_s() + half};
}

// A late torque, a castor's direction, a gap's side: what such an effect holds of the time before.
bool remembers(const model::EffectSet<double>& effects) {
    bool any = false;
    model::for_each_active(effects.active, [&]<typename Effect>(std::size_t) {
        if constexpr (requires { typename Effect::template Memory<double>; })
            any = any || !std::is_empty_v<typename Effect::template Memory<double>>;
    });
    return any;
}

// From where on the robot is led to the stretch's begin.
std::size_t lead_from(const SimulatedRobot& robot, const Stretch& stretch) {
    // no torque path of the catalogue takes longer, and a castor has turned
    constexpr double kRemembered_s = 1;
    if (!remembers(robot.effects)) return stretch.first;
    return stretch.first -
           std::min(stretch.first, static_cast<std::size_t>(kRemembered_s / stretch.log->period_s));
}

}  // namespace

std::optional<SimulatedRobot> simulated_robot(const task::RobotFile& file) {
    const auto known = [&](const char* key) { return file.mass || file.is_given(key); };
    SimulatedRobot robot{file.parameters.geometry, file.parameters.dynamics, file.parameters.effects,
                         known("dynamics.k8_per_kg_m2"), known("dynamics.k7_per_kg_m")};
    if (!robot.turning && !robot.driving) return std::nullopt;
    model::Dynamics<double>& k = robot.dynamics;
    const double track_m = robot.geometry.track_m;
    if (!robot.turning) {
        k.k5_m = k.k6_per_m = 0;
        k.k8_per_kg_m2 = 4 * k.k7_per_kg_m / track_m;
    }
    if (!robot.driving) k.k7_per_kg_m = k.k8_per_kg_m2 * track_m / 4;
    return robot;
}

std::size_t samples_in_step(double period_s, double step_s) {
    return std::max<std::size_t>(1, static_cast<std::size_t>(step_s / period_s + 1e-9));
}

double free_run(const SimulatedRobot& robot, const Stretch& stretch, const WheelPair<double>& start_rad_per_s,
                const TakeSpeeds& take, double step_s) {
    const tools::MeasuredLog& log = *stretch.log;
    sim::PlantParameters parameters = sim::plant_from_dynamics(robot.geometry, robot.dynamics, robot.effects);
    const std::size_t lead = lead_from(robot, stretch);
    parameters.start_s = log.samples[lead].t_s - log.samples.front().t_s;
    parameters.span_s = log.samples.back().t_s - log.samples.front().t_s;
    for (std::size_t i = 0; i < lead; ++i) {
        const WheelPair<double>& from = log.samples[i].speed_rad_per_s;
        const WheelPair<double>& to = log.samples[i + 1].speed_rad_per_s;
        parameters.start_angle_rad.left += log.period_s / 2 * (from.left + to.left);
        parameters.start_angle_rad.right += log.period_s / 2 * (from.right + to.right);
    }
    const Pose<double> pose{0, 0, stretch.heading_rad};
    sim::Plant plant(parameters, pose);
    const auto balanced = [&](const WheelPair<double>& pair) {
        const double mean = pair.sum() / 2;
        return robot.turning ? pair : WheelPair<double>{mean, mean};
    };
    const model::Geometry<double>& geometry = plant.actual().geometry;
    // led along the measured speeds
    const int lead_steps = static_cast<int>(std::ceil(log.period_s / step_s - 1e-9));
    for (std::size_t i = lead; i < stretch.first; ++i) {
        const tools::MeasuredSample& s = log.samples[i];
        plant.place(pose, model::twist_from_wheel_speeds(geometry, balanced(s.speed_rad_per_s)));
        for (int n = 0; n < lead_steps; ++n) plant.advance(log.period_s / lead_steps, balanced(s.torque_Nm));
    }
    const WheelPair<double> slip = balanced(slip_at_start(robot, stretch));
    WheelPair<double> rolls = balanced(start_rad_per_s);
    rolls.left -= slip.left / geometry.wheel_radius_m.left;
    rolls.right -= slip.right / geometry.wheel_radius_m.right;
    // by the radii that it has, not those it is believed to have
    plant.place(pose, model::twist_from_wheel_speeds(geometry, rolls), slip);
    const std::size_t together = samples_in_step(log.period_s, step_s);
    const double period_s = double(together) * log.period_s;
    const int steps = static_cast<int>(std::ceil(period_s / step_s - 1e-9));
    // What the drives would report of it.
    const model::Parameters<double> lag = robot.effects.active[kMeasurementLag]
                                              ? robot.effects.parameter[kMeasurementLag]
                                              : model::Parameters<double>{};
    WheelPair<model::MeasurementLag::Memory<double>> late{{start_rad_per_s.left}, {start_rad_per_s.right}};
    double sum = 0;
    for (std::size_t i = stretch.first; i + together < stretch.end; i += together) {
        WheelPair<double> mean;
        for (std::size_t n = i; n < i + together; ++n) {
            mean.left += log.samples[n].torque_Nm.left / double(together);
            mean.right += log.samples[n].torque_Nm.right / double(together);
        }
        const WheelPair<double> torque = balanced(mean);
        WheelPair<double> simulated;
        for (int s = 0; s < steps; ++s) {
            const double one_s = period_s / steps;
            plant.advance(one_s, torque);
            const WheelPair<double>& is = plant.wheel_speed_rad_per_s();
            simulated = {model::MeasurementLag::report_speed(lag, late.left, is.left, one_s),
                         model::MeasurementLag::report_speed(lag, late.right, is.right, one_s)};
        }
        const WheelPair<double>& measured = log.samples[i + together].speed_rad_per_s;
        sum += std::pow(simulated.left - measured.left, 2) + std::pow(simulated.right - measured.right, 2);
        if (take) take(i + together, simulated);
    }
    return sum;
}

}  // namespace wheelwright::gap
