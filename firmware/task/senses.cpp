#include "firmware/task/senses.hpp"

#include "firmware/task/cycle_schedule.hpp"

namespace wheelwright::task {

void Senses::configure(const model::RobotParameters& parameters, double encoder_loop_period_s) {
    observer_.configure(control::wheel_observer_settings<Real>(parameters, Real(kCyclePeriod_s)));
    odometry_.configure(control::odometry_settings<Real>(parameters));
    slip_limit_rad_per_s_ = SlipWatch::limit_rad_per_s(parameters);
    sample_age_ns_ = static_cast<std::int64_t>(sample_age_s(parameters) * 1e9);
    encoder_loop_period_s_ = encoder_loop_period_s;
    encoder_period_s_ = 1e-3 * parameters.drive.encoder_period_ms;
    encoder_count_rad_ = kStepPerNoise * parameters.velocity_loop.angle_noise_rad;
    set_encoder_lag({parameters.drive.left.encoder_lag_s, parameters.drive.right.encoder_lag_s});
}

void Senses::set_encoder_lag(const WheelPair<double>& lag_s) {
    const std::array<double, 2> lags_s{lag_s.left, lag_s.right};
    for (std::size_t i = 0; i < loop_.size(); ++i) {
        const bool before = loop_[i].undone();
        loop_[i].configure(lags_s[i], encoder_loop_period_s_, encoder_period_s_, encoder_count_rad_);
        scale_[i].configure(lags_s[i], encoder_period_s_);
        if (loop_[i].undone() != before) observer_.begin_new_clock();
    }
}

void Senses::look(const drivers::DriveFeedback& left, const drivers::DriveFeedback& right) {
    const bool ended = scale_[0].take(encoder_sample(left));
    scale_[1].take(encoder_sample(right), !ended);
}

Observed Senses::observe(const Told& told, const control::PlantModel<Real>& plant) {
    const auto angle = [this](std::size_t i, const drivers::DriveFeedback& f) {
        const control::EncoderSample sample = loop_[i].sample(encoder_sample(f));
        encoder_[i] = {f.position_rad, sample.position_rad, loop_[i].unsure_rad(), sample.time_ns};
        return sample;
    };
    observer_.update(told.now_ns, angle(0, told.left), angle(1, told.right), plant);
    odometry_.advance(plant.geometry, observer_.turned_rad(), told.now_ns);
    if (told.external_pose != nullptr) {
        odometry_.fuse(*told.external_pose);
        slip_.compare(told.external_pose->heading_rad, odometry_.bare_pose().heading_rad, told.now_ns,
                      slip_limit_rad_per_s_);
    }
    observer_.set_heading(odometry_.pose().heading_rad);

    Observed seen;
    seen.now_ns = told.now_ns;
    seen.elapsed_s = told.elapsed_s;
    seen.motion = observer_.motion();
    seen.pose = odometry_.pose();
    seen.last_torque_Nm = seen.sample.last_torque_Nm = told.sent_torque_Nm;
    seen.angles_known = observer_.angles_at(told.now_ns - sample_age_ns_, sampled_rad_) && told.in_a_row;
    seen.sample.angle_rad = sampled_rad_;
    seen.encoder = &encoder_;
    seen.two_scales = scale_[0].differs() || scale_[1].differs();
    seen.encoder_taken_ns = observer_.taken_ns();
    if (encoder_speed_.step()) {
        encoder_speed_.look(observer_.taken_rad(), seen.encoder_taken_ns);
        seen.encoder_speed = &encoder_speed_;
    }
    seen.slipping = slip_.slipping(told.now_ns);
    seen.sample.usable = seen.angles_known && !seen.slipping;
    seen.sample.heading_rad = seen.pose.heading_rad;
    seen.external_pose = told.external_pose;
    return seen;
}

}  // namespace wheelwright::task
