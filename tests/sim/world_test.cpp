// The whole simulated robot on the in-process bus, commanded by frames written here.
#include <cmath>
#include <cstdio>
#include <cstring>

#include "firmware/model/robot_parameters.hpp"
#include "sim_hal/world.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

constexpr std::int64_t kMs = 1'000'000;

model::RobotParameters truth() {
    model::RobotParameters p = model::default_parameters();
    p.geometry = {{0.0743, 0.0761}, 0.327};
    p.dynamics = {0.037, model::coupled_k6(0.037, 1.31, 6.1, 0.327), 1.31, 6.1};
    p.drive.left.sign = -1;
    p.drive.right.gear_ratio = 7.5;
    p.drive.watchdog_timeout_s = 0.05;
    return p;
}

model::RobotParameters with_friction(double left, double right) {
    model::RobotParameters p = truth();
    const std::size_t dry = model::find_effect("coulomb_friction");
    p.effects.active[dry] = true;
    p.effects.parameter[dry] = {left, right};
    return p;
}

sim::WorldOptions quiet() {
    sim::WorldOptions o;
    o.torque_noise_Nm = 0;
    o.encoder_noise_rad = 0;
    o.external_pose_noise_m = 0;
    o.external_heading_noise_rad = 0;
    o.phase_ns = {300'000, 600'000};  // telemetry keeps out of the way of commands sent at whole milliseconds
    return o;
}

// FNV-1a over each frame on the wire, times included.
struct Hash final : sim::BusTap {
    void on_frame(const sim::WireEvent& event) override {
        add(static_cast<std::uint64_t>(event.end_ns));
        add(event.frame->id);
        for (std::size_t i = 0; i < event.frame->length; ++i) add(event.frame->data[i]);
        ++frames;
    }
    void add(std::uint64_t x) { value = (value ^ x) * 0x100000001B3U; }
    std::uint64_t value = 0xCBF29CE484222325U;
    int frames = 0;
};

struct Bench {
    Bench(const model::RobotParameters& p, const sim::WorldOptions& options)
        : bus(clock, 2), world(p, options, bus.endpoint(1)), robot(clock, bus, bus.endpoint(1), world) {
        bus.add_tap(hash);
    }

    void send(std::uint32_t id, std::uint32_t first, std::uint32_t second, std::uint8_t length) {
        hal::CanFrame frame;
        frame.id = id;
        frame.length = length;
        std::memcpy(frame.data.data(), &first, 4);
        std::memcpy(frame.data.data() + 4, &second, 4);
        CHECK(bus.endpoint(0).send(frame) == hal::CanStatus::ok);
    }
    void torque(std::uint32_t node, double motor_Nm) {
        const float value = static_cast<float>(motor_Nm);
        std::uint32_t bits = 0;
        std::memcpy(&bits, &value, 4);
        send(node << 5U | 0x0EU, bits, 0, 8);
    }
    // Wheel torques, as somebody does who knows the gears and signs.
    void command(double left_Nm, double right_Nm) {
        torque(1, -left_Nm / 8);
        torque(2, right_Nm / 7.5);
    }
    void ms(int n) {
        for (int i = 0; i < n; ++i) {
            clock.sleep_until_ns(clock.now_ns() + kMs);
            hal::ReceivedFrame received;
            while (bus.endpoint(0).receive(received) == hal::CanStatus::ok) {
            }
        }
    }
    void drive(int n, double left_Nm, double right_Nm) {
        for (int i = 0; i < n; ++i) {
            command(left_Nm, right_Nm);
            ms(1);
        }
    }
    void arm() {
        for (const std::uint32_t node : {1U, 2U}) {
            send(node << 5U | 0x18U, 0, 0, 1);
            send(node << 5U | 0x0BU, 1, 1, 8);
            torque(node, 0);
            send(node << 5U | 0x07U, 8, 0, 4);
        }
        drive(8, 0, 0);
        CHECK(world.left().armed() && world.right().armed());
    }

    sim::VirtualClock clock;
    sim::InProcessBus bus;
    Hash hash;
    sim::World world;
    sim::VirtualRobot robot;
};

}  // namespace

TEST_GROUP(SimWorld){};

TEST(SimWorld, a_torque_on_the_bus_moves_the_robot_after_wire_latency_and_lag) {
    model::RobotParameters p = truth();
    p.dynamics.k5_m = p.dynamics.k6_per_m = 0;
    p.geometry.wheel_radius_m = {0.075, 0.075};
    p.drive.torque_period_ms = 0;
    Bench b(p, quiet());
    b.arm();
    const std::int64_t start = b.clock.now_ns();
    b.drive(40, 0.8, 0.8);
    // Two frames on the wire one after the other (132 us and 135 us apart at 1 Mbit/s, worst-case stuffing),
    // 0.2 ms in the drive, 0.5 ms of lag: v = K7 sum(tau (t - delay)), the lag being settled.
    const double t = static_cast<double>(b.clock.now_ns() - start) * 1e-9;
    const double left = 0.8 * (t - 132e-6 - 0.0002 - 0.0005);
    const double right = 0.8 * (t - 267e-6 - 0.0002 - 0.0005);
    DOUBLES_EQUAL(1.31 * (left + right), b.world.twist().v_m_per_s, 5e-6);
    DOUBLES_EQUAL(6.1 * (right - left), b.world.twist().omega_rad_per_s, 1e-4);
    DOUBLES_EQUAL(0.8, b.world.left().torque_target_Nm(), 1e-6);
    DOUBLES_EQUAL(0.8, b.world.plant().torques().motor_Nm.right, 1e-6);
}

TEST(SimWorld, the_watchdogs_stop_the_wheels_when_the_host_dies) {
    Bench b(with_friction(0.3, 0.25), quiet());
    b.arm();
    b.drive(150, 1.2, 1.1);
    const double speed = b.world.twist().v_m_per_s;
    CHECK(speed > 0.2);
    b.ms(60);
    CHECK(!b.world.left().armed() && !b.world.right().armed());
    DOUBLES_EQUAL(0, b.world.plant().torques().motor_Nm.left, 0);
    b.ms(3000);
    CHECK(b.world.plant().at_rest());
}

TEST(SimWorld, a_parked_robot_with_noisy_drives_does_not_move_one_bit) {
    sim::WorldOptions o;
    o.start_pose = {1, 2, 0.5};
    Bench b(with_friction(0.3, 0.25), o);
    b.arm();
    b.drive(2000, 0.1, -0.1);
    const Pose<double> start{1, 2, 0.5};
    CHECK_EQUAL(0, std::memcmp(&start, &b.world.pose(), sizeof start));
}

TEST(SimWorld, the_same_seed_gives_the_same_bytes_and_another_seed_other_ones) {
    const auto hash = [](std::uint64_t seed) {
        sim::WorldOptions o;
        o.seed = seed;
        Bench b(with_friction(0.3, 0.25), o);
        b.arm();
        for (int i = 0; i < 400; ++i) {
            b.command(2 * std::sin(i * 0.05), 1.7 * std::sin(i * 0.043));
            b.ms(1);
        }
        b.hash.add(static_cast<std::uint64_t>(b.hash.frames));
        return b.hash.value;
    };
    const std::uint64_t first = hash(11);
    std::printf("hash of seed 11: %016llx\n", static_cast<unsigned long long>(first));
    CHECK(first == hash(11));
    CHECK(first != hash(12));
}

TEST(SimWorld, the_external_pose_comes_at_its_rate_with_noise_and_delay) {
    sim::WorldOptions o;
    o.external_pose_rate_Hz = 200;
    o.external_pose_delay_s = 0.012;
    o.start_pose = {3, -1, 0.4};
    Bench b(truth(), o);
    double square_position = 0;
    double square_heading = 0;
    int count = 0;
    for (int i = 0; i < 20'000; ++i) {
        b.ms(1);
        sim::ExternalPose pose;
        while (b.world.take_external_pose(pose)) {
            ++count;
            CHECK_EQUAL(count * 5 * kMs, pose.sample_time_ns);
            CHECK_EQUAL(pose.sample_time_ns + 12 * kMs, pose.ready_time_ns);
            CHECK_EQUAL(b.clock.now_ns(), pose.ready_time_ns);
            square_position += std::pow(pose.pose.x_m - 3, 2) + std::pow(pose.pose.y_m + 1, 2);
            square_heading += std::pow(pose.pose.heading_rad - 0.4, 2);
        }
    }
    CHECK_EQUAL(3997, count);
    DOUBLES_EQUAL(0.002, std::sqrt(square_position / (2 * count)), 0.0001);
    DOUBLES_EQUAL(0.004, std::sqrt(square_heading / count), 0.0003);
    CHECK_EQUAL(0U, b.world.totals().poses_lost);
}

TEST(SimWorld, clearing_one_axis_of_a_0_5_board_clears_both) {
    model::RobotParameters p = truth();
    p.drive.generation = 5;
    Bench b(p, quiet());
    b.world.left().raise_error(0x40);
    b.world.right().raise_error(0x40);
    b.send(1U << 5U | 0x18U, 0, 0, 0);
    b.ms(1);
    CHECK_EQUAL(0U, b.world.left().error_bits());
    CHECK_EQUAL(0U, b.world.right().error_bits());
}

TEST(SimWorld, a_payload_dropped_on_while_driving_changes_the_acceleration_only) {
    model::RobotParameters p = truth();
    p.dynamics.k5_m = p.dynamics.k6_per_m = 0;
    p.geometry.wheel_radius_m = {0.075, 0.075};
    Bench b(p, quiet());
    b.arm();
    b.drive(100, 0.5, 0.5);
    const double v0 = b.world.twist().v_m_per_s;
    b.drive(100, 0.5, 0.5);
    const double v1 = b.world.twist().v_m_per_s;
    const sim::PlantParameters& q = b.world.plant().parameters();
    b.world.plant().add_payload({0.3 * q.mass_kg, 0.3 * q.inertia_kg_m2, 0, 0});
    DOUBLES_EQUAL(v1, b.world.twist().v_m_per_s, 0);
    b.drive(100, 0.5, 0.5);
    DOUBLES_EQUAL(1.3, (v1 - v0) / (b.world.twist().v_m_per_s - v1), 0.001);
}

TEST(SimWorld, the_robot_files_effects_are_the_robots) {
    model::RobotParameters p = truth();
    p.dynamics.k5_m = p.dynamics.k6_per_m = 0;
    p.geometry.wheel_radius_m = {0.075, 0.075};
    const auto add = [&](const char* name, const model::Parameters<double>& parameters) {
        p.effects.active[model::find_effect(name)] = true;
        p.effects.parameter[model::find_effect(name)] = parameters;
    };
    add("torque_saturation", {0.4});
    const double mass = 1 / (1.31 * 0.075);
    add("payload_step", {0.2, 0.5 * mass, 0.01});
    add("encoder_quantisation", {2048});
    add("measurement_lag", {0.03});
    Bench b(p, quiet());
    b.arm();
    b.drive(60, 0.9, 0.9);
    const double v0 = b.world.twist().v_m_per_s;
    b.drive(100, 0.9, 0.9);
    const double v1 = b.world.twist().v_m_per_s;
    DOUBLES_EQUAL(1.31 * 0.8 * 0.1, v1 - v0, 1e-9);
    b.drive(60, 0.9, 0.9);
    const double v2 = b.world.twist().v_m_per_s;
    b.drive(100, 0.9, 0.9);
    DOUBLES_EQUAL(1.31 / 1.5 * 0.8 * 0.1, b.world.twist().v_m_per_s - v2, 1e-9);
    DOUBLES_EQUAL(2048, b.world.left().config().report_counts_per_wheel_turn, 0);
    DOUBLES_EQUAL(0.03, b.world.right().config().report_lag_s, 0);
}

TEST(SimWorld, after_a_pause_of_the_machine_old_telemetry_is_not_sent_in_a_burst) {
    Bench b(truth(), quiet());
    b.ms(20);
    const std::uint64_t sent = b.world.totals().frames_sent;
    b.clock.set_sleeper(nullptr);
    b.clock.sleep_until_ns(b.clock.now_ns() + 1000 * kMs);
    b.world.pump(b.clock.now_ns());
    CHECK(b.world.totals().frames_sent - sent <= 16);
    CHECK(b.world.totals().frames_lost > 1900);
    CHECK_EQUAL(b.clock.now_ns(), b.world.now_ns());
}
