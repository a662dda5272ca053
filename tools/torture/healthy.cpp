#include "tools/torture/healthy.hpp"

#include "firmware/control/limits.hpp"
#include "firmware/control/trajectory.hpp"
#include "tools/sim/experiments.hpp"
#include "tools/torture/scene.hpp"

namespace wheelwright::tools {
namespace {

using protocol::Mode;

constexpr std::uint64_t kHealthyStream = 0x72;

class Driver {
  public:
    Driver(const SceneSetup& setup, HealthyResult& result)
        : scene_(setup), result_(result), random_(setup.seed, kHealthyStream) {}

    void drive(double duration_s) {
        Simulation& sim = scene_.sim();
        sim.run_for(0.5);
        sim::FaultRule loss;
        loss.probability = kHealthyLoss;
        sim.bus().add_fault(loss);
        for (std::size_t turn = 0; sim.time_s() < duration_s; ++turn) {
            switch (turn % 6) {
                case 0:
                case 3:
                    velocities();
                    break;
                case 1:
                    goals();
                    break;
                case 2:
                    path(Mode::trajectory);
                    break;
                case 4:
                    path(Mode::adaptive);
                    break;
                default:
                    identification();
                    break;
            }
            rest();
        }
        result_.driven_s = sim.time_s();
    }

  private:
    double uniform(double low, double high) { return low + (high - low) * random_.uniform(); }

    // Frames are lost, also those that ask for a mode.
    bool enter(Mode mode) {
        for (int i = 0; i < 3; ++i) {
            if (enter_mode(scene_.sim(), mode)) {
                ++result_.drives;
                return true;
            }
            if (scene_.sim().cycle().supervisor().mode() == Mode::fault) break;
        }
        ++result_.refused;
        const protocol::Status status = scene_.sim().cycle().report().status;
        note(mode, "not entered: " + std::string(protocol::to_string_view(status.state)) + ", " +
                       std::string(protocol::to_string_view(status.fault)) + ", " +
                       std::string(protocol::to_string_view(status.blocker)) + ", drives " +
                       std::string(protocol::to_string_view(status.drive_left)) + " and " +
                       std::string(protocol::to_string_view(status.drive_right)));
        return false;
    }

    void note(Mode mode, const std::string& what) {
        result_.trips.push_back(std::to_string(scene_.sim().time_s()) + " s, " +
                                std::string(protocol::to_string_view(mode)) + ": " + what);
    }

    // Runs on in a mode, which must not be left.
    void stay(Mode mode, double duration_s) {
        const auto& supervisor = scene_.sim().cycle().supervisor();
        if (scene_.sim().run_until([&] { return supervisor.mode() == Mode::fault; }, duration_s))
            note(mode, std::string(protocol::to_string_view(supervisor.fault())));
    }

    void rest() {
        Simulation& sim = scene_.sim();
        const auto& supervisor = sim.cycle().supervisor();
        sim.host().silence();
        const auto idle = [&] {
            return supervisor.mode() == Mode::idle && supervisor.phase() == supervisor::Phase::steady;
        };
        for (int i = 0; i < 5 && !idle(); ++i) {
            if (supervisor.mode() == Mode::fault) {
                sim.host().clear_fault();
            } else {
                sim.host().mode(Mode::idle);
            }
            // Asked again, the ramp's limit begins anew.
            sim.run_until(idle, 2 * control::braking_time_s(scene_.setup().believed) + 1);
        }
        sim.run_for(uniform(0.1, 1));
        // Rooms are finite; somebody carries it back.
        sim.world().plant().place({}, {});
        sim.run_for(0.1);
        sim.host().external_pose({});
        sim.run_for(0.3);
    }

    void velocities() {
        const auto& limits = scene_.setup().believed.limits;
        const auto any = [&] {
            const double quick = random_.bits() % 4 == 0 ? 1 : 0.5;  // now and then all that is allowed
            scene_.sim().host().velocity({quick * uniform(-1, 1) * limits.speed_m_per_s,
                                          quick * uniform(-1, 1) * limits.yaw_rate_rad_per_s});
        };
        any();
        if (!enter(Mode::velocity)) return;
        for (int i = 0; i < 8; ++i) {
            stay(Mode::velocity, uniform(0.1, 3));
            any();
        }
    }

    void goals() {
        const double away_m = 6 * scene_.setup().believed.geometry.track_m;
        const auto any = [&] {
            scene_.sim().host().goal({uniform(-away_m, away_m), uniform(-away_m, away_m), uniform(-3, 3)},
                                     static_cast<protocol::PoseDirection>(random_.bits() % 3));
        };
        any();
        if (!enter(Mode::pose)) return;
        for (int i = 0; i < 4; ++i) {
            stay(Mode::pose, uniform(1, 8));
            any();
        }
    }

    void path(Mode mode) {
        const auto figure = control::standard_figure_eight<double>(scene_.setup().believed);
        protocol::TrajectoryCommand command;
        command.shape = static_cast<protocol::TrajectoryShape>(figure.kind);
        command.length_m = figure.length_m;
        command.width_m = figure.width_m;
        command.period_s = figure.period_s;
        for (int i = 0; i < 2; ++i) {  // one may be lost
            scene_.sim().host().trajectory(command);
            scene_.sim().run_for(0.02);
        }
        if (enter(mode)) stay(mode, uniform(5, 30));
    }

    void identification() {
        if (!enter(Mode::ident)) return;
        const auto& supervisor = scene_.sim().cycle().supervisor();
        scene_.sim().run_until([&] { return supervisor.mode() != Mode::ident; },
                               scene_.setup().believed.ident.duration_s + 2);
        if (supervisor.mode() == Mode::fault)
            note(Mode::ident, std::string(protocol::to_string_view(supervisor.fault())));
        scene_.sim().run_for(0.5);
    }

    Scene scene_;
    HealthyResult& result_;
    sim::Random random_;
};

}  // namespace

HealthyResult drive_healthy(std::uint64_t seed, double duration_s) {
    HealthyResult result;
    result.seed = seed;
    const SceneSetup setup = scene_setup(seed, TorturedRobots::drawn);
    result.robot = setup.text();
    Driver(setup, result).drive(duration_s);
    return result;
}

}  // namespace wheelwright::tools
