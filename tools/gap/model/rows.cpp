#include "tools/gap/model/rows.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include "tools/gap/model/products.hpp"

namespace wheelwright::gap {
namespace {

using tools::MeasuredLog;
using tools::MeasuredSample;

constexpr double kPi = 3.14159265358979323846;
constexpr double kShortestBlock_s = 0.5;
constexpr int kFewestIntervals = 20;
constexpr double kHighest_Hz = 25;  // of a row
constexpr double kStanding_s = 0.02;
constexpr double kStandingShare = 0.005;  // of the RMS speed: slower than this for longer than that stands

// The mean power of the torques is taken from every sixth interval.
constexpr Eigen::Index kPowerOf = 6;

// As long as this an interval may become, where a log's are shorter.
constexpr double kLongest_s = 0.005;

double mean_product(double a0, double a1, double b0, double b1) {
    return (2 * a0 * b0 + a0 * b1 + a1 * b0 + 2 * a1 * b1) / 6;
}

// Of a block of so many intervals; only the first half is kept.
const Sines& sines(int intervals, int rows, std::map<std::pair<int, int>, Sines>& known) {
    Sines& s = known[{intervals, rows}];
    if (s.odd.size() == 0) {
        const int half = (intervals + 1) / 2;
        s.odd.resize(half, (rows + 1) / 2);
        s.even.resize(half, rows / 2);
        for (int k = 1; k <= rows; ++k) {
            const double scale = 1 / (std::sqrt(2.0 * intervals) * std::sin(k * kPi / (2.0 * intervals)));
            for (int n = 0; n < half; ++n) {
                (k % 2 == 1 ? s.odd : s.even)(n, (k - 1) / 2) =
                    scale * std::sin(k * kPi * (n + 0.5) / intervals);
            }
        }
    }
    return s;
}
// `x`: columns by interval.
Eigen::MatrixXd transformed(const Sines& s, const Eigen::MatrixXd& x) {
    const Eigen::Index whole = x.cols() / 2;  // an interval in the middle belongs to no pair
    const Eigen::Index half = s.odd.rows();
    Eigen::MatrixXd sum = x.leftCols(half);
    Eigen::MatrixXd difference = x.leftCols(half);
    for (Eigen::Index n = 0; n < whole; ++n) {
        sum.col(n) += x.col(x.cols() - 1 - n);
        difference.col(n) -= x.col(x.cols() - 1 - n);
    }
    Eigen::MatrixXd rows(s.odd.cols() + s.even.cols(), x.rows());
    rows(Eigen::seqN(0, s.odd.cols(), 2), Eigen::all) = product(sum, s.odd).transpose();
    rows(Eigen::seqN(1, s.even.cols(), 2), Eigen::all) = product(difference, s.even).transpose();
    return rows;
}

class Maker {
  public:
    Maker(const BlockOptions& options, BlockSet& to)
        : options_(options),
          to_(to),
          geometry_(options.dictionary->setting().geometry),
          kept_(options.kept != nullptr ? *options.kept : nothing_kept_) {
        const std::span<const Column> columns = options.dictionary->columns();
        const auto count = static_cast<Eigen::Index>(columns.size());
        to_.wheel_power = Eigen::MatrixXd::Zero(count, count);
        for (std::size_t c = 0; c < columns.size(); ++c) {
            const std::optional<Source>& source = columns[c].source;
            const auto found =
                source ? std::find(kept_.source.begin(), kept_.source.end(), *source) : kept_.source.end();
            fresh_.push_back(found == kept_.source.end());
            slot_.push_back(fresh_.back() ? fresh_count_++ : found - kept_.source.begin());
        }
        if (options.kept == nullptr) return;
        for (std::size_t c = 0; c < columns.size(); ++c) {
            if (!fresh_[c] || !columns[c].source) continue;
            kept_.source.push_back(*columns[c].source);
            to_keep_.push_back(slot_[c]);
        }
    }

    void add(const LogPart& part) {
        const MeasuredLog& log = *part.log;
        const double dt = log.period_s;
        heading_ = log.start_heading_rad;
        angle_ = {};
        span_s_ = log.samples.back().t_s - log.samples.front().t_s;
        walker_.emplace(*options_.dictionary, fresh_);
        come_to(part);
        const int longest = std::max(kFewestIntervals, static_cast<int>(std::lround(options_.block_s / dt)));
        const int shortest = std::max(kFewestIntervals, static_cast<int>(std::lround(kShortestBlock_s / dt)));
        const std::size_t last = part.end - 1;  // intervals are first .. last - 1
        std::size_t i = part.first;
        while (i < last) {
            // a run without a wheel that stands while the other turns, or a sample that cannot be used
            std::size_t run = i;
            while (run < last && !unusable(part, run, last)) ++run;
            const auto length = static_cast<int>(run - i);
            if (length >= shortest) {
                const int pieces = std::max(1, static_cast<int>(std::lround(double(length) / longest)));
                for (int p = 0; p < pieces; ++p) {
                    const std::size_t begin =
                        i + static_cast<std::size_t>(length) * std::size_t(p) / std::size_t(pieces);
                    const std::size_t end =
                        i + static_cast<std::size_t>(length) * std::size_t(p + 1) / std::size_t(pieces);
                    block(part, begin, end);
                }
            } else {
                for (std::size_t n = i; n < run; ++n) pass(part, n);
            }
            for (i = run; i < last && unusable(part, i, last); ++i) {
                pass(part, i);
            }
        }
    }

    void finish() {
        if (used_ > 0) to_.wheel_power /= double(used_);
        to_.torque_rms_Nm = std::sqrt(to_.wheel_power(Dictionary::kTorque, Dictionary::kTorque));
    }

  private:
    // A part begins where the log has come to: angles all the way, what forgets from a little before on.
    void come_to(const LogPart& part) {
        constexpr double kRemembered_s = 2;
        const auto remembered = static_cast<std::size_t>(kRemembered_s / part.log->period_s);
        for (std::size_t i = 0; i < part.first; ++i) {
            if (i + remembered < part.first) {
                next(part, i);
            } else {
                pass(part, i);
            }
        }
    }

    bool standing(const MeasuredLog& log, std::size_t i, std::size_t last,
                  double WheelPair<double>::*side) const {
        const auto reach = static_cast<std::size_t>(std::max(2.0, kStanding_s / log.period_s));
        const double least =
            std::max(kStandingShare * options_.speed_rms_rad_per_s, 4 * options_.noise_rad_per_s.*side);
        const std::size_t from = i > reach ? i - reach : 0;
        for (std::size_t n = from; n <= std::min(i + reach, last); ++n) {
            if (std::abs(log.samples[n].speed_rad_per_s.*side) > least) return false;
        }
        return true;
    }
    bool unusable(const LogPart& part, std::size_t i, std::size_t last) const {
        if (part.unusable != nullptr && ((*part.unusable)[i] || (*part.unusable)[i + 1])) return true;
        const MeasuredLog& log = *part.log;
        return standing(log, i, last, &WheelPair<double>::left) !=
               standing(log, i, last, &WheelPair<double>::right);
    }

    // Heading and angles go on.
    Interval next(const LogPart& part, std::size_t i) {
        const MeasuredLog& log = *part.log;
        const MeasuredSample& a = log.samples[i];
        const MeasuredSample& b = log.samples[i + 1];
        const double dt = log.period_s;
        Interval interval;
        interval.t_s = a.t_s - log.samples.front().t_s;
        interval.dt_s = dt;
        interval.span_s = span_s_;
        interval.torque = a.torque_Nm;
        interval.torque_before = log.samples[i > part.first ? i - 1 : i].torque_Nm;
        interval.before = a.speed_rad_per_s;
        interval.after = b.speed_rad_per_s;
        const WheelPair<double> mean = interval.speed();
        const double turn = dt * model::twist_from_wheel_speeds(geometry_, mean).omega_rad_per_s;
        interval.angle = {angle_.left + dt / 2 * mean.left, angle_.right + dt / 2 * mean.right};
        interval.heading_rad = heading_ + turn / 2;
        heading_ += turn;
        angle_.left += dt * mean.left;
        angle_.right += dt * mean.right;
        if (options_.straight) {
            for (WheelPair<double>* pair :
                 {&interval.torque, &interval.torque_before, &interval.before, &interval.after})
                pair->left = pair->right = pair->sum() / 2;
        }
        return interval;
    }
    void pass(const LogPart& part, std::size_t i) {
        walker_->step(next(part, i), true);
        walker_->skip();
    }

    // Short intervals are put together: the equation of their sum is as exact.
    void block(const LogPart& part, std::size_t begin, std::size_t end) {
        const MeasuredLog& log = *part.log;
        const double dt = log.period_s;
        const auto together = std::max<std::size_t>(1, static_cast<std::size_t>(kLongest_s / dt + 1e-6));
        const std::size_t rows_of_time = (end - begin) / together;
        const auto intervals = static_cast<Eigen::Index>(rows_of_time);
        std::array<Eigen::MatrixXd, kEquations> x;
        // column by interval, so that an interval's values lie side by side; last what was measured
        for (Eigen::MatrixXd& m : x) m = Eigen::MatrixXd::Zero(fresh_count_ + 1, intervals);
        const Eigen::Index used = (intervals + kPowerOf - 1) / kPowerOf;
        Eigen::MatrixXd wheels = Eigen::MatrixXd::Zero(2 * used, fresh_count_);
        const Eigen::Index product = slot_[Dictionary::kProduct];
        for (std::size_t n = begin; n < end; ++n) {
            const auto row = static_cast<Eigen::Index>((n - begin) / together);
            if (row >= intervals) {  // fewer than make one
                pass(part, n);
                continue;
            }
            const Interval interval = next(part, n);
            const Twist<double> u0 = model::twist_from_wheel_speeds(geometry_, interval.before);
            const Twist<double> u1 = model::twist_from_wheel_speeds(geometry_, interval.after);
            x[kLinear](fresh_count_, row) += u1.v_m_per_s - u0.v_m_per_s;
            x[kTurning](fresh_count_, row) += u1.omega_rad_per_s - u0.omega_rad_per_s;
            // both stand: whatever acts is held, nothing accelerates
            const bool stands = standing(log, n, part.end - 1, &WheelPair<double>::left);
            if (!stands) {
                x[kLinear](product, row) += dt * mean_product(u0.omega_rad_per_s, u1.omega_rad_per_s,
                                                              u0.omega_rad_per_s, u1.omega_rad_per_s);
                x[kTurning](product, row) +=
                    dt * mean_product(u0.v_m_per_s, u1.v_m_per_s, u0.omega_rad_per_s, u1.omega_rad_per_s);
            }
            walker_->step(interval, stands);
            if ((n - begin) % together != together - 1) continue;
            const bool for_power = row % kPowerOf == 0;
            const double share = 1 / double(together);
            walker_->take_sums([&](int of, const WheelPair<double>& pair) {
                const Eigen::Index column = slot_[std::size_t(of)];
                x[kLinear](column, row) = dt * pair.sum();
                x[kTurning](column, row) = dt * pair.difference();
                if (!for_power) return;
                wheels(2 * (row / kPowerOf), column) = share * pair.left;
                wheels(2 * (row / kPowerOf) + 1, column) = share * pair.right;
            });
        }
        used_ += used;

        Block made;
        const double step_s = dt * double(together);
        const double length_s = step_s * double(intervals);
        const int rows = std::clamp(static_cast<int>(2 * length_s * std::min(kHighest_Hz, 0.2 / step_s)), 4,
                                    static_cast<int>(intervals) / 2);
        const double left = geometry_.wheel_radius_m.left * options_.noise_rad_per_s.left;
        const double right = geometry_.wheel_radius_m.right * options_.noise_rad_per_s.right;
        const double both = std::sqrt(left * left + right * right);
        const std::array<double, kEquations> sigma{both / 2, both / geometry_.track_m};
        const Sines& transform = sines(static_cast<int>(intervals), rows, kept_.sines);
        if (kept_.pieces.size() == to_.blocks.size()) kept_.pieces.emplace_back();
        KeptColumns::Piece& piece = kept_.pieces[to_.blocks.size()];
        for (std::size_t e = 0; e < kEquations; ++e) {
            made.row[e] = with_kept(transformed(transform, x[e]) / sigma[e], piece.row[e]);
            made.rows[e] = rows;
        }
        to_.wheel_power += times_itself(with_kept(wheels, piece.wheels).transpose());
        made.first_Hz = 1 / (2 * length_s);
        to_.blocks.push_back(std::move(made));
    }

    // The columns of the dictionary, and what was made behind them, from what was made and what was kept;
    // what was made is kept too.
    Eigen::MatrixXd with_kept(const Eigen::MatrixXd& made, Eigen::MatrixXd& kept) const {
        const auto count = static_cast<Eigen::Index>(fresh_.size());
        const Eigen::Index behind = made.cols() - fresh_count_;
        Eigen::MatrixXd all(made.rows(), count + behind);
        for (Eigen::Index c = 0; c < count; ++c) {
            const auto i = static_cast<std::size_t>(c);
            if (fresh_[i]) {
                all.col(c) = made.col(slot_[i]);
            } else {
                all.col(c) = kept.col(slot_[i]);
            }
        }
        all.rightCols(behind) = made.rightCols(behind);
        const Eigen::Index had = kept.cols();
        kept.conservativeResize(made.rows(), had + static_cast<Eigen::Index>(to_keep_.size()));
        for (std::size_t i = 0; i < to_keep_.size(); ++i)
            kept.col(had + static_cast<Eigen::Index>(i)) = made.col(to_keep_[i]);
        return all;
    }

    const BlockOptions& options_;
    BlockSet& to_;
    model::Geometry<double> geometry_;
    Eigen::Index used_ = 0;
    KeptColumns nothing_kept_;
    KeptColumns& kept_;
    std::vector<bool> fresh_;         // columns that are to be made
    std::vector<Eigen::Index> slot_;  // where a column is in what is made, or in what was kept
    Eigen::Index fresh_count_ = 0;
    std::vector<Eigen::Index> to_keep_;  // of what is made
    std::optional<Dictionary::Walker> walker_;
    double heading_ = 0, span_s_ = 0;
    WheelPair<double> angle_;
};

double frequency_Hz(const Block& block, Eigen::Index row) { return double(row + 1) * block.first_Hz; }

// What columns leave, as the sensor's noise alone would whiten it, by bands a tenth wide.
struct Rests {
    struct Band {
        double rows = 0;
        double squares = 0;    // of what was left
        double set_right = 0;  // the same over the share of it that the fit has not pulled to itself
    };
    std::map<int, Band> bands;
    double rows = 0, columns = 0;

    static constexpr double kWidth = 0.1;
    static int band_of(double frequency_Hz) {
        return static_cast<int>(std::lround(std::log(frequency_Hz) / kWidth));
    }
    static double frequency_Hz(int band) { return std::exp(kWidth * band); }
};

struct Likely {
    double level = 1, corner_Hz = 0, slowest_Hz = 0;
    double unlikely = std::numeric_limits<double>::infinity();  // minus twice the logarithm of the likelihood
};

Likely likeliest(const Rests& rests, double Rests::Band::*squares) {
    constexpr double kStep = 1.5;
    constexpr double kSteepest = 1e3;  // corner over the highest frequency: all is the accelerations' noise
    const double lowest = Rests::frequency_Hz(rests.bands.begin()->first);
    const double highest = Rests::frequency_Hz(rests.bands.rbegin()->first);
    struct Of {
        double frequency_squared, rows, squares;
    };
    std::vector<Of> all;
    for (const auto& [band, of] : rests.bands)
        all.push_back({std::pow(Rests::frequency_Hz(band), 2), of.rows, of.*squares});
    Likely best;
    for (double slowest = 0; slowest<highest; slowest = slowest> 0 ? kStep * slowest : lowest) {
        for (double corner = 0;
             corner<kSteepest * highest; corner = corner> 0 ? kStep * corner : lowest / 4) {
            double sum = 0;
            double shape = 0;
            for (const Of& of : all) {
                const double power =
                    1 + corner * corner / (of.frequency_squared + slowest * slowest);  // Colour's
                sum += of.squares / power;
                shape += of.rows * std::log(power);
            }
            const double level = std::max(1.0, sum / rests.rows);  // the sensor's noise at least
            const double unlikely = rests.rows * std::log(level) + sum / level + shape;
            if (unlikely < best.unlikely) best = {level, corner, slowest, unlikely};
        }
    }
    return best;
}

Rests rests_of(const BlockSet& set, std::size_t e, const std::vector<int>& columns, const Colour& colour) {
    constexpr double kLeastFree = 0.05;
    const auto count = static_cast<Eigen::Index>(columns.size());
    std::vector<int> with_y = columns;
    with_y.push_back(static_cast<int>(set.wheel_power.cols()));
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(count + 1, count + 1);
    std::vector<Eigen::MatrixXd> rows;
    for (const Block& block : set.blocks) {
        rows.emplace_back(block.row[e](Eigen::all, with_y));
        Eigen::ArrayXd root(rows.back().rows());
        for (Eigen::Index k = 0; k < root.size(); ++k)
            root(k) = std::sqrt(colour.power(e, frequency_Hz(block, k)));
        if (root.maxCoeff() != 1 || root.minCoeff() != 1) rows.back().array().colwise() /= root;
        sum += times_itself(rows.back().transpose());
    }
    Eigen::MatrixXd normal = sum.topLeftCorner(count, count);
    Rests rests;
    for (Eigen::Index i = 0; i < count; ++i) {
        if (normal(i, i) > 0) ++rests.columns;
        normal(i, i) += 1e-7 * normal(i, i) + 1e-12;
    }
    const Eigen::LLT<Eigen::MatrixXd> root(normal);
    Eigen::VectorXd c(count + 1);
    c.head(count) = root.solve(sum.col(count).head(count));
    c(count) = -1;
    for (std::size_t b = 0; b < rows.size(); ++b) {
        const Eigen::VectorXd rest = rows[b] * c;
        const Eigen::MatrixXd pull = solved_lower(root.matrixLLT(), rows[b].leftCols(count).transpose());
        for (Eigen::Index k = 0; k < rest.size(); ++k) {
            const double f = frequency_Hz(set.blocks[b], k);
            Rests::Band& band = rests.bands[Rests::band_of(f)];
            const double square = rest(k) * rest(k) * colour.power(e, f);
            band.rows += 1;
            band.squares += square;
            band.set_right += square / std::max(kLeastFree, 1 - pull.col(k).squaredNorm());
            ++rests.rows;
        }
    }
    return rests;
}

// All of the dictionary's columns but those of the excluded effects; and of these the linear ones.
std::array<std::vector<int>, 2> columns_without(std::span<const std::size_t> excluded,
                                                const Dictionary& dictionary) {
    std::array<std::vector<int>, 2> columns;
    const std::span<const Column> all = dictionary.columns();
    for (std::size_t c = 0; c < all.size(); ++c) {
        const std::size_t effect = all[c].effect;
        if (std::find(excluded.begin(), excluded.end(), effect) != excluded.end()) continue;
        const auto i = static_cast<int>(c);
        columns[0].push_back(i);
        const bool linear = effect < model::kEffectCount && i < dictionary.linear_columns(effect).second;
        if (i < Dictionary::kFirstEffect || linear) columns[1].push_back(i);
    }
    return columns;
}

}  // namespace

Colour colour_of_rest(const BlockSet& set, std::span<const std::vector<int>> columns) {
    constexpr int kPasses = 2;  // each fitted with the colour that the one before has left
    Colour best;
    std::array<double, kEquations> least{};
    least.fill(std::numeric_limits<double>::infinity());
    for (const std::vector<int>& some : columns) {
        for (std::size_t e = 0; e < kEquations && !set.blocks.empty(); ++e) {
            Colour colour;
            Rests rests;
            for (int pass = 0; pass < kPasses; ++pass) {
                rests = rests_of(set, e, some, colour);
                const Likely likely = likeliest(rests, &Rests::Band::set_right);
                // as it was but for its level, which no fit depends on: another pass would find it again
                const bool settled = likely.corner_Hz == colour.corner_Hz[e] &&
                                     (likely.corner_Hz == 0 || likely.slowest_Hz == colour.slowest_Hz[e]);
                colour.level[e] = likely.level;
                colour.corner_Hz[e] = likely.corner_Hz;
                colour.slowest_Hz[e] = likely.slowest_Hz;
                if (settled) break;
            }
            const double criterion =
                likeliest(rests, &Rests::Band::squares).unlikely + rests.columns * std::log(rests.rows);
            if (criterion >= least[e]) continue;
            least[e] = criterion;
            best.level[e] = colour.level[e];
            best.corner_Hz[e] = colour.corner_Hz[e];
            best.slowest_Hz[e] = colour.slowest_Hz[e];
        }
    }
    return best;
}

namespace {

template <typename Weight>
void weigh(Block& block, std::size_t e, const Weight& weight) {
    Eigen::VectorXd root(block.rows[e]);
    for (Eigen::Index k = 0; k < root.size(); ++k) root(k) = std::sqrt(weight(k));
    block.product[e] = times_itself((root.asDiagonal() * block.row[e]).transpose());
}

}  // namespace

void weigh(BlockSet& set, const Colour& colour) {
    for (Block& block : set.blocks) {
        for (std::size_t e = 0; e < kEquations; ++e)
            weigh(block, e, [&](Eigen::Index k) { return 1 / colour.power(e, frequency_Hz(block, k)); });
    }
}

void weigh_where_motion_is_seen(BlockSet& set, const Colour& colour) {
    constexpr double kSeen = 30;  // over what the noise alone makes: a fraction of it is not taken for lag
    struct Band {
        double speed = 0, noise = 0;
        bool seen() const { return speed > kSeen * noise; }
    };
    for (Block& block : set.blocks) {
        const auto band_of = [&](Eigen::Index k) { return std::lround(5 * std::log10(double(k + 1))); };
        for (std::size_t e = 0; e < kEquations; ++e) {
            const auto speed = block.row[e].rightCols<1>();
            std::map<long, Band> bands;
            for (Eigen::Index k = 0; k < speed.size(); ++k) {
                bands[band_of(k)].speed += speed(k) * speed(k);
                bands[band_of(k)].noise += colour.power(e, frequency_Hz(block, k));
            }
            weigh(block, e, [&](Eigen::Index k) {
                return bands[band_of(k)].seen() ? 1 / colour.power(e, frequency_Hz(block, k)) : 0.0;
            });
        }
    }
}

BlockSet make_blocks(std::span<const LogPart> parts, const BlockOptions& options) {
    BlockSet set;
    Maker maker(options, set);
    for (const LogPart& part : parts) {
        if (part.end > part.first + std::size_t(kFewestIntervals)) maker.add(part);
    }
    maker.finish();
    return set;
}

BlockOptions block_options(std::span<const LogPart> parts, const WheelPair<double>& noise_rad_per_s,
                           double speed_rms_rad_per_s) {
    BlockOptions options;
    options.noise_rad_per_s = noise_rad_per_s;
    options.speed_rms_rad_per_s = speed_rms_rad_per_s;
    double total_s = 0;
    for (const LogPart& part : parts) total_s += part.log->period_s * double(part.end - part.first);
    options.block_s = std::clamp(total_s / 24, 0.5, 2.0);
    return options;
}

WeighedBlocks weighed_blocks(std::span<const LogPart> parts, const BlockOptions& options,
                             std::span<const std::size_t> excluded) {
    WeighedBlocks blocks;
    blocks.set = make_blocks(parts, options);
    blocks.colour = colour_of_rest(blocks.set, columns_without(excluded, *options.dictionary));
    weigh(blocks.set, blocks.colour);
    return blocks;
}

std::vector<const Block*> pointers(const BlockSet& set) {
    std::vector<const Block*> blocks;
    for (const Block& b : set.blocks) blocks.push_back(&b);
    return blocks;
}

}  // namespace wheelwright::gap
