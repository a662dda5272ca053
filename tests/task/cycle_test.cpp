// The whole cycle between drives, buses and lines that do what the test says.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <deque>
#include <vector>

#include "firmware/protocol/command_guard.hpp"
#include "firmware/task/cycle.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::task;
using drivers::DriveState;
using protocol::Fault;
using protocol::Mode;

namespace {

// A drive at rest that arms at once, and whose torque frames tell the torque in mNm.
struct FakeDrive final : drivers::MotorDrive {
    explicit FakeDrive(std::uint32_t first) : id(first) {}

    bool accept(const hal::ReceivedFrame& received) override {
        if (received.frame.id != id + 1) return false;
        ++accepted;
        accepted_ns = received.timestamp_ns;
        return true;
    }
    void update(std::int64_t now_ns, drivers::FrameSink& out) override {
        if (feeds) told.encoder_time_ns = told.heartbeat_time_ns = now_ns;
        if (asks) out.push(frame(id + 2));
    }
    void request_arm() override {
        ++arms;
        if (obeys) now = DriveState::armed;
    }
    void request_disarm() override {
        ++disarms;
        if (obeys) now = DriveState::idle;
    }
    void request_clear_errors() override { ++clears; }
    void command_torque(double torque_Nm, drivers::FrameSink& out) override {
        if (now != DriveState::armed) return;
        hal::CanFrame f = frame(id);
        f.data[0] = static_cast<std::uint8_t>(static_cast<std::int8_t>(1000 * torque_Nm));
        out.push(f);
    }
    bool refused(const hal::CanFrame& f) override {
        refusals += f.id == id + 2 ? 1 : 0;
        return f.id == id + 2;
    }
    void was_sent(const hal::CanFrame&) override {}
    void set_torque_scale(double value) override { scale = value; }
    DriveState state() const override { return now; }
    drivers::DriveFault fault() const override { return {}; }
    drivers::ArmRefusal refusal() const override { return {}; }
    const drivers::DriveFeedback& feedback() const override { return told; }
    const drivers::DriveCounters& counters() const override { return counted; }
    void push_idle(drivers::FrameSink& out) const override { out.push(frame(id + 3)); }
    const drivers::DriveRatings& ratings() const override { return rated; }
    std::span<std::byte> memory() override { return {}; }
    std::span<const drivers::DriveFrame> frames() const override { return {}; }
    std::string_view error_name(std::uint32_t) const override { return "unknown"; }

    static hal::CanFrame frame(std::uint32_t id) {
        hal::CanFrame f;
        f.id = id;
        f.length = 8;
        f.data.fill(0);
        return f;
    }

    std::uint32_t id;
    DriveState now = DriveState::idle;
    drivers::DriveFeedback told;
    drivers::DriveCounters counted;
    drivers::DriveRatings rated;
    bool feeds = true, obeys = true, asks = false;
    int arms = 0, disarms = 0, clears = 0, accepted = 0, refusals = 0;
    std::int64_t accepted_ns = 0;
    double scale = 0;
};

struct FakeBus final : hal::CanBus {
    hal::CanStatus send(const hal::CanFrame& frame) override {
        const bool taken = std::find(refuses.begin(), refuses.end(), frame.id) == refuses.end();
        if (taken) sent.push_back(frame);
        return taken ? hal::CanStatus::ok : hal::CanStatus::would_block;
    }
    bool waits(std::uint32_t id) const override { return id == waiting; }
    hal::CanStatus receive(hal::ReceivedFrame& out) override {
        if (incoming.empty()) return down ? hal::CanStatus::bus_down : hal::CanStatus::would_block;
        out = incoming.front();
        incoming.pop_front();
        return hal::CanStatus::ok;
    }
    bool set_filters(std::span<const hal::CanFilter>) override { return true; }
    hal::CanStatistics statistics() const override { return {}; }

    // Of this identifier, since the last time.
    std::vector<hal::CanFrame> take(std::uint32_t id) {
        std::vector<hal::CanFrame> found;
        for (const hal::CanFrame& f : sent) {
            if (f.id == id) found.push_back(f);
        }
        return found;
    }

    std::deque<hal::ReceivedFrame> incoming;
    std::vector<hal::CanFrame> sent;
    std::vector<std::uint32_t> refuses;
    std::uint32_t waiting = 0xFFFF;
    bool down = false;
};

struct FakeInput final : hal::DigitalInput {
    hal::LineLevel read() override { return level; }
    hal::LineLevel level = hal::LineLevel::inactive;
};

struct FakeOutput final : hal::DigitalOutput {
    bool write(bool active) override {
        now = active;
        return works;
    }
    bool now = false, works = true;
};

constexpr std::uint32_t kLeft = 0x100, kRight = 0x200;

model::RobotParameters quick_robot() {
    model::RobotParameters p = model::default_parameters();
    p.limits.torque_Nm = 1;
    p.drive.left.torque_scale = 0.9;
    p.drive.right.torque_scale = 1.1;
    return p;
}

struct Rig {
    explicit Rig(const model::RobotParameters& p = quick_robot(), bool separate = false, bool lines = false)
        : parameters(p),
          cycle(parameters, mailbox,
                CyclePorts{bus, separate ? &host_bus : nullptr, left, right, lines ? &stop_line : nullptr,
                           lines ? &enable : nullptr}),
          host(separate ? host_bus : bus) {
        run(5);
    }

    void step(std::int64_t missed = 0) {
        bus.sent.clear();
        host_bus.sent.clear();
        now += (1 + missed) * kCyclePeriod_ns;
        CycleTime time;
        time.scheduled_ns = now;
        time.woken_ns = now + late_ns;
        time.missed = missed;
        time.last_execution_ns = ran_ns;
        cycle.think(time);
        cycle.send(now + cycle.send_phase_ns());
        late_ns = 0;
    }
    void run(int cycles) {
        for (int i = 0; i < cycles; ++i) {
            if (pushes) push();
            step();
        }
    }
    template <typename Message>
    void say(const Message& message, FakeBus& on) {
        hal::ReceivedFrame received;
        received.frame.id = Message::id;
        received.frame.length = Message::length;
        received.timestamp_ns = now + 1000;
        alive = protocol::next_alive(alive);
        CHECK(protocol::encode_sealed(message, alive, received.frame.data) == protocol::CodecStatus::ok);
        on.incoming.push_back(received);
    }
    template <typename Message>
    void say(const Message& message) {
        say(message, host);
    }
    void push(double left_Nm = 0.02, double right_Nm = -0.03) {
        protocol::TorqueCommand torque;
        torque.left_torque_Nm = left_Nm;
        torque.right_torque_Nm = right_Nm;
        say(torque);
    }
    void ask(Mode mode) {
        protocol::ModeCommand command;
        command.mode = mode;
        say(command);
    }
    void drive() {
        ask(Mode::torque);
        pushes = true;
        run(4);
        CHECK(cycle.supervisor().may_drive());
    }
    // The torque that a drive was sent in the last cycle, in mNm; -128: none.
    int sent_mNm(std::uint32_t id) {
        const auto frames = bus.take(id);
        CHECK(frames.size() <= 1);
        return frames.empty() ? -128 : static_cast<std::int8_t>(frames[0].data[0]);
    }
    Fault fault() const { return cycle.supervisor().fault(); }
    std::uint32_t count(protocol::CounterCause cause) const {
        return cycle.report().counters[std::size_t(cause)];
    }

    model::RobotParameters parameters;
    SaveMailbox mailbox;
    FakeBus bus, host_bus;
    FakeDrive left{kLeft}, right{kRight};
    FakeInput stop_line;
    FakeOutput enable;
    Cycle cycle;
    FakeBus& host;
    std::int64_t now = 1000 * kCyclePeriod_ns, late_ns = 0, ran_ns = 0;
    std::uint8_t alive = 0;
    bool pushes = false;
};

}  // namespace

TEST_GROUP(WholeCycle){};

TEST(WholeCycle, a_set_point_becomes_a_torque_frame_for_each_drive_while_both_are_armed) {
    for (const bool separate : {false, true}) {
        Rig rig(quick_robot(), separate);
        CHECK_EQUAL(-128, rig.sent_mNm(kLeft));
        rig.drive();
        CHECK_EQUAL(20, rig.sent_mNm(kLeft));
        CHECK_EQUAL(-30, rig.sent_mNm(kRight));
        CHECK_EQUAL(1, rig.left.arms);
        CHECK_EQUAL(1, rig.right.arms);
        CHECK_EQUAL(0, rig.left.disarms + rig.right.disarms);
        DOUBLES_EQUAL(0.9, rig.left.scale, 0);
        DOUBLES_EQUAL(1.1, rig.right.scale, 0);
        rig.ask(Mode::idle);
        rig.run(1500);
        CHECK(rig.cycle.supervisor().mode() == Mode::idle);
        CHECK_EQUAL(1, rig.left.disarms);
        CHECK_EQUAL(1, rig.right.disarms);
        CHECK_EQUAL(-128, rig.sent_mNm(kRight));
    }
}

TEST(WholeCycle, on_a_bus_of_its_own_the_host_alone_commands_and_is_told) {
    Rig rig(quick_robot(), true);
    const auto says = [&](FakeBus& where, Mode mode) {
        protocol::ModeCommand command;
        command.mode = mode;
        rig.say(command, where);
    };
    says(rig.bus, Mode::torque);
    rig.run(3);
    CHECK(rig.cycle.supervisor().requested() == Mode::idle);
    rig.host_bus.incoming.push_back({FakeDrive::frame(kLeft + 1), rig.now});  // no drive speaks there
    rig.step();
    CHECK_EQUAL(0, rig.left.accepted);
    rig.bus.incoming.push_back({FakeDrive::frame(kLeft + 1), rig.now});
    rig.bus.incoming.push_back({FakeDrive::frame(kRight + 1), rig.now});
    rig.step();
    CHECK_EQUAL(1, rig.left.accepted);
    CHECK_EQUAL(1, rig.right.accepted);
    std::size_t told = 0;
    for (int i = 0; i < 100; ++i) {
        rig.step();
        told += rig.host_bus.sent.size();
        CHECK(rig.bus.sent.empty());
    }
    CHECK(told > 20);
    rig.host_bus.down = true;  // takes nobody's drives away
    rig.step();
    CHECK_FALSE(rig.cycle.conditions().bus_down);
    rig.bus.incoming.push_back({FakeDrive::frame(protocol::EmergencyStop::id), rig.now});
    rig.step();
    CHECK(rig.fault() == Fault::emergency_stop_message);
    CHECK_EQUAL(1, rig.left.disarms);
    CHECK_EQUAL(1, rig.right.disarms);
}

TEST(WholeCycle, on_a_shared_bus_telemetry_goes_there_and_error_frames_go_nowhere) {
    Rig rig;
    hal::CanFrame error = FakeDrive::frame(kLeft + 1);
    error.error = true;
    rig.bus.incoming.push_back({error, rig.now});
    rig.step();
    CHECK_EQUAL(0, rig.left.accepted);
    std::size_t told = 0;
    for (int i = 0; i < 450; ++i) {
        rig.step();
        told += rig.bus.sent.size();
    }
    CHECK(told > 20);
    CHECK(rig.host_bus.sent.empty());
    CHECK(rig.cycle.report().bus_load.drive_bus_load_percent > 0);
    DOUBLES_EQUAL(0, rig.cycle.report().bus_load.host_bus_load_percent, 0);
}

TEST(WholeCycle, a_flood_is_read_a_part_in_each_cycle) {
    Rig rig;
    for (int i = 0; i < 150; ++i) rig.bus.incoming.push_back({FakeDrive::frame(kLeft + 1), rig.now});
    rig.step();
    CHECK_EQUAL(64, rig.left.accepted);
    rig.run(2);
    CHECK_EQUAL(150, rig.left.accepted);
}

// Also a cycle that wakes late hears none that is younger than itself.
TEST(WholeCycle, no_frame_was_received_in_the_future) {
    for (const std::int64_t late_ns : {0, 300'000}) {
        Rig rig;
        for (const std::int64_t off_ns :
             {-60'000'000'000LL, -250'000LL, 0LL, 1'000'000LL, 60'000'000'000LL}) {
            const std::int64_t woken_ns = rig.now + kCyclePeriod_ns + late_ns;
            const std::int64_t time_ns = woken_ns + off_ns;
            rig.bus.incoming.push_back({FakeDrive::frame(kLeft + 1), time_ns});
            rig.late_ns = late_ns;
            rig.step();
            CHECK_EQUAL(std::min(time_ns, woken_ns), rig.left.accepted_ns);
        }
    }
}

TEST(WholeCycle, an_emergency_stop_line_that_is_active_or_cannot_be_read_stops) {
    for (const hal::LineLevel level : {hal::LineLevel::active, hal::LineLevel::unknown}) {
        Rig rig(quick_robot(), false, true);
        rig.drive();
        rig.stop_line.level = level;
        rig.run(1);
        CHECK(rig.fault() == Fault::emergency_stop_line);
        CHECK_EQUAL(-128, rig.sent_mNm(kLeft));
        CHECK_EQUAL(1, rig.left.disarms);
    }
}

TEST(WholeCycle, the_enable_line_follows_arming_and_one_that_cannot_be_written_is_a_fault) {
    Rig rig(quick_robot(), false, true);
    CHECK_FALSE(rig.enable.now);
    rig.drive();
    CHECK(rig.enable.now);
    rig.enable.works = false;
    rig.run(2);
    CHECK(rig.fault() == Fault::drive_enable_failed);
    CHECK_FALSE(rig.enable.now);
    CHECK_EQUAL(-128, rig.sent_mNm(kLeft));
}

TEST(WholeCycle, a_drives_bus_that_is_down_is_a_fault) {
    Rig rig;
    rig.drive();
    rig.bus.down = true;
    rig.run(1);
    CHECK(rig.fault() == Fault::bus_down);
}

TEST(WholeCycle, torques_that_the_bus_would_not_take_five_times_are_a_bus_that_is_down) {
    for (const std::uint32_t id : {kLeft, kRight}) {
        for (const bool old_one_waits : {false, true}) {
            Rig rig;
            rig.drive();
            const auto jam = [&](bool on) {
                if (old_one_waits) {
                    rig.bus.waiting = on ? id : 0xFFFF;
                } else if (on) {
                    rig.bus.refuses = {id};
                } else {
                    rig.bus.refuses.clear();
                }
            };
            const std::uint32_t before = rig.count(protocol::CounterCause::send_refused);
            jam(true);
            for (int i = 0; i < 4; ++i) {
                rig.run(1);
                CHECK_EQUAL(-128, rig.sent_mNm(id));
                CHECK_EQUAL(1U, rig.bus.sent.size());  // the other's: telemetry waits on a jammed bus
            }
            CHECK_EQUAL(before + 4, rig.count(protocol::CounterCause::send_refused));
            jam(false);
            rig.run(1);
            jam(true);
            rig.run(5);
            CHECK(rig.fault() == Fault::none);
            rig.run(1);
            CHECK(rig.fault() == Fault::bus_down);
        }
    }
}

TEST(WholeCycle, what_a_drive_was_to_be_asked_and_the_bus_refused_it_is_told) {
    Rig rig;
    rig.left.asks = rig.right.asks = true;
    rig.step();
    CHECK_EQUAL(1U, rig.bus.take(kLeft + 2).size());
    CHECK_EQUAL(1U, rig.bus.take(kRight + 2).size());
    CHECK_EQUAL(0, rig.left.refusals + rig.right.refusals);
    for (FakeDrive* drive : {&rig.left, &rig.right}) {
        rig.bus.refuses = {drive->id + 2};
        rig.step();
        CHECK_EQUAL(1, drive->refusals);
        drive->refusals = 0;
    }
    CHECK_EQUAL(0, rig.left.refusals + rig.right.refusals);
}

TEST(WholeCycle, the_end_waits_for_both_drives_to_be_idle_but_not_for_ever) {
    model::RobotParameters p = quick_robot();
    p.safety.terminate_reaction = model::StopReaction::coast;
    const auto cycles_until_finished = [&](bool left_obeys, bool right_obeys) {
        Rig rig(p);
        rig.drive();
        rig.left.obeys = left_obeys;
        rig.right.obeys = right_obeys;
        rig.cycle.request_termination();
        int cycles = 0;
        while (!rig.cycle.finished() && cycles < 2000) {
            rig.run(1);
            ++cycles;
        }
        CHECK(rig.fault() == Fault::terminated);
        return cycles;
    };
    CHECK_EQUAL(4, cycles_until_finished(true, true));
    CHECK_EQUAL(501, cycles_until_finished(false, true));
    CHECK_EQUAL(501, cycles_until_finished(true, false));
    // One that only arms yet is not asleep either; and without a request there is no end.
    Rig rig(p);
    rig.run(600);
    CHECK_FALSE(rig.cycle.finished());
    rig.right.obeys = false;
    rig.right.now = DriveState::arming;
    rig.cycle.request_termination();
    rig.run(100);
    CHECK_FALSE(rig.cycle.finished());
}

TEST(WholeCycle, each_reaction_of_the_robot_file_is_that_of_its_own_cause) {
    const auto reacts = [](auto choose, auto cause, Fault fault) {
        for (const bool ramps : {false, true}) {
            model::RobotParameters p = quick_robot();
            auto& s = p.safety;
            s.terminate_reaction = model::StopReaction::coast;
            if (ramps) choose(s) = model::StopReaction::ramp;
            Rig rig(p, false, true);
            rig.drive();
            cause(rig);
            CHECK(rig.fault() == fault);
            CHECK_EQUAL(ramps, rig.cycle.supervisor().ramping());
        }
    };
    using Reaction = model::StopReaction;
    reacts([](auto& s) -> Reaction& { return s.stale_command_reaction; },
           [](Rig& rig) {
               rig.pushes = false;
               rig.run(65);
           },
           Fault::stale_command);
    reacts([](auto& s) -> Reaction& { return s.emergency_stop_reaction; },
           [](Rig& rig) {
               rig.stop_line.level = hal::LineLevel::active;
               rig.run(1);
           },
           Fault::emergency_stop_line);
    reacts([](auto& s) -> Reaction& { return s.overrun_reaction; }, [](Rig& rig) { rig.step(3); },
           Fault::cycle_overrun);
    reacts([](auto& s) -> Reaction& { return s.terminate_reaction; },
           [](Rig& rig) {
               rig.cycle.request_termination();
               rig.run(1);
           },
           Fault::terminated);
}

TEST(WholeCycle, a_ramp_ends_after_the_time_of_the_robot_file_or_of_its_own_reckoning) {
    const auto cycles_of_ramp = [](double timeout_s, double speed_m_per_s) {
        model::RobotParameters p = quick_robot();
        p.safety.ramp_timeout_s = timeout_s;
        p.limits.speed_m_per_s = speed_m_per_s;
        p.limits.yaw_rate_rad_per_s = 0.1;
        p.limits.acceleration_m_per_s2 = 0.5;
        p.dynamics.k7_per_kg_m = 0.8;
        p.dynamics.k8_per_kg_m2 = 10;
        Rig rig(p);
        rig.drive();
        rig.ask(Mode::idle);
        int cycles = 0;
        double position = 0;
        for (; cycles < 100'000; ++cycles) {  // it rolls on, whatever the brakes do
            position += 0.5e-3;
            for (FakeDrive* drive : {&rig.left, &rig.right}) {
                drive->told.position_rad = position;
                drive->told.speed_rad_per_s = 0.5;
            }
            rig.step();
            if (!rig.cycle.supervisor().wants_armed()) break;
        }
        return cycles;
    };
    DOUBLES_EQUAL(200, cycles_of_ramp(0.2, 1), 2);
    DOUBLES_EQUAL(2 * 2000 + 500, cycles_of_ramp(0, 1), 2);  // twice 1 m/s at 0.5 m/s^2, and half a second
    DOUBLES_EQUAL(60'000, cycles_of_ramp(0, 20), 2);
}

TEST(WholeCycle, a_drive_that_does_not_arm_is_given_up_after_half_as_much_again_as_it_may_take) {
    model::RobotParameters p = quick_robot();
    p.drive.arming_timeout_s = 0.2;
    Rig rig(p);
    rig.right.obeys = false;
    rig.ask(Mode::torque);
    rig.run(299);
    CHECK(rig.fault() == Fault::none);
    rig.run(5);
    CHECK(rig.fault() == Fault::arming_refused);
}

TEST(WholeCycle, parameters_are_answered_and_take_effect_in_idle_only) {
    Rig rig;
    const auto ask = [&](protocol::ParameterOperation operation, std::uint16_t index = 0, float value = 0) {
        protocol::ParameterRequest request;
        request.operation = operation;
        request.index = index;
        request.value = value;
        rig.say(request);
        for (int i = 0; i < 10; ++i) {
            rig.run(1);
            const auto replies = rig.bus.take(protocol::ParameterReply::id);
            protocol::ParameterReply reply;
            if (!replies.empty() && protocol::ParameterReply::decode({replies[0].data.data(), 8}, reply) ==
                                        protocol::CodecStatus::ok) {
                CHECK(reply.operation == operation);
                return reply.result;
            }
        }
        FAIL("no reply");
        return protocol::ParameterResult::not_now;
    };
    using Operation = protocol::ParameterOperation;
    using Result = protocol::ParameterResult;
    constexpr std::uint16_t kTorqueLimit = 0x0010;
    CHECK(ask(Operation::read, kTorqueLimit) == Result::ok);
    CHECK(ask(Operation::read, 0x7FFF) == Result::unknown_index);
    CHECK_EQUAL(1U, rig.count(protocol::CounterCause::unknown_parameter));
    CHECK(ask(Operation::write, kTorqueLimit, 0.0125F) == Result::ok);
    CHECK(ask(Operation::commit) == Result::ok);
    CHECK(ask(Operation::save) == Result::save_started);
    CHECK(rig.mailbox.take() != nullptr);
    rig.mailbox.finished(true);
    bool told = false;
    for (int i = 0; i < 10; ++i) {
        rig.run(1);
        told = told || !rig.bus.take(protocol::ParameterReply::id).empty();
    }
    CHECK(told);
    rig.drive();
    CHECK_EQUAL(12, rig.sent_mNm(kLeft));  // the new limit
    CHECK_EQUAL(-12, rig.sent_mNm(kRight));
    CHECK(ask(Operation::write, kTorqueLimit, 0.5F) == Result::ok);
    CHECK(ask(Operation::commit) == Result::not_now);
    CHECK_EQUAL(1U, rig.count(protocol::CounterCause::unknown_parameter));
    rig.pushes = false;
    rig.run(200);  // a fault is no idle
    CHECK(rig.fault() != Fault::none);
    CHECK(ask(Operation::commit) == Result::not_now);
    // Nor is a robot that arms.
    Rig arming;
    arming.right.obeys = false;
    arming.ask(Mode::torque);
    arming.run(3);
    CHECK(arming.cycle.supervisor().mode() == Mode::idle);
    protocol::ParameterRequest write;
    write.operation = Operation::write;
    write.index = kTorqueLimit;
    write.value = 0.5F;
    arming.say(write);
    write.operation = Operation::commit;
    arming.say(write);
    arming.run(3);
    DOUBLES_EQUAL(1, arming.parameters.limits.torque_Nm, 0);
}

TEST(WholeCycle, clearing_goes_to_both_drives_and_a_refused_mode_is_counted) {
    Rig rig;
    rig.ask(Mode::velocity);  // not identified
    rig.run(2);
    CHECK_EQUAL(1U, rig.count(protocol::CounterCause::rejected_mode_not_allowed));
    rig.left.now = DriveState::fault;
    rig.say(protocol::ClearFault{});
    rig.run(1);
    CHECK_EQUAL(1, rig.left.clears);
    CHECK_EQUAL(1, rig.right.clears);
    rig.run(10);
    CHECK_EQUAL(1, rig.left.clears);
    CHECK_EQUAL(1U, rig.count(protocol::CounterCause::rejected_mode_not_allowed));
}

// Torques in the cycle of the stop, idle in the next one.
TEST(WholeCycle, a_stop_does_not_wait_for_its_phase_nor_behind_telemetry) {
    for (const bool separate : {false, true}) {
        Rig rig(quick_robot(), separate, true);
        const std::int64_t phase_ns = rig.cycle.send_phase_ns();
        rig.drive();
        protocol::ParameterRequest read;
        read.operation = protocol::ParameterOperation::read;
        for (int i = 0; i < 8; ++i) rig.say(read);  // an answer for each cycle
        rig.run(1);
        const auto answers = [&rig] { return rig.host.take(protocol::ParameterReply::id).size(); };
        CHECK_EQUAL(1U, answers());
        LONGS_EQUAL(phase_ns, rig.cycle.send_phase_ns());
        rig.stop_line.level = hal::LineLevel::active;
        for (int i = 0; i < 2; ++i) {
            rig.run(1);
            CHECK(rig.fault() == Fault::emergency_stop_line);
            LONGS_EQUAL(0, rig.cycle.send_phase_ns());
            CHECK_EQUAL(separate ? 1U : 0U, answers());
        }
        rig.run(1);
        LONGS_EQUAL(phase_ns, rig.cycle.send_phase_ns());
        CHECK_EQUAL(1U, answers());
    }
}

// Where the other drive's torque is still on its way, its zero would leave a cycle later than this one's.
TEST(WholeCycle, one_zero_may_stand_behind_an_old_torque) {
    for (const std::uint32_t jammed : {kLeft, kRight}) {
        Rig rig;
        rig.drive();
        rig.bus.waiting = jammed;
        rig.run(1);
        CHECK_EQUAL(-128, rig.sent_mNm(jammed));
        for (int again = 0; again < 2; ++again) {
            rig.pushes = false;
            for (const bool left : {true, false}) {  // one wheel's is none
                rig.push(left ? 0 : 0.02, left ? 0.02 : 0);
                rig.run(1);
                CHECK_EQUAL(-128, rig.sent_mNm(jammed));
            }
            rig.push(0, 0);
            rig.run(1);
            CHECK_EQUAL(0, rig.sent_mNm(jammed));
            rig.push(0, 0);
            rig.run(1);
            CHECK_EQUAL(-128, rig.sent_mNm(jammed));
            rig.push();
            rig.run(1);
            CHECK_EQUAL(-128, rig.sent_mNm(jammed));  // the zero is the last word while they wait
            rig.push(0, 0);
            rig.run(1);
            CHECK_EQUAL(-128, rig.sent_mNm(jammed));
            rig.bus.waiting = 0xFFFF;
            rig.push();
            rig.run(1);
            CHECK_EQUAL(jammed == kLeft ? 20 : -30, rig.sent_mNm(jammed));
            rig.bus.waiting = jammed;
        }
        CHECK(rig.fault() == Fault::none);
    }
}

TEST(WholeCycle, the_longest_wake_up_latency_is_told_once) {
    Rig rig;
    rig.late_ns = 700'000;
    rig.step();
    rig.run(1);
    DOUBLES_EQUAL(700, rig.cycle.report().timing.wake_latency_max_us, 1e-9);
    bool told = false;
    for (int i = 0; i < 300 && !told; ++i) {
        rig.run(1);
        told = !rig.bus.take(protocol::Timing::id).empty();
    }
    CHECK(told);
    DOUBLES_EQUAL(0, rig.cycle.report().timing.wake_latency_max_us, 1e-9);
    LONGS_EQUAL(std::llround(rig.parameters.realtime.send_phase_s * 1e9), rig.cycle.send_phase_ns());
}

TEST(WholeCycle, the_longest_computing_time_is_told) {
    Rig rig;
    for (const std::int64_t ran_ns : {200'000, 300'000, 100'000}) {
        rig.ran_ns = ran_ns;
        rig.step();
    }
    DOUBLES_EQUAL(300, rig.cycle.report().timing.execution_max_us, 1e-9);
}

TEST(WholeCycle, the_load_of_a_bus_of_the_hosts_own_is_told) {
    Rig rig(quick_robot(), true);
    rig.pushes = true;
    rig.run(3000);
    CHECK(rig.cycle.report().bus_load.host_bus_load_percent > 5);
}

// Of an unknown robot that is 80 cycles of more than a quarter of the torque limit each way, and a tenth.
TEST(WholeCycle, wheels_that_stand_against_torque_are_counted_anew_when_somebody_drives_again) {
    for (const double torque_Nm : {0.7, 0.55}) {
        Rig rig;
        const auto drive = [&](int cycles) {
            rig.ask(Mode::torque);
            for (int i = 0; i < cycles; ++i) {
                rig.push(torque_Nm, torque_Nm);
                rig.run(1);
            }
        };
        for (int i = 0; i < 3; ++i) {
            drive(60);
            CHECK(rig.cycle.supervisor().may_drive());
            rig.ask(Mode::idle);
            rig.run(700);
            CHECK(rig.fault() == Fault::none);
            CHECK_FALSE(rig.cycle.supervisor().may_drive());
        }
        drive(100);
        CHECK(rig.fault() == (torque_Nm > 0.6 ? Fault::encoder_implausible : Fault::none));
    }
}

// A probe says itself why the wheels do not turn.
TEST(WholeCycle, an_identification_of_wheels_that_stand_ends_with_its_own_cause) {
    Rig rig;
    rig.ask(Mode::ident);
    rig.run(4);
    CHECK(rig.cycle.supervisor().may_drive());
    for (int i = 0; i < 10'000 && rig.cycle.supervisor().mode() != Mode::idle; ++i) {
        rig.run(1);
        if (i % 100 == 0) rig.say(protocol::HostAlive{});
    }
    CHECK(rig.fault() == Fault::none);
    STRCMP_EQUAL("too_heavy", std::string(to_string_view(rig.cycle.learning().run().cause())).c_str());
}

TEST(WholeCycle, a_set_point_of_before_does_not_act_in_a_mode_that_is_entered) {
    Rig rig;
    rig.push();
    rig.run(3);
    rig.ask(Mode::torque);
    rig.run(5);
    CHECK(rig.cycle.supervisor().may_drive());
    CHECK_EQUAL(0, rig.sent_mNm(kLeft));
}

namespace {
model::RobotParameters known_robot() {
    model::RobotParameters p = quick_robot();
    p.dynamics = {0.01, 0.1, 0.5, 3};
    p.dynamics_standard_error = {0.001, 0.01, 0.005, 0.03};
    return p;
}
}  // namespace

// Where K5 is no number the velocity law's torque is none either.
TEST(WholeCycle, a_torque_that_is_no_number_is_a_fault) {
    for (const bool broken : {false, true}) {
        model::RobotParameters p = known_robot();
        if (broken) p.dynamics.k5_m = std::nan("");
        Rig rig(p);
        protocol::VelocityCommand velocity;
        velocity.forward_speed_m_per_s = 0.1;
        rig.ask(Mode::velocity);
        for (int i = 0; i < 4; ++i) {
            rig.say(velocity);
            rig.run(1);
        }
        CHECK(rig.fault() == (broken ? Fault::internal_error : Fault::none));
        CHECK_EQUAL(!broken, rig.cycle.supervisor().may_drive());
    }
}

// At start-up there is time for it: the first cycle's host may drive.
TEST(WholeCycle, the_loops_of_a_known_robot_are_designed_before_the_first_cycle) {
    Rig rig(known_robot());
    CHECK(rig.cycle.conditions().velocity_design_accepted);
}

// It takes some tens of cycles.
TEST(WholeCycle, a_path_is_driven_once_its_pace_is_known) {
    Rig rig(known_robot());
    protocol::TrajectoryCommand figure;
    figure.shape = protocol::TrajectoryShape::figure_eight;
    figure.length_m = 3;
    rig.say(figure);
    rig.ask(Mode::trajectory);
    int waited = 0;
    for (int i = 0; i < 500 && !rig.cycle.supervisor().may_drive(); ++i) {
        rig.run(1);
        if (rig.cycle.control().pace().running()) {
            ++waited;
            CHECK_FALSE(rig.cycle.supervisor().may_drive());
        }
    }
    CHECK(rig.cycle.supervisor().may_drive());
    CHECK(waited > 3);
}
