#include "tools/sim/simulation.hpp"

#include <array>
#include <utility>

#include "firmware/protocol/command_guard.hpp"
#include "firmware/task/realtime_loop.hpp"
#include "tools/logs/candump.hpp"

namespace wheelwright::tools {
namespace {

constexpr std::size_t kFirmware = 0;
constexpr std::size_t kRobot = 1;
constexpr std::size_t kHost = 2;

sim::InProcessBusOptions bus_options(double bit_rate, std::uint64_t seed) {
    sim::InProcessBusOptions options;
    options.bit_rate = static_cast<std::uint32_t>(bit_rate);
    options.seed = seed;
    return options;
}

}  // namespace

sim::WorldOptions world_options(const task::SimulationParameters& from, std::uint64_t seed) {
    sim::WorldOptions to;
    to.seed = seed;
    to.start_pose = from.start;
    to.encoder_counts_per_turn = from.encoder_counts_per_turn;
    to.encoder_noise_rad = from.encoder_noise_rad;
    to.filter_bandwidth_rad_per_s = from.velocity_filter_rad_per_s;
    to.torque_lag_s = from.torque_lag_s;
    to.torque_noise_Nm = from.torque_noise_Nm;
    to.torque_ripple_Nm = from.torque_ripple_Nm;
    to.current_limit_A = from.current_limit_A;
    to.command_latency_s = from.command_latency_s;
    to.external_pose_rate_Hz = from.external_pose_rate_Hz;
    to.external_pose_noise_m = from.external_pose_noise_m;
    to.external_heading_noise_rad = from.external_heading_noise_rad;
    to.external_pose_delay_s = from.external_pose_delay_s;
    return to;
}

// ---- host -----------------------------------------------------------------------------------------------

template <typename Message>
void SimulatedHost::send(const Message& message) {
    hal::CanFrame frame;
    frame.id = Message::id;
    frame.length = Message::length;
    alive_ = protocol::next_alive(alive_);
    if (protocol::encode_sealed(message, alive_, frame.data) != protocol::CodecStatus::ok ||
        bus_.send(frame) != hal::CanStatus::ok) {
        ++refused_;
    }
}

void SimulatedHost::mode(protocol::Mode mode) {
    protocol::ModeCommand command;
    command.mode = mode;
    send(command);
}

void SimulatedHost::clear_fault() { send(protocol::ClearFault{}); }

void SimulatedHost::emergency_stop() {
    hal::CanFrame frame;
    frame.id = protocol::EmergencyStop::id;
    if (bus_.send(frame) != hal::CanStatus::ok) ++refused_;
}

void SimulatedHost::trajectory(const protocol::TrajectoryCommand& command) { send(command); }
void SimulatedHost::ident(const protocol::IdentSettings& settings) { send(settings); }

void SimulatedHost::parameter(protocol::ParameterOperation operation, std::uint16_t index, float value) {
    protocol::ParameterRequest request;
    request.operation = operation;
    request.index = index;
    request.value = value;
    send(request);
}

void SimulatedHost::torque(const WheelPair<double>& torque_Nm) {
    torque_.left_torque_Nm = torque_Nm.left;
    torque_.right_torque_Nm = torque_Nm.right;
    repeating_ = Repeating::torque;
    next_ns_ = 0;
}

void SimulatedHost::velocity(const Twist<double>& twist) {
    velocity_.forward_speed_m_per_s = twist.v_m_per_s;
    velocity_.yaw_rate_rad_per_s = twist.omega_rad_per_s;
    repeating_ = Repeating::velocity;
    next_ns_ = 0;
}

void SimulatedHost::goal(const Pose<double>& pose, protocol::PoseDirection direction) {
    goal_.x_m = pose.x_m;
    goal_.y_m = pose.y_m;
    goal_.heading_rad = wrap_angle_rad(pose.heading_rad);
    goal_.direction = direction;
    repeating_ = Repeating::goal;
    next_ns_ = 0;
}

void SimulatedHost::stream(std::function<std::pair<Pose<double>, Twist<double>>(double)> reference) {
    stream_ = std::move(reference);
    stream_start_ns_ = now_ns_;
    repeating_ = Repeating::stream;
    next_ns_ = 0;
}

void SimulatedHost::silence() { repeating_ = Repeating::nothing; }

void SimulatedHost::external_pose(const Pose<double>& pose) {
    protocol::ExternalPose message;
    message.x_m = pose.x_m;
    message.y_m = pose.y_m;
    message.heading_rad = wrap_angle_rad(pose.heading_rad);
    send(message);
}

void SimulatedHost::send_setpoint(std::int64_t now_ns) {
    std::uint16_t period_ms = 0;
    switch (repeating_) {
        case Repeating::nothing:
            return;
        case Repeating::torque:
            send(torque_);
            period_ms = protocol::TorqueCommand::cycle_time_ms;
            break;
        case Repeating::velocity:
            send(velocity_);
            period_ms = protocol::VelocityCommand::cycle_time_ms;
            break;
        case Repeating::goal:
            send(goal_);
            period_ms = protocol::PoseGoal::cycle_time_ms;
            break;
        case Repeating::stream: {
            const auto [pose, twist] = stream_(1e-9 * static_cast<double>(now_ns - stream_start_ns_));
            protocol::StreamedPose first;
            first.x_m = pose.x_m;
            first.y_m = pose.y_m;
            first.heading_rad = wrap_angle_rad(pose.heading_rad);
            protocol::StreamedVelocity second;
            second.forward_speed_m_per_s = twist.v_m_per_s;
            second.yaw_rate_rad_per_s = twist.omega_rad_per_s;
            const std::uint8_t before = alive_;
            send(first);
            alive_ = before;  // both halves carry the same counter
            send(second);
            period_ms = protocol::StreamedPose::cycle_time_ms;
            break;
        }
    }
    next_ns_ = now_ns + std::int64_t{period_ms} * 1'000'000;
}

void SimulatedHost::step(std::int64_t now_ns) {
    now_ns_ = now_ns;
    if (repeating_ != Repeating::nothing && now_ns >= next_ns_) send_setpoint(now_ns);
    sim::ExternalPose pose;
    while (world_.take_external_pose(pose)) {
        if (external_poses_) external_pose(pose.pose);
    }
}

// ---- log ------------------------------------------------------------------------------------------------

class Simulation::Log {
  public:
    explicit Log(const std::string& path) : file_(std::fopen(path.c_str(), "w")) {
        failed_ = file_ == nullptr;
    }
    ~Log() {
        if (file_ != nullptr) std::fclose(file_);
    }
    Log(const Log&) = delete;
    Log& operator=(const Log&) = delete;

    bool failed() const { return failed_; }
    sim::BusTap& tap(std::size_t bus) { return taps_[bus]; }

  private:
    class Tap final : public sim::BusTap {
      public:
        Tap(Log& log, const char* interface) : log_(log) { entry_.interface = interface; }
        void on_frame(const sim::WireEvent& event) override {
            if (event.dropped || log_.file_ == nullptr) return;
            entry_.time_ns = event.end_ns;
            entry_.frame = *event.frame;
            const std::string line = format_candump_line(entry_) + '\n';
            if (std::fwrite(line.data(), 1, line.size(), log_.file_) != line.size()) log_.failed_ = true;
        }

      private:
        Log& log_;
        LogFrame entry_;
    };

    std::FILE* file_;
    bool failed_ = false;
    std::array<Tap, 2> taps_{Tap{*this, "can0"}, Tap{*this, "can1"}};
};

// ---- simulation -----------------------------------------------------------------------------------------

Simulation::Simulation(const model::RobotParameters& controller, const model::RobotParameters& truth,
                       const SimulationOptions& options)
    : parameters_(controller),
      start_ns_(options.start_ns),
      clock_(options.start_ns),
      bus_(clock_, 3, bus_options(controller.bus.bit_rate_bit_per_s, options.seed)),
      stop_line_(clock_),
      schedule_(options.start_ns + task::kCyclePeriod_ns) {
    sim::WorldOptions world = options.world;
    world.seed = options.seed;
    world.start_ns = options.start_ns;
    world_ = std::make_unique<sim::World>(truth, world, bus_.endpoint(kRobot));
    robot_ = std::make_unique<sim::VirtualRobot>(clock_, bus_, bus_.endpoint(kRobot), *world_);

    hal::CanBus* host_side = &bus_.endpoint(kHost);
    hal::CanBus* firmware_host_side = nullptr;
    if (options.separate_host_bus) {
        host_bus_ = std::make_unique<sim::InProcessBus>(
            clock_, 2, bus_options(controller.bus.host_bit_rate_bit_per_s, options.seed + 1));
        firmware_host_side = &host_bus_->endpoint(0);
        host_side = &host_bus_->endpoint(1);
    }
    host_side->set_filters({});  // the simulated host listens to nobody; taps see all
    host_ = std::make_unique<SimulatedHost>(*host_side, *world_);

    const task::CyclePorts ports{bus_.endpoint(kFirmware),
                                 firmware_host_side,
                                 *drivers::make_drive(left_, parameters_, drivers::Wheel::left),
                                 *drivers::make_drive(right_, parameters_, drivers::Wheel::right),
                                 options.emergency_stop_line ? &stop_line_ : nullptr,
                                 nullptr};
    cycle_ = std::make_unique<task::Cycle>(parameters_, mailbox_, ports);
    if (!options.log_path.empty()) {
        log_ = std::make_unique<Log>(options.log_path);
        bus_.add_tap(log_->tap(0));
        if (host_bus_ != nullptr) host_bus_->add_tap(log_->tap(1));
    }
}

Simulation::~Simulation() {
    bus_.catch_up();
    if (host_bus_ != nullptr) host_bus_->catch_up();
}

void Simulation::step() {
    clock_.sleep_until_ns(schedule_.next_deadline_ns());
    host_->step(clock_.now_ns());
    const task::CycleTime time = schedule_.begin(clock_.now_ns());
    cycle_->think(time);
    clock_.sleep_until_ns(time.scheduled_ns + cycle_->send_phase_ns());
    cycle_->send(clock_.now_ns());
    schedule_.end(0);
}

void Simulation::run_for(double duration_s, const std::function<void()>& each) {
    const auto cycles = static_cast<std::int64_t>(duration_s / task::kCyclePeriod_s + 0.5);
    for (std::int64_t i = 0; i < cycles; ++i) {
        step();
        if (each) each();
    }
}

bool Simulation::run_until(const std::function<bool()>& done, double at_most_s,
                           const std::function<void()>& each) {
    const auto cycles = static_cast<std::int64_t>(at_most_s / task::kCyclePeriod_s + 0.5);
    for (std::int64_t i = 0; i < cycles; ++i) {
        step();
        if (each) each();
        if (done()) return true;
    }
    return false;
}

double Simulation::time_s() const { return 1e-9 * static_cast<double>(clock_.now_ns() - start_ns_); }

bool Simulation::log_failed() const { return log_ != nullptr && log_->failed(); }

}  // namespace wheelwright::tools
