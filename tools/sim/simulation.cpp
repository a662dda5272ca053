#include "tools/sim/simulation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "firmware/protocol/command_guard.hpp"
#include "firmware/supervisor/modes.hpp"
#include "firmware/task/build_identity.hpp"
#include "hal/linux/monotonic_clock.hpp"
#include "hal/linux/socketcan_bus.hpp"
#include "tools/logs/candump.hpp"

namespace wheelwright::tools {
namespace {

constexpr std::size_t kFirmware = 0;
constexpr std::size_t kRobot = 1;
constexpr std::size_t kHost = 2;
constexpr std::size_t kForeign = 3;
constexpr std::size_t kFirmwareQueue = 7;  // as SocketCanBus has it

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
    if (Message::id != protocol::ExternalPose::id) spoke_ns_ = now_ns_;
    if (protocol::encode_sealed(message, alive_, frame.data) != protocol::CodecStatus::ok ||
        bus_.send(frame) != hal::CanStatus::ok) {
        ++refused_;
    }
}

void SimulatedHost::mode(protocol::Mode mode) {
    protocol::ModeCommand command;
    command.mode = mode;
    send(command);
    watches_ = supervisor::drives(mode);
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

void SimulatedHost::vanish() {
    silence();
    external_poses_ = false;
    watches_ = false;
}

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
    constexpr std::int64_t kAlive_ns = std::int64_t{protocol::HostAlive::cycle_time_ms} * 1'000'000;
    if (watches_ && now_ns - spoke_ns_ >= kAlive_ns) send(protocol::HostAlive{});
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

// ---- machines -------------------------------------------------------------------------------------------

class Simulation::VirtualMachine final : public Machine {
  public:
    VirtualMachine(const model::RobotParameters& parameters, const SimulationOptions& options)
        : clock_(options.start_ns),
          bus_(clock_, 4, bus_options(parameters.bus.bit_rate_bit_per_s, options.seed)) {
        if (options.separate_host_bus) {
            second_ = std::make_unique<sim::InProcessBus>(
                clock_, 2, bus_options(parameters.bus.host_bit_rate_bit_per_s, options.seed + 1));
        }
        bus_.limit_transmit_queue(kFirmware, kFirmwareQueue);
        bus_.endpoint(kForeign).set_filters({});
        host_bus().set_filters({});  // the simulated host listens to nobody; taps see all
    }
    ~VirtualMachine() override { catch_up(); }

    hal::Clock& clock() override { return clock_; }
    hal::CanBus& firmware_bus() override { return bus_.endpoint(kFirmware); }
    hal::CanBus* firmware_host_bus() override { return second_ == nullptr ? nullptr : &second_->endpoint(0); }
    hal::CanBus& robot_bus() override { return bus_.endpoint(kRobot); }
    hal::CanBus& host_bus() override {
        return second_ == nullptr ? bus_.endpoint(kHost) : second_->endpoint(1);
    }
    void attach(sim::World& world) override {
        robot_ = std::make_unique<sim::VirtualRobot>(clock_, bus_, bus_.endpoint(kRobot), world,
                                                     sim::VirtualRobot::Body::at_last_event);
    }
    void log_to(Log& log);
    void catch_up() {
        bus_.catch_up();
        if (second_ != nullptr) second_->catch_up();
    }
    sim::InProcessBus& bus() { return bus_; }

  private:
    sim::VirtualClock clock_;
    sim::InProcessBus bus_;
    std::unique_ptr<sim::InProcessBus> second_;
    std::unique_ptr<sim::VirtualRobot> robot_;
};

void Simulation::VirtualMachine::log_to(Log& log) {
    bus_.add_tap(log.tap(0));
    if (second_ != nullptr) second_->add_tap(log.tap(1));
}

// Three sockets on one real interface. The robot lives in the time in which the firmware sleeps.
class Simulation::RealMachine final : public Machine, private hal::Clock {
  public:
    RealMachine(const std::string& interface, std::int64_t rest_ns)
        : rest_ns_(rest_ns), firmware_(open(interface)), robot_(open(interface)), host_(open(interface)) {
        host_->set_filters({});
    }

    hal::Clock& clock() override { return *this; }
    hal::CanBus& firmware_bus() override { return *firmware_; }
    hal::CanBus* firmware_host_bus() override { return nullptr; }
    hal::CanBus& robot_bus() override { return *robot_; }
    hal::CanBus& host_bus() override { return *host_; }
    void attach(sim::World& world) override { world_ = &world; }

  private:
    static std::unique_ptr<hal::SocketCanBus> open(const std::string& interface) {
        auto opened = hal::SocketCanBus::open(interface);
        if (!opened) throw std::runtime_error(opened.error().message);
        return std::move(opened.value());
    }

    std::int64_t now_ns() const override { return clock_.now_ns(); }
    void sleep_until_ns(std::int64_t deadline_ns) override {
        while (world_ != nullptr) {
            const std::int64_t look_ns = std::max(world_->next_event_ns(), looked_ns_ + rest_ns_);
            clock_.sleep_until_ns(std::min(deadline_ns, look_ns));
            const std::int64_t now = clock_.now_ns();
            if (now >= look_ns) {
                world_->pump(now);
                looked_ns_ = now;
            }
            if (now >= deadline_ns) return;
        }
        clock_.sleep_until_ns(deadline_ns);
    }

    std::int64_t rest_ns_;
    hal::MonotonicClock clock_;
    std::unique_ptr<hal::SocketCanBus> firmware_;
    std::unique_ptr<hal::SocketCanBus> robot_;
    std::unique_ptr<hal::SocketCanBus> host_;
    sim::World* world_ = nullptr;
    std::int64_t looked_ns_ = 0;  // at the robot's bus
};

// ---- simulation -----------------------------------------------------------------------------------------

Simulation::Simulation(const model::RobotParameters& controller, const model::RobotParameters& truth,
                       const SimulationOptions& options)
    : parameters_(controller), start_ns_(0), schedule_(0) {
    if (options.can_interface.empty()) {
        auto machine = std::make_unique<VirtualMachine>(controller, options);
        virtual_ = machine.get();
        machine_ = std::move(machine);
    } else {
        machine_ = std::make_unique<RealMachine>(options.can_interface, options.rest_ns);
    }
    start_ns_ = machine_->clock().now_ns();
    cycle_ns_ = start_ns_;
    sim::WorldOptions world = options.world;
    world.seed = options.seed;
    world.start_ns = start_ns_;
    if (virtual_ == nullptr) world.latest_ns += options.rest_ns;
    hal::CanBus* firmware_bus = &machine_->firmware_bus();
    hal::CanBus* robot_bus = &machine_->robot_bus();
    hal::CanBus* host_bus = machine_->firmware_host_bus();
    const auto make_faulty = [&](Node node, hal::CanBus*& bus) {
        if (!options.faulty_buses || bus == nullptr) return;
        faulty_[std::size_t(node)] = std::make_unique<sim::FaultyBus>(*bus);
        bus = faulty_[std::size_t(node)].get();
    };
    make_faulty(Node::firmware, firmware_bus);
    make_faulty(Node::robot, robot_bus);
    make_faulty(Node::host, host_bus);
    world_ = std::make_unique<sim::World>(truth, world, *robot_bus);
    machine_->attach(*world_);
    host_ = std::make_unique<SimulatedHost>(machine_->host_bus(), *world_);
    stop_line_ = std::make_unique<sim::SimInput>(machine_->clock());
    enable_line_ = std::make_unique<sim::SimOutput>(machine_->clock());
    const task::CyclePorts ports{*firmware_bus,
                                 host_bus,
                                 *drivers::make_drive(left_, parameters_, drivers::Wheel::left),
                                 *drivers::make_drive(right_, parameters_, drivers::Wheel::right),
                                 options.emergency_stop_line ? stop_line_.get() : nullptr,
                                 options.drive_enable_line ? enable_line_.get() : nullptr,
                                 options.arming_key};
    if (options.black_box.empty()) {
        cycle_ = std::make_unique<task::Cycle>(parameters_, mailbox_, ports);
    } else {
        record_to(options, ports);
    }
    // In real time the lines above take some: cycles are due from now on.
    schedule_ = task::CycleSchedule(machine_->clock().now_ns() + task::kCyclePeriod_ns);
    if (!options.log_path.empty() && virtual_ != nullptr) {
        log_ = std::make_unique<Log>(options.log_path);
        virtual_->log_to(*log_);
    }
}

void Simulation::record_to(const SimulationOptions& options, const task::CyclePorts& ports) {
    if (const std::string problem = task::BlackBoxWriter::prepare(options.black_box); !problem.empty()) {
        throw std::runtime_error(problem + "\n");
    }
    box_ = std::make_unique<task::BlackBox>(ports, mailbox_);
    cycle_ = std::make_unique<task::Cycle>(parameters_, mailbox_, box_->ports());
    box_->watch(*cycle_);
    task::BoxAbout about;
    about.build = task::build_identity();
    about.interface = {"can0", ports.host_bus == nullptr ? "" : "can1"};
    about.stop_line = ports.emergency_stop != nullptr;
    about.enable_line = ports.drive_enable != nullptr;
    about.drive_generation = parameters_.drive.generation;
    about.robot_file = options.robot_file;
    box_writer_ = std::make_unique<task::BlackBoxWriter>(
        *box_, options.black_box, about, [this](const std::string& said) { black_boxes_.push_back(said); });
}

void Simulation::end_recording() {
    if (box_writer_ != nullptr) box_writer_->finish();
}

Simulation::~Simulation() {
    end_recording();
    if (virtual_ != nullptr) virtual_->catch_up();  // the log outlives the last frame
    machine_.reset();
}

sim::InProcessBus& Simulation::bus() { return virtual_->bus(); }

void Simulation::step() {
    if (end_s_ > 0 && time_s() >= end_s_) throw TimeIsOver{};
    hal::Clock& clock = machine_->clock();
    clock.sleep_until_ns(schedule_.next_deadline_ns());
    const std::int64_t now_ns = clock.now_ns();
    host_->step(now_ns);
    const task::CycleTime time = schedule_.begin(now_ns);
    cycle_ns_ = time.scheduled_ns;
    missed_cycles_ += time.missed;
    if (box_ != nullptr) box_->begin(time);
    cycle_->think(time);
    clock.sleep_until_ns(time.scheduled_ns + cycle_->send_phase_ns());
    if (box_ != nullptr) box_->sending(clock.now_ns());
    cycle_->send(clock.now_ns());
    if (box_ != nullptr) {
        box_->end();
        box_writer_->step();
    }
    schedule_.end(0);
    if (virtual_ != nullptr) world_->advance_to(clock.now_ns());  // for the judge
}

void Simulation::stall(double duration_s) {
    hal::Clock& clock = machine_->clock();
    const std::int64_t end_ns = clock.now_ns() + std::llround(duration_s * 1e9);
    while (clock.now_ns() < end_ns) {
        clock.sleep_until_ns(std::min(end_ns, clock.now_ns() + task::kCyclePeriod_ns));
        host_->step(clock.now_ns());
    }
    if (virtual_ != nullptr) world_->advance_to(clock.now_ns());
}

sim::FaultyBus& Simulation::faulty_bus(Node node) {
    const bool shared = node == Node::host && faulty_[std::size_t(node)] == nullptr;
    return *faulty_[std::size_t(shared ? Node::firmware : node)];
}

void Simulation::run_for(double duration_s, const std::function<void()>& each) {
    run_until([] { return false; }, duration_s, each);
}

bool Simulation::run_until(const std::function<bool()>& done, double at_most_s,
                           const std::function<void()>& each) {
    const std::int64_t end_ns =
        schedule_.next_deadline_ns() + std::llround(at_most_s / task::kCyclePeriod_s) * task::kCyclePeriod_ns;
    while (schedule_.next_deadline_ns() < end_ns) {
        step();
        if (each) each();
        if (done()) return true;
    }
    return false;
}

double Simulation::time_s() const { return 1e-9 * static_cast<double>(now_ns() - start_ns_); }

bool Simulation::log_failed() const { return log_ != nullptr && log_->failed(); }

}  // namespace wheelwright::tools
