#include "tools/gap_trials/hidden/plan.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <map>

namespace wheelwright::hidden {
namespace {

constexpr int kRobotsPerCell = 5;
constexpr int kRobotsPerPair = 10;
constexpr int kNothing = 300;
constexpr int kRobotsPerBlind = 10;

constexpr std::array<std::pair<std::string_view, std::string_view>, 16> kPairs{{
    {"viscous_friction", "coulomb_friction"},
    {"viscous_friction", "transport_delay"},
    {"viscous_friction", "slope"},
    {"coulomb_friction", "actuator_lag"},
    {"coulomb_friction", "torque_gain_mismatch"},
    {"coulomb_friction", "torque_bias"},
    {"coulomb_friction", "cog_lateral"},
    {"coulomb_friction", "turning_scrub"},
    {"stribeck_friction", "transport_delay"},
    {"quadratic_drag", "coulomb_friction"},
    {"dead_zone", "viscous_friction"},
    {"torque_saturation", "viscous_friction"},
    {"payload_step", "coulomb_friction"},
    {"gain_drift", "coulomb_friction"},
    {"torque_ripple", "viscous_friction"},
    {"wheel_radius_mismatch", "coulomb_friction"},
}};

struct Blind {
    std::string_view effect;
    Motion motion;
};
constexpr std::array kBlind{
    Blind{"quadratic_drag", Motion::spin},
    Blind{"slope", Motion::straight},
    Blind{"turning_scrub", Motion::spin},
    Blind{"castor_drag", Motion::straight},
    Blind{"torque_bias", Motion::straight},
    Blind{"coulomb_friction", Motion::spin},
    Blind{"viscous_friction", Motion::spin},
    Blind{"cog_lateral", Motion::straight},
    Blind{"torque_gain_mismatch", Motion::straight},
    Blind{"back_emf_limit", Motion::straight},
    Blind{"dead_zone", Motion::spin},
    Blind{"wheel_radius_mismatch", Motion::straight},
};

}  // namespace

std::span<const std::pair<std::string_view, std::string_view>> tried_pairs() { return kPairs; }

std::vector<ListedTrial> all_trials(std::uint64_t seed, const std::vector<std::string>& plants) {
    std::vector<ListedTrial> trials;
    constexpr std::array kSizes{Size::mild, Size::medium, Size::strong};
    for (const std::string& plant : plants) {
        const auto add = [&](Kind kind, std::vector<std::string> effects, std::vector<Size> sizes,
                             std::size_t noise, std::vector<Motion> motions = {}) {
            TrialPlan plan;
            plan.kind = kind;
            plan.effects = std::move(effects);
            plan.sizes = std::move(sizes);
            plan.noise = noise;
            plan.seed = seed;
            plan.stream = trials.size() + 1;
            plan.motions = std::move(motions);
            std::array<char, 24> name{};
            Random random(seed, plan.stream * 4 + 3);
            std::snprintf(name.data(), name.size(), "log-%010llx",
                          static_cast<unsigned long long>(random.bits() >> 24U));
            plan.id = name.data();
            trials.push_back({std::move(plan), plant});
        };
        for (const EffectInfo& effect : all_effects()) {
            for (const Size size : kSizes) {
                for (std::size_t noise = 0; noise < kNoises.size(); ++noise) {
                    for (int i = 0; i < kRobotsPerCell; ++i) {
                        add(effect.fault_of_log ? Kind::fault : Kind::single, {std::string(effect.name)},
                            {size}, noise);
                    }
                }
            }
        }
        for (std::size_t p = 0; p < kPairs.size(); ++p) {
            for (int i = 0; i < kRobotsPerPair; ++i) {
                Random random(seed, 1'000'000 + trials.size());
                const auto size = [&] { return random.chance(0.5) ? Size::medium : Size::strong; };
                const Size first = size();
                const Size second = size();
                add(Kind::pair, {std::string(kPairs[p].first), std::string(kPairs[p].second)},
                    {first, second}, random.below(kNoises.size()));
            }
        }
        for (int i = 0; i < kNothing; ++i) {
            add(Kind::nothing, {}, {}, static_cast<std::size_t>(i) % kNoises.size());
        }
        for (const Blind& blind : kBlind) {
            for (int i = 0; i < kRobotsPerBlind; ++i) {
                add(Kind::blind, {std::string(blind.effect)},
                    {kSizes[static_cast<std::size_t>(i) % kSizes.size()]},
                    static_cast<std::size_t>(i) % kNoises.size(), {blind.motion});
            }
        }
    }
    return trials;
}

std::vector<ListedTrial> sample_of(std::vector<ListedTrial> trials, std::size_t count, std::uint64_t seed) {
    if (count >= trials.size()) return trials;
    // The list is in the order of kinds: an even comb with a drawn beginning, jittered within its teeth.
    Random random(seed, 7'777'777);
    std::vector<ListedTrial> sample;
    const double tooth = static_cast<double>(trials.size()) / static_cast<double>(count);
    std::size_t next = 0;  // none is drawn twice where teeth meet
    for (std::size_t i = 0; i < count; ++i) {
        const double at = (static_cast<double>(i) + random.uniform()) * tooth;
        const std::size_t left = count - i;
        const std::size_t drawn = std::clamp(static_cast<std::size_t>(at), next, trials.size() - left);
        sample.push_back(std::move(trials[drawn]));
        next = drawn + 1;
    }
    return sample;
}

namespace {

// Of one plant.
std::vector<ListedTrial> every_effect_on_one(std::vector<ListedTrial> trials, std::uint64_t seed) {
    constexpr std::size_t kOfEachOtherKind = 4;
    constexpr std::size_t kMiddleNoise = 1;
    // Trials of which one is drawn, by kind.
    std::map<Kind, std::map<std::vector<std::string>, std::vector<ListedTrial>>> groups;
    std::vector<ListedTrial> nothing;
    for (ListedTrial& trial : trials) {
        const TrialPlan& plan = trial.plan;
        const bool one_effect = plan.kind == Kind::single || plan.kind == Kind::fault;
        if (one_effect && (plan.noise != kMiddleNoise || plan.sizes.front() == Size::mild)) continue;
        if (plan.kind == Kind::nothing) {
            nothing.push_back(std::move(trial));
        } else {
            groups[plan.kind][plan.effects].push_back(std::move(trial));
        }
    }
    Random random(seed, 7'777'778);
    const auto take_one = [&](auto& list) {
        const auto at = list.begin() + static_cast<std::ptrdiff_t>(random.below(list.size()));
        auto taken = std::move(*at);
        list.erase(at);
        return taken;
    };
    std::vector<ListedTrial> sample;
    for (const Kind kind : {Kind::single, Kind::pair, Kind::nothing, Kind::fault, Kind::blind}) {
        if (kind == Kind::nothing) {
            for (std::size_t i = 0; i < kOfEachOtherKind; ++i) sample.push_back(take_one(nothing));
            continue;
        }
        std::vector<std::vector<ListedTrial>> left;
        for (auto& [effects, group] : groups[kind]) left.push_back(std::move(group));
        const bool all = kind == Kind::single || kind == Kind::fault;
        const std::size_t count = all ? left.size() : kOfEachOtherKind;
        for (std::size_t i = 0; i < count; ++i) {
            std::vector<ListedTrial> group = take_one(left);
            sample.push_back(take_one(group));
        }
    }
    return sample;
}

}  // namespace

std::vector<ListedTrial> every_effect_of(std::vector<ListedTrial> trials, std::uint64_t seed) {
    std::map<std::string, std::vector<ListedTrial>> by_plant;
    for (ListedTrial& trial : trials) by_plant[trial.plant].push_back(std::move(trial));
    std::vector<ListedTrial> sample;
    for (auto& [plant, list] : by_plant) {
        for (ListedTrial& trial : every_effect_on_one(std::move(list), seed))
            sample.push_back(std::move(trial));
    }
    return sample;
}

}  // namespace wheelwright::hidden
