#include "tools/gap_trials/hidden/oracle.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <utility>

#include "tools/gap_trials/hidden/electronics.hpp"

namespace wheelwright::hidden {
namespace {

constexpr double kEnough = 50;
constexpr double kShare = 0.0005;
constexpr double kWindow_s = 2;
constexpr double kStanding_rad_per_s = 0.03;

// A candidate: an effect and its nonlinear parameters by the names of the table.
using Candidate = HiddenEffect;

double sign_of(double x) { return x > 0 ? 1.0 : (x < 0 ? -1.0 : 0.0); }

struct Log {
    double period_s = 0;
    double radius_m = 0;
    double track_m = 0;
    double castor_m = 0;
    double wheel_inertia_kg_m2 = 0;
    double duration_s = 0;
    double peak_Nm = 0;
    double peak_rad_per_s = 0;
    double sigma_speed = 0;
    double sigma_gyro = 0;
    bool gyro = false;
    std::vector<Pair> torque;
    std::vector<Pair> speed;
    std::vector<double> yaw;
    std::vector<char> standing;
};

Log log_of(const Trial& trial) {
    Log log;
    log.period_s = 1 / trial.rate_Hz;
    log.radius_m = trial.robot.wheel_radius_m;
    log.track_m = trial.robot.track_m;
    log.castor_m = trial.robot.castor_ahead_m;
    log.wheel_inertia_kg_m2 = trial.robot.wheel_inertia_kg_m2;
    log.duration_s = trial.duration_s;
    log.peak_Nm = trial.peak_torque_Nm;
    const Noise& noise = kNoises[trial.plan.noise];
    const double step = speed_step_rad_per_s(kUsualCountsPerTurn);
    log.sigma_speed = std::sqrt(noise.speed_rad_per_s * noise.speed_rad_per_s + step * step / 12);
    log.sigma_gyro = noise.gyro_rad_per_s;
    log.gyro = trial.gyro;
    for (const Sample& s : trial.samples) {
        log.torque.push_back(s.torque_Nm);
        log.speed.push_back(s.clean_rad_per_s);
        log.yaw.push_back(s.clean_gyro_rad_per_s);
        log.peak_rad_per_s = std::max(
            {log.peak_rad_per_s, std::abs(s.clean_rad_per_s.left), std::abs(s.clean_rad_per_s.right)});
        log.standing.push_back(std::abs(s.clean_rad_per_s.left) < kStanding_rad_per_s ||
                               std::abs(s.clean_rad_per_s.right) < kStanding_rad_per_s);
    }
    return log;
}

// How a coefficient of the forward equation returns in the yaw equation.
enum class Tie {
    alone,   // one of the equations only: the ratio is not used
    torque,  // a wheel torque: K8 / K7
    force,   // a force and its moment: 2 K8 / (b K7)
};

struct Column {
    Tie tie = Tie::alone;
    bool not_negative = false;
    bool integrated = true;
    bool held = false;            // between samples, as torques are
    std::vector<double> forward;  // empty: none
    std::vector<double> turning;
    std::vector<double> gyro;  // of the yaw equation's coefficient; not integrated
};

// The log as a set of candidates sees it.
struct View {
    std::vector<double> v, w;         // speeds of the robot, from the wheels
    std::vector<double> sum, differ;  // of the torques, until the next sample
    std::vector<Column> columns;
};

std::vector<double> lagged(const std::vector<double>& u, double time_constant_s, double period_s) {
    std::vector<double> out(u.size());
    double state = 0;
    const double share = -std::expm1(-period_s / time_constant_s);
    for (std::size_t k = 0; k < u.size(); ++k) {
        const double before = state;
        state += (u[k] - state) * share;
        out[k] = u[k] - time_constant_s * (state - before) / period_s;
    }
    return out;
}

std::vector<double> delayed(const std::vector<double>& u, double delay_s, double period_s) {
    const double shift = delay_s / period_s;
    const auto whole = static_cast<std::size_t>(shift);
    const double part = shift - static_cast<double>(whole);
    std::vector<double> out(u.size());
    for (std::size_t k = 0; k < u.size(); ++k) {
        const double late = k >= whole ? u[k - whole] : 0;
        const double later = k >= whole + 1 ? u[k - whole - 1] : 0;
        out[k] = (1 - part) * late + part * later;
    }
    return out;
}

std::vector<double> through_gap(const std::vector<double>& u, const std::vector<double>& w, double gap,
                                double inertia, double period_s) {
    constexpr double kStiffness = 100;
    const double damping = 0.7 * std::sqrt(kStiffness * inertia);
    const int steps = std::max(1, static_cast<int>(std::lround(period_s / 6e-5)));
    const double h = period_s / steps;
    std::vector<double> out(u.size());
    double motor = 0;
    double motor_speed = 0;
    double wheel = 0;
    for (std::size_t k = 0; k + 1 < u.size(); ++k) {
        double impulse = 0;
        const double freely = u[k] / inertia * h;
        for (int i = 0; i < steps; ++i) {
            const double speed = w[k] + (w[k + 1] - w[k]) * i / steps;
            const double ahead = motor - wheel;
            double push = 0;
            if (std::abs(ahead) > gap) {
                push = kStiffness * (ahead - std::copysign(gap, ahead)) + damping * (motor_speed - speed);
                if (push * ahead < 0) push = 0;
            }
            impulse += push * h;
            motor_speed += push == 0 ? freely : (u[k] - push) / inertia * h;
            motor += motor_speed * h;
            wheel += speed * h;
        }
        out[k] = impulse / period_s;
    }
    return out;
}

class Viewer {
  public:
    explicit Viewer(const Log& log) : log_(log), n_(log.torque.size()) {
        for (std::size_t k = 0; k < n_; ++k) {
            ul_.push_back(log.torque[k].left);
            ur_.push_back(log.torque[k].right);
            wl_.push_back(log.speed[k].left);
            wr_.push_back(log.speed[k].right);
        }
    }

    View view(const std::vector<Candidate>& candidates) {
        for (const Candidate& c : candidates) correct_speeds(c);
        const double r = log_.radius_m;
        view_.v.resize(n_);
        view_.w.resize(n_);
        for (std::size_t k = 0; k < n_; ++k) {
            view_.v[k] = (left_m(r) * wl_[k] + right_m(r) * wr_[k]) / 2;
            view_.w[k] = (right_m(r) * wr_[k] - left_m(r) * wl_[k]) / log_.track_m;
        }
        // in the order in which they happen
        for (const char* name : {"transport_delay", "dead_zone", "torque_saturation", "back_emf_limit",
                                 "actuator_lag", "backlash"}) {
            for (const Candidate& c : candidates) {
                if (c.name == name) transform(c);
            }
        }
        view_.sum = wheel_sum(ul_, ur_);
        view_.differ = wheel_difference(ul_, ur_);
        for (const Candidate& c : candidates) add_columns(c);
        return std::move(view_);
    }

  private:
    double left_m(double r) const { return 2 * r / (2 + mismatch_); }
    double right_m(double r) const { return left_m(r) * (1 + mismatch_); }

    // As forces of wheels of the mean radius.
    std::vector<double> wheel_sum(const std::vector<double>& left, const std::vector<double>& right) const {
        std::vector<double> out(n_);
        for (std::size_t k = 0; k < n_; ++k) out[k] = left[k] / left_m(1) + right[k] / right_m(1);
        return out;
    }
    std::vector<double> wheel_difference(const std::vector<double>& left,
                                         const std::vector<double>& right) const {
        std::vector<double> out(n_);
        for (std::size_t k = 0; k < n_; ++k) out[k] = right[k] / right_m(1) - left[k] / left_m(1);
        return out;
    }

    void correct_speeds(const Candidate& c) {
        if (c.name == "wheel_radius_mismatch") mismatch_ = c["relative"];
        if (c.name != "measurement_lag") return;
        const double time_constant_s = c["time_constant_s"];
        for (auto* w : {&wl_, &wr_}) {
            const std::vector<double> reported = *w;
            for (std::size_t k = 1; k + 1 < n_; ++k) {
                (*w)[k] += time_constant_s * (reported[k + 1] - reported[k - 1]) / (2 * log_.period_s);
            }
        }
    }

    void transform(const Candidate& c) {
        for (const bool right : {false, true}) {
            std::vector<double>& u = right ? ur_ : ul_;
            const std::vector<double>& w = right ? wr_ : wl_;
            if (c.name == "transport_delay") u = delayed(u, c["delay_s"], log_.period_s);
            if (c.name == "actuator_lag") u = lagged(u, c["time_constant_s"], log_.period_s);
            if (c.name == "backlash") {
                u = through_gap(u, w, c["half_gap_rad"], c["motor_inertia_kg_m2"], log_.period_s);
            }
            if (c.name == "dead_zone") {
                const double width = c["width_Nm"];
                for (double& x : u) x -= std::clamp(x, -width, width);
            }
            if (c.name == "torque_saturation") {
                const double limit = c["limit_Nm"];
                for (double& x : u) x = std::clamp(x, -limit, limit);
            }
            if (c.name == "back_emf_limit") {
                const double stall = c["stall_Nm"];
                const double no_load = c["no_load_rad_per_s"];
                for (std::size_t k = 0; k < n_; ++k) {
                    const double share = w[k] / no_load;
                    u[k] = std::clamp(u[k], std::min(0.0, -stall * (1 + share)),
                                      std::max(0.0, stall * (1 - share)));
                }
            }
        }
    }

    template <typename Left, typename Right>
    void add_torque(bool not_negative, Left left, Right right, bool held = false) {
        std::vector<double> l(n_);
        std::vector<double> r(n_);
        for (std::size_t k = 0; k < n_; ++k) {
            l[k] = left(k);
            r[k] = right(k);
        }
        view_.columns.push_back(
            {Tie::torque, not_negative, true, held, wheel_sum(l, r), wheel_difference(l, r), {}});
    }

    template <typename Forward>
    std::vector<double> series(Forward value) const {
        std::vector<double> out(n_);
        for (std::size_t k = 0; k < n_; ++k) out[k] = value(k);
        return out;
    }

    void add_columns(const Candidate& c) {
        const auto zero = [](std::size_t) { return 0.0; };
        const auto& v = view_.v;
        const auto& w = view_.w;
        auto& columns = view_.columns;
        if (c.name == "viscous_friction") {
            add_torque(
                true, [&](std::size_t k) { return -wl_[k]; }, zero);
            add_torque(true, zero, [&](std::size_t k) { return -wr_[k]; });
        } else if (c.name == "coulomb_friction") {
            add_torque(
                true, [&](std::size_t k) { return -sign_of(wl_[k]); }, zero);
            add_torque(true, zero, [&](std::size_t k) { return -sign_of(wr_[k]); });
        } else if (c.name == "stribeck_friction") {
            const double knee = c["stribeck_rad_per_s"];
            const auto more = [knee](double x) { return -sign_of(x) * std::exp(-x * x / (knee * knee)); };
            add_torque(
                true, [&](std::size_t k) { return -sign_of(wl_[k]); },
                [&](std::size_t k) { return -sign_of(wr_[k]); });
            add_torque(
                true, [&](std::size_t k) { return more(wl_[k]); },
                [&](std::size_t k) { return more(wr_[k]); });
        } else if (c.name == "quadratic_drag") {
            columns.push_back({Tie::alone,
                               true,
                               true,
                               false,
                               series([&](std::size_t k) { return -v[k] * std::abs(v[k]); }),
                               {},
                               {}});
        } else if (c.name == "turning_scrub") {
            columns.push_back({Tie::alone,
                               true,
                               true,
                               false,
                               {},
                               series([&](std::size_t k) { return -sign_of(w[k]); }),
                               {}});
        } else if (c.name == "castor_drag") {
            add_castor(c["arm_m"], c["trail_m"]);
        } else if (c.name == "slope") {
            std::vector<double> heading(n_, 0.0);
            for (std::size_t k = 1; k < n_; ++k)
                heading[k] = heading[k - 1] + log_.period_s * (w[k] + w[k - 1]) / 2;
            const auto cosine = series([&](std::size_t k) { return std::cos(heading[k]); });
            const auto sine = series([&](std::size_t k) { return std::sin(heading[k]); });
            columns.push_back({Tie::alone, false, true, false, cosine, {}, {}});
            columns.push_back({Tie::alone, false, true, false, sine, {}, {}});
            columns.push_back({Tie::alone, false, true, false, {}, cosine, {}});
            columns.push_back({Tie::alone, false, true, false, {}, sine, {}});
        } else if (c.name == "torque_bias") {
            add_torque(
                false, [](std::size_t) { return 1.0; }, zero);
            add_torque(false, zero, [](std::size_t) { return 1.0; });
        } else if (c.name == "torque_gain_mismatch") {
            add_torque(
                false, [&](std::size_t k) { return -ul_[k]; }, [&](std::size_t k) { return ur_[k]; }, true);
        } else if (c.name == "cog_lateral") {
            columns.push_back({Tie::force, false, false, false, w, v, {}});
        } else if (c.name == "gain_drift") {
            const double time_constant_s = c["time_constant_s"];
            const auto lost = [&](std::size_t k) {
                const double t = (static_cast<double>(k) + 0.5) * log_.period_s;
                return time_constant_s > 0 ? -std::expm1(-t / time_constant_s) : t / log_.duration_s;
            };
            add_torque(
                true, [&](std::size_t k) { return -ul_[k] * lost(k); },
                [&](std::size_t k) { return -ur_[k] * lost(k); }, true);
        } else if (c.name == "torque_ripple") {
            std::vector<Pair> angle(n_);
            for (std::size_t k = 1; k < n_; ++k) {
                angle[k].left = angle[k - 1].left + log_.period_s * (wl_[k] + wl_[k - 1]) / 2;
                angle[k].right = angle[k - 1].right + log_.period_s * (wr_[k] + wr_[k - 1]) / 2;
            }
            const double order = c["order"];
            add_torque(
                false, [&](std::size_t k) { return std::sin(order * angle[k].left); },
                [&](std::size_t k) { return std::sin(order * angle[k].right); });
            add_torque(
                false, [&](std::size_t k) { return std::cos(order * angle[k].left); },
                [&](std::size_t k) { return std::cos(order * angle[k].right); });
        } else if (c.name == "payload_step") {
            const double from_s = c["time_s"];
            const auto later = [&](auto value) {
                return series([&](std::size_t k) {
                    return static_cast<double>(k) * log_.period_s >= from_s ? value(k) : 0.0;
                });
            };
            columns.push_back(
                {Tie::alone, false, true, false, later([&](std::size_t k) { return w[k] * w[k]; }), {}, {}});
            columns.push_back(
                {Tie::alone, false, true, true, later([&](std::size_t k) { return view_.sum[k]; }), {}, {}});
            columns.push_back(
                {Tie::alone, false, true, false, {}, later([&](std::size_t k) { return v[k] * w[k]; }), {}});
            columns.push_back({Tie::alone,
                               false,
                               true,
                               true,
                               {},
                               later([&](std::size_t k) { return view_.differ[k]; }),
                               {}});
        } else if (c.name == "wheel_slip") {
            // The wheels run ahead of the robot by a speed that goes with the force, as of the last sample's
            // torque.
            const auto last = [](const std::vector<double>& u) {
                std::vector<double> out = u;
                std::rotate(out.rbegin(), out.rbegin() + 1, out.rend());
                out.front() = 0;
                return out;
            };
            columns.push_back({Tie::alone, true, false, false, last(view_.sum), {}, {}});
            std::vector<double> turning = last(view_.differ);
            std::vector<double> gyro = turning;
            for (double& x : gyro) x = -x;
            columns.push_back({Tie::alone, true, false, false, {}, std::move(turning), std::move(gyro)});
        } else if (c.name == "gyro_bias") {
            columns.push_back({Tie::alone,
                               false,
                               false,
                               false,
                               {},
                               std::vector<double>(n_, 0.0),
                               std::vector<double>(n_, 1.0)});
        }
    }

    // A castor that rolls without slipping sideways: its direction follows from the robot's motion.
    void add_castor(double arm, double trail) {
        Column rolling{Tie::force, true, true, false, std::vector<double>(n_), std::vector<double>(n_), {}};
        Column swivel = rolling;
        double angle = 0;
        for (std::size_t k = 0; k < n_; ++k) {
            const double v = view_.v[k];
            const double w = view_.w[k];
            const auto rate = [&](double at) {
                return (-v * std::sin(at) + arm * w * std::cos(at)) / trail - w;
            };
            const double turning = rate(angle);
            const double c = std::cos(angle);
            const double s = std::sin(angle);
            const double direction = std::tanh((v * c + arm * w * s) / 0.005);
            rolling.forward[k] = -direction * c;
            rolling.turning[k] = -direction * arm * s;
            const double drags = std::tanh(turning / 0.05);
            swivel.forward[k] = drags * s / trail;
            swivel.turning[k] = drags * (1 - arm * c / trail);
            const int steps =
                1 + static_cast<int>((std::abs(v) + std::abs(arm * w)) / trail * log_.period_s / 0.1);
            for (int i = 0; i < steps; ++i) angle += rate(angle) * log_.period_s / steps;
        }
        view_.columns.push_back(std::move(rolling));
        view_.columns.push_back(std::move(swivel));
    }

    const Log& log_;
    std::size_t n_;
    std::vector<double> ul_, ur_, wl_, wr_;
    double mismatch_ = 0;
    View view_;
};

// Normal equations of both axes: two of the base model's, then the columns.
struct Normal {
    Eigen::MatrixXd h;
    Eigen::VectorXd g;
    double yy = 0;

    explicit Normal(Eigen::Index size)
        : h(Eigen::MatrixXd::Zero(size, size)), g(Eigen::VectorXd::Zero(size)) {}
};

// One axis of a view: what is explained, and by what.
struct Axis {
    const std::vector<double>& target;
    const std::vector<double>& smooth;
    const std::vector<double>& torque;
    double weight;
    struct Explaining {
        const std::vector<double>* values;
        Eigen::Index at;  // in the normal equations
        bool integrated;
        bool held;
    };
    std::vector<Explaining> columns = {};  // those that this axis has
};

Axis axis_of(const View& view, bool turning, const std::vector<double>& smooth, double weight) {
    Axis axis{turning ? view.w : view.v, smooth, turning ? view.differ : view.sum, weight};
    for (std::size_t j = 0; j < view.columns.size(); ++j) {
        const Column& c = view.columns[j];
        const std::vector<double>& values = turning ? c.turning : c.forward;
        if (values.empty()) continue;
        axis.columns.push_back({&values, static_cast<Eigen::Index>(j) + 2, c.integrated, c.held});
    }
    return axis;
}

// Adds the windows of one axis: target and columns, integrated from the window's beginning, without their
// means. The size, 2 and the columns', is known to the compiler: most of the oracle's time is spent here.
template <int kSize>
void add_windows(const Log& log, const Axis& axis, Normal& normal) {
    using Vector = Eigen::Matrix<double, kSize, 1>;
    using Square = Eigen::Matrix<double, kSize, kSize>;
    const std::size_t n = axis.target.size();
    const auto longest = static_cast<std::size_t>(std::lround(kWindow_s / log.period_s));
    const double dt = log.period_s;
    Square all = Square::Zero();
    Vector all_products = Vector::Zero();
    std::size_t begin = 0;
    while (begin + 4 < n) {
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
                const std::vector<double>& c = *column.values;
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
        if (count > 4) {
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

// As many columns as two effects can have.
constexpr int kMostColumns = 8;

template <int kSize = 2>
void add_axis(const Log& log, const Axis& axis, Normal& normal) {
    if (axis.columns.size() + 2 == kSize) return add_windows<kSize>(log, axis, normal);
    if constexpr (kSize < kMostColumns + 2) return add_axis<kSize + 1>(log, axis, normal);
    throw std::logic_error("more columns than two effects have");
}

double unexplained(const Log& log, const std::vector<Candidate>& candidates) {
    const View view = Viewer(log).view(candidates);
    const std::size_t extra = view.columns.size();
    const auto size = static_cast<Eigen::Index>(extra) + 2;
    std::vector<double> squared(view.v.size());
    std::vector<double> product(view.v.size());
    for (std::size_t k = 0; k < squared.size(); ++k) {
        squared[k] = view.w[k] * view.w[k];
        product[k] = view.v[k] * view.w[k];
    }
    // (left + right) / 2 and (right - left) / 2 of the wheels have half the variance of one
    const double variance = log.sigma_speed * log.sigma_speed / 2;
    const double forward_scale = 1 / log.radius_m;
    const double turning_scale = log.track_m / (2 * log.radius_m);
    Normal forward(size);
    Normal turning(size);
    add_axis(log, axis_of(view, false, squared, forward_scale * forward_scale / variance), forward);
    add_axis(log, axis_of(view, true, product, turning_scale * turning_scale / variance), turning);
    double yy = forward.yy + turning.yy;
    if (log.gyro) {
        const double weight = 1 / (log.sigma_gyro * log.sigma_gyro);
        for (std::size_t k = 0; k < view.w.size(); ++k) {
            const double y = log.yaw[k] - view.w[k];
            yy += weight * y * y;
        }
        for (std::size_t i = 0; i < extra; ++i) {
            const std::vector<double>& a = view.columns[i].gyro;
            for (std::size_t k = 0; k < a.size(); ++k) {
                turning.g[static_cast<Eigen::Index>(i) + 2] += weight * (log.yaw[k] - view.w[k]) * a[k];
            }
            for (std::size_t j = 0; j < extra; ++j) {
                const std::vector<double>& b = view.columns[j].gyro;
                double& sum = turning.h(static_cast<Eigen::Index>(i) + 2, static_cast<Eigen::Index>(j) + 2);
                for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k) sum += weight * a[k] * b[k];
            }
        }
    }
    // Unknowns: K5, K7, K6, K8, then one for each column; the ties by iteration, from the base model's ratio.
    std::vector<char> used(extra, 1);
    double ratio = log.track_m / (2 * log.radius_m) * log.radius_m * 10;
    double best = yy;
    for (int round = 0; round < 6; ++round) {
        const Eigen::Index total = static_cast<Eigen::Index>(extra) + 4;
        Eigen::MatrixXd h = Eigen::MatrixXd::Zero(total, total);
        Eigen::VectorXd g = Eigen::VectorXd::Zero(total);
        const auto add = [&](const Normal& normal, Eigen::Index base, bool turns) {
            const auto place = [&](Eigen::Index i) { return i < 2 ? base + i : i + 2; };
            const auto factor = [&](Eigen::Index i) {
                if (i < 2) return 1.0;
                const auto j = static_cast<std::size_t>(i) - 2;
                if (used[j] == 0) return 0.0;
                const Tie tie = view.columns[j].tie;
                if (!turns || tie == Tie::alone) return 1.0;
                return tie == Tie::torque ? ratio : 2 * ratio / log.track_m;
            };
            for (Eigen::Index i = 0; i < size; ++i) {
                g[place(i)] += factor(i) * normal.g[i];
                for (Eigen::Index j = 0; j < size; ++j) {
                    h(place(i), place(j)) += factor(i) * factor(j) * normal.h(i, j);
                }
            }
        };
        add(forward, 0, false);
        add(turning, 2, true);
        // columns of unlike units
        Eigen::VectorXd scale(total);
        for (Eigen::Index i = 0; i < total; ++i) scale[i] = h(i, i) > 0 ? 1 / std::sqrt(h(i, i)) : 0;
        const Eigen::MatrixXd scaled = scale.asDiagonal() * h * scale.asDiagonal();
        const Eigen::MatrixXd safe = scaled + 1e-13 * Eigen::MatrixXd::Identity(total, total);
        const Eigen::VectorXd z = safe.ldlt().solve(scale.asDiagonal() * g);
        const Eigen::VectorXd x = scale.asDiagonal() * z;
        best = yy - 2 * g.dot(x) + x.dot(h * x);
        bool again = false;
        double most = 0;
        std::size_t drop = extra;
        for (std::size_t j = 0; j < extra; ++j) {
            const double value = z[static_cast<Eigen::Index>(j) + 4];
            if (used[j] != 0 && view.columns[j].not_negative && value < most) {
                most = value;
                drop = j;
            }
        }
        if (drop < extra) {
            used[drop] = 0;
            again = true;
        }
        if (x[1] > 0 && x[3] > 0) {
            const double now = x[3] / x[1];
            again = again || std::abs(now / ratio - 1) > 1e-4;
            ratio = now;
        }
        if (!again) break;
    }
    return std::max(best, 0.0);
}

// The best that an effect can do beside `partners`, its nonlinear parameters searched.
double best_of(const Log& log, std::string_view name, const std::vector<Candidate>& partners) {
    const auto with = [&](std::map<std::string, double, std::less<>> parameters) {
        std::vector<Candidate> all = partners;
        all.push_back({std::string(name), std::move(parameters)});
        return unexplained(log, all);
    };
    // The smallest over a grid, and by thirds between its neighbours.
    const auto along = [&](const char* parameter, double low, double high, int points, bool logarithmic) {
        const auto at = [&](double share) {
            return logarithmic ? low * std::pow(high / low, share) : low + (high - low) * share;
        };
        double best = std::numeric_limits<double>::infinity();
        int where = 0;
        for (int i = 0; i < points; ++i) {
            const double value = with({{parameter, at(i / (points - 1.0))}});
            if (value < best) {
                best = value;
                where = i;
            }
        }
        double left = std::max(0, where - 1) / (points - 1.0);
        double right = std::min(points - 1, where + 1) / (points - 1.0);
        for (int i = 0; i < 5; ++i) {
            const double a = left + (right - left) * 0.382;
            const double b = left + (right - left) * 0.618;
            const double at_a = with({{parameter, at(a)}});
            const double at_b = with({{parameter, at(b)}});
            best = std::min({best, at_a, at_b});
            (at_a < at_b ? right : left) = at_a < at_b ? b : a;
        }
        return best;
    };
    double best = std::numeric_limits<double>::infinity();
    const auto consider = [&](double value) { best = std::min(best, value); };
    if (name == "actuator_lag") return along("time_constant_s", 0.002, 0.08, 6, true);
    if (name == "transport_delay") return along("delay_s", 0.0005, 0.03, 6, true);
    if (name == "measurement_lag") return along("time_constant_s", 0.003, 0.2, 6, true);
    if (name == "dead_zone") return along("width_Nm", 0.01 * log.peak_Nm, 0.4 * log.peak_Nm, 6, true);
    if (name == "torque_saturation")
        return along("limit_Nm", 0.3 * log.peak_Nm, 0.98 * log.peak_Nm, 7, false);
    if (name == "wheel_radius_mismatch") return along("relative", -0.12, 0.12, 7, false);
    if (name == "payload_step") return along("time_s", 0.1 * log.duration_s, 0.9 * log.duration_s, 9, false);
    if (name == "stribeck_friction") return along("stribeck_rad_per_s", 0.3, 4, 4, true);
    if (name == "torque_ripple") {
        for (int order = 1; order <= 14; ++order) consider(with({{"order", order}}));
        return best;
    }
    if (name == "gain_drift") {
        for (const double share : {0.0, 0.1, 0.2, 0.35, 0.6}) {
            consider(with({{"time_constant_s", share * log.duration_s}}));
        }
        return best;
    }
    if (name == "back_emf_limit") {
        for (const double stall : {0.35, 0.5, 0.7, 0.85, 1.0, 1.2}) {
            for (const double speed : {1.1, 1.4, 2.0, 3.0}) {
                consider(with(
                    {{"stall_Nm", stall * log.peak_Nm}, {"no_load_rad_per_s", speed * log.peak_rad_per_s}}));
            }
        }
        return best;
    }
    if (name == "castor_drag") {
        for (const double trail : {0.022, 0.03, 0.038})
            consider(with({{"arm_m", log.castor_m}, {"trail_m", trail}}));
        return best;
    }
    if (name == "backlash") {
        for (const double gap : {0.006, 0.012, 0.025, 0.05, 0.09}) {
            consider(with({{"half_gap_rad", gap}, {"motor_inertia_kg_m2", log.wheel_inertia_kg_m2 / 2}}));
        }
        return best;
    }
    return with({});
}

}  // namespace

OracleVerdict ask_oracle(const Trial& trial) {
    OracleVerdict verdict;
    std::vector<Candidate> truth;
    for (const HiddenEffect& effect : trial.hidden.effects) {
        const EffectInfo* info = find_effect(effect.name);
        if (info != nullptr && !info->fault_of_log && effect.name != "encoder_quantisation")
            truth.push_back(effect);
    }
    if (truth.empty()) return verdict;
    const Log log = log_of(trial);
    verdict.unexplained_true = unexplained(log, truth);
    verdict.unexplained_none = unexplained(log, {});
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < truth.size(); ++i) {
        std::vector<Candidate> others = truth;
        others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
        // what this effect closes of the gap
        const double without = unexplained(log, others);
        const double gap = without - verdict.unexplained_true;
        const auto consider = [&](const std::string& name, double value) {
            const double excess = value - verdict.unexplained_true;
            if (excess < std::max(kEnough, kShare * gap)) verdict.identifiable = false;
            const double share = excess / std::max(gap, kEnough);
            if (share >= nearest) return;
            nearest = share;
            verdict.unexplained_rival = value;
            verdict.nearest_rival = name;
        };
        consider(others.empty() ? "nothing" : others.front().name + " alone", without);
        for (const EffectInfo& info : all_effects()) {
            if (info.fault_of_log || info.name == "encoder_quantisation" || (info.needs_gyro && !log.gyro)) {
                continue;
            }
            // Dry friction that grows near standstill, by nothing, is dry friction: the smaller one is to be
            // named.
            const auto same = [&](const Candidate& c) {
                return c.name == info.name ||
                       (c.name == "coulomb_friction" && info.name == "stribeck_friction");
            };
            if (std::any_of(truth.begin(), truth.end(), same)) continue;
            const std::string name = std::string(info.name) + (others.empty() ? "" : " for " + truth[i].name);
            consider(name, best_of(log, info.name, others));
        }
    }
    return verdict;
}

}  // namespace wheelwright::hidden
