// The first step of a cycle: what the drives and an outside sensor have told becomes the robot's motion.
//
// Threads: the cycle's. No call allocates, blocks or throws.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "drivers/motor_drive.hpp"
#include "firmware/control/encoder_loop.hpp"
#include "firmware/control/encoder_speed.hpp"
#include "firmware/control/odometry.hpp"
#include "firmware/control/wheel_observer.hpp"
#include "firmware/ident/regression_filter.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/task/slip_watch.hpp"

namespace wheelwright::task {

// What has been told until a cycle's instant.
struct Told {
    std::int64_t now_ns = 0;
    Real elapsed_s = 0;    // since the cycle before
    bool in_a_row = true;  // no cycle was missed
    const drivers::DriveFeedback& left;
    const drivers::DriveFeedback& right;
    const Pose<Real>* external_pose = nullptr;  // that came in this cycle
    WheelPair<Real> sent_torque_Nm;             // in the cycle before
};

// The robot's motion at a cycle's instant, as all laws, estimators and watchers take it.
struct Observed {
    std::int64_t now_ns = 0;
    Real elapsed_s = 0;
    model::Motion<Real> motion;
    Pose<Real> pose;
    WheelPair<Real> last_torque_Nm;
    // For the estimators: the wheels' angles some cycles ago, by the encoders alone.
    ident::IdentSample<Real> sample;
    bool angles_known = false;
    bool two_scales = false;  // a drive's positions and speeds are not of one motion
    const std::array<control::EncoderAngle, 2>* encoder = nullptr;  // the newest
    std::array<std::int64_t, 2> encoder_taken_ns{};  // receive times of the newest samples that were believed
    const control::EncoderSpeed* encoder_speed = nullptr;  // that is of this cycle
    bool slipping = false;
    const Pose<Real>* external_pose = nullptr;
};

inline control::EncoderSample encoder_sample(const drivers::DriveFeedback& f) {
    return {f.position_rad, f.speed_rad_per_s, f.encoder_time_ns};
}

class Senses {
  public:
    void configure(const model::RobotParameters& parameters, double encoder_loop_period_s);
    // 1 / b of the drives' encoder loops (encoder_loop.hpp); configure() takes them from the parameters.
    void set_encoder_lag(const WheelPair<double>& lag_s);
    // Once in each cycle, before torque_sent().
    Observed observe(const Told& told, const control::PlantModel<Real>& plant);
    // Where a cycle has time for it: each wheel's positions beside its speeds. Some 20 instructions, 150 each
    // 5 ms.
    void look(const drivers::DriveFeedback& left, const drivers::DriveFeedback& right);
    void torque_sent(const WheelPair<Real>& torque_Nm) { observer_.torque_sent(torque_Nm); }

    bool slipping(std::int64_t now_ns) const { return slip_.slipping(now_ns); }
    const control::WheelObserver<Real>& observer() const { return observer_; }
    const control::Odometry<Real>& odometry() const { return odometry_; }

    // How long before the cycle's instant the angles of a sample were: the estimators count it as delay. As
    // old as the last report but one may be, and those before a drive's loop are half a period older.
    static double sample_age_s(const model::RobotParameters& parameters) {
        const int period_ms = parameters.drive.encoder_period_ms;
        return 1e-3 * (period_ms + std::max(1.0, 0.5 * period_ms + 0.5));
    }

  private:
    std::array<control::EncoderBehindLoop, 2> loop_;
    std::array<control::EncoderScale, 2> scale_;
    std::array<control::EncoderAngle, 2> encoder_;
    double encoder_loop_period_s_ = 0, encoder_period_s_ = 0, encoder_count_rad_ = 0;
    control::WheelObserver<Real> observer_;
    control::EncoderSpeed encoder_speed_;
    control::Odometry<Real> odometry_;
    SlipWatch slip_;
    double slip_limit_rad_per_s_ = 0;
    std::int64_t sample_age_ns_ = 0;
    WheelPair<double> sampled_rad_;  // as last known
};

}  // namespace wheelwright::task
