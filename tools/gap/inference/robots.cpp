#include "tools/gap/inference/robots.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <optional>

#include "tools/gap/hypotheses/hypotheses.hpp"
#include "tools/gap/inference/evidence.hpp"
#include "tools/gap/inference/outcome.hpp"
#include "tools/gap/inference/statistics.hpp"
#include "tools/gap/model/output_error.hpp"

namespace wheelwright::gap {
namespace {

constexpr double kShot_s = 5;
constexpr double kSmall = 0.02;                             // of the speeds
constexpr Eigen::Index kFirstOfMembers = kFirstAmount + 1;  // after the timing

double mean_of(const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0) / double(values.size());
}

double straight_k8_per_kg_m2(double k7_per_kg_m, double track_m) { return 4 * k7_per_kg_m / track_m; }

// The parameters of an effect as its amounts count them.
model::Parameters<double> coordinates_of(std::size_t effect, model::Parameters<double> parameters) {
    std::array<bool, model::kEffectCount> one{};
    one[effect] = true;
    model::for_each_active(one, [&]<typename Effect>(std::size_t) {
        if constexpr (model::HasOwnCoordinates<Effect>) parameters = Effect::coordinates(parameters);
    });
    return parameters;
}

}  // namespace

model::Dynamics<double> dynamics_of(const Fit& fit, bool turning, double track_m) {
    model::Dynamics<double> k{fit.value(0), fit.value(1), fit.value(2), fit.value(3)};
    if (!turning) {
        k.k5_m = k.k6_per_m = 0;
        k.k8_per_kg_m2 = straight_k8_per_kg_m2(k.k7_per_kg_m, track_m);
    }
    return k;
}

model::Dynamics<double> whole_dynamics(const Fit& fit, std::span<const std::string> unknowable, bool turning,
                                       double track_m) {
    model::Dynamics<double> k = dynamics_of(fit, turning, track_m);
    const auto unknown = [&](const char* name) {
        return std::find(unknowable.begin(), unknowable.end(), name) != unknowable.end();
    };
    if (unknown("K5") || unknown("K6")) k.k5_m = k.k6_per_m = 0;
    if (unknown("K7")) {
        k.k7_per_kg_m = k.k8_per_kg_m2 * track_m / 4;
    } else if (unknown("K8")) {
        k.k8_per_kg_m2 = straight_k8_per_kg_m2(k.k7_per_kg_m, track_m);
    }
    return k;
}

SimulatedRobot robot_of(const std::vector<Candidate>& members, const Fit& fit, const Setting& setting,
                        bool turning) {
    return {setting.geometry, dynamics_of(fit, turning, setting.geometry.track_m),
            effects_of(members, fit, setting), turning};
}

std::vector<Candidate> base_members(const Search& search) {
    return {search.members.begin(), search.members.begin() + std::ptrdiff_t(search.base_members)};
}

Search refined(const Search& search, std::span<const LogPart> parts, const Setting& setting, bool turning,
               double speed_rms_rad_per_s) {
    // What has a state of its own (a castor's direction, a gap's side) cannot start in the middle of a log.
    const bool stateless =
        std::all_of(search.members.begin(), search.members.end(),
                    [](const Candidate& candidate) { return candidate.kind == Candidate::Kind::linear; });
    if (!stateless) return search;
    const std::vector<Stretch> shots = stretches(parts, kShot_s, setting.geometry);
    const auto by_free_run = [&](const Fit& weak, const std::vector<Candidate>& members) {
        return refine_by_free_run(weak, shots, kSmall * speed_rms_rad_per_s, [&](const Fit& trial) {
            return robot_of(members, trial, setting, turning);
        });
    };
    Search result = search;
    if (const std::optional<Refined> base = by_free_run(search.base, base_members(search)))
        result.base = base->fit;
    if (search.effects.empty()) {
        result.after = result.base;
    } else if (const std::optional<Refined> after = by_free_run(search.after, search.members)) {
        result.after = after->fit;
        result.effects = described_anew(result, setting);
    }
    result.unknowable = unknowable(result.after, turning);
    return result;
}

FreeRunsSay by_free_runs(const Search& search, const Blocks& train, std::span<const LogPart> parts,
                         const Setting& setting, bool turning) {
    constexpr double kFreeStep_s = 0.001;
    constexpr double kFreeShot_s = 2;  // in a longer one the wheels' angles stray, by which a ripple counts
    const std::vector<Stretch> shots = stretches(parts, kFreeShot_s, setting.geometry);
    // Of each shot, as a logarithm: where the robot stops or runs away a shot misses many times what the
    // others do, whatever the model, and must not outvote them.
    const auto missed = [&](const Members& members, const Fit& fit) {
        const SimulatedRobot robot = robot_of(members, fit, setting, turning);
        std::vector<double> each;
        for (const Stretch& shot : shots) {
            // Without the mean: a memory is empty where a shot begins, and the measured start is noisy, and
            // speeds may keep that.
            WheelPair<double> mean;
            double samples = 0;
            const double squares = free_run(
                robot, shot, shot.log->samples[shot.first].speed_rad_per_s,
                [&](std::size_t i, const WheelPair<double>& w) {
                    mean.left += w.left - shot.log->samples[i].speed_rad_per_s.left;
                    mean.right += w.right - shot.log->samples[i].speed_rad_per_s.right;
                    ++samples;
                },
                kFreeStep_s);
            each.push_back(
                std::log(std::max(std::numeric_limits<double>::min(),
                                  squares - (mean.left * mean.left + mean.right * mean.right) / samples)));
        }
        return each;
    };
    FreeRunsSay say;
    std::vector<double> with_all;
    for (std::size_t i = search.base_members; i < search.members.size(); ++i) {
        if (is_usual_friction(search.members[i].effect) || search.is_shown(search.members[i].effect))
            continue;
        // held against a drive train with its usual friction, where it has taken the place of that
        Members fewer = without(search.members, i);
        for (const Candidate& candidate : search.friction) {
            if (!contains(fewer, candidate.effect)) fewer.push_back(candidate);
        }
        const bool instead = fewer.size() >= search.members.size();
        if (with_all.empty()) with_all = missed(search.members, search.after);
        std::vector<double> closer = missed(fewer, fit(train, shape_of(fewer, turning), Spread::none));
        const double without_it = mean_of(closer);
        if (!std::isfinite(without_it)) continue;  // one that runs away is no number
        // friction in its place is likelier, unless it does better
        if (!(mean_of(with_all) < without_it + (instead ? 0 : kPolicy.better_by))) {
            say.no_better = search.members[i].effect;
            break;
        }
        for (std::size_t s = 0; s < closer.size(); ++s) closer[s] -= with_all[s];
        if (signed_rank_probability(closer) > kPolicy.kept) say.unsure.push_back(search.members[i].effect);
    }
    return say;
}

Fit nominal_fit(const Search& search, const model::RobotParameters& robot) {
    Fit nominal = search.base;
    nominal.value.setZero();
    const model::Dynamics<double>& k = robot.dynamics;
    nominal.value.head<4>() << k.k5_m, k.k6_per_m, k.k7_per_kg_m, k.k8_per_kg_m2;
    Eigen::Index at = kFirstOfMembers;
    for (const Candidate& candidate : base_members(search)) {
        const model::Parameters<double> c =
            coordinates_of(candidate.effect, robot.effects.parameter[candidate.effect]);
        for (std::size_t i = 0; i < candidate.amounts.size(); ++i, ++at) {
            // a point is the robot file's own
            if (candidate.kind == Candidate::Kind::linear) nominal.value(at) = c[candidate.coordinate[i]];
        }
    }
    return nominal;
}

}  // namespace wheelwright::gap
