// record FILE SENT [another]: a drive of the simulated robot, as recording.hpp says: identification, every
// law, a model that adapts to a payload, a stop line, a drive's error. Until identification begins the
// encoders tell their origin without noise: the excitation's seed is drawn from the last digits of the
// observer's angles, which in float would be others. `another`: says of the robot that its track is longer by
// a thousandth.
#include <cstdio>
#include <fstream>
#include <memory>
#include <utility>
#include <vector>

#include "drivers/odrive/odrive_0_5_messages.hpp"
#include "tests/m7/recording.hpp"
#include "tools/sim/cycle_rig.hpp"
#include "tools/sim/experiments.hpp"

namespace {

using namespace wheelwright;
using protocol::Mode;

class Recorder final : public tools::FrontBus {
  public:
    hal::CanStatus send(const hal::CanFrame& frame) override {
        sent.push_back(m7::frame_of(frame, now_ns));
        return FrontBus::send(frame);
    }
    hal::CanStatus receive(hal::ReceivedFrame& out) override {
        const hal::CanStatus status = FrontBus::receive(out);
        if (status == hal::CanStatus::ok) {
            if (still && out.frame.id < protocol::EmergencyStop::id &&
                (out.frame.id & 0x1FU) == drivers::odrive_0_5::GetEncoderEstimates::command)
                out.frame.data = {};
            received.push_back(m7::frame_of(out.frame, out.timestamp_ns));
        }
        return status;
    }
    bool still = true;
    std::int64_t now_ns = 0;
    std::vector<m7::Frame> received, sent;
};

class Drive {
  public:
    Drive(const char* file, const char* sent, double track_factor)
        : file_(file, std::ios::binary), sent_(sent, std::ios::binary) {
        const tools::ExampleRobots robots = tools::example_robots(false);
        tools::RigOptions options;
        options.world = robots.world;
        // float's last digits choose another step of the loops' gain, or another cycle at a limit, in most
        // drives: what is compared then differs by up to 23 times the tolerances (docs/target.md). Not in
        // this one
        options.seed = 23;
        options.digital_lines = true;
        options.front = &bus_;
        rig_ = std::make_unique<tools::CycleRig>(robots.controller, robots.truth, options);
        put(beginning_);
        model::RobotParameters told = rig_->parameters();
        told.geometry.track_m *= track_factor;
        put(told);
    }

    tools::CycleRig& rig() { return *rig_; }
    tools::SimulatedHost& host() { return rig_->host(); }
    const supervisor::Supervisor& supervisor() { return rig_->cycle().supervisor(); }

    void move() { bus_.still = false; }
    void run(int cycles) {
        for (int i = 0; i < cycles; ++i) step();
    }
    void enter(Mode mode, int cycles) {
        host().mode(mode);
        for (int i = 0; i < 500 && !(supervisor().mode() == mode && supervisor().may_drive()); ++i) step();
        run(cycles);
    }
    void recover() {
        host().clear_fault();
        run(200);
        host().mode(Mode::idle);
        run(100);
    }
    // True: written.
    bool end() {
        file_.seekp(0);
        put(beginning_);
        return file_.good() && sent_.flush().good();
    }

    void step() {
        bus_.received.clear();
        bus_.sent.clear();
        m7::Told told;
        rig_->wake();
        told.time = rig_->time();
        bus_.now_ns = told.time.scheduled_ns;
        told.stop_line = rig_->stop_line().read();
        rig_->think();
        m7::Outcome outcome = m7::outcome_of(rig_->cycle());
        rig_->wait_for_sending();
        told.sending_ns = told.time.scheduled_ns + rig_->cycle().send_phase_ns();
        rig_->send();
        outcome.state = task::CycleState::of(supervisor());
        told.received = static_cast<std::uint32_t>(bus_.received.size());
        put(told);
        put(outcome);
        for (const m7::Frame& frame : bus_.received) put(frame);
        for (const m7::Frame& frame : bus_.sent)
            sent_.write(reinterpret_cast<const char*>(&frame), sizeof(frame));
        ++beginning_.cycles;
    }

  private:
    template <typename T>
    void put(const T& value) {
        file_.write(reinterpret_cast<const char*>(&value), sizeof(value));
    }

    std::ofstream file_, sent_;
    m7::Beginning beginning_;
    Recorder bus_;
    std::unique_ptr<tools::CycleRig> rig_;
};

// True: it went as it was to go, to the end.
bool drive(Drive& d) {
    tools::SimulatedHost& host = d.host();
    d.run(200);
    protocol::IdentSettings settings;
    settings.duration_s = 16;  // short: what it must find is what the record says
    host.ident(settings);
    d.enter(Mode::ident, 0);
    d.move();
    for (int i = 0; i < 60'000 && d.supervisor().mode() == Mode::ident; ++i) d.step();
    d.run(600);  // the loops are designed

    host.torque({0.8, 1.1});
    d.enter(Mode::torque, 300);
    host.velocity({0.4, 0.7});
    d.enter(Mode::velocity, 600);
    host.velocity({9, -20});
    d.run(400);
    host.goal({0.4, 0.2, 1.0}, protocol::PoseDirection::automatic);
    d.enter(Mode::pose, 2000);
    host.silence();
    d.enter(Mode::adaptive, 4000);
    tools::drop_payload(d.rig().world(), 0.3);
    d.run(3000);
    d.rig().stop_line().set(hal::LineLevel::active);
    d.run(20);
    d.rig().stop_line().set(hal::LineLevel::inactive);
    for (int i = 0; i < 300 && d.supervisor().mode() == Mode::fault; ++i) {  // cleared as soon as it stands
        host.clear_fault();
        d.run(10);
    }
    d.recover();
    d.enter(Mode::trajectory, 1000);
    const bool drove = d.supervisor().mode() == Mode::trajectory;
    d.rig().world().left().raise_error(0x40);
    d.run(600);
    return drove && d.supervisor().fault() == protocol::Fault::drive_error;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 3) return 1;
    Drive d(argv[1], argv[2], argc > 3 ? 1.001 : 1);
    return drive(d) && d.end() ? 0 : 2;
}
