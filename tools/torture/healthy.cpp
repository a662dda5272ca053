#include "tools/torture/healthy.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string_view>

#include "firmware/control/limits.hpp"
#include "firmware/control/trajectory.hpp"
#include "firmware/control/velocity_loop_speed.hpp"
#include "tools/sim/experiments.hpp"
#include "tools/torture/scene.hpp"

namespace wheelwright::tools {
namespace {

using protocol::Mode;

constexpr std::uint64_t kHealthyStream = 0x72;
constexpr std::uint64_t kGroundStream = 0x73;

// What pushes a robot on rough ground, in shares of what its torque can push, or of half its weight if that
// is less.
class Ground {
  public:
    Ground(const SceneSetup& setup, sim::World& world)
        : world_(world), random_(setup.seed, kGroundStream), half_track_m_(setup.truth.geometry.track_m / 2) {
        const sim::PlantParameters& plant = world.plant().actual();
        mass_kg_ = plant.mass_kg;
        most_N_ = std::min(2 * setup.believed.limits.torque_Nm / plant.geometry.mean_radius_m(),
                           kSteepest * model::kGravity_m_per_s2 * mass_kg_);
    }

    // Where nothing holds the robot.
    void flat() {
        slope_ = camber_ = 0;
        bump_cycles_ = held_cycles_ = 0;
        world_.plant().set_disturbance({});
    }

    void step() {
        sim::Plant& plant = world_.plant();
        const Twist<double>& twist = plant.twist();
        const bool moves = std::abs(twist.v_m_per_s) > 0.05 || std::abs(twist.omega_rad_per_s) > 0.1;
        if (--slope_cycles_ < 0) {  // another one, within a tenth of a second
            slope_cycles_ = static_cast<int>(uniform(500, 4000));
            next_slope_ = uniform(-kSlope, kSlope);
            next_camber_ = uniform(-kCamber, kCamber);
        }
        slope_ += 0.01 * (next_slope_ - slope_);
        camber_ += 0.01 * (next_camber_ - camber_);
        if (moves && bump_cycles_ == 0 && random_.uniform() < kBumpsPerSecond * 1e-3) {
            bump_cycle_ = 0;
            bump_cycles_ = static_cast<int>(uniform(10, 60));
            bump_N_ = uniform(0.2, kBump) * most_N_;
            bump_arm_m_ = random_.bits() % 2 != 0 ? half_track_m_ : -half_track_m_;
        }
        if (moves && held_cycles_ == 0 && random_.uniform() < kHitsPerSecond * 1e-3) {
            held_cycles_ = static_cast<int>(uniform(30, 400));
            const double back = -uniform(0, kGivesBack);
            plant.place(plant.pose(),
                        {back * twist.v_m_per_s, uniform(-kGivesBack, 1) * twist.omega_rad_per_s});
        }
        sim::Disturbance push{slope_ * most_N_, camber_ * most_N_ * half_track_m_};
        if (bump_cycles_ > 0) {
            const double way = twist.v_m_per_s >= 0 ? 1 : -1;
            const double force_N =
                way * bump_N_ * std::sin(2 * kPi * (++bump_cycle_ + 0.5 * bump_cycles_) / bump_cycles_);
            push.force_N += force_N;
            push.yaw_torque_Nm -= force_N * bump_arm_m_;
            if (bump_cycle_ >= bump_cycles_) bump_cycles_ = 0;
        }
        if (held_cycles_ > 0) {  // by what it has hit
            --held_cycles_;
            push.force_N -= twist.v_m_per_s * mass_kg_ / kHeld_s;
        }
        plant.set_disturbance(push);
    }

  private:
    static constexpr double kSteepest = 0.5;  // of the weight
    static constexpr double kSlope = 0.4, kCamber = 0.3, kBump = 1.5;
    static constexpr double kBumpsPerSecond = 1, kHitsPerSecond = 0.05;
    static constexpr double kGivesBack = 0.3;
    static constexpr double kHeld_s = 0.01;
    static constexpr double kPi = 3.141592653589793;
    double uniform(double low, double high) { return low + (high - low) * random_.uniform(); }

    sim::World& world_;
    sim::Random random_;
    double half_track_m_, most_N_ = 0, mass_kg_ = 0;
    int slope_cycles_ = 0, bump_cycle_ = 0, bump_cycles_ = 0, held_cycles_ = 0;
    double slope_ = 0, camber_ = 0, next_slope_ = 0, next_camber_ = 0, bump_N_ = 0, bump_arm_m_ = 0;
};

class Driver {
  public:
    Driver(const SceneSetup& setup, HealthyResult& result, bool rough)
        : scene_(setup),
          result_(result),
          random_(setup.seed, kHealthyStream),
          torque_Nm_(
              std::min(setup.believed.limits.torque_Nm, setup.simulation.current_limit_A *
                                                            setup.truth.drive.left.torque_constant_Nm_per_A *
                                                            setup.truth.drive.left.gear_ratio)) {
        if (rough) ground_.emplace(setup, scene_.sim().world());
    }

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
    std::function<void()> ground() {
        return ground_ ? [this] { ground_->step(); } : std::function<void()>{};
    }

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
        result_.trips.push_back(at(scene_.sim().time_s(), mode) + ": " + what);
    }

    static std::string at(double time_s, Mode mode) {
        return std::to_string(time_s) + " s, " + std::string(protocol::to_string_view(mode));
    }

    // Runs on in a mode, which must not be left. False: it was.
    bool stay(Mode mode, double duration_s) {
        const auto& supervisor = scene_.sim().cycle().supervisor();
        const auto stopped = [&] { return supervisor.mode() == Mode::fault; };
        const auto step = [&] {
            if (ground_) ground_->step();
            look_at_speed(mode);
            if (mode == Mode::velocity) look_at_course();
        };
        asked_s_ = scene_.sim().time_s();
        if (!scene_.sim().run_until(stopped, duration_s, step)) return true;
        if (!rushed()) note(mode, std::string(protocol::to_string_view(supervisor.fault())));
        return false;
    }

    void look_at_speed(Mode mode) {
        const Twist<double> now = of_limits(scene_.sim().world().twist());
        const Twist<double> blind = blind_share();
        const double share = std::max(std::abs(now.v_m_per_s) - blind.v_m_per_s,
                                      std::abs(now.omega_rad_per_s) - blind.omega_rad_per_s);
        result_.fastest = std::max(result_.fastest, share);
        if (share > kHealthySpeed) stray(mode, std::to_string(share) + " of its limits");
    }

    void stray(Mode mode, const std::string& how) {
        if (!ground_ && result_.strays.empty()) result_.strays = at(scene_.sim().time_s(), mode) + ": " + how;
    }

    // Whatever the torque: on its way to another set-point no speed passes what it was, was told to be, or is
    // to become; and in the end the robot drives its set-point, or where half of the torque does not hold it
    // there the same curve more slowly.
    void look_at_course() {
        const Twist<double> now = of_limits(scene_.sim().world().twist());
        const auto outside = [this](double Twist<double>::*axis, double value) {
            const auto [low, high] = std::minmax({0.0, was_.*axis, told_.*axis, asked_.*axis});
            return std::max(low - value, value - high);
        };
        const Twist<double> blind = blind_share();
        double astray =
            std::max(outside(&Twist<double>::v_m_per_s, now.v_m_per_s) - blind.v_m_per_s,
                     outside(&Twist<double>::omega_rad_per_s, now.omega_rad_per_s) - blind.omega_rad_per_s);
        if (scene_.sim().time_s() > asked_s_ + settled_after_s()) {
            const double along = held_by_half() ? 1 : share_of(asked_, now);
            astray = std::max(astray, std::hypot(now.v_m_per_s - along * asked_.v_m_per_s,
                                                 now.omega_rad_per_s - along * asked_.omega_rad_per_s));
        }
        result_.astray = std::max(result_.astray, astray);
        if (astray > kHealthyAstray)
            stray(Mode::velocity, std::to_string(astray) + " of its limits beside its set-point");
    }

    // The pushes of eq (43) that a turn brings.
    bool held_by_half() const {
        const model::Dynamics<double>& k = scene_.setup().believed.dynamics;
        return control::within_limit(model::inverse_dynamics(k, times_limits(asked_), {}), torque_Nm_ / 2);
    }

    static double share_of(const Twist<double>& whole, const Twist<double>& part) {
        const double product =
            whole.v_m_per_s * part.v_m_per_s + whole.omega_rad_per_s * part.omega_rad_per_s;
        const double square =
            whole.v_m_per_s * whole.v_m_per_s + whole.omega_rad_per_s * whole.omega_rad_per_s;
        return square > 0 ? std::clamp(product / square, 0.0, 1.0) : 0;
    }

    // Twice what half of the torque that friction leaves and the loops take from one set-point to the next.
    double settled_after_s() const {
        const model::RobotParameters& robot = scene_.setup().believed;
        const auto [acceleration, yaw_acceleration] = control::usual_acceleration(robot);
        const Twist<double> asked = times_limits(asked_), was = times_limits(was_);
        double ramp_s = std::max(std::abs(asked.v_m_per_s - was.v_m_per_s) / acceleration,
                                 std::abs(asked.omega_rad_per_s - was.omega_rad_per_s) / yaw_acceleration);
        const auto largest = [&robot](std::string_view name) {
            const auto& sides = robot.effects.parameter[model::find_effect(name)];
            return std::max(sides[0], sides[1]);
        };
        const WheelPair<double> wheel_rad_per_s = model::wheel_speeds_from_twist(robot.geometry, asked);
        const double friction_Nm = largest("coulomb_friction") +
                                   largest("viscous_friction") * std::max(std::abs(wheel_rad_per_s.left),
                                                                          std::abs(wheel_rad_per_s.right));
        ramp_s *= robot.limits.torque_Nm / std::max(torque_Nm_ - friction_Nm, kLeastLeft * torque_Nm_);
        return 2 * (ramp_s + control::velocity_loop_speed(robot, 1e-3).settling_time_s);
    }

    // What all of the torque adds before the loops can hear of it, which none can take back.
    Twist<double> blind_share() const {
        const model::RobotParameters& robot = scene_.setup().believed;
        const double blind_Nm_s = 2 * robot.limits.torque_Nm * robot.velocity_loop.actuation_delay_s;
        return of_limits({robot.dynamics.k7_per_kg_m * blind_Nm_s, robot.dynamics.k8_per_kg_m2 * blind_Nm_s});
    }

    Twist<double> of_limits(const Twist<double>& twist) const {
        const auto& limits = scene_.setup().believed.limits;
        return {twist.v_m_per_s / limits.speed_m_per_s, twist.omega_rad_per_s / limits.yaw_rate_rad_per_s};
    }

    Twist<double> times_limits(const Twist<double>& share) const {
        const auto& limits = scene_.setup().believed.limits;
        return {share.v_m_per_s * limits.speed_m_per_s, share.omega_rad_per_s * limits.yaw_rate_rad_per_s};
    }

    // Down a slope, say, truly faster than its limits: that is no false trip.
    bool rushed() {
        const auto& supervisor = scene_.sim().cycle().supervisor();
        const auto& safety = scene_.setup().believed.safety;
        const Twist<double>& twist = scene_.sim().world().twist();
        return ground_ && supervisor.fault() == protocol::Fault::over_speed &&
               (std::abs(twist.v_m_per_s) > 0.9 * safety.over_speed_m_per_s ||
                std::abs(twist.omega_rad_per_s) > 0.9 * safety.over_yaw_rate_rad_per_s);
    }

    void rest() {
        Simulation& sim = scene_.sim();
        const auto& supervisor = sim.cycle().supervisor();
        if (ground_) ground_->flat();
        const auto idle = [&] {
            return supervisor.mode() == Mode::idle && supervisor.phase() == supervisor::Phase::steady;
        };
        const auto drives = [&] {
            return supervisor.mode() != Mode::fault && supervisor.mode() != Mode::idle &&
                   supervisor.phase() == supervisor::Phase::steady;
        };
        // A host falls silent when it is heard to brake: frames are lost.
        for (int i = 0; i < 3 && drives(); ++i) {
            sim.host().mode(Mode::idle);
            sim.run_for(0.02);
        }
        sim.host().silence();
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
        const auto any = [&] {
            const double quick = random_.bits() % 4 == 0 ? 1 : 0.5;  // now and then all that is allowed
            const double v = quick * uniform(-1, 1);
            asked_ = {v, quick * uniform(-1, 1)};
            was_ = of_limits(scene_.sim().world().twist());
            told_ = of_limits(scene_.sim().cycle().report().reference);
            scene_.sim().host().velocity(times_limits(asked_));
        };
        any();
        if (!enter(Mode::velocity)) return;
        for (int i = 0; i < 8 && stay(Mode::velocity, uniform(0.1, 3)); ++i) any();
    }

    void goals() {
        const double away_m = 6 * scene_.setup().believed.geometry.track_m;
        const auto any = [&] {
            scene_.sim().host().goal({uniform(-away_m, away_m), uniform(-away_m, away_m), uniform(-3, 3)},
                                     static_cast<protocol::PoseDirection>(random_.bits() % 3));
        };
        any();
        if (!enter(Mode::pose)) return;
        for (int i = 0; i < 4 && stay(Mode::pose, uniform(1, 8)); ++i) any();
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
                               scene_.setup().believed.ident.duration_s + 2, ground());
        if (supervisor.mode() == Mode::fault && !rushed())
            note(Mode::ident, std::string(protocol::to_string_view(supervisor.fault())));
        scene_.sim().run_for(0.5);
    }

    Scene scene_;
    HealthyResult& result_;
    sim::Random random_;
    std::optional<Ground> ground_;
    // Shares of the limits: the set-point, and at its moment true motion and reference.
    Twist<double> asked_, was_, told_;
    double asked_s_ = 0;
    static constexpr double kLeastLeft = 0.05;  // of the torque: a slower robot is not waited for
    double torque_Nm_;                          // that the drives give
};

}  // namespace

HealthyResult drive_healthy(std::uint64_t seed, double duration_s, bool rough, int report_period_ms) {
    HealthyResult result;
    result.seed = seed;
    SceneSetup setup = scene_setup(seed, TorturedRobots::drawn, report_period_ms);
    result.robot = setup.text();
    if (rough && seed % 2 == 0) {
        const std::size_t slip = model::find_effect("wheel_slip");
        setup.truth.effects.active[slip] = true;
        setup.truth.effects.parameter[slip] = {0.5, 0.05};
    }
    Driver(setup, result, rough).drive(duration_s);
    return result;
}

}  // namespace wheelwright::tools
