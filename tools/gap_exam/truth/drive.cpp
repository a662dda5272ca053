#include "tools/gap_exam/truth/drive.hpp"

#include <cstdio>
#include <numbers>

namespace wheelwright::exam {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kRest_s = 1;
constexpr double kSecondOverFirst = 0.25;  // links of a late report

double quantised(double x, double step) { return step > 0 ? step * std::round(x / step) : x; }

// Noise that is alike over a time.
class Coloured {
  public:
    Coloured(double rms, double time_s, double period_s) : rms_(rms), keeps_(std::exp(-period_s / time_s)) {}
    double next(Random& random) {
        value_ = keeps_ * value_ + rms_ * std::sqrt(1 - keeps_ * keeps_) * random.gaussian();
        return value_;
    }

  private:
    double rms_, keeps_, value_ = 0;
};

// One motion: speeds of the body, as shares of the top speed forward and turning; torque as share of the
// limit.
struct Part {
    std::vector<double> forward, turning, left_torque, right_torque;
    explicit Part(std::size_t n) : forward(n), turning(n), left_torque(n), right_torque(n) {}
};

// Constant for drawn times.
void hold_steps(Random& random, std::vector<double>& values, double period_s, double shortest_s,
                double longest_s, double largest) {
    std::size_t k = 0;
    while (k < values.size()) {
        const auto until =
            k + 1 + static_cast<std::size_t>(random.log_uniform(shortest_s, longest_s) / period_s);
        const double value = random.uniform(-largest, largest);
        for (; k < std::min(until, values.size()); ++k) values[k] = value;
    }
}

Part part_of(Random& random, Motion motion, std::size_t n, double period_s) {
    Part p(n);
    const double top = random.uniform(0.5, 1);
    const auto share = [n](std::size_t k) { return static_cast<double>(k) / static_cast<double>(n); };
    switch (motion) {
        case Motion::quasi_static:  // up slowly, and the same backwards
            for (std::size_t k = 0; k < n; ++k) {
                const double x = share(k) * 2;
                if (x < 0.85) p.forward[k] = top * x / 0.85;
                if (x >= 1 && x < 1.85) p.forward[k] = -top * (x - 1) / 0.85;
            }
            break;
        case Motion::dynamic:  // as fast as it goes, and back
            for (std::size_t k = 0; k < n; ++k) {
                const double x = share(k) * 4;
                p.forward[k] = x < 0.8   ? top
                               : x < 1.2 ? 0
                               : x < 2   ? -top
                               : x < 2.4 ? 0
                               : x < 3   ? top / 2
                                         : -top / 2;
            }
            break;
        case Motion::steps:
            hold_steps(random, p.forward, period_s, 0.5, 3, top * 0.8);
            hold_steps(random, p.turning, period_s, 0.5, 3, top * 0.4);
            break;
        case Motion::teleoperation: {  // a person's hand: slow wishes, and now and then none
            Coloured forward(0.5, random.uniform(0.4, 1.5), period_s);
            Coloured turning(0.3, random.uniform(0.3, 1), period_s);
            std::vector<double> hand(n);
            hold_steps(random, hand, period_s, 0.5, 4, 1);
            for (std::size_t k = 0; k < n; ++k) {
                const double f = forward.next(random);
                const double t = turning.next(random);
                if (hand[k] < -0.7) continue;
                p.forward[k] = std::clamp(f + 0.2, -0.7, 0.7) * top;
                p.turning[k] = std::clamp(t, -0.4, 0.4) * top;
            }
            break;
        }
        case Motion::spin:
            hold_steps(random, p.turning, period_s, 0.8, 4, top);
            break;
        case Motion::figure_eight: {
            const double lap_s = random.uniform(4, 9);
            for (std::size_t k = 0; k < n; ++k) {
                const double phase = 2 * kPi * static_cast<double>(k) * period_s / lap_s;
                p.forward[k] = top * (0.5 + 0.1 * std::sin(2 * phase));
                p.turning[k] = top * 0.35 * std::sin(phase);
            }
            break;
        }
        case Motion::excitation: {  // pseudo-random torques on a slow speed
            hold_steps(random, p.forward, period_s, 2, 5, top * 0.5);
            hold_steps(random, p.turning, period_s, 2, 5, top * 0.2);
            const double level = random.uniform(0.15, 0.5);
            for (auto* torque : {&p.left_torque, &p.right_torque}) {
                hold_steps(random, *torque, period_s, 0.05, 0.3, 1);
                for (double& x : *torque) x = x < 0 ? -level : level;
            }
            break;
        }
    }
    return p;
}

}  // namespace

Sensors draw_sensors(Random& random, const Robot& robot) {
    Sensors s;
    constexpr std::array<double, 7> kPeriods_s{0.001, 0.002, 0.004, 0.005, 0.01, 0.01, 0.02};
    s.period_s = kPeriods_s[random.below(kPeriods_s.size())];
    s.counts_per_turn = random.log_uniform(1000, 65536);
    s.tracking_rad_per_s = random.log_uniform(150, 1000);
    s.noise_rad_per_s = robot.top_speed_rad_per_s * random.log_uniform(0.0002, 0.003);
    s.noise_time_s = random.log_uniform(0.003, 0.1);
    s.gyro = random.chance(0.5);
    const double top_yaw_rad_per_s = 2 * robot.top_speed_rad_per_s * robot.mean_radius_m() / robot.track_m;
    s.gyro_bias_rad_per_s = top_yaw_rad_per_s * random.log_uniform(0.0002, 0.01) * random.sign();
    s.gyro_noise_rad_per_s = top_yaw_rad_per_s * random.log_uniform(0.0005, 0.005);
    s.gyro_wander_rad_per_s = s.gyro_noise_rad_per_s * random.uniform(0, 0.5);
    s.gyro_time_s = random.log_uniform(0.1, 10);
    s.torque_step_Nm = robot.torque_limit_Nm / random.log_uniform(200, 4000);
    s.jitter_s = random.chance(0.5) ? s.period_s * random.uniform(0, 0.2) : 0;
    s.dropped = random.chance(0.5) ? random.log_uniform(0.0005, 0.02) : 0;
    return s;
}

Driving draw_driving(Random& random, const Sensors& sensors) {
    Driving d;
    const std::size_t count = random.chance(0.15) ? 1 : random.chance(0.5) ? 2 : 3;
    while (d.motions.size() < count) {
        const auto motion = static_cast<Motion>(random.below(kMotionNames.size()));
        if (std::find(d.motions.begin(), d.motions.end(), motion) == d.motions.end())
            d.motions.push_back(motion);
    }
    d.each_s = random.uniform(30, 50) / static_cast<double>(count);
    // No faster than the slowest sample and the latest report let it be.
    const double late_s = sensors.period_s + 2 / sensors.tracking_rad_per_s;
    d.loop_rad_per_s = std::min(random.log_uniform(2, 12), 0.3 / late_s);
    return d;
}

Wanted draw_motion(Random& random, const Robot& robot, const Driving& driving, double period_s) {
    Wanted wanted;
    for (const Motion motion : driving.motions) {
        const auto n = static_cast<std::size_t>(driving.each_s / period_s);
        const Part p = part_of(random, motion, n, period_s);
        for (std::size_t k = 0; k < n; ++k) {
            const double top = robot.top_speed_rad_per_s;
            wanted.speed_rad_per_s.push_back(
                {top * (p.forward[k] - p.turning[k]), top * (p.forward[k] + p.turning[k])});
            wanted.torque_Nm.push_back(
                {robot.torque_limit_Nm * p.left_torque[k], robot.torque_limit_Nm * p.right_torque[k]});
        }
        const auto rest = static_cast<std::size_t>(kRest_s / period_s);
        wanted.speed_rad_per_s.insert(wanted.speed_rad_per_s.end(), rest, {});
        wanted.torque_Nm.insert(wanted.torque_Nm.end(), rest, {});
    }
    return wanted;
}

Sides<double> LateReport::operator()(const Sides<double>& speed, double step_s) {
    if (!(lag_s_ > 0)) return speed;
    const double first_s = lag_s_ / (1 + kSecondOverFirst);
    const double keeps_first = std::exp(-step_s / first_s);
    const double keeps_second = std::exp(-step_s / (first_s * kSecondOverFirst));
    for (std::size_t i = 0; i < 2; ++i) {
        first_[i] = keeps_first * first_[i] + (1 - keeps_first) * speed[i];
        second_[i] = keeps_second * second_[i] + (1 - keeps_second) * first_[i];
    }
    return second_;
}

void Tracking::take(double angle_rad, double step_s) {
    angle_ += step_s * speed_;
    const double off = angle_rad - angle_;
    angle_ += step_s * 2 * bandwidth_ * off;
    speed_ += step_s * bandwidth_ * bandwidth_ * off;
}

Drive drive(const Robot& robot, const Sensors& sensors, const Driving& driving, const Wanted& wanted,
            std::uint64_t seed) {
    Simulator plant(robot, seed, true);
    Random noise(seed, 3);
    Random stamps(seed, 4);
    Sides<Tracking> tracking{Tracking(sensors.tracking_rad_per_s), Tracking(sensors.tracking_rad_per_s)};
    const double late_s = robot.further == Further::measurement_lag ? robot.amount * largest(robot) : 0;
    LateReport logged_late(late_s);
    LateReport true_late(late_s);
    Sides<Coloured> coloured{Coloured(sensors.noise_rad_per_s, sensors.noise_time_s, sensors.period_s),
                             Coloured(sensors.noise_rad_per_s, sensors.noise_time_s, sensors.period_s)};
    Coloured wander(sensors.gyro_wander_rad_per_s, sensors.gyro_time_s, sensors.period_s);
    const double count_rad = 2 * kPi / sensors.counts_per_turn;
    const double inertia_kg_m2 =
        robot.effective_mass_kg() * robot.mean_radius_m() * robot.mean_radius_m() / 2;
    const double loop_Nm_s_per_rad = driving.loop_rad_per_s * inertia_kg_m2;

    Drive made{sensors.period_s, sensors.gyro, {}};
    made.rows.reserve(wanted.speed_rad_per_s.size());
    Sides<double> reported{};
    Sides<double> true_reported{};
    for (std::size_t k = 0; k < wanted.speed_rad_per_s.size(); ++k) {
        Row row;
        row.t_s = static_cast<double>(k) * sensors.period_s + sensors.jitter_s * stamps.gaussian() / 2;
        row.dropped = k > 0 && stamps.chance(sensors.dropped);
        for (std::size_t i = 0; i < 2; ++i) {
            row.speed_rad_per_s[i] = reported[i] + coloured[i].next(noise);
            row.true_rad_per_s[i] = true_reported[i];
            row.asked_Nm[i] =
                std::clamp(loop_Nm_s_per_rad * (wanted.speed_rad_per_s[k][i] - row.speed_rad_per_s[i]) +
                               wanted.torque_Nm[k][i],
                           -robot.torque_limit_Nm, robot.torque_limit_Nm);
            row.torque_Nm[i] = quantised(row.asked_Nm[i], sensors.torque_step_Nm);
        }
        row.gyro_rad_per_s = plant.yaw_rate_rad_per_s() + sensors.gyro_bias_rad_per_s + wander.next(noise) +
                             sensors.gyro_noise_rad_per_s * noise.gaussian();
        plant.advance(row.asked_Nm, sensors.period_s, [&](double step_s, const Sides<double>& angle_rad) {
            Sides<double> speed{};
            for (std::size_t i = 0; i < 2; ++i) {
                tracking[i].take(count_rad * std::floor(angle_rad[i] / count_rad), step_s);
                speed[i] = tracking[i].speed_rad_per_s();
            }
            reported = logged_late(speed, step_s);
            true_reported = true_late(plant.speed_rad_per_s(), step_s);
        });
        row.resistance = plant.resistance();
        made.rows.push_back(row);
    }
    return made;
}

double true_free_run_rms(const Robot& robot, const Sensors& sensors, const Drive& drive) {
    Simulator plant(robot, 0, false);
    const Sides<double>& first = drive.rows.front().speed_rad_per_s;
    plant.set_motion(
        (first[0] * robot.wheel_radius_m[0] + first[1] * robot.wheel_radius_m[1]) / 2,
        (first[1] * robot.wheel_radius_m[1] - first[0] * robot.wheel_radius_m[0]) / robot.track_m);
    LateReport late(robot.further == Further::measurement_lag ? robot.amount * largest(robot) : 0);
    late.begin(first);
    Sides<Tracking> tracking{Tracking(sensors.tracking_rad_per_s), Tracking(sensors.tracking_rad_per_s)};
    for (std::size_t i = 0; i < 2; ++i) tracking[i].begin(0, first[i]);
    double sum = 0;
    double count = 0;
    for (std::size_t k = 0; k + 1 < drive.rows.size(); ++k) {
        Sides<double> reported{};
        plant.advance(drive.rows[k].torque_Nm, drive.period_s,
                      [&](double step_s, const Sides<double>& angle_rad) {
                          Sides<double> speed{};
                          for (std::size_t i = 0; i < 2; ++i) {
                              tracking[i].take(angle_rad[i], step_s);
                              speed[i] = tracking[i].speed_rad_per_s();
                          }
                          reported = late(speed, step_s);
                      });
        for (std::size_t i = 0; i < 2; ++i) {
            const double off = reported[i] - drive.rows[k + 1].speed_rad_per_s[i];
            sum += off * off;
            count += 1;
        }
    }
    return std::sqrt(sum / count);
}

std::string csv(const Drive& drive) {
    std::string text = "t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s";
    text += drive.gyro ? ",gyro_z_rad_s\n" : "\n";
    std::array<char, 160> line{};
    for (const Row& row : drive.rows) {
        if (row.dropped) continue;
        int length =
            std::snprintf(line.data(), line.size(), "%.6f,%.6g,%.6g,%.6g,%.6g", row.t_s, row.torque_Nm[0],
                          row.torque_Nm[1], row.speed_rad_per_s[0], row.speed_rad_per_s[1]);
        text.append(line.data(), static_cast<std::size_t>(length));
        if (drive.gyro) {
            length = std::snprintf(line.data(), line.size(), ",%.6g", row.gyro_rad_per_s);
            text.append(line.data(), static_cast<std::size_t>(length));
        }
        text += '\n';
    }
    return text;
}

}  // namespace wheelwright::exam
