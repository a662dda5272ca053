#include "tools/gap_trials/hidden/oracle_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "tools/gap_trials/hidden/oracle_columns.hpp"

namespace wheelwright::hidden {
namespace {

constexpr double kWindow_s = 2;
constexpr int kFewest = 4;  // samples, of which a window must have more

// Normal equations of one axis: two of the base model's, then the columns. All columns: those that the axis
// does not have are 0.
struct Normal {
    Eigen::MatrixXd h;
    Eigen::VectorXd g;
    double yy = 0;

    explicit Normal(Eigen::Index size)
        : h(Eigen::MatrixXd::Zero(size, size)), g(Eigen::VectorXd::Zero(size)) {}
};

// One axis of a view: what is explained, and by what.
struct Axis {
    const Series& target;
    const Series& smooth;  // of the base model: K5's or K6's
    const Series& torque;  // K7's or K8's
    double weight;         // 1 / variance of the target
    struct Explaining {
        const Series* values;
        Eigen::Index at;  // in the normal equations
        bool integrated;
        bool held;
    };
    std::vector<Explaining> columns = {};  // those that this axis has

    void explain_by(const std::vector<Column>& all, Series Column::*of_axis) {
        for (std::size_t j = 0; j < all.size(); ++j) {
            const Series& values = all[j].*of_axis;
            if (values.empty()) continue;
            columns.push_back({&values, static_cast<Eigen::Index>(j) + 2, all[j].integrated, all[j].held});
        }
    }
};

// Adds the windows of one axis: target and columns, integrated from the window's beginning, without their
// means. The size, 2 and the columns', is known to the compiler: most of the oracle's time is spent here.
template <int kSize>
void add_windows(const CleanLog& log, const Axis& axis, Normal& normal) {
    using Vector = Eigen::Matrix<double, kSize, 1>;
    using Square = Eigen::Matrix<double, kSize, kSize>;
    const std::size_t n = axis.target.size();
    const auto longest = static_cast<std::size_t>(std::lround(kWindow_s / log.period_s));
    const double dt = log.period_s;
    Square all = Square::Zero();
    Vector all_products = Vector::Zero();
    std::size_t begin = 0;
    while (begin + kFewest < n) {
        if (log.standing[begin] != 0) {
            ++begin;
            continue;
        }
        Vector integral = Vector::Zero();
        Vector row = Vector::Zero();
        Vector mean = Vector::Zero();
        Square squares = Square::Zero();
        Vector products = Vector::Zero();
        double mean_y = 0;
        double squares_y = 0;
        std::size_t k = begin;
        for (; k < n && k < begin + longest && log.standing[k] == 0; ++k) {
            if (k > begin) {
                integral[0] += dt * (axis.smooth[k] + axis.smooth[k - 1]) / 2;
                integral[1] += dt * axis.torque[k - 1];
            }
            row[0] = integral[0];
            row[1] = integral[1];
            for (int i = 2; i < kSize; ++i) {
                const Axis::Explaining& column = axis.columns[static_cast<std::size_t>(i) - 2];
                const Series& c = *column.values;
                if (column.integrated) {
                    if (k > begin) integral[i] += dt * (column.held ? c[k - 1] : (c[k] + c[k - 1]) / 2);
                    row[i] = integral[i];
                } else {
                    row[i] = c[k];
                }
            }
            const double y = axis.target[k] - axis.target[begin];
            squares.noalias() += row * row.transpose();
            products.noalias() += y * row;
            mean += row;
            mean_y += y;
            squares_y += y * y;
        }
        const auto count = static_cast<double>(k - begin);
        if (count > kFewest) {
            all += axis.weight * (squares - mean * mean.transpose() / count);
            all_products += axis.weight * (products - mean * (mean_y / count));
            normal.yy += axis.weight * (squares_y - mean_y * mean_y / count);
        }
        begin = std::max(k, begin + 1);
    }
    const auto place = [&](int i) { return i < 2 ? i : axis.columns[static_cast<std::size_t>(i) - 2].at; };
    for (int i = 0; i < kSize; ++i) {
        normal.g[place(i)] += all_products[i];
        for (int j = 0; j < kSize; ++j) normal.h(place(i), place(j)) += all(i, j);
    }
}

template <int kSize = 2>
void add_axis(const CleanLog& log, const Axis& axis, Normal& normal) {
    if (axis.columns.size() + 2 == kSize) return add_windows<kSize>(log, axis, normal);
    if constexpr (kSize < kMostColumns + 2) return add_axis<kSize + 1>(log, axis, normal);
    throw std::logic_error("more columns than two effects have");
}

// What the gyro says of the robot's turning beside the wheels: its target is what both differ by, not
// integrated.
void add_gyro(const CleanLog& log, const View& view, const std::vector<Column>& columns, Normal& turning,
              double& yy) {
    const double weight = 1 / (log.gyro_noise_rad_per_s * log.gyro_noise_rad_per_s);
    Series y(log.gyro_rad_per_s.size());
    for (std::size_t k = 0; k < y.size(); ++k) {
        y[k] = log.gyro_rad_per_s[k] - view.w_rad_per_s[k];
        yy += weight * y[k] * y[k];
    }
    for (std::size_t i = 0; i < columns.size(); ++i) {
        const Series& a = columns[i].gyro;
        const auto at = static_cast<Eigen::Index>(i) + 2;
        for (std::size_t k = 0; k < a.size(); ++k) turning.g[at] += weight * y[k] * a[k];
        for (std::size_t j = 0; j < columns.size(); ++j) {
            const Series& b = columns[j].gyro;
            double& sum = turning.h(at, static_cast<Eigen::Index>(j) + 2);
            for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k) sum += weight * a[k] * b[k];
        }
    }
}

// Both axes at once. Unknowns: K5, K7, K6, K8, then one for each column.
class Fit {
  public:
    // `ratio`: K8 / K7 to begin with. All must live longer.
    Fit(const Normal& forward, const Normal& turning, double yy, const std::vector<Column>& columns,
        double track_m, double ratio)
        : forward_(forward),
          turning_(turning),
          yy_(yy),
          columns_(columns),
          track_m_(track_m),
          ratio_(ratio),
          used_(columns.size(), 1) {}

    // The sum of squares that is left. Ties hold by iteration of the ratio; columns of the wrong sign leave
    // one after the other, and for good.
    double left() {
        constexpr int kMoves = 6;  // of the ratio
        for (int moves = 0; moves < kMoves;) {
            solve();
            if (drop_wrong_sign()) continue;
            if (!move_ratio()) break;
            ++moves;
        }
        return left_;
    }

  private:
    static constexpr Eigen::Index kBase = 4;

    // Of the coefficient of column j in an axis.
    double factor(std::size_t j, bool turning) const {
        if (used_[j] == 0) return 0.0;
        const Tie tie = columns_[j].tie;
        if (!turning || tie == Tie::alone) return 1.0;
        return tie == Tie::torque ? ratio_ : 2 * ratio_ / track_m_;
    }

    void add(const Normal& normal, Eigen::Index base, bool turning, Eigen::MatrixXd& h,
             Eigen::VectorXd& g) const {
        const auto place = [&](Eigen::Index i) { return i < 2 ? base + i : i - 2 + kBase; };
        const auto by = [&](Eigen::Index i) {
            return i < 2 ? 1.0 : factor(static_cast<std::size_t>(i) - 2, turning);
        };
        for (Eigen::Index i = 0; i < normal.g.size(); ++i) {
            g[place(i)] += by(i) * normal.g[i];
            for (Eigen::Index j = 0; j < normal.g.size(); ++j) {
                h(place(i), place(j)) += by(i) * by(j) * normal.h(i, j);
            }
        }
    }

    void solve() {
        const Eigen::Index size = static_cast<Eigen::Index>(columns_.size()) + kBase;
        Eigen::MatrixXd h = Eigen::MatrixXd::Zero(size, size);
        Eigen::VectorXd g = Eigen::VectorXd::Zero(size);
        add(forward_, 0, false, h, g);
        add(turning_, 2, true, h, g);
        // columns of unlike units
        Eigen::VectorXd scale(size);
        for (Eigen::Index i = 0; i < size; ++i) scale[i] = h(i, i) > 0 ? 1 / std::sqrt(h(i, i)) : 0;
        const Eigen::MatrixXd scaled = scale.asDiagonal() * h * scale.asDiagonal();
        const Eigen::MatrixXd safe = scaled + 1e-13 * Eigen::MatrixXd::Identity(size, size);
        scaled_ = safe.ldlt().solve(scale.asDiagonal() * g);
        x_ = scale.asDiagonal() * scaled_;
        left_ = yy_ - 2 * g.dot(x_) + x_.dot(h * x_);
    }

    // The column whose coefficient is most negative of those that must not be.
    bool drop_wrong_sign() {
        double most = 0;
        std::size_t drop = used_.size();
        for (std::size_t j = 0; j < used_.size(); ++j) {
            const double value = scaled_[static_cast<Eigen::Index>(j) + kBase];
            if (used_[j] != 0 && columns_[j].not_negative && value < most) {
                most = value;
                drop = j;
            }
        }
        if (drop == used_.size()) return false;
        used_[drop] = 0;
        return true;
    }

    bool move_ratio() {
        constexpr double kClose = 1e-4;
        if (!(x_[1] > 0 && x_[3] > 0)) return false;
        const double now = x_[3] / x_[1];
        const bool moved = std::abs(now / ratio_ - 1) > kClose;
        ratio_ = now;
        return moved;
    }

    const Normal& forward_;
    const Normal& turning_;
    double yy_;  // of all targets
    const std::vector<Column>& columns_;
    double track_m_;
    double ratio_;
    std::vector<char> used_;
    Eigen::VectorXd scaled_;  // unknowns in units of their own
    Eigen::VectorXd x_;
    double left_ = 0;
};

}  // namespace

double unexplained(const CleanLog& log, const std::vector<Candidate>& candidates) {
    const View view = view_of(log, candidates);
    const std::vector<Column> columns = columns_of(log, view, candidates);
    const Series& v = view.v_m_per_s;
    const Series& w = view.w_rad_per_s;
    Series squared(v.size());
    Series product(v.size());
    for (std::size_t k = 0; k < v.size(); ++k) {
        squared[k] = w[k] * w[k];
        product[k] = v[k] * w[k];
    }
    // (left + right) / 2 and (right - left) / 2 of the wheels have half the variance of one
    const double variance = log.speed_noise_rad_per_s * log.speed_noise_rad_per_s / 2;
    const double forward_scale = 1 / log.wheel_radius_m;
    const double turning_scale = log.track_m / (2 * log.wheel_radius_m);
    Axis forward{v, squared, view.sums_Nm.forward, forward_scale * forward_scale / variance};
    Axis turning{w, product, view.sums_Nm.turning, turning_scale * turning_scale / variance};
    forward.explain_by(columns, &Column::forward);
    turning.explain_by(columns, &Column::turning);
    const auto size = static_cast<Eigen::Index>(columns.size()) + 2;
    Normal of_forward(size);
    Normal of_turning(size);
    add_axis(log, forward, of_forward);
    add_axis(log, turning, of_turning);
    double yy = of_forward.yy + of_turning.yy;
    if (log.gyro) add_gyro(log, view, columns, of_turning, yy);
    // of a robot of 10 kg for each kg m^2
    const double ratio = turning_scale * log.wheel_radius_m * 10;
    return std::max(Fit(of_forward, of_turning, yy, columns, log.track_m, ratio).left(), 0.0);
}

}  // namespace wheelwright::hidden
