#include "tools/gap/motions.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "sim_hal/plant.hpp"
#include "tools/gap/gap_search.hpp"

namespace wheelwright::gap {
namespace {

using tools::MeasuredLog;
using tools::MeasuredSample;

// NOLINTBEGIN(readability-magic-numbers): shapes of motions
constexpr std::array<Motion, 6> kMotions{{
    {"creep", "reversals at a creep", 0.15,
     [](double t, double a) {
         const double s = 0.25 * a * (std::fmod(t, 2.0) < 1 ? 1 : -1);
         return WheelPair<double>{s, s};
     }},
    {"coast", "full torque, then coasting", 1,
     [](double t, double a) {
         const double s = t < 2 ? a : 0.0;
         return WheelPair<double>{s, s};
     }},
    {"spin", "spins both ways", 0.7,
     [](double t, double a) {
         const double s = 0.5 * a * (std::fmod(t, 4.0) < 2 ? 1 : -1);
         return WheelPair<double>{-s, s};
     }},
    {"curves", "curves through all headings", 0.6,
     [](double t, double a) {
         return WheelPair<double>{0.3 * a * std::sin(0.9 * t) + 0.04 * a,
                                  0.3 * a * std::sin(0.9 * t) - 0.04 * a};
     }},
    {"three_speeds", "out and back at three speeds", 1,
     [](double t, double a) {
         const double s = a * (0.2 + 0.3 * std::floor(t / 4)) * std::sin(2 * 3.14159265 * t / 4);
         return WheelPair<double>{s, s};
     }},
    {"random", "random torques on each wheel", 0.7,
     [](double t, double a) {
         return WheelPair<double>{0.5 * a * std::sin(7.1 * t) * std::sin(1.3 * t),
                                  0.5 * a * std::sin(5.7 * t + 1) * std::sin(0.9 * t)};
     }},
}};
constexpr double kLargestSize = 4;  // over the torque's rms
constexpr double kSizeRatio = 0.8;
constexpr int kSizes = 18;
constexpr double kFastest = 2;  // wheel speed over its rms
constexpr double kPeriod_s = 0.01;
constexpr int kStepsPerSample = 5;
// NOLINTEND(readability-magic-numbers)

// Empty: faster than it may be.
MeasuredLog simulate(const Confusion& c, const Motion& motion, double size_Nm) {
    sim::Plant plant(sim::plant_from_dynamics(c.setting.geometry, c.setting.dynamics, c.effects));
    MeasuredLog log;
    log.period_s = kPeriod_s;
    for (int i = 0; i <= static_cast<int>(kMotion_s / log.period_s); ++i) {
        MeasuredSample sample;
        sample.t_s = i * log.period_s;
        sample.torque_Nm = motion.torque_Nm(sample.t_s, size_Nm);
        sample.speed_rad_per_s = plant.wheel_speed_rad_per_s();
        for (int n = 0; n < kStepsPerSample; ++n)
            plant.advance(log.period_s / kStepsPerSample, sample.torque_Nm);
        const double fastest =
            std::max(std::abs(sample.speed_rad_per_s.left), std::abs(sample.speed_rad_per_s.right));
        if (fastest > motion.speed_share * kFastest * c.speed_rms_rad_per_s) return {};
        log.samples.push_back(sample);
    }
    return log;
}

// As in the named model where it is one of its members, else with all it can do.
std::vector<Amount> amounts_of(const Dictionary& dictionary, std::size_t effect,
                               const std::vector<Way>& members) {
    if (!dictionary.ways(effect).empty()) return directions(dictionary.ways(effect).back());
    for (const Way& way : members) {
        if (way.effect == effect) return directions(way);
    }
    std::vector<Amount> all;
    for (auto [c, end] = dictionary.linear_columns(effect); c < end; ++c) all.push_back({{c}});
    return all;
}

}  // namespace

std::span<const Motion> motions() { return kMotions; }

const Motion* find_motion(std::string_view name) {
    for (const Motion& motion : kMotions) {
        if (motion.name == name) return &motion;
    }
    return nullptr;
}

Separation separating_motion(const Confusion& c) {
    Separation best;
    double least = 1;
    for (const Motion& motion : kMotions) {
        double size_Nm = kLargestSize * c.torque_rms_Nm;
        MeasuredLog log = simulate(c, motion, size_Nm);
        for (int i = 0; i < kSizes && log.samples.empty(); ++i)
            log = simulate(c, motion, size_Nm *= kSizeRatio);
        if (log.samples.empty()) continue;
        Setting setting = c.setting;
        setting.span_s = kMotion_s;
        const Dictionary dictionary(setting, c.points);
        BlockOptions options;
        options.dictionary = &dictionary;
        options.noise_rad_per_s = c.noise_rad_per_s;
        options.speed_rms_rad_per_s = c.speed_rms_rad_per_s;
        const LogPart part{&log, 0, 0, log.samples.size(), 0};
        BlockSet set = make_blocks(std::array{part}, options);
        if (set.blocks.empty()) continue;
        weigh(set, Colour::white());
        Fit base = c.base;
        base.shape.turning = true;
        base.shape.fixed.clear();
        base.value(3) = c.setting.dynamics.k8_per_kg_m2;
        Blocks blocks;
        for (const Block& block : set.blocks) blocks.push_back(&block);
        const double alike = likeness(blocks, base, amounts_of(dictionary, c.effect, c.members),
                                      amounts_of(dictionary, c.rival, c.members));
        if (alike < least) {
            least = alike;
            best = {&motion, size_Nm};
        }
    }
    return best;
}

}  // namespace wheelwright::gap
