#include "tools/torture/kinds.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "drivers/odrive/odrive_0_6_messages.hpp"

namespace wheelwright::tools {
namespace {

namespace odrive = drivers::odrive_0_6;
using Deal = sim::FaultyBus::Deal;
using protocol::Mode;

constexpr double kCycle_s = task::kCyclePeriod_s;
constexpr std::uint32_t kHeartbeat = odrive::Heartbeat::command;
constexpr std::uint32_t kEncoder = odrive::GetEncoderEstimates::command;
constexpr std::uint32_t kTorqueControl = 1;
constexpr std::uint32_t kClosedLoop = 8;
constexpr double kFrame_s = 0.000138;  // with eight bytes at 1 Mbit/s
// What still waits when a jam ends: of the jam, extended; of everybody else.
constexpr double kWaiting_s = 16 * 0.000163 + 24 * kFrame_s;

// ---- bounds
double two_cycles(const Scene&) { return 2 * kCycle_s; }
// Before the zeros a telemetry frame may stand in the firmware's queue, which goes behind what hosts have
// sent within that cycle: a mode and a set-point, of the storm and of the robot's own host.
double two_cycles_in_a_storm(const Scene& s) {
    return two_cycles(s) + (s.setup().separate_host_bus ? 0 : 5 * kFrame_s);
}
// From the beginning of the cycle that knows to the end of both torques' frames.
double way(const Scene& s) { return s.setup().believed.realtime.send_phase_s + 2 * kFrame_s; }
double feedback_timeout(const Scene& s) {
    return s.setup().believed.safety.stale_feedback_s + kCycle_s + way(s);
}
double silence_timeout(const Scene& s) {
    return s.setup().believed.drive.heartbeat_timeout_s + kCycle_s + way(s);
}
// The drives count in milliseconds of their own.
double watchdogs(const Scene& s) { return s.setup().truth.drive.watchdog_timeout_s + 2 * kCycle_s + way(s); }
double command_timeout(const Scene& s) {
    const double period_ms = s.setup().mode == Mode::pose ? protocol::PoseGoal::cycle_time_ms
                                                          : protocol::VelocityCommand::cycle_time_ms;
    return 1e-3 * period_ms * s.setup().believed.safety.stale_command_cycles + kCycle_s + way(s);
}
// Where no set-point has begun to come (a first goal may be on its way), the host need only be there, and may
// last have been heard just then.
double host_timeout(const Scene& s) {
    if (s.setup().mode == Mode::torque || s.setup().mode == Mode::velocity) return command_timeout(s);
    return std::max(command_timeout(s), s.setup().believed.safety.host_timeout_s + kCycle_s + way(s));
}
double deaf_watchdog(const Scene& s) {
    return watchdogs(s) + 1e-3 * s.setup().truth.drive.heartbeat_period_ms + 2 * kCycle_s;
}
// Frames that wait when a jam ends still feed the watchdogs.
double jam(const Scene& s) {
    const bool ends_first = s.amount < watchdogs(s);
    return ends_first ? s.amount + kWaiting_s + 2 * kCycle_s + way(s) : watchdogs(s);
}
double implausible(const Scene& s) { return s.setup().believed_lie_s(); }
constexpr std::string_view kImplausible =
    "100 ms, or 20 reports, from where a wheel is 1.5/64 of a turn from what is told";
double ramp(const Scene& s) {
    return 2 * control::braking_time_s(s.setup().believed) + 0.5 + 2 * kCycle_s + way(s);
}
double outvoted(const Scene&) { return 0.005; }

// ---- small tools
float number(const hal::CanFrame& frame, std::size_t at) {
    float value = 0;
    std::memcpy(&value, frame.data.data() + at, 4);
    return value;
}
void put(hal::CanFrame& frame, std::size_t at, float value) {
    std::memcpy(frame.data.data() + at, &value, 4);
}
void put(hal::CanFrame& frame, std::size_t at, std::uint32_t value) {
    std::memcpy(frame.data.data() + at, &value, 4);
}

// What the firmware hears of one kind of frame of the tortured side's drive.
template <typename Change>
void hears(Scene& s, std::uint32_t command, Change change) {
    s.firmware_bus().on_receive([&s, command, change](hal::ReceivedFrame& received) {
        return s.from_drive(received.frame, command) ? change(s, received) : Deal::pass;
    });
}
// All that the node receives.
template <typename Change>
void all_of(sim::FaultyBus& bus, Scene& s, Change change) {
    bus.on_receive([&s, change](hal::ReceivedFrame& received) { return change(s, received); });
}

void lose_some(Scene& s, double share) {
    s.amount = share;
    const auto lose = [](Scene& scene, hal::ReceivedFrame&) {
        return scene.random().uniform() < scene.amount ? Deal::lose : Deal::pass;
    };
    all_of(s.firmware_bus(), s, lose);
    all_of(s.robot_bus(), s, lose);
}

hal::CanFrame stop_frame() {
    hal::CanFrame frame;
    frame.id = protocol::EmergencyStop::id;
    return frame;
}

// Wins the wire against all drives, and is for none of them: a standard 0 would feed the watchdog of node 0.
hal::CanFrame lowest() {
    hal::CanFrame frame;
    frame.extended = true;
    frame.length = 8;
    frame.data = {};
    return frame;
}

void jam_bus(Scene& s) {
    const hal::CanFrame first = lowest();
    for (int i = 0; i < 16 && s.since_s() < s.amount; ++i) s.foreign(first);
}

void repeat_setpoint(Scene& s, std::size_t side, float torque_Nm) {
    s.foreign(s.to_drive(side, odrive::SetInputTorque::command, bits_of(torque_Nm)));
}

void random_setpoints(Scene& s) {
    switch (s.random().bits() % 4) {
        case 0: {
            protocol::VelocityCommand command;
            command.forward_speed_m_per_s = s.uniform(-16, 16);
            command.yaw_rate_rad_per_s = s.uniform(-30, 30);
            s.second_host(command);
            break;
        }
        case 1: {
            protocol::TorqueCommand command;
            command.left_torque_Nm = s.uniform(-30, 30);
            command.right_torque_Nm = s.uniform(-30, 30);
            s.second_host(command);
            break;
        }
        case 2: {
            protocol::PoseGoal command;
            command.x_m = s.uniform(-60, 60);
            command.y_m = s.uniform(-60, 60);
            s.second_host(command);
            break;
        }
        default: {
            protocol::ExternalPose command;
            command.x_m = s.uniform(-60, 60);
            command.y_m = s.uniform(-60, 60);
            command.heading_rad = s.uniform(-3, 3);
            s.second_host(command);
            break;
        }
    }
}

void random_mode(Scene& s) {
    protocol::ModeCommand command;
    command.mode = static_cast<Mode>(1 + s.random().bits() % 7);
    s.second_host(command);
}

// Idle, at rest, and then the mode again: true at a random moment of the arming.
void begin_arming(Scene& s) {
    s.amount = s.uniform(0, 60);
    s.sim().host().mode(Mode::idle);
}
bool while_arming(Scene& s) {
    const auto& supervisor = s.sim().cycle().supervisor();
    const bool idle = supervisor.mode() == Mode::idle && supervisor.phase() == supervisor::Phase::steady;
    if (s.count == 0 && idle) s.sim().host().mode(s.setup().mode);
    if (s.count > 0 || idle || s.since_s() > 0.8) ++s.count;
    return s.count == 1 + std::int64_t(s.amount);
}

void parameter(Scene& s, protocol::ParameterOperation operation, std::uint16_t index = 0, float value = 0) {
    protocol::ParameterRequest request;
    request.operation = operation;
    request.index = index;
    request.value = value;
    s.second_host(request);
}

// From the first frame on.
void tell_half_of_the_way(Scene& scene, hal::CanFrame& frame) {
    const double position = number(frame, 0);
    if (scene.count++ == 0) scene.amount = position;
    put(frame, 0, static_cast<float>(scene.amount + (position - scene.amount) / 2));
}

// ---- how far what the encoders tell is from the truth, for From::lie
double the_way(const Scene& s, const WheelPair<double>& turned_rad) {
    return std::abs(s.setup().side == 0 ? turned_rad.left : turned_rad.right);
}
double twice_the_way(const Scene& s, const WheelPair<double>& turned_rad) {
    return 2 * the_way(s, turned_rad);
}
double either_way(const Scene&, const WheelPair<double>& turned_rad) {
    return std::max(std::abs(turned_rad.left), std::abs(turned_rad.right));
}

// ---- the table
constexpr std::string_view kSilenceNames = "stale_feedback,drive_silent,drive_left_armed_state,bus_down";
// A drive that has left closed loop reports no torque, before its heartbeat says why.
constexpr std::string_view kDropsOutNames = "drive_left_armed_state,torque_not_followed,foreign_control";
constexpr std::string_view kLieNames = "encoder_implausible,over_speed,stale_feedback";
// The last ones are what an identification says that ends by itself.
constexpr std::string_view kStillNames =
    "encoder_implausible,over_speed,left_wheel_does_not_turn,right_wheel_does_not_turn";
constexpr std::string_view kSignNames =
    "encoder_implausible,over_speed,stale_feedback,left_wheel_against_torque,right_wheel_against_torque,"
    "one_sign_wrong";
constexpr std::string_view kForeignNames = "foreign_control,drive_error,drive_left_armed_state";

constexpr std::array kKinds{
    // ---- emergency stop
    TortureKind{"stop_line", "the emergency-stop line becomes active", Expect::stops, "emergency_stop_line",
                [](Scene& s) { s.sim().emergency_stop().set(hal::LineLevel::active); }, nullptr, two_cycles,
                "2 cycles"},
    TortureKind{"stop_line_blip", "the line is active for two milliseconds", Expect::stops,
                "emergency_stop_line",
                [](Scene& s) { s.sim().emergency_stop().set(hal::LineLevel::active); },
                [](Scene& s) {
                    if (++s.count == 2) s.sim().emergency_stop().set(hal::LineLevel::inactive);
                },
                two_cycles, "2 cycles"},
    TortureKind{"stop_line_broken", "the line cannot be read", Expect::stops, "emergency_stop_line",
                [](Scene& s) { s.sim().emergency_stop().set(hal::LineLevel::unknown); }, nullptr, two_cycles,
                "2 cycles"},
    TortureKind{"stop_message", "EmergencyStop from the host", Expect::stops, "emergency_stop_message",
                [](Scene& s) { s.sim().host().emergency_stop(); }, nullptr, two_cycles, "2 cycles after the frame", From::told},
    TortureKind{"stop_on_drive_bus", "EmergencyStop on the drives' bus", Expect::stops,
                "emergency_stop_message", [](Scene& s) { s.foreign(stop_frame()); }, nullptr, two_cycles,
                "2 cycles after the frame", From::told},
    TortureKind{"stop_and_clear", "stop, clear and a mode in one cycle", Expect::stops,
                "emergency_stop_message",
                [](Scene& s) {
                    s.sim().host().emergency_stop();
                    s.sim().host().clear_fault();
                    s.sim().host().mode(s.setup().mode);
                },
                nullptr, two_cycles, "2 cycles after the frame", From::told},
    TortureKind{"clear_and_stop", "a mode, clear and stop in one cycle", Expect::stops,
                "emergency_stop_message",
                [](Scene& s) {
                    s.sim().host().mode(Mode::idle);
                    s.sim().host().clear_fault();
                    s.sim().host().emergency_stop();
                },
                nullptr, two_cycles, "2 cycles after the frame", From::told},
    TortureKind{"stop_while_arming", "a stop message while the drives are armed anew", Expect::stops,
                "emergency_stop_message", begin_arming,
                [](Scene& s) {
                    if (!while_arming(s)) return;
                    s.forget_told();  // what the drives have said before
                    s.sim().host().emergency_stop();
                    if (s.setup().separate_host_bus) s.tell();  // nothing is in its way
                },
                two_cycles, "2 cycles after the frame", From::told, 1.5},
    TortureKind{"stop_in_a_fault", "the host falls silent and the encoders' frames stop, then a stop message",
                Expect::stops, "emergency_stop_message",
                [](Scene& s) {
                    s.drive().faults().mute = true;
                    s.sim().host().silence();
                },
                [](Scene& s) {
                    if (++s.count == 50) s.sim().host().emergency_stop();
                },
                feedback_timeout, "feedback's time-out + 1 cycle and the way"},
    TortureKind{"terminated", "the process is asked to end", Expect::stops, "terminated",
                [](Scene& s) { s.sim().cycle().request_termination(); }, nullptr, ramp, "the braking ramp",
                From::harm, 2.5, 0.1, false, true},
    TortureKind{"idle", "the host asks for idle", Expect::rests, "",
                [](Scene& s) {
                    s.sim().host().mode(Mode::idle);  // one of the two has a counter that is new
                    s.sim().host().mode(Mode::idle);
                },
                nullptr, ramp, "the braking ramp",
                From::harm, 1},
    TortureKind{"idle_repeated", "it asks for idle in each tenth of a second", Expect::rests, "", nullptr,
                [](Scene& s) {
                    if (++s.count % 100 == 1) s.sim().host().mode(Mode::idle);
                },
                ramp, "the braking ramp", From::harm, 1},
    // ---- drives
    TortureKind{"drive_error", "a drive finds a fault of its own", Expect::stops, "drive_error",
                [](Scene& s) { s.drive().raise_error(s.setup().truth.drive.generation == 5 ? 0x40 : 0x10); },
                nullptr, two_cycles, "2 cycles after its heartbeat", From::told},
    TortureKind{"drive_error_while_arming", "a drive finds a fault while it is armed anew", Expect::obeys,
                "drive_error,arming_refused,drive_left_armed_state", begin_arming,
                [](Scene& s) {
                    if (while_arming(s))
                        s.drive().raise_error(s.setup().truth.drive.generation == 5 ? 0x40 : 0x10);
                },
                nullptr, "", From::harm, 1.5},
    TortureKind{"drive_under_voltage", "a drive stops as its supply sinks", Expect::stops, "drive_error",
                [](Scene& s) { s.drive().raise_error(s.setup().truth.drive.generation == 5 ? 0x2 : 0x200); },
                nullptr, two_cycles, "2 cycles after its heartbeat", From::told},
    TortureKind{"drive_over_temperature", "a drive stops as it is too hot", Expect::stops, "drive_error",
                [](Scene& s) {
                    s.drive().raise_error(s.setup().truth.drive.generation == 5 ? 0x2'0000 : 0x4000);
                },
                nullptr, two_cycles, "2 cycles after its heartbeat", From::told},
    TortureKind{"drive_drops_out", "a drive leaves closed loop without an error", Expect::stops,
                kDropsOutNames, [](Scene& s) { s.drive().faults().motor_unplugged = true; },
                nullptr, two_cycles, "2 cycles after its heartbeat", From::told},
    TortureKind{"drive_off", "a drive loses its supply", Expect::stops, kSilenceNames,
                [](Scene& s) { s.drive().faults().powered_off = true; }, nullptr, feedback_timeout,
                "feedback's time-out + 1 cycle and the way"},
    TortureKind{"drive_reboots", "a drive is off for 30 to 300 ms and comes back idle", Expect::stops,
                kSilenceNames,
                [](Scene& s) {
                    s.drive().faults().powered_off = true;
                    s.amount = s.uniform(30, 300);
                },
                [](Scene& s) { s.drive().faults().powered_off = ++s.count < std::int64_t(s.amount); },
                feedback_timeout, "feedback's time-out + 1 cycle and the way"},
    TortureKind{"drive_blinks", "a drive is off for 2 to 8 ms and comes back idle, at position 0",
                Expect::stops, "drive_left_armed_state,encoder_implausible,stale_feedback",
                [](Scene& s) {
                    s.drive().faults().powered_off = true;
                    s.amount = s.uniform(2, 8);
                },
                [](Scene& s) {
                    s.drive().faults().powered_off = ++s.count < std::int64_t(s.amount);
                },
                two_cycles, "2 cycles after its heartbeat", From::told},
    TortureKind{"drive_reboots_armed",
                "a drive is off for 30 to 300 ms and comes back in closed loop, in position control",
                Expect::stops, "stale_feedback,drive_silent,foreign_control",
                [](Scene& s) {
                    s.drive().faults().powered_off = true;
                    s.drive().faults().wakes_armed = s.told_by_return = true;
                    s.amount = s.uniform(30, 300);
                },
                [](Scene& s) {
                    s.has_returned = ++s.count >= std::int64_t(s.amount);
                    s.drive().faults().powered_off = !s.has_returned;
                },
                two_cycles, "2 cycles after its first frame", From::told},
    TortureKind{"drive_blinks_armed", "the same within 2 to 8 ms", Expect::either,
                // In another mode it follows no torque.
                "drive_left_armed_state,encoder_implausible,stale_feedback,foreign_control,torque_not_followed",
                [](Scene& s) {
                    s.drive().faults().powered_off = true;
                    s.drive().faults().wakes_armed = true;
                    s.amount = s.uniform(2, 8);
                },
                [](Scene& s) { s.drive().faults().powered_off = ++s.count < std::int64_t(s.amount); },
                nullptr, "", From::harm, 1, 1},
    TortureKind{"drive_mute", "a drive sends nothing and obeys", Expect::stops, kSilenceNames,
                [](Scene& s) { s.drive().faults().mute = true; }, nullptr, feedback_timeout,
                "feedback's time-out + 1 cycle and the way"},
    // It holds its last torque until its watchdog ends it: to who only sees the wheel, a lie.
    TortureKind{"drive_deaf", "a drive hears nothing", Expect::stops,
                "drive_error,drive_left_armed_state,torque_not_followed,encoder_implausible",
                [](Scene& s) { s.drive().faults().deaf = true; }, nullptr, deaf_watchdog,
                "its watchdog, its heartbeat + 2 cycles", From::harm, 1, 0.1, true},
    TortureKind{"no_heartbeats", "a drive's heartbeats are lost", Expect::stops, "drive_silent",
                [](Scene& s) {
                    hears(s, kHeartbeat, [](Scene&, hal::ReceivedFrame&) { return Deal::lose; });
                },
                nullptr, silence_timeout, "heartbeat's time-out + 1 cycle and the way"},
    TortureKind{"no_encoder_frames", "a drive's encoder frames are lost", Expect::stops, "stale_feedback",
                [](Scene& s) {
                    hears(s, kEncoder, [](Scene&, hal::ReceivedFrame&) { return Deal::lose; });
                },
                nullptr, feedback_timeout, "feedback's time-out + 1 cycle and the way"},
    TortureKind{"no_torque_reports", "the drives' torque reports are lost", Expect::serves, "",
                [](Scene& s) {
                    all_of(s.firmware_bus(), s, [](Scene&, hal::ReceivedFrame& r) {
                        const std::uint32_t command = r.frame.id & 0x1FU;
                        return r.frame.id < 0x600 && (command == odrive::GetTorques::command ||
                                                      command == odrive::GetIq::command)
                                   ? Deal::lose
                                   : Deal::pass;
                    });
                }},
    // ---- lies
    TortureKind{"lie_error_bits", "heartbeats with an error that is none", Expect::stops, "drive_error",
                [](Scene& s) {
                    hears(s, kHeartbeat, [](Scene& scene, hal::ReceivedFrame& r) {
                        put(r.frame, 0, std::uint32_t{0x10});
                        scene.tell();
                        return Deal::pass;
                    });
                },
                nullptr, two_cycles, "2 cycles after the heartbeat", From::told},
    TortureKind{"lie_axis_state", "heartbeats that say idle", Expect::stops, "drive_left_armed_state",
                [](Scene& s) {
                    hears(s, kHeartbeat, [](Scene& scene, hal::ReceivedFrame& r) {
                        r.frame.data[4] = 1;
                        scene.tell();
                        return Deal::pass;
                    });
                },
                nullptr, two_cycles, "2 cycles after the heartbeat", From::told},
    TortureKind{"lie_one_wild_position", "one encoder frame is wild: no number, 3e38 or some turns off",
                Expect::serves, "",
                [](Scene& s) {
                    hears(s, kEncoder, [](Scene& scene, hal::ReceivedFrame& r) {
                        if (scene.count++ > 0) return Deal::pass;
                        const std::array<float, 6> wild{std::numeric_limits<float>::quiet_NaN(),
                                                        std::numeric_limits<float>::infinity(), 3e38F, -1e9F,
                                                        number(r.frame, 0) + 40, number(r.frame, 0) - 3};
                        put(r.frame, 0, wild[scene.random().bits() % wild.size()]);
                        return Deal::pass;
                    });
                }},
    TortureKind{"lie_wild_positions", "every encoder frame is wild", Expect::stops, kLieNames,
                [](Scene& s) {
                    hears(s, kEncoder, [](Scene& scene, hal::ReceivedFrame& r) {
                        put(r.frame, 0, static_cast<float>(scene.uniform(-1, 1) * 1e6));
                        return Deal::pass;
                    });
                },
                nullptr, implausible, "100 ms"},
    TortureKind{"lie_not_a_number", "every encoder frame holds NaN", Expect::stops, "stale_feedback",
                [](Scene& s) {
                    hears(s, kEncoder, [](Scene&, hal::ReceivedFrame& r) {
                        put(r.frame, 0, std::numeric_limits<float>::quiet_NaN());
                        return Deal::pass;
                    });
                },
                nullptr, feedback_timeout, "feedback's time-out + 1 cycle and the way"},
    TortureKind{"lie_speed", "the drive's own speed estimate is random, its position true", Expect::serves,
                "",
                [](Scene& s) {
                    hears(s, kEncoder, [](Scene& scene, hal::ReceivedFrame& r) {
                        put(r.frame, 4, static_cast<float>(scene.uniform(-100, 100)));
                        return Deal::pass;
                    });
                }},
    TortureKind{"lie_speed_one_wild", "one speed estimate of 1e30", Expect::serves, "",
                [](Scene& s) {
                    hears(s, kEncoder, [](Scene& scene, hal::ReceivedFrame& r) {
                        if (scene.count++ == 0) put(r.frame, 4, 1e30F);
                        return Deal::pass;
                    });
                }},
    TortureKind{"lie_torque", "the reported torque is random", Expect::serves, "",
                [](Scene& s) {
                    all_of(s.firmware_bus(), s, [](Scene& scene, hal::ReceivedFrame& r) {
                        const std::uint32_t command = r.frame.id & 0x1FU;
                        if (r.frame.id < 0x600 && (command == odrive::GetTorques::command ||
                                                   command == odrive::GetIq::command)) {
                            put(r.frame, 4, static_cast<float>(scene.uniform(-50, 50)));
                        }
                        return Deal::pass;
                    });
                }},
    TortureKind{"lie_sign", "an encoder counts the other way from where it is", Expect::stops, kSignNames,
                [](Scene& s) {
                    s.drive().reverse_encoder();
                    s.reversed = true;
                    s.untold_rad = twice_the_way;
                },
                nullptr, implausible, kImplausible, From::lie},
    TortureKind{"lie_frozen", "an encoder stands still", Expect::stops, kStillNames,
                [](Scene& s) {
                    s.drive().faults().frozen_encoder = true;
                    s.untold_rad = the_way;
                },
                nullptr, implausible, kImplausible, From::lie, 1.5},
    TortureKind{"lie_both_frozen", "both encoders stand still", Expect::stops, kStillNames,
                [](Scene& s) {
                    s.sim().world().left().faults().frozen_encoder = true;
                    s.sim().world().right().faults().frozen_encoder = true;
                    s.untold_rad = either_way;
                },
                nullptr, implausible, kImplausible, From::lie, 1.5},
    TortureKind{"lie_frame_repeated", "the last encoder frame comes again and again, fresh", Expect::stops,
                kStillNames,
                [](Scene& s) {
                    s.untold_rad = the_way;
                    hears(s, kEncoder, [](Scene& scene, hal::ReceivedFrame& r) {
                        if (scene.count++ == 0) scene.amount = double{number(r.frame, 0)};
                        put(r.frame, 0, static_cast<float>(scene.amount));
                        return Deal::pass;
                    });
                },
                nullptr, implausible, kImplausible, From::lie, 1.5},
    TortureKind{"lie_half_speed", "an encoder's positions tell half of the way, its speeds all of it",
                Expect::either, kLieNames,
                [](Scene& s) {
                    hears(s, kEncoder, [](Scene& scene, hal::ReceivedFrame& r) {
                        tell_half_of_the_way(scene, r.frame);
                        return Deal::pass;
                    });
                },
                nullptr, nullptr, "", From::harm, 1, 10},
    TortureKind{"lie_half_counts", "an encoder misses every other count: half of the way, half of the speed",
                Expect::either, kLieNames,
                [](Scene& s) {
                    hears(s, kEncoder, [](Scene& scene, hal::ReceivedFrame& r) {
                        tell_half_of_the_way(scene, r.frame);
                        put(r.frame, 4, number(r.frame, 4) / 2);
                        return Deal::pass;
                    });
                },
                nullptr, nullptr, "", From::harm, 1, 10},
    TortureKind{"origin_jump", "a drive's position becomes 0", Expect::serves, "",
                [](Scene& s) { s.drive().zero_position(); }},
    // A drive whose position breaks off looks like one that was off for a moment.
    TortureKind{"swapped_nodes", "the two drives' encoder frames change names", Expect::either,
                "encoder_implausible,over_speed,stale_feedback,drive_left_armed_state",
                [](Scene& s) {
                    all_of(s.firmware_bus(), s, [](Scene& scene, hal::ReceivedFrame& r) {
                        const std::uint32_t left = scene.id(0, kEncoder);
                        const std::uint32_t right = scene.id(1, kEncoder);
                        if (r.frame.error || r.frame.extended) return Deal::pass;
                        if (r.frame.id == left) {
                            r.frame.id = right;
                        } else if (r.frame.id == right) {
                            r.frame.id = left;
                        }
                        return Deal::pass;
                    });
                },
                nullptr, nullptr, "", From::harm, 1, 10},
    TortureKind{"strange_nodes", "encoder frames and heartbeats of drives that are not ours", Expect::serves,
                "", nullptr,
                [](Scene& s) {
                    const auto node = static_cast<std::uint32_t>(s.random().bits() % 48);  // telemetry has the upper ones
                    if (node == s.node(0) || node == s.node(1)) return;
                    hal::CanFrame frame = s.to_drive(0, 0, bits_of(1e3F), bits_of(1e3F));
                    frame.id = node << 5U | (s.random().bits() % 2 != 0 ? kEncoder : kHeartbeat);
                    s.foreign(frame);
                }},
    TortureKind{"short_encoder_frames", "a drive's encoder frames lose bytes", Expect::stops,
                "stale_feedback",
                [](Scene& s) {
                    hears(s, kEncoder, [](Scene& scene, hal::ReceivedFrame& r) {
                        r.frame.length = static_cast<std::uint8_t>(scene.random().bits() % 8);
                        return Deal::pass;
                    });
                },
                nullptr, feedback_timeout, "feedback's time-out + 1 cycle and the way"},
    TortureKind{"short_heartbeats", "a drive's heartbeats lose bytes", Expect::stops, "drive_silent",
                [](Scene& s) {
                    hears(s, kHeartbeat, [](Scene& scene, hal::ReceivedFrame& r) {
                        r.frame.length = static_cast<std::uint8_t>(scene.random().bits() % 8);
                        return Deal::pass;
                    });
                },
                nullptr, silence_timeout, "heartbeat's time-out + 1 cycle and the way"},
    TortureKind{"extended_and_remote", "extended and remote frames with the identifiers of drives and host",
                Expect::serves, "", nullptr,
                [](Scene& s) {
                    hal::CanFrame frame = s.to_drive(s.setup().side, kEncoder, bits_of(1e3F), bits_of(1e3F));
                    const std::array<std::uint32_t, 4> ids{frame.id, s.id(0, kHeartbeat),
                                                           protocol::EmergencyStop::id,
                                                           protocol::ModeCommand::id};
                    frame.id = ids[s.random().bits() % ids.size()];
                    if (s.random().bits() % 2 != 0) {
                        frame.extended = true;
                    } else {
                        frame.remote = true;
                        frame.length = 0;
                    }
                    s.foreign(frame);
                }},
    TortureKind{"low_supply_reported", "drives report a supply of 5 V", Expect::stops,
                "drive_voltage_out_of_range", nullptr,
                [](Scene& s) {
                    for (const std::size_t side : {0U, 1U})
                        s.foreign(s.to_drive(side, odrive::GetBusVoltageCurrent::command, bits_of(5.F)));
                },
                implausible, "100 ms"},
    TortureKind{"high_supply_reported", "a drive reports a supply of 80 V", Expect::stops,
                "drive_voltage_out_of_range", nullptr,
                [](Scene& s) {
                    s.foreign(s.to_drive(s.setup().side, odrive::GetBusVoltageCurrent::command, bits_of(80.F)));
                },
                implausible, "100 ms"},
    TortureKind{"wild_reports", "one report in ten of supply and heat is wild: no number, 0 or 3e38",
                Expect::serves, "", nullptr,
                [](Scene& s) {
                    constexpr std::array<float, 4> kWild{std::numeric_limits<float>::quiet_NaN(), 0, 3e38F,
                                                         -3e38F};
                    const bool wild = ++s.count % 10 == 0;
                    const auto value = [&](float plain) { return bits_of(wild ? kWild[s.random().bits() % 4] : plain); };
                    const std::size_t side = s.setup().side;
                    s.foreign(s.to_drive(side, odrive::GetBusVoltageCurrent::command, value(24)));
                    s.foreign(s.to_drive(side, odrive::GetTemperature::command, value(40), value(40)));
                }},
    // A drive of 0.5 has no such frame, and tells heat by its error.
    TortureKind{"heat_reported", "drives report 130 degC", Expect::stops, "drive_overheated,drive_error",
                [](Scene& s) {
                    if (s.setup().truth.drive.generation == 5) s.drive().raise_error(0x2'0000);
                },
                [](Scene& s) {
                    if (s.setup().truth.drive.generation == 5) return;
                    for (const std::size_t side : {0U, 1U})
                        s.foreign(s.to_drive(side, odrive::GetTemperature::command, bits_of(130.F),
                                             bits_of(130.F)));
                },
                implausible, "100 ms"},
    // ---- the bus
    TortureKind{"bus_down", "the interface goes down", Expect::stops, "bus_down",
                [](Scene& s) { s.sim().bus().set_down(0, true); }, nullptr, watchdogs, "the drives' watchdogs",
                From::harm, 1, 0.1, true},
    TortureKind{"bus_off", "the controller goes bus-off", Expect::stops, "bus_down",
                [](Scene& s) { s.sim().bus().set_bus_off(0); }, nullptr, watchdogs, "the drives' watchdogs",
                From::harm, 1, 0.1, true},
    TortureKind{"bus_flap", "the interface is down for 1 to 30 ms", Expect::stops,
                "bus_down",
                [](Scene& s) {
                    s.sim().bus().set_down(0, true);
                    s.amount = s.uniform(1, 30);
                },
                [](Scene& s) {
                    if (++s.count == std::int64_t(s.amount)) s.sim().bus().set_down(0, false);
                },
                watchdogs, "the drives' watchdogs", From::harm, 1, 0.1, true},
    TortureKind{"bus_jam", "lower identifiers fill the drives' bus for 12 to 100 ms", Expect::stops,
                "bus_down,stale_feedback,drive_silent",
                [](Scene& s) {
                    s.amount = s.uniform(0.012, 0.1);
                    jam_bus(s);
                },
                jam_bus,
                jam, "the jam, what waits, + 2 cycles; the watchdogs in a longer one", From::harm, 1, 0.1, true},
    TortureKind{"bus_flood", "a lower identifier takes half of the drives' bus", Expect::serves, "", nullptr,
                [](Scene& s) {
                    for (int i = 0; i < 2; ++i) s.foreign(lowest());
                }},
    TortureKind{"transmit_refused", "the transmit queue takes nothing any more", Expect::stops, "bus_down",
                [](Scene& s) {
                    s.firmware_bus().on_send([](hal::ReceivedFrame&) { return Deal::refuse; });
                },
                nullptr, watchdogs, "the drives' watchdogs", From::harm, 1, 0.1, true},
    TortureKind{"transmit_refused_briefly", "it takes nothing for 3 ms", Expect::serves, "",
                [](Scene& s) {
                    s.firmware_bus().on_send(
                        [&s](hal::ReceivedFrame&) { return s.count < 3 ? Deal::refuse : Deal::pass; });
                },
                [](Scene& s) { ++s.count; }},
    TortureKind{"torques_lost", "what the firmware sends is lost", Expect::stops,
                "drive_error,drive_left_armed_state,torque_not_followed,encoder_implausible",
                [](Scene& s) { s.firmware_bus().on_send([](hal::ReceivedFrame&) { return Deal::lose; }); },
                nullptr, watchdogs, "the drives' watchdogs", From::harm, 1, 0.1, true},
    TortureKind{"loss_1_percent", "one frame of a hundred is lost, each way", Expect::serves, "",
                [](Scene& s) { lose_some(s, 0.01); }},
    TortureKind{"loss_20_percent", "one frame of five is lost, each way", Expect::either,
                "stale_command,stale_feedback,drive_silent,encoder_implausible",
                [](Scene& s) { lose_some(s, 0.2); }, nullptr, nullptr, "", From::harm, 1, 0.5, true},
    TortureKind{"loss_burst", "everything is lost for 5 ms", Expect::serves, "",
                [](Scene& s) { lose_some(s, 1); },
                [](Scene& s) {
                    if (++s.count == 5) s.restore();
                }},
    TortureKind{"delay", "frames reach the firmware 0.5 to 1 ms late, each otherwise", Expect::serves, "",
                [](Scene& s) { s.sim().bus().set_receive_latency(0, 500'000, 500'000); }},
    TortureKind{"long_delay", "frames reach the firmware late by one and a half of feedback's time-out",
                Expect::stops, "stale_feedback",
                [](Scene& s) {
                    const double late_s = 1.5 * s.setup().believed.safety.stale_feedback_s;
                    s.sim().bus().set_receive_latency(0, std::llround(1e9 * late_s), 0);
                },
                nullptr,
                feedback_timeout, "feedback's time-out + 1 cycle and the way"},
    TortureKind{"late_torques", "the drives hear 1 ms late", Expect::serves, "",
                [](Scene& s) { s.sim().bus().set_receive_latency(1, 1'000'000, 0); }, nullptr, nullptr, "",
                From::harm, 1, 0.3},
    TortureKind{"reorder", "a third of the frames come behind the next one, each way", Expect::serves, "",
                [](Scene& s) {
                    const auto swap = [](Scene& scene, hal::ReceivedFrame&) {
                        return scene.random().bits() % 3 == 0 ? Deal::later : Deal::pass;
                    };
                    all_of(s.firmware_bus(), s, swap);
                    all_of(s.robot_bus(), s, swap);
                }},
    TortureKind{"duplicate", "every frame comes twice, each way", Expect::serves, "",
                [](Scene& s) {
                    const auto twice = [](Scene&, hal::ReceivedFrame&) { return Deal::twice; };
                    all_of(s.firmware_bus(), s, twice);
                    all_of(s.robot_bus(), s, twice);
                    if (s.setup().separate_host_bus) all_of(s.host_bus(), s, twice);
                }},
    TortureKind{"corrupt_host", "a bit of each third host frame is flipped", Expect::either, "stale_command",
                [](Scene& s) {
                    all_of(s.host_bus(), s, [](Scene& scene, hal::ReceivedFrame& r) {
                        if (r.frame.id > 0x600 && r.frame.length > 0 && scene.random().bits() % 3 == 0)
                            r.frame.data[scene.random().bits() % r.frame.length] ^=
                                static_cast<std::uint8_t>(1U << scene.random().bits() % 8);
                        return Deal::pass;
                    });
                }},
    TortureKind{"error_frames", "an error frame in each millisecond", Expect::serves, "", nullptr,
                [](Scene& s) { s.sim().bus().inject_error_frame(sim::InProcessBus::error_bus); }},
    TortureKind{"destroyed_frames", "one frame of thirty is destroyed on the wire and repeated", Expect::serves,
                "",
                [](Scene& s) {
                    sim::FaultRule rule;
                    rule.action = sim::FaultAction::destroy;
                    rule.probability = 1.0 / 30;
                    s.sim().bus().add_fault(rule);
                }},
    // ---- time
    TortureKind{"stall_short", "the computer stands still for one or two cycles", Expect::serves, "",
                [](Scene& s) { s.sim().stall(s.uniform(0.001, 0.002)); }},
    TortureKind{"stall", "it stands still for 5 to 40 ms", Expect::stops, "cycle_overrun",
                [](Scene& s) {
                    s.sim().stall(s.uniform(0.005, 0.04));
                    s.tell();
                },
                nullptr, two_cycles, "2 cycles after it runs again", From::told},
    TortureKind{"stall_long", "it stands still for 300 ms", Expect::stops, "cycle_overrun",
                [](Scene& s) {
                    s.sim().stall(0.3);
                    s.tell();
                },
                nullptr, two_cycles, "2 cycles after it runs again", From::told},
    TortureKind{"overruns", "each twentieth cycle is missed", Expect::stops, "cycle_overrun", nullptr,
                [](Scene& s) {
                    if (++s.count % 20 != 0) return;
                    s.sim().stall(0.0018);
                    if (s.count == 200) s.tell();
                },
                two_cycles, "2 cycles after the tenth within a second", From::told},
    TortureKind{"late_cycles", "each cycle wakes up to 0.4 ms late", Expect::serves, "", nullptr,
                [](Scene& s) {
                    s.sim().stall(kCycle_s - s.setup().believed.realtime.send_phase_s + s.uniform(0, 0.0004));
                },
                nullptr, "", From::harm, 1, 0.3},
    TortureKind{"clock_forward", "receive times jump ahead by a minute", Expect::either, "stale_feedback",
                [](Scene& s) {
                    all_of(s.firmware_bus(), s, [](Scene&, hal::ReceivedFrame& r) {
                        r.timestamp_ns += 60'000'000'000;
                        return Deal::pass;
                    });
                },
                nullptr, nullptr, "", From::harm, 1, 0.5},
    TortureKind{"clock_back", "receive times jump back by a minute", Expect::stops,
                "stale_feedback,drive_silent",
                [](Scene& s) {
                    all_of(s.firmware_bus(), s, [](Scene&, hal::ReceivedFrame& r) {
                        r.timestamp_ns -= 60'000'000'000;
                        return Deal::pass;
                    });
                },
                nullptr, feedback_timeout, "feedback's time-out + 1 cycle and the way"},
    TortureKind{"clock_shakes", "receive times are off by up to 2 ms, each otherwise", Expect::either,
                "encoder_implausible,over_speed",
                [](Scene& s) {
                    all_of(s.firmware_bus(), s, [](Scene& scene, hal::ReceivedFrame& r) {
                        r.timestamp_ns -= static_cast<std::int64_t>(scene.uniform(0, 2e6));
                        return Deal::pass;
                    });
                },
                nullptr, nullptr, "", From::harm, 1, 1},
    // ---- hosts
    TortureKind{"host_gone", "the host sends nothing any more", Expect::stops, "*",
                [](Scene& s) {
                    s.sim().host().vanish();
                    s.undo = [&s] { s.sim().host().external_poses(true); };
                },
                nullptr, host_timeout, "the set-points' or the host's time-out + 1 cycle and the way"},
    TortureKind{"second_host_drives", "a second host sends set-points and poses in each millisecond",
                Expect::obeys, "over_speed,stale_command,encoder_implausible", nullptr, random_setpoints},
    TortureKind{"second_host_modes", "a second host asks for another mode in each millisecond",
                Expect::obeys, "over_speed,stale_command,arming_refused,drive_left_armed_state", nullptr,
                random_mode},
    TortureKind{"mode_storm", "modes, clears and set-points at random, together", Expect::obeys,
                "over_speed,stale_command,arming_refused,drive_left_armed_state", nullptr,
                [](Scene& s) {
                    random_mode(s);
                    random_setpoints(s);
                    if (s.random().bits() % 8 == 0) s.second_host(protocol::ClearFault{});
                }},
    TortureKind{"stop_in_a_mode_storm", "the same, and a stop message in between", Expect::stops,
                "emergency_stop_message", [](Scene& s) { s.sim().host().emergency_stop(); },
                [](Scene& s) {
                    random_mode(s);
                    random_setpoints(s);
                },
                two_cycles_in_a_storm, "2 cycles after the frame, and on one bus 5 frames", From::told},
    TortureKind{"clear_while_driving", "ClearFault in each millisecond", Expect::serves, "", nullptr,
                [](Scene& s) { s.second_host(protocol::ClearFault{}); }},
    TortureKind{"commits_while_driving", "parameters are written and committed in each millisecond",
                Expect::serves, "", nullptr,
                [](Scene& s) {
                    const auto table = model::parameter_table();
                    const model::ParameterInfo& info = table[s.random().bits() % table.size()];
                    if (info.when == model::ChangeWhen::any) return;  // those may act, as they are meant to
                    parameter(s, protocol::ParameterOperation::write, info.index,
                              static_cast<float>(info.maximum));
                    parameter(s, protocol::ParameterOperation::commit);
                }},
    TortureKind{"commit_then_drive", "wild parameters are committed in idle, then a mode is asked for",
                Expect::obeys, "*",
                [](Scene& s) { s.sim().host().mode(Mode::idle); },
                [](Scene& s) {
                    const auto table = model::parameter_table();
                    const model::ParameterInfo& info = table[s.random().bits() % table.size()];
                    // A robot's limits may be changed by who may change parameters.
                    if (info.key.starts_with("limits.") || info.key.starts_with("geometry.") ||
                        info.key.starts_with("drive."))
                        return;
                    parameter(s, protocol::ParameterOperation::write, info.index,
                              static_cast<float>(s.uniform(info.minimum, std::min(info.maximum, 1e3))));
                    parameter(s, protocol::ParameterOperation::commit);
                    if (++s.count == 600) s.sim().host().mode(s.setup().mode);
                },
                nullptr, "", From::harm, 1.5, 0.1, false, true},
    TortureKind{"save_while_driving", "the robot file is saved in each tenth of a second", Expect::serves, "",
                nullptr,
                [](Scene& s) {
                    if (++s.count % 100 == 1) parameter(s, protocol::ParameterOperation::save);
                    if (s.sim().mailbox().take() != nullptr && s.count % 100 == 50)
                        s.sim().mailbox().finished(s.random().bits() % 2 != 0);
                }},
    TortureKind{"path_while_driving", "trajectories and ident settings in each millisecond", Expect::serves,
                "", nullptr,
                [](Scene& s) {
                    protocol::TrajectoryCommand path;
                    path.shape = static_cast<protocol::TrajectoryShape>(s.random().bits() % 5);
                    path.length_m = s.uniform(0, 60);
                    path.width_m = s.uniform(0, 60);
                    path.period_s = s.uniform(0, 600);
                    s.second_host(path);
                    protocol::IdentSettings settings;
                    settings.amplitude_Nm = 12;
                    settings.distance_limit_m = 25;
                    s.second_host(settings);
                }},
    TortureKind{"wild_poses", "external poses that are tens of metres off", Expect::either,
                "over_speed",
                nullptr,
                [](Scene& s) {
                    protocol::ExternalPose pose;
                    pose.x_m = s.uniform(-60, 60);
                    pose.y_m = s.uniform(-60, 60);
                    pose.heading_rad = s.uniform(-3.1, 3.1);
                    if (++s.count % 10 == 0) s.second_host(pose);
                },
                nullptr, "", From::harm, 1, 10},
    TortureKind{"bad_payloads", "commands with a good checksum and values out of range", Expect::serves, "",
                nullptr,
                [](Scene& s) {
                    hal::CanFrame frame;
                    const std::array<std::pair<std::uint32_t, std::uint8_t>, 3> of{
                        {{protocol::ModeCommand::id, protocol::ModeCommand::length},
                         {protocol::ParameterRequest::id, protocol::ParameterRequest::length},
                         {protocol::TrajectoryCommand::id, protocol::TrajectoryCommand::length}}};
                    const auto& [id, length] = of[s.random().bits() % of.size()];
                    frame.id = id;
                    frame.length = length;
                    frame.data.fill(0xFF);
                    protocol::seal({frame.data.data(), length},
                                   static_cast<std::uint8_t>(s.random().bits() % 15));
                    s.sim().host_bus().send(frame);
                }},
    // ---- somebody else at the drives
    TortureKind{"foreign_torque", "a second host gives one drive torques", Expect::stops, kForeignNames,
                nullptr, [](Scene& s) { repeat_setpoint(s, s.setup().side, 0.5F); }, outvoted, "5 ms"},
    TortureKind{"foreign_velocity", "a second host gives one drive velocity set-points", Expect::stops,
                kForeignNames, nullptr,
                [](Scene& s) {
                    s.foreign(s.to_drive(s.setup().side, odrive::SetInputVel::command, bits_of(20.F)));
                },
                outvoted, "5 ms"},
    TortureKind{"foreign_mode", "a second host sets a drive's control mode", Expect::stops, kForeignNames,
                [](Scene& s) {
                    s.foreign(s.to_drive(s.setup().side, odrive::SetControllerMode::command, 2, 1));
                },
                nullptr, outvoted, "5 ms"},
    TortureKind{"foreign_arming", "a second host arms both drives again and again and gives them torques",
                Expect::stops, kForeignNames, nullptr,
                [](Scene& s) {
                    const std::size_t side = static_cast<std::size_t>(++s.count % 2);
                    if (s.count % 10 < 2) {
                        s.foreign(s.to_drive(side, odrive::SetAxisState::command, kClosedLoop, 0, 4));
                        s.foreign(s.to_drive(side, odrive::SetControllerMode::command, kTorqueControl, 1));
                    }
                    repeat_setpoint(s, side, 0.5F);
                },
                outvoted, "5 ms"},
    TortureKind{"foreign_arming_flood", "the same in each millisecond, which fills a shared bus",
                Expect::stops, kForeignNames, nullptr,
                [](Scene& s) {
                    const std::size_t side = static_cast<std::size_t>(++s.count % 2);
                    s.foreign(s.to_drive(side, odrive::SetAxisState::command, kClosedLoop, 0, 4));
                    s.foreign(s.to_drive(side, odrive::SetControllerMode::command, kTorqueControl, 1));
                    repeat_setpoint(s, side, 0.5F);
                },
                outvoted, "5 ms"},
    TortureKind{"foreign_idle", "a second host tells a drive to be idle", Expect::stops,
                kDropsOutNames,
                [](Scene& s) {
                    s.foreign(s.to_drive(s.setup().side, odrive::SetAxisState::command, 1, 0, 4));
                },
                nullptr, two_cycles, "2 cycles after its heartbeat", From::told},
    TortureKind{"foreign_estop", "a second host sends a drive its Estop", Expect::stops, "drive_error",
                [](Scene& s) { s.foreign(s.to_drive(s.setup().side, odrive::Estop::command, 0, 0, 0)); },
                nullptr, two_cycles, "2 cycles after its heartbeat", From::told},
    TortureKind{"foreign_questions", "a second host sends requests that feed the drives' watchdogs",
                Expect::serves, "", nullptr,
                [](Scene& s) {
                    hal::CanFrame frame = s.to_drive(s.setup().side, odrive::GetError::command, 0, 0, 0);
                    frame.remote = true;
                    s.foreign(frame);
                }},
};

static_assert(kKinds.size() >= 40);

}  // namespace

std::span<const TortureKind> torture_kinds() { return kKinds; }

const TortureKind* find_torture_kind(std::string_view name) {
    const auto found = std::find_if(kKinds.begin(), kKinds.end(),
                                    [&](const TortureKind& kind) { return kind.name == name; });
    return found == kKinds.end() ? nullptr : &*found;
}

}  // namespace wheelwright::tools
