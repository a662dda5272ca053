#include "tools/gap/inference/separating_motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "sim_hal/plant.hpp"
#include "tools/gap/inference/policy.hpp"

namespace wheelwright::gap {
namespace {

using tools::MeasuredLog;
using tools::MeasuredSample;

constexpr double kLargestSize = 4;  // over the torque's rms
constexpr double kSizeRatio = 0.8;
constexpr int kSizes = 18;
constexpr double kFastest = 2;  // wheel speed over its rms
constexpr double kPeriod_s = 0.01;
constexpr int kStepsPerSample = 5;
constexpr std::size_t kSamples = std::size_t(excite::kMotion_s / kPeriod_s);
constexpr std::array kShares{1.0, 0.6};     // of the largest size
constexpr std::size_t kLeastSamples = 300;  // that a motion lasts at least
constexpr double kLeastDifference = 12;     // between the two, in variances of the noise: no motion else

// Ends where the robot gets faster than it may.
MeasuredLog simulate(const Confusion& c, const excite::Motion& motion, double size_Nm) {
    sim::Plant plant(sim::plant_from_dynamics(c.setting.geometry, c.setting.dynamics, c.effects));
    MeasuredLog log;
    log.period_s = kPeriod_s;
    for (std::size_t i = 0; i <= kSamples; ++i) {
        MeasuredSample sample;
        sample.t_s = double(i) * log.period_s;
        sample.torque_Nm = motion.torque_Nm(sample.t_s, size_Nm);
        sample.speed_rad_per_s = plant.wheel_speed_rad_per_s();
        for (int n = 0; n < kStepsPerSample; ++n)
            plant.advance(log.period_s / kStepsPerSample, sample.torque_Nm);
        const double fastest =
            std::max(std::abs(sample.speed_rad_per_s.left), std::abs(sample.speed_rad_per_s.right));
        if (fastest > motion.speed_share * kFastest * c.speed_rms_rad_per_s) break;
        log.samples.push_back(sample);
    }
    return log;
}

// As in the named model where it is one of its members, else with all it can do.
Candidate candidate_of(const Dictionary& dictionary, std::size_t effect,
                       const std::vector<Candidate>& members) {
    if (!dictionary.candidates(effect).empty()) return dictionary.candidates(effect).back();
    for (const Candidate& candidate : members) {
        if (candidate.effect == effect) return candidate;
    }
    Candidate all;
    all.effect = effect;
    for (auto [c, end] = dictionary.linear_columns(effect); c < end; ++c) all.amounts.push_back({{c}});
    return all;
}

// With `effect` in the place of the one named.
Fit fit_with(const Blocks& blocks, const Dictionary& dictionary, const Confusion& c, std::size_t effect) {
    Members members;
    for (const Candidate& member : c.members) {
        if (member.effect != c.effect && member.effect != effect)
            members.push_back(candidate_of(dictionary, member.effect, c.members));
    }
    members.push_back(candidate_of(dictionary, effect, c.members));
    return fit(blocks, shape_of(members, true));
}

// Grids, which are most of the work, only where a rival is known by nothing else.
Dictionary dictionary_for(const Confusion& c, const Setting& setting) {
    Dictionary dictionary(setting, c.points, false);
    const auto [first, end] = dictionary.linear_columns(c.rival);
    if (first == end && dictionary.candidates(c.rival).empty()) return {setting, c.points};
    return dictionary;
}

// How clearly a simulated log tells the one named from its rival: how much more the rival leaves, against all
// that hides it. That is noise; what stays although the named one is there (friction that holds a wheel is in
// no column); and the share of the torque below which nothing is of interest.
double clearness(const Confusion& c, const MeasuredLog& log) {
    Setting setting = c.setting;
    setting.span_s = excite::kMotion_s;
    const Dictionary dictionary = dictionary_for(c, setting);
    BlockOptions options;
    options.dictionary = &dictionary;
    options.noise_rad_per_s = c.noise_rad_per_s;
    options.speed_rms_rad_per_s = c.speed_rms_rad_per_s;
    const LogPart part{&log, 0, 0, log.samples.size(), 0};
    BlockSet set = make_blocks(std::array{part}, options);
    if (set.blocks.empty()) return 0;
    weigh(set, Colour{});
    Blocks blocks;
    double rows = 0;
    for (const Block& block : set.blocks) {
        blocks.push_back(&block);
        for (const int count : block.rows) rows += count;
    }
    const Fit named = fit_with(blocks, dictionary, c, c.effect);
    const double difference = fit_with(blocks, dictionary, c, c.rival).squares - named.squares;
    if (difference < kLeastDifference) return 0;
    return difference /
           (rows + named.squares + kPolicy.effect * kPolicy.effect * torque_squares(blocks, named));
}

}  // namespace

Separation separating_motion(const Confusion& c) {
    Separation best;
    double most = 0;
    for (const excite::Motion& motion : excite::motions()) {
        // The largest with which the robot stays slow enough. With a bias or on a slope it may roll away
        // whatever the size: then the round ends early.
        double size_Nm = kLargestSize * c.torque_rms_Nm;
        MeasuredLog log = simulate(c, motion, size_Nm);
        for (int i = 0; i < kSizes && log.samples.size() <= kSamples; ++i)
            log = simulate(c, motion, size_Nm *= kSizeRatio);
        if (log.samples.size() <= kSamples) size_Nm = c.torque_rms_Nm;
        // What does not grow with the torque shows better in a slower motion.
        for (const double share : kShares) {
            log = simulate(c, motion, share * size_Nm);
            if (log.samples.size() < kLeastSamples) continue;
            const double clear = clearness(c, log);
            if (clear > most) {
                most = clear;
                best = {&motion, share * size_Nm};
            }
        }
    }
    return best;
}

}  // namespace wheelwright::gap
