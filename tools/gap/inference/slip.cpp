#include "tools/gap/inference/slip.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <limits>
#include <string_view>
#include <utility>

#include "tools/gap/hypotheses/wheel_slip.hpp"
#include "tools/gap/inference/estimates.hpp"
#include "tools/gap/inference/policy.hpp"
#include "tools/gap/inference/statistics.hpp"
#include "tools/gap/model/columns.hpp"
#include "tools/gap/model/fit.hpp"
#include "tools/gap/model/members.hpp"
#include "tools/gap/model/rows.hpp"

namespace wheelwright::gap {
namespace {

using tools::MeasuredLog;

constexpr int kColumns = 7;
using Row = Eigen::Matrix<double, kColumns, 1>;
using Square = Eigen::Matrix<double, kColumns, kColumns>;

// Two lags one behind the other, as a drive's encoder loop has them, of some signals at once.
template <int kCount>
class TwoLags {
  public:
    using Signals = Eigen::Matrix<double, kCount, 1>;
    TwoLags(double each_s, double period_s) : keeps_(each_s > 0 ? std::exp(-period_s / each_s) : 0.0) {}
    const Signals& operator()(const Signals& now) {
        if (first_) one_ = two_ = now;
        first_ = false;
        one_ += (1 - keeps_) * (now - one_);
        two_ += (1 - keeps_) * (one_ - two_);
        return two_;
    }

  private:
    double keeps_;
    Signals one_ = Signals::Zero(), two_ = Signals::Zero();
    bool first_ = true;
};

struct GyroSum {
    Square xx = Square::Zero();
    Row xy = Row::Zero();
    double yy = 0;
};

// gyro = bias, wheels' yaw rate, its first and second change, forward speed, torques' difference (what is
// late in any other way), torques times speeds; gyro and torques late by two lags of `each_s`. By blocks.
std::vector<GyroSum> sums(const std::vector<MeasuredLog>& logs, const model::Geometry<double>& g,
                          double each_s) {
    constexpr double kBlock_s = 1;
    std::vector<GyroSum> blocks;
    for (const MeasuredLog& log : logs) {
        TwoLags<3> lags(each_s, log.period_s);
        const auto length = static_cast<std::size_t>(std::max(4.0, kBlock_s / log.period_s));
        const auto yaw = [&](std::size_t i) {
            return model::twist_from_wheel_speeds(g, log.samples[i].speed_rad_per_s).omega_rad_per_s;
        };
        for (std::size_t i = 0; i < log.samples.size(); ++i) {
            const tools::MeasuredSample& s = log.samples[i];
            const WheelPair<double>& w = s.speed_rad_per_s;
            const Eigen::Vector3d late =
                lags({s.gyro_rad_per_s, s.torque_Nm.difference(),
                      std::abs(w.right) * s.torque_Nm.right - std::abs(w.left) * s.torque_Nm.left});
            if (i % length == 0) blocks.emplace_back();
            if (i == 0 || i + 1 == log.samples.size()) continue;
            Row x;
            x << 1, yaw(i), model::twist_from_wheel_speeds(g, w).v_m_per_s, (yaw(i + 1) - yaw(i - 1)) / 2,
                yaw(i + 1) - 2 * yaw(i) + yaw(i - 1), late(1), late(2);
            blocks.back().xx += x * x.transpose();
            blocks.back().xy += late(0) * x;
            blocks.back().yy += late(0) * late(0);
        }
    }
    return blocks;
}

}  // namespace

std::optional<RollingSlip> slip_by_gyro(const std::vector<MeasuredLog>& logs,
                                        const model::Geometry<double>& g) {
    constexpr double kSure = 4;  // standard errors: the rows must say so as well
    constexpr double kLeastShare =
        0.001;  // of the yaw rate: no track is known better, and lags leave as much
    constexpr double kLongest_s = 0.015, kStep = 1.25;
    if (logs.empty() ||
        !std::all_of(logs.begin(), logs.end(), [](const MeasuredLog& l) { return l.has_gyro; }))
        return std::nullopt;
    double least = std::numeric_limits<double>::infinity();
    double share = 0;  // of the yaw rate that the slip makes, RMS over RMS
    RollingSlip best;
    for (double each_s = 0; each_s<kLongest_s; each_s = each_s> 0 ? kStep * each_s : 0.0005) {
        const std::vector<GyroSum> blocks = sums(logs, g, each_s);
        GyroSum all;
        for (const GyroSum& b : blocks) {
            all.xx += b.xx;
            all.xy += b.xy;
            all.yy += b.yy;
        }
        const Row scale = all.xx.diagonal().cwiseSqrt().cwiseMax(1e-12).cwiseInverse();
        const auto scaled = [&](const Square& m) {
            return Square(scale.asDiagonal() * m * scale.asDiagonal());
        };
        const Square inverse =
            Square(scaled(all.xx) + 1e-10 * Square::Identity()).ldlt().solve(Square::Identity());
        const Row value = inverse * scale.cwiseProduct(all.xy);
        const double residual = all.yy - value.dot(scale.cwiseProduct(all.xy));
        if (residual >= least) continue;
        least = residual;
        Square spread = Square::Zero();
        for (const GyroSum& b : blocks) {
            const Row score = scale.cwiseProduct(b.xy) - scaled(b.xx) * value;
            spread += score * score.transpose();
        }
        const double error = std::sqrt((inverse * spread * inverse)(kColumns - 1, kColumns - 1));
        // the wheels turn the robot by more than the gyro sees
        best = {-g.track_m * scale(kColumns - 1) * value(kColumns - 1),
                g.track_m * scale(kColumns - 1) * error};
        // columns that are scaled have a root mean square of one, the yaw rate's of its own scale's inverse
        share = std::abs(value(kColumns - 1)) * scale(1);
    }
    if (!(best.value > kSure * best.error) || share < kLeastShare) return std::nullopt;
    return best;
}

bool found_slip(const Search& search) {
    return std::any_of(search.members.begin() + std::ptrdiff_t(search.base_members), search.members.end(),
                       [](const Candidate& candidate) { return candidate.effect == kSlip; });
}

bool may_slip(const Search& search, const Known& known) {
    return !contains(search.members, kSlip) &&
           std::find(known.excluded.begin(), known.excluded.end(), kSlip) == known.excluded.end();
}

SlipInRows slip_in_rows(const Search& search, const ResidualOptions& options) {
    constexpr double kSure = kPolicy.false_alarm / double(model::kEffectCount);
    const bool rolls = !contains(search.members, kSlip);
    Points points = options.known.given;
    for (const Candidate& candidate : search.members) {
        if (candidate.kind != Candidate::Kind::linear && search.points.contains(candidate.effect))
            points[candidate.effect] = search.points.at(candidate.effect);
    }
    if (rolls) points[kSlip] = {1, 0.1, 0, 1};
    const Dictionary dictionary(options.setting, points, false, true);
    BlockOptions block_options = options.blocks;
    block_options.dictionary = &dictionary;
    block_options.kept = nullptr;
    const WeighedBlocks weighed = weighed_blocks(options.training, block_options, options.known.excluded);
    const Blocks blocks = pointers(weighed.set);
    Members others;
    Candidate slip = dictionary.candidates(kSlip).back();
    for (const Candidate& member : search.members) {
        (member.effect == kSlip ? slip : others.emplace_back()) = same_candidate(dictionary, member);
    }
    // the first amount is in proportion to the slip speed, or the effect as a whole
    const Amount amount = rolls ? slip.amounts.front() : directions(slip).front();
    ModelShape shape = shape_of(others, options.turning);
    shape.amounts.push_back(amount);
    const Eigen::Index at = kFirstAmount + static_cast<Eigen::Index>(shape.amounts.size()) - 1;
    const auto sure = [&](const Fit& f) {
        const double degrees = std::max(1.0, double(blocks.size()) - 5);
        return f.value(at) > 0 && t_probability(f.value(at) / f.error(at), degrees) <= 2 * kSure;
    };
    const Fit usual = fit(blocks, shape);
    // what stands for no effect and is no slip either; what comes late has columns among the places
    const auto add = [&](std::pair<int, int> of, std::initializer_list<std::string_view> but) {
        for (auto [c, end] = of; c < end; ++c) {
            const std::string_view place = dictionary.columns()[std::size_t(c)].place;
            if (std::find(but.begin(), but.end(), place) == but.end()) shape.amounts.push_back({{c}});
        }
    };
    add(dictionary.rich_columns(), {"lag", "torque times speed"});
    add(dictionary.place_columns(), {"torque times speed", "wheel angle", "time"});
    const int column = amount.columns.front();
    const double per = slip_speed_per(options.setting);
    return {{usual.value(at) / per, usual.error(at) / per},
            sure(usual) && sure(fit(blocks, shape)),
            usual.value(at) * std::sqrt(weighed.set.wheel_power(column, column)) / weighed.set.torque_rms_Nm};
}

std::optional<SlipFound> slip_of(const std::optional<RollingSlip>& gyro, const SlipInRows& rows,
                                 const Setting& setting) {
    constexpr double kAlso = 2.576;  // one in a hundred
    constexpr double kAlone = 8;     // twice what is enough beside the rows: lags that are no two of a kind
                                     // make six of what is none
    constexpr double kLaws = 0.7;    // as unsure as a tyre's law
    const double per = slip_speed_per(setting);
    const auto found = [per](double value, double error) {
        return SlipFound{{1, per * value, 0, 1}, per * error};
    };
    const auto& [value, error] = rows.rolling;
    if (gyro && std::abs(gyro->value - value) < kLaws * std::max(gyro->value, value) &&
        value > kAlso * error) {
        const double apart = std::hypot(gyro->error, error);
        const double gyros_weight = std::pow(error / apart, 2);
        return found(gyros_weight * gyro->value + (1 - gyros_weight) * value, gyro->error * error / apart);
    }
    if (gyro && gyro->value > kAlone * gyro->error && value > -kAlso * error)
        return found(gyro->value, gyro->error);
    if (rows.surely && rows.torque_share >= kPolicy.effect) return found(value, error);
    return std::nullopt;
}

NamedEffect named_slip(const SlipFound& slip, const Setting& setting) {
    NamedEffect named;
    named.effect = kSlip;
    named.probability = 0;
    named.in_file = false;
    Candidate candidate;
    candidate.effect = kSlip;
    candidate.kind = Candidate::Kind::linearised;
    for (std::size_t j = 0; j < model::kEffects[kSlip].parameters.size(); ++j) {
        const double value = slip.parameters[j];
        named.parameters.push_back({value, j == 1 ? slip.error : 0.0, {value, value}, j == 1});
    }
    named.unmoved.assign(named.parameters.size(), 0.0);
    widen(candidate, setting, named.unmoved, named.parameters);
    return named;
}

}  // namespace wheelwright::gap
