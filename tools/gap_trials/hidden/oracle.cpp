#include "tools/gap_trials/hidden/oracle.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>

#include "tools/gap_trials/hidden/oracle_fit.hpp"
#include "tools/gap_trials/hidden/oracle_views.hpp"

namespace wheelwright::hidden {
namespace {

// The rule of oracle.hpp.
constexpr double kEnough = 50;
constexpr double kShare = 0.0005;

using Parameters = std::map<std::string, double, std::less<>>;

// Where the only nonlinear parameter of an effect is searched.
struct Range {
    enum class Unit { one, peak_torque, duration };
    enum class Scale { linear, logarithmic };

    std::string_view effect;
    const char* parameter;
    double low, high;
    Unit unit;
    Scale scale;
    int points;

    double at(double share, const CleanLog& log) const {
        double one = 1;
        if (unit == Unit::peak_torque) one = log.peak_torque_Nm;
        if (unit == Unit::duration) one = log.duration_s;
        const double from = low * one;
        const double to = high * one;
        return scale == Scale::logarithmic ? from * std::pow(to / from, share) : from + (to - from) * share;
    }
};
using enum Range::Unit;
using enum Range::Scale;
constexpr std::array kRanges{
    Range{"actuator_lag", "time_constant_s", 0.002, 0.08, one, logarithmic, 6},
    Range{"transport_delay", "delay_s", 0.0005, 0.03, one, logarithmic, 6},
    Range{"measurement_lag", "time_constant_s", 0.003, 0.2, one, logarithmic, 6},
    Range{"dead_zone", "width_Nm", 0.01, 0.4, peak_torque, logarithmic, 6},
    Range{"torque_saturation", "limit_Nm", 0.3, 0.98, peak_torque, linear, 7},
    Range{"wheel_radius_mismatch", "relative", -0.12, 0.12, one, linear, 7},
    Range{"payload_step", "time_s", 0.1, 0.9, duration, linear, 9},
    Range{"stribeck_friction", "stribeck_rad_per_s", 0.3, 4, one, logarithmic, 4},
};

// The values that are tried of an effect whose parameters come together, or jump. Empty: it has none but
// linear ones.
std::vector<Parameters> tried(std::string_view effect, const CleanLog& log) {
    std::vector<Parameters> all;
    if (effect == "torque_ripple") {
        for (int order = 1; order <= 14; ++order) all.push_back({{"order", order}});
    }
    if (effect == "gain_drift") {
        for (const double share : {0.0, 0.1, 0.2, 0.35, 0.6}) {
            all.push_back({{"time_constant_s", share * log.duration_s}});
        }
    }
    if (effect == "back_emf_limit") {
        for (const double stall : {0.35, 0.5, 0.7, 0.85, 1.0, 1.2}) {
            for (const double speed : {1.1, 1.4, 2.0, 3.0}) {
                all.push_back({{"stall_Nm", stall * log.peak_torque_Nm},
                               {"no_load_rad_per_s", speed * log.peak_speed_rad_per_s}});
            }
        }
    }
    if (effect == "castor_drag") {
        for (const double trail_m : {0.022, 0.03, 0.038}) {
            all.push_back({{"arm_m", log.castor_ahead_m}, {"trail_m", trail_m}});
        }
    }
    if (effect == "backlash") {
        for (const double gap : {0.006, 0.012, 0.025, 0.05, 0.09}) {
            all.push_back({{"half_gap_rad", gap}, {"motor_inertia_kg_m2", log.wheel_inertia_kg_m2 / 2}});
        }
    }
    return all;
}

// The smallest over a range's points, and between the best one's neighbours by golden sections.
template <typename Left>
double least_along(const Range& range, const CleanLog& log, Left left_with) {
    constexpr int kSections = 5;
    const auto left_at = [&](double share) { return left_with({{range.parameter, range.at(share, log)}}); };
    const double intervals = range.points - 1.0;
    double least = std::numeric_limits<double>::infinity();
    int where = 0;
    for (int i = 0; i < range.points; ++i) {
        const double left = left_at(i / intervals);
        if (left < least) {
            least = left;
            where = i;
        }
    }
    double from = std::max(0, where - 1) / intervals;
    double to = std::min(range.points - 1, where + 1) / intervals;
    for (int i = 0; i < kSections; ++i) {
        const double a = from + (to - from) * 0.382;
        const double b = from + (to - from) * 0.618;
        const double at_a = left_at(a);
        const double at_b = left_at(b);
        least = std::min({least, at_a, at_b});
        (at_a < at_b ? to : from) = at_a < at_b ? b : a;
    }
    return least;
}

// What an effect leaves beside `partners` at its best, its nonlinear parameters searched.
double least_unexplained(const CleanLog& log, std::string_view effect,
                         const std::vector<Candidate>& partners) {
    const auto left_with = [&](const Parameters& parameters) {
        std::vector<Candidate> all = partners;
        all.push_back({std::string(effect), parameters});
        return unexplained(log, all);
    };
    for (const Range& range : kRanges) {
        if (range.effect == effect) return least_along(range, log, left_with);
    }
    const std::vector<Parameters> grid = tried(effect, log);
    if (grid.empty()) return left_with({});
    double least = std::numeric_limits<double>::infinity();
    for (const Parameters& parameters : grid) least = std::min(least, left_with(parameters));
    return least;
}

}  // namespace

OracleVerdict ask_oracle(const Trial& trial) {
    OracleVerdict verdict;
    std::vector<Candidate> truth;
    for (const HiddenEffect& effect : trial.hidden.effects) {
        const EffectInfo* info = find_effect(effect.name);
        if (info != nullptr && !info->fault_of_log && effect.name != "encoder_quantisation")
            truth.push_back(effect);
    }
    if (truth.empty()) return verdict;
    const CleanLog log = clean_log(trial);
    verdict.unexplained_true = unexplained(log, truth);
    verdict.unexplained_none = unexplained(log, {});
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < truth.size(); ++i) {
        std::vector<Candidate> others = truth;
        others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
        // what this effect closes of the gap
        const double without = unexplained(log, others);
        const double gap = without - verdict.unexplained_true;
        const auto consider = [&](const std::string& name, double value) {
            const double excess = value - verdict.unexplained_true;
            if (excess < std::max(kEnough, kShare * gap)) verdict.identifiable = false;
            const double share = excess / std::max(gap, kEnough);
            if (share >= nearest) return;
            nearest = share;
            verdict.unexplained_rival = value;
            verdict.nearest_rival = name;
        };
        consider(others.empty() ? "nothing" : others.front().name + " alone", without);
        for (const EffectInfo& info : all_effects()) {
            if (info.fault_of_log || info.name == "encoder_quantisation" || (info.needs_gyro && !log.gyro)) {
                continue;
            }
            // Dry friction that grows near standstill, by nothing, is dry friction: the smaller one is to be
            // named.
            const auto same = [&](const Candidate& c) {
                return c.name == info.name ||
                       (c.name == "coulomb_friction" && info.name == "stribeck_friction");
            };
            if (std::any_of(truth.begin(), truth.end(), same)) continue;
            const std::string name = std::string(info.name) + (others.empty() ? "" : " for " + truth[i].name);
            consider(name, least_unexplained(log, info.name, others));
        }
    }
    return verdict;
}

}  // namespace wheelwright::hidden
