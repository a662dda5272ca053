#include "tools/torture/scene.hpp"

#include <cmath>
#include <cstring>
#include <numbers>

#include "firmware/control/trajectory.hpp"
#include "tools/cli/robots.hpp"
#include "tools/sim/experiments.hpp"
#include "tools/strangers/draw.hpp"
#include "tools/strangers/trial.hpp"

namespace wheelwright::tools {
namespace {

using protocol::Mode;

constexpr std::uint64_t kSetupStream = 0x70;
constexpr std::uint64_t kSceneStream = 0x71;
constexpr std::array kModes{Mode::ident, Mode::velocity, Mode::pose, Mode::trajectory, Mode::adaptive};
// The cycle's own part of the way from torque to motion, beside the drives' delay.
constexpr double kCycleDelay_s = 0.0007;

const task::RobotFile& standard_believed() {
    static const task::RobotFile file = load_robot(example_robot("default.toml"));
    return file;
}
const task::RobotFile& standard_truth() {
    static const task::RobotFile file = load_robot(example_robot("simulated.toml"));
    return file;
}

// As if the robot had been identified well: K5..K8 as its file's geometry sees them, and its friction.
void identify(SceneSetup& setup, const model::Dynamics<double>& seen, double delay_s) {
    model::RobotParameters& p = setup.believed;
    p.dynamics = seen;
    p.dynamics_standard_error = {0.003 * std::abs(seen.k5_m), 0.01 * std::abs(seen.k6_per_m),
                                 0.001 * seen.k7_per_kg_m, 0.001 * seen.k8_per_kg_m2};
    for (const char* name : {"coulomb_friction", "viscous_friction"}) {
        const std::size_t i = model::find_effect(name);
        p.effects.active[i] = true;
        for (std::size_t j = 0; j < model::kEffects[i].parameters.size(); ++j) {
            p.effects.parameter[i][j] = 1.03 * setup.truth.effects.parameter[i][j];
            p.effects_standard_error.parameter[i][j] = 0.05 * p.effects.parameter[i][j] + 1e-6;
        }
    }
    p.velocity_loop.actuation_delay_s = delay_s + kCycleDelay_s;
    for (model::DriveParameters* drive : {&p.drive.left, &p.drive.right})
        drive->encoder_lag_s = 1 / setup.simulation.velocity_filter_rad_per_s;
    // A drive's own estimator takes half of an encoder's noise.
    const double gear = (p.drive.left.gear_ratio + p.drive.right.gear_ratio) / 2;
    const double step_rad = 2 * std::numbers::pi / (setup.simulation.encoder_counts_per_turn * gear);
    p.velocity_loop.angle_noise_rad =
        0.5 * std::hypot(setup.simulation.encoder_noise_rad, step_rad / std::sqrt(12.0));
}

void report_each(int period_ms, SceneSetup& setup) {
    for (model::RobotParameters* p : {&setup.believed, &setup.truth}) {
        p->drive.encoder_period_ms = period_ms;
        p->safety.stale_feedback_s = stale_feedback_s(period_ms);
    }
}

}  // namespace

std::uint32_t bits_of(float value) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, &value, 4);
    return bits;
}

std::string SceneSetup::text() const {
    return std::string(protocol::to_string_view(mode)) + (separate_host_bus ? ", host bus" : ", one bus") +
           (truth.drive.generation == 5 ? ", 0.5" : ", 0.6") + (drawn_robot ? ", drawn" : ", default") +
           (side == 0 ? ", left" : ", right") +
           (truth.drive.encoder_period_ms > 1
                ? ", reports each " + std::to_string(truth.drive.encoder_period_ms) + " ms"
                : "");
}

SceneSetup scene_setup(std::uint64_t seed, TorturedRobots robots, int report_period_ms) {
    sim::Random random(seed, kSetupStream);
    SceneSetup setup;
    setup.seed = seed;
    setup.mode = kModes[seed % kModes.size()];
    setup.separate_host_bus = seed / 5 % 2 != 0;
    setup.drawn_robot =
        robots == TorturedRobots::drawn || (robots == TorturedRobots::both && seed / 20 % 2 != 0);
    setup.side = random.bits() % 2;
    setup.way = random.bits() % 2 != 0 ? 1 : -1;
    if (setup.drawn_robot) {
        const DrawnRobot robot = draw_robot(seed, 1);
        setup.believed = robot.believed.parameters;
        setup.truth = robot.truth.parameters;
        report_each(report_period_ms, setup);
        setup.simulation = robot.truth.simulation;
        const sim::Plant plant(
            sim::plant_from_dynamics(setup.truth.geometry, setup.truth.dynamics, setup.truth.effects));
        identify(setup, seen_truth(robot, plant.actual()), robot.delay_s);
        return setup;
    }
    setup.believed = standard_believed().parameters;
    setup.truth = standard_truth().parameters;
    setup.simulation = standard_truth().simulation;
    report_each(report_period_ms, setup);
    setup.believed.drive.generation = setup.truth.drive.generation = seed / 10 % 2 != 0 ? 5 : 6;
    identify(setup, as_seen_with(setup.truth.dynamics, setup.truth.geometry, setup.believed.geometry),
             setup.simulation.command_latency_s + setup.simulation.torque_lag_s);
    return setup;
}

SimulationOptions Scene::options(const SceneSetup& setup, const SceneRecords& records) {
    SimulationOptions o;
    o.seed = setup.seed;
    o.world = world_options(setup.simulation, setup.seed);
    o.separate_host_bus = setup.separate_host_bus;
    o.emergency_stop_line = true;
    o.faulty_buses = true;
    o.log_path = records.log;
    o.black_box = records.black_box;
    return o;
}

Scene::Scene(const SceneSetup& setup, const SceneRecords& records)
    : setup_(setup),
      random_(setup.seed, kSceneStream),
      sim_(setup.believed, setup.truth, options(setup, records)) {}

bool Scene::drive_off() {
    SimulatedHost& host = sim_.host();
    sim_.run_for(0.5);
    const model::RobotParameters& p = setup_.believed;
    const double moment = random_.uniform();
    double drives_s = 0;  // before the moment
    switch (setup_.mode) {
        case Mode::velocity:
            host.velocity({setup_.way * uniform(0.2, 0.6) * p.limits.speed_m_per_s,
                           uniform(-0.3, 0.3) * p.limits.yaw_rate_rad_per_s});
            drives_s = 0.05 + moment;
            break;
        case Mode::pose: {
            const Pose<double> here = sim_.world().pose();
            const double away_m = 4 * p.geometry.track_m;
            host.external_pose(here);
            sim_.run_for(0.1);
            host.goal({here.x_m + setup_.way * away_m, here.y_m + uniform(-1, 1) * away_m, uniform(-3, 3)},
                      protocol::PoseDirection::automatic);
            drives_s = 0.05 + 2 * moment;
            break;
        }
        case Mode::trajectory:
        case Mode::adaptive: {
            const auto path = control::standard_figure_eight<double>(p);
            sim_.world().plant().place({}, {});
            sim_.run_for(0.1);
            host.external_pose({});
            sim_.run_for(0.1);
            protocol::TrajectoryCommand command;
            command.shape = static_cast<protocol::TrajectoryShape>(path.kind);
            command.length_m = path.length_m;
            command.width_m = path.width_m;
            command.period_s = path.period_s;
            host.trajectory(command);
            sim_.run_for(0.05);
            drives_s = 0.1 + 4 * moment;
            break;
        }
        default:
            drives_s = 0.05 + 6 * moment;
            break;
    }
    if (!enter_mode(sim_, setup_.mode)) {
        const auto& supervisor = sim_.cycle().supervisor();
        problem = std::string(protocol::to_string_view(supervisor.blocker())) + "/" +
                  std::string(protocol::to_string_view(supervisor.fault()));
        return false;
    }
    sim_.run_for(drives_s);
    if (sim_.cycle().supervisor().mode() != setup_.mode) {
        problem =
            "left by itself: " + std::string(protocol::to_string_view(sim_.cycle().supervisor().fault()));
        return false;
    }
    return true;
}

hal::CanFrame Scene::to_drive(std::size_t side, std::uint32_t command, std::uint32_t first,
                              std::uint32_t second, std::uint8_t length) const {
    hal::CanFrame frame;
    frame.id = id(side, command);
    frame.length = length;
    frame.data = {};
    std::memcpy(frame.data.data(), &first, 4);
    std::memcpy(frame.data.data() + 4, &second, 4);
    return frame;
}

void Scene::restore() {
    for (const auto node : {Simulation::Node::firmware, Simulation::Node::robot, Simulation::Node::host}) {
        sim_.faulty_bus(node).on_receive({});
        sim_.faulty_bus(node).on_send({});
    }
    sim_.bus().clear_faults();
    for (std::size_t i = 0; i < 2; ++i) {
        sim_.bus().set_down(i, false);
        sim_.bus().recover(i);
        sim_.bus().set_receive_latency(i, 0, 0);
        sim_.world().drive(i).faults() = {};
    }
    sim_.emergency_stop().set(hal::LineLevel::inactive);
    if (reversed) drive().reverse_encoder();
    reversed = false;
    if (undo) undo();
    undo = {};
}

}  // namespace wheelwright::tools
