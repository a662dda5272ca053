// `wheelwright ctl`: commands a robot by CAN, or prints the frames for cansend.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "firmware/supervisor/modes.hpp"
#include "tools/cli/can_port.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/message_text.hpp"
#include "tools/cli/parameter_names.hpp"
#include "tools/ctl/identification.hpp"
#include "tools/ctl/link.hpp"

namespace wheelwright::tools {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

struct Options : LinkOptions {
    bool print = false;
    double rate_Hz = 0;
    double for_s = 0;
    bool enter = false;
    bool no_wait = false;
};

int complain(int status, const std::string& text) { return LinkOptions{}.complain(status, text); }

template <typename Values>
std::optional<typename Values::value_type> by_name(const Values& values, const std::string& name) {
    for (const auto value : values) {
        if (to_string_view(value) == name) return value;
    }
    return std::nullopt;
}

template <typename Values>
std::string names_of(const Values& values) {
    std::string text;
    for (const auto value : values) {
        if (!text.empty()) text += ", ";
        text += to_string_view(value);
    }
    return text;
}

// The modes that may be asked for.
std::vector<protocol::Mode> modes() {
    std::vector<protocol::Mode> modes;
    for (const supervisor::ModeRule& rule : supervisor::kModes) {
        if (rule.from != supervisor::From::nowhere) modes.push_back(rule.mode);
    }
    return modes;
}

int print_frames(const Options& options, const std::vector<Command>& commands) {
    if (!options.key.empty()) {
        return complain(kUsage, "--key with --print: the answer depends on the robot's challenge");
    }
    for (const Command& command : commands) {
        hal::CanFrame frame;
        const auto alive = static_cast<std::uint8_t>(std::max(options.alive, 0));
        if (const std::string wrong = command.make(alive, frame); !wrong.empty()) {
            return complain(kUsage, wrong);
        }
        std::printf("cansend %s %s\n", options.interface.c_str(), frame_text(frame).c_str());
    }
    return kDone;
}

// Waits until the state is `wanted`. Arming the drives takes a while; a refusal is final.
int await_state(Link& link, protocol::Mode wanted) {
    std::int64_t deadline_ns = can_now_ns() + kSecond_ns;
    const std::int64_t last_ns = can_now_ns() + link.longest_arming_ns();
    const std::int64_t settled_ns = can_now_ns() + kSecond_ns / 4;
    std::optional<protocol::Status> last;
    while (const auto status = link.wait_for<protocol::Status>(deadline_ns)) {
        last = status;
        if (status->state == wanted) {
            std::printf("%s\n", link.text_of(*status).c_str());
            return kDone;
        }
        if (can_now_ns() > settled_ns && !link.keeps_trying(*status)) break;
        if (can_now_ns() > last_ns) break;
        deadline_ns = std::min(can_now_ns() + kSecond_ns, last_ns);
    }
    if (interrupted()) return kAimMissed;
    if (!last.has_value()) {
        return complain(kAimMissed, "sent, but no Status frame came back: is the firmware running there?");
    }
    return complain(kAimMissed, "sent, but the state is not " + std::string(to_string_view(wanted)) + ": " +
                                    link.text_of(*last));
}

// After ClearFault: until the drives have told what is left of their errors.
int await_cleared(Link& link) {
    const int result = await_state(link, protocol::Mode::idle);
    if (result != kDone) return result;
    const std::int64_t last_ns = can_now_ns() + kSecond_ns;
    using protocol::DriveState;
    while (const auto status = link.wait_for<protocol::Status>(last_ns)) {
        const auto either = [&](DriveState state) {
            return status->drive_left == state || status->drive_right == state;
        };
        if (either(DriveState::arming)) continue;
        if (!either(DriveState::fault)) return kDone;
        for (int i = 0; i < 2; ++i) link.wait_for<protocol::DriveError>(can_now_ns() + kSecond_ns / 4);
        return complain(kAimMissed, "idle, but a drive keeps its error: " + link.drive_errors().text());
    }
    return interrupted() ? kAimMissed : kDone;
}

// After idle has been asked for: until the robot has braked and is there, so that what is asked next is not
// refused for its motion. A second Ctrl-C ends this too.
int await_rest(Link& link) {
    constexpr std::int64_t kLongest_s = 10;
    const std::int64_t last_ns = can_now_ns() + kLongest_s * kSecond_ns;
    forget_interrupt();
    link.forget_received();
    while (can_now_ns() < last_ns) {
        const auto status = link.wait_for<protocol::Status>(can_now_ns() + kSecond_ns);
        if (interrupted()) return kAimMissed;
        if (!status.has_value()) {
            return complain(kAimMissed, "idle was asked for, but the firmware's Status frames have ceased");
        }
        if (status->state == protocol::Mode::fault) {
            return complain(kAimMissed, "stopped on the way to idle: " + link.text_of(*status));
        }
        if (status->state == protocol::Mode::idle && status->requested == protocol::Mode::idle) return kDone;
    }
    return complain(kAimMissed, "idle was asked for " + std::to_string(kLongest_s) +
                                    " s ago, and the robot is not idle yet");
}

std::int64_t end_of(const Options& options) {
    return options.for_s > 0 ? can_now_ns() + static_cast<std::int64_t>(options.for_s * 1e9) : INT64_MAX;
}

// Says that somebody is there until --for is over, Ctrl-C, or the robot has left the mode; then asks for
// idle.
int watch_over(Link& link, protocol::Mode mode, std::int64_t end_ns) {
    ModeWatch watch(mode, can_now_ns());
    do {  // some Status is heard in any case
        const std::int64_t soon_ns = can_now_ns() + kSecond_ns / 4;
        if (!watch.follow(link, std::clamp(end_ns, soon_ns, soon_ns + kSecond_ns)) || watch.silent()) break;
    } while (!interrupted() && can_now_ns() < end_ns);
    const int result = watch.result(link);
    if (watch.in_fault()) return result;
    const int status = link.ask(protocol::Mode::idle);
    const int rested = status == kDone ? await_rest(link) : status;
    return result == kDone ? rested : result;
}

int send_mode(const Options& options, protocol::Mode mode) {
    if (options.print) return print_frames(options, {mode_command(mode)});
    catch_interrupt();
    Link link(options);
    if (const int status = link.open(); status != kDone) return status;
    link.forget_received();
    if (const int status = link.ask(mode); status != kDone) return status;
    if (options.no_wait) link.prove();
    if (supervisor::drives(mode)) link.stay_alive();
    int result = options.no_wait ? kDone : await_state(link, mode);
    if (!options.no_wait && supervisor::drives(mode) && (result == kDone || interrupted())) {
        result = mode == protocol::Mode::ident ? await_identification(link)
                                               : watch_over(link, mode, end_of(options));
    }
    Link::leave_slot();
    return result;
}

// The firmware may drive a path slower than asked.
void tell_pace(Link& link, const protocol::TrajectoryCommand& asked) {
    const std::int64_t last_ns = can_now_ns() + kSecond_ns;
    while (const auto pace = link.wait_for<protocol::TrajectoryPace>(last_ns)) {
        // Some tens of milliseconds pass until the pace of the new path is known.
        if (pace->shape != asked.shape || std::abs(pace->asked_period_s - asked.period_s) > 0.006) continue;
        if (const std::string words = pace_sentence(*pace); !words.empty())
            std::printf("%s\n", words.c_str());
        return;
    }
}

// Sends a command once, or a set-point again and again; with --enter in its mode, and idle at the end.
int send_commands(const Options& options, const std::vector<Command>& commands,
                  std::optional<protocol::Mode> mode, bool repeat_by_default,
                  const std::function<void(Link&)>& after = {}) {
    if (options.print) {
        std::vector<Command> all = commands;
        if (options.enter && mode.has_value()) all.push_back(mode_command(*mode));
        return print_frames(options, all);
    }
    // A path of the firmware's own is chosen once; with --enter it is watched over.
    const bool alone = !repeat_by_default && options.enter && mode.has_value() && supervisor::drives(*mode);
    const bool repeat = !alone && (repeat_by_default || options.for_s > 0);
    double period_s = commands.front().period_s;
    if (options.rate_Hz > 0) period_s = 1 / options.rate_Hz;
    if (repeat && period_s <= 0) period_s = 0.1;

    catch_interrupt();
    Link link(options);
    if (const int status = link.open(); status != kDone) return status;
    const std::int64_t end_ns = end_of(options);
    std::int64_t due_ns = can_now_ns();
    const bool enter = options.enter && mode.has_value();
    std::optional<ModeWatch> watch;
    do {
        for (const Command& command : commands) {
            if (const int status = link.send(command); status != kDone) return status;
        }
        if (enter && !watch.has_value()) {
            link.forget_received();
            if (const int status = link.ask(*mode); status != kDone) return status;
            if (options.no_wait) link.prove();
            watch.emplace(*mode, can_now_ns());
            if (alone) link.stay_alive();
        }
        if (!repeat) break;
        due_ns += static_cast<std::int64_t>(period_s * 1e9);
        if (enter && !options.no_wait) {
            if (!watch->follow(link, std::min(due_ns, end_ns)) || watch->silent()) break;
        } else {
            sleep_until(std::min(due_ns, end_ns));
        }
    } while (!interrupted() && can_now_ns() < end_ns);
    int result = kDone;
    if (after && !options.no_wait && !interrupted()) after(link);
    if (enter && !options.no_wait) result = repeat ? watch->result(link) : await_state(link, *mode);
    if (alone && !options.no_wait && (result == kDone || interrupted())) {
        result =
            *mode == protocol::Mode::ident ? await_identification(link) : watch_over(link, *mode, end_ns);
    }
    // In a fault it would be refused, and hide what was refused before.
    if (enter && repeat && !watch->in_fault()) {
        int status = link.ask(protocol::Mode::idle);
        if (status == kDone && !options.no_wait) status = await_rest(link);
        if (result == kDone) result = status;
    }
    Link::leave_slot();
    return result;
}

std::string saved_text(float values) {
    const auto count = std::lround(values);
    if (count == 0) return "nothing has changed since the robot file was read";
    return std::to_string(count) + (count == 1 ? " value is" : " values are") + " in the robot file";
}

int run_parameter(const Options& options, protocol::ParameterOperation operation,
                  const std::optional<NamedParameter>& parameter, float value, bool commit) {
    using protocol::ParameterOperation;
    const std::uint16_t index = parameter.has_value() ? parameter->index : std::uint16_t{0};
    if (options.print) {
        std::vector<Command> commands{parameter_request(operation, index, value)};
        if (commit) {
            // A counter accepted once is refused for half a second, so the second frame has the next one.
            Command second = parameter_request(ParameterOperation::commit, 0, 0);
            const MakeFrame make = second.make;
            second.make = [make](std::uint8_t alive, hal::CanFrame& out) {
                return make(protocol::next_alive(alive), out);
            };
            commands.push_back(second);
        }
        return print_frames(options, commands);
    }
    catch_interrupt();
    Link link(options);
    if (const int status = link.open(); status != kDone) return status;
    int status = kDone;
    const auto run_one = [&](ParameterOperation what) {
        const auto reply = link.ask(what, index, value, status);
        if (!reply.has_value()) return;
        const std::string name = parameter.has_value() && what != ParameterOperation::commit
                                     ? parameter->key
                                     : std::string(to_string_view(what));
        const protocol::ParameterResult result = reply->result;
        if (result != protocol::ParameterResult::ok) {
            status = complain(kAimMissed, name + ": " + result_text(result));
        } else if (parameter.has_value() && what != ParameterOperation::commit) {
            std::printf("%s = %s%s%s\n", name.c_str(), parameter_value_text(*parameter, reply->value).c_str(),
                        parameter->unit.empty() ? "" : " ", parameter->unit.c_str());
        } else if (what == ParameterOperation::save) {
            std::printf("save: %s\n", saved_text(reply->value).c_str());
        } else {
            std::printf("%s: ok\n", name.c_str());
        }
    };
    run_one(operation);
    if (status == kDone && commit) run_one(ParameterOperation::commit);
    Link::leave_slot();
    return status;
}

int list_parameters() {
    for (const NamedParameter& parameter : all_parameters()) {
        std::printf("0x%04X  %-44s %-12s %-6s %s\n", unsigned{parameter.index}, parameter.key.c_str(),
                    parameter.unit.c_str(), std::string(change_text(parameter.when)).c_str(),
                    parameter.meaning.c_str());
    }
    return kDone;
}

using Shared = std::shared_ptr<Options>;

CommandLine subcommand(const CommandLine& parent, const char* name, const char* text) {
    const CommandLine command = parent.add_subcommand(name, text);
    command.fallthrough();  // --can and the others may stand behind the subcommand too
    command.footer(
        "The options of `wheelwright ctl --help` (--can, --print, --for ...) may stand behind it.");
    return command;
}

void add_mode(const CommandLine& ctl, const Shared& options, Run& run) {
    const auto name = std::make_shared<std::string>();
    const CommandLine command = subcommand(ctl, "mode",
                                           "Ask for a mode and wait until the robot is in it; in one that "
                                           "drives, stay (HostAlive) until it is over");
    command.add_option("MODE", *name, "One of " + names_of(modes())).required();
    command.footer(
        "Mode ident ends by itself: progress is shown, then what was found; Ctrl-C sends idle.\n"
        "Exit status 0 of ident: K7 and K8 are known; 3: refused, or not identified, and why; or nobody "
        "answered.");
    command.callback([=, &run] {
        run = [=] {
            const auto mode = by_name(modes(), *name);
            if (!mode.has_value()) {
                return complain(kUsage, "mode " + *name + ": expected one of " + names_of(modes()));
            }
            return send_mode(*options, *mode);
        };
    });
}

void add_torque(const CommandLine& ctl, const Shared& options, Run& run) {
    const auto message = std::make_shared<protocol::TorqueCommand>();
    const CommandLine command = subcommand(ctl, "torque", "Wheel torques for mode torque, repeated");
    command.add_option("LEFT", message->left_torque_Nm, "Left wheel, Nm, positive drives forward").required();
    command.add_option("RIGHT", message->right_torque_Nm, "Right wheel, Nm").required();
    command.callback([=, &run] {
        run = [=] { return send_commands(*options, {command_of(*message)}, protocol::Mode::torque, true); };
    });
}

void add_velocity(const CommandLine& ctl, const Shared& options, Run& run) {
    const auto message = std::make_shared<protocol::VelocityCommand>();
    const CommandLine command = subcommand(ctl, "velocity", "Body velocity for mode velocity, repeated");
    command.add_option("V", message->forward_speed_m_per_s, "Forward speed, m/s").required();
    command.add_option("W", message->yaw_rate_rad_per_s, "Yaw rate, rad/s, positive counter-clockwise")
        .required();
    command.callback([=, &run] {
        run = [=] { return send_commands(*options, {command_of(*message)}, protocol::Mode::velocity, true); };
    });
}

void add_goal(const CommandLine& ctl, const Shared& options, Run& run) {
    const auto message = std::make_shared<protocol::PoseGoal>();
    const auto direction = std::make_shared<std::string>("forward");
    const CommandLine command = subcommand(ctl, "goal", "Pose to drive to in mode pose, repeated");
    command.add_option("X", message->x_m, "m").required();
    command.add_option("Y", message->y_m, "m").required();
    command.add_option("HEADING", message->heading_rad, "rad, within -pi..pi").required();
    command
        .add_option("--direction", *direction,
                    "Which end leads: " + names_of(protocol::pose_direction_values))
        .show_default();
    command.callback([=, &run] {
        run = [=] {
            const auto chosen = by_name(protocol::pose_direction_values, *direction);
            if (!chosen.has_value()) {
                return complain(kUsage, "direction " + *direction + ": expected one of " +
                                            names_of(protocol::pose_direction_values));
            }
            message->direction = *chosen;
            return send_commands(*options, {command_of(*message)}, protocol::Mode::pose, true);
        };
    });
}

void add_trajectory(const CommandLine& ctl, const Shared& options, Run& run) {
    const auto message = std::make_shared<protocol::TrajectoryCommand>();
    const auto shape = std::make_shared<std::string>();
    // The standard path of each shape is the robot file's figure-8.
    const model::RobotParameters standard = model::default_parameters();
    message->length_m = standard.trajectory.length_m;
    message->width_m = standard.trajectory.width_m;
    message->period_s = standard.trajectory.period_s;
    const CommandLine command =
        subcommand(ctl, "trajectory", "Choose the path of modes trajectory and adaptive");
    command.add_option("SHAPE", *shape, "One of " + names_of(protocol::trajectory_shape_values)).required();
    command.add_option("--length", message->length_m, "Extent along x, or diameter of the circle, m")
        .show_default();
    command.add_option("--width", message->width_m, "Extent along y, m (figure_eight only)").show_default();
    command.add_option("--period", message->period_s, "Time of one lap, s").show_default();
    command.callback([=, &run] {
        run = [=] {
            const auto chosen = by_name(protocol::trajectory_shape_values, *shape);
            if (!chosen.has_value()) {
                return complain(kUsage, "shape " + *shape + ": expected one of " +
                                            names_of(protocol::trajectory_shape_values));
            }
            message->shape = *chosen;
            return send_commands(*options, {command_of(*message)}, protocol::Mode::trajectory, false,
                                 [=](Link& link) { tell_pace(link, *message); });
        };
    });
}

void add_stream(const CommandLine& ctl, const Shared& options, Run& run) {
    const auto pose = std::make_shared<protocol::StreamedPose>();
    const auto velocity = std::make_shared<protocol::StreamedVelocity>();
    const CommandLine command =
        subcommand(ctl, "reference", "One streamed reference (pose and velocities), repeated");
    command.add_option("X", pose->x_m, "m").required();
    command.add_option("Y", pose->y_m, "m").required();
    command.add_option("HEADING", pose->heading_rad, "rad, within -pi..pi").required();
    command.add_option("V", velocity->forward_speed_m_per_s, "m/s").required();
    command.add_option("W", velocity->yaw_rate_rad_per_s, "rad/s").required();
    command.callback([=, &run] {
        run = [=] {
            return send_commands(*options, {command_of(*pose), command_of(*velocity)},
                                 protocol::Mode::trajectory, true);
        };
    });
}

void add_pose(const CommandLine& ctl, const Shared& options, Run& run) {
    const auto message = std::make_shared<protocol::ExternalPose>();
    const CommandLine command = subcommand(ctl, "pose", "Tell the robot where it is (external pose)");
    command.add_option("X", message->x_m, "m").required();
    command.add_option("Y", message->y_m, "m").required();
    command.add_option("HEADING", message->heading_rad, "rad, within -pi..pi").required();
    command.callback([=, &run] {
        run = [=] { return send_commands(*options, {command_of(*message)}, std::nullopt, false); };
    });
}

void add_alive(const CommandLine& ctl, const Shared& options, Run& run) {
    const CommandLine command = subcommand(
        ctl, "alive", "Say that the host is there (HostAlive), repeated; for scripts of cansend lines");
    command.callback([=, &run] {
        run = [=] {
            return send_commands(*options, {command_of(protocol::HostAlive{})}, std::nullopt, true);
        };
    });
}

void add_ident(const CommandLine& ctl, const Shared& options, Run& run) {
    const auto message = std::make_shared<protocol::IdentSettings>();
    const auto bit_time_ms = std::make_shared<int>(0);
    const auto duration_s = std::make_shared<int>(0);
    const CommandLine command = subcommand(ctl, "ident", "Settings of the next identification");
    command.footer("A setting left out is the robot file's. Sent in idle; `ctl mode ident` starts it.");
    command.add_option("--amplitude", message->amplitude_Nm, "Excitation torque, Nm");
    command.add_option("--bit-time", *bit_time_ms, "Length of one bit, ms").check(from_to("0", "255"));
    command.add_option("--duration", *duration_s, "Longest time, s").check(from_to("0", "255"));
    command.add_option("--speed-limit", message->speed_limit_m_per_s, "m/s");
    command.add_option("--yaw-rate-limit", message->yaw_rate_limit_rad_per_s, "rad/s");
    command.add_option("--distance-limit", message->distance_limit_m, "From the start, m");
    command.callback([=, &run] {
        run = [=] {
            message->bit_time_ms = static_cast<decltype(message->bit_time_ms)>(*bit_time_ms);
            message->duration_s = static_cast<decltype(message->duration_s)>(*duration_s);
            return send_commands(*options, {command_of(*message)}, protocol::Mode::ident, false);
        };
    });
}

void add_stop(const CommandLine& ctl, const Shared& options, Run& run) {
    const CommandLine stop = subcommand(ctl, "stop", "Emergency stop: no torque within two cycles");
    stop.callback([=, &run] {
        run = [=] {
            const std::vector<Command> commands{command_of(protocol::EmergencyStop{})};
            if (options->print) return print_frames(*options, commands);
            catch_interrupt();
            Link link(*options);
            if (const int status = link.open(); status != kDone) return status;
            if (const int status = link.send(commands.front()); status != kDone) return status;
            return options->no_wait ? kDone : await_state(link, protocol::Mode::fault);
        };
    });
    const CommandLine clear =
        subcommand(ctl, "clear", "Clear a latched fault and the drives' errors; their cause must be gone");
    clear.callback([=, &run] {
        run = [=] {
            const std::vector<Command> commands{command_of(protocol::ClearFault{})};
            if (options->print) return print_frames(*options, commands);
            catch_interrupt();
            Link link(*options);
            if (const int status = link.open(); status != kDone) return status;
            link.forget_received();
            if (const int status = link.send(commands.front()); status != kDone) return status;
            const int result = options->no_wait ? kDone : await_cleared(link);
            Link::leave_slot();
            return result;
        };
    });
}

void add_param(const CommandLine& ctl, const Shared& options, Run& run) {
    using protocol::ParameterOperation;
    const CommandLine param = subcommand(ctl, "param", "Read and write the firmware's parameters");
    param.require_subcommand();
    const auto key = std::make_shared<std::string>();
    const auto value = std::make_shared<std::string>();
    const auto commit = std::make_shared<bool>(false);
    const auto find = [key]() {
        std::optional<NamedParameter> found = find_named_parameter(std::string_view(*key));
        if (!found.has_value()) {
            complain(kUsage, "no parameter " + *key + "; `wheelwright ctl param list` names them all");
        }
        return found;
    };
    const CommandLine get = subcommand(param, "get", "Print a parameter's value");
    get.add_option("KEY", *key, "Key of the robot file, or index (0x0082)").required();
    get.callback([=, &run] {
        run = [=] {
            const auto parameter = find();
            if (!parameter.has_value()) return kUsage;
            return run_parameter(*options, ParameterOperation::read, parameter, 0, false);
        };
    });
    const CommandLine set = subcommand(param, "set", "Stage a new value; it counts from commit on");
    set.add_option("KEY", *key, "Key of the robot file, or index (0x0082)").required();
    set.add_option("VALUE", *value, "Number, true or false, or a choice's name").required();
    set.add_flag("--commit", *commit, "Commit at once");
    set.callback([=, &run] {
        run = [=] {
            const auto parameter = find();
            if (!parameter.has_value()) return kUsage;
            std::string expected;
            const auto number = parse_parameter_value(*parameter, *value, expected);
            if (!number.has_value()) {
                return complain(kUsage, parameter->key + ": found " + *value + ", expected " + expected);
            }
            if (parameter->when == model::ChangeWhen::start) {
                return complain(kUsage, parameter->key + ": only the robot file sets it, at the start");
            }
            return run_parameter(*options, ParameterOperation::write, parameter,
                                 parameter->automatic && *number == 0
                                     ? 0.0F
                                     : float_within(*number, parameter->minimum, parameter->maximum),
                                 *commit);
        };
    });
    const auto simple = [&](const char* name, const char* text, ParameterOperation operation) {
        const CommandLine command = subcommand(param, name, text);
        command.callback(
            [=, &run] { run = [=] { return run_parameter(*options, operation, std::nullopt, 0, false); }; });
    };
    simple("commit", "Make all staged values valid in one cycle", ParameterOperation::commit);
    simple("discard", "Forget the staged values", ParameterOperation::discard);
    simple("save", "Write the valid values into the robot file", ParameterOperation::save);
    const CommandLine list =
        subcommand(param, "list", "List all parameters: index, key, unit, when it may change");
    list.callback([&run] { run = [] { return list_parameters(); }; });
}

}  // namespace

void add_ctl(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine ctl = program.add_subcommand("ctl", "Command a robot by CAN, or print the frames");
    ctl.require_subcommand();
    ctl.footer(
        "Set-points (torque, velocity, goal, reference) are repeated until --for is over or Ctrl-C, as the\n"
        "robot stops when they cease; with --enter the matching mode is asked for first, and idle at the\n"
        "end, which comes early when the robot refuses or leaves the mode; it is waited for, 10 s at most. "
        "Write negative\n"
        "numbers as -0.5, not -.5.\n"
        "Exit status 3: sent, but the robot did not do it, and why.");
    ctl.add_option("--can", options->interface, "CAN interface").show_default();
    ctl.add_option("--key", options->key, "Key file, to answer a robot that asks for it before it arms");
    ctl.add_flag("--print", options->print, "Print the cansend lines instead of sending");
    ctl.add_option("--alive", options->alive,
                   "Alive counter of the first frame (default: 0 printed, else chosen)")
        .check(from_to("0", "14"));
    ctl.add_option("--rate", options->rate_Hz, "Repetitions a second (default: the message's cycle time)")
        .check(from_to("0.1", "1000"));
    ctl.add_option("--for", options->for_s, "Seconds to repeat").check(greater_than_zero());
    ctl.add_flag("--enter", options->enter, "Ask for the command's mode too, and for idle at the end");
    ctl.add_flag("--no-wait", options->no_wait,
                 "Do not wait for the robot's answer to mode, stop, clear and --enter, nor for ident's end");
    add_mode(ctl, options, run);
    add_torque(ctl, options, run);
    add_velocity(ctl, options, run);
    add_goal(ctl, options, run);
    add_trajectory(ctl, options, run);
    add_stream(ctl, options, run);
    add_pose(ctl, options, run);
    add_alive(ctl, options, run);
    add_ident(ctl, options, run);
    add_param(ctl, options, run);
    add_stop(ctl, options, run);
}

}  // namespace wheelwright::tools
