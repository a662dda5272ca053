// The scenes of the trust tests: a robot that has been identified, in every layout of the buses, and frames
// that do not come from its firmware, its drives or its host.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <string>

#include "tests/chain/robots.hpp"
//
#include <CppUTest/TestHarness.h>

namespace chain {

using namespace wheelwright;
using namespace wheelwright::tools;
using protocol::Fault;
using protocol::Mode;

inline constexpr std::uint32_t kEncoderEstimates = 0x09;
inline constexpr std::uint32_t kSetAxisState = 0x07;
inline constexpr std::uint32_t kSetControllerMode = 0x0B;
inline constexpr std::uint32_t kSetInputTorque = 0x0E;
inline constexpr std::size_t kForeignControl = 16;  // of the value table CounterCause

struct Layout {
    bool separate;     // the host has a bus of its own
    std::size_t side;  // 0 left, 1 right
    double way;        // 1 or -1

    std::string name() const {
        return std::string(separate ? "host bus" : "shared bus") + (side == 0 ? ", left" : ", right") +
               (way > 0 ? ", forward" : ", backward");
    }
};

inline void for_each_layout(const std::function<void(const Layout&)>& visit) {
    for (const bool separate : {false, true}) {
        for (const std::size_t side : {0U, 1U}) {
            for (const double way : {1.0, -1.0}) visit({separate, side, way});
        }
    }
}

// A robot at rest that has been identified.
class Scene {
  public:
    explicit Scene(const Layout& layout, std::uint64_t seed = 31,
                   const model::RobotParameters& believed = identified(),
                   const model::RobotParameters& truth = real().parameters)
        : sim(believed, truth, options(layout, seed)) {
        sim.run_for(0.5);
    }

    static SimulationOptions options(const Layout& layout, std::uint64_t seed) {
        SimulationOptions o = chain::options(seed);
        o.separate_host_bus = layout.separate;
        o.emergency_stop_line = true;
        o.drive_enable_line = true;
        o.world.phase_ns = {100'000, 150'000};  // a foreign frame then is the last one of its cycle
        return o;
    }

    void cruise(double speed_m_per_s) {
        sim.host().velocity({speed_m_per_s, 0});
        CHECK(enter_mode(sim, Mode::velocity));
        sim.run_for(0.6);
        CHECK(std::abs(true_speed() - speed_m_per_s) < 0.03);
    }

    // A frame on the drives' bus that neither firmware, drive nor host sends.
    void foreign(const hal::CanFrame& frame) { sim.bus().endpoint(2).send(frame); }

    double true_speed() const { return world().twist().v_m_per_s; }
    double rim_speed() const {
        const auto& radius = real().parameters.geometry.wheel_radius_m;
        const auto& speed = world().plant().wheel_speed_rad_per_s();
        return std::max(std::abs(radius.left * speed.left), std::abs(radius.right * speed.right));
    }
    // What the drives' motors are told, at the wheels.
    double true_torque_Nm() {
        return std::max(std::abs(sim.world().left().torque_target_Nm()),
                        std::abs(sim.world().right().torque_target_Nm()));
    }
    const sim::World& world() const { return const_cast<Simulation&>(sim).world(); }
    Fault fault() const { return sim.cycle().supervisor().fault(); }

    // Runs on; the largest true torque and rim speed.
    struct Worst {
        double torque_Nm = 0, rim_m_per_s = 0;
        double last_torque_s = 0;  // when a torque was last seen, from the start of the run
    };
    Worst run(double duration_s, const std::function<void()>& each = {}) {
        Worst worst;
        const double start_s = sim.time_s();
        sim.run_for(duration_s, [&] {
            worst.torque_Nm = std::max(worst.torque_Nm, true_torque_Nm());
            worst.rim_m_per_s = std::max(worst.rim_m_per_s, rim_speed());
            if (true_torque_Nm() > 0) worst.last_torque_s = sim.time_s() - start_s;
            if (each) each();
        });
        return worst;
    }

    Simulation sim;
};

inline hal::CanFrame encoder_frame(std::size_t side, float position_rev, float speed_rev_per_s) {
    const auto& drive = real().parameters.drive;
    hal::CanFrame frame;
    frame.id =
        static_cast<std::uint32_t>(side == 0 ? drive.left.node : drive.right.node) << 5U | kEncoderEstimates;
    frame.length = 8;
    std::memcpy(frame.data.data(), &position_rev, 4);
    std::memcpy(frame.data.data() + 4, &speed_rev_per_s, 4);
    return frame;
}

inline hal::CanFrame drive_frame(std::size_t side, std::uint32_t command, std::uint32_t first,
                                 std::uint32_t second = 0) {
    hal::CanFrame frame = encoder_frame(side, 0, 0);
    frame.id = (frame.id & ~0x1FU) | command;
    frame.length = command == kSetAxisState ? 4 : 8;
    std::memcpy(frame.data.data(), &first, 4);
    std::memcpy(frame.data.data() + 4, &second, 4);
    return frame;
}

inline std::uint32_t bits_of(float value) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, &value, 4);
    return bits;
}

}  // namespace chain
