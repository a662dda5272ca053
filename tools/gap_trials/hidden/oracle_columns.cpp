#include "tools/gap_trials/hidden/oracle_columns.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace wheelwright::hidden {
namespace {

double sign_of(double x) { return x > 0 ? 1.0 : (x < 0 ? -1.0 : 0.0); }

Series integral(const Series& rate, double period_s) {
    Series out(rate.size());
    for (std::size_t k = 1; k < rate.size(); ++k) {
        out[k] = out[k - 1] + period_s * (rate[k] + rate[k - 1]) / 2;
    }
    return out;
}

template <typename Function>
Series each(const Series& of, Function value) {
    Series out(of.size());
    for (std::size_t k = 0; k < of.size(); ++k) out[k] = value(of[k]);
    return out;
}

template <typename Function>
WheelSeries each(const WheelSeries& of, Function value) {
    return {each(of.left, value), each(of.right, value)};
}

Series product(const Series& a, const Series& b) {
    Series out(a.size());
    for (std::size_t k = 0; k < a.size(); ++k) out[k] = a[k] * b[k];
    return out;
}

// One effect after the other adds its columns.
class Columns {
  public:
    Columns(const CleanLog& log, const View& view) : log_(log), view_(view) {}

    void add(const Candidate& candidate);
    std::vector<Column> take() { return std::move(columns_); }

  private:
    enum Sign { any, not_negative };
    enum Between { moving, held };  // a value between samples

    // Torques at both wheels with one coefficient.
    void together(const WheelSeries& torque, Sign sign, Between between = moving) {
        AxisSeries sums = view_.sums_of(torque);
        columns_.push_back({.tie = Tie::torque,
                            .not_negative = sign == not_negative,
                            .held = between == held,
                            .forward = std::move(sums.forward),
                            .turning = std::move(sums.turning)});
    }
    // A coefficient for each wheel.
    void apart(const WheelSeries& torque, Sign sign) {
        together({torque.left, Series(n_, 0.0)}, sign);
        together({Series(n_, 0.0), torque.right}, sign);
    }

    void viscous_friction(const Candidate&) {
        apart(each(speed_, [](double speed) { return -speed; }), not_negative);
    }

    void coulomb_friction(const Candidate&) { apart(dry(), not_negative); }

    void stribeck_friction(const Candidate& c) {
        const double knee = c["stribeck_rad_per_s"];
        const auto more = [knee](double x) { return -sign_of(x) * std::exp(-x * x / (knee * knee)); };
        together(dry(), not_negative);
        together(each(speed_, more), not_negative);
    }

    void quadratic_drag(const Candidate&) {
        columns_.push_back(
            {.not_negative = true, .forward = each(v_, [](double v) { return -v * std::abs(v); })});
    }

    void turning_scrub(const Candidate&) {
        columns_.push_back({.not_negative = true, .turning = each(w_, [](double w) { return -sign_of(w); })});
    }

    // A castor that rolls without slipping sideways: its direction follows from the robot's motion.
    void castor_drag(const Candidate& c);

    // Uphill is anywhere.
    void slope(const Candidate&) {
        const Series heading = integral(w_, log_.period_s);
        const Series cosine = each(heading, [](double at) { return std::cos(at); });
        const Series sine = each(heading, [](double at) { return std::sin(at); });
        columns_.push_back({.forward = cosine});
        columns_.push_back({.forward = sine});
        columns_.push_back({.turning = cosine});
        columns_.push_back({.turning = sine});
    }

    void torque_bias(const Candidate&) { apart({Series(n_, 1.0), Series(n_, 1.0)}, any); }

    void torque_gain_mismatch(const Candidate&) {
        together({each(torque_.left, [](double u) { return -u; }), torque_.right}, any, held);
    }

    void cog_lateral(const Candidate&) {
        columns_.push_back({.tie = Tie::force, .integrated = false, .forward = w_, .turning = v_});
    }

    void gain_drift(const Candidate& c) {
        const double time_constant_s = c["time_constant_s"];
        WheelSeries lost = torque_;
        for (std::size_t k = 0; k < n_; ++k) {
            const double t_s = (static_cast<double>(k) + 0.5) * log_.period_s;
            const double share =
                time_constant_s > 0 ? -std::expm1(-t_s / time_constant_s) : t_s / log_.duration_s;
            lost.left[k] *= -share;
            lost.right[k] *= -share;
        }
        together(lost, not_negative, held);
    }

    // With any phase.
    void torque_ripple(const Candidate& c) {
        const double order = c["order"];
        const WheelSeries angle{integral(speed_.left, log_.period_s), integral(speed_.right, log_.period_s)};
        together(each(angle, [order](double at) { return std::sin(order * at); }), any);
        together(each(angle, [order](double at) { return std::cos(order * at); }), any);
    }

    // Each of the base model's four terms changes.
    void payload_step(const Candidate& c) {
        const double from_s = c["time_s"];
        const auto later = [&](Series x) {
            for (std::size_t k = 0; k < n_; ++k) {
                if (static_cast<double>(k) * log_.period_s < from_s) x[k] = 0;
            }
            return x;
        };
        columns_.push_back({.forward = later(product(w_, w_))});
        columns_.push_back({.held = true, .forward = later(view_.sums_Nm.forward)});
        columns_.push_back({.turning = later(product(v_, w_))});
        columns_.push_back({.held = true, .turning = later(view_.sums_Nm.turning)});
    }

    // The wheels run ahead of the robot by a speed that goes with the force, as of the last sample's torque.
    void wheel_slip(const Candidate&) {
        const auto last = [](Series x) {
            std::rotate(x.rbegin(), x.rbegin() + 1, x.rend());
            x.front() = 0;
            return x;
        };
        Series turning = last(view_.sums_Nm.turning);
        Series gyro = each(turning, [](double ahead) { return -ahead; });
        columns_.push_back(
            {.not_negative = true, .integrated = false, .forward = last(view_.sums_Nm.forward)});
        columns_.push_back({.not_negative = true,
                            .integrated = false,
                            .turning = std::move(turning),
                            .gyro = std::move(gyro)});
    }

    void gyro_bias(const Candidate&) {
        columns_.push_back({.integrated = false, .turning = Series(n_, 0.0), .gyro = Series(n_, 1.0)});
    }

    WheelSeries dry() const {
        return each(speed_, [](double speed) { return -sign_of(speed); });
    }

    const CleanLog& log_;
    const View& view_;
    const WheelSeries& speed_ = view_.speed_rad_per_s;
    const WheelSeries& torque_ = view_.torque_Nm;
    const Series& v_ = view_.v_m_per_s;
    const Series& w_ = view_.w_rad_per_s;
    const std::size_t n_ = v_.size();
    std::vector<Column> columns_;
};

void Columns::castor_drag(const Candidate& c) {
    constexpr double kRolling_m_per_s = 0.005;
    constexpr double kSwivelling_rad_per_s = 0.05;
    constexpr double kStep_rad = 0.1;
    const double arm = c["arm_m"];
    const double trail = c["trail_m"];
    Column rolling{.tie = Tie::force, .not_negative = true, .forward = Series(n_), .turning = Series(n_)};
    Column swivel = rolling;
    double angle = 0;
    for (std::size_t k = 0; k < n_; ++k) {
        const double v = v_[k];
        const double w = w_[k];
        const auto rate = [&](double at) { return (-v * std::sin(at) + arm * w * std::cos(at)) / trail - w; };
        const double cosine = std::cos(angle);
        const double sine = std::sin(angle);
        const double direction = std::tanh((v * cosine + arm * w * sine) / kRolling_m_per_s);
        rolling.forward[k] = -direction * cosine;
        rolling.turning[k] = -direction * arm * sine;
        const double drags = std::tanh(rate(angle) / kSwivelling_rad_per_s);
        swivel.forward[k] = drags * sine / trail;
        swivel.turning[k] = drags * (1 - arm * cosine / trail);
        const double about_rad = (std::abs(v) + std::abs(arm * w)) / trail * log_.period_s;
        const int steps = 1 + static_cast<int>(about_rad / kStep_rad);
        for (int i = 0; i < steps; ++i) angle += rate(angle) * log_.period_s / steps;
    }
    columns_.push_back(std::move(rolling));
    columns_.push_back(std::move(swivel));
}

void Columns::add(const Candidate& candidate) {
    struct Row {
        std::string_view effect;
        void (Columns::*add)(const Candidate&);
    };
    static constexpr std::array kRows{Row{"viscous_friction", &Columns::viscous_friction},
                                      Row{"coulomb_friction", &Columns::coulomb_friction},
                                      Row{"stribeck_friction", &Columns::stribeck_friction},
                                      Row{"quadratic_drag", &Columns::quadratic_drag},
                                      Row{"turning_scrub", &Columns::turning_scrub},
                                      Row{"castor_drag", &Columns::castor_drag},
                                      Row{"slope", &Columns::slope},
                                      Row{"torque_bias", &Columns::torque_bias},
                                      Row{"torque_gain_mismatch", &Columns::torque_gain_mismatch},
                                      Row{"cog_lateral", &Columns::cog_lateral},
                                      Row{"gain_drift", &Columns::gain_drift},
                                      Row{"torque_ripple", &Columns::torque_ripple},
                                      Row{"payload_step", &Columns::payload_step},
                                      Row{"wheel_slip", &Columns::wheel_slip},
                                      Row{"gyro_bias", &Columns::gyro_bias}};
    for (const Row& row : kRows) {
        if (row.effect == candidate.name) (this->*row.add)(candidate);
    }
}

}  // namespace

std::vector<Column> columns_of(const CleanLog& log, const View& view,
                               const std::vector<Candidate>& candidates) {
    Columns columns(log, view);
    for (const Candidate& candidate : candidates) columns.add(candidate);
    return columns.take();
}

}  // namespace wheelwright::hidden
