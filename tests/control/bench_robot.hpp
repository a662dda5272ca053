// A differential-drive robot for the control tests, written from the equations of motion by itself: it shares
// no code and no number with the controllers or with sim_hal. Two drives with transport delay and first-order
// torque lag, Coulomb friction that sticks, encoders with their own phases, quantisation, noise and late
// frames.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace bench {

constexpr double kPi = 3.14159265358979323846;
constexpr double kCount = 2 * kPi / 65536;  // one encoder count at the wheel

// xorshift64*, and a Gaussian by the sum of twelve uniforms (tails to 6 sigma).
class Noise {
  public:
    explicit Noise(std::uint64_t seed) : state_(seed * 0x9E3779B97F4A7C15ULL + 1) {}
    double uniform() {
        state_ ^= state_ >> 12U;
        state_ ^= state_ << 25U;
        state_ ^= state_ >> 27U;
        return static_cast<double>((state_ * 0x2545F4914F6CDD1DULL) >> 11U) * 0x1.0p-53;
    }
    double gaussian() {
        double sum = -6;
        for (int i = 0; i < 12; ++i) sum += uniform();
        return sum;
    }

  private:
    std::uint64_t state_;
};

struct Truth {
    double radius_left_m = 0.075;
    double radius_right_m = 0.075;
    double track_m = 0.32;
    double k5 = 0.0413;
    double k7 = 1.40855;
    double k8 = 6.74245;
    double coulomb_left_Nm = 0;
    double coulomb_right_Nm = 0;
    double viscous_Nm_s_per_rad = 0;
    double transport_s = 1.2e-3;        // from a cycle's start until its torque reaches the drive
    double lag_s = 1e-3;                // first-order torque lag of the drive
    double encoder_noise_rad = 0.2e-3;  // of each of the drive's readings (10 in a millisecond)
    double filter_rad_per_s = 1000;     // the drive's tracking filter, two poles; 0: none
    bool quantised = true;
    double frame_s = 0.13e-3;         // least delay of an encoder's time stamp
    double frame_jitter_s = 0.12e-3;  // arbitration: uniform, on top
    double k6() const { return -k5 * 2 * k8 / (track_m * k7); }
};

struct Encoder {
    double position_rad = 0;
    std::int64_t time_ns = 0;
};

class Robot {
  public:
    static constexpr int kSubsteps = 10;  // per millisecond
    static constexpr double kStep_s = 1e-3 / kSubsteps;

    Robot(const Truth& truth, std::uint64_t seed) : truth_(truth), noise_(seed) {
        transport_steps_ = static_cast<std::size_t>(std::lround(truth.transport_s / kStep_s));
    }

    // One millisecond under the torques that the controller computes at its beginning.
    void cycle(double left_Nm, double right_Nm) {
        for (int i = 0; i < kSubsteps; ++i) {
            const std::size_t in = (step_ + transport_steps_) % kQueue;
            queue_[in] = {left_Nm, right_Nm};
            const auto& asked = queue_[step_ % kQueue];
            const double share = truth_.lag_s > 0 ? 1 - std::exp(-kStep_s / truth_.lag_s) : 1;
            torque_left += share * (asked[0] - torque_left);
            torque_right += share * (asked[1] - torque_right);
            move();
            ++step_;
            read(left_, wheel_left);
            read(right_, wheel_right);
            if (step_ % kSubsteps == 3) send(left_, left);
            if (step_ % kSubsteps == 8) send(right_, right);
        }
    }

    std::int64_t now_ns() const { return static_cast<std::int64_t>(step_) * 100'000; }
    double speed_left() const { return (v - omega * truth_.track_m / 2) / truth_.radius_left_m; }
    double speed_right() const { return (v + omega * truth_.track_m / 2) / truth_.radius_right_m; }

    double x = 0, y = 0, heading = 0, v = 0, omega = 0;
    double wheel_left = 0, wheel_right = 0;
    double torque_left = 0, torque_right = 0;
    Encoder left, right;

  private:
    static constexpr std::size_t kQueue = 256;

    void move() {
        const double r_left = truth_.radius_left_m;
        const double r_right = truth_.radius_right_m;
        const double half = truth_.track_m / 2;
        const double drive_left = torque_left - truth_.viscous_Nm_s_per_rad * speed_left();
        const double drive_right = torque_right - truth_.viscous_Nm_s_per_rad * speed_right();
        double dv = kStep_s * (truth_.k5 * omega * omega + truth_.k7 * (drive_right + drive_left));
        double dw = kStep_s * (truth_.k6() * v * omega + truth_.k8 * (drive_right - drive_left));
        // Friction: impulses that bring the wheels' new speeds as near to zero as their sizes allow;
        // Gauss-Seidel.
        const double per_v = kStep_s * truth_.k7;
        const double per_w = kStep_s * truth_.k8;
        double used_left = 0, used_right = 0;
        for (int sweep = 0; sweep < 4; ++sweep) {
            const double s_left = (v + dv - (omega + dw) * half) / r_left;
            const double next_left = std::clamp(used_left + s_left / ((per_v + per_w * half) / r_left),
                                                -truth_.coulomb_left_Nm, truth_.coulomb_left_Nm);
            dv -= per_v * (next_left - used_left);
            dw += per_w * (next_left - used_left);
            used_left = next_left;
            const double s_right = (v + dv + (omega + dw) * half) / r_right;
            const double next_right = std::clamp(used_right + s_right / ((per_v + per_w * half) / r_right),
                                                 -truth_.coulomb_right_Nm, truth_.coulomb_right_Nm);
            dv -= per_v * (next_right - used_right);
            dw -= per_w * (next_right - used_right);
            used_right = next_right;
        }
        const double v_mean = v + dv / 2;
        const double w_mean = omega + dw / 2;
        v += dv;
        omega += dw;
        const double middle = heading + kStep_s * w_mean / 2;
        x += kStep_s * v_mean * std::cos(middle);
        y += kStep_s * v_mean * std::sin(middle);
        heading += kStep_s * w_mean;
        wheel_left += kStep_s * (v_mean - w_mean * half) / r_left;
        wheel_right += kStep_s * (v_mean + w_mean * half) / r_right;
    }

    struct Filter {
        double position = 0;
        double speed = 0;
    };

    void read(Filter& filter, double angle) {
        const double noisy = angle + truth_.encoder_noise_rad * noise_.gaussian();
        const double reading = truth_.quantised ? kCount * std::floor(noisy / kCount) : noisy;
        const double w = truth_.filter_rad_per_s;
        if (w <= 0) {
            filter.position = reading;
            return;
        }
        filter.position += kStep_s * filter.speed;
        const double off = reading - filter.position;
        filter.position += 2 * w * kStep_s * off;
        filter.speed += w * w * kStep_s * off;
    }

    void send(const Filter& filter, Encoder& encoder) {
        encoder.position_rad = filter.position;
        encoder.time_ns = now_ns() + static_cast<std::int64_t>(
                                         1e9 * (truth_.frame_s + truth_.frame_jitter_s * noise_.uniform()));
    }

    Truth truth_;
    Noise noise_;
    Filter left_, right_;
    std::size_t transport_steps_ = 0;
    std::size_t step_ = 10'000'000;  // time starts at 1000 s: nothing may depend on zero
    std::array<std::array<double, 2>, kQueue> queue_{};
};

}  // namespace bench
