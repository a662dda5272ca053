#include "tools/gap/gap_rows.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>

namespace wheelwright::gap {
namespace {

using tools::MeasuredLog;
using tools::MeasuredSample;

constexpr double kPi = 3.14159265358979323846;
constexpr double kShortestBlock_s = 0.5;
constexpr int kFewestIntervals = 20;
constexpr double kStanding_s = 0.02;
constexpr double kStandingShare = 0.005;  // of the RMS speed: slower than this for longer than that stands

// A function of motion and torque that stands for no effect.
struct Instant {
    WheelPair<double> torque, before, speed;  // speed: mean of the interval's ends
    WheelPair<double> slow_torque;
    Twist<double> twist;
    double heading = 0, time = 0;
    WheelPair<double> angle;
};
struct Rich {
    std::string_view place;
    WheelPair<double> (*value)(const Instant&);
};
double sign_of(double x) { return x > 0 ? 1.0 : x < 0 ? -1.0 : 0.0; }
WheelPair<double> each(const WheelPair<double>& a, double (*f)(double)) { return {f(a.left), f(a.right)}; }

// NOLINTBEGIN(readability-magic-numbers): shapes, not quantities
constexpr std::array kRich{
    Rich{"wheel speed",
         [](const Instant& i) {
             return WheelPair<double>{i.speed.left, 0};
         }},
    Rich{"wheel speed",
         [](const Instant& i) {
             return WheelPair<double>{0, i.speed.right};
         }},
    Rich{"wheel speed",
         [](const Instant& i) { return each(i.speed, [](double w) { return w * std::abs(w) / 10; }); }},
    Rich{"wheel speed",
         [](const Instant& i) { return each(i.speed, [](double w) { return w * w * w / 100; }); }},
    Rich{"direction of turning of the wheels",
         [](const Instant& i) {
             return WheelPair<double>{sign_of(i.speed.left), 0};
         }},
    Rich{"direction of turning of the wheels",
         [](const Instant& i) {
             return WheelPair<double>{0, sign_of(i.speed.right)};
         }},
    Rich{"low wheel speed",
         [](const Instant& i) {
             return each(i.speed, [](double w) { return sign_of(w) * std::exp(-w * w); });
         }},
    Rich{"yaw rate",
         [](const Instant& i) {
             const double s = sign_of(i.twist.omega_rad_per_s);
             return WheelPair<double>{-s, s};
         }},
    Rich{"yaw rate",
         [](const Instant& i) {
             const double w = i.twist.omega_rad_per_s * std::abs(i.twist.omega_rad_per_s);
             return WheelPair<double>{-w, w};
         }},
    Rich{"torque",
         [](const Instant& i) {
             return WheelPair<double>{i.torque.left, 0};
         }},
    Rich{"torque", [](const Instant& i) { return each(i.torque, [](double t) { return t * std::abs(t); }); }},
    Rich{"torque", [](const Instant& i) { return each(i.torque, sign_of); }},
    Rich{"torque times speed",
         [](const Instant& i) {
             return WheelPair<double>{i.torque.left * std::abs(i.speed.left) / 10,
                                      i.torque.right * std::abs(i.speed.right) / 10};
         }},
    Rich{"lag",
         [](const Instant& i) {
             return WheelPair<double>{i.slow_torque.left - i.torque.left,
                                      i.slow_torque.right - i.torque.right};
         }},
    Rich{"constant",
         [](const Instant&) {
             return WheelPair<double>{1, 0};
         }},
    Rich{"constant",
         [](const Instant&) {
             return WheelPair<double>{0, 1};
         }},
    Rich{"heading",
         [](const Instant& i) {
             const double c = std::cos(i.heading);
             return WheelPair<double>{c, c};
         }},
    Rich{"heading",
         [](const Instant& i) {
             const double s = std::sin(i.heading);
             return WheelPair<double>{s, s};
         }},
    Rich{"heading",
         [](const Instant& i) {
             const double c = std::cos(i.heading);
             return WheelPair<double>{-c, c};
         }},
    Rich{"heading",
         [](const Instant& i) {
             const double s = std::sin(i.heading);
             return WheelPair<double>{-s, s};
         }},
    Rich{"wheel angle", [](const Instant& i) { return each(i.angle, [](double a) { return std::sin(a); }); }},
    Rich{"wheel angle", [](const Instant& i) { return each(i.angle, [](double a) { return std::cos(a); }); }},
    Rich{"time",
         [](const Instant& i) {
             return WheelPair<double>{i.torque.left * i.time / 30, i.torque.right * i.time / 30};
         }},
    Rich{"coupling of turning and driving",
         [](const Instant& i) {
             const double w = i.twist.omega_rad_per_s * i.twist.omega_rad_per_s;
             return WheelPair<double>{-w, w};
         }},
    Rich{"coupling of turning and driving",
         [](const Instant& i) {
             const double w = i.twist.omega_rad_per_s * i.twist.v_m_per_s;
             return WheelPair<double>{w, w};
         }},
};
// NOLINTEND(readability-magic-numbers)

constexpr std::size_t kColumnCount = [] {
    std::size_t count = kFirstEffect + kRich.size();
    for (const std::size_t each :
         model::for_catalogue([]<typename Effect>() { return model::kCoordinates<Effect>; })) {
        count += each;
    }
    return count;
}();

double mean_product(double a0, double a1, double b0, double b1) {
    return (2 * a0 * b0 + a0 * b1 + a1 * b0 + 2 * a1 * b1) / 6;
}

// Mean sign of a speed that goes straight from a to b.
double mean_sign(double a, double b) {
    const double size = std::abs(a) + std::abs(b);
    return size > 0 ? (a + b) / size : 0.0;
}

// One row for each coordinate of each effect: the wheel torque of one unit.
template <typename Take>
void effect_columns(const model::EffectContext<double>& context, const WheelPair<double>& before,
                    const WheelPair<double>& after, Take&& take) {
    std::array<bool, model::kEffectCount> all{};
    all.fill(true);
    model::for_each_active(all, [&]<typename Effect>(std::size_t) {
        for (unsigned k = 0; k < model::kCoordinates<Effect>; ++k) {
            if constexpr (model::Dry<Effect>) {
                const WheelPair<double> d =
                    model::wheel_torque_Nm(context.geometry, Effect::template dry_direction<double>(k));
                const double amount =
                    -mean_sign(model::sliding_speed(d, before), model::sliding_speed(d, after));
                take(WheelPair<double>{amount * d.left, amount * d.right});
            } else if constexpr (model::HasColumns<Effect>) {
                take(model::smooth_column<Effect>(k, context));
            }
        }
    });
}

// The transform of a block of so many intervals: rows k, columns n.
using Sines = std::map<std::pair<int, int>, Eigen::MatrixXd>;
const Eigen::MatrixXd& sines(int intervals, int rows, Sines& known) {
    Eigen::MatrixXd& s = known[{intervals, rows}];
    if (s.size() == 0) {
        s.resize(rows, intervals);
        for (int k = 1; k <= rows; ++k) {
            const double scale = 1 / (std::sqrt(2.0 * intervals) * std::sin(k * kPi / (2.0 * intervals)));
            for (int n = 0; n < intervals; ++n)
                s(k - 1, n) = scale * std::sin(k * kPi * (n + 0.5) / intervals);
        }
    }
    return s;
}

class Maker {
  public:
    Maker(const BlockOptions& options, BlockSet& to) : options_(options), to_(to) {
        const auto count = static_cast<Eigen::Index>(columns().size());
        to_.wheel_power = Eigen::MatrixXd::Zero(count, count);
    }

    void add(const LogPart& part) {
        const MeasuredLog& log = *part.log;
        const double dt = log.period_s;
        heading_ = part.initial_heading_rad;
        angle_ = {};
        slow_ = log.samples[part.first].torque_Nm;
        const int longest = std::max(kFewestIntervals, static_cast<int>(std::lround(options_.block_s / dt)));
        const int shortest = std::max(kFewestIntervals, static_cast<int>(std::lround(kShortestBlock_s / dt)));
        const std::size_t last = part.end - 1;  // intervals are first .. last - 1
        std::size_t i = part.first;
        while (i < last) {
            // a run without a wheel that stands while the other turns
            std::size_t run = i;
            while (run < last && !half_standing(log, run, last)) ++run;
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
                to_.left_out_s += dt * length;
                for (std::size_t n = i; n < run; ++n) pass(log, n);
            }
            for (i = run; i < last && half_standing(log, i, last); ++i) {
                to_.left_out_s += dt;
                pass(log, i);
            }
        }
    }

    void finish() {
        if (intervals_ > 0) to_.wheel_power /= double(intervals_);
        to_.torque_rms_Nm = std::sqrt(to_.wheel_power(kTorque, kTorque));
    }

  private:
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
    bool half_standing(const MeasuredLog& log, std::size_t i, std::size_t last) const {
        return standing(log, i, last, &WheelPair<double>::left) !=
               standing(log, i, last, &WheelPair<double>::right);
    }

    // Heading, angles and the slow torque go on.
    void pass(const MeasuredLog& log, std::size_t i) {
        const MeasuredSample& a = log.samples[i];
        const MeasuredSample& b = log.samples[i + 1];
        const double dt = log.period_s;
        const WheelPair<double> mean{(a.speed_rad_per_s.left + b.speed_rad_per_s.left) / 2,
                                     (a.speed_rad_per_s.right + b.speed_rad_per_s.right) / 2};
        heading_ += dt * model::twist_from_wheel_speeds(options_.geometry, mean).omega_rad_per_s;
        angle_.left += dt * mean.left;
        angle_.right += dt * mean.right;
        const double share = dt / (dt + 0.02);
        slow_.left += share * (a.torque_Nm.left - slow_.left);
        slow_.right += share * (a.torque_Nm.right - slow_.right);
    }

    void block(const LogPart& part, std::size_t begin, std::size_t end) {
        const MeasuredLog& log = *part.log;
        const double dt = log.period_s;
        const auto count = static_cast<Eigen::Index>(columns().size());
        const auto intervals = static_cast<Eigen::Index>(end - begin);
        std::array<Eigen::MatrixXd, kEquations> x;
        for (Eigen::MatrixXd& m : x) m = Eigen::MatrixXd::Zero(intervals, count + 1);
        Eigen::MatrixXd wheels = Eigen::MatrixXd::Zero(2 * intervals, count);
        for (std::size_t n = begin; n < end; ++n) {
            const auto row = static_cast<Eigen::Index>(n - begin);
            const MeasuredSample& a = log.samples[n];
            const MeasuredSample& b = log.samples[n + 1];
            const Twist<double> u0 = model::twist_from_wheel_speeds(options_.geometry, a.speed_rad_per_s);
            const Twist<double> u1 = model::twist_from_wheel_speeds(options_.geometry, b.speed_rad_per_s);
            x[kLinear](row, count) = (u1.v_m_per_s - u0.v_m_per_s);
            x[kTurning](row, count) = (u1.omega_rad_per_s - u0.omega_rad_per_s);
            if (standing(log, n, part.end - 1, &WheelPair<double>::left)) {
                pass(log, n);  // both stand: whatever acts is held, nothing accelerates
                continue;
            }
            x[kLinear](row, kProduct) = dt * mean_product(u0.omega_rad_per_s, u1.omega_rad_per_s,
                                                          u0.omega_rad_per_s, u1.omega_rad_per_s);
            x[kTurning](row, kProduct) =
                dt * mean_product(u0.v_m_per_s, u1.v_m_per_s, u0.omega_rad_per_s, u1.omega_rad_per_s);
            Eigen::Index column = kTorque;
            const auto put = [&](const WheelPair<double>& pair) {
                x[kLinear](row, column) = dt * pair.sum();
                x[kTurning](row, column) = dt * pair.difference();
                wheels(2 * row, column) = pair.left;
                wheels(2 * row + 1, column) = pair.right;
                ++column;
            };
            Instant at;
            at.torque = a.torque_Nm;
            at.before = log.samples[n > part.first ? n - 1 : n].torque_Nm;
            put(at.torque);
            put({at.before.left - at.torque.left, at.before.right - at.torque.right});
            at.speed = {(a.speed_rad_per_s.left + b.speed_rad_per_s.left) / 2,
                        (a.speed_rad_per_s.right + b.speed_rad_per_s.right) / 2};
            at.twist = model::twist_from_wheel_speeds(options_.geometry, at.speed);
            at.heading = heading_ + dt / 2 * at.twist.omega_rad_per_s;
            at.angle = {angle_.left + dt / 2 * at.speed.left, angle_.right + dt / 2 * at.speed.right};
            at.slow_torque = slow_;
            at.time = a.t_s;
            const model::Motion<double> motion{at.speed, at.angle, at.twist, at.heading};
            effect_columns({motion, at.torque, options_.geometry, options_.dynamics}, a.speed_rad_per_s,
                           b.speed_rad_per_s, put);
            for (const Rich& rich : kRich) put(rich.value(at));
            pass(log, n);
        }
        intervals_ += static_cast<std::size_t>(intervals);
        to_.wheel_power.noalias() += wheels.transpose() * wheels;

        Block made;
        made.log = part.index;
        made.start_s = log.samples[begin].t_s;
        made.end_s = log.samples[end].t_s;
        const double length_s = dt * double(intervals);
        const int rows = std::clamp(static_cast<int>(2 * length_s * std::min(options_.highest_Hz, 0.2 / dt)),
                                    4, static_cast<int>(intervals) / 2);
        const double left = options_.geometry.wheel_radius_m.left * options_.noise_rad_per_s.left;
        const double right = options_.geometry.wheel_radius_m.right * options_.noise_rad_per_s.right;
        const double both = std::sqrt(left * left + right * right);
        const std::array<double, kEquations> sigma{both / 2, both / options_.geometry.track_m};
        const Eigen::MatrixXd& transform = sines(static_cast<int>(intervals), rows, sines_);
        for (std::size_t e = 0; e < kEquations; ++e) {
            made.row[e] = transform * x[e] / sigma[e];
            made.rows[e] = rows;
            made.product[e] = made.row[e].transpose() * made.row[e];
        }
        made.first_Hz = 1 / (2 * length_s);
        to_.blocks.push_back(std::move(made));
    }

    const BlockOptions& options_;
    BlockSet& to_;
    std::size_t intervals_ = 0;
    Sines sines_;
    double heading_ = 0;
    WheelPair<double> angle_, slow_;
};

}  // namespace

std::span<const ColumnName> columns() {
    static const std::array<ColumnName, kColumnCount> made = [] {
        std::array<ColumnName, kColumnCount> names;
        names.fill({model::kEffectCount, 0, ""});
        std::size_t at = kFirstEffect;
        std::array<bool, model::kEffectCount> all{};
        all.fill(true);
        model::for_each_active(all, [&]<typename Effect>(std::size_t i) {
            for (unsigned k = 0; k < model::kCoordinates<Effect>; ++k) names[at++] = {i, k, ""};
        });
        for (const Rich& rich : kRich) names[at++].place = rich.place;
        return names;
    }();
    return made;
}

std::pair<int, int> columns_of(std::size_t effect) {
    const std::span<const ColumnName> all = columns();
    const auto mine = [&](const ColumnName& name) { return name.effect == effect; };
    const auto first = std::find_if(all.begin(), all.end(), mine);
    const auto end = std::find_if_not(first, all.end(), mine);
    return {static_cast<int>(first - all.begin()), static_cast<int>(end - all.begin())};
}

std::pair<int, int> rich_columns() {
    const auto all = static_cast<int>(columns().size());
    return {all - static_cast<int>(kRich.size()), all};
}

WheelPair<double> speed_noise(std::span<const MeasuredLog> logs) {
    const auto one = [&](double WheelPair<double>::*side) {
        // variances of the second, third and fourth difference of white noise: 6,
        // 20, 70
        std::array<double, 3> sum{};
        double power = 0;
        std::size_t count = 0;
        for (const MeasuredLog& log : logs) {
            for (std::size_t i = 4; i < log.samples.size(); ++i) {
                const auto w = [&](std::size_t back) { return log.samples[i - back].speed_rad_per_s.*side; };
                const double second = w(0) - 2 * w(1) + w(2);
                const double third = second - (w(1) - 2 * w(2) + w(3));
                const double fourth = third - (w(1) - 3 * w(2) + 3 * w(3) - w(4));
                sum[0] += second * second / 6;
                sum[1] += third * third / 20;
                sum[2] += fourth * fourth / 70;
                power += w(0) * w(0);
                ++count;
            }
        }
        if (count == 0) return 1.0;
        const double least = *std::min_element(sum.begin(), sum.end());
        return std::sqrt(std::max(least, 1e-8 * power) / double(count));
    };
    return {one(&WheelPair<double>::left), one(&WheelPair<double>::right)};
}

std::size_t Colour::bin(double frequency_Hz) const {
    const double place = std::log(frequency_Hz / lowest_Hz) / std::log(ratio);
    return static_cast<std::size_t>(std::clamp(place, 0.0, double(kBins - 1)));
}

Colour colour_of_rest(const BlockSet& set) {
    Colour colour;
    const auto count = static_cast<Eigen::Index>(columns().size());
    for (std::size_t e = 0; e < kEquations; ++e) {
        Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(count + 1, count + 1);
        for (const Block& block : set.blocks) sum += block.product[e];
        Eigen::MatrixXd normal = sum.topLeftCorner(count, count);
        for (Eigen::Index i = 0; i < count; ++i) normal(i, i) += 1e-7 * normal(i, i) + 1e-12;
        Eigen::VectorXd c(count + 1);
        c.head(count) = normal.ldlt().solve(sum.col(count).head(count));
        c(count) = -1;
        std::array<double, Colour::kBins> squares{};
        std::array<double, Colour::kBins> rows{};
        for (const Block& block : set.blocks) {
            const Eigen::VectorXd rest = block.row[e] * c;
            for (Eigen::Index k = 0; k < rest.size(); ++k) {
                const std::size_t b = colour.bin(double(k + 1) * block.first_Hz);
                squares[b] += rest(k) * rest(k);
                rows[b] += 1;
            }
        }
        for (std::size_t b = 0; b < Colour::kBins; ++b) {
            colour.power[e][b] = rows[b] > 0 ? std::max(1.0, squares[b] / rows[b]) : 1.0;
        }
    }
    return colour;
}

void weigh(BlockSet& set, const Colour& colour) {
    for (Block& block : set.blocks) {
        for (std::size_t e = 0; e < kEquations; ++e) {
            Eigen::VectorXd weight(block.rows[e]);
            for (Eigen::Index k = 0; k < weight.size(); ++k) {
                weight(k) = 1 / colour.power[e][colour.bin(double(k + 1) * block.first_Hz)];
            }
            block.product[e] = block.row[e].transpose() * weight.asDiagonal() * block.row[e];
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

}  // namespace wheelwright::gap
