// `wheelwright sim`: firmware and robot in virtual time, or the robot alone in real time on an interface.
#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "firmware/task/write_file.hpp"
#include "hal/linux/monotonic_clock.hpp"
#include "hal/linux/socketcan_bus.hpp"
#include "tools/cli/can_port.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"
#include "tools/cli/ident_words.hpp"
#include "tools/cli/report.hpp"
#include "tools/cli/robots.hpp"
#include "tools/ctl/frames.hpp"
#include "tools/ctl/link.hpp"
#include "tools/sim/experiments.hpp"

namespace wheelwright::tools {
namespace {

struct Options {
    std::string robot = example_robot("default.toml");
    std::string plant = example_robot("simulated.toml");
    std::uint64_t seed = 1;
    double duration_s = 0;
    std::string log;
    std::string black_box;
    std::string json;
    std::string interface;
    bool external_poses = false;
    std::string trace;
    std::int64_t rest_us = 50;
    std::vector<std::string> actions;
};

// "name" or "name:number,number,..."
struct Action {
    std::string name;
    std::vector<double> numbers;
};

// What an action takes; `numbers` may be fewer where the rest has a meaning of its own.
struct ActionInfo {
    const char* name;
    std::size_t fewest, most;
    std::size_t seconds;  // which of them is a time; kNone: none
    const char* usage;
    std::string (*wrong)(const std::vector<double>& numbers) = nullptr;  // "" or what is out of its range
};

// A command takes what its message can carry.
std::string wrong_velocity(const std::vector<double>& n) {
    protocol::VelocityCommand message;
    message.forward_speed_m_per_s = n[0];
    message.yaw_rate_rad_per_s = n[1];
    return field_error(message);
}
std::string wrong_torque(const std::vector<double>& n) {
    protocol::TorqueCommand message;
    message.left_torque_Nm = n[0];
    message.right_torque_Nm = n[1];
    return field_error(message);
}
std::string wrong_goal(const std::vector<double>& n) {
    protocol::PoseGoal message;
    message.x_m = n[0];
    message.y_m = n[1];
    message.heading_rad = wrap_angle_rad(n[2]);
    return field_error(message);
}
// Something must be left to drive, and the truth's file has its bounds as well.
std::string wrong_payload(const std::vector<double>& n) {
    constexpr double kLeast = -0.9, kMost = 100;
    if (n[0] >= kLeast && n[0] <= kMost) return "";
    return "SHARE: found " + number_text(n[0]) + ", expected " + number_text(kLeast) + " to " +
           number_text(kMost);
}
constexpr std::size_t kNone = SIZE_MAX;
constexpr std::array kActions{
    ActionInfo{"ident", 0, 0, kNone, "ident                   identify the robot"},
    ActionInfo{"velocity", 3, 3, 2, "velocity:V,W,S          m/s, rad/s, for S seconds", &wrong_velocity},
    ActionInfo{"torque", 3, 3, 2, "torque:LEFT,RIGHT,S     Nm, for S seconds", &wrong_torque},
    ActionInfo{"goal", 3, 3, kNone, "goal:X,Y,HEADING        drive to a pose (m, m, rad)", &wrong_goal},
    ActionInfo{"figure-eight", 0, 1, 0, "figure-eight[:S]        the standard figure-8, 42 s or S"},
    ActionInfo{"adaptive", 0, 1, 0, "adaptive[:S]            the same while the model is adapted"},
    ActionInfo{"payload", 1, 1, kNone, "payload:SHARE           mass and inertia grow by this share at once",
               &wrong_payload},
    ActionInfo{"place", 3, 3, kNone, "place:X,Y,HEADING       carry the robot to a pose"},
    ActionInfo{"wait", 1, 1, 0, "wait:S                  idle for S seconds"},
};

std::string usage_of_actions() {
    std::string text = "Actions, in their order:\n";
    for (const ActionInfo& info : kActions) text += std::string("  ") + info.usage + "\n";
    return text;
}

// Throws std::invalid_argument with one sentence.
Action parse_action(const std::string& text) {
    Action action;
    const std::size_t colon = text.find(':');
    action.name = text.substr(0, colon);
    std::size_t at = colon == std::string::npos ? text.size() : colon + 1;
    while (at < text.size()) {
        const std::size_t comma = std::min(text.find(',', at), text.size());
        double value = 0;
        const auto [end, error] = std::from_chars(text.data() + at, text.data() + comma, value);
        if (error != std::errc{} || end != text.data() + comma || !std::isfinite(value)) {
            throw std::invalid_argument("action \"" + text + "\": \"" + text.substr(at, comma - at) +
                                        "\" is not a number");
        }
        action.numbers.push_back(value);
        at = comma + 1;
    }
    for (const ActionInfo& info : kActions) {
        if (action.name != info.name) continue;
        if (action.numbers.size() < info.fewest || action.numbers.size() > info.most) {
            throw std::invalid_argument("action \"" + text + "\": expected " + info.usage);
        }
        constexpr double kLongest_s = 1e6;
        if (info.seconds < action.numbers.size() &&
            !(action.numbers[info.seconds] > 0 && action.numbers[info.seconds] <= kLongest_s)) {
            throw std::invalid_argument("action \"" + text +
                                        "\": expected a time greater than 0, at most 1e6 s");
        }
        if (const std::string wrong = info.wrong != nullptr ? info.wrong(action.numbers) : "";
            !wrong.empty()) {
            throw std::invalid_argument("action \"" + text + "\": " + wrong);
        }
        return action;
    }
    throw std::invalid_argument("unknown action \"" + text + "\"\n" + usage_of_actions());
}

// What stopped the robot or keeps it from a mode, as `wheelwright ctl` says it; no line when nothing does.
void add_hindrance(const Simulation& sim, Report& report) {
    const task::CycleReport now = sim.cycle().report();
    const protocol::Status& status = now.status;
    if (status.fault == protocol::Fault::none && status.blocker == protocol::Blocker::none) return;
    DriveErrors errors;
    for (const protocol::Wheel wheel : protocol::wheel_values)
        errors.take({.wheel = wheel,
                     .generation = now.drive_generation,
                     .error = now.drive_error_bits[std::size_t(wheel)]});
    report.add("hindrance", "because of", status_text(status, errors));
}

// Does one action; adds its figures. False: its mode was not entered, or its aim not reached.
bool act(Simulation& sim, const Action& action, const model::RobotParameters& plant, Report& report) {
    const auto& n = action.numbers;
    report.section(action.name + "_" + std::to_string(static_cast<long>(sim.time_s() * 1e3)), action.name);
    if (action.name == "wait") {
        sim.run_for(n[0]);
        report.add("time_s", "waited", n[0], "s");
        return true;
    }
    if (action.name == "payload") {
        drop_payload(sim.world(), n[0]);
        report.add("share", "mass and inertia grow by", 100 * n[0], "%");
        return true;
    }
    if (action.name == "place") {
        sim.world().plant().place({n[0], n[1], n[2]}, {0, 0});
        sim.run_for(0.2);
        return true;
    }
    if (action.name == "ident") {
        const double asked_Nm = sim.parameters().limits.torque_Nm;
        const IdentificationResult result = identify(sim);
        const auto truth = as_seen_with(sim::plant_dynamics(sim.world().plant().parameters()), plant.geometry,
                                        sim.parameters().geometry);
        const ident::ProbeFindings& found = sim.cycle().learning().run().findings();
        const ident::Sizing& sizing = sim.cycle().learning().run().sizing();
        report.add("succeeded", "K7 and K8 known", result.succeeded);
        const protocol::IdentStatus status = sim.cycle().learning().status();
        report.add("cause", "ended by", std::string(to_string_view(status.cause)));
        report.add("cause_words", "that is", cause_sentence(status.cause));
        report.add("probe_k7_per_kg_m", "probe: K7", found.k7_per_kg_m, "1/(kg m)");
        report.add("probe_k8_per_kg_m2", "probe: K8", found.k8_per_kg_m2, "1/(kg m^2)");
        report.add("probe_friction_Nm", "probe: friction of a wheel", found.friction_Nm, "Nm");
        report.add("probe_angle_noise_rad", "probe: noise of the angles", found.angle_noise_rad, "rad");
        report.add("torque_limit_Nm", "probe: torque that arrives", found.torque_limit_Nm, "Nm",
                   clipping_sentence(status, {found.torque_limit_Nm, asked_Nm}));
        report.add("sides_confirmed", "probe: left and right confirmed", found.pose_seen, "",
                   sides_sentence(status));
        report.add("unexplained_percent", "slow acceleration left unexplained",
                   100 * sim.cycle().learning().run().unexplained(), "%",
                   sim.cycle().learning().run().model_incomplete()
                       ? "something is missing: run `wheelwright gap` on this log"
                       : "");
        report.add("amplitude_Nm", "chosen: amplitude", sizing.amplitude_Nm, "Nm");
        report.add("bit_time_s", "chosen: bit", sizing.bit_time_s, "s");
        report.add("speed_limit_m_per_s", "chosen: speed limit", sizing.speed_limit_m_per_s, "m/s");
        report.add("yaw_rate_limit_rad_per_s", "chosen: yaw rate limit", sizing.yaw_rate_limit_rad_per_s,
                   "rad/s");
        if (!result.succeeded) add_hindrance(sim, report);
        report.add("duration_s", "after", result.duration_s, "s");
        report.add("delay_s", "actuation delay", result.delay_s, "s");
        report.table("parameters", {{"name", "parameter"},
                                    {"true_value", "truth"},
                                    {"value", "identified"},
                                    {"standard_error", "standard error"}});
        // What is known stands in the file's parameters, beside what couples forward and turning there.
        model::Dynamics<double> k = result.estimate.dynamics;
        if (result.succeeded) {
            const model::Dynamics<double>& kept = sim.parameters().dynamics;
            k = sim.cycle().learning().run().coupling_known()
                    ? kept
                    : model::Dynamics<double>{k.k5_m, k.k6_per_m, kept.k7_per_kg_m, kept.k8_per_kg_m2};
        }
        const auto& e = result.estimate.standard_error;
        report.row({std::string("K5"), truth.k5_m, k.k5_m, e.k5_m});
        report.row({std::string("K6"), truth.k6_per_m, k.k6_per_m, e.k6_per_m});
        report.row({std::string("K7"), truth.k7_per_kg_m, k.k7_per_kg_m, e.k7_per_kg_m});
        report.row({std::string("K8"), truth.k8_per_kg_m2, k.k8_per_kg_m2, e.k8_per_kg_m2});
        const model::EffectSet<double>& effects = sim.parameters().effects;
        const std::array<bool, model::kEffectCount> estimated =
            model::estimated_effects(result.estimate.effects.active);
        for (std::size_t i = 0; result.succeeded && i < model::kEffectCount; ++i) {
            for (std::size_t j = 0; estimated[i] && j < model::kEffects[i].parameters.size(); ++j)
                report.row({std::string(model::kEffects[i].name) + "." +
                                std::string(model::kEffects[i].parameters[j].name),
                            plant.effects.parameter[i][j], effects.parameter[i][j],
                            result.estimate.effects_standard_error.parameter[i][j]});
        }
        return result.succeeded;
    }
    if (action.name == "goal") {
        const GoalResult result = drive_to(sim, {n[0], n[1], n[2]}, protocol::PoseDirection::automatic);
        report.add("reached", "reached and held for 2 s", result.reached);
        if (!result.reached) add_hindrance(sim, report);
        report.add("time_s", "after", result.time_s, "s");
        report.add("distance_m", "distance from the goal", result.distance_m, "m");
        report.add("heading_error_rad", "heading error", result.heading_error_rad, "rad");
        sim.host().silence();
        return enter_mode(sim, protocol::Mode::idle) && result.reached;
    }
    if (action.name == "figure-eight" || action.name == "adaptive") {
        TrackingOptions options;
        options.mode = action.name == "adaptive" ? protocol::Mode::adaptive : protocol::Mode::trajectory;
        options.path = control::standard_figure_eight<double>(sim.parameters());
        if (!n.empty()) options.duration_s = n[0];
        const TrackingResult result = track(sim, options);
        report.add("entered", "mode entered", result.entered);
        add_hindrance(sim, report);
        report.add("period_s", "period", result.pace.period_s, "s", pace_sentence(result.pace));
        report.add("rms_m", "RMS error from 12 s on", result.rms_m, "m");
        report.add("peak_m", "largest error from 12 s on", result.peak_m, "m");
        return result.entered;
    }
    const bool torque = action.name == "torque";
    if (torque) {
        sim.host().torque({n[0], n[1]});
    } else {
        sim.host().velocity({n[0], n[1]});
    }
    const bool entered = enter_mode(sim, torque ? protocol::Mode::torque : protocol::Mode::velocity);
    sim.run_for(n[2]);
    report.add("entered", "mode entered", entered);
    add_hindrance(sim, report);
    report.add("true_speed_m_per_s", "true speed at the end", sim.world().twist().v_m_per_s, "m/s");
    report.add("true_yaw_rate_rad_per_s", "true yaw rate at the end", sim.world().twist().omega_rad_per_s,
               "rad/s");
    sim.host().silence();
    enter_mode(sim, protocol::Mode::idle);
    return entered;
}

int run_virtual(const Options& options) {
    std::vector<Action> actions;
    try {
        for (const std::string& text : options.actions) actions.push_back(parse_action(text));
    } catch (const std::invalid_argument& error) {
        std::fprintf(stderr, "wheelwright sim: %s\n", error.what());
        return kUsage;
    }
    if (actions.empty() && options.duration_s == 0) actions = {{"ident", {}}, {"figure-eight", {}}};
    // With a duration and no actions: identify and drive until the time is over.
    if (actions.empty()) actions = {{"ident", {}}, {"figure-eight", {options.duration_s}}};
    try {
        const task::RobotFile robot = load_robot(options.robot);
        const task::RobotFile plant = load_robot(options.plant);
        SimulationOptions settings;
        settings.seed = options.seed;
        settings.world = world_options(plant.simulation, options.seed);
        settings.log_path = options.log;
        settings.black_box = options.black_box;
        if (!options.black_box.empty()) task::read_whole_file(options.robot, settings.robot_file);
        Report report("sim");
        bool reached = true;
        const auto begin = std::chrono::steady_clock::now();
        double simulated_s = 0;
        {
            Simulation sim(robot.parameters, plant.parameters, settings);
            if (sim.log_failed()) {
                std::fprintf(stderr, "wheelwright sim: cannot write %s\n", options.log.c_str());
                return kMachineLacks;
            }
            if (options.duration_s > 0) sim.end_at(options.duration_s);
            try {
                sim.run_for(0.5);
                for (const Action& action : actions)
                    reached = act(sim, action, plant.parameters, report) && reached;
                if (options.duration_s > 0) sim.run_for(options.duration_s);
            } catch (const Simulation::TimeIsOver&) {
                // what --duration asked for
            }
            simulated_s = sim.time_s();
            sim.end_recording();
            for (const std::string& said : sim.black_boxes()) std::printf("%s\n", said.c_str());
            if (sim.log_failed()) {
                std::fprintf(stderr, "wheelwright sim: %s could not be written whole\n", options.log.c_str());
                return kMachineLacks;
            }
            const double wall_s =
                std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
            report.section("run", "Run");
            report.add("simulated_s", "simulated", simulated_s, "s");
            report.add("frames", "frames on the wire", static_cast<std::int64_t>(sim.bus().totals().frames));
            report.add("bus_load", "bus load",
                       100e-9 * static_cast<double>(sim.bus().totals().busy_ns) / simulated_s, "%");
            report.add("times_real_time", "times real time", simulated_s / wall_s);
        }
        if (!report.publish(options.json)) return kMachineLacks;
        return reached ? kDone : kAimMissed;
    } catch (const std::runtime_error& error) {
        std::fputs(error.what(), stderr);
        return kUsage;
    }
}

// The robot's true motion as a table of numbers, for whoever judges a firmware from outside.
class Trace {
  public:
    explicit Trace(const std::string& path) : offset_ns_(wall_clock_offset_ns()) {
        if (path.empty()) return;
        file_ = std::fopen(path.c_str(), "w");
        failed_ = file_ == nullptr;
        if (failed_) return;
        std::setvbuf(file_, nullptr, _IOLBF, BUFSIZ);  // each row can be read at once
        std::fputs("time_s,x_m,y_m,heading_rad,speed_m_per_s,yaw_rate_rad_per_s\n", file_);
    }
    ~Trace() {
        if (file_ != nullptr) std::fclose(file_);
    }
    Trace(const Trace&) = delete;
    Trace& operator=(const Trace&) = delete;

    bool failed() const { return failed_; }

    // A row if one is due.
    void step(std::int64_t now_ns, const sim::World& world) {
        if (file_ == nullptr || now_ns < next_ns_) return;
        next_ns_ = now_ns + kPeriod_ns;
        const Pose<double>& pose = world.pose();
        const Twist<double>& twist = world.twist();
        if (std::fprintf(file_, "%.6f,%.5f,%.5f,%.5f,%.5f,%.5f\n",
                         1e-9 * static_cast<double>(now_ns + offset_ns_), pose.x_m, pose.y_m,
                         wrap_angle_rad(pose.heading_rad), twist.v_m_per_s, twist.omega_rad_per_s) < 0) {
            failed_ = true;
        }
    }

  private:
    static constexpr std::int64_t kPeriod_ns = 10'000'000;
    std::FILE* file_ = nullptr;
    std::int64_t offset_ns_;  // rows bear wall-clock time, as candump -L does
    std::int64_t next_ns_ = 0;
    bool failed_ = false;
};

// The robot alone: two drives and a body on a real interface; somebody else is the firmware.
int run_robot(const Options& options) {
    task::RobotFile plant;
    try {
        plant = load_robot(options.plant);
    } catch (const std::runtime_error& error) {
        std::fputs(error.what(), stderr);
        return kUsage;
    }
    int status = kDone;
    const auto bus = open_can(options.interface, status);
    if (bus == nullptr) return status;
    const auto host = open_can(options.interface, status);
    if (host == nullptr) return status;
    host->set_filters({});
    constexpr std::uint32_t kNodeMask = 0x7E0;
    const std::array filters{
        hal::CanFilter{static_cast<std::uint32_t>(plant.parameters.drive.left.node) << 5, kNodeMask, false},
        hal::CanFilter{static_cast<std::uint32_t>(plant.parameters.drive.right.node) << 5, kNodeMask, false}};
    bus->set_filters(filters);

    Trace trace(options.trace);
    if (trace.failed()) {
        std::fprintf(stderr, "wheelwright sim: cannot write %s\n", options.trace.c_str());
        return kMachineLacks;
    }

    catch_interrupt();
    hal::MonotonicClock clock;
    const std::int64_t begin_ns = clock.now_ns();
    const std::int64_t end_ns =
        options.duration_s > 0 ? begin_ns + static_cast<std::int64_t>(options.duration_s * 1e9) : INT64_MAX;
    sim::WorldOptions world_settings = world_options(plant.simulation, options.seed);
    world_settings.start_ns = begin_ns;
    world_settings.latest_ns += 1000 * options.rest_us;
    sim::World world(plant.parameters, world_settings, *bus);
    SimulatedHost poses(*host, world);
    poses.external_poses(options.external_poses);
    std::printf("robot on %s\n", options.interface.c_str());
    std::fflush(stdout);
    const std::int64_t rest_ns = 1000 * options.rest_us;
    while (!interrupted()) {
        const std::int64_t now = clock.now_ns();
        if (now >= end_ns) break;
        world.pump(now);
        poses.step(now);
        trace.step(now, world);
        clock.sleep_until_ns(std::min(end_ns, std::max(world.next_event_ns(), now + rest_ns)));
    }
    Report report("sim");
    report.section("robot", "The robot at the end");
    report.add("x_m", "x", world.pose().x_m, "m");
    report.add("y_m", "y", world.pose().y_m, "m");
    report.add("heading_rad", "heading", wrap_angle_rad(world.pose().heading_rad), "rad");
    report.add("speed_m_per_s", "speed", world.twist().v_m_per_s, "m/s");
    report.add("yaw_rate_rad_per_s", "yaw rate", world.twist().omega_rad_per_s, "rad/s");
    if (trace.failed()) {
        std::fprintf(stderr, "wheelwright sim: %s could not be written whole\n", options.trace.c_str());
        return kMachineLacks;
    }
    return report.publish(options.json) ? kDone : kMachineLacks;
}

}  // namespace

void add_sim(const CommandLine& program, Run& run) {
    const auto options = std::make_shared<Options>();
    const CommandLine command =
        program.add_subcommand("sim", "Run firmware and a simulated robot, or the robot alone");
    command.footer(
        usage_of_actions() +
        "Without actions: ident, then figure-eight. Virtual time; the same seed gives the same bytes.\n"
        "With --can: the simulated robot alone, in real time on that interface, until Ctrl-C.");
    command.add_option("actions", options->actions, "What to do (see below)");
    command.add_option("--robot", options->robot, "Robot file of the firmware").show_default();
    command.add_option("--plant", options->plant, "Robot file with the simulated robot's truth")
        .show_default();
    command.add_option("--seed", options->seed, "Seed of noise and phases").show_default();
    command.add_option("--duration", options->duration_s, "Seconds to run (default: until all is done)")
        .check(greater_than_zero());
    command.add_option("--log", options->log, "Write the bus as candump -L");
    command.add_option("--black-box", options->black_box,
                       "After each fault, write the last half minute to a file in this directory");
    const Option can =
        command.add_option("--can", options->interface, "Play the robot on this interface, in real time");
    command.add_flag("--external-poses", options->external_poses,
                     "With --can: also send the poses that an outside sensor would measure");
    command
        .add_option("--trace", options->trace,
                    "With --can: write the robot's true motion, each 10 ms, as CSV with candump's time")
        .needs(can);
    command
        .add_option("--rest", options->rest_us,
                    "With --can: microseconds to sleep at least between two looks at the bus; more of them "
                    "spare a slow machine, and frames leave up to so much later")
        .check(from_to("0", "10000"))
        .show_default();
    command.add_option("--json", options->json, "Also write the figures to this file");
    command.callback([options, &run] {
        run = [options] { return options->interface.empty() ? run_virtual(*options) : run_robot(*options); };
    });
}

}  // namespace wheelwright::tools
