// Encoders that lie, one test for each way, and what is no lie. Judged like trust_test.cpp on the robot's
// true motion and torque.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>

#include "tests/chain/scene.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace chain;

TEST_GROUP(ChainEncoders){};

namespace {

constexpr double kBound_s = 0.1;

// A robot that drives so, on buses that may be falsified.
struct Driven {
    Simulation sim;

    Driven(const Layout& layout, const Twist<double>& wanted)
        : sim(identified(), real().parameters, options(layout)) {
        sim.run_for(0.3);
        sim.host().velocity(wanted);
        CHECK(enter_mode(sim, Mode::velocity));
        sim.run_for(0.5);
    }
    static SimulationOptions options(const Layout& layout) {
        SimulationOptions o = Scene::options(layout, 37);
        o.faulty_buses = true;
        return o;
    }
    sim::SimOdrive& drive(std::size_t side) { return sim.world().drive(side); }
    double torque_Nm() {
        return std::max(std::abs(sim.world().left().torque_target_Nm()),
                        std::abs(sim.world().right().torque_target_Nm()));
    }
    Fault fault() const { return sim.cycle().supervisor().fault(); }

    // What the firmware hears of the position of that side's wheel, in turns of the motor.
    void tells(const Layout& layout, const std::function<float(float)>& what) {
        const std::uint32_t id = encoder_frame(layout.side, 0, 0).id;
        sim.faulty_bus(Simulation::Node::firmware).on_receive([id, what](hal::ReceivedFrame& r) {
            if (r.frame.id != id) return sim::FaultyBus::Deal::pass;
            float position_rev = 0;
            std::memcpy(&position_rev, r.frame.data.data(), 4);
            position_rev = what(position_rev);
            std::memcpy(r.frame.data.data(), &position_rev, 4);
            return sim::FaultyBus::Deal::pass;
        });
    }

    // When torque was last seen in this time.
    double last_torque_s(double duration_s) {
        double last_s = 0;
        const double start_s = sim.time_s();
        sim.run_for(duration_s, [&] {
            if (torque_Nm() > 0) last_s = sim.time_s() - start_s;
        });
        return last_s;
    }
};

// The lie ends in a fault of that name, in time, at each of these speeds.
void ends_in_time(const char* what, Fault name, double bound_s, std::initializer_list<double> speeds,
                  const std::function<void(Driven&, const Layout&)>& lie, double yaw_rate = 0) {
    double longest_s = 0;
    for_each_layout([&](const Layout& layout) {
        for (const double speed : speeds) {
            Driven robot(layout, {layout.way * speed, layout.way * yaw_rate});
            lie(robot, layout);
            const double last_s = robot.last_torque_s(0.4);
            longest_s = std::max(longest_s, last_s);
            const std::string text = layout.name() + ", at " + std::to_string(speed) + " m/s: torque for " +
                                     std::to_string(last_s) + " s, fault " +
                                     std::to_string(int(robot.fault()));
            CHECK_TEXT(robot.fault() == name, text.c_str());
            CHECK_TEXT(last_s <= bound_s, text.c_str());
        }
    });
    std::printf("  %s: torque for %.0f ms at most\n", what, 1e3 * longest_s);
}

}  // namespace

TEST(ChainEncoders, frames_that_are_all_wild_are_no_feedback) {
    ends_in_time("wild", Fault::stale_feedback, identified().safety.stale_feedback_s + 0.003, {0.0, 0.5},
                 [](Driven& robot, const Layout& layout) {
                     robot.tells(layout, [wild = 1.F](float position) mutable {
                         wild *= -1.7F;
                         return position + 100 * wild;
                     });
                 });
}

TEST(ChainEncoders, one_that_counts_the_other_way_is_seen) {
    ends_in_time("other way", Fault::encoder_implausible, kBound_s, {0.1, 0.5, 2.0},
                 [](Driven& robot, const Layout& layout) { robot.drive(layout.side).reverse_encoder(); });
}

TEST(ChainEncoders, one_that_stands_still_at_speed_is_seen_long_before_a_coarse_step) {
    ends_in_time(
        "still", Fault::encoder_implausible, 0.05, {0.3, 1.0, 2.0},
        [](Driven& robot, const Layout& layout) { robot.drive(layout.side).faults().frozen_encoder = true; });
}

TEST(ChainEncoders, an_angle_that_stands_still_beside_a_speed_is_seen) {
    ends_in_time("angle alone", Fault::encoder_implausible, kBound_s, {0.2, 1.0},
                 [](Driven& robot, const Layout& layout) {
                     robot.drive(layout.side).faults().told_position_frozen = true;
                 });
}

TEST(ChainEncoders, an_angle_that_goes_half_the_way_of_its_speed_is_seen) {
    ends_in_time("half", Fault::encoder_implausible, kBound_s, {0.3, 1.5},
                 [](Driven& robot, const Layout& layout) {
                     robot.tells(layout, [begin = 0.F, begun = false](float position) mutable {
                         if (!begun) begin = position;
                         begun = true;
                         return begin + (position - begin) / 2;
                     });
                 });
}

// Told by each other's frames: turning then feeds on itself.
TEST(ChainEncoders, wheels_that_are_exchanged_are_seen_as_the_robot_turns) {
    for_each_layout([](const Layout& layout) {
        Driven robot(layout, {0.4 * layout.way, layout.side == 0 ? 1.0 : -1.0});
        robot.drive(0).faults().told_by = &robot.drive(1);
        robot.drive(1).faults().told_by = &robot.drive(0);
        double fastest = 0;
        robot.sim.run_for(1, [&] {
            if (robot.torque_Nm() > 0)
                fastest = std::max(fastest, std::abs(robot.sim.world().twist().omega_rad_per_s));
        });
        const std::string text = layout.name() + ": " + std::to_string(fastest) + " rad/s, fault " +
                                 std::to_string(int(robot.fault()));
        CHECK_TEXT(robot.fault() == Fault::encoder_implausible || robot.fault() == Fault::over_speed,
                   text.c_str());
        CHECK_TEXT(fastest <= 1.1 * identified().safety.over_yaw_rate_rad_per_s, text.c_str());
    });
}

// Its position is what counts; a clock that leaps ahead; somebody who pushes as hard as half of the torque.
TEST(ChainEncoders, what_is_no_lie_does_not_stop_the_robot) {
    const std::function<void(Driven&, const Layout&)> harmless[] = {
        [](Driven& robot, const Layout& layout) { robot.drive(layout.side).zero_position(); },
        [](Driven& robot, const Layout& layout) {
            sim::Random random(5, layout.side);
            const std::uint32_t id = encoder_frame(layout.side, 0, 0).id;
            robot.sim.faulty_bus(Simulation::Node::firmware)
                .on_receive([id, random](hal::ReceivedFrame& r) mutable {
                    const float any = static_cast<float>(200 * random.uniform() - 100);
                    if (r.frame.id == id) std::memcpy(r.frame.data.data() + 4, &any, 4);
                    return sim::FaultyBus::Deal::pass;
                });
        },
        [](Driven& robot, const Layout&) {
            robot.sim.faulty_bus(Simulation::Node::firmware).on_receive([](hal::ReceivedFrame& r) {
                r.timestamp_ns += 60'000'000'000;
                return sim::FaultyBus::Deal::pass;
            });
        },
        [](Driven& robot, const Layout& layout) {
            const auto& p = identified();
            robot.sim.world().plant().set_disturbance(
                {-layout.way * p.limits.torque_Nm / p.geometry.mean_radius_m(), 0});
        },
    };
    for_each_layout([&](const Layout& layout) {
        for (std::size_t i = 0; i < std::size(harmless); ++i) {
            Driven robot(layout, {0.6 * layout.way, 0.3});
            harmless[i](robot, layout);
            robot.sim.run_for(0.5);
            const double speed = robot.sim.world().twist().v_m_per_s;
            const std::string text = layout.name() + ", " + std::to_string(i) + ": " + std::to_string(speed) +
                                     " m/s, fault " + std::to_string(int(robot.fault()));
            CHECK_TEXT(robot.fault() == Fault::none, text.c_str());
            CHECK_TEXT(std::abs(speed - 0.6 * layout.way) < 0.1, text.c_str());
        }
    });
}
