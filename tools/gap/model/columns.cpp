#include "tools/gap/model/columns.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "tools/gap/hypotheses/hypotheses.hpp"
#include "tools/gap/model/places.hpp"

namespace wheelwright::gap {
namespace {

using model::Parameters;

// A function of motion and torque that stands for no effect.
struct Instant {
    WheelPair<double> torque, speed, slow_torque, angle;
    Twist<double> twist;
    double heading = 0, time = 0;
};
struct Rich {
    std::string_view place;
    WheelPair<double> (*value)(const Instant&);
};
using Pair = WheelPair<double>;
Pair each(const Pair& a, double (*f)(double)) { return {f(a.left), f(a.right)}; }
Pair each(const Pair& a, const Pair& b, double (*f)(double, double)) {
    return {f(a.left, b.left), f(a.right, b.right)};
}
Pair turn(double torque) { return {-torque, torque}; }
Pair drive(double torque) { return {torque, torque}; }

// NOLINTBEGIN(readability-magic-numbers): shapes, not quantities
constexpr std::array kRich{
    Rich{"wheel speed",
         [](const Instant& i) {
             return Pair{i.speed.left, 0};
         }},
    Rich{"wheel speed",
         [](const Instant& i) {
             return Pair{0, i.speed.right};
         }},
    Rich{"wheel speed",
         [](const Instant& i) { return each(i.speed, [](double w) { return w * std::abs(w) / 10; }); }},
    Rich{"wheel speed",
         [](const Instant& i) { return each(i.speed, [](double w) { return w * w * w / 100; }); }},
    Rich{"direction of turning of the wheels",
         [](const Instant& i) {
             return Pair{sign_of(i.speed.left), 0};
         }},
    Rich{"direction of turning of the wheels",
         [](const Instant& i) {
             return Pair{0, sign_of(i.speed.right)};
         }},
    Rich{"low wheel speed",
         [](const Instant& i) {
             return each(i.speed, [](double w) { return sign_of(w) * std::exp(-w * w); });
         }},
    Rich{"yaw rate", [](const Instant& i) { return turn(sign_of(i.twist.omega_rad_per_s)); }},
    Rich{"yaw rate",
         [](const Instant& i) { return turn(i.twist.omega_rad_per_s * std::abs(i.twist.omega_rad_per_s)); }},
    Rich{"torque",
         [](const Instant& i) {
             return Pair{i.torque.left, 0};
         }},
    Rich{"torque", [](const Instant& i) { return each(i.torque, [](double t) { return t * std::abs(t); }); }},
    Rich{"torque", [](const Instant& i) { return each(i.torque, sign_of); }},
    Rich{"torque times speed",
         [](const Instant& i) {
             return each(i.torque, i.speed, [](double t, double w) { return t * std::abs(w) / 10; });
         }},
    Rich{"lag",
         [](const Instant& i) {
             return each(i.slow_torque, i.torque, [](double late, double now) { return late - now; });
         }},
    Rich{"constant",
         [](const Instant&) {
             return Pair{1, 0};
         }},
    Rich{"constant",
         [](const Instant&) {
             return Pair{0, 1};
         }},
    Rich{"heading", [](const Instant& i) { return drive(std::cos(i.heading)); }},
    Rich{"heading", [](const Instant& i) { return drive(std::sin(i.heading)); }},
    Rich{"heading", [](const Instant& i) { return turn(std::cos(i.heading)); }},
    Rich{"heading", [](const Instant& i) { return turn(std::sin(i.heading)); }},
    Rich{"wheel angle", [](const Instant& i) { return each(i.angle, [](double a) { return std::sin(a); }); }},
    Rich{"wheel angle", [](const Instant& i) { return each(i.angle, [](double a) { return std::cos(a); }); }},
    Rich{"time",
         [](const Instant& i) {
             return Pair{i.torque.left * i.time / 30, i.torque.right * i.time / 30};
         }},
    Rich{"coupling of turning and driving",
         [](const Instant& i) { return turn(i.twist.omega_rad_per_s * i.twist.omega_rad_per_s); }},
    Rich{"coupling of turning and driving",
         [](const Instant& i) { return drive(i.twist.omega_rad_per_s * i.twist.v_m_per_s); }},
};
// NOLINTEND(readability-magic-numbers)

}  // namespace

std::optional<Candidate> left_free(const Candidate& candidate) {
    if (candidate.hidden == model::kMaxEffectParameters || candidate.leaves_open) return std::nullopt;
    Candidate other = candidate;
    other.leaves_open = true;
    if (candidate.kind == Candidate::Kind::start) {
        std::vector<int>& all = other.amounts.front().columns;
        for (std::size_t i = 1; i < candidate.amounts.size(); ++i)
            all.insert(all.end(), candidate.amounts[i].columns.begin(), candidate.amounts[i].columns.end());
        other.amounts.resize(1);
        return other;
    }
    const auto hidden = std::find(candidate.free.begin(), candidate.free.end(), candidate.hidden);
    if (hidden == candidate.free.end()) return std::nullopt;
    const auto at = hidden - candidate.free.begin();
    other.free.erase(other.free.begin() + at);
    other.amounts.erase(other.amounts.begin() + at);
    return other;
}

std::pair<Parameters<double>, bool> parameters_of(const Candidate& candidate, const Eigen::VectorXd& amounts,
                                                  const Setting& setting) {
    Parameters<double> p{};
    switch (candidate.kind) {
        case Candidate::Kind::linear: {
            for (std::size_t i = 0; i < candidate.amounts.size(); ++i) {
                if (candidate.together) {
                    p[0] = p[1] = amounts(0);
                } else {
                    p[candidate.coordinate[i]] = amounts(Eigen::Index(i));
                }
            }
            std::array<bool, model::kEffectCount> one{};
            one[candidate.effect] = true;
            model::for_each_active(one, [&]<typename Effect>(std::size_t) {
                if constexpr (model::HasOwnCoordinates<Effect>) p = Effect::from_coordinates(p);
            });
            return {p, true};
        }
        case Candidate::Kind::start: {
            const StartingPoints start = hypothesis_of(candidate.effect).starting_points(setting);
            return {start.parameters(candidate.at, amounts), start.plausible(amounts)};
        }
        case Candidate::Kind::linearised:
            p = candidate.at;
            for (std::size_t i = 0; i < candidate.free.size(); ++i)
                p[candidate.free[i]] += amounts(Eigen::Index(i));
            return {p, hypothesis_of(candidate.effect).starting_points(setting).itself(p)};
    }
    return {p, true};
}

Dictionary::Dictionary(const Setting& setting, const Points& linearised, bool starts, bool places)
    : setting_(setting), linear_(model::kEffectCount), candidates_(model::kEffectCount) {
    columns_.resize(kFirstEffect);
    std::size_t number = 0;  // of those that stand for no effect
    const auto without_effect = [&number] { return Source{model::kEffectCount, number++, {}}; };
    for (const int c : {kTorque, kTiming}) columns_[std::size_t(c)].source = without_effect();
    std::array<bool, model::kEffectCount> all{};
    all.fill(true);
    model::for_each_active(all, [&]<typename Effect>(std::size_t i) {
        const auto first = static_cast<int>(columns_.size());
        for (unsigned k = 0; k < model::kCoordinates<Effect>; ++k) {
            columns_.push_back({i, "", std::nullopt});
            if (!hypothesis_of(i).by_dynamics) columns_.back().source = Source{i, k, {}};
        }
        linear_[i] = {first, static_cast<int>(columns_.size())};
    });
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (linear_[i].first != linear_[i].second) continue;
        const auto found = linearised.find(i);
        const StartingPoints start = hypothesis_of(i).starting_points(setting_);
        if (found != linearised.end() && start.closer) {
            for (const Parameters<double>& at : start.closer(found->second)) add_linearised(i, at);
            continue;
        }
        if (starts || found != linearised.end()) add_starts(i);
        if (found != linearised.end() && can_linearise(i)) add_linearised(i, found->second);
    }
    rich_.first = static_cast<int>(columns_.size());
    for (const Rich& rich : kRich) columns_.push_back({model::kEffectCount, rich.place, without_effect()});
    rich_.second = static_cast<int>(columns_.size());
    places_.first = rich_.second;
    if (places) {
        for (const PlaceColumns::Kind& kind : PlaceColumns::kinds())
            columns_.push_back({model::kEffectCount, kind.place, std::nullopt});
    }
    places_.second = static_cast<int>(columns_.size());
}

std::vector<int> Dictionary::rich_columns_of(std::string_view place) const {
    std::vector<int> columns;
    for (int c = rich_.first; c < rich_.second; ++c) {
        if (columns_[std::size_t(c)].place == place) columns.push_back(c);
    }
    return columns;
}

bool Dictionary::can_linearise(std::size_t effect) const {
    return hypothesis_of(effect).starting_points(setting_).step != decltype(StartingPoints::step){};
}

std::size_t Dictionary::term(std::size_t effect, const Parameters<double>& p) {
    terms_.push_back({effect, p});
    return terms_.size() - 1;
}

int Dictionary::add(std::size_t effect, const Probe& probe, const std::optional<Source>& source) {
    probes_.push_back(probe);
    columns_.push_back({effect, "", source});
    return static_cast<int>(columns_.size()) - 1;
}

void Dictionary::add_starts(std::size_t effect) {
    const StartingPoints start = hypothesis_of(effect).starting_points(setting_);
    for (const Parameters<double>& at : start.points) {
        Candidate candidate;
        candidate.effect = effect;
        candidate.kind = Candidate::Kind::start;
        candidate.at = at;
        candidate.hidden = start.hidden;
        for (const Parameters<double>& unit : start.units(at)) {
            std::optional<Source> source;
            if (!hypothesis_of(effect).by_dynamics) source = Source{effect, 0, unit};
            candidate.amounts.push_back({{add(effect, {term(effect, unit)}, source)}, start.likely_amount});
        }
        candidates_[effect].push_back(candidate);
    }
}

// Slopes are taken to one side where the other is out of the parameter's range.
void Dictionary::add_linearised(std::size_t effect, const Parameters<double>& at) {
    const StartingPoints start = hypothesis_of(effect).starting_points(setting_);
    const auto& info = model::kEffects[effect].parameters;
    Candidate candidate;
    candidate.effect = effect;
    candidate.kind = Candidate::Kind::linearised;
    candidate.at = at;
    candidate.hidden = start.hidden;
    const std::size_t here = term(effect, at);
    candidate.fixed.push_back(add(effect, {here}));
    for (std::size_t j = 0; j < info.size(); ++j) {
        if (start.step[j] == 0 || (j == start.apart_at_zero && at[j] == 0)) continue;
        Parameters<double> up = at;
        Parameters<double> down = at;
        up[j] = std::min(info[j].maximum, at[j] + start.step[j]);
        down[j] = std::max(info[j].minimum, at[j] - start.step[j]);
        candidate.free.push_back(j);
        candidate.amounts.push_back(
            {{add(effect, {term(effect, up), term(effect, down), 1 / (up[j] - down[j])})},
             start.likely_move[j]});
    }
    if (start.beside != Parameters<double>{}) {
        Parameters<double> up = at;
        Parameters<double> down = at;
        double step = 0;
        for (std::size_t j = 0; j < at.size(); ++j) {
            up[j] += start.beside[j];
            down[j] -= start.beside[j];
            step += 2 * start.beside[j];
        }
        candidate.amounts.push_back(
            {{add(effect, {term(effect, up), term(effect, down), 1 / step})}, start.expected});
    }
    candidates_[effect].push_back(candidate);
}

Dictionary::Walker::Walker(const Dictionary& dictionary, const std::vector<bool>& wanted)
    : dictionary_(dictionary), term_(dictionary.terms_.size()) {
    const auto is_wanted = [&wanted](std::size_t column) { return wanted.empty() || wanted[column]; };
    const auto any_wanted = [&](const std::pair<int, int>& of) {
        bool any = false;
        for (int c = of.first; c < of.second; ++c) any = any || is_wanted(std::size_t(c));
        return any;
    };
    for (std::size_t i = 0; i < model::kEffectCount; ++i)
        linear_wanted_[i] = any_wanted(dictionary.linear_[i]);
    rich_wanted_ = any_wanted(dictionary.rich_);
    std::vector<bool> term_wanted(term_.size());
    const std::size_t first_probe = dictionary.first_probe();
    for (std::size_t i = 0; i < dictionary.probes_.size(); ++i) {
        if (!is_wanted(first_probe + i)) continue;
        probes_.push_back(i);
        const Probe& probe = dictionary.probes_[i];
        term_wanted[probe.plus] = true;
        if (probe.minus != kNone) term_wanted[probe.minus] = true;
    }
    for (std::size_t t = 0; t < term_.size(); ++t) {
        if (!term_wanted[t]) continue;
        const auto& [effect, parameters] = dictionary.terms_[t];
        term_[t] = hypothesis_of(effect).columns(parameters, dictionary.setting_);
        for (std::size_t i = 0; i < t; ++i) {
            if (term_[i] && dictionary.terms_[i].effect == effect) term_[t]->share(*term_[i]);
        }
        (term_[t]->slow() ? slow_ : quick_).push_back(t);
    }
    term_sums_.resize(term_.size());
    columns_.resize(dictionary.columns_.size() - kTorque);
    for (std::size_t i = 0; i < columns_.size(); ++i) {
        if (!is_wanted(i + kTorque)) continue;
        wanted_.push_back(i);
        const bool probed =
            i + kTorque >= first_probe && i + kTorque < first_probe + dictionary.probes_.size();
        if (!probed) summed_.push_back(i);
    }
    const auto [first, end] = dictionary.places_;
    if (first != end) places_ = std::make_shared<PlaceColumns>(dictionary.setting_);
}

void Dictionary::Walker::forget() {
    std::fill(term_sums_.begin(), term_sums_.end(), WheelPair<double>{});
    for (const std::size_t i : summed_) columns_[i] = {};
}

void Dictionary::Walker::put_together(const Interval& i) {
    if (together_++ == 0) {
        whole_ = i;
        return;
    }
    const double share = 1 / double(together_);
    const auto mean = [&](double& of, double next) { of += share * (next - of); };
    whole_.dt_s += i.dt_s;
    whole_.after = i.after;
    mean(whole_.torque.left, i.torque.left);
    mean(whole_.torque.right, i.torque.right);
    mean(whole_.angle.left, i.angle.left);
    mean(whole_.angle.right, i.angle.right);
    mean(whole_.heading_rad, i.heading_rad);
}

void Dictionary::Walker::close() {
    for (const std::size_t t : slow_) {
        if (together_ == 0) break;
        const WheelPair<double> pair = term_[t]->over(whole_);
        term_sums_[t] = {double(acting_) * pair.left, double(acting_) * pair.right};
    }
    together_ = acting_ = 0;
}

void Dictionary::Walker::add(const WheelPair<double>& pair) {
    columns_[at_].left += pair.left;
    columns_[at_].right += pair.right;
    ++at_;
}

void Dictionary::Walker::step(const Interval& i, bool standing) {
    if (first_) slow_torque_ = i.torque;
    first_ = false;
    for (const std::size_t t : quick_) {
        const WheelPair<double> pair = term_[t]->over(i);
        if (standing) continue;
        term_sums_[t].left += pair.left;
        term_sums_[t].right += pair.right;
    }
    if (!slow_.empty()) put_together(i);
    acting_ += standing ? 0 : 1;
    if (!standing) {
        at_ = 0;
        add(i.torque);
        add({i.torque_before.left - i.torque.left, i.torque_before.right - i.torque.right});
        add_effects(i);
        at_ += dictionary_.probes_.size();
        add_rich(i);
    }
    if (places_ && !standing) {
        place_values_.clear();
        places_->append(i, place_values_);
        for (const WheelPair<double>& pair : place_values_) add(pair);
    }
    if (places_) places_->advance(i);
    constexpr double kSlow_s = 0.02;
    const double share = i.dt_s / (i.dt_s + kSlow_s);
    slow_torque_.left += share * (i.torque.left - slow_torque_.left);
    slow_torque_.right += share * (i.torque.right - slow_torque_.right);
}

void Dictionary::Walker::add_rich(const Interval& i) {
    if (!rich_wanted_) {
        at_ += kRich.size();
        return;
    }
    Instant at;
    at.torque = i.torque;
    at.speed = i.speed();
    at.slow_torque = slow_torque_;
    at.angle = i.angle;
    at.twist = model::twist_from_wheel_speeds(dictionary_.setting_.geometry, at.speed);
    at.heading = i.heading_rad;
    at.time = i.t_s;
    for (const Rich& rich : kRich) add(rich.value(at));
}

// The points' columns are differences of contributions.
void Dictionary::Walker::combine() {
    const std::size_t first = dictionary_.first_probe() - kTorque;
    for (const std::size_t i : probes_) {
        const Probe& probe = dictionary_.probes_[i];
        WheelPair<double> pair = term_sums_[probe.plus];
        if (probe.minus != kNone) {
            pair.left -= term_sums_[probe.minus].left;
            pair.right -= term_sums_[probe.minus].right;
        }
        columns_[first + i] = {probe.scale * pair.left, probe.scale * pair.right};
    }
}

// The wheel torque of one unit of each coordinate of each linear effect.
void Dictionary::Walker::add_effects(const Interval& i) {
    const Setting& s = dictionary_.setting_;
    const WheelPair<double> speed = i.speed();
    const model::Motion<double> motion{speed, i.angle, model::twist_from_wheel_speeds(s.geometry, speed),
                                       i.heading_rad};
    const model::EffectContext<double> context{motion, i.torque, s.geometry, s.dynamics};
    std::array<bool, model::kEffectCount> all{};
    all.fill(true);
    model::for_each_active(all, [&]<typename Effect>(std::size_t effect) {
        if (!linear_wanted_[effect]) {
            at_ += model::kCoordinates<Effect>;
            return;
        }
        for (unsigned k = 0; k < model::kCoordinates<Effect>; ++k) {
            if constexpr (model::Dry<Effect>) {
                const WheelPair<double> d =
                    model::wheel_torque_Nm(s.geometry, Effect::template dry_direction<double>(k));
                const double amount =
                    -mean_sign(model::sliding_speed(d, i.before), model::sliding_speed(d, i.after));
                add({amount * d.left, amount * d.right});
            } else if constexpr (model::kCoordinates<Effect> > 0) {
                add(model::smooth_column<Effect>(k, context));
            }
        }
    });
}

}  // namespace wheelwright::gap
