// One robot that drives, and the means to do it harm. Everything random comes from the scene's seed: the same
// seed gives the same bytes.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "firmware/protocol/command_guard.hpp"
#include "sim_hal/random.hpp"
#include "tools/sim/simulation.hpp"

namespace wheelwright::tools {

enum class TorturedRobots : std::uint8_t { both, standard, drawn };

// What a seed stands for. Mode, layout of the buses, generation and robot take turns, so that forty seeds in
// a row meet each combination once; the rest is drawn.
struct SceneSetup {
    std::uint64_t seed = 1;
    protocol::Mode mode = protocol::Mode::velocity;
    bool separate_host_bus = false;
    bool drawn_robot = false;
    std::size_t side = 0;  // 0 left, 1 right
    double way = 1;        // 1 or -1
    model::RobotParameters believed, truth;
    task::SimulationParameters simulation;
    // The bound for a lying encoder: a lie shows in what is reported after it, in twenty reports at most.
    double believed_lie_s() const { return std::max(0.1, 20e-3 * believed.drive.encoder_period_ms); }
    std::string text() const;  // "velocity, host bus, 0.5, drawn, left"
};
// `report_period_ms`: of the drives' encoder frames, 1 to 10.
SceneSetup scene_setup(std::uint64_t seed, TorturedRobots robots, int report_period_ms = 1);

// What a scene writes; "": nothing.
struct SceneRecords {
    std::string log;        // a file: the frames as candump -L writes them
    std::string black_box;  // a directory
};

class Scene {
  public:
    explicit Scene(const SceneSetup& setup, const SceneRecords& records = {});

    // Puts the robot on its way in the setup's mode. False: the mode was not entered, `problem` says why.
    bool drive_off();
    std::string problem;

    // ---- for those who do harm
    Simulation& sim() { return sim_; }
    const SceneSetup& setup() const { return setup_; }
    sim::Random& random() { return random_; }
    double uniform(double low, double high) { return low + (high - low) * random_.uniform(); }
    sim::SimOdrive& drive() { return sim_.world().drive(setup_.side); }
    sim::FaultyBus& firmware_bus() { return sim_.faulty_bus(Simulation::Node::firmware); }
    sim::FaultyBus& robot_bus() { return sim_.faulty_bus(Simulation::Node::robot); }
    sim::FaultyBus& host_bus() { return sim_.faulty_bus(Simulation::Node::host); }
    std::uint32_t node(std::size_t side) const {
        const auto& drive = setup_.truth.drive;
        return static_cast<std::uint32_t>(side == 0 ? drive.left.node : drive.right.node);
    }
    std::uint32_t id(std::size_t side, std::uint32_t command) const { return node(side) << 5U | command; }
    bool from_drive(const hal::CanFrame& frame, std::uint32_t command) const {
        return !frame.error && !frame.remote && !frame.extended && frame.id == id(setup_.side, command);
    }

    // A frame on the drives' bus that neither firmware, drive nor host sends.
    void foreign(const hal::CanFrame& frame) { sim_.bus().endpoint(3).send(frame); }
    hal::CanFrame to_drive(std::size_t side, std::uint32_t command, std::uint32_t first,
                           std::uint32_t second = 0, std::uint8_t length = 8) const;
    // A command of a second host, with a good checksum and counter.
    template <typename Message>
    void second_host(const Message& message) {
        hal::CanFrame frame;
        frame.id = Message::id;
        frame.length = Message::length;
        alive_ = protocol::next_alive(alive_);
        if (protocol::encode_sealed(message, alive_, frame.data) == protocol::CodecStatus::ok)
            sim_.host_bus().send(frame);
    }

    // The moment from which a bound counts, where that is not the injection: when the firmware is told.
    void tell() {
        if (!told_s_) told_s_ = since_s();
    }
    void forget_told() { told_s_.reset(); }
    std::optional<double> told_s() const { return told_s_; }
    void tell_at(std::int64_t now_ns) {
        if (!told_s_) told_s_ = since_s(now_ns);
    }
    // The firmware is told by the first frame of the tortured side's drive after its return.
    bool told_by_return = false, has_returned = false;
    // From::lie: how far what encoders tell is from the truth, by how far the wheels have truly turned since.
    // An encoder that stands still tells the truth of a wheel that does.
    double (*untold_rad)(const Scene&, const WheelPair<double>& turned_rad) = nullptr;
    void begin_harm() { harm_ns_ = sim_.now_ns(); }
    double since_s() const { return since_s(sim_.now_ns()); }  // since the injection
    double since_s(std::int64_t now_ns) const { return 1e-9 * static_cast<double>(now_ns - harm_ns_); }
    // Everything as before the injection, but for what the robot has gone through.
    void restore();

    // ---- what a kind of fault keeps between its cycles
    double amount = 0;
    std::int64_t count = 0;
    bool reversed = false;
    std::function<void()> undo;

  private:
    static SimulationOptions options(const SceneSetup& setup, const SceneRecords& records);
    SceneSetup setup_;
    sim::Random random_;
    Simulation sim_;
    std::int64_t harm_ns_ = 0;
    std::optional<double> told_s_;
    std::uint8_t alive_ = 7;
};

std::uint32_t bits_of(float value);

}  // namespace wheelwright::tools
