#include "tests/tools/gap/hidden_effect.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <stdexcept>

#include "sim_hal/plant.hpp"

namespace wheelwright::test {
namespace {

struct Drawn {
    sim::PlantParameters plant;
    double noise_rad_per_s, duration_s, rate_Hz;
    std::uint64_t seed;
    bool straight;
    double share = 0;  // of the effects' torque
};

tools::MeasuredLog drive(Drawn& drawn) {
    std::mt19937_64 random(drawn.seed * 77777 + 5);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform(-1, 1);
    sim::Plant plant(drawn.plant);
    tools::MeasuredLog log;
    log.period_s = 1 / drawn.rate_Hz;
    const int steps = std::max(1, static_cast<int>(std::lround(log.period_s / 0.0005)));
    double v = 0, omega = 0, change_s = 0, bit_s = 0, effect_power = 0, torque_power = 0;
    WheelPair<double> bits;
    const auto samples = static_cast<int>(drawn.duration_s * drawn.rate_Hz);
    for (int i = 0; i <= samples; ++i) {
        const double t = i * log.period_s;
        if (t >= change_s) {
            v = 1.2 * uniform(random);
            omega = 2.5 * uniform(random);
            if (uniform(random) < -0.6) omega = 0;
            if (uniform(random) < -0.7) v = 0;
            change_s = t + 0.7 + 0.6 * uniform(random);
        }
        if (t >= bit_s) {
            if (drawn.straight) {
                omega = 0;
                bits.left = bits.right = uniform(random) < 0 ? -0.5 : 0.5;
            } else
                bits = {uniform(random) < 0 ? -0.5 : 0.5, uniform(random) < 0 ? -0.5 : 0.5};
            bit_s = t + 0.06;
        }
        tools::MeasuredSample s;
        s.t_s = t;
        const Twist<double> now = plant.twist();
        const double forward = 2.5 * (v - now.v_m_per_s);
        const double turn = drawn.straight ? 0.0 : 0.6 * (omega - now.omega_rad_per_s);
        s.torque_Nm = {std::clamp(forward - turn + bits.left, -3.0, 3.0),
                       std::clamp(forward + turn + bits.right, -3.0, 3.0)};
        const WheelPair<double>& w = plant.wheel_speed_rad_per_s();
        s.speed_rad_per_s = {w.left + drawn.noise_rad_per_s * normal(random),
                             w.right + drawn.noise_rad_per_s * normal(random)};
        s.gyro_rad_per_s = now.omega_rad_per_s + 0.005 * normal(random);
        log.samples.push_back(s);
        for (int n = 0; n < steps; ++n) {
            plant.advance(log.period_s / steps, s.torque_Nm);
            const sim::PlantTorques acting = plant.torques();
            for (const auto side : {&WheelPair<double>::left, &WheelPair<double>::right}) {
                effect_power += std::pow(acting.smooth_effects_Nm.*side + acting.dry_effects_Nm.*side +
                                             acting.motor_Nm.*side - s.torque_Nm.*side,
                                         2);
                torque_power += std::pow(s.torque_Nm.*side, 2);
            }
        }
    }
    drawn.share = std::sqrt(effect_power / torque_power);
    return log;
}

}  // namespace

HiddenLog hidden_log(const HiddenEffect& effect, std::uint64_t seed, double noise_rad_per_s,
                     double duration_s, double rate_Hz, bool straight) {
    std::mt19937_64 random(seed * 1234567 + 11);
    std::uniform_real_distribution<double> near(0.92, 1.08);
    HiddenLog made;
    const double radius = 0.082 * near(random);
    made.geometry = {{radius, radius}, 0.41 * near(random)};
    model::Dynamics<double> k;
    k.k5_m = 0.055 * near(random);
    k.k7_per_kg_m = 0.93 * near(random);
    k.k8_per_kg_m2 = 4.4 * near(random);
    k.k6_per_m = model::coupled_k6(k.k5_m, k.k7_per_kg_m, k.k8_per_kg_m2, made.geometry.track_m);
    model::EffectSet<double> effects;
    made.parameters = effect.parameters;
    const std::size_t i = model::find_effect(effect.name);
    if (!effect.name.empty()) {
        if (i == model::kEffectCount) throw std::runtime_error("no effect is called " + effect.name);
        effects.active[i] = true;
    }
    for (int pass = 0; pass < 4; ++pass) {
        if (!effect.name.empty()) effects.parameter[i] = made.parameters;
        Drawn drawn{sim::plant_from_dynamics(made.geometry, k, effects),
                    noise_rad_per_s,
                    duration_s,
                    rate_Hz,
                    seed,
                    straight};
        made.log = drive(drawn);
        if (effect.torque_share == 0 || effect.name.empty() ||
            std::abs(drawn.share / effect.torque_share - 1) < 0.03)
            break;
        for (double& p : made.parameters) p *= effect.torque_share / drawn.share;
    }
    made.log.has_gyro = true;
    return made;
}

void write_csv(const tools::MeasuredLog& log, const std::string& path) {
    std::FILE* file = std::fopen(path.c_str(), "w");
    if (file == nullptr) throw std::runtime_error("cannot write " + path);
    std::fputs("t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s,gyro_z_rad_s\n", file);
    for (const tools::MeasuredSample& s : log.samples) {
        std::fprintf(file, "%.6f,%.8g,%.8g,%.8g,%.8g,%.8g\n", s.t_s, s.torque_Nm.left, s.torque_Nm.right,
                     s.speed_rad_per_s.left, s.speed_rad_per_s.right, s.gyro_rad_per_s);
    }
    std::fclose(file);
}

}  // namespace wheelwright::test
