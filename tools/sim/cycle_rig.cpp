#include "tools/sim/cycle_rig.hpp"

#include "tools/cli/robots.hpp"
#include "tools/sim/experiments.hpp"

namespace wheelwright::tools {
namespace {

constexpr std::int64_t kStart_ns = 1'000'000'000;

sim::InProcessBusOptions bus_options(double bit_rate, std::uint64_t seed) {
    sim::InProcessBusOptions options;
    options.bit_rate = static_cast<std::uint32_t>(bit_rate);
    options.seed = seed;
    return options;
}

sim::WorldOptions seeded(sim::WorldOptions world, std::uint64_t seed) {
    world.seed = seed;
    world.start_ns = kStart_ns;
    return world;
}

}  // namespace

CycleRig::CycleRig(const model::RobotParameters& controller, const model::RobotParameters& truth,
                   const RigOptions& options)
    : parameters_(controller),
      clock_(kStart_ns),
      bus_(clock_, 3, bus_options(controller.bus.bit_rate_bit_per_s, options.seed)),
      second_(options.separate_host_bus
                  ? std::make_unique<sim::InProcessBus>(
                        clock_, 2, bus_options(controller.bus.host_bit_rate_bit_per_s, options.seed + 1))
                  : nullptr),
      world_(truth, seeded(options.world, options.seed), bus_.endpoint(kRobot)),
      robot_(clock_, bus_, bus_.endpoint(kRobot), world_),
      host_(std::make_unique<SimulatedHost>(host_bus(), world_)),
      stop_line_(clock_),
      enable_line_(clock_),
      schedule_(kStart_ns + task::kCyclePeriod_ns) {
    host_bus().set_filters({});
    if (options.front != nullptr) options.front->connect(bus_.endpoint(kFirmware));
    const task::CyclePorts ports{
        options.front != nullptr ? static_cast<hal::CanBus&>(*options.front) : bus_.endpoint(kFirmware),
        second_ == nullptr ? nullptr : &second_->endpoint(0),
        *drivers::make_drive(left_, parameters_, drivers::Wheel::left),
        *drivers::make_drive(right_, parameters_, drivers::Wheel::right),
        options.digital_lines ? &stop_line_ : nullptr,
        options.digital_lines ? &enable_line_ : nullptr,
        options.arming_key};
    if (options.black_box) box_ = std::make_unique<task::BlackBox>(ports, mailbox_);
    cycle_ = std::make_unique<task::Cycle>(parameters_, mailbox_, box_ == nullptr ? ports : box_->ports());
    if (box_ != nullptr) box_->watch(*cycle_);
}

void CycleRig::wake() {
    clock_.sleep_until_ns(schedule_.next_deadline_ns() + late_cycles_ * task::kCyclePeriod_ns);
    late_cycles_ = 0;
    host_->step(clock_.now_ns());
    time_ = schedule_.begin(clock_.now_ns());
}

ExampleRobots example_robots(bool identified) {
    const task::RobotFile controller = load_robot(example_robot("default.toml"));
    const task::RobotFile truth = load_robot(example_robot("simulated.toml"));
    ExampleRobots robots{controller.parameters, truth.parameters, world_options(truth.simulation, 1)};
    if (identified) {
        model::RobotParameters& p = robots.controller;
        const model::Dynamics<double> k =
            as_seen_with(sim::plant_dynamics(sim::Plant(sim::plant_from_dynamics(truth.parameters.geometry,
                                                                                 truth.parameters.dynamics,
                                                                                 truth.parameters.effects),
                                                        {})
                                                 .parameters()),
                         truth.parameters.geometry, p.geometry);
        p.dynamics = k;
        p.dynamics_standard_error = {2e-3, 1e-1, 2e-3 * k.k7_per_kg_m, 2e-3 * k.k8_per_kg_m2};
        for (std::size_t i = 0; i < model::kEffectCount; ++i) {
            if (!p.effects.active[i]) continue;
            p.effects.parameter[i] = truth.parameters.effects.parameter[i];
            p.effects_standard_error.parameter[i].fill(0.01);
        }
    }
    return robots;
}

}  // namespace wheelwright::tools
