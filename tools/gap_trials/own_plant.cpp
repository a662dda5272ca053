#include "tools/gap_trials/own_plant.hpp"

#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <stdexcept>
#include <string>

#include "sim_hal/plant.hpp"

namespace wheelwright::tools {
namespace {

constexpr std::array kMechanical{"viscous_friction",
                                 "coulomb_friction",
                                 "stribeck_friction",
                                 "quadratic_drag",
                                 "turning_scrub",
                                 "castor_drag",
                                 "slope",
                                 "cog_lateral",
                                 "wheel_radius_mismatch",
                                 "wheel_slip",
                                 "payload_step"};
constexpr double kTurning_rad_per_s = 1e-3;

sim::PlantParameters parameters_of(const hidden::Robot& robot, const hidden::HiddenSet& hidden) {
    model::EffectSet<double> effects;
    for (const char* name : kMechanical) {
        const hidden::HiddenEffect* effect = hidden.find(name);
        if (effect == nullptr) continue;
        const std::size_t index = model::find_effect(name);
        if (index == model::kEffectCount)
            throw std::runtime_error("no effect of the catalogue: " + effect->name);
        effects.active[index] = true;
        const auto& parameters = model::kEffects[index].parameters;
        for (std::size_t j = 0; j < parameters.size(); ++j) {
            // 0 where the hidden law has none of it: a load is put onto the centre of gravity
            const auto hidden_value = effect->parameters.find(parameters[j].name);
            if (hidden_value != effect->parameters.end()) effects.parameter[index][j] = hidden_value->second;
        }
    }
    // The catalogue takes a usual share of what the motors move for the wheels' rotation (slope.hpp).
    constexpr std::size_t kSlope = model::find_effect("slope");
    double& angle_rad = effects.parameter[kSlope][0];
    angle_rad = std::asin(std::sin(angle_rad) * robot.mass_kg /
                          ((1 - model::kRotationShare) * robot.effective_mass_kg()));
    // motors behind backlash are no part of what the arriving torque moves
    double wheel_inertia_kg_m2 = robot.wheel_inertia_kg_m2;
    if (const hidden::HiddenEffect* backlash = hidden.find("backlash"))
        wheel_inertia_kg_m2 -= (*backlash)["motor_inertia_kg_m2"];
    return sim::plant_from_mass(
        {{robot.wheel_radius_m, robot.wheel_radius_m}, robot.track_m},
        {robot.mass_kg, robot.yaw_inertia_kg_m2, robot.cog_ahead_m, wheel_inertia_kg_m2}, effects);
}

class OwnPlant final : public hidden::Plant {
  public:
    OwnPlant(const hidden::Robot& robot, const hidden::HiddenSet& hidden)
        : robot_(robot), hidden_(hidden), plant_(parameters_of(robot, hidden)) {}

    hidden::PlantState state() const override {
        hidden::PlantState s;
        const WheelPair<double>& speed = plant_.wheel_speed_rad_per_s();
        const WheelPair<double>& angle = plant_.wheel_angle_rad();
        s.wheel_speed_rad_per_s = {speed.left, speed.right};
        s.wheel_angle_rad = {angle.left, angle.right};
        s.speed_m_per_s = plant_.twist().v_m_per_s;
        s.yaw_rate_rad_per_s = plant_.twist().omega_rad_per_s;
        s.heading_rad = plant_.pose().heading_rad;
        s.x_m = plant_.pose().x_m;
        s.y_m = plant_.pose().y_m;
        return s;
    }

    double kinetic_energy_J() const override { return plant_.kinetic_energy_J(); }

    void advance(double step_s, const hidden::Pair& torque_Nm) override {
        plant_.advance(step_s, {torque_Nm.left, torque_Nm.right});
        ++steps_;
        const WheelPair<double>& speed = plant_.wheel_speed_rad_per_s();
        const WheelPair<double> slip = plant_.slip_m_per_s();
        travelled_m_ += robot_.wheel_radius_m * (std::abs(speed.left) + std::abs(speed.right)) * step_s;
        slipped_m_ += (std::abs(slip.left) + std::abs(slip.right)) * step_s;
        add_squares();
    }

    double effect_rms_Nm(std::string_view effect) const override {
        const auto found = squares_.find(effect);
        return found == squares_.end() || steps_ == 0 ? 0 : std::sqrt(found->second / (2 * steps_));
    }
    double slipped_m() const override { return slipped_m_; }
    double travelled_m() const override { return travelled_m_; }

  private:
    // Sizes by the effects' definitions in hidden/effects.hpp's table, both wheels.
    void add_squares() {
        const hidden::PlantState now = state();
        const std::array<double, 2> speed{now.wheel_speed_rad_per_s.left, now.wheel_speed_rad_per_s.right};
        const std::array<const char*, 2> viscous{"left_Nm_s_per_rad", "right_Nm_s_per_rad"};
        const std::array<const char*, 2> coulomb{"left_Nm", "right_Nm"};
        for (const hidden::HiddenEffect& effect : hidden_.effects) {
            double& sum = squares_[effect.name];
            // of a force along the robot and a moment, on both wheels
            const auto of_body = [&](double force_N, double moment_Nm) {
                const double common = force_N * robot_.wheel_radius_m / 2;
                const double difference = moment_Nm * robot_.wheel_radius_m / robot_.track_m;
                return 2 * (common * common + difference * difference);
            };
            if (effect.name == "quadratic_drag") {
                sum += of_body(effect["drag_N_s2_per_m2"] * now.speed_m_per_s * now.speed_m_per_s, 0);
            } else if (effect.name == "turning_scrub") {
                if (std::abs(now.yaw_rate_rad_per_s) > kTurning_rad_per_s)
                    sum += of_body(0, effect["scrub_Nm"]);
            } else if (effect.name == "castor_drag") {
                // no other effect has dry or smooth torques where a castor is hidden
                const sim::PlantTorques torques = plant_.torques();
                sum += std::pow(torques.dry_effects_Nm.left + torques.smooth_effects_Nm.left, 2) +
                       std::pow(torques.dry_effects_Nm.right + torques.smooth_effects_Nm.right, 2);
            }
            for (std::size_t side = 0; side < 2; ++side) {
                const bool turns = std::abs(speed[side]) > kTurning_rad_per_s;
                if (effect.name == "viscous_friction") {
                    sum += std::pow(effect[viscous[side]] * speed[side], 2);
                } else if (effect.name == "coulomb_friction" && turns) {
                    sum += std::pow(effect[coulomb[side]], 2);
                } else if (effect.name == "stribeck_friction" && turns) {
                    const double ratio = speed[side] / effect["stribeck_rad_per_s"];
                    const double dry = effect["coulomb_Nm"] + (effect["static_Nm"] - effect["coulomb_Nm"]) *
                                                                  std::exp(-ratio * ratio);
                    sum += dry * dry;
                }
            }
        }
    }

    hidden::Robot robot_;
    const hidden::HiddenSet& hidden_;
    sim::Plant plant_;
    double steps_ = 0;
    double travelled_m_ = 0;
    double slipped_m_ = 0;
    std::map<std::string, double, std::less<>> squares_;
};

}  // namespace

std::unique_ptr<hidden::Plant> make_own_plant(const hidden::Robot& robot, const hidden::HiddenSet& hidden) {
    return std::make_unique<OwnPlant>(robot, hidden);
}

}  // namespace wheelwright::tools
