// The firmware's cycle and a simulated robot in virtual time, with the cycle's two calls in the caller's
// hand: to count or to guard what happens inside them and nothing else. tools/sim/simulation.hpp is the same
// for people who want to drive.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "drivers/drive_catalogue.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/task/black_box.hpp"
#include "firmware/task/cycle.hpp"
#include "hal/can_bus.hpp"
#include "sim_hal/in_process_bus.hpp"
#include "sim_hal/sim_line.hpp"
#include "sim_hal/virtual_clock.hpp"
#include "sim_hal/world.hpp"
#include "tools/sim/simulation.hpp"

namespace wheelwright::tools {

// A bus that stands between the cycle and the real one.
class FrontBus : public hal::CanBus {
  public:
    void connect(hal::CanBus& behind) { behind_ = &behind; }
    hal::CanStatus send(const hal::CanFrame& frame) override { return behind_->send(frame); }
    bool waits(std::uint32_t id) const override { return behind_->waits(id); }
    hal::CanStatus receive(hal::ReceivedFrame& out) override { return behind_->receive(out); }
    bool set_filters(std::span<const hal::CanFilter> filters) override {
        return behind_->set_filters(filters);
    }
    hal::CanStatistics statistics() const override { return behind_->statistics(); }

  private:
    hal::CanBus* behind_ = nullptr;
};

struct RigOptions {
    std::uint64_t seed = 1;
    sim::WorldOptions world;
    bool separate_host_bus = false;
    bool digital_lines = false;  // the emergency-stop input and the drive-enable output
    task::ArmingKey arming_key = {};
    bool black_box = false;     // records into CycleRig::box(), which nobody writes
    FrontBus* front = nullptr;  // for the drives' bus; null: none. Outlives the rig.
};

class CycleRig {
  public:
    CycleRig(const model::RobotParameters& controller, const model::RobotParameters& truth,
             const RigOptions& options = {});
    CycleRig(const CycleRig&) = delete;
    CycleRig& operator=(const CycleRig&) = delete;

    // One millisecond. `cycle_part` is called twice, each time with the function that it shall call.
    template <typename CyclePart>
    void step(CyclePart&& cycle_part) {
        wake();
        cycle_part([&] { think(); });
        wait_for_sending();
        cycle_part([&] { send(); });
    }
    void step() {
        step([](auto&& part) { part(); });
    }

    // The parts of step(), in their order: the robot lives up to the cycle, the firmware thinks, the robot
    // lives up to the sending phase, the firmware sends.
    void wake();
    void think() {
        if (box_ != nullptr) box_->begin(time_);
        cycle_->think(time_);
    }
    void wait_for_sending() { clock_.sleep_until_ns(time_.scheduled_ns + cycle_->send_phase_ns()); }
    void send() {
        if (box_ != nullptr) box_->sending(clock_.now_ns());
        cycle_->send(clock_.now_ns());
        if (box_ != nullptr) box_->end();
    }

    // The next cycle begins late by so many periods.
    void miss(std::int64_t cycles) { late_cycles_ = cycles; }

    task::Cycle& cycle() { return *cycle_; }
    task::BlackBox& box() { return *box_; }
    SimulatedHost& host() { return *host_; }
    sim::World& world() { return world_; }
    sim::InProcessBus& bus() { return bus_; }
    sim::SimInput& stop_line() { return stop_line_; }
    sim::SimOutput& enable_line() { return enable_line_; }
    task::SaveMailbox& mailbox() { return mailbox_; }
    hal::CanBus& host_bus() { return second_ == nullptr ? bus_.endpoint(kHost) : second_->endpoint(1); }
    model::RobotParameters& parameters() { return parameters_; }  // the live ones
    const task::CycleTime& time() const { return time_; }

    static constexpr std::size_t kFirmware = 0;
    static constexpr std::size_t kRobot = 1;
    static constexpr std::size_t kHost = 2;

  private:
    model::RobotParameters parameters_;
    sim::VirtualClock clock_;
    sim::InProcessBus bus_;
    std::unique_ptr<sim::InProcessBus> second_;
    sim::World world_;
    sim::VirtualRobot robot_;
    std::unique_ptr<SimulatedHost> host_;
    sim::SimInput stop_line_;
    sim::SimOutput enable_line_;
    drivers::DriveSlot left_;
    drivers::DriveSlot right_;
    task::SaveMailbox mailbox_;
    std::unique_ptr<task::BlackBox> box_;
    std::unique_ptr<task::Cycle> cycle_;
    task::CycleSchedule schedule_;
    task::CycleTime time_;
    std::int64_t late_cycles_ = 0;
};

// The example controller and the robot it is to drive, from tools/robots. `identified`: as the ident mode
// would leave it, so that every mode is allowed.
struct ExampleRobots {
    model::RobotParameters controller;
    model::RobotParameters truth;
    sim::WorldOptions world;
};
ExampleRobots example_robots(bool identified);

}  // namespace wheelwright::tools
