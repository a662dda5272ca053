// The command handler as a state machine: an input is a script of commands, parameter changes, frames of
// nobody's and time, played to the firmware with a simulated robot behind it. Judged by what the robot truly
// does.
#include <fuzzer/FuzzedDataProvider.h>

#include <cmath>
#include <limits>

#include "firmware/protocol/command_guard.hpp"
#include "tests/chain/robots.hpp"
#include "tests/fuzz/expect.hpp"
#include "tests/support/key_holder.hpp"

using namespace wheelwright;
using protocol::Mode;

namespace {

enum class Act : std::uint8_t {
    wait,
    mode,
    velocity,
    torque,
    goal,
    sealed,     // a command frame with any payload and a good seal
    parameter,  // read, write or commit, with any index and value
    any_frame,  // on the host's bus
    stop,
    clear,
    silence,
    external_pose,
    answer,  // to the last challenge, with the right code or some other
    kMaxValue = answer,
};

constexpr double kMostTime_s = 3;
constexpr int kMostSteps = 200;

class Robot {
  public:
    // `locked`: its firmware has a key, and the host holds it.
    explicit Robot(bool locked)
        : locked_(locked), sim_(chain::identified(), chain::real().parameters, options(locked, holder_)) {
        support::KeyHolder::listen(sim_.host_bus());
        run(400);
    }

    void act(FuzzedDataProvider& input) {
        tools::SimulatedHost& host = sim_.host();
        const auto real = [&] { return input.ConsumeFloatingPointInRange(-4.0, 4.0); };
        switch (input.ConsumeEnum<Act>()) {
            case Act::wait:
                return run(input.ConsumeIntegralInRange(1, 100));
            case Act::mode:
                host.mode(static_cast<Mode>(input.ConsumeIntegralInRange(0, 8)));
                break;
            case Act::velocity:
                host.velocity({real(), 2 * real()});
                break;
            case Act::torque:
                host.torque({real(), real()});
                break;
            case Act::goal:
                host.goal({real(), real(), real()}, protocol::PoseDirection::forward);
                break;
            case Act::sealed:
                send_sealed(input);
                break;
            case Act::parameter: {
                const auto table = model::parameter_table();
                const auto operation = input.ConsumeIntegralInRange(0, 4);
                const auto which = input.ConsumeIntegralInRange<std::size_t>(0, table.size());
                const std::uint16_t index =
                    which < table.size() ? table[which].index : input.ConsumeIntegral<std::uint16_t>();
                host.parameter(static_cast<protocol::ParameterOperation>(operation), index,
                               input.ConsumeFloatingPoint<float>());
                break;
            }
            case Act::any_frame: {
                hal::CanFrame frame;
                frame.extended = input.ConsumeBool();
                frame.id = input.ConsumeIntegralInRange(0U, frame.extended ? 0x1FFF'FFFFU : 0x7FFU);
                frame.remote = input.ConsumeBool();
                fill(frame, input);
                sim_.host_bus().send(frame);
                break;
            }
            case Act::stop:
                host.emergency_stop();
                stopped_ = true;
                since_stop_ = 0;
                break;
            case Act::clear:
                host.clear_fault();
                stopped_ = false;
                break;
            case Act::silence:
                host.silence();
                break;
            case Act::external_pose:
                host.external_pose({real(), real(), real()});
                break;
            case Act::answer:
                send_answer(input);
                break;
        }
        run(1);
    }

    bool time_is_over() const { return sim_.time_s() > kMostTime_s; }

  private:
    static tools::SimulationOptions options(bool locked, support::KeyHolder& holder) {
        tools::SimulationOptions o = chain::options(1);
        if (locked) o.arming_key = holder.key();
        o.separate_host_bus = true;  // on one bus any_frame could be a set-point for a drive
        return o;
    }

    static void fill(hal::CanFrame& frame, FuzzedDataProvider& input) {
        frame.length = input.ConsumeIntegralInRange<std::uint8_t>(0, 8);
        frame.data.fill(0);
        input.ConsumeData(frame.data.data(), frame.length);
    }

    // EmergencyStop is no sealed frame, but ClearFault is.
    void send_sealed(FuzzedDataProvider& input) {
        const protocol::MessageInfo& info = input.PickValueInArray(protocol::all_messages);
        hal::CanFrame frame;
        fill(frame, input);
        frame.id = info.id;
        if (info.sealed) {
            frame.length = info.length;
            alive_ = protocol::next_alive(alive_);
            protocol::seal({frame.data.data(), frame.length}, alive_);
        }
        if (info.id == protocol::EmergencyStop::id || info.id == protocol::ClearFault::id) stopped_ = false;
        sim_.host_bus().send(frame);
    }

    void send_answer(FuzzedDataProvider& input) {
        if (const auto heard = support::KeyHolder::heard(sim_.host_bus())) challenge_ = *heard;
        const auto mode = static_cast<Mode>(input.ConsumeIntegralInRange(1, 7));
        protocol::ArmingAnswer answer = holder_.answer(challenge_, mode);
        const auto turned = input.ConsumeIntegral<std::uint8_t>();
        answer.code_low ^= turned;
        if (turned == 0) proven_ = true;
        sim_.host_bus().send(holder_.frame(answer));
    }

    void run(int cycles) {
        for (int i = 0; i < cycles && !time_is_over(); ++i) {
            sim_.run_for(0.001);
            judge();
        }
    }

    void judge() {
        const sim::Plant& plant = sim_.world().plant();
        const auto& wheels = plant.wheel_speed_rad_per_s();
        FUZZ_EXPECT(std::isfinite(wheels.left) && std::isfinite(wheels.right));
        FUZZ_EXPECT(std::isfinite(plant.pose().x_m) && std::isfinite(plant.pose().heading_rad));

        // Parameters: whatever was committed is within its range.
        double value = 0;
        for (const model::ParameterInfo& info : model::parameter_table()) {
            value = info.get(sim_.parameters());
            FUZZ_EXPECT((info.automatic() && value == 0) || (value >= info.minimum && value <= info.maximum));
        }

        // Nobody drives who may not: two cycles and a frame's time after the supervisor lets go, the motors
        // are told nothing.
        const supervisor::Supervisor& supervisor = sim_.cycle().supervisor();
        const bool may = supervisor.may_drive() || supervisor.ramping();
        idle_cycles_ = may ? 0 : idle_cycles_ + 1;
        if (idle_cycles_ > 3) {
            for (std::size_t side : {0U, 1U}) {
                const sim::SimOdrive& drive = sim_.world().drive(side);
                FUZZ_EXPECT(!drive.armed() || drive.torque_target_Nm() == 0);
            }
        }
        // Nobody arms a robot with a key who has not shown it.
        FUZZ_EXPECT(!locked_ || proven_ || !supervisor.wants_armed());
        // A stop stands until it is cleared.
        if (stopped_ && ++since_stop_ > 3)
            FUZZ_EXPECT(supervisor.mode() == Mode::fault && !supervisor.may_drive());
    }

    bool locked_;
    bool proven_ = false;
    support::KeyHolder holder_;
    protocol::ArmingChallenge challenge_;
    tools::Simulation sim_;
    std::uint8_t alive_ = 7;
    int idle_cycles_ = 0;
    int since_stop_ = 0;
    bool stopped_ = false;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    FuzzedDataProvider input(data, size);
    Robot robot(input.ConsumeBool());
    for (int step = 0; step < kMostSteps && input.remaining_bytes() > 0 && !robot.time_is_over(); ++step)
        robot.act(input);
    return 0;
}
