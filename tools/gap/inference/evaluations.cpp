#include "tools/gap/inference/evaluations.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "tools/cli/report.hpp"
#include "tools/gap/hypotheses/hypotheses.hpp"
#include "tools/gap/inference/evidence.hpp"
#include "tools/gap/inference/robots.hpp"

namespace wheelwright::gap {
namespace {

constexpr std::size_t kFewestBlocks = 6;
constexpr int kMostPasses = 6;
constexpr double kClear = 3;  // of zero, standard errors
constexpr std::size_t kCoulomb = model::find_effect(model::CoulombFriction::info.name);
constexpr std::size_t kViscous = model::find_effect(model::ViscousFriction::info.name);
constexpr std::size_t kStribeck = model::find_effect(model::StribeckFriction::info.name);

bool close(const model::Dynamics<double>& a, const model::Dynamics<double>& b) {
    const auto near = [](double x, double y, double scale) { return std::abs(x - y) < 1e-3 * scale; };
    return near(a.k7_per_kg_m, b.k7_per_kg_m, b.k7_per_kg_m) &&
           near(a.k8_per_kg_m2, b.k8_per_kg_m2, b.k8_per_kg_m2) && near(a.k5_m, b.k5_m, 0.1);
}

// Effects, rivals and what is detectable: each is of an effect.
template <typename Entries>
bool has(const Entries& entries, std::size_t effect) {
    return std::any_of(entries.begin(), entries.end(),
                       [&](const auto& entry) { return entry.effect == effect; });
}

// A closer evaluation has columns for what came near only.
void keep_what_was_not_tried(Search& now, const Search& earlier) {
    for (const Detectable& d : earlier.detectable) {
        if (!has(now.detectable, d.effect) && !has(now.effects, d.effect)) now.detectable.push_back(d);
    }
    for (const Tried& t : earlier.tried) {
        if (!has(now.tried, t.effect)) now.tried.push_back(t);
    }
    for (NamedEffect& e : now.effects) {
        for (const NamedEffect& was : earlier.effects) {
            if (was.effect != e.effect) continue;
            for (const Rival& r : was.ruled_out) {
                if (!has(e.rivals, r.effect) && !has(e.ruled_out, r.effect) && !has(now.effects, r.effect))
                    e.ruled_out.push_back(r);
            }
        }
    }
}

// Nothing was found, but a closer evaluation of some effects may.
bool has_leads(const Search& search) {
    return search.effects.empty() &&
           std::any_of(search.points.begin(), search.points.end(),
                       [&](const auto& point) { return !has(search.members, point.first); });
}

// A closer evaluation must not lose what was found.
bool is_worse(const Search& later, const Search& earlier) {
    constexpr double kSlack = 1.02;
    const bool lost = std::any_of(earlier.effects.begin(), earlier.effects.end(),
                                  [&](const NamedEffect& e) { return !has(later.effects, e.effect); });
    return later.effects.empty() || (lost && later.gap_after > kSlack * earlier.gap_after);
}

// By the fit beside friction alone; by the effects found, of Stribeck's what is left at speed.
WheelFriction friction_of(const Fit& fit, const Dictionary& dictionary) {
    const auto amount_of = [&](std::size_t effect) {
        const int first = dictionary.linear_columns(effect).first;
        for (std::size_t i = 0; i < fit.shape.amounts.size(); ++i) {
            if (fit.shape.amounts[i].columns.front() == first)
                return fit.value(kFirstAmount + Eigen::Index(i));
        }
        return 0.0;
    };
    return {amount_of(kCoulomb), amount_of(kViscous)};
}

WheelFriction friction_of(const Search& found, const Setting& setting) {
    const model::EffectSet<double> effects = effects_of(found.members, found.after, setting);
    const auto mean_of = [&](std::size_t effect) {
        const model::Parameters<double>& p = effects.parameter[effect];
        return effects.active[effect] ? (p[0] + p[1]) / 2 : 0.0;
    };
    const double stribeck = effects.active[kStribeck] ? effects.parameter[kStribeck][0] : 0.0;
    return {mean_of(kCoulomb) + stribeck, mean_of(kViscous)};
}

// Standard error of the time of an event that was found; 0: none was.
double event_error_s(const Search& search) {
    for (const NamedEffect& e : search.effects) {
        const std::size_t event = hypothesis_of(e.effect).event;
        if (event != model::kMaxEffectParameters) return e.unmoved[event];
    }
    return 0;
}

// Columns were linearised where an effect was found, and were no better than the starting point.
bool was_linearised_at(const Evaluation& evaluation, std::size_t effect) {
    constexpr double kSame = 0.02;
    const std::span<const Candidate> candidates = evaluation.dictionary.candidates(effect);
    const model::Parameters<double>& found = evaluation.search.points.at(effect);
    return std::any_of(candidates.begin(), candidates.end(), [&](const Candidate& candidate) {
        bool same = candidate.kind == Candidate::Kind::linearised;
        for (std::size_t j = 0; j < found.size(); ++j)
            same = same && std::abs(found[j] - candidate.at[j]) <= kSame * std::abs(found[j]);
        return same;
    });
}

}  // namespace

Evaluations::Evaluations(EvaluationOptions options)
    : options_(std::move(options)),
      block_options_(gap::block_options(options_.parts.training, options_.overview.noise_rad_per_s,
                                        options_.overview.speed_rms_rad_per_s)),
      driving_(options_.overview.driving),
      turning_(options_.overview.turning) {
    block_options_.kept = &kept_;
}

std::optional<std::string> Evaluations::first_model() {
    model::Dynamics<double> start;
    start.k7_per_kg_m = 1;
    make(start, {}, false);
    blocks_ = current_->train.blocks.size();
    if (blocks_ < kFewestBlocks) {
        return "too short: " + std::to_string(blocks_) +
               " pieces of at least half a second in which both wheels turn are left for the search, and it "
               "takes " +
               std::to_string(kFewestBlocks) + "; drive for 20 s";
    }
    std::vector<Amount> frictions;
    for (const std::size_t friction : usual_friction()) {
        const int first = current_->dictionary.linear_columns(friction).first;
        frictions.push_back({{first, first + 1}});
    }
    ModelShape shape{{{{Dictionary::kTiming}}}, {}, turning_, {}};
    if (!driving_) shape.held_gain[kLinear] = 1;  // any: the log does not show it
    Fit f = fit_beside_friction(pointers(current_->train), shape, frictions);
    double& k7 = f.value(gain_of(kLinear));
    const double k8 = f.value(gain_of(kTurning));
    if (driving_ && !(k7 > 0)) {
        if (k7 < -kClear * f.error(gain_of(kLinear)))
            return "forward torque slows the robot down: is the sign of torque or speed wrong?";
        return "what forward torque does is lost in the speeds' noise, " +
               tools::number_text(
                   std::max(options_.overview.noise_rad_per_s.left, options_.overview.noise_rad_per_s.right),
                   2) +
               " rad/s beside an RMS of " + tools::number_text(options_.overview.speed_rms_rad_per_s, 2) +
               " rad/s: drive faster, or record smoother speeds";
    }
    if (turning_ && !(k8 > kClear * f.error(gain_of(kTurning)))) {
        if (k8 < -kClear * f.error(gain_of(kTurning))) {
            return "torque turns the robot the wrong way: are left and right of torque or speed swapped?";
        }
        turning_ = turned_with_an_effect(f);  // else turned, but not by the torques
    }
    if (!driving_) {
        if (!turning_) return "the torques neither drive nor turn the robot";
        k7 = k8 * options_.geometry.track_m / 4;  // as if the mass were above the wheels
        k7_per_kg_m_ = k7;
    }
    if (!turning_) {
        kept_ = {};  // made of what the wheels differ by
        block_options_.straight = true;
    }
    friction_ = friction_of(f, current_->dictionary);
    make(whole_dynamics(f, unknowable(f, turning_), turning_, options_.geometry.track_m), {}, true);
    first_ = current_;
    return std::nullopt;
}

void Evaluations::deny(std::size_t effect) {
    options_.known.rivals_only.push_back(effect);
    refinements_ = 0;
    event_spacing_s_ = 0;
    current_.reset();  // its blocks take room
    current_ = first_;
}

// Driven straight a robot may be turned by what is missing more than by the torques' difference: those fit
// its turning only beside an effect that does.
bool Evaluations::turned_with_an_effect(const Fit& without) const {
    constexpr double kMost = 0.5;  // of the squares, that such an effect leaves at most
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        ModelShape shape;
        shape.amounts.push_back({{Dictionary::kTiming}});
        for (auto [c, end] = current_->dictionary.linear_columns(i); c < end; ++c)
            shape.amounts.push_back({{c}});
        if (shape.amounts.size() == 1) continue;
        const Fit with = fit(pointers(current_->train), shape);
        if (with.value(gain_of(kTurning)) > kClear * with.error(gain_of(kTurning)) &&
            with.squares < kMost * without.squares)
            return true;
    }
    return false;
}

void Evaluations::evaluate() {
    const Known& known = options_.known;
    SearchOptions search_options;
    search_options.dictionary = &current_->dictionary;
    search_options.base = options_.base;
    search_options.given = known.given;
    search_options.excluded = known.excluded;
    search_options.rivals_only = known.rivals_only;
    if (turning_) search_options.shown = known.shown;
    search_options.large_gap = known.large_gap;
    search_options.most_report_lag_s = known.most_report_lag_s;
    search_options.white_noise = known.white_noise;
    search_options.turning = turning_;
    search_options.k7_per_kg_m = k7_per_kg_m_;
    current_->search = search(current_->train, search_options);
}

void Evaluations::evaluate_closer(int broad) {
    for (int again = 0; again < kMostPasses; ++again) {
        const bool leads = has_leads(current_->search);
        if (current_->search.effects.empty() && !leads) break;
        const model::Dynamics<double> found = dynamics_found();
        if (!leads && close(found, current_->dictionary.setting().dynamics) && near_enough()) break;
        friction_ = friction_of(current_->search, current_->dictionary.setting());
        Evaluation before = put_aside();
        ++refinements_;
        space_events_closer();
        make(found, before.search.points, again < broad);
        evaluate();
        keep_what_was_not_tried(current_->search, before.search);
        if (is_worse(current_->search, before.search)) {
            current_ = std::move(before);
            break;
        }
    }
}

// Times of events are tried closer together, but not much closer than their errors.
void Evaluations::space_events_closer() {
    constexpr double kFinerBy = 4;  // each evaluation than the one before
    constexpr double kOfError = 0.75;
    const Setting& setting = current_->dictionary.setting();
    double next_s = (event_spacing_s_ > 0 ? event_spacing_s_ : kEventSpacing * setting.span_s) / kFinerBy;
    if (event_spacing_s_ > 0) next_s = std::max(next_s, kOfError * event_error_s(current_->search));
    event_spacing_s_ = std::max(next_s, 2 * setting.period_s);
}

// Whether the effects found lie where their columns were made, within a fifth of a standard error.
bool Evaluations::near_enough() const {
    const Search& s = current_->search;
    const Dictionary& dictionary = current_->dictionary;
    const double event_s = event_error_s(s);
    if (event_s > 0 && event_spacing_s_ > std::max(event_s, 2 * dictionary.setting().period_s)) return false;
    for (const NamedEffect& e : s.effects) {
        for (const Rival& r : e.rivals) {
            if (r.coarse && !r.confounded) return false;
        }
        for (const Candidate& candidate : s.members) {
            if (candidate.effect != e.effect || candidate.kind == Candidate::Kind::linear) continue;
            if (candidate.kind == Candidate::Kind::start) {
                if (dictionary.can_linearise(candidate.effect) &&
                    !was_linearised_at(*current_, candidate.effect))
                    return false;
                continue;
            }
            const model::Parameters<double>& found = s.points.at(e.effect);
            for (std::size_t j = 0; j < e.parameters.size(); ++j) {
                const double error = e.parameters[j].standard_error;  // 0: the log does not show it
                if (error > 0 && std::abs(found[j] - candidate.at[j]) > 0.2 * error) return false;
            }
        }
    }
    return true;
}

model::Dynamics<double> Evaluations::dynamics_found() const {
    const Search& found = current_->search;
    return whole_dynamics(found.after, found.unknowable, turning_, options_.geometry.track_m);
}

Setting Evaluations::setting_found() const {
    Setting setting = current_->dictionary.setting();
    setting.dynamics = dynamics_found();
    return setting;
}

Setting Evaluations::setting_for(const model::Dynamics<double>& dynamics) const {
    const Overview& o = options_.overview;
    return {options_.geometry, dynamics,   friction_,    o.peak_torque_Nm, o.peak_speed_rad_per_s,
            o.span_s,          o.period_s, o.turned_rad, refinements_,     event_spacing_s_};
}

BlockSet Evaluations::held_out() const {
    if (!options_.parts.held_out) return {};
    BlockOptions made_with = block_options_;
    made_with.dictionary = &current_->dictionary;
    made_with.kept = nullptr;  // those are of other parts
    BlockSet blocks = make_blocks(std::array{*options_.parts.held_out}, made_with);
    weigh(blocks, current_->colour);
    return blocks;
}

// The last evaluation; the next one finds its search and its dictionary in place, but no blocks.
Evaluation Evaluations::put_aside() {
    return {current_->search, current_->dictionary, std::move(current_->train), current_->colour};
}

// The dictionary and the blocks of the evaluation that comes next; what was found stays.
void Evaluations::make(const model::Dynamics<double>& dynamics, Points points, bool starts) {
    const Known& known = options_.known;
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (options_.base.active[i]) points.try_emplace(i, options_.base.parameter[i]);
    }
    for (const auto& [effect, parameters] : known.given) points[effect] = parameters;
    Search found = current_ ? std::move(current_->search) : Search{};
    current_.reset();  // its blocks take room
    current_.emplace(Evaluation{std::move(found), Dictionary(setting_for(dynamics), points, starts), {}, {}});
    BlockOptions made_with = block_options_;
    made_with.dictionary = &current_->dictionary;
    WeighedBlocks train = weighed_blocks(options_.parts.training, made_with, known.excluded);
    current_->train = std::move(train.set);
    current_->colour = train.colour;
}

}  // namespace wheelwright::gap
