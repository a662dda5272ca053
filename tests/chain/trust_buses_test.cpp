// What may go wrong on the buses and with the computers at their ends, judged like trust_test.cpp on the
// robot's true motion and torque.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>

#include "tests/chain/scene.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace chain;

TEST_GROUP(ChainBuses){};

namespace {

// What passes on the drives' bus: the last frame of a stranger, the firmware's torques since, and when both
// drives have been told to stop.
class Witness final : public sim::BusTap {
  public:
    void on_frame(const sim::WireEvent& event) override {
        if (event.sender == 2) {
            stranger_ns = event.end_ns;
            torques = 0;
            stopped_ns = {};
        }
        if (event.sender != 0) return;
        const std::uint32_t command = event.frame->id & 0x1FU;
        const bool left = event.frame->id >> 5U == std::uint32_t(real().parameters.drive.left.node);
        float torque = 0;
        std::memcpy(&torque, event.frame->data.data(), 4);
        if (command == kSetInputTorque && torque != 0) {
            ++torques;
            stopped_ns[left ? 0 : 1] = 0;
        } else if ((command == kSetInputTorque || command == kSetAxisState) &&
                   stopped_ns[left ? 0 : 1] == 0) {
            stopped_ns[left ? 0 : 1] = event.end_ns;
        }
    }
    double stop_ms() const {
        return 1e-6 * static_cast<double>(std::max(stopped_ns[0], stopped_ns[1]) - stranger_ns);
    }
    std::int64_t stranger_ns = 0;
    std::array<std::int64_t, 2> stopped_ns{};
    int torques = 0;
};

}  // namespace

// The drives' bus is full of a stranger's frames, which go first; then it is free again. Of the firmware's
// frames seven wait at most, and one old torque for each drive among them; in front of them are those that
// the drives had waiting. When these have passed, there is no torque; or when the drives' watchdogs expire.
TEST(ChainBuses, a_jam_leaves_one_old_torque_for_each_drive_at_most) {
    constexpr double kFrame_ms = 0.138;
    double longest_ms = 0;
    int most = 0;
    for_each_layout([&](const Layout& layout) {
        for (const double jam_s : {0.003, 0.008, 0.015, 0.03, 0.04}) {
            for (const bool line : {false, true}) {
                Scene scene(layout);
                Witness witness;
                scene.sim.bus().add_tap(witness);
                scene.sim.bus().limit_transmit_queue(1, 6);  // three mailboxes for each drive
                scene.sim.host().velocity({3 * layout.way, 0});
                CHECK(enter_mode(scene.sim, Mode::velocity));
                scene.sim.run_for(0.05);  // at full torque
                CHECK(scene.true_torque_Nm() > 3);
                scene.sim.host().vanish();
                hal::CanFrame first;
                first.length = 8;
                if (line) scene.sim.emergency_stop().set(hal::LineLevel::active);
                scene.run(jam_s, [&] {
                    for (int i = 0; i < 16; ++i) scene.foreign(first);
                });
                scene.sim.emergency_stop().set(hal::LineLevel::active);
                scene.run(0.2);
                const std::string text = layout.name() + ", jam of " + std::to_string(jam_s) +
                                         " s: torque until " + std::to_string(witness.stop_ms()) +
                                         " ms after it, " + std::to_string(witness.torques) + " old torques";
                longest_ms = std::max(longest_ms, witness.stop_ms());
                most = std::max(most, witness.torques);
                CHECK_TEXT(witness.torques <= 2, text.c_str());
                // seven of the firmware's, six of the drives', and what these send meanwhile
                CHECK_TEXT(witness.stop_ms() <= (7 + 6 + 2 * 2) * kFrame_ms, text.c_str());
                CHECK(scene.fault() != Fault::none);
                CHECK_EQUAL(0, scene.true_torque_Nm());
            }
        }
    });
    std::printf("  told to stop %.2f ms after the jam at most, %d old torques\n", longest_ms, most);
}

// --- the drives -------------------------------------------------------------------------------------------

namespace {

enum class Reads { nothing, endpoints };

model::RobotParameters with_drives(model::RobotParameters p, int generation, Reads reads) {
    p.drive.generation = generation;
    if (reads == Reads::endpoints) {
        p.drive.watchdog_endpoint = 391;
        p.drive.watchdog_timeout_endpoint = 392;
        p.drive.control_mode_endpoint = 401;
        p.drive.input_mode_endpoint = 402;
    }
    return p;
}

}  // namespace

// Set_Controller_Mode is lost on the way to one drive: once, twice, always. The drive then would hold its
// position.
TEST(ChainBuses, a_drive_in_another_mode_makes_no_robot_run_away) {
    double fastest[3]{}, turned[3]{};
    for_each_layout([&](const Layout& layout) {
        for (const int generation : {5, 6}) {
            for (const Reads reads : {Reads::nothing, Reads::endpoints}) {
                if (generation == 5 && reads == Reads::endpoints) continue;
                for (const std::uint32_t lost : {1U, 2U, 1'000'000U}) {
                    Scene scene(layout, 35, with_drives(identified(), generation, reads),
                                with_drives(real().parameters, generation, reads));
                    scene.sim.bus().add_fault({sim::FaultAction::drop,
                                               drive_frame(layout.side, kSetControllerMode, 0).id, 0x7FF, 0,
                                               lost});
                    scene.sim.host().velocity({0.5 * layout.way, 0});
                    scene.sim.host().mode(Mode::velocity);
                    double yaw = 0;
                    const Scene::Worst worst = scene.run(
                        4, [&] { yaw = std::max(yaw, std::abs(scene.world().twist().omega_rad_per_s)); });
                    const bool drives = scene.fault() == Fault::none;
                    const std::size_t which = generation == 5 ? 0 : reads == Reads::nothing ? 1 : 2;
                    fastest[which] = std::max(fastest[which], worst.rim_m_per_s);
                    turned[which] = std::max(turned[which], yaw);
                    const std::string text =
                        layout.name() + ", generation " + std::to_string(generation) +
                        (reads == Reads::endpoints ? ", asked" : "") + ", " + std::to_string(lost) +
                        " lost: fastest rim " + std::to_string(worst.rim_m_per_s) + ", yaw " +
                        std::to_string(yaw) + ", fault " + std::to_string(int(scene.fault()));
                    CHECK_TEXT(worst.rim_m_per_s <= 0.6, text.c_str());
                    CHECK_TEXT(yaw < 0.7, text.c_str());
                    // what is lost once is sent again
                    if (lost == 1 || (lost == 2 && reads == Reads::endpoints)) {
                        CHECK_TEXT(drives && std::abs(scene.true_speed() - 0.5 * layout.way) < 0.03,
                                   text.c_str());
                    } else if (lost > 2) {
                        CHECK_TEXT(!drives && scene.true_torque_Nm() == 0, text.c_str());
                        if (reads == Reads::endpoints) CHECK_EQUAL_TEXT(0, worst.torque_Nm, text.c_str());
                    }
                }
            }
        }
    });
    std::printf("  fastest rim, yaw: 0.5 %.2f, %.2f; 0.6 not asked %.2f, %.2f; asked %.2f, %.2f\n",
                fastest[0], turned[0], fastest[1], turned[1], fastest[2], turned[2]);
}

// A drive that is switched off for a moment, by a bad plug say, and comes back in closed loop by itself, in
// the mode that it has stored: driving and at rest.
TEST(ChainBuses, a_drive_that_comes_back_armed_is_named_and_gets_no_torque) {
    double longest_s = 0, fastest = 0;
    for_each_layout([&](const Layout& layout) {
        for (const double speed : {0.0, 0.5}) {
            for (const double off_s : {0.001, 0.003, 0.005, 0.009, 0.02, 0.1, 0.3, 2.0}) {
                Scene scene(layout, 36);
                scene.cruise(speed * layout.way);
                if (speed == 0) {
                    CHECK(enter_mode(scene.sim, Mode::idle));
                    scene.sim.run_for(0.2);
                }
                sim::SimOdrive& drive = scene.sim.world().drive(layout.side);
                drive.faults().wakes_armed = true;
                drive.faults().powered_off = true;
                scene.run(off_s);
                drive.faults().powered_off = false;
                const Scene::Worst worst = scene.run(1);
                longest_s = std::max(longest_s, worst.last_torque_s);
                fastest = std::max(fastest, worst.rim_m_per_s - speed);
                const std::string text = layout.name() + ", at " + std::to_string(speed) + " m/s off for " +
                                         std::to_string(off_s) + " s: torque for " +
                                         std::to_string(worst.last_torque_s) + " s, fastest rim " +
                                         std::to_string(worst.rim_m_per_s) + ", fault " +
                                         std::to_string(int(scene.fault()));
                // Its first frame tells it; the cycle after that answers. Of one that is idle, and stands
                // where it began to count, some missing frames tell nothing: its heartbeat does.
                const double bound_s = speed == 0 && off_s < 0.006 ? 0.16 : 0.005;
                CHECK_TEXT(worst.last_torque_s <= bound_s, text.c_str());
                CHECK_TEXT(worst.rim_m_per_s <= speed + 0.05, text.c_str());
                if (speed > 0) CHECK_TEXT(scene.fault() != Fault::none, text.c_str());
                CHECK_FALSE_TEXT(drive.armed(), text.c_str());
            }
        }
    });
    std::printf("  torque for %.0f ms at most, rims %.2f m/s quicker\n", 1e3 * longest_s, fastest);
}

// Supply and heat as the drives report them: near is told, beyond stops, and keeps the robot from driving
// off.
TEST(ChainBuses, a_supply_or_a_temperature_beyond_its_limit_stops_the_robot_until_it_is_back) {
    model::RobotParameters truth = real().parameters;
    model::RobotParameters believed = identified();
    for (model::RobotParameters* p : {&truth, &believed}) {
        p->drive.supply_period_ms = p->drive.temperature_period_ms = 20;
    }
    believed.safety.lowest_supply_V = 20;
    believed.safety.highest_supply_V = 30;
    struct Case {
        double sags_V, heats_degC;
        Fault fault;
        bool ramps;  // where it is asked for
    };
    for_each_layout([&](const Layout& layout) {
        for (const Case& each :
             {Case{3.5, 0, Fault::none, true}, Case{6, 0, Fault::drive_voltage_out_of_range, true},
              Case{-10, 0, Fault::drive_voltage_out_of_range, false}, Case{0, 75, Fault::none, true},
              Case{0, 85, Fault::drive_overheated, true}}) {
            const bool asks_ramp = layout.side == 0;
            believed.safety.drive_limits_reaction =
                asks_ramp ? model::StopReaction::ramp : model::StopReaction::coast;
            Scene scene(layout, 37, believed, truth);
            scene.cruise(0.5 * layout.way);
            CHECK(!scene.sim.cycle().report().status.limit_drives);
            sim::SimOdriveFaults& faults = scene.sim.world().drive(layout.side).faults();
            faults.supply_sags_V = each.sags_V;
            faults.heats_degC = each.heats_degC;
            const Scene::Worst worst = scene.run(1);
            const std::string text = layout.name() + ", " + std::to_string(each.sags_V) + " V, " +
                                     std::to_string(each.heats_degC) + " degC: fault " +
                                     std::to_string(int(scene.fault())) + ", torque for " +
                                     std::to_string(worst.last_torque_s) + " s";
            CHECK_TEXT(scene.fault() == each.fault, text.c_str());
            CHECK_TEXT(scene.sim.cycle().report().status.limit_drives, text.c_str());
            if (each.fault == Fault::none) continue;
            if (asks_ramp && each.ramps) {
                CHECK_TEXT(std::abs(scene.true_speed()) < 0.01, text.c_str());
            } else {
                CHECK_TEXT(worst.last_torque_s <= 0.07, text.c_str());  // three reports
            }
            scene.sim.host().silence();
            scene.sim.run_for(3);
            scene.sim.host().clear_fault();
            scene.sim.run_for(0.1);
            scene.sim.host().mode(Mode::velocity);
            scene.sim.run_for(0.1);
            CHECK_TEXT(scene.sim.cycle().supervisor().blocker() == protocol::Blocker::drive_out_of_limits,
                       text.c_str());
            faults = {};
            scene.sim.run_for(0.1);
            CHECK(!scene.sim.cycle().report().status.limit_drives);
            scene.cruise(0.3 * layout.way);
        }
    });
}

// --- the lines ---------------------------------------------------------------------------------------------

TEST(ChainBuses, a_drive_enable_line_that_cannot_be_written_is_a_fault) {
    for_each_layout([](const Layout& layout) {
        for (const bool driving : {false, true}) {
            Scene scene(layout);
            if (driving) scene.cruise(0.5 * layout.way);
            scene.sim.drive_enable().set_broken(true);
            Scene::Worst worst;
            if (!driving) {
                scene.sim.host().velocity({0.5 * layout.way, 0});
                scene.sim.host().mode(Mode::velocity);
                worst = scene.run(0.5);
                CHECK_EQUAL(0, worst.torque_Nm);
            } else {
                worst = scene.run(0.5);
                CHECK(worst.last_torque_s <= 0.003);
            }
            CHECK_TEXT(scene.fault() == Fault::drive_enable_failed, layout.name().c_str());
            CHECK(!scene.sim.world().left().armed() && !scene.sim.world().right().armed());

            scene.sim.drive_enable().set_broken(false);
            scene.sim.host().silence();
            scene.sim.run_for(3);
            scene.sim.host().clear_fault();
            scene.sim.run_for(0.2);
            scene.cruise(0.3 * layout.way);
        }
    });
}

// --- the buses ---------------------------------------------------------------------------------------------

TEST(ChainBuses, a_remote_or_extended_frame_is_no_stop_and_no_command) {
    for_each_layout([](const Layout& layout) {
        Scene scene(layout);
        scene.cruise(0.5 * layout.way);
        for (const bool remote : {false, true}) {
            for (std::uint32_t id = protocol::EmergencyStop::id; id <= protocol::ArmingAnswer::id; ++id) {
                hal::CanFrame frame;
                frame.id = id;
                frame.extended = !remote;
                frame.remote = remote;
                frame.length = 0;
                scene.foreign(frame);
                scene.sim.host_bus().send(frame);
                scene.sim.run_for(0.004);
            }
        }
        scene.sim.run_for(0.1);
        CHECK_TEXT(scene.fault() == Fault::none, layout.name().c_str());
        CHECK(std::abs(scene.true_speed() - 0.5 * layout.way) < 0.02);
        for (std::size_t i = 0; i <= 7; ++i) CHECK_EQUAL(0, scene.sim.cycle().report().counters[i]);
    });
}

// A second firmware is known by its telemetry, wherever it is heard; of a firmware that drives, by its
// torques too.
TEST(ChainBuses, another_firmware_on_the_bus_stops_both) {
    for_each_layout([](const Layout& layout) {
        for (const bool driving : {false, true}) {
            for (const bool on_drives_bus : {false, true}) {
                Scene scene(layout);
                if (driving) scene.cruise(0.5 * layout.way);
                hal::CanFrame status;
                status.id = protocol::Status::id;
                status.length = protocol::Status::length;
                status.data.fill(0);
                if (on_drives_bus) {
                    scene.foreign(status);
                } else {
                    scene.sim.host_bus().send(status);
                }
                const Scene::Worst worst = scene.run(0.1);
                CHECK_TEXT(scene.fault() == Fault::foreign_control, layout.name().c_str());
                CHECK(worst.last_torque_s <= 0.003);
                CHECK(scene.sim.cycle().report().counters[kForeignControl] == 1);
            }
        }
    });
}

// The interface of the drives' bus goes down, with a frame still to be read: named at once. It comes back;
// the fault clears and the robot drives again, without a restart. With a bus of its own the host is heard all
// the while.
TEST(ChainBuses, a_flap_of_the_drives_bus_is_named_at_once_and_ends_without_a_restart) {
    for_each_layout([](const Layout& layout) {
        for (const bool driving : {true, false}) {
            for (const bool off_bus : {false, true}) {
                for (const double down_s : {0.001, 0.01, 0.1, 2.0}) {
                    Scene scene(layout);
                    if (driving) scene.cruise(0.5 * layout.way);
                    scene.foreign(
                        encoder_frame(layout.side, 0, 0));  // is read in the cycle that finds it down
                    scene.sim.bus().set_receive_latency(0, 0, 0);
                    if (off_bus) {
                        scene.sim.bus().set_bus_off(0);
                    } else {
                        scene.sim.bus().set_down(0, true);
                    }
                    scene.sim.run_for(0.002);
                    const Fault named = scene.fault();
                    const std::string text = layout.name() + (driving ? ", driving" : ", idle") +
                                             ", down for " + std::to_string(down_s) + " s, fault " +
                                             std::to_string(int(named));
                    CHECK_TEXT(named == (driving ? Fault::bus_down : Fault::none), text.c_str());
                    scene.sim.run_for(down_s);
                    if (off_bus) {
                        scene.sim.bus().recover(0);
                    } else {
                        scene.sim.bus().set_down(0, false);
                    }
                    scene.sim.host().silence();
                    CHECK(scene.sim.run_until(
                        [&] { return scene.true_speed() == 0 || std::abs(scene.true_speed()) < 0.01; }, 5));
                    scene.sim.run_for(0.3);
                    CHECK_EQUAL_TEXT(0, scene.true_torque_Nm(), text.c_str());
                    if (driving) {
                        scene.sim.host().clear_fault();
                        scene.sim.run_for(0.2);
                    }
                    CHECK_TEXT(scene.fault() == Fault::none, text.c_str());
                    scene.cruise(0.3 * layout.way);
                }
            }
        }
    });
}

// --- the computers at the ends -----------------------------------------------------------------------------

// The firmware's computer stands still: the drives' watchdogs stop the wheels, and what is named is the
// stall.
TEST(ChainBuses, a_stall_of_the_firmwares_computer_is_called_an_overrun) {
    double longest_s = 0;
    for_each_layout([&](const Layout& layout) {
        for (const double stall_s : {0.005, 0.02, 0.1, 0.2, 0.3, 1.0, 3.0}) {
            Scene scene(layout);
            scene.cruise(0.5 * layout.way);
            scene.sim.stall(stall_s);
            const Scene::Worst worst = scene.run(0.5);
            longest_s = std::max(longest_s, worst.last_torque_s);
            const std::string text = layout.name() + ", " + std::to_string(stall_s) + " s: fault " +
                                     std::to_string(int(scene.fault()));
            CHECK_TEXT(scene.fault() == Fault::cycle_overrun, text.c_str());
            CHECK_TEXT(worst.last_torque_s <= 0.003, text.c_str());
            scene.sim.host().silence();
            scene.sim.run_for(3);
            scene.sim.host().clear_fault();
            scene.sim.run_for(0.5);
            scene.cruise(0.3 * layout.way);
        }
    });
}

// A host that enters a mode and dies before its first set-point leaves no robot armed.
TEST(ChainBuses, a_mode_without_a_set_point_yet_ends_with_its_host) {
    for_each_layout([&](const Layout& layout) {
        for (const Mode mode : {Mode::torque, Mode::velocity, Mode::pose}) {
            Scene scene(layout);
            CHECK(enter_mode(scene.sim, mode));
            scene.sim.run_for(1);
            const std::string text = layout.name() + ", mode " + std::to_string(int(mode));
            CHECK_TEXT(scene.sim.cycle().supervisor().mode() == mode, text.c_str());
            scene.sim.host().vanish();
            scene.sim.run_for(identified().safety.host_timeout_s + 0.005);
            CHECK_TEXT(scene.fault() == Fault::stale_command, text.c_str());
        }
    });
}

// The host dies while the robot is under way: it stops, whatever it was doing. A camera's poses do not keep
// it going.
TEST(ChainBuses, a_robot_whose_host_is_gone_stops) {
    double longest_s = 0;
    for_each_layout([&](const Layout& layout) {
        for (const Mode mode : {Mode::ident, Mode::pose, Mode::trajectory, Mode::adaptive}) {
            for (const bool camera : {false, true}) {
                for (const double at_s : {0.05, 2.0}) {
                    Scene scene(layout);
                    if (mode == Mode::pose)
                        scene.sim.host().goal({4 * layout.way, 0, 0}, layout.way > 0
                                                                          ? protocol::PoseDirection::forward
                                                                          : protocol::PoseDirection::reverse);
                    scene.sim.run_for(0.01);
                    CHECK(enter_mode(scene.sim, mode));
                    scene.sim.run_for(at_s);
                    const std::string text = layout.name() + ", mode " + std::to_string(int(mode)) + ", at " +
                                             std::to_string(at_s) + " s";
                    CHECK_TEXT(scene.sim.cycle().supervisor().mode() == mode, text.c_str());
                    scene.sim.host().vanish();
                    scene.sim.host().external_poses(camera);
                    const Scene::Worst worst = scene.run(2);
                    longest_s = std::max(longest_s, worst.last_torque_s);
                    CHECK_TEXT(worst.last_torque_s <= identified().safety.host_timeout_s + 0.005,
                               text.c_str());
                    CHECK_TEXT(scene.fault() == Fault::stale_command, text.c_str());
                }
            }
        }
    });
    std::printf("  torque for %.3f s at most\n", longest_s);
}
