#include "tools/gap/gap_analysis.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <limits>

#include "tools/gap/free_run.hpp"
#include "tools/gap/gap_places.hpp"
#include "tools/gap/gap_points.hpp"
#include "tools/gap/gap_refine.hpp"
#include "tools/gap/motions.hpp"
#include "tools/ident/drive_samples.hpp"

namespace wheelwright::gap {
namespace {

using tools::MeasuredLog;
using tools::MeasuredSample;

constexpr double kTurningOverNoise = 9;  // power of the yaw rate over that of its noise
constexpr std::size_t kFewestBlocks = 6;
constexpr double kHeldOutShare = 0.2;
constexpr double kSmallMismatch = 0.004;  // of the wheels' radii
constexpr std::size_t kMeasurementLag = model::find_effect("measurement_lag");
constexpr int kMostPasses = 6;
constexpr int kBroadPasses = 1;  // of those, with everything in the catalogue

model::Dynamics<double> dynamics_of(const Fit& f, bool turning, double track_m) {
    model::Dynamics<double> k{f.value(0), f.value(1), f.value(2), f.value(3)};
    if (!turning) {
        // nothing is known of turning: a robot that goes straight, with any inertia
        k.k5_m = k.k6_per_m = 0;
        k.k8_per_kg_m2 = 4 * k.k7_per_kg_m / track_m;
    }
    return k;
}

class Analysis {
  public:
    explicit Analysis(const Request& request) : request_(request), excluded_(request.without) {}

    Findings run() {
        if (!request_.without.empty()) {
            std::string names;
            for (const std::size_t effect : request_.without)
                names += (names.empty() ? "" : ", ") + std::string(model::kEffects[effect].name);
            findings_.notes.push_back("not looked for, as was asked: " + names);
        }
        read();
        if (good()) look();
        if (!good()) return findings_;
        split();
        take_sensors();
        request_.progress("products of columns");
        first_model();
        if (!good()) return findings_;
        request_.progress("search");
        look_for_effects();
        look_with_a_guess();
        look_closer(kBroadPasses);
        look_without_the_least();
        look_at_what_is_left();
        refine();
        refine_names();
        name_sensors();
        judge_sensors();
        take_models();
        request_.progress("free run on the held-out part");
        free_runs();
        curves();
        std::erase_if(findings_.search.detectable, [&](const Detectable& d) { return left_out(d.effect); });
        return findings_;
    }

  private:
    // A look at the log with one dictionary.
    struct Pass {
        Search search;
        Dictionary dictionary;
        BlockSet train, report;
    };
    Pass take_pass() { return {findings_.search, *dictionary_, std::move(train_), std::move(report_)}; }
    void take_back(Pass& before) {
        findings_.search = std::move(before.search);
        dictionary_.emplace(std::move(before.dictionary));
        train_ = std::move(before.train);
        report_ = std::move(before.report);
    }
    // A closer look has columns for what came near only.
    void keep_what_was_not_tried(const Search& earlier) {
        Search& now = findings_.search;
        for (const Detectable& d : earlier.detectable) {
            const auto same = [&](const auto& other) { return other.effect == d.effect; };
            if (std::none_of(now.detectable.begin(), now.detectable.end(), same) &&
                std::none_of(now.effects.begin(), now.effects.end(), same)) {
                now.detectable.push_back(d);
            }
        }
        for (NamedEffect& e : now.effects) {
            for (const NamedEffect& was : earlier.effects) {
                if (was.effect != e.effect) continue;
                for (const Rival& r : was.ruled_out) {
                    const auto same = [&](const auto& other) { return other.effect == r.effect; };
                    if (std::none_of(e.rivals.begin(), e.rivals.end(), same) &&
                        std::none_of(e.ruled_out.begin(), e.ruled_out.end(), same) &&
                        std::none_of(now.effects.begin(), now.effects.end(), same)) {
                        e.ruled_out.push_back(r);
                    }
                }
            }
        }
    }

    // On request.
    bool left_out(std::size_t effect) const {
        return std::find(request_.without.begin(), request_.without.end(), effect) != request_.without.end();
    }

    // Nothing was found, but a closer look at some effects may.
    bool has_leads() const {
        const Search& s = findings_.search;
        const auto is_member = [&](std::size_t effect) {
            return std::any_of(s.members.begin(), s.members.end(),
                               [&](const Way& way) { return way.effect == effect; });
        };
        return s.effects.empty() && std::any_of(s.points.begin(), s.points.end(),
                                                [&](const auto& point) { return !is_member(point.first); });
    }

    // A closer look must not lose what was found.
    static bool is_worse(const Search& later, const Search& earlier) {
        constexpr double kSlack = 1.02;
        return later.effects.empty() || (later.effects.size() < earlier.effects.size() &&
                                         later.gap_after > kSlack * earlier.gap_after);
    }

    bool good() const { return findings_.problems.empty(); }
    void problem(const std::string& text) { findings_.problems.push_back(text); }

    void read() {
        std::vector<std::string> paths = request_.logs;
        if (!request_.heldout_log.empty()) paths.push_back(request_.heldout_log);
        for (const std::string& path : paths) {
            tools::SampledLog read = tools::read_sampled_log(path, request_.robot);
            for (const std::string& text : read.problems) problem(text);
            findings_.notes.insert(findings_.notes.end(), read.notes.begin(), read.notes.end());
            last_file_ = logs_.size();
            std::move(read.logs.begin(), read.logs.end(), std::back_inserter(logs_));
        }
        unusable_.resize(logs_.size());
        for (std::size_t i = 0; i < logs_.size(); ++i) {
            const std::vector<LogFault> faults = repair(logs_[i], unusable_[i]);
            findings_.faults.insert(findings_.faults.end(), faults.begin(), faults.end());
            for (const LogFault& fault : faults) findings_.notes.push_back(words_of(fault));
        }
    }

    static std::string words_of(const LogFault& fault) {
        std::array<char, 160> text{};
        std::snprintf(text.data(), text.size(), "%s: %zu samples (%.3g %%), the first at %.3f s; %s",
                      fault.name.c_str(), fault.count, 100 * fault.rate, fault.first_s,
                      fault.name == "log_outliers" ? "put between their neighbours" : "left out");
        return text.data();
    }

    void look() {
        double torque = 0;
        double speed = 0;
        bool negative_torque = false;
        bool negative_speed = false;
        for (const MeasuredLog& log : logs_) {
            findings_.duration_s += log.period_s * double(log.samples.size() - 1);
            for (const MeasuredSample& s : log.samples) {
                torque += std::pow(s.torque_Nm.left, 2) + std::pow(s.torque_Nm.right, 2);
                speed += std::pow(s.speed_rad_per_s.left, 2) + std::pow(s.speed_rad_per_s.right, 2);
                for (const auto side : {&WheelPair<double>::left, &WheelPair<double>::right}) {
                    peak_torque_Nm_ = std::max(peak_torque_Nm_, std::abs(s.torque_Nm.*side));
                    peak_speed_rad_per_s_ =
                        std::max(peak_speed_rad_per_s_, std::abs(s.speed_rad_per_s.*side));
                }
                negative_torque = negative_torque || s.torque_Nm.left < 0 || s.torque_Nm.right < 0;
                negative_speed =
                    negative_speed || s.speed_rad_per_s.left < -1 || s.speed_rad_per_s.right < -1;
            }
        }
        double samples = 0;
        for (const MeasuredLog& log : logs_) samples += double(log.samples.size());
        speed_rms_ = std::sqrt(speed / (2 * samples));
        findings_.rate_Hz = 1 / logs_.front().period_s;
        if (torque == 0) problem("no excitation: the torque is zero throughout");
        if (speed == 0) problem("no motion: the wheel speeds are zero throughout");
        if (torque > 0 && negative_speed && !negative_torque) {
            problem(
                "the wheels turn backwards, yet the torque is never negative: "
                "has it lost its sign?");
        }
        if (!good()) return;
        findings_.noise_rad_per_s = speed_noise(logs_);
        double yaw = 0;
        double count = 0;
        const model::Geometry<double>& g = request_.geometry;
        for (const MeasuredLog& log : logs_) {
            for (const MeasuredSample& s : log.samples) {
                const double omega = model::twist_from_wheel_speeds(g, s.speed_rad_per_s).omega_rad_per_s;
                yaw += omega * omega;
                ++count;
            }
        }
        const double noise = std::hypot(g.wheel_radius_m.left * findings_.noise_rad_per_s.left,
                                        g.wheel_radius_m.right * findings_.noise_rad_per_s.right) /
                             g.track_m;
        findings_.turning = yaw / count > kTurningOverNoise * noise * noise;
        sensors_ = look_at_sensors(logs_, g);
        late_report_ = left_out(kMeasurementLag) &&
                       std::any_of(sensors_.effects.begin(), sensors_.effects.end(),
                                   [](const SensorEffect& e) { return e.effect == kMeasurementLag; });
        std::erase_if(sensors_.effects, [&](const SensorEffect& e) { return left_out(e.effect); });
        if (sensors_.gyro && findings_.turning) {
            findings_.gyro = sensors_.gyro;
            const double slope = sensors_.gyro->slope;
            const double error = sensors_.gyro->slope_error;
            const auto near = [&](double factor) { return std::abs(slope / factor - 1) < 0.2; };
            if (slope < 0 && std::abs(slope) > 20 * error) {
                problem(
                    "gyro and wheels turn in opposite senses: are left and right "
                    "swapped?");
            } else if (near(2 * 3.14159265) || near(1 / (2 * 3.14159265))) {
                problem(
                    "the wheels' yaw rate is off the gyro's by a factor near 2 pi: "
                    "turns instead of radians?");
            } else if (near(1000) || near(0.001) || near(57.29578) || near(1 / 57.29578)) {
                problem(
                    "the wheels' yaw rate is off the gyro's by a factor of a unit: "
                    "rad/s are expected");
            }
        }
    }

    void split() {
        // A file may hold several stretches; from a time of the last file on nothing is learned, and the
        // longest piece behind it is what the free run is judged on.
        const std::size_t last = last_file_;
        double from = -1;
        if (request_.heldout_log.empty()) {
            double driven = 0;
            for (std::size_t i = last; i < logs_.size(); ++i) driven += duration(logs_[i]);
            double left = kHeldOutShare * driven;
            for (std::size_t i = logs_.size(); i-- > last && left > 0;) {
                from = logs_[i].samples.back().t_s - std::min(left, duration(logs_[i]));
                left -= duration(logs_[i]);
            }
            from = request_.heldout_from_s.value_or(from);
        }
        std::size_t longest = 0;
        for (std::size_t i = 0; i < logs_.size(); ++i) {
            const MeasuredLog& log = logs_[i];
            std::size_t cut = 0;
            double heading = log.start_heading_rad;
            while (cut < log.samples.size() && (i < last || log.samples[cut].t_s < from)) {
                heading += log.period_s *
                           model::twist_from_wheel_speeds(request_.geometry, log.samples[cut].speed_rad_per_s)
                               .omega_rad_per_s;
                ++cut;
            }
            if (cut > 1) training_.push_back({&log, i, 0, cut, log.start_heading_rad, &unusable_[i]});
            const std::size_t after = log.samples.size() - cut;
            if (i >= last && after > std::max<std::size_t>(longest, 2)) {
                held_out_ = LogPart{&log, i, cut, log.samples.size(), heading, &unusable_[i]};
                longest = after;
            }
        }
        findings_.heldout_from_s =
            held_out_ ? held_out_->log->samples[held_out_->first].t_s : logs_.back().samples.back().t_s;
    }

    static double duration(const MeasuredLog& log) { return log.period_s * double(log.samples.size() - 1); }

    static bool close(const model::Dynamics<double>& a, const model::Dynamics<double>& b) {
        const auto near = [](double x, double y, double scale) { return std::abs(x - y) < 1e-3 * scale; };
        return near(a.k7_per_kg_m, b.k7_per_kg_m, b.k7_per_kg_m) &&
               near(a.k8_per_kg_m2, b.k8_per_kg_m2, b.k8_per_kg_m2) && near(a.k5_m, b.k5_m, 0.1);
    }

    void look_for_effects() {
        SearchOptions options;
        options.dictionary = &*dictionary_;
        options.base = base_effects();
        options.given = given_;
        options.excluded = excluded_;
        for (std::size_t i = 0; !only_.empty() && i < model::kEffectCount; ++i) {
            if (std::find(only_.begin(), only_.end(), i) == only_.end()) options.excluded.push_back(i);
        }
        options.large_gap = large_gap();
        options.white_noise = !coarse_counts();
        for (const NamedEffect& e : findings_.search.effects) options.confirmed.push_back(e.effect);
        options.turning = findings_.turning;
        findings_.search = search(train_, report_.blocks, options);
    }

    // Where much is missing, K5..K8 without it may be far off, and with them the columns of effects that act
    // through them: what is there looks as if it were not.
    void look_with_a_guess() {
        const Search& s = findings_.search;
        if (s.verdict != Verdict::unexplained || !s.effects.empty() || !s.guess) return;
        const model::Dynamics<double> likely =
            dynamics_of(*s.guess, findings_.turning, request_.geometry.track_m);
        if (!(likely.k7_per_kg_m > 0) || close(likely, dictionary_->setting().dynamics)) return;
        Pass before = take_pass();
        make(likely, {});
        look_for_effects();
        if (findings_.search.effects.empty()) take_back(before);
    }

    // A report that lags by much is known only so well.
    double large_gap() const {
        constexpr double kGapBehindLag = 0.06;
        return given_.contains(kMeasurementLag) ? kGapBehindLag : kLargeGap;
    }
    // Which are no white noise.
    bool coarse_counts() const {
        return std::any_of(sensors_.effects.begin(), sensors_.effects.end(), [](const SensorEffect& e) {
            return e.effect == model::find_effect("encoder_quantisation");
        });
    }

    // Times of events are tried closer together, but not much closer than they can be told apart.
    void look_closer_at_events() {
        constexpr double kCloser = 4;  // each look than the one before
        constexpr double kOfError = 0.75;
        const Setting& setting = dictionary_->setting();
        double next_s = (event_spacing_s_ > 0 ? event_spacing_s_ : kEventSpacing * setting.span_s) / kCloser;
        if (event_spacing_s_ > 0) next_s = std::max(next_s, kOfError * event_error_s());
        event_spacing_s_ = std::max(next_s, 2 * setting.period_s);
    }
    double event_error_s() const {
        for (const NamedEffect& e : findings_.search.effects) {
            if (e.effect == model::find_effect("payload_step")) return e.unmoved[0];
        }
        return 0;
    }

    // Whether the effects found lie where their columns were made: a tenth of a standard error.
    bool near_enough() const {
        const Search& s = findings_.search;
        const double event_s = event_error_s();
        if (event_s > 0 && event_spacing_s_ > std::max(event_s, 2 * dictionary_->setting().period_s))
            return false;
        for (const NamedEffect& e : s.effects) {
            for (const Rival& r : e.rivals) {
                if (r.coarse && !r.alike) return false;
            }
            for (const Way& way : s.members) {
                if (way.effect != e.effect || way.kind == Way::Kind::linear) continue;
                if (way.kind == Way::Kind::grid) {
                    if (dictionary_->can_focus(way.effect) && !has_looked_at(way.effect)) return false;
                    continue;
                }
                const model::Parameters<double>& found = s.points.at(e.effect);
                for (std::size_t j = 0; j < e.parameters.size(); ++j) {
                    const double error = e.parameters[j].standard_error;  // 0: the log does not show it
                    if (error > 0 && std::abs(found[j] - way.at[j]) > 0.2 * error) return false;
                }
            }
        }
        return true;
    }

    // A closer look at where an effect was found has been taken, and was no better than the grid's point.
    bool has_looked_at(std::size_t effect) const {
        constexpr double kSame = 0.02;
        const std::span<const Way> ways = dictionary_->ways(effect);
        const model::Parameters<double>& found = findings_.search.points.at(effect);
        return std::any_of(ways.begin(), ways.end(), [&](const Way& way) {
            bool same = way.kind == Way::Kind::focus;
            for (std::size_t j = 0; j < found.size(); ++j)
                same = same && std::abs(found[j] - way.at[j]) <= kSame * std::abs(found[j]);
            return same;
        });
    }

    // Columns may depend on K5..K8 (a slope's do), which what was missing had spoilt, and on where an effect
    // that is not linear was looked for. The first `broad` looks have everything in the catalogue.
    void look_closer(int broad) {
        for (int again = 0; again < kMostPasses; ++again) {
            const bool leads = has_leads();
            if (findings_.search.effects.empty() && !leads) break;
            const model::Dynamics<double> found = dynamics_found();
            if (!leads && close(found, dictionary_->setting().dynamics) && near_enough()) break;
            Pass before = take_pass();
            const Points points = before.search.points;
            ++closer_looks_;
            look_closer_at_events();
            make(found, points, again < broad);
            look_for_effects();
            keep_what_was_not_tried(before.search);
            if (is_worse(findings_.search, before.search)) {
                take_back(before);
                break;
            }
        }
    }
    model::Dynamics<double> dynamics_found() const {
        return dynamics_of(findings_.search.after, findings_.turning, request_.geometry.track_m);
    }

    // An effect that closes next to nothing may only make up for another's being looked for in a wrong place.
    // Whether it is there still, once the others have found their places without it?
    void look_without_the_least() {
        constexpr double kNextToNothing = 0.05;
        const Search& s = findings_.search;
        if (s.effects.size() < 2 || s.verdict == Verdict::unexplained ||
            s.effects.back().closes > kNextToNothing)
            return;
        std::vector<std::size_t> others;
        Points points;
        for (std::size_t i = 0; i + 1 < s.effects.size(); ++i) {
            others.push_back(s.effects[i].effect);
            const auto found = s.points.find(others.back());
            if (found != s.points.end()) points.insert(*found);
        }
        if (points.empty()) return;  // what is linear has one place
        Pass before{findings_.search, *dictionary_, train_, report_};
        only_ = others;
        closer_looks_ = 0;
        make(dynamics_found(), points, false);
        look_for_effects();
        look_closer(0);
        only_.clear();
        if (findings_.search.effects.size() == others.size()) {
            make(dynamics_found(), Points(findings_.search.points), true);
            look_for_effects();
            keep_what_was_not_tried(before.search);
            if (findings_.search.effects.size() == others.size() &&
                findings_.search.verdict != Verdict::unexplained) {
                look_closer(0);
                return;
            }
        }
        take_back(before);
    }

    // What the gyro says of the wheels' report and of their radii.
    void take_sensors() {
        if (!sensors_.gyro || !findings_.turning) return;
        const Sensors::Gyro& gyro = *sensors_.gyro;
        constexpr double kShortLag_s = 0.003;
        const std::size_t lag = model::find_effect("measurement_lag");
        for (const SensorEffect& e : sensors_.effects) {
            if (e.effect == lag) given_[lag] = {e.value};
        }
        if (!given_.contains(lag) && 3 * gyro.lag_error_s < kShortLag_s) excluded_.push_back(lag);
        const double mismatch = std::abs(gyro.bend_per_m) * request_.geometry.track_m;
        const double error = gyro.bend_error * request_.geometry.track_m;
        if (mismatch + 3 * error < kSmallMismatch) {
            excluded_.push_back(model::find_effect("wheel_radius_mismatch"));
        }
    }

    // They come from no search, but are as much a part of what was found.
    void name_sensors() {
        Search& s = findings_.search;
        constexpr double kQuantile = 1.96;
        if (sensors_.gyro && findings_.turning) {  // tells unequal radii better than any acceleration
            const double track = request_.geometry.track_m;
            for (NamedEffect& e : s.effects) {
                if (e.effect != model::find_effect("wheel_radius_mismatch")) continue;
                // gyro = omega + x v / b with x = relative / (1 + relative / 2), both wheels' mean radius
                // kept
                const double bend = sensors_.gyro->bend_per_m * track;
                const double value = bend / (1 - bend / 2);
                const double error = std::hypot(sensors_.gyro->bend_error * track, 0.005 * value);
                if (std::abs(value - e.parameters[0].value) > 4 * e.parameters[0].standard_error) continue;
                e.parameters[0] = {
                    value, error, {value - kQuantile * error, value + kQuantile * error}, true};
            }
        }
        for (const SensorEffect& e : sensors_.effects) {
            if (e.effect == model::find_effect("measurement_lag") && !given_.contains(e.effect)) continue;
            NamedEffect named;
            named.effect = e.effect;
            named.probability = 0;
            named.parameters.push_back(
                {e.value,
                 e.standard_error,
                 {e.value - kQuantile * e.standard_error, e.value + kQuantile * e.standard_error},
                 true});
            s.effects.push_back(named);
        }
        if (s.verdict == Verdict::nothing_missing && !s.effects.empty()) {
            s.closable_share = std::numeric_limits<double>::quiet_NaN();  // it moves no wheel
            s.verdict = Verdict::named;
            s.reason = "what a sensor reports shows it directly";
        }
    }

    Setting setting_for(const model::Dynamics<double>& dynamics) const {
        Setting setting{request_.geometry, dynamics, peak_torque_Nm_, peak_speed_rad_per_s_, 0, 0, 0};
        for (const MeasuredLog& log : logs_) {
            setting.span_s = std::max(setting.span_s, log.samples.back().t_s - log.samples.front().t_s);
            for (const auto side : {&WheelPair<double>::left, &WheelPair<double>::right}) {
                setting.turned_rad = std::max(setting.turned_rad, turned_rad(log, side));
            }
        }
        setting.period_s = logs_.front().period_s;
        setting.closer_looks = closer_looks_;
        setting.event_spacing_s = event_spacing_s_;
        return setting;
    }

    static double turned_rad(const MeasuredLog& log, double WheelPair<double>::*side) {
        double angle = 0;
        double least = 0;
        double most = 0;
        for (const MeasuredSample& s : log.samples) {
            angle += log.period_s * s.speed_rad_per_s.*side;
            least = std::min(least, angle);
            most = std::max(most, angle);
        }
        return most - least;
    }

    void make(const model::Dynamics<double>& dynamics, Points points, bool grids = true) {
        const model::EffectSet<double> base = base_effects();
        for (std::size_t i = 0; i < model::kEffectCount; ++i) {
            if (base.active[i]) points.try_emplace(i, base.parameter[i]);
        }
        for (const auto& [effect, parameters] : given_) points[effect] = parameters;
        dictionary_.emplace(setting_for(dynamics), points, grids);
        const BlockOptions options = block_options(*dictionary_);
        train_ = make_blocks(training_, options);
        const Colour colour = colour_of_rest(train_, known_columns(*dictionary_));
        weigh(train_, colour);
        report_ = {};
        if (held_out_) {
            report_ = make_blocks(std::array{*held_out_}, options);
            weigh(report_, colour);
        }
    }

    BlockOptions block_options(const Dictionary& dictionary) const {
        BlockOptions options;
        options.dictionary = &dictionary;
        options.noise_rad_per_s = findings_.noise_rad_per_s;
        options.speed_rms_rad_per_s = speed_rms_;
        double total = 0;
        for (const LogPart& part : training_) total += part.log->period_s * double(part.end - part.first);
        // two dozens of blocks where the log allows it
        options.block_s = std::clamp(total / 24, 0.5, 2.0);
        return options;
    }

    // A member of the model as another dictionary has it, which was made with where the members are.
    static Way same_way(const Dictionary& dictionary, const Way& way) {
        if (way.kind == Way::Kind::linear) return way;
        const std::span<const Way> all = dictionary.ways(way.effect);
        Way same = all.back();  // the focus
        for (const Way& other : all) {
            if (way.kind == Way::Kind::grid && other.kind == way.kind && other.at == way.at) same = other;
        }
        if (way.amounts.empty()) same.amounts.clear();  // given, and not refitted
        return same;
    }

    // What the model found leaves, along all that motion, torque and time have to offer.
    void look_at_what_is_left() {
        Search& s = findings_.search;
        Points points;
        const model::EffectSet<double> named = effects_of(s.members, s.after, dictionary_->setting());
        for (const Way& way : s.members) {
            if (s.points.contains(way.effect)) points[way.effect] = named.parameter[way.effect];
        }
        for (const auto& [effect, parameters] : given_) points[effect] = parameters;
        const Dictionary dictionary(setting_for(dynamics_found()), points, false, true);
        BlockSet set = make_blocks(training_, block_options(dictionary));
        const Colour colour = colour_of_rest(set, known_columns(dictionary));
        weigh(set, colour);
        const Blocks blocks = pointers(set);
        const auto model = [&](std::size_t members) {
            ModelShape shape{{{{Dictionary::kTiming}}}, {}, findings_.turning};
            for (std::size_t i = 0; i < members; ++i) {
                const Way way = same_way(dictionary, s.members[i]);
                shape.amounts.insert(shape.amounts.end(), way.amounts.begin(), way.amounts.end());
                shape.fixed.insert(shape.fixed.end(), way.fixed.begin(), way.fixed.end());
            }
            return fit(blocks, shape, Spread::left_out);
        };
        const auto is_lag = [](const auto& one) { return one.place == "lag"; };
        const std::vector<Aspect> aspects = aspects_of(dictionary);
        const Fit after = model(s.members.size());
        const Fit base = model(s.base_members);
        const std::vector<Structure> missing = structures_beside(base, blocks, aspects);
        std::vector<Structure> left =
            s.members.size() == s.base_members ? missing : structures_beside(after, blocks, aspects);
        const double explained = base.squares - after.squares;
        double closable = std::max(0.0, explained);
        if (!missing.empty()) closable = std::max(closable, missing.front().squares);
        s.where.clear();
        for (const Structure& m : missing) put_place(m, closable);
        // columns at other points than the search's may fit worse than none
        if (explained < 0) return;
        const double explained_share = std::sqrt(explained / torque_squares(blocks, after));
        const auto lag = std::find_if(left.begin(), left.end(), is_lag);
        if (lag != left.end() && lag->sure && of_interest(*lag, explained_share)) {
            // that of the drive's speed loop, which answers to noise, is none
            weigh_where_motion_is_seen(set, colour);
            std::vector<Aspect> lags;
            std::copy_if(aspects.begin(), aspects.end(), std::back_inserter(lags), is_lag);
            const std::vector<Structure> seen = structures_beside(model(s.members.size()), blocks, lags);
            if (seen.empty() || !seen.front().sure || !of_interest(seen.front(), explained_share)) {
                left.erase(lag);
                if (s.members.size() == s.base_members)
                    std::erase_if(s.where, [](const Place& p) { return p.name == "lag"; });
            }
        }
        judge_what_is_left(left, explained_share);
        if (s.verdict != Verdict::unexplained || s.effects.empty() || left.empty() || !left.front().sure)
            return;
        // what is left beside what was named comes first
        std::erase_if(s.where, [&](const Place& p) { return p.name == left.front().place; });
        put_place(left.front(), std::max(closable, left.front().squares));
        std::rotate(s.where.begin(), s.where.end() - 1, s.where.end());
    }

    void put_place(const Structure& structure, double closable) {
        constexpr double kLeast = 0.02;
        const double share = structure.squares / closable;
        if (share > kLeast || structure.sure)
            findings_.search.where.push_back({std::string(structure.place), share});
    }

    // By enough; beside what a sensor tells only so well, by more.
    bool of_interest(const Structure& left, double explained_share) const {
        double least = explained_share > 0 ? kShownBeside : kShown;
        if (!given_.empty() || coarse_counts()) least = large_gap();
        return left.torque_share >= least &&
               left.torque_share >= kShareShownBeside * std::hypot(explained_share, left.torque_share);
    }

    // What depends on a place, by more than chance and by enough, is not explained by what was named.
    void judge_what_is_left(const std::vector<Structure>& left, double explained_share) {
        Search& s = findings_.search;
        if (s.verdict == Verdict::unexplained) return;
        const auto found = std::find_if(left.begin(), left.end(), [&](const Structure& l) {
            return l.sure && of_interest(l, explained_share);
        });
        if (found == left.end()) return;
        s.verdict = Verdict::unexplained;
        s.reason = (s.effects.empty()
                        ? "no effect that was looked for explains what depends on the "
                        : "beside what the effects found explain, something is left that depends on the ") +
                   std::string(found->place) + ": " + percent(found->torque_share) + " of the torque";
    }
    static std::string percent(double share) {
        std::array<char, 20> text{};
        std::snprintf(text.data(), text.size(), "%.3g %%", 100 * share);
        return text.data();
    }

    // A sensor that shows directly what the search was told not to look for: nothing else does that.
    void judge_sensors() {
        Search& s = findings_.search;
        const auto say = [&](const char* place, const std::string& what) {
            std::erase_if(s.where, [&](const Place& p) { return p.name == place; });
            s.where.insert(s.where.begin(), {place, 1.0});
            s.verdict = Verdict::unexplained;
            s.reason = "the gyro shows " + what + ", which no effect that was looked for does";
        };
        if (late_report_) say("lag", "that the wheel speeds are reported late");
        if (!sensors_.gyro || !findings_.turning || !left_out(model::find_effect("wheel_radius_mismatch")))
            return;
        const double mismatch = std::abs(sensors_.gyro->bend_per_m) * request_.geometry.track_m;
        const double error = sensors_.gyro->bend_error * request_.geometry.track_m;
        if (mismatch > kSmallMismatch + 3 * error)
            say("coupling of turning and driving", "that the robot turns as it drives straight on");
    }

    // All but those of effects that are known not to be there.
    std::vector<int> known_columns(const Dictionary& dictionary) const {
        std::vector<int> columns;
        const std::span<const Column> all = dictionary.columns();
        for (std::size_t c = 0; c < all.size(); ++c) {
            if (std::find(excluded_.begin(), excluded_.end(), all[c].effect) == excluded_.end())
                columns.push_back(static_cast<int>(c));
        }
        return columns;
    }

    model::EffectSet<double> base_effects() const {
        return request_.robot ? request_.robot->effects : model::EffectSet<double>{};
    }

    Blocks pointers(const BlockSet& set) const {
        Blocks blocks;
        for (const Block& b : set.blocks) blocks.push_back(&b);
        return blocks;
    }

    void first_model() {
        model::Dynamics<double> start;
        start.k7_per_kg_m = 1;
        make(start, {}, false);
        if (train_.blocks.size() < kFewestBlocks) {
            problem("too short: " + std::to_string(train_.blocks.size()) +
                    " pieces of at least half a second in which " +
                    "both wheels turn are left for the search, and it takes " +
                    std::to_string(kFewestBlocks) + "; drive for 20 s");
            return;
        }
        const Fit f = fit(pointers(train_), {{{{Dictionary::kTiming}}}, {}, findings_.turning});
        if (!(f.value(2) > 0)) {
            problem(
                "forward torque slows the robot down: is the sign of torque or "
                "speed wrong?");
            return;
        }
        if (findings_.turning && !(f.value(3) > 3 * f.error(3))) {
            if (f.value(3) < -3 * f.error(3)) {
                problem(
                    "torque turns the robot the wrong way: are left and right of "
                    "torque or speed swapped?");
                return;
            }
            findings_.turning = turned_with_an_effect(f);  // else turned, but not by the torques
        }
        findings_.blocks = train_.blocks.size();
        make(dynamics_of(f, findings_.turning, request_.geometry.track_m), {});
    }

    // Driven straight a robot may be turned by what is missing more than by the torques' difference: those
    // fit its turning only beside an effect that does.
    bool turned_with_an_effect(const Fit& without) const {
        constexpr double kMost = 0.5;  // of the squares, that such an effect leaves at most
        for (std::size_t i = 0; i < model::kEffectCount; ++i) {
            ModelShape shape;
            shape.amounts.push_back({{Dictionary::kTiming}});
            for (auto [c, end] = dictionary_->linear_columns(i); c < end; ++c) shape.amounts.push_back({{c}});
            if (shape.amounts.size() == 1) continue;
            const Fit with = fit(pointers(train_), shape);
            if (with.value(3) > 3 * with.error(3) && with.squares < kMost * without.squares) return true;
        }
        return false;
    }

    // Noise in the measured speeds stands in the weak form's regressors too, and may lead it astray. Where
    // the free run over the same pieces misses much, it has the last word, if that is clearly better.
    void refine() {
        Search& s = findings_.search;
        constexpr double kSmall = 0.02;  // of the speeds
        // What has a state of its own (a castor's direction, a gap's side) cannot start in the middle of a
        // log.
        for (const Way& way : s.members) {
            if (way.kind != Way::Kind::linear) return;
        }
        constexpr double kShot_s = 5;
        const std::vector<Stretch> shots = stretches(training_, kShot_s, request_.geometry);
        for (const bool named : {false, true}) {
            if (named && s.effects.empty()) break;
            Fit& f = named ? s.after : s.base;
            const std::vector<Way> members(
                s.members.begin(),
                s.members.begin() + std::ptrdiff_t(named ? s.members.size() : s.base_members));
            const std::optional<Refined> refined =
                refine_by_free_run(f, shots, kSmall * speed_rms_, [&](const Fit& trial) {
                    return SimulatedRobot{
                        request_.geometry, dynamics_of(trial, findings_.turning, request_.geometry.track_m),
                        effects_of(members, trial, dictionary_->setting()), findings_.turning};
                });
            if (!refined) continue;
            f = refined->fit;
            if (named) take_refined(s, dictionary_->setting());
        }
        if (s.effects.empty()) s.after = s.base;
        s.unknowable = unknowable(s.after, findings_.turning);
    }

    // As found, and for what this log cannot show some robot's: motions must be simulated with something.
    model::Dynamics<double> whole_dynamics() const {
        const Search& s = findings_.search;
        const double track_m = request_.geometry.track_m;
        model::Dynamics<double> k = dynamics_found();
        const auto unknown = [&](const char* name) {
            return std::find(s.unknowable.begin(), s.unknowable.end(), name) != s.unknowable.end();
        };
        if (unknown("K5") || unknown("K6")) k.k5_m = k.k6_per_m = 0;
        if (unknown("K7")) {
            k.k7_per_kg_m = k.k8_per_kg_m2 * track_m / 4;
        } else if (unknown("K8")) {
            k.k8_per_kg_m2 = 4 * k.k7_per_kg_m / track_m;
        }
        return k;
    }

    // What would tell the named ones from their rivals: a motion.
    void refine_names() {
        const Search& s = findings_.search;
        Confusion c;
        c.setting = dictionary_->setting();
        c.setting.dynamics = whole_dynamics();
        c.points = s.points;
        c.effects = effects_of(s.members, s.after, dictionary_->setting());
        c.members = s.members;
        c.torque_rms_Nm = train_.torque_rms_Nm;
        c.speed_rms_rad_per_s = speed_rms_;
        c.noise_rad_per_s = findings_.noise_rad_per_s;
        name_voltage_drag();
        for (NamedEffect& e : findings_.search.effects) {
            for (Rival& r : e.rivals) {
                if (r.torque_is_voltage) continue;
                c.effect = e.effect;
                c.rival = r.effect;
                const Separation found = separating_motion(c);
                r.motion = found.motion;
                r.motion_size_Nm = found.size_Nm;
            }
        }
    }

    // Drag in proportion to speed that takes most of the torque is what a torque column holds that was made
    // from the motors' voltage: their back-EMF was not taken off.
    void name_voltage_drag() {
        constexpr double kMostOfTheTorque = 0.5;
        constexpr std::size_t kViscous = model::find_effect("viscous_friction");
        constexpr std::size_t kBackEmf = model::find_effect("back_emf_limit");
        for (NamedEffect& e : findings_.search.effects) {
            if (e.effect != kViscous || e.torque_share < kMostOfTheTorque) continue;
            const auto is_back_emf = [](const Rival& r) { return r.effect == kBackEmf; };
            std::erase_if(e.rivals, is_back_emf);
            std::erase_if(e.ruled_out, is_back_emf);
            if (left_out(kBackEmf)) continue;
            Rival rival;
            rival.effect = kBackEmf;
            rival.alike = rival.torque_is_voltage = true;
            rival.keeps = 1;
            e.rivals.push_back(rival);
        }
    }

    void take_models() {
        const Search& s = findings_.search;
        const double track = request_.geometry.track_m;
        findings_.after_error = {s.after.error(0), s.after.error(1), s.after.error(2), s.after.error(3)};
        findings_.effects_before =
            effects_of({s.members.begin(), s.members.begin() + std::ptrdiff_t(s.base_members)}, s.base,
                       dictionary_->setting());
        findings_.effects_after = effects_of(s.members, s.after, dictionary_->setting());
        findings_.before = dynamics_of(s.base, findings_.turning, track);
        findings_.after = dynamics_found();
        if (request_.robot) {
            Fit nominal = s.base;
            const auto& k = request_.robot->dynamics;
            nominal.value.setZero();
            nominal.value.head<4>() << k.k5_m, k.k6_per_m, k.k7_per_kg_m, k.k8_per_kg_m2;
            Eigen::Index at = 5;  // after K5..K8 and the timing
            for (std::size_t m = 0; m < s.base_members; ++m) {
                const Way& way = s.members[m];
                model::Parameters<double> c = request_.robot->effects.parameter[way.effect];
                std::array<bool, model::kEffectCount> one{};
                one[way.effect] = true;
                model::for_each_active(one, [&]<typename Effect>(std::size_t) {
                    if constexpr (model::HasOwnCoordinates<Effect>) c = Effect::coordinates(c);
                });
                for (std::size_t i = 0; i < way.amounts.size(); ++i, ++at) {
                    // a point is the robot file's own
                    if (way.kind == Way::Kind::linear) nominal.value(at) = c[way.coordinate[i]];
                }
            }
            const Blocks all = pointers(train_);
            findings_.gap_nominal = squares(all, nominal) / row_count(all, nominal.shape);
        }
    }

    void free_runs() {
        const WheelPair<double>& noise = findings_.noise_rad_per_s;
        findings_.floor_rad_per_s = std::sqrt((noise.left * noise.left + noise.right * noise.right) / 2);
        if (!held_out_) return;
        const LogPart& part = *held_out_;
        const MeasuredLog& log = *part.log;
        const SimulatedRobot before{request_.geometry, findings_.before, findings_.effects_before,
                                    findings_.turning};
        const SimulatedRobot after{request_.geometry, findings_.after, findings_.effects_after,
                                   findings_.turning};
        std::optional<SimulatedRobot> nominal;
        if (request_.robot) {
            nominal = SimulatedRobot{request_.geometry, request_.robot->dynamics, request_.robot->effects,
                                     findings_.turning};
        }
        findings_.heldout_s = log.period_s * double(part.end - part.first - 1);
        std::vector<double> headings{part.initial_heading_rad};
        double power = 0;
        for (std::size_t i = part.first; i < part.end; ++i) {
            const WheelPair<double>& w = log.samples[i].speed_rad_per_s;
            headings.push_back(headings.back() +
                               log.period_s *
                                   model::twist_from_wheel_speeds(request_.geometry, w).omega_rad_per_s);
            power += w.left * w.left + w.right * w.right;
        }
        findings_.heldout_rms_rad_per_s = std::sqrt(power / (2.0 * double(part.end - part.first)));
        for (const double window : {1.0, 5.0, 10.0, 0.0}) {
            FreeRun result;
            result.window_s = window;
            const std::size_t length = window == 0
                                           ? part.end - part.first
                                           : static_cast<std::size_t>(std::lround(window / log.period_s)) + 1;
            if (length > part.end - part.first) continue;
            const auto rms = [&](const SimulatedRobot& robot) {
                double both = 0;
                double forward = 0;
                result.windows = 0;
                for (std::size_t from = part.first; from + length <= part.end; from += length - 1) {
                    both += free_run(robot, {&log, from, from + length, headings[from - part.first]},
                                     log.samples[from].speed_rad_per_s,
                                     [&](std::size_t i, const WheelPair<double>& simulated) {
                                         const WheelPair<double>& measured = log.samples[i].speed_rad_per_s;
                                         forward += std::pow((simulated.sum() - measured.sum()) / 2, 2);
                                     });
                    ++result.windows;
                }
                const auto count = static_cast<double>(result.windows * (length - 1));
                return SpeedError{std::sqrt(both / (2 * count)), std::sqrt(forward / count)};
            };
            if (nominal) result.nominal = rms(*nominal);
            result.before = rms(before);
            result.after = rms(after);
            findings_.heldout.push_back(result);
        }
        // a picture of it: the first ten seconds, the left wheel
        const std::size_t end = std::min(part.end, part.first + static_cast<std::size_t>(10 / log.period_s));
        Trace& trace = findings_.trace;
        const Stretch shown{&log, part.first, end, part.initial_heading_rad};
        const WheelPair<double>& start = log.samples[part.first].speed_rad_per_s;
        free_run(before, shown, start, [&](std::size_t i, const WheelPair<double>& w) {
            trace.t_s.push_back(log.samples[i].t_s);
            trace.measured.push_back(log.samples[i].speed_rad_per_s.left);
            trace.before.push_back(w.left);
        });
        free_run(after, shown, start,
                 [&](std::size_t, const WheelPair<double>& w) { trace.after.push_back(w.left); });
    }

    // Mean torque that is missing, forward, over 0.1 s, in bins of the mean wheel
    // speed.
    void curves() {
        constexpr std::size_t kBins = 24;
        constexpr double kSpan_s = 0.1;
        std::vector<std::array<double, 3>> points;
        double fastest = 0;
        const auto missing = [&](const MeasuredLog& log, std::size_t from, std::size_t to,
                                 const model::Dynamics<double>& k, const model::EffectSet<double>& effects) {
            double torque = 0;
            double product = 0;
            for (std::size_t i = from; i < to; ++i) {
                model::Motion<double> m;
                m.wheel_speed_rad_per_s = log.samples[i].speed_rad_per_s;
                m.twist = model::twist_from_wheel_speeds(request_.geometry, m.wheel_speed_rad_per_s);
                m.heading_rad = heading_[&log - logs_.data()][i];
                const model::EffectContext<double> context{m, log.samples[i].torque_Nm, request_.geometry, k};
                const WheelPair<double> smooth = model::smooth_effect_torque_Nm(effects, context);
                torque += model::delivered_torque_Nm(effects, context).sum() + smooth.sum();
                model::for_each_dry(effects, request_.geometry,
                                    [&](std::size_t, unsigned, const WheelPair<double>& d, double limit) {
                                        const double s = model::sliding_speed(d, m.wheel_speed_rad_per_s);
                                        torque -= limit * (s > 0 ? 1.0 : s < 0 ? -1.0 : 0.0) * d.sum();
                                    });
                product += m.twist.omega_rad_per_s * m.twist.omega_rad_per_s;
            }
            const double n = double(to - from);
            const double gained =
                model::twist_from_wheel_speeds(request_.geometry, log.samples[to].speed_rad_per_s).v_m_per_s -
                model::twist_from_wheel_speeds(request_.geometry, log.samples[from].speed_rad_per_s)
                    .v_m_per_s;
            return ((gained / (n * log.period_s) - k.k5_m * product / n) / k.k7_per_kg_m - torque / n) / 2;
        };
        for (const MeasuredLog& log : logs_) {
            std::vector<double> heading{log.start_heading_rad};
            for (const MeasuredSample& s : log.samples) {
                heading.push_back(
                    heading.back() +
                    log.period_s *
                        model::twist_from_wheel_speeds(request_.geometry, s.speed_rad_per_s).omega_rad_per_s);
            }
            heading_.push_back(std::move(heading));
        }
        for (const MeasuredLog& log : logs_) {
            const auto span = static_cast<std::size_t>(std::max(1.0, std::round(kSpan_s / log.period_s)));
            for (std::size_t from = 0; from + span < log.samples.size(); from += span) {
                double speed = 0;
                for (std::size_t i = from; i < from + span; ++i)
                    speed += log.samples[i].speed_rad_per_s.sum() / 2;
                speed /= double(span);
                fastest = std::max(fastest, std::abs(speed));
                points.push_back({speed,
                                  missing(log, from, from + span, findings_.before, findings_.effects_before),
                                  missing(log, from, from + span, findings_.after, findings_.effects_after)});
            }
        }
        std::array<std::array<double, 4>, kBins> bins{};
        for (const auto& p : points) {
            const auto b =
                std::min(kBins - 1, static_cast<std::size_t>((p[0] / fastest + 1) / 2 * double(kBins)));
            bins[b][0] += 1;
            for (std::size_t i = 0; i < 3; ++i) bins[b][i + 1] += p[i];
        }
        for (const auto& b : bins) {
            if (b[0] < 5) continue;
            findings_.against_speed.x.push_back(b[1] / b[0]);
            findings_.against_speed.before.push_back(b[2] / b[0]);
            findings_.against_speed.after.push_back(b[3] / b[0]);
        }
    }

    const Request& request_;
    Findings findings_;
    std::vector<MeasuredLog> logs_;
    std::size_t last_file_ = 0;  // its first stretch
    std::vector<LogPart> training_;
    std::optional<LogPart> held_out_;
    std::vector<std::vector<bool>> unusable_;  // samples of each log
    Sensors sensors_;
    Points given_;
    std::vector<std::size_t> excluded_;
    std::vector<std::size_t> only_;  // these are looked for, or, if none, all
    BlockSet train_, report_;
    bool late_report_ = false;  // the gyro says so, and it is left out on request
    double speed_rms_ = 0;
    int closer_looks_ = 0;
    double event_spacing_s_ = 0;
    std::optional<Dictionary> dictionary_;
    double peak_torque_Nm_ = 0, peak_speed_rad_per_s_ = 0;
    std::vector<std::vector<double>> heading_;
};

}  // namespace

Findings analyse(const Request& request) { return Analysis(request).run(); }

}  // namespace wheelwright::gap
