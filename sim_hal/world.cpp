#include "sim_hal/world.hpp"

#include <algorithm>
#include <cmath>
#include <string_view>

namespace wheelwright::sim {

SimOdriveConfig sim_odrive_config(const model::RobotParameters& truth, const WorldOptions& options,
                                  std::size_t side) {
    const model::DriveParameters& drive = side == 0 ? truth.drive.left : truth.drive.right;
    Random random(options.seed, 100 + side);
    SimOdriveConfig c;
    c.generation = truth.drive.generation;
    c.node = drive.node;
    c.sign = drive.sign;
    c.gear_ratio = drive.gear_ratio;
    c.torque_constant_Nm_per_A = drive.torque_constant_Nm_per_A;
    c.torque_scale = drive.torque_scale;
    c.current_limit_A = options.current_limit_A;
    c.torque_lag_s = options.torque_lag_s;
    c.torque_noise_Nm = options.torque_noise_Nm;
    c.torque_ripple_Nm = options.torque_ripple_Nm;
    c.command_latency_s = options.command_latency_s;
    c.counts_per_turn = options.encoder_counts_per_turn;
    c.encoder_noise_rad = options.encoder_noise_rad;
    c.filter_bandwidth_rad_per_s = options.filter_bandwidth_rad_per_s;
    const auto reports = [&truth](std::string_view effect) {
        const std::size_t i = model::find_effect(effect);
        return truth.effects.active[i] ? truth.effects.parameter[i][0] : 0;
    };
    c.report_counts_per_wheel_turn = reports(model::EncoderQuantisation::info.name);
    c.report_lag_s = reports(model::MeasurementLag::info.name);
    c.heartbeat_period_ms = truth.drive.heartbeat_period_ms;
    c.encoder_period_ms = truth.drive.encoder_period_ms;
    c.torque_period_ms = truth.drive.torque_period_ms;
    c.voltage_period_ms = truth.drive.supply_period_ms;
    c.temperature_period_ms = truth.drive.temperature_period_ms;
    c.watchdog_enabled = options.watchdog_enabled;
    c.watchdog_timeout_s = truth.drive.watchdog_timeout_s;
    c.watchdog_endpoint = truth.drive.watchdog_endpoint;
    c.watchdog_timeout_endpoint = truth.drive.watchdog_timeout_endpoint;
    c.control_mode_endpoint = truth.drive.control_mode_endpoint;
    c.input_mode_endpoint = truth.drive.input_mode_endpoint;
    c.arming_time_s = options.arming_time_s;
    c.clock_error_ppm = options.clock_error_ppm[side];
    c.phase_ns = options.phase_ns[side] >= 0 ? options.phase_ns[side]
                                             : static_cast<std::int64_t>(random.bits() % 1'000'000U);
    c.seed = options.seed;
    c.stream = 1 + side;
    return c;
}

World::World(const model::RobotParameters& truth, const WorldOptions& options, hal::CanBus& bus)
    : options_(options),
      bus_(bus),
      port_(bus, totals_),
      plant_(plant_from_dynamics(truth.geometry, truth.dynamics, truth.effects), options.start_pose),
      drives_{SimOdrive(sim_odrive_config(truth, options, 0), options.start_ns),
              SimOdrive(sim_odrive_config(truth, options, 1), options.start_ns)},
      random_(options.seed, 3),
      now_ns_(options.start_ns),
      torque_ns_(options.start_ns),
      reached_ns_(options.start_ns),
      next_pose_ns_(InProcessBus::never_ns) {
    if (options.external_pose_rate_Hz > 0) {
        pose_period_ns_ = std::llround(1e9 / options.external_pose_rate_Hz);
        next_pose_ns_ = options.start_ns + pose_period_ns_;
    }
}

void World::Port::push(const hal::CanFrame& frame) {
    if (!late && bus_.send(frame) == hal::CanStatus::ok) {
        ++totals_.frames_sent;
    } else {
        ++totals_.frames_lost;
    }
}

std::int64_t World::next_event_ns() const {
    return std::min({drives_[0].next_event_ns(), drives_[1].next_event_ns(), next_pose_ns_});
}

// A set-point that takes effect changes the torque and nothing else, so the body need not stop there: it goes
// on in one step with the mean torque. (The speed at the step's end is the same; the angle differs by the
// impulse's lever in time, some 1e-8 rad.)
void World::move_torque_to(std::int64_t until_ns) {
    if (until_ns <= torque_ns_) return;
    const double dt_s = static_cast<double>(until_ns - torque_ns_) * 1e-9;
    const SimOdrive::LagStep lag = SimOdrive::lag_step(dt_s, options_.torque_lag_s);
    impulse_Nm_s_.left += dt_s * drives_[0].advance_torque(lag);
    impulse_Nm_s_.right += dt_s * drives_[1].advance_torque(lag);
    torque_ns_ = until_ns;
}

void World::move_body_to(std::int64_t until_ns) {
    until_ns = std::max(until_ns, torque_ns_);
    while (now_ns_ < until_ns) {
        const std::int64_t step_ns = std::min(until_ns - now_ns_, kLongestStep_ns);
        const double dt_s = static_cast<double>(step_ns) * 1e-9;
        if (torque_ns_ == now_ns_) {  // mostly
            const SimOdrive::LagStep lag = SimOdrive::lag_step(dt_s, options_.torque_lag_s);
            const double left_Nm = drives_[0].advance_torque(lag);
            const double right_Nm = drives_[1].advance_torque(lag);
            plant_.advance(dt_s, {left_Nm, right_Nm});
        } else {
            move_torque_to(now_ns_ + step_ns);
            const double per_s = 1 / dt_s;
            plant_.advance(dt_s, {impulse_Nm_s_.left * per_s, impulse_Nm_s_.right * per_s});
            impulse_Nm_s_ = {};
        }
        now_ns_ += step_ns;
        torque_ns_ = now_ns_;
        ++totals_.plant_steps;
    }
}

// Everything due up to `until_ns`; the body stays at the last event.
void World::run_events_to(std::int64_t until_ns, std::int64_t now_ns) {
    for (;;) {
        const std::int64_t next_ns = next_event_ns();
        if (next_ns > until_ns) break;
        const bool looks = next_pose_ns_ == next_ns || drives_[0].next_look_ns() == next_ns ||
                           drives_[1].next_look_ns() == next_ns;
        if (looks || next_ns - now_ns_ > kLongestStep_ns) {
            move_body_to(next_ns);
        } else {
            move_torque_to(next_ns);
        }
        port_.late = now_ns - next_ns > options_.latest_ns;
        if (drives_[0].next_event_ns() == next_ns) {
            drives_[0].run_event(plant_.wheel_angle_rad().left, plant_.wheel_speed_rad_per_s().left, port_);
        }
        if (drives_[1].next_event_ns() == next_ns) {
            drives_[1].run_event(plant_.wheel_angle_rad().right, plant_.wheel_speed_rad_per_s().right, port_);
        }
        if (next_pose_ns_ == next_ns) sample_external_pose();
    }
    reached_ns_ = std::max(reached_ns_, until_ns);
}

void World::deliver(const hal::CanFrame& frame, std::int64_t time_ns) {
    port_.late = false;
    for (SimOdrive& drive : drives_) drive.receive(frame, time_ns, port_);
    // A 0.5 board has two axes and clears the errors of both.
    if (options_.one_board && drives_[0].config().generation == 5 && !frame.remote && !frame.extended &&
        (frame.id & 0x1FU) == 0x18U) {
        for (const SimOdrive& drive : drives_) {
            if (frame.id >> 5U != static_cast<std::uint32_t>(drive.config().node)) continue;
            for (SimOdrive& each : drives_) each.clear_errors();
        }
    }
}

void World::pump_events(std::int64_t now_ns) {
    hal::ReceivedFrame received;
    while (bus_.receive(received) == hal::CanStatus::ok) {
        if (received.frame.error) continue;
        const std::int64_t time_ns =
            std::clamp(received.timestamp_ns, reached_ns_, std::max(now_ns, reached_ns_));
        run_events_to(time_ns, now_ns);
        deliver(received.frame, time_ns);
    }
    run_events_to(now_ns, now_ns);
}

void World::run_events(std::int64_t now_ns) { run_events_to(now_ns, now_ns); }

void World::pump(std::int64_t now_ns) {
    pump_events(now_ns);
    move_body_to(now_ns);
}

void World::advance_to(std::int64_t now_ns) {
    run_events_to(now_ns, now_ns);
    move_body_to(now_ns);
}

void World::sample_external_pose() {
    if (pose_count_ == poses_.size()) {
        pose_first_ = (pose_first_ + 1) % poses_.size();
        --pose_count_;
        ++totals_.poses_lost;
    }
    ExternalPose& sample = poses_[(pose_first_ + pose_count_++) % poses_.size()];
    sample.pose.x_m = pose().x_m + options_.external_pose_noise_m * random_.gaussian();
    sample.pose.y_m = pose().y_m + options_.external_pose_noise_m * random_.gaussian();
    sample.pose.heading_rad = pose().heading_rad + options_.external_heading_noise_rad * random_.gaussian();
    sample.sample_time_ns = next_pose_ns_;
    sample.ready_time_ns = next_pose_ns_ + std::llround(options_.external_pose_delay_s * 1e9);
    next_pose_ns_ += pose_period_ns_;
}

bool World::take_external_pose(ExternalPose& out) {
    if (pose_count_ == 0 || poses_[pose_first_].ready_time_ns > reached_ns_) return false;
    out = poses_[pose_first_];
    pose_first_ = (pose_first_ + 1) % poses_.size();
    --pose_count_;
    return true;
}

void VirtualRobot::run_until(std::int64_t deadline_ns) {
    world_.pump_events(clock_.now_ns());
    for (;;) {
        const std::int64_t bus_ns = bus_.next_arrival_ns(endpoint_);
        const std::int64_t world_ns = world_.next_event_ns();
        if (std::min(bus_ns, world_ns) > deadline_ns) break;
        if (bus_ns <= world_ns) {
            clock_.advance_to(bus_ns);
            world_.pump_events(bus_ns);
        } else {
            clock_.advance_to(world_ns);
            world_.run_events(world_ns);
        }
    }
    clock_.advance_to(deadline_ns);
    if (body_ == Body::at_wake_up) world_.advance_to(deadline_ns);
}

}  // namespace wheelwright::sim
