// The firmware with all its threads, a simulated robot and a host in one process, and then many such robots
// side by side: for what watches every access to memory (thread sanitizer, memcheck). Says what it came past;
// exit status 1 when something did not happen.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "firmware/task/robot_file.hpp"
#include "firmware/task/saver.hpp"
#include "tools/cli/in_parallel.hpp"
#include "tools/cli/scratch_folder.hpp"
#include "tools/sim/simulation.hpp"

namespace {

using namespace wheelwright;
using namespace wheelwright::tools;

constexpr std::uint16_t kTorqueLimit = 0x0010;

int failures = 0;

void expect(bool done, const char* what) {
    std::printf("%s: %s\n", what, done ? "yes" : "NO");
    if (!done) ++failures;
}

model::RobotParameters robot(const std::string& path) {
    const task::RobotFileResult file = task::read_robot_file(path);
    return file.robot ? file.robot->parameters : model::default_parameters();
}

std::string shipped(const char* name) { return std::string(WHEELWRIGHT_ROBOTS) + "/" + name; }

// Pushes both wheels for a while.
void push(Simulation& sim, double duration_s) {
    sim.host().torque({0.8, 0.8});
    sim.host().mode(protocol::Mode::torque);
    sim.run_for(duration_s);
}

// The cycle's thread, the saving thread, and a signal from a third.
void one_robot() {
    const ScratchFolder folder;
    const std::string path = folder.path() + "/robot.toml";
    std::filesystem::copy_file(shipped("default.toml"), path);
    Simulation sim(robot(path), robot(shipped("simulated.toml")), {});
    const task::Saver saver(path, sim.mailbox());
    sim.run_for(0.3);
    push(sim, 0.5);
    expect(sim.world().twist().v_m_per_s > 0.05, "drives");
    sim.host().mode(protocol::Mode::idle);
    sim.run_for(1.5);
    using Operation = protocol::ParameterOperation;
    for (const double limit_Nm : {2.0, 2.5, 3.0}) {
        sim.host().parameter(Operation::write, kTorqueLimit, static_cast<float>(limit_Nm));
        sim.host().parameter(Operation::commit, 0);
        bool saved = false;
        for (int i = 0; i < 1000 && !saved; ++i) {
            if (i % 20 == 0) sim.host().parameter(Operation::save, 0);  // refused while one is under way
            sim.run_for(0.002);
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
            saved = std::abs(robot(path).limits.torque_Nm - limit_Nm) < 1e-9;
        }
        expect(saved, "saves what was committed");
    }
    push(sim, 0.2);
    std::thread signal([&] { sim.cycle().request_termination(); });
    const bool ended = sim.run_until([&] { return sim.cycle().finished(); }, 5);
    signal.join();
    expect(ended, "ends in order");
}

void many_robots() {
    constexpr std::size_t kRobots = 6;
    const model::RobotParameters controller = robot(shipped("default.toml"));
    const model::RobotParameters truth = robot(shipped("simulated.toml"));
    std::vector<double> way_m(kRobots);
    std::size_t told = 0;
    in_parallel(
        kRobots, 3, [&](const CampaignProgress& progress) { told = progress.done; },
        [&](std::size_t i) {
            SimulationOptions options;
            options.seed = i / 2;
            Simulation sim(controller, truth, options);
            sim.run_for(0.3);
            push(sim, 0.3);
            way_m[i] = sim.world().pose().x_m;
            return std::to_string(i);
        });
    bool same = told == kRobots;
    for (std::size_t i = 0; i < kRobots; i += 2) same = same && way_m[i] > 0 && way_m[i] == way_m[i + 1];
    expect(same, "side by side as alone");
}

}  // namespace

int main() {
    one_robot();
    many_robots();
    return failures == 0 ? 0 : 1;
}
