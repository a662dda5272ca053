#include "tools/gap/inference/slip.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "tools/gap/hypotheses/wheel_slip.hpp"
#include "tools/gap/inference/estimates.hpp"
#include "tools/gap/inference/statistics.hpp"
#include "tools/gap/model/columns.hpp"
#include "tools/gap/model/fit.hpp"
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

bool may_slip(const Search& search, const Known& known) {
    return std::find(known.excluded.begin(), known.excluded.end(), kSlip) == known.excluded.end() &&
           std::none_of(search.members.begin(), search.members.end(),
                        [](const Candidate& candidate) { return candidate.effect == kSlip; });
}

RollingSlip slip_in_rows(const Search& search, const ResidualOptions& options) {
    Points points = options.known.given;
    for (const Candidate& candidate : search.members) {
        if (candidate.kind != Candidate::Kind::linear && search.points.contains(candidate.effect))
            points[candidate.effect] = search.points.at(candidate.effect);
    }
    points[kSlip] = {1, 0.1, 0, 1};
    const Dictionary dictionary(options.setting, points, false);
    BlockOptions block_options = options.blocks;
    block_options.dictionary = &dictionary;
    block_options.kept = nullptr;
    const WeighedBlocks weighed = weighed_blocks(options.training, block_options, options.known.excluded);
    Members members;
    for (const Candidate& member : search.members) members.push_back(same_candidate(dictionary, member));
    ModelShape shape = shape_of(members, options.turning);
    // in proportion to the slip speed
    shape.amounts.push_back(dictionary.candidates(kSlip).back().amounts.front());
    const Fit f = fit(pointers(weighed.set), shape);
    const Eigen::Index last = f.value.size() - 1;
    const double per = slip_speed_per(options.setting);
    return {f.value(last) / per, f.error(last) / per};
}

std::optional<SlipFound> slip_of(const RollingSlip& gyro, const RollingSlip& rows, const Setting& setting) {
    constexpr double kAlso = 2.576;  // one in a hundred
    constexpr double kAlone = 8;     // twice what is enough beside the rows: lags that are no two of a kind
                                     // make six of what is none
    constexpr double kLaws = 0.7;    // as unsure as a tyre's law
    const double per = slip_speed_per(setting);
    const double apart = std::hypot(gyro.error, rows.error);
    const bool same = std::abs(gyro.value - rows.value) < kLaws * std::max(gyro.value, rows.value);
    if (same && rows.value > kAlso * rows.error) {
        const double gyros_weight = std::pow(rows.error / apart, 2);
        const double mean = gyros_weight * gyro.value + (1 - gyros_weight) * rows.value;
        return SlipFound{{1, per * mean, 0, 1}, per * gyro.error * rows.error / apart};
    }
    if (gyro.value > kAlone * gyro.error && rows.value > -kAlso * rows.error)
        return SlipFound{{1, per * gyro.value, 0, 1}, per * gyro.error};
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
