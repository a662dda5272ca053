#include "tests/alloc/every_cycle.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

#include "firmware/protocol/command_guard.hpp"
#include "hal/linux/cryptography.hpp"
#include "tests/support/key_holder.hpp"
#include "tools/sim/cycle_rig.hpp"
#include "tools/sim/experiments.hpp"

namespace wheelwright::alloc {
namespace {

using protocol::Blocker;
using protocol::CounterCause;
using protocol::Fault;
using protocol::Mode;
using protocol::ParameterOperation;
using protocol::ParameterResult;

constexpr std::uint32_t kHeartbeatOfLeft = 1U << 5U | 1U;  // node 1
constexpr std::uint32_t kControllerModeOfLeft = 1U << 5U | 0x0BU;

// Calls visit(number of the field, its name, its value) for the fields that are yes or no.
template <typename Visitor>
void for_each_flag(const protocol::Status& status, Visitor&& visit) {
    std::size_t i = 0;
    protocol::Status::for_each_field(status, [&](const protocol::FieldInfo& info, const auto& field) {
        if constexpr (std::is_same_v<std::remove_cvref_t<decltype(field)>, bool>) visit(i, info.name, field);
        ++i;
    });
}

class Witness final : public sim::BusTap {
  public:
    explicit Witness(Tour& tour) : tour_(tour) {}
    void on_frame(const sim::WireEvent& event) override {
        const hal::CanFrame& frame = *event.frame;
        if (frame.error || frame.extended) return;
        tour_.sent[frame.id] = true;
        protocol::ParameterReply reply;
        if (frame.id == protocol::ParameterReply::id &&
            protocol::ParameterReply::decode({frame.data.data(), frame.length}, reply) ==
                protocol::CodecStatus::ok) {
            tour_.answered[std::size_t(reply.result)] = true;
        }
        protocol::Status status;
        if (frame.id == protocol::Status::id &&
            protocol::Status::decode({frame.data.data(), frame.length}, status) ==
                protocol::CodecStatus::ok) {
            for_each_flag(status, [&](std::size_t i, std::string_view, bool yes) { tour_.flag[i] |= yes; });
        }
    }

  private:
    Tour& tour_;
};

// One robot, and what is done with it.
class Visit {
  public:
    Visit(Tour& tour, const Watch& watch, const tools::ExampleRobots& robots, tools::RigOptions options = {})
        : tour_(tour), watch_(watch), witness_(tour) {
        options.world = robots.world;
        options.black_box = true;
        rig_ = std::make_unique<tools::CycleRig>(robots.controller, robots.truth, options);
        rig_->bus().add_tap(witness_);
        run(300);
    }

    tools::CycleRig& rig() { return *rig_; }
    tools::SimulatedHost& host() { return rig_->host(); }
    sim::World& world() { return rig_->world(); }
    Mode mode() const { return rig_->cycle().supervisor().mode(); }

    void run(int cycles) {
        for (int i = 0; i < cycles; ++i) step();
    }
    template <typename Done>
    void run_until(Done&& done, int at_most) {
        for (int i = 0; i < at_most && !done(); ++i) step();
    }
    void enter(Mode mode) {
        host().mode(mode);
        run_until([&] { return this->mode() == mode && rig_->cycle().supervisor().may_drive(); }, 500);
    }
    void drive(const Twist<double>& twist) {
        host().velocity(twist);
        enter(Mode::velocity);
        run(400);
    }
    // The robot stands, the fault is cleared.
    void recover() {
        host().clear_fault();  // while it moves, perhaps
        run(2000);
        host().clear_fault();
        run(200);
        host().silence();
        host().mode(Mode::idle);
        run(50);
    }
    void parameter(ParameterOperation operation, std::uint16_t index = 0, float value = 0) {
        host().parameter(operation, index, value);
        run(3);
    }
    // A command as it comes from a careless sender: the caller may spoil it.
    template <typename Message, typename Spoil>
    void send_spoilt(const Message& message, Spoil&& spoil) {
        hal::CanFrame frame;
        frame.id = Message::id;
        frame.length = Message::length;
        alive_ = protocol::next_alive(alive_);
        static_cast<void>(protocol::encode_sealed(message, alive_, frame.data));
        spoil(frame);
        rig_->host_bus().send(frame);
        run(3);
    }
    static void seal_again(hal::CanFrame& frame) {
        protocol::seal(std::span(frame.data).first(frame.length),
                       static_cast<std::uint8_t>(frame.data[1] & 0xFU));
    }

    void step() {
        rig_->step([this](auto&& part) { watch_(part); });
        ++tour_.cycles;
        const task::Cycle& cycle = rig_->cycle();
        const supervisor::Supervisor& supervisor = cycle.supervisor();
        tour_.mode[std::size_t(supervisor.mode())] = true;
        if (supervisor.mode() == Mode::fault) {
            (supervisor.ramping() ? tour_.ramped : tour_.coasted)[std::size_t(supervisor.fault())] = true;
        }
        tour_.blocker[std::size_t(supervisor.blocker())] = true;
        tour_.identified |= cycle.learning().identification_succeeded();
        tour_.finished |= cycle.finished();
        if (tour_.cycles % 50 == 0) count();
    }
    void count() {
        const auto counters = rig_->cycle().report().counters;
        for (std::size_t i = 0; i < counters.size(); ++i) tour_.counted[i] |= counters[i] > 0;
    }

  private:
    Tour& tour_;
    const Watch& watch_;
    Witness witness_;
    std::unique_ptr<tools::CycleRig> rig_;
    std::uint8_t alive_ = 7;
};

void drive_modes(Visit& visit) {
    tools::SimulatedHost& host = visit.host();
    visit.enter(Mode::torque);  // without a set-point
    visit.run(20);
    host.torque({0.8, 1.1});
    visit.run(300);
    host.torque({9, -9});  // over the limit
    visit.run(30);
    visit.drive({0.3, 0.5});
    host.velocity({3.9, -15});
    visit.run(300);
    host.velocity({3.9, 0.1});
    visit.run(150);
    for (const auto direction : protocol::pose_direction_values) {
        host.goal({0.4, 0.2, 1.0}, direction);
        visit.enter(Mode::pose);
        visit.run(2500);
    }
    visit.run_until([&] { return visit.rig().cycle().report().status.goal_reached; }, 20'000);
    visit.run(50);
    for (const auto shape : protocol::trajectory_shape_values) {
        protocol::TrajectoryCommand command;
        command.shape = shape;
        host.trajectory(command);
        if (shape == protocol::TrajectoryShape::streamed) {
            host.stream([](double t) {
                return std::pair{Pose<double>{0.3 * t, 0.1 * std::sin(t), 0.3 * std::cos(t)},
                                 Twist<double>{0.3, 0.1}};
            });
        } else {
            host.silence();
        }
        visit.enter(Mode::trajectory);
        visit.run(1500);
        visit.enter(Mode::adaptive);
        visit.run(500);
    }
    host.mode(Mode::idle);  // from motion: brakes
    visit.run(800);
    // From every driving mode into every other.
    constexpr std::array kDriving{Mode::torque, Mode::velocity, Mode::pose, Mode::trajectory, Mode::adaptive};
    for (const Mode from : kDriving) {
        for (const Mode to : kDriving) {
            host.silence();
            visit.enter(from);
            visit.run(15);
            visit.enter(to);
            visit.run(15);
        }
    }
    host.mode(Mode::ident);  // not from here
    visit.run(5);
}

void adapt(Visit& visit, Tour& tour) {
    visit.enter(Mode::adaptive);
    visit.run(8000);
    const double before = visit.rig().cycle().control().plant().dynamics.k7_per_kg_m;
    tools::drop_payload(visit.world(), 0.3);
    visit.run(5000);
    visit.rig().miss(1);
    visit.run(200);
    tour.adapted = visit.rig().cycle().control().plant().dynamics.k7_per_kg_m < 0.9 * before;
}

void identify(Visit& visit) {
    visit.host().mode(Mode::adaptive);  // knows too little
    visit.run(5);
    visit.enter(Mode::ident);
    visit.run(100);
    visit.host().mode(Mode::velocity);
    visit.run_until([&] { return visit.mode() != Mode::ident; }, 90'000);
    visit.run(1500);  // new gains are designed in slices
    visit.parameter(ParameterOperation::save);
    visit.host().mode(Mode::idle);
    visit.run(300);
    protocol::IdentSettings settings;  // a run that ends before it knows anything
    settings.duration_s = 2;
    settings.distance_limit_m = 0.2;
    settings.speed_limit_m_per_s = 0.1;
    visit.host().ident(settings);
    visit.enter(Mode::ident);
    visit.run(4000);
    visit.host().mode(Mode::idle);
    visit.run(300);
    settings.duration_s = 30;  // and one that is turned back at the edge of its area
    settings.distance_limit_m = 0.4;
    settings.speed_limit_m_per_s = 0.8;
    visit.host().ident(settings);
    visit.enter(Mode::ident);
    visit.run(30'000);
}

void ask_parameters(Visit& visit, Tour& tour) {
    const auto table = model::parameter_table();
    for (const model::ParameterInfo& info : table) {
        visit.parameter(ParameterOperation::read, info.index);
        visit.parameter(ParameterOperation::write, info.index, static_cast<float>(info.standard));
    }
    visit.parameter(ParameterOperation::discard);
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        visit.parameter(ParameterOperation::write, model::effect_index(i, 0), 0.1F);
        visit.parameter(ParameterOperation::read, model::effect_index(i, 0));
        visit.parameter(ParameterOperation::read, model::effect_index(i, model::kEffectActiveSlot));
    }
    const std::uint16_t gain = model::find_parameter("trajectory.along_gain_per_s")->index;
    const std::uint16_t k7 = model::find_parameter("dynamics.k7_per_kg_m")->index;
    visit.parameter(ParameterOperation::read, 0x3FFF);
    visit.parameter(ParameterOperation::write, gain, 1e30F);
    visit.parameter(ParameterOperation::commit);
    visit.parameter(ParameterOperation::commit);  // nothing staged any more
    visit.parameter(ParameterOperation::write, k7, 1.4F);
    visit.parameter(ParameterOperation::commit);
    visit.run(1500);  // loops are designed again
    visit.enter(Mode::torque);
    visit.parameter(ParameterOperation::write, k7, 1.5F);
    visit.parameter(ParameterOperation::commit);  // not while driving
    visit.parameter(ParameterOperation::discard);
    visit.host().mode(Mode::idle);
    visit.run(100);
    for (const bool well : {true, false}) {
        visit.parameter(ParameterOperation::save);
        visit.parameter(ParameterOperation::save);  // the first is not done
        if (visit.rig().mailbox().take() == nullptr) continue;
        visit.rig().mailbox().finished(well);
        visit.run(10);
        tour.saved |= well;
    }
    // More at once than a cycle takes, and more than the replies' queue holds, for longer than the shortest
    // period of telemetry.
    for (int burst = 0; burst < 12; ++burst) {
        for (int i = 0; i < 14; ++i) visit.host().parameter(ParameterOperation::read, gain);
        visit.rig().miss(2);  // they pile up
        visit.run(2);
    }
    visit.run(50);
}

void send_nonsense(Visit& visit) {
    protocol::VelocityCommand velocity;
    const auto as_is = [](hal::CanFrame&) {};
    visit.send_spoilt(velocity, [](hal::CanFrame& f) { f.length = 3; });
    visit.send_spoilt(velocity, [](hal::CanFrame& f) { f.length = 0; });
    visit.send_spoilt(velocity, [](hal::CanFrame& f) { f.data[0] ^= 0x55U; });
    visit.send_spoilt(velocity, [](hal::CanFrame& f) { f.remote = true; });
    visit.send_spoilt(velocity, [](hal::CanFrame& f) { f.extended = true; });
    visit.send_spoilt(velocity, [&](hal::CanFrame& f) {  // out of range, the seal right
        for (std::size_t i = 2; i < f.length; ++i) f.data[i] = i % 2 == 0 ? 0x00 : 0x80;
        Visit::seal_again(f);
    });
    visit.send_spoilt(velocity, [&](hal::CanFrame& f) {  // a counter that does not exist
        f.data[1] = static_cast<std::uint8_t>(f.data[1] | 0x0FU);
        Visit::seal_again(f);
    });
    for (int i = 0; i < 2; ++i) {  // the same counter twice
        visit.send_spoilt(velocity, [&](hal::CanFrame& f) {
            f.data[1] = static_cast<std::uint8_t>((f.data[1] & 0xF0U) | 3U);
            Visit::seal_again(f);
        });
    }
    for (const float odd :
         {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
        protocol::ParameterRequest request;
        request.operation = ParameterOperation::write;
        request.index = model::find_parameter("trajectory.along_gain_per_s")->index;
        visit.send_spoilt(request, [&](hal::CanFrame& f) {
            std::memcpy(f.data.data() + f.length - 4, &odd, 4);
            Visit::seal_again(f);
        });
    }
    for (const std::uint8_t number : {std::uint8_t{0}, std::uint8_t{8}, std::uint8_t{99}}) {
        visit.send_spoilt(protocol::ModeCommand{}, [&](hal::CanFrame& f) {
            f.data[2] = number;  // boot, fault, no mode at all
            Visit::seal_again(f);
        });
    }
    visit.send_spoilt(protocol::StreamedPose{}, as_is);
    visit.send_spoilt(protocol::StreamedPose{}, as_is);      // two first halves
    visit.send_spoilt(protocol::StreamedVelocity{}, as_is);  // a second half of another pair
    visit.rig().bus().inject_error_frame(0x080);
    visit.rig().bus().add_fault({sim::FaultAction::corrupt, 0, 0, 0, 200, 0.3});
    visit.drive({0.2, 0.2});
    visit.rig().bus().clear_faults();
    visit.rig().bus().add_fault({sim::FaultAction::destroy, 0, 0, 0, 20, 1});
    visit.run(100);
    visit.rig().bus().clear_faults();
    visit.recover();
}

// A wrong answer first, then the right one.
void prove(Visit& visit, support::KeyHolder& holder) {
    hal::CanBus& bus = visit.rig().host_bus();
    support::KeyHolder::listen(bus);
    visit.host().torque({0.5, 0.5});
    for (const unsigned wrong : {1U, 0U}) {
        visit.host().mode(Mode::torque);
        std::optional<protocol::ArmingChallenge> challenge;
        visit.run_until([&] { return (challenge = support::KeyHolder::heard(bus)).has_value(); }, 500);
        if (!challenge) return;
        protocol::ArmingAnswer answer = holder.answer(*challenge, Mode::torque);
        answer.code_low ^= wrong;
        bus.send(holder.frame(answer));
        visit.run(200);
    }
}

void fail_in_every_way(Visit& visit) {
    const auto left_faults = [](Visit& v) -> sim::SimOdriveFaults& { return v.world().left().faults(); };
    // Faults of drives, bus and host while the robot moves.
    struct Case {
        std::function<void()> provoke;
        std::function<void()> repair;
    };
    sim::InProcessBus& bus = visit.rig().bus();
    const auto nothing = [] {};
    const std::array cases{
        Case{[&] { left_faults(visit).mute = true; }, [&] { left_faults(visit).mute = false; }},
        Case{[&] { left_faults(visit).frozen_encoder = true; },
             [&] { left_faults(visit).frozen_encoder = false; }},
        Case{[&] {
                 hal::CanFrame torque;  // somebody else's
                 torque.id = (kHeartbeatOfLeft & ~0x1FU) | 0x0E;
                 torque.length = 8;
                 torque.data = {};
                 bus.endpoint(tools::CycleRig::kHost).send(torque);
             },
             nothing},
        Case{[&] { visit.host().silence(); }, nothing},
        Case{[&] { visit.world().left().raise_error(0x40); }, nothing},
        Case{[&] { visit.world().right().drop_out(); }, nothing},
        Case{[&] { left_faults(visit).supply_sags_V = 20; }, [&] { left_faults(visit).supply_sags_V = 0; }},
        Case{[&] { left_faults(visit).supply_sags_V = -60; }, [&] { left_faults(visit).supply_sags_V = 0; }},
        Case{[&] { left_faults(visit).heats_degC = 100; }, [&] { left_faults(visit).heats_degC = 0; }},
        Case{[&] { left_faults(visit).powered_off = true; }, [&] { left_faults(visit).powered_off = false; }},
        Case{[&] { left_faults(visit).motor_unplugged = true; },
             [&] { left_faults(visit).motor_unplugged = false; }},
        Case{[&] {
                 visit.host().velocity({2.4, 0});
             },
             nothing},  // over the speed limit of this visit
        Case{[&] { visit.rig().stop_line().set(hal::LineLevel::active); },
             [&] { visit.rig().stop_line().set(hal::LineLevel::inactive); }},
        Case{[&] { visit.rig().stop_line().set(hal::LineLevel::unknown); },
             [&] { visit.rig().stop_line().set(hal::LineLevel::inactive); }},
        Case{[&] { visit.rig().enable_line().set_broken(true); },
             [&] { visit.rig().enable_line().set_broken(false); }},
        Case{[&] { visit.host().emergency_stop(); }, nothing},
        Case{[&] { visit.rig().miss(20); }, nothing},
        Case{[&] {
                 bus.add_fault({sim::FaultAction::drop, kHeartbeatOfLeft, 0x7FF});
             },
             [&] { bus.clear_faults(); }},
        Case{[&] { bus.set_down(tools::CycleRig::kFirmware, true); },
             [&] { bus.set_down(tools::CycleRig::kFirmware, false); }},
        Case{[&] { bus.set_bus_off(tools::CycleRig::kFirmware); },
             [&] { bus.recover(tools::CycleRig::kFirmware); }},
    };
    for (const Case& one : cases) {
        visit.drive({0.4, 0.6});
        one.provoke();
        visit.run(500);
        visit.host().mode(Mode::velocity);  // not while the fault stands
        visit.run(5);
        one.repair();
        visit.recover();
    }
    visit.host().emergency_stop();  // in idle
    visit.run(10);
    visit.recover();
    visit.world().left().raise_error(0x2);  // in idle: it stays until somebody clears it
    visit.run(200);
    visit.host().mode(Mode::velocity);
    visit.run(10);
    visit.recover();
    left_faults(visit).heats_degC = 100;
    visit.run(100);
    visit.host().mode(Mode::velocity);
    visit.run(10);
    left_faults(visit).heats_degC = 0;
    visit.recover();
    visit.rig().stop_line().set(hal::LineLevel::active);
    visit.host().mode(Mode::velocity);
    visit.run(10);
    visit.rig().stop_line().set(hal::LineLevel::inactive);
    left_faults(visit).deaf = true;  // will not arm
    visit.host().mode(Mode::velocity);
    visit.run(3000);
    left_faults(visit).deaf = false;
    visit.recover();
}

// Torques that are no numbers: a model that no configuration can hold, put in behind the firmware's back.
void compute_nonsense(Visit& visit) {
    visit.rig().parameters().dynamics.k7_per_kg_m = std::numeric_limits<double>::quiet_NaN();
    const std::uint16_t gain = model::find_parameter("trajectory.along_gain_per_s")->index;
    visit.parameter(ParameterOperation::write, gain, 2.0F);
    visit.parameter(ParameterOperation::commit);
    visit.host().velocity({0.3, 0.1});
    visit.enter(Mode::velocity);
    visit.run(100);
}

void terminate(Visit& visit, bool moving) {
    if (moving) visit.drive({0.5, 0.3});
    visit.rig().cycle().request_termination();
    visit.run_until([&] { return visit.rig().cycle().finished(); }, 5000);
}

model::RobotParameters reacting(model::RobotParameters p, model::StopReaction reaction) {
    p.safety.stale_command_reaction = p.safety.over_speed_reaction = p.safety.emergency_stop_reaction =
        p.safety.overrun_reaction = p.safety.terminate_reaction = p.safety.drive_limits_reaction = reaction;
    p.safety.over_speed_m_per_s = 1.5;
    return p;
}

template <typename Values, typename Met>
void list(std::vector<std::string>& out, const char* what, const Values& values, const Met& met,
          std::initializer_list<typename Values::value_type> except = {}) {
    for (const auto value : values) {
        if (met[std::size_t(value)]) continue;
        if (std::find(except.begin(), except.end(), value) != except.end()) continue;
        out.push_back(std::string(what) + " " + std::string(to_string_view(value)));
    }
}

}  // namespace

std::vector<std::string> Tour::missing() const {
    std::vector<std::string> out;
    list(out, "mode", protocol::mode_values, mode, {Mode::boot});  // before the first cycle's end
    list(out, "coasting after", protocol::fault_values, coasted, {Fault::none});
    for (const Fault fault :
         {Fault::stale_command, Fault::over_speed, Fault::emergency_stop_line, Fault::emergency_stop_message,
          Fault::cycle_overrun, Fault::drive_voltage_out_of_range, Fault::drive_overheated,
          Fault::terminated}) {
        // A stop line that is still active turns braking into coasting in the next cycle.
        if (!ramped[std::size_t(fault)]) out.push_back("braking after " + std::string(to_string_view(fault)));
    }
    // Unknown modes are refused by the codec already.
    list(out, "refusal", protocol::blocker_values, blocker, {Blocker::unknown_mode});
    for_each_flag(protocol::Status{}, [&](std::size_t i, std::string_view name, bool) {
        if (!flag[i]) out.push_back("Status with " + std::string(name));
    });
    list(out, "counter", protocol::counter_cause_values, counted);
    // A number that is none is refused before it is a request.
    list(out, "answer", protocol::parameter_result_values, answered, {ParameterResult::not_finite});
    for (const protocol::MessageInfo& message : protocol::all_messages) {
        if (!sent[message.id]) out.push_back("message " + std::string(message.name));
    }
    if (!identified) out.emplace_back("an identification that succeeds");
    if (!adapted) out.emplace_back("a model that followed the payload");
    if (!saved) out.emplace_back("a snapshot to save");
    if (!finished) out.emplace_back("the end after a request");
    return out;
}

Tour drive_everything(const Watch& watch, const std::function<void(const char*)>& scene) {
    Tour tour;
    const tools::ExampleRobots known = tools::example_robots(true);
    const tools::ExampleRobots unknown = tools::example_robots(false);
    const auto visit = [&](const char* what, const tools::ExampleRobots& robots,
                           const tools::RigOptions& options, auto&& act) {
        scene(what);
        Visit one(tour, watch, robots, options);
        act(one);
        one.count();
    };
    visit("every mode", known, {}, drive_modes);
    visit("adaptation to a payload", known, {}, [&](Visit& v) { adapt(v, tour); });
    visit("identification", unknown, {}, identify);
    visit("parameters", known, {}, [&](Visit& v) { ask_parameters(v, tour); });
    visit("frames that are refused", known, {}, send_nonsense);

    tools::RigOptions lines;
    lines.digital_lines = true;
    for (const auto reaction : {model::StopReaction::coast, model::StopReaction::ramp}) {
        const bool ramps = reaction == model::StopReaction::ramp;
        tools::ExampleRobots robots = known;
        robots.controller = reacting(known.controller, reaction);
        for (model::RobotParameters* p : {&robots.controller, &robots.truth})
            p->drive.supply_period_ms = p->drive.temperature_period_ms = 20;
        visit(ramps ? "faults met by braking" : "faults met by coasting", robots, lines, fail_in_every_way);
        visit("termination while driving", robots, lines, [](Visit& v) { terminate(v, true); });
    }
    visit("termination at rest", known, {}, [](Visit& v) { terminate(v, false); });
    visit("a model that is not a number", known, {}, compute_nonsense);

    tools::ExampleRobots nobody_knows = known;
    nobody_knows.controller.dynamics = model::default_parameters().dynamics;
    nobody_knows.controller.dynamics_standard_error = {};
    visit("a model that nobody has given", nobody_knows, {}, [](Visit& v) { v.enter(Mode::velocity); });

    tools::ExampleRobots no_watchdog = known;
    no_watchdog.controller.drive.watchdog_assured = false;
    no_watchdog.world.watchdog_enabled = false;
    // Told to be in torque mode, a drive does not hear it: it gives another torque, or says so when asked.
    const auto hear_no_mode = [](Visit& v) {
        v.rig().bus().add_fault({sim::FaultAction::drop, kControllerModeOfLeft, 0x7FF});
        v.host().velocity({0.4, 0.2});
        v.host().mode(Mode::velocity);
        v.run(3000);
    };
    visit("drives in another mode", known, {}, hear_no_mode);
    tools::ExampleRobots asked = known;
    for (model::RobotParameters* p : {&asked.controller, &asked.truth}) {
        p->drive.watchdog_endpoint = 391;
        p->drive.watchdog_timeout_endpoint = 392;
        p->drive.control_mode_endpoint = 401;
        p->drive.input_mode_endpoint = 402;
    }
    visit("drives in another mode that say so", asked, {}, hear_no_mode);
    visit("drives without a watchdog", no_watchdog, {}, [](Visit& v) { v.enter(Mode::velocity); });

    tools::ExampleRobots impossible = known;  // no loop is that fast and that stable
    impossible.controller.velocity_loop.settling_time_s = 0.005;
    impossible.controller.velocity_loop.phase_margin_deg = 85;
    visit("loops without an accepted design", impossible, lines, [](Visit& v) {
        v.host().mode(Mode::velocity);
        v.run(10);
        v.host().torque({1, 1});
        v.enter(Mode::torque);
        v.run(300);
        v.host().mode(Mode::idle);  // there is nothing to brake with
        v.run(300);
    });

    tools::RigOptions two;
    two.separate_host_bus = true;
    visit("a host bus of its own", known, two, [](Visit& v) {
        v.drive({0.3, 0.4});
        v.enter(Mode::adaptive);
        v.run(1500);
        v.host().emergency_stop();
        v.recover();
    });
    support::KeyHolder holder;
    const auto random = std::move(hal::make_random().value());
    tools::RigOptions locked;
    locked.arming_key = holder.key();
    locked.arming_key.random = random.get();
    visit("authenticated arming", known, locked, [&](Visit& v) { prove(v, holder); });
    tools::ExampleRobots older = known;
    older.controller.drive.generation = older.truth.drive.generation = 5;
    visit("drives of generation 0.5", older, {}, [](Visit& v) {
        v.drive({0.3, 0.4});
        v.world().left().raise_error(0x40);
        v.run(200);
        v.recover();
    });
    return tour;
}

}  // namespace wheelwright::alloc
