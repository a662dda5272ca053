// The whole simulated robot: body, two drives, and an external pose sensor, as a discrete-event world. The
// body moves from event to event, so a frame acts at its own time and a drive reports the motion at its own
// phase.
//
// It plays on a bus and keeps no clock: `pump(now)` takes the frames that have arrived and runs up to now.
// - Virtual time: VirtualRobot (below) runs it from a VirtualClock, event by event.
// - Real time: sleep until next_event_ns(), pump, repeat; on vcan0 a process then is the robot.
//
// The judge reads the truth from it: pose, speeds, torques. Same options, same frames, same bytes.
// Threads: one. After the constructor nothing allocates, blocks or throws.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/model/robot_parameters.hpp"
#include "hal/can_bus.hpp"
#include "sim_hal/in_process_bus.hpp"
#include "sim_hal/plant.hpp"
#include "sim_hal/random.hpp"
#include "sim_hal/sim_odrive.hpp"
#include "sim_hal/virtual_clock.hpp"

namespace wheelwright::sim {

// What the truth's robot file does not say.
struct WorldOptions {
    std::uint64_t seed = 1;
    std::int64_t start_ns = 0;
    Pose<double> start_pose;
    double encoder_counts_per_turn = 8192;  // on the motor shaft; 0: an ideal encoder
    double encoder_noise_rad = 0.0002;      // at the wheel
    double filter_bandwidth_rad_per_s = 1000;
    double torque_lag_s = 0.0005;
    double torque_noise_Nm = 0.02;  // at the wheel
    double torque_ripple_Nm = 0;
    double current_limit_A = 20;
    double command_latency_s = 0.0002;  // inside the drive, from frame to effect
    double arming_time_s = 0.003;
    bool watchdog_enabled = true;
    bool one_board = true;                               // 0.5: clearing errors clears both axes
    std::array<double, 2> clock_error_ppm{17.3, -31.9};  // left, right
    // First milliseconds of the drives after the start; negative: from the seed.
    std::array<std::int64_t, 2> phase_ns{-1, -1};
    double external_pose_rate_Hz = 20;  // 0: none
    double external_pose_noise_m = 0.002;
    double external_heading_noise_rad = 0.004;
    double external_pose_delay_s = 0;
    // In real time: a frame that would leave later than this is dropped, as its time would be wrong.
    std::int64_t latest_ns = 500'000;
};

struct ExternalPose {
    Pose<double> pose;                // with noise, heading not wrapped
    std::int64_t sample_time_ns = 0;  // when the robot was there
    std::int64_t ready_time_ns = 0;   // when the sensor tells
};

// Monotonic counters.
struct WorldTotals {
    std::uint64_t frames_sent = 0;
    std::uint64_t frames_lost = 0;  // refused by the bus, or too late to be worth sending
    std::uint64_t poses_lost = 0;   // nobody took them
    std::uint64_t plant_steps = 0;
};

class World {
  public:
    // `truth` gives geometry, dynamics, effects, and each drive's node, sign, gear, torque constant and
    // scale, message periods, watchdog time-out and endpoint.
    World(const model::RobotParameters& truth, const WorldOptions& options, hal::CanBus& bus);
    World(const World&) = delete;
    World& operator=(const World&) = delete;

    // Takes the waiting frames in order, each at its timestamp (or now, when that has passed), and runs the
    // world up to `now_ns`. Frames the robot sends leave during the call; those overdue by more than the
    // options say, after a pause of the machine, are dropped.
    void pump(std::int64_t now_ns);

    // The same, but the body stays where the last event was: cheaper when nobody looks at it now.
    void pump_events(std::int64_t now_ns);

    // The same again, without looking at the bus for received frames.
    void run_events(std::int64_t now_ns);

    // Runs up to `now_ns` without looking at the bus for received frames.
    void advance_to(std::int64_t now_ns);

    // When the robot next does something by itself.
    std::int64_t next_event_ns() const;

    // The time of the body's state. After pump_events() and run_events() it may be a while ago: advance_to()
    // brings it up.
    std::int64_t now_ns() const { return now_ns_; }

    // The oldest pose that is ready and not taken yet; false when there is none.
    bool take_external_pose(ExternalPose& out);

    // Truth, at now_ns().
    const Plant& plant() const { return plant_; }
    const Pose<double>& pose() const { return plant_.pose(); }
    const Twist<double>& twist() const { return plant_.twist(); }
    const WorldTotals& totals() const { return totals_; }

    // For changes and faults on purpose, between calls.
    Plant& plant() { return plant_; }
    SimOdrive& left() { return drives_[0]; }
    SimOdrive& right() { return drives_[1]; }
    SimOdrive& drive(std::size_t side) { return drives_[side]; }  // 0 left, 1 right

  private:
    static constexpr std::int64_t kLongestStep_ns = 500'000;

    class Port final : public drivers::FrameSink {
      public:
        Port(hal::CanBus& bus, WorldTotals& totals) : bus_(bus), totals_(totals) {}
        void push(const hal::CanFrame& frame) override;
        bool late = false;

      private:
        hal::CanBus& bus_;
        WorldTotals& totals_;
    };

    void run_events_to(std::int64_t until_ns, std::int64_t now_ns);
    void move_torque_to(std::int64_t until_ns);
    void move_body_to(std::int64_t until_ns);
    void deliver(const hal::CanFrame& frame, std::int64_t time_ns);
    void sample_external_pose();

    WorldOptions options_;
    WorldTotals totals_;
    hal::CanBus& bus_;
    Port port_;
    Plant plant_;
    std::array<SimOdrive, 2> drives_;
    Random random_;
    std::int64_t now_ns_;               // of the body
    std::int64_t torque_ns_;            // of the drives' torques
    std::int64_t reached_ns_;           // all events up to here have happened
    WheelPair<double> impulse_Nm_s_{};  // of the torques between the two
    std::int64_t pose_period_ns_ = 0;
    std::int64_t next_pose_ns_;
    std::array<ExternalPose, 16> poses_{};
    std::size_t pose_first_ = 0;
    std::size_t pose_count_ = 0;
};

// The truth's parameters as one drive of the world has them. side: 0 left, 1 right.
SimOdriveConfig sim_odrive_config(const model::RobotParameters& truth, const WorldOptions& options,
                                  std::size_t side);

// Runs a World in virtual time: while somebody sleeps on the clock, each frame ends on the wire and each
// drive acts at its own moment. The world's endpoint must be one of `bus`; more buses need no stepping.
class VirtualRobot final : public VirtualClock::Sleeper {
  public:
    // Where the body is when a sleeper wakes: at that time, or at the robot's last event, which is cheaper
    // for who calls World::advance_to() before looking.
    enum class Body : std::uint8_t { at_wake_up, at_last_event };

    VirtualRobot(VirtualClock& clock, InProcessBus& bus, InProcessBus::Endpoint& endpoint, World& world,
                 Body body = Body::at_wake_up)
        : clock_(clock), bus_(bus), endpoint_(endpoint), world_(world), body_(body) {
        clock_.set_sleeper(this);
    }
    ~VirtualRobot() override { clock_.set_sleeper(nullptr); }
    VirtualRobot(const VirtualRobot&) = delete;
    VirtualRobot& operator=(const VirtualRobot&) = delete;

    void run_until(std::int64_t deadline_ns) override;

  private:
    VirtualClock& clock_;
    InProcessBus& bus_;
    InProcessBus::Endpoint& endpoint_;
    World& world_;
    Body body_;
};

}  // namespace wheelwright::sim
