#include "tools/gap/model/output_error.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <unsupported/Eigen/LevenbergMarquardt>

namespace wheelwright::gap {
namespace {

constexpr Eigen::Index kK7 = gain_of(kLinear), kTiming = kFirstAmount;
constexpr double kFastest_Hz = 200;  // of the differences that are taken
constexpr double kStep_s = 0.004;    // of the simulation: what is refined is smooth or dry, and has no delay
constexpr double kClearlyBetter = 0.9;
constexpr int kMostEvaluations = 8;  // a right model needs six
// Of a parameter's scale, for its slope. Where friction holds the robot or lets it go the misses jump, and
// with smaller moves there are slopes that lead nowhere.
constexpr double kMove = 0.03;

// Residuals of all pieces and their slopes. Unknowns: the parameters as differences from the start over their
// scale, then each piece's two speeds at its start as differences from the measured ones.
class Misses {
  public:
    // what the solver asks for
    using Scalar = double;
    // NOLINTNEXTLINE(readability-identifier-naming)
    enum { InputsAtCompileTime = Eigen::Dynamic, ValuesAtCompileTime = Eigen::Dynamic };
    using InputType = Eigen::VectorXd;
    using ValueType = Eigen::VectorXd;
    using JacobianType = Eigen::MatrixXd;
    using QRSolver = Eigen::ColPivHouseholderQR<Eigen::MatrixXd>;
    int inputs() const { return static_cast<int>(free_.size() + 2 * pieces_.size()); }
    int values() const { return static_cast<int>(rows_); }

    Misses(const Fit& weak, std::span<const Stretch> pieces,
           const std::function<SimulatedRobot(const Fit&)>& robot_of)
        : weak_(weak), pieces_(pieces), robot_of_(robot_of) {
        for (Eigen::Index i = 0; i < weak.value.size(); ++i) {
            const bool known = weak.error(i) < std::abs(weak.value(i));
            if (i == kK7 && weak.shape.held_gain[kLinear]) continue;
            if (i == kTiming || (i != kK7 && !known)) continue;
            if (!weak.shape.turning && i < kTiming && i != kK7) continue;
            free_.push_back(i);
            scale_.push_back(0.1 * std::abs(weak.value(i)));
        }
        for (const Stretch& piece : pieces) {
            const std::size_t together = samples_in_step(piece.log->period_s, kStep_s);
            const double steps = 1 / (kFastest_Hz * piece.log->period_s * double(together));
            stride_.push_back(together *
                              std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(steps))));
            first_.push_back(rows_);
            rows_ += 2 + 2 * Eigen::Index((piece.end - 1 - piece.first) / stride_.back());
        }
        first_.push_back(rows_);
    }

    std::span<const Eigen::Index> free() const { return free_; }
    double scale(std::size_t i) const { return scale_[i]; }
    Eigen::Index first(std::size_t piece) const { return first_[piece]; }
    Eigen::Index rows() const { return rows_; }

    Fit fit_at(const Eigen::VectorXd& z) const {
        Fit f = weak_;
        for (std::size_t i = 0; i < free_.size(); ++i) f.value(free_[i]) += scale_[i] * z(Eigen::Index(i));
        return f;
    }

    int operator()(const Eigen::VectorXd& z, Eigen::VectorXd& miss) const {
        const SimulatedRobot robot = robot_of_(fit_at(z));
        if (!possible(robot)) return -1;
        for (std::size_t p = 0; p < pieces_.size(); ++p) run(robot, p, z, miss);
        last_at_ = z;
        last_ = miss;
        return 0;
    }

    int df(const Eigen::VectorXd& z, Eigen::MatrixXd& slope) const {
        slope.setZero(rows_, inputs());
        Eigen::VectorXd here(rows_);
        Eigen::VectorXd there(rows_);
        if (last_at_.size() == z.size() && last_at_ == z) {
            here = last_;
        } else if ((*this)(z, here) < 0) {
            return -1;
        }
        Eigen::VectorXd moved = z;
        const auto parameters = Eigen::Index(free_.size());
        for (Eigen::Index i = 0; i < parameters; ++i) {
            moved(i) += kMove;
            if ((*this)(moved, there) < 0) return -1;
            moved(i) = z(i);
            slope.col(i) = (there - here) / kMove;
        }
        const SimulatedRobot robot = robot_of_(fit_at(z));
        for (std::size_t p = 0; p < pieces_.size(); ++p) {
            for (Eigen::Index side = 0; side < 2; ++side) {
                const Eigen::Index i = parameters + 2 * Eigen::Index(p) + side;
                moved(i) += kMove;
                run(robot, p, moved, there);
                moved(i) = z(i);
                const Eigen::Index from = first_[p];
                const Eigen::Index n = first_[p + 1] - from;
                slope.col(i).segment(from, n) = (there.segment(from, n) - here.segment(from, n)) / kMove;
            }
        }
        return 0;
    }

  private:
    static bool possible(const SimulatedRobot& robot) {
        return robot.dynamics.k7_per_kg_m > 0 && robot.dynamics.k8_per_kg_m2 > 0;
    }
    void run(const SimulatedRobot& robot, std::size_t p, const Eigen::VectorXd& z,
             Eigen::VectorXd& miss) const {
        const Stretch& piece = pieces_[p];
        const Eigen::Index at = Eigen::Index(free_.size() + 2 * p);
        WheelPair<double> start = piece.log->samples[piece.first].speed_rad_per_s;
        start.left += z(at);
        start.right += z(at + 1);
        Eigen::Index row = first_[p];
        miss(row++) = z(at);  // what was measured at the start counts as much as any other
        miss(row++) = z(at + 1);
        const auto take = [&](std::size_t i, const WheelPair<double>& w) {
            if ((i - piece.first) % stride_[p] != 0) return;
            const WheelPair<double>& measured = piece.log->samples[i].speed_rad_per_s;
            miss(row++) = w.left - measured.left;
            miss(row++) = w.right - measured.right;
        };
        free_run(robot, piece, start, take, kStep_s);
    }

    const Fit& weak_;
    std::span<const Stretch> pieces_;
    const std::function<SimulatedRobot(const Fit&)>& robot_of_;
    std::vector<Eigen::Index> free_;
    std::vector<double> scale_;
    std::vector<std::size_t> stride_;
    std::vector<Eigen::Index> first_;
    Eigen::Index rows_ = 0;
    mutable Eigen::VectorXd last_at_, last_;  // where the slopes are mostly asked for, and the misses there
};

bool solve(Misses& misses, Eigen::VectorXd& z) {
    Eigen::LevenbergMarquardt<Misses> solver(misses);
    solver.setMaxfev(kMostEvaluations);
    solver.setFtol(1e-6);
    solver.setXtol(1e-5);
    solver.minimize(z);
    return z.allFinite();
}

}  // namespace

std::vector<Stretch> stretches(std::span<const LogPart> parts, double length_s,
                               const model::Geometry<double>& geometry) {
    constexpr double kShortest_s = 1;
    std::vector<Stretch> made;
    for (const LogPart& part : parts) {
        const tools::MeasuredLog& log = *part.log;
        const auto shortest = static_cast<std::size_t>(std::lround(kShortest_s / log.period_s));
        const auto bad = [&](std::size_t i) { return part.unusable != nullptr && (*part.unusable)[i]; };
        double heading = part.initial_heading_rad;
        const auto turned = [&](std::size_t i) {
            const auto u = model::twist_from_wheel_speeds(geometry, log.samples[i].speed_rad_per_s);
            return log.period_s * u.omega_rad_per_s;
        };
        for (std::size_t i = part.first; i < part.end;) {
            std::size_t end = i;
            while (end < part.end && !bad(end)) ++end;
            const std::size_t pieces = std::max<std::size_t>(
                1, static_cast<std::size_t>(std::lround(double(end - i) * log.period_s / length_s)));
            const std::size_t from = i;
            for (std::size_t p = 0; p < pieces; ++p) {
                const Stretch s{&log, from + (end - from) * p / pieces,
                                from + (end - from) * (p + 1) / pieces, heading};
                for (; i < s.end; ++i) heading += turned(i);
                if (s.end - s.first > shortest) made.push_back(s);
            }
            for (; i < part.end && bad(i); ++i) heading += turned(i);
        }
    }
    return made;
}

std::optional<Refined> refine_by_free_run(const Fit& weak, std::span<const Stretch> pieces,
                                          double small_rad_per_s,
                                          const std::function<SimulatedRobot(const Fit&)>& robot_of) {
    if (pieces.size() < 3) return std::nullopt;
    Misses misses(weak, pieces, robot_of);
    Eigen::VectorXd z = Eigen::VectorXd::Zero(misses.inputs());
    Eigen::VectorXd miss(misses.rows());
    const auto rms = [&] { return std::sqrt(miss.squaredNorm() / double(misses.rows())); };
    if (misses(z, miss) < 0) return std::nullopt;
    Refined refined{weak, rms(), 0};
    if (refined.weak_rad_per_s < small_rad_per_s) return std::nullopt;
    if (!solve(misses, z) || misses(z, miss) < 0) return std::nullopt;
    refined.rad_per_s = rms();
    if (!(refined.rad_per_s < kClearlyBetter * refined.weak_rad_per_s)) return std::nullopt;
    Eigen::MatrixXd slope;
    if (misses.df(z, slope) < 0) return std::nullopt;
    const Eigen::Index n = slope.cols();
    Eigen::MatrixXd normal = slope.transpose() * slope;
    normal.diagonal() *= 1 + 1e-12;
    const Eigen::MatrixXd inverse = normal.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
    Eigen::MatrixXd meat = Eigen::MatrixXd::Zero(n, n);
    for (std::size_t p = 0; p < pieces.size(); ++p) {
        const Eigen::Index rows = misses.first(p + 1) - misses.first(p);
        const Eigen::VectorXd score =
            slope.middleRows(misses.first(p), rows).transpose() * miss.segment(misses.first(p), rows);
        meat += score * score.transpose();
    }
    const double pieces_count = double(pieces.size());
    Eigen::MatrixXd covariance = pieces_count / (pieces_count - 1) * inverse * meat * inverse;
    // one piece that alone tells of a parameter fits it whatever its error: not below what the misses' size
    // gives
    const double variance = miss.squaredNorm() / std::max(1.0, double(misses.rows() - n));
    refined.fit = misses.fit_at(z);
    const auto free = misses.free();
    for (std::size_t i = 0; i < free.size(); ++i) {
        for (std::size_t j = 0; j < free.size(); ++j) {
            const auto a = Eigen::Index(i);
            const auto b = Eigen::Index(j);
            double c = covariance(a, b);
            if (i == j) c = std::max(c, variance * inverse(a, a));
            refined.fit.covariance(free[i], free[j]) = misses.scale(i) * misses.scale(j) * c;
        }
    }
    return refined;
}

}  // namespace wheelwright::gap
