// The driver and the simulated drive, each written from the protocol, on one bus.
#include <cmath>
#include <cstdio>

#include "drivers/drive_catalogue.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "sim_hal/world.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::drivers;

namespace {

constexpr std::int64_t kMs = 1'000'000;

model::RobotParameters parameters(int generation) {
    model::RobotParameters p = model::default_parameters();
    p.drive.generation = generation;
    p.drive.watchdog_assured = generation == 5;
    p.drive.watchdog_endpoint = generation == 5 ? 0 : 391;
    p.drive.left.sign = -1;
    p.drive.left.node = 5;
    p.drive.right.gear_ratio = 7.5;
    p.drive.right.torque_constant_Nm_per_A = 0.051;
    p.dynamics = {0.037, model::coupled_k6(0.037, 1.31, 6.1, 0.32), 1.31, 6.1};
    return p;
}

// A 1 kHz cycle with two drivers against the simulated robot, 0.2 ms of receive latency on both sides.
struct Bench {
    explicit Bench(const model::RobotParameters& p, const sim::WorldOptions& options = {})
        : bus(clock, 2, bus_options()),
          world(p, options, bus.endpoint(1)),
          robot(clock, bus, bus.endpoint(1), world),
          left(*make_drive(left_slot, p, Wheel::left)),
          right(*make_drive(right_slot, p, Wheel::right)),
          sink(bus.endpoint(0)) {}

    static sim::InProcessBusOptions bus_options() {
        sim::InProcessBusOptions options;
        options.receive_latency_ns = 200'000;
        return options;
    }

    void cycle(double left_Nm = 0, double right_Nm = 0) {
        hal::ReceivedFrame received;
        while (bus.endpoint(0).receive(received) == hal::CanStatus::ok) {
            if (!left.accept(received)) CHECK(right.accept(received));
        }
        left.update(clock.now_ns(), sink);
        right.update(clock.now_ns(), sink);
        left.command_torque(left_Nm, sink);
        right.command_torque(right_Nm, sink);
        clock.sleep_until_ns(clock.now_ns() + kMs);
    }
    void cycles(int n, double left_Nm = 0, double right_Nm = 0) {
        for (int i = 0; i < n; ++i) cycle(left_Nm, right_Nm);
    }
    int arm() {
        cycles(120);
        left.request_arm();
        right.request_arm();
        int taken = 0;
        while (taken < 500 && (left.state() != DriveState::armed || right.state() != DriveState::armed)) {
            cycle();
            ++taken;
        }
        CHECK(left.state() == DriveState::armed && right.state() == DriveState::armed);
        CHECK(world.left().armed() && world.right().armed());
        return taken;
    }

    struct Sink final : FrameSink {
        explicit Sink(hal::CanBus& to) : bus(to) {}
        void push(const hal::CanFrame& frame) override { CHECK(bus.send(frame) == hal::CanStatus::ok); }
        hal::CanBus& bus;
    };

    sim::VirtualClock clock;
    sim::InProcessBus bus;
    sim::World world;
    sim::VirtualRobot robot;
    DriveSlot left_slot;
    DriveSlot right_slot;
    MotorDrive& left;
    MotorDrive& right;
    Sink sink;
};

}  // namespace

TEST_GROUP(OdriveAgainstSim){};

TEST(OdriveAgainstSim, both_generations_arm_and_stay_armed) {
    for (const int generation : {5, 6}) {
        Bench b(parameters(generation));
        const int taken = b.arm();
        std::printf("generation 0.%d armed in %d ms\n", generation, taken);
        // A heartbeat period and the steps; where the watchdog runs while idle, the heartbeat's time-out too.
        CHECK(taken < (generation == 5 ? 130 + 350 : 130));
        b.cycles(1000, 0.1, 0.1);
        CHECK(b.left.state() == DriveState::armed && b.right.state() == DriveState::armed);
        CHECK_EQUAL(0U, b.world.left().bad_frames() + b.world.right().bad_frames());
        b.left.request_disarm();
        b.right.request_disarm();
        b.cycles(110);
        CHECK(b.left.state() == DriveState::idle && b.right.state() == DriveState::idle);
        CHECK(!b.world.left().armed() && !b.world.right().armed());
    }
}

TEST(OdriveAgainstSim, wheel_torque_asked_is_wheel_torque_delivered_and_reported) {
    for (const int generation : {5, 6}) {
        sim::WorldOptions o;
        o.torque_noise_Nm = 0;
        Bench b(parameters(generation), o);
        b.arm();
        b.cycles(30, 1.3, -0.7);
        DOUBLES_EQUAL(1.3, b.world.plant().torques().motor_Nm.left, 1e-6);
        DOUBLES_EQUAL(-0.7, b.world.plant().torques().motor_Nm.right, 1e-6);
        DOUBLES_EQUAL(1.3, b.left.feedback().torque_Nm, 1e-6);
        DOUBLES_EQUAL(-0.7, b.right.feedback().torque_Nm, 1e-6);
    }
}

TEST(OdriveAgainstSim, reported_angles_and_speeds_are_the_wheels) {
    Bench b(parameters(6));
    b.arm();
    b.cycles(150, 0.9, 0.6);
    b.cycles(150, 0, 0);
    const WheelPair<double> angle = b.world.plant().wheel_angle_rad();
    const WheelPair<double> speed = b.world.plant().wheel_speed_rad_per_s();
    // Up to 1.5 ms and the filter's 2 ms old at some 10 rad/s; noise 0.04 rad/s.
    DOUBLES_EQUAL(angle.left, b.left.feedback().position_rad, 0.002 * std::fabs(speed.left) + 0.001);
    DOUBLES_EQUAL(angle.right, b.right.feedback().position_rad, 0.002 * std::fabs(speed.right) + 0.001);
    DOUBLES_EQUAL(speed.left, b.left.feedback().speed_rad_per_s, 0.2);
    DOUBLES_EQUAL(speed.right, b.right.feedback().speed_rad_per_s, 0.2);
    CHECK(b.clock.now_ns() - b.left.feedback().encoder_time_ns < 2 * kMs + kMs / 2);
}

TEST(OdriveAgainstSim, a_drive_whose_watchdog_is_off_is_refused) {
    sim::WorldOptions o;
    o.watchdog_enabled = false;
    Bench b(parameters(6), o);
    b.cycles(120);
    b.left.request_arm();
    b.cycles(200);
    CHECK(b.left.refusal() == ArmRefusal::watchdog_not_confirmed);
    CHECK(b.left.state() == DriveState::idle);
    CHECK(!b.world.left().armed());
}

TEST(OdriveAgainstSim, each_fault_of_the_drive_is_seen_within_a_heartbeat_or_its_time_out) {
    for (const int generation : {5, 6}) {
        struct Case {
            const char* name;
            void (*happen)(sim::SimOdrive&);
            DriveFault fault;
            int within_ms;
        };
        const Case cases[] = {
            // NOLINT(*-avoid-c-arrays)
            {"error bit", [](sim::SimOdrive& d) { d.raise_error(0x100); }, DriveFault::error, 105},
            {"drops out, error 0", [](sim::SimOdrive& d) { d.drop_out(); }, DriveFault::left_armed, 105},
            {"unplugged", [](sim::SimOdrive& d) { d.faults().motor_unplugged = true; },
             DriveFault::left_armed, 105},
            {"mute", [](sim::SimOdrive& d) { d.faults().mute = true; }, DriveFault::silent, 355},
            {"switched off", [](sim::SimOdrive& d) { d.faults().powered_off = true; }, DriveFault::silent,
             355},
            {"deaf", [](sim::SimOdrive& d) { d.faults().deaf = true; }, DriveFault::error, 160},
        };
        for (const Case& each : cases) {
            Bench b(parameters(generation));
            b.arm();
            b.cycles(100, 0.2, 0.2);
            each.happen(b.world.left());
            int taken = 0;
            while (b.left.state() == DriveState::armed && taken < 1000) {
                b.cycle(0.2, 0.2);
                ++taken;
            }
            std::printf("0.%d %s: %d ms\n", generation, each.name, taken);
            CHECK(taken <= each.within_ms);
            CHECK(b.left.fault() == each.fault);
            CHECK(b.right.state() == DriveState::armed);
        }
    }
}

TEST(OdriveAgainstSim, a_cleared_fault_arms_again) {
    for (const int generation : {5, 6}) {
        Bench b(parameters(generation));
        b.arm();
        b.world.left().raise_error(0x200);
        b.cycles(120);
        CHECK(b.left.state() == DriveState::fault);
        b.right.request_disarm();
        b.left.request_clear_errors();
        b.cycles(220);
        CHECK(b.left.state() == DriveState::idle);
        b.arm();
    }
}

TEST(OdriveAgainstSim, lost_frames_of_the_arming_are_sent_again_or_end_in_a_refusal_and_an_idle_drive) {
    // Each step's frame lost in turn: 0x18, 0x0B, 0x0E, 0x04, 0x07 of node 5; once, and always.
    for (const auto& [command, lost] :
         {std::pair{0x18U, 1U}, {0x0BU, 1U}, {0x0EU, 1U}, {0x04U, 1U}, {0x07U, 1U}, {0x07U, 1'000'000U}}) {
        Bench b(parameters(6));
        b.cycles(120);
        sim::FaultRule rule;
        rule.action = sim::FaultAction::drop;
        rule.id = 5U << 5U | command;
        rule.mask = 0x7FF;
        rule.count = lost;
        b.bus.add_fault(rule);
        b.left.request_arm();
        b.cycles(2300);
        // What the lost frame would have set was already so, or it is asked again, or arming gives up.
        const bool armed = b.left.state() == DriveState::armed;
        CHECK_EQUAL(armed, b.world.left().armed());
        CHECK(armed || b.left.refusal() == ArmRefusal::timed_out);
        CHECK_EQUAL(lost > 1, !armed);
    }
}
