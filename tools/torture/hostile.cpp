#include "tools/torture/hostile.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <set>

#include "tools/sim/experiments.hpp"
#include "tools/torture/scene.hpp"

namespace wheelwright::tools {
namespace {

using protocol::Fault;
using protocol::Mode;

constexpr std::uint64_t kHostileStream = 0x73;
// Beside the robot's own frames there is room for so many in a millisecond at 1 Mbit/s.
constexpr std::uint64_t kDriveBusFrames = 2, kHostBusFrames = 6;
constexpr std::uint64_t kFramesAtATime = 1000;
constexpr double kSpeedShare = 0.2;  // of the limit, while driving
constexpr double kGrace_s = 0.003;
// What a foreign host can do with a drive before it is told to be idle; as ChainTrust has it.
constexpr double kForeignSpeed_m_per_s = 0.3;
// The true names of what such frames are.
constexpr std::array kStated{
    Fault::emergency_stop_message, Fault::foreign_control, Fault::drive_error,
    Fault::drive_left_armed_state, Fault::drive_silent,    Fault::stale_feedback,
    Fault::encoder_implausible,    Fault::over_speed,      Fault::arming_refused,
    Fault::stale_command,          Fault::bus_down,        Fault::drive_voltage_out_of_range,
    Fault::drive_overheated};

class Hostility {
  public:
    Hostility(HostilePlan plan, std::uint64_t seed, std::uint64_t part, HostileResult& result)
        : result_(result),
          harmless_(plan == HostilePlan::idle_harmless || plan == HostilePlan::driving_harmless),
          drives_(plan == HostilePlan::driving_harmless || plan == HostilePlan::driving_all),
          setup_(five(seed)),
          scene_(setup_),
          random_(seed, kHostileStream + 256 * part),
          valid_before_(result.valid_commands) {
        result.plan = plan;
        result.setup = setup_.text();
    }

    void run(std::uint64_t frames) {
        Simulation& sim = scene_.sim();
        sim.run_for(0.5);
        wanted_m_per_s_ = kSpeedShare * setup_.believed.limits.speed_m_per_s;
        if (drives_ && !set_off()) {
            violate("does not drive", "before any hostile frame");
            return;
        }
        for (const model::ParameterInfo& info : model::parameter_table())
            parameters_.push_back(info.get(sim.parameters()));
        std::int64_t ms = 0;
        const std::uint64_t end = result_.frames + frames;
        while (result_.frames < end) {
            be_hostile();
            sim.step();
            judge();
            if (++ms % 100 == 0 && !harmless_) keep_going();
        }
        calm_down();
        check_parameters();
    }

  private:
    // Of the default robots the velocity ones; layout and generation from the seed.
    static SceneSetup five(std::uint64_t seed) {
        return scene_setup(1 + 5 * (seed % 4), TorturedRobots::standard);
    }

    void violate(const std::string& rule, const std::string& what) {
        if (broken_.insert(rule).second) ++result_.broken[rule];
        for (const std::string& known : result_.violations) {
            if (known.starts_with(rule + ":")) return;
        }
        result_.violations.push_back(rule + ": " + what);
    }

    bool set_off() {
        scene_.sim().host().velocity({wanted_m_per_s_, 0});
        const bool entered = enter_mode(scene_.sim(), Mode::velocity);
        scene_.sim().run_for(0.5);
        return entered;
    }

    hal::CanFrame any_frame() {
        hal::CanFrame frame;
        const std::uint64_t how = random_.bits();
        frame.id = static_cast<std::uint32_t>(random_.bits() % 0x800U);
        frame.length = static_cast<std::uint8_t>(random_.bits() % 9);
        const std::uint64_t bytes = random_.bits();
        for (std::size_t i = 0; i < 8; ++i) frame.data[i] = static_cast<std::uint8_t>(bytes >> (8 * i));
        if (how % 4 == 0) {  // small numbers, which mean something more often
            for (std::size_t i = 0; i < 8; ++i) frame.data[i] = i % 4 == 0 ? frame.data[i] % 16 : 0;
        }
        if (how / 4 % 10 == 0) {
            frame.remote = true;
        } else if (how / 4 % 10 == 1) {
            frame.extended = true;
            if (how / 64 % 2 == 0) frame.id = static_cast<std::uint32_t>(random_.bits() % 0x2000'0000U);
        }
        return frame;
    }

    // Another firmware's Status is a second firmware.
    bool acts(const hal::CanFrame& frame) const {
        if (frame.extended) return false;
        if (frame.id == protocol::Status::id && !frame.remote) return true;
        const std::uint32_t node = frame.id >> 5U;
        return node == scene_.node(0) || node == scene_.node(1) ||
               (frame.id == protocol::EmergencyStop::id && !frame.remote);
    }

    // By chance; its sender then is a host like any other.
    static bool is_valid_command(const hal::CanFrame& frame) {
        if (frame.extended || frame.remote) return false;
        for (const protocol::MessageInfo& message : protocol::all_messages) {
            if (!message.sealed || message.id != frame.id || message.length != frame.length) continue;
            return frame.data[0] == protocol::seal_crc({frame.data.data(), frame.length});
        }
        return false;
    }

    void send(hal::CanBus& bus, std::uint64_t most) {
        for (std::uint64_t i = 0; i < most; ++i) {
            const hal::CanFrame frame = any_frame();
            if (harmless_ && acts(frame)) continue;
            if (bus.send(frame) != hal::CanStatus::ok) return;
            ++result_.frames;
            if (is_valid_command(frame)) ++result_.valid_commands;
        }
    }

    void be_hostile() {
        Simulation& sim = scene_.sim();
        send(sim.bus().endpoint(3), kDriveBusFrames);
        if (setup_.separate_host_bus) send(sim.host_bus(), kHostBusFrames);
        if (random_.bits() % 64 == 0) {
            sim.bus().inject_error_frame(1U << random_.bits() % 9);
            ++result_.frames;
        }
    }

    void judge() {
        Simulation& sim = scene_.sim();
        const auto& supervisor = sim.cycle().supervisor();
        const auto& p = setup_.believed;
        sim::World& world = sim.world();
        const double torque_Nm =
            std::max(std::abs(world.left().torque_target_Nm()), std::abs(world.right().torque_target_Nm()));
        const double v = world.twist().v_m_per_s;
        const double omega = world.twist().omega_rad_per_s;
        const auto& radius = world.plant().actual().geometry.wheel_radius_m;
        const auto& wheel = world.plant().wheel_speed_rad_per_s();
        const double rim = std::max(std::abs(radius.left * wheel.left), std::abs(radius.right * wheel.right));
        result_.fastest_rim_m_per_s = std::max(result_.fastest_rim_m_per_s, rim);
        if (supervisor.fault() != fault_) {
            fault_ = supervisor.fault();
            if (fault_ != Fault::none) {
                ++result_.faults[std::string(protocol::to_string_view(fault_))];
                if (std::find(kStated.begin(), kStated.end(), fault_) == kStated.end())
                    violate("name", std::string(protocol::to_string_view(fault_)));
            }
        }
        const bool driven = supervisor.may_drive() || supervisor.ramping();
        undriven_s_ = driven ? 0 : undriven_s_ + task::kCyclePeriod_s;
        const bool reached = result_.valid_commands > valid_before_;  // from then on the mode is anybody's
        if (harmless_ && !reached) {
            const Mode mode = drives_ ? Mode::velocity : Mode::idle;
            if (supervisor.mode() != mode)
                violate("mode", std::string(protocol::to_string_view(supervisor.mode())) + ", " +
                                    std::string(protocol::to_string_view(supervisor.fault())));
            const double wanted = drives_ ? wanted_m_per_s_ : 0;
            if (!(std::abs(v - wanted) <= 0.05 * wanted + 1e-9)) violate("speed", std::to_string(v) + " m/s");
            if (!drives_ && torque_Nm > 0) violate("torque at rest", std::to_string(torque_Nm) + " Nm");
        }
        if (!harmless_ && undriven_s_ > kGrace_s && torque_Nm > 0) {
            foreign_s_ += task::kCyclePeriod_s;
            if (foreign_s_ > kGrace_s + 0.003)  // armed from outside until it is told to be idle
                violate("torque at rest", std::to_string(torque_Nm) + " Nm");
        } else {
            foreign_s_ = 0;
        }
        if (!(std::abs(v) <= 1.05 * p.safety.over_speed_m_per_s &&
              std::abs(omega) <= 1.05 * p.safety.over_yaw_rate_rad_per_s))
            violate("too fast", std::to_string(v) + " m/s, " + std::to_string(omega) + " rad/s");
        if (!reached && rim > kForeignSpeed_m_per_s + (drives_ ? wanted_m_per_s_ : 0))
            violate("quicker", std::to_string(rim) + " m/s at a rim");
        if (sim.mailbox().take() != nullptr) {
            if (!reached) violate("saved", "the robot file");
            sim.mailbox().finished(true);
        }
    }

    // The robot is used on, between the faults.
    void keep_going() {
        Simulation& sim = scene_.sim();
        const auto& supervisor = sim.cycle().supervisor();
        if (supervisor.mode() == Mode::fault) {
            sim.world().plant().place({}, {});
            sim.host().clear_fault();
        } else if (drives_ && supervisor.mode() != Mode::velocity) {
            sim.host().velocity({wanted_m_per_s_, 0});
            sim.host().mode(Mode::velocity);
        }
    }

    // Silence at last: it must drive as before.
    void calm_down() {
        Simulation& sim = scene_.sim();
        const auto& supervisor = sim.cycle().supervisor();
        sim.host().silence();
        sim.run_for(0.5);
        sim.world().plant().place({}, {});
        sim.run_for(0.3);
        for (int i = 0; i < 30 && supervisor.mode() != Mode::idle; ++i) {
            if (supervisor.mode() == Mode::fault) {
                sim.host().clear_fault();
            } else {
                sim.host().mode(Mode::idle);
            }
            sim.run_for(0.1);
        }
        sim.host().clear_fault();  // in idle: the drives' errors
        sim.run_for(0.2);
        if (!set_off() && !set_off())
            violate("no way out", std::string(protocol::to_string_view(supervisor.mode())) + ", " +
                                      std::string(protocol::to_string_view(supervisor.fault())) + ", " +
                                      std::string(protocol::to_string_view(supervisor.blocker())) +
                                      ", drives " +
                                      std::to_string(int(sim.cycle().report().status.drive_left)) + " " +
                                      std::to_string(int(sim.cycle().report().status.drive_right)));
    }

    void check_parameters() {
        if (result_.valid_commands > valid_before_) return;
        std::size_t i = 0;
        for (const model::ParameterInfo& info : model::parameter_table()) {
            if (info.get(scene_.sim().parameters()) != parameters_[i++])
                violate("parameter", std::string(info.key));
        }
    }

    HostileResult& result_;
    bool harmless_, drives_;
    SceneSetup setup_;
    Scene scene_;
    sim::Random random_;
    std::uint64_t valid_before_;
    double wanted_m_per_s_ = 0;
    double undriven_s_ = 0;
    double foreign_s_ = 0;
    std::set<std::string> broken_;
    Fault fault_ = Fault::none;
    std::vector<double> parameters_;
};

}  // namespace

HostileResult be_hostile(HostilePlan plan, std::uint64_t seed, std::uint64_t frames) {
    HostileResult result;
    const bool all = plan == HostilePlan::idle_all || plan == HostilePlan::driving_all;
    for (std::uint64_t part = 0; result.frames < frames; ++part) {
        const std::uint64_t left = frames - result.frames;
        Hostility(plan, seed, part, result).run(all ? std::min<std::uint64_t>(left, kFramesAtATime) : left);
    }
    return result;
}

std::uint64_t resident_bytes() {
    std::FILE* file = std::fopen("/proc/self/statm", "r");
    if (file == nullptr) return 0;
    unsigned long long all = 0;
    unsigned long long resident = 0;
    const int read = std::fscanf(file, "%llu %llu", &all, &resident);
    std::fclose(file);
    return read == 2 ? resident * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE)) : 0;
}

}  // namespace wheelwright::tools
