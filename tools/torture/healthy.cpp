#include "tools/torture/healthy.hpp"

#include <algorithm>
#include <cmath>

#include "firmware/control/limits.hpp"
#include "firmware/control/trajectory.hpp"
#include "tools/sim/experiments.hpp"
#include "tools/torture/scene.hpp"

namespace wheelwright::tools {
namespace {

using protocol::Mode;

constexpr std::uint64_t kHealthyStream = 0x72;

// Of what both motors can push with.
constexpr double kMostSlope = 0.3;
constexpr double kMostPush = 0.6;
constexpr double kPayload = 0.3;  // of the robot's mass

// What no robot file knows: a slope, for half of them tyres that slip.
SceneSetup on(Ground ground, SceneSetup setup) {
    if (ground == Ground::level) return setup;
    sim::Random random(setup.seed, kHealthyStream + 1);
    const auto activate = [&](const char* name, double first, double second) {
        const std::size_t i = model::find_effect(name);
        setup.truth.effects.active[i] = true;
        setup.truth.effects.parameter[i][0] = first;
        setup.truth.effects.parameter[i][1] = second;
    };
    const double pull_m_per_s2 = kMostSlope * random.uniform() * 2 * setup.believed.limits.torque_Nm *
                                 setup.believed.dynamics.k7_per_kg_m;
    activate("slope", std::asin(std::min(pull_m_per_s2 / model::kGravity_m_per_s2, 0.3)),
             6.28 * random.uniform() - 3.14);
    if (random.bits() % 2 != 0)
        activate("wheel_slip", 0.2 + 0.8 * random.uniform(), 0.02 + 0.1 * random.uniform());
    return setup;
}

class Driver {
  public:
    Driver(const SceneSetup& setup, HealthyResult& result, Ground ground)
        : scene_(on(ground, setup)), result_(result), random_(setup.seed, kHealthyStream), ground_(ground) {}

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
        if (run_until([&] { return supervisor.mode() == Mode::fault; }, duration_s))
            note(mode, std::string(protocol::to_string_view(supervisor.fault())));
    }

    // Now and then somebody pushes, for a moment.
    template <typename Condition>
    bool run_until(Condition condition, double duration_s) {
        if (ground_ == Ground::level) return scene_.sim().run_until(condition, duration_s);
        sim::Plant& plant = scene_.sim().world().plant();
        const double end_s = scene_.sim().time_s() + duration_s;
        while (scene_.sim().time_s() < end_s) {
            const auto rest_s = [&] { return end_s - scene_.sim().time_s(); };
            if (scene_.sim().run_until(condition, std::min(uniform(0.3, 4), rest_s()))) return true;
            const auto& p = scene_.setup().believed;
            const double most_N = kMostPush * 2 * p.limits.torque_Nm / p.geometry.mean_radius_m();
            const double force_N = uniform(-1, 1) * most_N;
            plant.set_disturbance({force_N, uniform(-0.5, 0.5) * most_N * p.geometry.track_m / 2});
            const bool over = scene_.sim().run_until(condition, std::min(uniform(0.01, 1), rest_s()));
            plant.set_disturbance({});
            if (over) return true;
        }
        return condition();
    }

    // Every other drive is with a box on the robot.
    void load() {
        if (ground_ == Ground::level) return;
        sim::Plant& plant = scene_.sim().world().plant();
        if (box_.mass_kg == 0) {
            const sim::PlantParameters& body = plant.parameters();
            box_ = {kPayload * body.mass_kg, kPayload * body.inertia_kg_m2, 0, 0};
        }
        plant.add_payload(box_);
        box_.mass_kg = -box_.mass_kg;
        box_.inertia_kg_m2 = -box_.inertia_kg_m2;
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
        load();
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
        run_until([&] { return supervisor.mode() != Mode::ident; },
                  scene_.setup().believed.ident.duration_s + 2);
        if (supervisor.mode() == Mode::fault)
            note(Mode::ident, std::string(protocol::to_string_view(supervisor.fault())));
        scene_.sim().run_for(0.5);
    }

    Scene scene_;
    HealthyResult& result_;
    sim::Random random_;
    Ground ground_;
    sim::Payload box_;
};

}  // namespace

HealthyResult drive_healthy(std::uint64_t seed, double duration_s, Ground ground) {
    HealthyResult result;
    result.seed = seed;
    const SceneSetup setup = scene_setup(seed, TorturedRobots::drawn);
    result.robot = setup.text();
    Driver(setup, result, ground).drive(duration_s);
    return result;
}

}  // namespace wheelwright::tools
