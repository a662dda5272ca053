#include "tools/torture/trial.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <optional>

#include "drivers/odrive/odrive_0_6_messages.hpp"
#include "tools/sim/experiments.hpp"

namespace wheelwright::tools {
namespace {

using protocol::Fault;
using protocol::Mode;

constexpr double kLongest_s = 2.5;  // of TortureKind::lasts_s
constexpr double kLatestLie_s = 8;  // From::lie: an identification's next pushes are seen
constexpr double kCycle_s = task::kCyclePeriod_s;
// From then on the torque must be gone where the firmware says that nobody drives.
constexpr double kGrace_s = 2 * kCycle_s;
// No encoder is farther from the truth than this: a step of the coarsest, and where in a step it began.
constexpr double kCoarse_rad = kMostUnseen_rad;
// Noise of set-points and observers.
constexpr double kRoom = 0.05;

double rim_m_per_s(const sim::World& world) {
    const WheelPair<double>& radius = world.plant().actual().geometry.wheel_radius_m;
    const WheelPair<double>& speed = world.plant().wheel_speed_rad_per_s();
    return std::max(std::abs(radius.left * speed.left), std::abs(radius.right * speed.right));
}

double true_torque_Nm(sim::World& world) {
    return std::max(std::abs(world.left().torque_target_Nm()), std::abs(world.right().torque_target_Nm()));
}

std::string text(const char* format, double a = 0, double b = 0) {
    std::array<char, 160> buffer;
    std::snprintf(buffer.data(), buffer.size(), format, a, b);
    return buffer.data();
}

bool names(std::string_view list, std::string_view name) {
    if (list == "*") return true;
    while (!list.empty()) {
        const std::size_t comma = std::min(list.find(','), list.size());
        if (list.substr(0, comma) == name) return true;
        list.remove_prefix(std::min(comma + 1, list.size()));
    }
    return false;
}

class Judge final : public sim::BusTap {
  public:
    Judge(Scene& scene, const TortureKind& kind, TortureResult& result)
        : scene_(scene), kind_(kind), result_(result) {
        scene.sim().bus().add_tap(*this);
        start_ = scene.sim().world().pose();
    }

    // The frames: their checksum, what the firmware tells the motors, when a drive first tells of its fault.
    void on_frame(const sim::WireEvent& event) override {
        const hal::CanFrame& frame = *event.frame;
        const auto mix = [this](std::uint64_t value) { hash_ = (hash_ ^ value) * 0x100000001B3U; };
        mix(std::uint64_t(event.end_ns));
        mix(frame.id | std::uint64_t{frame.length} << 32U);
        for (std::size_t i = 0; i < frame.length; ++i) mix(frame.data[i]);
        if (harmed_) {
            look_at_torque(event.end_ns);
            look_at_rest(event.end_ns);
        }
        // A stop counts from when it can be heard.
        if (harmed_ && event.sender >= 2 && frame.id == protocol::EmergencyStop::id && !frame.extended &&
            !frame.remote)
            scene_.tell_at(event.end_ns);
        if (harmed_ && event.sender >= 2 && frame.id == protocol::ClearFault::id) clear_asked_ = true;
        if (event.sender == 1 && frame.id >> 5U == scene_.node(scene_.setup().side) && !frame.extended &&
            scene_.has_returned) {
            scene_.tell_at(event.end_ns);
        }
        const std::uint32_t command = frame.id & 0x1FU;
        const bool of_drive = frame.id >> 5U == scene_.node(0) || frame.id >> 5U == scene_.node(1);
        if (!of_drive || frame.extended || frame.remote || frame.length < 4) return;
        if (event.sender == 0 && command == drivers::odrive_0_6::SetInputTorque::command) {
            float motor_Nm = 0;
            std::memcpy(&motor_Nm, frame.data.data(), 4);
            const auto& drive = frame.id >> 5U == scene_.node(0) ? scene_.setup().believed.drive.left
                                                                 : scene_.setup().believed.drive.right;
            const double limit_Nm =
                scene_.setup().believed.limits.torque_Nm / (drive.gear_ratio * drive.torque_scale);
            if (!(std::abs(double{motor_Nm}) <= 1.001 * limit_Nm))
                violate("torque sent", text("%g Nm for a limit of %g", double{motor_Nm}, limit_Nm));
        }
        if (harmed_ && !scene_.told_by_return && kind_.from != From::lie && event.sender == 1 &&
            command == drivers::odrive_0_6::Heartbeat::command && frame.length == 8) {
            std::uint32_t error = 0;
            std::memcpy(&error, frame.data.data(), 4);
            if (error != 0 || frame.data[4] != 8) scene_.tell_at(event.end_ns);
        }
    }

    void begin() {
        harmed_ = true;
        harmed_angle_rad_ = scene_.sim().world().plant().wheel_angle_rad();
    }

    // After each cycle. `watched`: the robot is under the fault, not in the recovery.
    void sample(bool watched) {
        sim::World& world = scene_.sim().world();
        const auto& supervisor = scene_.sim().cycle().supervisor();
        const double torque_Nm = true_torque_Nm(world);
        const double now_s = scene_.since_s();
        const model::RobotParameters& p = scene_.setup().believed;
        const double v = std::abs(world.twist().v_m_per_s);
        const double omega = std::abs(world.twist().omega_rad_per_s);
        if (!(std::isfinite(torque_Nm) && std::isfinite(v) && std::isfinite(omega)))
            violate("no number", "the true state");
        const double gain = 2 * p.limits.torque_Nm * scene_.setup().believed_lie_s();
        // A robot that coasts is nobody's: with its mass behind the axle it swings round by itself.
        if (torque_Nm > 0 &&
            !(v <= p.safety.over_speed_m_per_s * (1 + kRoom) + gain * p.dynamics.k7_per_kg_m))
            violate("too fast", text("%.2f m/s for a limit of %.2f", v, p.safety.over_speed_m_per_s));
        if (torque_Nm > 0 &&
            !(omega <= p.safety.over_yaw_rate_rad_per_s * (1 + kRoom) + gain * p.dynamics.k8_per_kg_m2))
            violate("too fast",
                    text("%.2f rad/s for a limit of %.2f", omega, p.safety.over_yaw_rate_rad_per_s));
        if (watched && scene_.untold_rad != nullptr) {
            const WheelPair<double>& angle_rad = world.plant().wheel_angle_rad();
            const WheelPair<double> turned_rad{angle_rad.left - harmed_angle_rad_.left,
                                               angle_rad.right - harmed_angle_rad_.right};
            if (scene_.untold_rad(scene_, turned_rad) > kCoarse_rad) scene_.tell();
        }
        const Pose<double>& pose = world.pose();
        if (watched && scene_.setup().mode == Mode::ident && kind_.expect != Expect::obeys &&
            p.ident.distance_limit_m > 0) {
            const double away_m = std::hypot(pose.x_m - start_.x_m, pose.y_m - start_.y_m);
            if (away_m > 2 * p.ident.distance_limit_m)  // from where it was, anywhere in the area
                violate("left its area", text("%.2f m for %.2f", away_m, p.ident.distance_limit_m));
        }

        look_at_torque(scene_.sim().now_ns());
        const bool driven = supervisor.may_drive() || supervisor.ramping();
        if (driven) undriven_since_s_.reset();
        // The firmware says it in the cycle that has just been.
        if (!driven && !undriven_since_s_) undriven_since_s_ = scene_.since_s(scene_.sim().cycle_ns());
        watched_ = watched;
        look_at_rest(scene_.sim().now_ns());
        if (watched) {
            rim_ = std::max(rim_, rim_m_per_s(world));
            // What is driven after a clear that was asked for is another drive; it may begin at rest.
            if (clear_asked_ && fault_ != Fault::none && supervisor.fault() == Fault::none && !cleared_) {
                cleared_ = true;
                if (rim_m_per_s(world) > 2 * p.safety.clear_speed_m_per_s)
                    violate("cleared", text("at %.2f m/s", rim_m_per_s(world)));
            }
            if (supervisor.fault() != Fault::none && fault_ != supervisor.fault()) {
                fault_ = supervisor.fault();
                faults_.push_back(fault_);
            }
        }
        if (supervisor.mode() != mode_ || supervisor.phase() != phase_ || supervisor.fault() != told_fault_ ||
            identifying_ != identification() || (torque_Nm > 0) != torque_) {
            mode_ = supervisor.mode();
            phase_ = supervisor.phase();
            told_fault_ = supervisor.fault();
            torque_ = torque_Nm > 0;
            identifying_ = identification();
            constexpr std::array kPhases{"steady", "arming", "ramping"};
            result_.story.push_back(text("%8.1f ms  %6.3f m/s  ", 1e3 * now_s, world.twist().v_m_per_s) +
                                    std::string(protocol::to_string_view(mode_)) + " " +
                                    kPhases[std::size_t(phase_)] + ", " +
                                    std::string(protocol::to_string_view(told_fault_)) +
                                    text(", %.3f Nm", torque_Nm) + identifying_);
        }
    }

    void violate(const std::string& rule, const std::string& what) {
        for (const std::string& known : result_.violations) {
            if (known.starts_with(rule + ":")) return;  // once is enough
        }
        result_.violations.push_back(rule + ": " + what);
        result_.story.push_back(text("%8.1f ms  VIOLATION ", 1e3 * scene_.since_s()) +
                                result_.violations.back());
    }

    // When torque was last seen, and when it was then seen to be gone.
    double last_torque_s() const { return last_torque_s_; }
    double no_torque_s() const { return no_torque_s_; }
    // In which torque acted since the firmware is told: all of it, with or without a pause between.
    double torque_since_told_s() const { return torque_since_told_s_; }
    double rim() const { return rim_; }
    const std::vector<Fault>& faults() const { return faults_; }
    std::uint64_t hash() const { return hash_; }

  private:
    // At each frame's end and each cycle's: some tenths of a millisecond apart.
    void look_at_torque(std::int64_t now_ns) {
        if (cleared_) return;
        const double since_look_s = scene_.since_s(now_ns) - looked_s_;
        looked_s_ += since_look_s;
        if (true_torque_Nm(scene_.sim().world()) > 0) {
            if (scene_.told_s()) torque_since_told_s_ += since_look_s;
            last_torque_s_ = scene_.since_s(now_ns);
            gone_ = false;
        } else if (!gone_) {
            gone_ = true;
            no_torque_s_ = scene_.since_s(now_ns);
        }
    }

    // Whether a robot that nobody drives is told torque.
    void look_at_rest(std::int64_t now_ns) {
        if (!undriven_since_s_) return;
        const double now_s = scene_.since_s(now_ns);
        // A drive that arms itself is known to be there from its first frame on.
        const double since_s = scene_.has_returned
                                   ? std::max(*undriven_since_s_, scene_.told_s().value_or(now_s))
                                   : *undriven_since_s_;
        double grace_s = kGrace_s + scene_.setup().simulation.command_latency_s;
        if (watched_ && kind_.unreachable)
            grace_s = std::max(grace_s, scene_.setup().believed.drive.watchdog_timeout_s + 2 * kCycle_s);
        const double torque_Nm = true_torque_Nm(scene_.sim().world());
        // A stop has its bound, wherever in it the firmware says so.
        const bool has_time = watched_ && kind_.expect == Expect::stops && kind_.from == From::harm &&
                              kind_.bound_s != nullptr &&
                              now_s <= kind_.bound_s(scene_) + scene_.setup().simulation.command_latency_s;
        if (torque_Nm > 0 && !has_time && now_s - since_s > grace_s + 1e-9)
            violate("torque at rest", text("%.2f Nm, %.1f ms after the firmware says that nobody drives",
                                           torque_Nm, 1e3 * (now_s - *undriven_since_s_)));
    }

    // What an identification does, or why it ended.
    std::string identification() const {
        if (scene_.setup().mode != Mode::ident) return "";
        const protocol::IdentStatus status = scene_.sim().cycle().learning().status();
        return ", " + std::string(protocol::to_string_view(status.phase)) + " " +
               std::string(protocol::to_string_view(status.cause));
    }

    Scene& scene_;
    const TortureKind& kind_;
    TortureResult& result_;
    Pose<double> start_;
    WheelPair<double> harmed_angle_rad_;
    bool harmed_ = false;
    std::uint64_t hash_ = 0xCBF29CE484222325U;
    double last_torque_s_ = -1;
    double no_torque_s_ = 0;
    double looked_s_ = 0, torque_since_told_s_ = 0;
    bool gone_ = true;
    bool clear_asked_ = false, cleared_ = false;
    std::optional<double> undriven_since_s_;
    bool watched_ = false;
    double rim_ = 0;
    Fault fault_ = Fault::none;
    std::vector<Fault> faults_;
    Mode mode_ = Mode::boot;
    supervisor::Phase phase_ = supervisor::Phase::steady;
    Fault told_fault_ = Fault::none;
    bool torque_ = false;
    std::string identifying_;
};

// Nothing is without a way out: at rest and with the cause gone, it clears and drives.
void recover(Scene& scene, Judge& judge) {
    Simulation& sim = scene.sim();
    const auto sample = [&] { judge.sample(false); };
    const auto& supervisor = sim.cycle().supervisor();
    scene.restore();
    sim.host().silence();
    sim.run_for(0.05, sample);
    sim.world().plant().place(sim.world().pose(), {});
    const auto idle = [&] {
        return supervisor.mode() == Mode::idle && supervisor.phase() == supervisor::Phase::steady;
    };
    const double longest_s = 2 * control::braking_time_s(scene.setup().believed) + 1;
    for (int i = 0; i < 30 && !idle(); ++i) {
        if (supervisor.mode() == Mode::fault) {
            sim.world().plant().place(sim.world().pose(), {});  // it may have coasted
            sim.host().clear_fault();
        } else {
            sim.host().mode(Mode::idle);
        }
        // Asked again, a ramp would begin anew.
        sim.run_until(idle, supervisor.mode() == Mode::fault ? 0.1 : longest_s, sample);
    }
    if (!idle()) {
        judge.violate("no way out", "fault " + std::string(protocol::to_string_view(supervisor.fault())) +
                                        ", " + std::string(protocol::to_string_view(supervisor.blocker())));
        return;
    }
    const double wanted = 0.15 * scene.setup().believed.limits.speed_m_per_s;
    sim.host().velocity({wanted, 0});
    const auto there = [&] {
        return supervisor.mode() == Mode::velocity &&
               std::abs(sim.world().twist().v_m_per_s - wanted) < 0.1 * wanted + 0.01;
    };
    for (int i = 0; i < 4; ++i) {
        if (i > 0) {  // cleared too early, or a drive still has its error
            sim.host().clear_fault();
            sim.run_for(0.05, sample);
        }
        sim.host().mode(Mode::velocity);
        if (sim.run_until(there, 2, sample)) return;
    }
    judge.violate("no way out",
                  "does not drive: " + std::string(protocol::to_string_view(supervisor.mode())) + ", " +
                      std::string(protocol::to_string_view(supervisor.fault())) + ", " +
                      std::string(protocol::to_string_view(supervisor.blocker())) +
                      text(", %.3f m/s for %.3f", sim.world().twist().v_m_per_s, wanted));
}

}  // namespace

UntouchedDrive untouched_drive(std::uint64_t seed, TorturedRobots robots, int report_period_ms) {
    UntouchedDrive drive;
    drive.setup = scene_setup(seed, robots, report_period_ms);
    Scene scene(drive.setup);
    if (!scene.drive_off()) {
        drive.problem = scene.problem;
        return drive;
    }
    double fastest = 0;
    scene.sim().run_for(kLatestLie_s, [&] {
        drive.pose.push_back(scene.sim().world().pose());
        drive.fastest_rim_m_per_s.push_back(fastest = std::max(fastest, rim_m_per_s(scene.sim().world())));
    });
    drive.mode_at_end = scene.sim().cycle().supervisor().mode();
    if (drive.mode_at_end == Mode::fault)
        drive.problem =
            "untouched, " + std::string(protocol::to_string_view(scene.sim().cycle().supervisor().fault()));
    return drive;
}

TortureResult torture(const TortureKind& kind, const UntouchedDrive& untouched, const SceneRecords& records) {
    TortureResult result;
    result.kind = kind.name;
    result.seed = untouched.setup.seed;
    result.setup = untouched.setup.text();
    Scene scene(untouched.setup, records);
    Judge judge(scene, kind, result);
    if (!scene.drive_off()) {  // untouched it did
        judge.violate("not repeatable", scene.problem);
        return result;
    }
    Simulation& sim = scene.sim();
    const auto& supervisor = sim.cycle().supervisor();
    scene.begin_harm();
    judge.begin();
    judge.sample(true);
    result.story.push_back("     0.0 ms  " + std::string(kind.what));
    if (kind.inject != nullptr) kind.inject(scene);
    // A ramp takes as long as the robot needs.
    const double lasts_s =
        kind.expect == Expect::rests ? std::max(kind.lasts_s, kind.bound_s(scene) + 0.5) : kind.lasts_s;
    const auto watch = [&] {
        judge.sample(true);
        if (kind.each != nullptr) kind.each(scene);
        const std::size_t i =
            static_cast<std::size_t>(std::max(0.0, std::round(scene.since_s() / kCycle_s) - 1));
        if (i < untouched.pose.size() && supervisor.may_drive()) {
            const Pose<double>& pose = sim.world().pose();
            result.deviation_m = std::max(result.deviation_m, std::hypot(pose.x_m - untouched.pose[i].x_m,
                                                                         pose.y_m - untouched.pose[i].y_m));
        }
    };
    sim.run_for(lasts_s, watch);
    // What is no lie yet may still become one, and then has its time of torque too.
    if (kind.from == From::lie) {
        sim.run_until(
            [&] {
                return !supervisor.may_drive() ||
                       (scene.told_s() && judge.torque_since_told_s() > 2 * kind.bound_s(scene));
            },
            kLatestLie_s - lasts_s, watch);
    }
    const std::size_t watched = static_cast<std::size_t>(std::max(kLongest_s, scene.since_s()) / kCycle_s);
    const double untouched_rim_m_per_s =
        untouched.fastest_rim_m_per_s[std::min(watched, untouched.fastest_rim_m_per_s.size()) - 1];
    result.fault = protocol::to_string_view(supervisor.fault());
    result.stopped = !judge.faults().empty();
    // An identification that has found what is wrong ends by itself.
    const auto& identification = sim.cycle().learning().run();
    if (!result.stopped && kind.from == From::lie && untouched.setup.mode == Mode::ident &&
        identification.state() == ident::IdentState::stopped_by_limit) {
        result.stopped = true;
        result.fault = protocol::to_string_view(identification.cause());
        if (!names(kind.names, result.fault)) judge.violate("name", result.fault);
    }
    result.quicker_m_per_s = judge.rim() - untouched_rim_m_per_s;
    if (kind.bound_s != nullptr) result.bound_s = kind.bound_s(scene);
    const double from_s = kind.from != From::harm ? scene.told_s().value_or(0) : 0;
    const bool untold = kind.from == From::lie && !scene.told_s();
    const double latency_s = untouched.setup.simulation.command_latency_s;
    // An encoder's lie can be seen while torque acts, and does harm while it does.
    const double torque_s =
        kind.from == From::lie ? judge.torque_since_told_s() : judge.last_torque_s() - from_s;
    const double zero_s = kind.from == From::lie ? torque_s : judge.no_torque_s() - from_s;
    if (result.stopped && !untold) result.zero_s = std::max(0.0, zero_s - latency_s);

    for (const Fault fault : judge.faults()) {
        const std::string_view name = protocol::to_string_view(fault);
        // A later fault may take the name of the first: the emergency stop.
        const bool last = fault == judge.faults().back();
        if (last && !names(kind.names, name))
            judge.violate(
                kind.expect == Expect::serves || kind.expect == Expect::rests ? "false trip" : "name",
                std::string(name));
    }
    if (kind.expect == Expect::stops) {
        if (!result.stopped && !untold)
            judge.violate("goes on", "no fault, " + std::string(protocol::to_string_view(supervisor.mode())));
        const double bound_s = result.bound_s + latency_s;
        if (!untold && torque_s > bound_s + 1e-9)
            judge.violate("late", text("torque for %.1f ms, bound %.1f", 1e3 * torque_s, 1e3 * bound_s));
    }
    if (kind.expect == Expect::rests) {
        result.zero_s = std::max(0.0, judge.no_torque_s() - latency_s);
        const double bound_s = result.bound_s + latency_s;
        if (supervisor.mode() != Mode::idle || judge.last_torque_s() > bound_s + 1e-9)
            judge.violate(
                "late", text("torque for %.1f ms, bound %.1f, ", 1e3 * judge.last_torque_s(), 1e3 * bound_s) +
                            std::string(protocol::to_string_view(supervisor.mode())));
    }
    const bool may_stop = kind.expect != Expect::serves;
    if (kind.expect != Expect::obeys && kind.expect != Expect::rests) {
        if (!result.stopped && !may_stop) {
            // A drive that ends by itself, an identification, may end a little earlier or later.
            const bool ended = supervisor.mode() == Mode::idle && untouched.setup.mode == Mode::ident;
            if (supervisor.mode() != untouched.setup.mode && !ended)
                judge.violate("left its mode", std::string(protocol::to_string_view(supervisor.mode())));
        }
        // An identification goes where its estimates lead it.
        if (!result.stopped && kind.expect != Expect::stops && untouched.setup.mode != Mode::ident &&
            result.deviation_m > kind.deviation_m)
            judge.violate("off its way", text("%.3f m", result.deviation_m));
        const double gain = 2 * untouched.setup.believed.limits.torque_Nm * untouched.setup.believed_lie_s();
        const auto& k = untouched.setup.believed.dynamics;
        const double most =
            gain * (k.k7_per_kg_m + k.k8_per_kg_m2 * untouched.setup.believed.geometry.track_m / 2) +
            kRoom * untouched_rim_m_per_s;
        if (result.quicker_m_per_s > most)
            judge.violate("quicker", text("by %.2f m/s, bound %.2f", result.quicker_m_per_s, most));
    }
    if (!kind.ends_firmware) recover(scene, judge);
    sim.bus().catch_up();
    const Pose<double>& pose = sim.world().pose();
    std::uint64_t x = 0;
    std::memcpy(&x, &pose.x_m, 8);
    result.bytes = judge.hash() ^ x;
    return result;
}

}  // namespace wheelwright::tools
