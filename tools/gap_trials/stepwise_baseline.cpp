#include "tools/gap_trials/stepwise_baseline.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "tools/gap/model/fit.hpp"
#include "tools/logs/read_measured.hpp"

namespace wheelwright::tools {
namespace {

using gap::Candidate;
using Json = nlohmann::ordered_json;

constexpr std::size_t kMostEffects = 6;
constexpr Eigen::Index kFirstAmount = 5;  // behind K5..K8 and the timing

class Stepwise {
  public:
    Stepwise(const MeasuredLog& log, const model::Geometry<double>& geometry) : log_(log) {
        setting_.geometry = geometry;
        setting_.dynamics.k7_per_kg_m = 1;
        setting_.span_s = log.samples.back().t_s - log.samples.front().t_s;
        setting_.period_s = log.period_s;
        for (const MeasuredSample& s : log.samples) {
            for (const auto side : {&WheelPair<double>::left, &WheelPair<double>::right}) {
                setting_.peak_torque_Nm = std::max(setting_.peak_torque_Nm, std::abs(s.torque_Nm.*side));
                setting_.peak_speed_rad_per_s =
                    std::max(setting_.peak_speed_rad_per_s, std::abs(s.speed_rad_per_s.*side));
            }
        }
    }

    // False: the log has too little for it.
    bool run() {
        if (!make()) return false;
        // columns of some effects depend on K5..K8
        const gap::Fit base = fit({});
        setting_.dynamics = {base.value(0), base.value(1), base.value(2), base.value(3)};
        if (!(base.value(2) > 0) || !(base.value(3) > 0) || !make()) return false;
        double now = criterion(chosen_);
        for (;;) {
            double best = now;
            std::vector<Candidate> better;
            const auto consider = [&](std::vector<Candidate> members) {
                const double told = criterion(members);
                if (told < best) {
                    best = told;
                    better = std::move(members);
                }
            };
            for (std::size_t i = 0; i < chosen_.size(); ++i) {
                std::vector<Candidate> fewer = chosen_;
                fewer.erase(fewer.begin() + static_cast<std::ptrdiff_t>(i));
                consider(std::move(fewer));
            }
            if (chosen_.size() < kMostEffects) {
                for (const Candidate& candidate : all_ways()) {
                    std::vector<Candidate> more = chosen_;
                    more.push_back(candidate);
                    consider(std::move(more));
                }
            }
            if (!(best < now)) return true;
            now = best;
            chosen_ = std::move(better);
        }
    }

    Json effects() const {
        const gap::Fit f = fit(chosen_);
        Json told = Json::array();
        Eigen::Index at = kFirstAmount;
        for (const Candidate& candidate : chosen_) {
            const auto count = static_cast<Eigen::Index>(candidate.amounts.size());
            const auto [values, plausible] =
                gap::parameters_of(candidate, f.value.segment(at, count), setting_);
            at += count;
            const model::EffectInfo& info = model::kEffects[candidate.effect];
            Json parameters = Json::array();
            for (std::size_t j = 0; j < info.parameters.size(); ++j) {
                if (std::isfinite(values[j]))
                    parameters.push_back({{"name", info.parameters[j].name}, {"value", values[j]}});
            }
            told.push_back({{"name", info.name}, {"parameters", parameters}, {"rivals", Json::array()}});
        }
        return told;
    }

  private:
    bool make() {
        dictionary_.emplace(setting_, gap::Points{});
        gap::BlockOptions options;
        options.dictionary = &*dictionary_;
        options.noise_rad_per_s = gap::speed_noise(std::span(&log_, 1));
        double squares = 0;
        for (const MeasuredSample& s : log_.samples) {
            squares += std::pow(s.speed_rad_per_s.left, 2) + std::pow(s.speed_rad_per_s.right, 2);
        }
        options.speed_rms_rad_per_s = std::sqrt(squares / (2 * double(log_.samples.size())));
        set_ = gap::make_blocks(
            std::array{gap::LogPart{&log_, 0, 0, log_.samples.size(), log_.start_heading_rad, nullptr}},
            options);
        gap::weigh(set_, gap::Colour{});
        blocks_.clear();
        for (const gap::Block& block : set_.blocks) blocks_.push_back(&block);
        return blocks_.size() > 2;
    }

    std::vector<Candidate> all_ways() const {
        std::vector<Candidate> candidates;
        for (std::size_t effect = 0; effect < model::kEffectCount; ++effect) {
            if (std::any_of(chosen_.begin(), chosen_.end(),
                            [&](const Candidate& w) { return w.effect == effect; }))
                continue;
            const auto [first, end] = dictionary_->linear_columns(effect);
            if (first == end) {
                const auto start = dictionary_->candidates(effect);
                candidates.insert(candidates.end(), start.begin(), start.end());
                continue;
            }
            Candidate candidate;
            candidate.effect = effect;
            for (int column = first; column < end; ++column) {
                if (!(set_.wheel_power(column, column) > 0)) continue;
                candidate.amounts.push_back({{column}});
                candidate.coordinate.push_back(static_cast<unsigned>(column - first));
            }
            if (candidate.amounts.empty()) continue;
            candidates.push_back(candidate);
            // left and right of one size
            const auto& p = model::kEffects[effect].parameters;
            if (candidate.amounts.size() == 2 && p[0].name.starts_with("left") && p[0].minimum >= 0) {
                candidate.together = true;
                candidate.amounts = {{{first, first + 1}}};
                candidate.coordinate = {0};
                candidates.push_back(candidate);
            }
        }
        return candidates;
    }

    gap::Fit fit(const std::vector<Candidate>& members) const {
        gap::ModelShape shape;
        shape.amounts.push_back({{gap::Dictionary::kTiming}});
        for (const Candidate& candidate : members) {
            shape.amounts.insert(shape.amounts.end(), candidate.amounts.begin(), candidate.amounts.end());
            shape.fixed.insert(shape.fixed.end(), candidate.fixed.begin(), candidate.fixed.end());
        }
        return gap::fit(blocks_, shape);
    }

    double criterion(const std::vector<Candidate>& members) const {
        const gap::Fit f = fit(members);
        Eigen::Index at = kFirstAmount;
        for (const Candidate& candidate : members) {
            const auto count = static_cast<Eigen::Index>(candidate.amounts.size());
            if (!gap::parameters_of(candidate, f.value.segment(at, count), setting_).second)
                return std::numeric_limits<double>::infinity();
            at += count;
        }
        const auto unknowns = static_cast<double>(f.value.size());
        if (!(f.squares > 0)) return std::numeric_limits<double>::infinity();
        return f.rows * std::log(f.squares / f.rows) + unknowns * std::log(f.rows);
    }

    MeasuredLog log_;
    gap::Setting setting_;
    std::optional<gap::Dictionary> dictionary_;
    gap::BlockSet set_;
    gap::Blocks blocks_;
    std::vector<Candidate> chosen_;
};

}  // namespace

std::string stepwise_baseline_json(const std::string& log, const model::Geometry<double>& geometry) {
    Json answer{{"verdict", "unusable_log"}, {"effects", Json::array()}};
    const MeasuredLogs read = read_measured_log(log);
    if (!read.segments.empty()) {
        Stepwise search(read.segments.front(), geometry);
        if (search.run()) {
            answer["effects"] = search.effects();
            answer["verdict"] = answer["effects"].empty() ? "nothing_missing" : "named";
        }
    }
    return answer.dump(1) + "\n";
}

}  // namespace wheelwright::tools
