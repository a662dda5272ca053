// Firmware and robot in one process and virtual time: the same objects that run on a robot, an in-process CAN
// bus, and a simulated robot with a truth of its own. Between them there are CAN frames only; the judge alone
// sees the truth. The same seed gives the same bytes.
//
//   Simulation sim(controller, truth, options);
//   sim.host().mode(protocol::Mode::velocity);
//   sim.host().velocity({0.3, 0});
//   sim.run_for(2.0);
//   judge(sim.world().pose());
//
// Threads: one. Nothing allocates after the constructor, unless a log or a black box is being written.
#pragma once

#include <array>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/drive_catalogue.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/task/black_box_writer.hpp"
#include "firmware/task/cycle.hpp"
#include "firmware/task/robot_file.hpp"
#include "sim_hal/faulty_bus.hpp"
#include "sim_hal/in_process_bus.hpp"
#include "sim_hal/sim_line.hpp"
#include "sim_hal/virtual_clock.hpp"
#include "sim_hal/world.hpp"

namespace wheelwright::tools {

// The world's options that a truth file's [simulation] speaks of.
sim::WorldOptions world_options(const task::SimulationParameters& from, std::uint64_t seed);

// The host of a simulated robot: sends commands, repeats set-points at their cycle times, hands on external
// poses. From a driving mode asked for on it says that it is there (HostAlive) when it says nothing else.
// Commands take effect at the next cycle of the simulation.
class SimulatedHost {
  public:
    SimulatedHost(hal::CanBus& bus, sim::World& world) : bus_(bus), world_(world) {}

    void mode(protocol::Mode mode);
    void clear_fault();
    void emergency_stop();
    void trajectory(const protocol::TrajectoryCommand& command);
    void ident(const protocol::IdentSettings& settings);
    void parameter(protocol::ParameterOperation operation, std::uint16_t index, float value = 0);

    // Set-points, repeated until another one is given or silence() is called.
    void torque(const WheelPair<double>& torque_Nm);
    void velocity(const Twist<double>& twist);
    void goal(const Pose<double>& pose, protocol::PoseDirection direction);
    // A reference to stream: pose and velocities as a function of the time since now.
    void stream(std::function<std::pair<Pose<double>, Twist<double>>(double time_s)> reference);
    void silence();
    // Sends nothing any more, as a host that has died.
    void vanish();

    // Hands on the world's external poses (on at first).
    void external_poses(bool on) { external_poses_ = on; }
    // Sends one external pose, as a known starting point is told.
    void external_pose(const Pose<double>& pose);

    // Once in each millisecond.
    void step(std::int64_t now_ns);

    std::uint32_t refused() const { return refused_; }

  private:
    enum class Repeating : std::uint8_t { nothing, torque, velocity, goal, stream };
    template <typename Message>
    void send(const Message& message);
    void send_setpoint(std::int64_t now_ns);

    hal::CanBus& bus_;
    sim::World& world_;
    Repeating repeating_ = Repeating::nothing;
    protocol::TorqueCommand torque_;
    protocol::VelocityCommand velocity_;
    protocol::PoseGoal goal_;
    std::function<std::pair<Pose<double>, Twist<double>>(double)> stream_;
    std::int64_t stream_start_ns_ = 0;
    std::int64_t now_ns_ = 0;
    std::int64_t next_ns_ = 0;
    std::int64_t spoke_ns_ = 0;  // other than by poses
    bool watches_ = false;       // has asked for a mode that needs a host and no set-points
    bool external_poses_ = true;
    std::uint8_t alive_ = 0;
    std::uint32_t refused_ = 0;
};

struct SimulationOptions {
    std::uint64_t seed = 1;
    sim::WorldOptions world;  // its seed is replaced
    std::int64_t start_ns = 1'000'000'000;
    bool separate_host_bus = false;
    bool emergency_stop_line = false;
    bool drive_enable_line = false;
    task::ArmingKey arming_key = {};  // none: whoever asks may arm
    bool faulty_buses = false;        // virtual time; for Simulation::faulty_bus()
    std::string can_interface;        // "": virtual time; otherwise real time on this SocketCAN interface
    std::int64_t rest_ns = 50'000;    // in real time: the robot looks at the bus no more often than that
    std::string black_box;            // "": none; otherwise the directory for a file after each fault
    std::string robot_file;           // the controller's text, for the black box
    std::string log_path;             // virtual time; "": no log; otherwise candump -L (a second bus as can1)
};

class Simulation {
  public:
    // Throws std::runtime_error when the interface cannot be opened.
    Simulation(const model::RobotParameters& controller, const model::RobotParameters& truth,
               const SimulationOptions& options);
    ~Simulation();
    Simulation(const Simulation&) = delete;
    Simulation& operator=(const Simulation&) = delete;

    // Runs whole cycles for a time; `each` is called after every cycle.
    void run_for(double duration_s, const std::function<void()>& each = {});
    // Runs until `done` (looked at after each cycle) or until the time is over. True: done.
    bool run_until(const std::function<bool()>& done, double at_most_s,
                   const std::function<void()>& each = {});
    void step();
    // The firmware does not run for a while, and everybody else does: the next cycle begins so late.
    void stall(double duration_s);

    // From then on step() throws TimeIsOver.
    struct TimeIsOver {};
    void end_at(double time_s) { end_s_ = time_s; }

    double time_s() const;  // since the start
    // When the last cycle was due, since the start.
    double cycle_time_s() const { return 1e-9 * static_cast<double>(cycle_ns_ - start_ns_); }
    std::int64_t cycle_ns() const { return cycle_ns_; }  // the same, by the clock
    // Cycles that a real machine was too late for; they count as time.
    std::int64_t missed_cycles() const { return missed_cycles_; }
    std::int64_t now_ns() const { return machine_->clock().now_ns(); }

    task::Cycle& cycle() { return *cycle_; }
    const task::Cycle& cycle() const { return *cycle_; }
    model::RobotParameters& parameters() { return parameters_; }
    sim::World& world() { return *world_; }
    SimulatedHost& host() { return *host_; }
    // The drives' bus; virtual time only. Endpoint 0 is the firmware, 1 the robot, 2 the host where it shares
    // the bus, 3 a node that belongs to nobody.
    sim::InProcessBus& bus();
    // Between a node and its endpoint; of options.faulty_buses. `host`: the firmware's end of its host bus,
    // where it has one of its own, else the same as `firmware`.
    enum class Node : std::uint8_t { firmware, robot, host };
    sim::FaultyBus& faulty_bus(Node node);
    hal::CanBus& host_bus() { return machine_->host_bus(); }  // for frames that SimulatedHost would not send
    sim::SimInput& emergency_stop() { return *stop_line_; }
    sim::SimOutput& drive_enable() { return *enable_line_; }
    task::SaveMailbox& mailbox() { return mailbox_; }
    bool log_failed() const;
    // One sentence for each black box that was written, or not.
    const std::vector<std::string>& black_boxes() const { return black_boxes_; }
    // Writes a black box that still waits for what follows its fault; the destructor does too.
    void end_recording();

  private:
    class Log;
    void record_to(const SimulationOptions& options, const task::CyclePorts& ports);
    // What firmware, robot and host meet on: clock and buses.
    class Machine {
      public:
        virtual ~Machine() = default;
        virtual hal::Clock& clock() = 0;
        virtual hal::CanBus& firmware_bus() = 0;
        virtual hal::CanBus* firmware_host_bus() = 0;  // null: shared
        virtual hal::CanBus& robot_bus() = 0;
        virtual hal::CanBus& host_bus() = 0;
        virtual void attach(
            sim::World& world) = 0;  // the world then lives while somebody sleeps on the clock
    };
    class VirtualMachine;
    class RealMachine;

    model::RobotParameters parameters_;
    VirtualMachine* virtual_ = nullptr;  // machine_, where it is that one
    std::unique_ptr<Machine> machine_;
    std::array<std::unique_ptr<sim::FaultyBus>, 3> faulty_;  // by Node
    std::int64_t start_ns_;
    std::unique_ptr<sim::World> world_;
    drivers::DriveSlot left_;
    drivers::DriveSlot right_;
    std::unique_ptr<sim::SimInput> stop_line_;
    std::unique_ptr<sim::SimOutput> enable_line_;
    task::SaveMailbox mailbox_;
    std::unique_ptr<task::BlackBox> box_;
    std::unique_ptr<task::Cycle> cycle_;
    std::unique_ptr<task::BlackBoxWriter> box_writer_;
    std::unique_ptr<SimulatedHost> host_;
    task::CycleSchedule schedule_;
    std::int64_t cycle_ns_ = 0;
    std::int64_t missed_cycles_ = 0;
    double end_s_ = 0;  // 0: never
    std::unique_ptr<Log> log_;
    std::vector<std::string> black_boxes_;
};

}  // namespace wheelwright::tools
