// What goes wrong where the firmware's own state is wrong. Each case is judged on the simulated robot's true
// speed and on the torque that its drives are truly told; on both wheels, both ways, and both layouts of the
// buses.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "tests/chain/scene.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;
using protocol::Fault;
using protocol::Mode;

TEST_GROUP(ChainTrust){};

using namespace chain;

TEST(ChainTrust, one_wild_encoder_frame_neither_moves_the_robot_nor_stays_in_the_firmwares_mind) {
    for_each_layout([](const Layout& layout) {
        for (const float wild_rev : {3e38F, -1e9F, 2e4F, 40.F, -1.F, 0.2F}) {
            for (const double speed : {0.0, 0.5}) {
                Scene scene(layout);
                const double wanted = layout.way * speed;
                scene.cruise(wanted);
                const double position =
                    scene.sim.cycle().observer().motion().wheel_angle_rad.left;  // near enough for all
                scene.foreign(encoder_frame(
                    layout.side,
                    wild_rev > 1e3F ? wild_rev : wild_rev + static_cast<float>(position * 8 / 6.2832),
                    wild_rev));
                const Scene::Worst worst = scene.run(1);
                const std::string text =
                    layout.name() + ", " + std::to_string(wild_rev) + " turns at " + std::to_string(speed) +
                    " m/s: fastest " + std::to_string(worst.rim_m_per_s) + ", then " +
                    std::to_string(scene.true_speed()) + ", fault " + std::to_string(int(scene.fault()));
                // 0.2 turns of the motor are a leap that a coarse encoder's wheel may make.
                CHECK_TEXT(worst.rim_m_per_s < speed + 0.15, text.c_str());
                CHECK_TEXT(std::abs(scene.true_speed() - wanted) < 0.03, text.c_str());
            }
        }
    });
}

TEST(ChainTrust, a_drives_position_that_is_set_anew_is_no_motion) {
    for_each_layout([](const Layout& layout) {
        for (const bool driving : {false, true}) {
            Scene scene(layout);
            scene.cruise(layout.way);
            scene.sim.run_for(2);  // some forty turns of the motor
            if (!driving) {
                CHECK(enter_mode(scene.sim, Mode::idle));
                scene.sim.run_for(0.5);
            }
            const Pose<double> before = scene.sim.cycle().odometry().pose();
            const double before_m = scene.world().pose().x_m;
            scene.sim.host().external_poses(false);
            scene.sim.world().drive(layout.side).zero_position();
            Scene::Worst worst = scene.run(0.5);
            if (!driving) {
                scene.sim.host().velocity({layout.way, 0});
                CHECK_TEXT(enter_mode(scene.sim, Mode::velocity), layout.name().c_str());
                worst = scene.run(0.5);
            }
            const std::string text = layout.name() + ": fastest " + std::to_string(worst.rim_m_per_s) +
                                     ", then " + std::to_string(scene.true_speed()) + ", fault " +
                                     std::to_string(int(scene.fault()));
            CHECK_TEXT(worst.rim_m_per_s < 1.15, text.c_str());
            CHECK_TEXT(std::abs(scene.true_speed() - layout.way) < 0.05, text.c_str());
            const Pose<double>& pose = scene.sim.cycle().odometry().pose();
            const double went_m = std::hypot(pose.x_m - before.x_m, pose.y_m - before.y_m);
            CHECK_TEXT(std::abs(went_m - std::abs(scene.world().pose().x_m - before_m)) < 0.05,
                       (layout.name() + " odometry").c_str());
        }
    });
}
// From rest and at speed: 100 ms after the torque rises, or after the encoder stops.
TEST(ChainTrust, a_frozen_encoder_takes_the_torque_away) {
    double longest_s = 0, fastest = 0;
    for_each_layout([&](const Layout& layout) {
        for (const bool driving : {false, true}) {
            for (const double speed : {0.1, 0.5, 2.0}) {
                for (const bool both : {false, true}) {
                    Scene scene(layout);
                    const double wanted = layout.way * speed;
                    if (driving) scene.cruise(wanted);
                    scene.sim.world().drive(layout.side).faults().frozen_encoder = true;
                    if (both) scene.sim.world().drive(1 - layout.side).faults().frozen_encoder = true;
                    if (!driving) {
                        scene.sim.run_for(0.1);
                        scene.sim.host().velocity({wanted, 0});
                        scene.sim.host().mode(Mode::velocity);
                        CHECK(scene.sim.run_until([&] { return scene.true_torque_Nm() > 0.1; }, 0.5));
                    }
                    const Scene::Worst worst = scene.run(1);
                    longest_s = std::max(longest_s, worst.last_torque_s);
                    fastest = std::max(fastest, worst.rim_m_per_s - (driving ? speed : 0));
                    const std::string text =
                        layout.name() + (driving ? ", at " : ", from rest to ") + std::to_string(speed) +
                        " m/s: torque for " + std::to_string(worst.last_torque_s) + " s, fastest " +
                        std::to_string(worst.rim_m_per_s) + ", fault " + std::to_string(int(scene.fault()));
                    CHECK_TEXT(worst.last_torque_s <= 0.1, text.c_str());
                    CHECK_TEXT(scene.fault() == Fault::encoder_implausible, text.c_str());
                }
            }
        }
    });
    std::printf("  torque for %.0f ms at most, rims %.2f m/s quicker\n", 1e3 * longest_s, fastest);
}

TEST(ChainTrust, a_frozen_encoder_ends_a_ramp_to_idle_and_torque_mode_at_speed_too) {
    for_each_layout([&](const Layout& layout) {
        for (const bool to_idle : {true, false}) {
            Scene scene(layout);
            scene.cruise(layout.way * 1.5);
            if (!to_idle) {
                scene.sim.host().torque({0.3 * layout.way, 0.3 * layout.way});
                scene.sim.run_for(0.003);
                CHECK(enter_mode(scene.sim, Mode::torque));
                scene.sim.run_for(0.05);
            }
            scene.sim.world().drive(layout.side).faults().frozen_encoder = true;
            if (to_idle) scene.sim.host().mode(Mode::idle);
            const Scene::Worst worst = scene.run(2);
            const std::string text = layout.name() + (to_idle ? ", to idle" : ", torque mode") +
                                     ": torque for " + std::to_string(worst.last_torque_s) + " s, fastest " +
                                     std::to_string(worst.rim_m_per_s);
            CHECK_TEXT(worst.last_torque_s <= 0.1, text.c_str());
            CHECK_TEXT(worst.rim_m_per_s <= 1.5 + 0.7, text.c_str());
        }
    });
}

// The loop then pushes a wheel the more, the more it turns.
TEST(ChainTrust, an_encoder_that_begins_to_count_the_other_way_takes_the_torque_away) {
    double longest_s = 0, fastest = 0;
    for_each_layout([&](const Layout& layout) {
        for (const double speed : {0.0, 0.2, 0.5, 2.0}) {
            Scene scene(layout);
            scene.cruise(layout.way * speed);
            scene.sim.world().drive(layout.side).reverse_encoder();
            if (speed == 0) scene.sim.host().velocity({layout.way * 0.5, 0});
            const Scene::Worst worst = scene.run(1);
            longest_s = std::max(longest_s, worst.last_torque_s);
            fastest = std::max(fastest, worst.rim_m_per_s - speed);
            const std::string text = layout.name() + ", at " + std::to_string(speed) + " m/s: torque for " +
                                     std::to_string(worst.last_torque_s) + " s, fastest " +
                                     std::to_string(worst.rim_m_per_s) + ", fault " +
                                     std::to_string(int(scene.fault()));
            CHECK_TEXT(worst.last_torque_s <= 0.1, text.c_str());
            CHECK_TEXT(worst.rim_m_per_s <= speed + 1.2, text.c_str());
            CHECK_TEXT(scene.fault() == Fault::encoder_implausible, text.c_str());
        }
    });
    std::printf("  torque for %.0f ms at most, rims %.2f m/s quicker\n", 1e3 * longest_s, fastest);
}

// At any moment of an identification, also of a robot of which nothing is known.
TEST(ChainTrust, a_frozen_encoder_ends_an_identification_inside_its_area) {
    double farthest = 0, fastest = 0;
    for_each_layout([&](const Layout& layout) {
        for (const bool known : {false, true}) {
            for (const double at_s : {0.0, 2.0, 5.0, 8.0, 12.0}) {
                model::RobotParameters believed = known ? chain::identified() : chain::believed().parameters;
                if (!known) believed.dynamics = model::default_parameters().dynamics;
                Scene scene(layout, 33, believed);
                if (at_s == 0) scene.sim.world().drive(layout.side).faults().frozen_encoder = true;
                CHECK(enter_mode(scene.sim, Mode::ident));
                scene.sim.run_for(at_s);
                scene.sim.world().drive(layout.side).faults().frozen_encoder = true;
                const Pose<double> start = scene.world().pose();
                double away_m = 0;
                const Scene::Worst worst = scene.run(20, [&] {
                    const Pose<double>& pose = scene.world().pose();
                    away_m = std::max(away_m, std::hypot(pose.x_m - start.x_m, pose.y_m - start.y_m));
                });
                farthest = std::max(farthest, away_m);
                fastest = std::max(fastest, worst.rim_m_per_s);
                const std::string text =
                    layout.name() + (known ? ", known" : ", unknown") + ", frozen at " +
                    std::to_string(at_s) + " s: fastest " + std::to_string(worst.rim_m_per_s) +
                    " m/s, away " + std::to_string(away_m) + " m, torque for " +
                    std::to_string(worst.last_torque_s) + " s, fault " + std::to_string(int(scene.fault())) +
                    ", cause " + std::to_string(int(scene.sim.cycle().report().ident.cause));
                CHECK_TEXT(worst.rim_m_per_s <= believed.safety.over_speed_m_per_s, text.c_str());
                CHECK_TEXT(away_m <= 1.5 * believed.ident.distance_limit_m, text.c_str());
                CHECK_FALSE_TEXT(scene.sim.cycle().supervisor().may_drive(), text.c_str());
            }
        }
    });
    std::printf("  rims %.2f m/s at most, %.2f m away\n", fastest, farthest);
}

// The drives' bus is full of frames that go first; then it is free again. Torque is zero two cycles after the
// wire has worked off what waited, or when the drives' watchdogs expire, whichever is first.
TEST(ChainTrust, a_jam_of_the_drives_bus_leaves_no_old_torque_behind) {
    double longest_s = 0;
    for_each_layout([&](const Layout& layout) {
        for (const double jam_s : {0.008, 0.015, 0.03, 0.045, 0.1}) {
            for (const bool line : {false, true}) {
                Scene scene(layout);
                scene.sim.host().velocity({3 * layout.way, 0});
                CHECK(enter_mode(scene.sim, Mode::velocity));
                scene.sim.run_for(0.05);  // at full torque
                CHECK(scene.true_torque_Nm() > 3);
                scene.sim.host().external_poses(false);
                scene.sim.host().silence();  // its frames would hold back the foreign ones behind them
                hal::CanFrame first;
                first.length = 8;
                bool jammed = true;
                const auto jam = [&] {
                    for (int i = 0; jammed && i < 16; ++i) scene.foreign(first);
                };
                if (line) scene.sim.emergency_stop().set(hal::LineLevel::active);
                Scene::Worst worst = scene.run(jam_s, jam);
                const double in_jam_s = worst.last_torque_s;
                jammed = false;
                const double left_s =
                    (16 + 24) * 0.000135;  // foreign frames and the drives' own that still wait
                worst = scene.run(0.3);
                const double bound_s = std::min(jam_s + left_s + 0.002,
                                                chain::real().parameters.drive.watchdog_timeout_s + 0.002) +
                                       0.001;
                const double took_s = worst.last_torque_s > 0 ? jam_s + worst.last_torque_s : in_jam_s;
                longest_s = std::max(longest_s, took_s - jam_s);
                const bool stopped = scene.fault() != Fault::none;
                const std::string text = layout.name() + ", jam of " + std::to_string(jam_s) +
                                         " s: torque for " + std::to_string(took_s) + " s, fault " +
                                         std::to_string(int(scene.fault()));
                CHECK_TEXT(stopped, text.c_str());
                CHECK_TEXT(took_s <= bound_s, text.c_str());
                CHECK_FALSE(scene.sim.world().left().armed() || scene.sim.world().right().armed());
            }
        }
    });
    std::printf("  torque until %.1f ms after the jam at most\n", 1e3 * longest_s);
}

// Somebody else's tool arms a drive and gives it torque, once or in every cycle.
TEST(ChainTrust, a_drive_that_somebody_else_arms_is_told_to_be_idle_and_named) {
    for_each_layout([](const Layout& layout) {
        for (const bool repeats : {false, true}) {
            for (const bool seen :
                 {true, false}) {  // the frame that arms; otherwise only the heartbeat tells
                Scene scene(layout);
                const float torque = static_cast<float>(0.3 * layout.way);
                if (seen) {
                    scene.foreign(drive_frame(layout.side, kSetControllerMode, 1, 1));
                    scene.foreign(drive_frame(layout.side, kSetInputTorque, bits_of(torque)));
                    scene.foreign(drive_frame(layout.side, kSetAxisState, 8));
                } else {
                    scene.sim.bus().set_receive_latency(0, 200'000'000, 0);
                    scene.foreign(drive_frame(layout.side, kSetAxisState, 8));
                    scene.sim.run_for(0.19);
                    CHECK(scene.sim.world().drive(layout.side).armed() ||
                          scene.sim.world().drive(layout.side).error_bits() != 0);
                    scene.sim.bus().set_receive_latency(0, 0, 0);
                }
                const Scene::Worst worst = scene.run(1, [&] {
                    if (repeats) scene.foreign(drive_frame(layout.side, kSetInputTorque, bits_of(torque)));
                });
                const std::string text = layout.name() + (seen ? ", seen" : ", not seen") +
                                         (repeats ? ", in every cycle" : ", once") + ": fastest " +
                                         std::to_string(worst.rim_m_per_s) + ", fault " +
                                         std::to_string(int(scene.fault()));
                CHECK_TEXT(worst.rim_m_per_s < 0.3, text.c_str());
                if (seen || repeats) CHECK_TEXT(scene.fault() == Fault::foreign_control, text.c_str());
                CHECK_FALSE_TEXT(scene.sim.world().drive(layout.side).armed(), text.c_str());
            }
        }
    });
}

TEST(ChainTrust, somebody_elses_torques_stop_the_robot) {
    for_each_layout([](const Layout& layout) {
        Scene scene(layout);
        scene.cruise(0.3 * layout.way);
        const auto before = scene.sim.cycle().report().counters[kForeignControl];
        const float torque = static_cast<float>(0.5 * layout.way);
        const Scene::Worst worst =
            scene.run(1, [&] { scene.foreign(drive_frame(layout.side, kSetInputTorque, bits_of(torque))); });
        const std::string text = layout.name() + ": fastest " + std::to_string(worst.rim_m_per_s) +
                                 ", fault " + std::to_string(int(scene.fault()));
        CHECK_TEXT(worst.rim_m_per_s < 0.45, text.c_str());
        CHECK_TEXT(worst.last_torque_s < 0.005, text.c_str());
        CHECK_TEXT(scene.fault() == Fault::foreign_control, text.c_str());
        CHECK_TEXT(scene.sim.cycle().report().counters[kForeignControl] > before, text.c_str());

        // Once it is quiet, it clears.
        scene.sim.host().silence();
        scene.sim.run_for(2);
        scene.sim.host().clear_fault();
        scene.sim.run_for(0.2);
        scene.cruise(0.3 * layout.way);
    });
}

// Whatever the firmware believes of the drives.
TEST(ChainTrust, a_stop_disarms_a_drive_that_is_believed_idle) {
    for_each_layout([](const Layout& layout) {
        Scene scene(layout);
        scene.sim.bus().add_fault({sim::FaultAction::drop,
                                   (encoder_frame(layout.side, 0, 0).id & 0x7E0U) | 1U,
                                   0x7FF});  // no heartbeats for a while
        scene.foreign(drive_frame(layout.side, kSetControllerMode, 1, 1));
        scene.sim.bus().set_down(0, true);
        scene.sim.run_for(0.001);
        scene.foreign(drive_frame(layout.side, kSetAxisState, 8));
        scene.sim.run_for(0.01);
        scene.sim.bus().set_down(0, false);
        CHECK(scene.sim.world().drive(layout.side).armed());
        scene.sim.host().emergency_stop();
        scene.sim.run_for(0.004);
        CHECK_FALSE_TEXT(scene.sim.world().drive(layout.side).armed(), layout.name().c_str());
        CHECK(scene.fault() == Fault::emergency_stop_message);
    });
}

TEST(ChainTrust, clearing_outside_a_fault_changes_nothing) {
    for (const bool separate : {false, true}) {
        for (const double at_s : {0.0, 0.002, 0.005, 0.01, 0.02, 0.05, 0.3}) {
            Scene scene({separate, 0, 1});
            scene.sim.host().velocity({0.3, 0});
            scene.sim.host().mode(Mode::velocity);
            if (at_s == 0) scene.sim.host().clear_fault();  // in the same cycle
            scene.sim.run_for(at_s);
            scene.sim.host().clear_fault();
            scene.sim.run_for(0.5);
            const std::string text = "cleared after " + std::to_string(at_s) + " s";
            CHECK_TEXT(scene.sim.cycle().supervisor().mode() == Mode::velocity, text.c_str());
            CHECK_TEXT(std::abs(scene.true_speed() - 0.3) < 0.02, text.c_str());
        }
    }
}

TEST(ChainTrust, a_configured_ramp_brakes_on_a_stop_message_and_on_a_second_one) {
    for_each_layout([](const Layout& layout) {
        for (const bool line : {false, true}) {
            model::RobotParameters believed = chain::identified();
            believed.safety.emergency_stop_reaction = model::StopReaction::ramp;
            Scene scene(layout, 34, believed);
            scene.cruise(layout.way);
            if (line) {
                scene.sim.emergency_stop().set(hal::LineLevel::active);
            } else {
                scene.sim.host().emergency_stop();
                scene.sim.run_for(0.01);
                scene.sim.host().emergency_stop();
            }
            scene.sim.run_for(0.25);
            const std::string text = layout.name() + (line ? ", line: " : ", message: ") +
                                     std::to_string(scene.true_speed()) + " m/s after 0.25 s";
            CHECK_TEXT(std::abs(scene.true_speed()) < 0.06, text.c_str());
            scene.sim.run_for(0.5);
            CHECK_TEXT(scene.true_torque_Nm() == 0, text.c_str());
            CHECK_TEXT(scene.fault() == (line ? Fault::emergency_stop_line : Fault::emergency_stop_message),
                       text.c_str());
        }
    });
}

TEST(ChainTrust, a_stop_during_another_fault_or_beside_another_request_is_remembered) {
    for (const bool separate : {false, true}) {
        Scene late({separate, 0, 1});
        late.cruise(0.5);
        late.sim.host().silence();
        CHECK(late.sim.run_until([&] { return late.fault() == Fault::stale_command; }, 0.2));
        late.sim.host().emergency_stop();
        late.sim.run_for(0.005);
        CHECK(late.fault() == Fault::emergency_stop_message);

        for (const Mode beside : {Mode::idle, Mode::velocity, Mode::torque, Mode::pose, Mode::ident}) {
            for (const bool clears : {false, true}) {
                for (const double at_s : {0.0, 0.02, 0.5}) {
                    Scene scene({separate, 1, 1});
                    scene.sim.host().velocity({0.5, 0});
                    if (at_s > 0) scene.sim.host().mode(Mode::velocity);
                    scene.sim.run_for(at_s);
                    scene.sim.host().emergency_stop();
                    scene.sim.host().mode(beside);
                    if (clears) scene.sim.host().clear_fault();
                    scene.sim.run_for(0.005);
                    CHECK(scene.fault() == Fault::emergency_stop_message);
                    CHECK_EQUAL(0, scene.true_torque_Nm());
                }
            }
        }
    }
}

// An old set-point of the mode that is entered is as if it had never come.
TEST(ChainTrust, a_set_point_from_long_ago_does_not_act_after_a_switch_of_modes) {
    for_each_layout([](const Layout& layout) {
        Scene scene(layout);
        scene.cruise(0.2 * layout.way);
        scene.sim.host().torque({4 * layout.way, 4 * layout.way});  // unused
        scene.sim.run_for(0.003);
        scene.cruise(0.2 * layout.way);
        scene.sim.host().mode(Mode::torque);
        const Scene::Worst worst = scene.run(0.1);
        CHECK_TEXT(worst.rim_m_per_s < 0.22, layout.name().c_str());
        CHECK_TEXT(worst.torque_Nm < 2,
                   (layout.name() + ": " + std::to_string(worst.torque_Nm) + " Nm").c_str());
    });
}

// What is committed while the drives are being armed must not slip past the entry rules.
TEST(ChainTrust, a_commit_while_arming_does_not_pass_the_entry_rules) {
    for (const bool separate : {false, true}) {
        for (const double at_s : {0.001, 0.01, 0.03}) {
            Scene scene({separate, 0, 1});
            const std::uint16_t k7 = model::find_parameter("dynamics_standard_error.k7_per_kg_m")->index;
            scene.sim.host().mode(Mode::adaptive);
            scene.sim.run_for(at_s);
            CHECK(scene.sim.cycle().supervisor().mode() == Mode::idle);
            scene.sim.host().parameter(protocol::ParameterOperation::write, k7, 0);
            scene.sim.host().parameter(protocol::ParameterOperation::commit, 0);
            scene.sim.run_for(1);
            const bool entered = scene.sim.cycle().supervisor().mode() == Mode::adaptive;
            const bool trusted = scene.sim.parameters().dynamics_standard_error.k7_per_kg_m > 0;
            CHECK(trusted || !entered);
        }
    }
}

TEST(ChainTrust, a_trajectory_command_during_a_trajectory_changes_nothing) {
    for (const Mode mode : {Mode::trajectory, Mode::adaptive}) {
        for (const double at_s : {0.1, 0.5, 2.0}) {
            Scene::Worst worst[2];
            double speed[2];
            for (const bool sends : {false, true}) {
                Scene scene({true, 0, 1});  // where a frame of the host delays no other
                protocol::TrajectoryCommand command;
                command.shape = protocol::TrajectoryShape::circle;
                scene.sim.host().trajectory(command);
                scene.sim.run_for(0.2);
                CHECK(enter_mode(scene.sim, mode));
                scene.sim.run_for(at_s);
                protocol::TrajectoryCommand other;
                other.shape = protocol::TrajectoryShape::spin;
                if (sends) scene.sim.host().trajectory(other);
                worst[sends] = scene.run(1);
                speed[sends] = scene.true_speed();
            }
            const std::string text = std::to_string(at_s) + " s: " + std::to_string(worst[1].torque_Nm) +
                                     " Nm instead of " + std::to_string(worst[0].torque_Nm);
            CHECK_TEXT(std::abs(worst[1].torque_Nm - worst[0].torque_Nm) < 0.05, text.c_str());
            CHECK_TEXT(std::abs(speed[1] - speed[0]) < 1e-3, text.c_str());
        }
    }
}

TEST(ChainTrust, a_stop_counts_on_the_drives_bus_as_well) {
    for_each_layout([](const Layout& layout) {
        Scene scene(layout);
        scene.cruise(0.5 * layout.way);
        hal::CanFrame stop;
        stop.id = protocol::EmergencyStop::id;
        scene.foreign(stop);
        scene.sim.run_for(0.004);
        CHECK_TEXT(scene.fault() == Fault::emergency_stop_message, layout.name().c_str());
        CHECK_EQUAL(0, scene.true_torque_Nm());
    });
}

TEST(ChainTrust, the_drives_bus_may_be_down_for_a_while_in_idle) {
    for_each_layout([](const Layout& layout) {
        Scene scene(layout);
        scene.sim.bus().set_down(0, true);
        scene.sim.run_for(0.5);
        scene.sim.bus().set_down(0, false);
        scene.sim.run_for(0.5);
        scene.cruise(0.3 * layout.way);
    });
}

// The guard forgets a counter after a while; a set-point must be late before one and the same frame counts
// as new.
TEST(ChainTrust, a_frame_that_is_repeated_for_ever_is_late_before_it_counts_again) {
    const double most = model::find_parameter("safety.stale_command_cycles")->maximum;
    for (const auto cycle_time_ms :
         {protocol::TorqueCommand::cycle_time_ms, protocol::VelocityCommand::cycle_time_ms,
          protocol::PoseGoal::cycle_time_ms, protocol::StreamedPose::cycle_time_ms}) {
        CHECK(1e6 * cycle_time_ms * most < double(protocol::alive_window_ns));
    }
}

// As a robot file would be refused.
TEST(ChainTrust, a_commit_that_contradicts_the_rest_is_refused) {
    Scene scene({true, 0, 1});
    const auto set = [&](std::string_view key, float value) {
        scene.sim.host().parameter(protocol::ParameterOperation::write, model::find_parameter(key)->index,
                                   value);
    };
    const auto commit = [&] {
        scene.sim.host().parameter(protocol::ParameterOperation::commit, 0);
        scene.sim.run_for(0.005);
    };
    model::RobotParameters& live = scene.sim.parameters();
    struct Case {
        std::string_view key;
        float value;
        bool good;
    };
    for (const Case& one :
         {Case{"limits.speed_m_per_s", 5, false}, Case{"limits.speed_m_per_s", 3, true},
          Case{"limits.yaw_rate_rad_per_s", 20, false}, Case{"ident.speed_limit_m_per_s", 4, false},
          Case{"ident.yaw_rate_limit_rad_per_s", 15, false}, Case{"ident.speed_limit_m_per_s", 0, true}}) {
        scene.sim.host().parameter(protocol::ParameterOperation::discard, 0);
        set(one.key, one.value);
        commit();
        const bool taken = std::abs(model::find_parameter(one.key)->get(live) - double(one.value)) < 1e-6;
        CHECK_EQUAL_TEXT(one.good, taken, std::string(one.key).c_str());
    }
    scene.sim.host().parameter(protocol::ParameterOperation::discard, 0);
    set("pose_control.stop_radius_m", 0.02F);
    set("pose_control.rearm_radius_m", 0.01F);
    commit();
    CHECK(live.pose_control.stop_radius_m != 0.02F);
    set("pose_control.rearm_radius_m", 0.03F);
    commit();
    CHECK(std::abs(live.pose_control.rearm_radius_m - 0.03) < 1e-6);
}
