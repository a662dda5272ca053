// Cycles of the firmware as a host has recorded them, to be run again on another machine: what each was told,
// and what came of it. Little-endian, with the alignment that x86-64 and Armv7-M share. A file is
//     Beginning, the live parameters, and for each cycle its Told, its Outcome, and the frames it received
#pragma once

#include <array>
#include <cstdint>
#include <type_traits>

#include "firmware/task/black_box.hpp"

namespace wheelwright::m7 {

struct Beginning {
    std::uint64_t magic = kMagic;
    std::uint32_t parameters_bytes = sizeof(model::RobotParameters);
    std::uint32_t cycles = 0;

    static constexpr std::uint64_t kMagic = 0x31'79'61'6C'70'65'72'57;  // "Wreplay1"
};

// A classic frame.
struct Frame {
    std::int64_t time_ns = 0;
    std::uint32_t id = 0;
    std::uint32_t length = 0;
    std::array<std::uint8_t, 8> data{};
};

struct Told {
    task::CycleTime time;
    std::int64_t sending_ns = 0;
    std::uint32_t received = 0;  // frames
    hal::LineLevel stop_line = hal::LineLevel::inactive;
};

struct Outcome {
    WheelPair<double> torque_Nm;  // as the drives' frames carry it
    Twist<double> twist;
    Pose<double> pose;
    double k7_per_kg_m = 0, k8_per_kg_m2 = 0;  // the controllers' model
    std::uint32_t sent = 0;                    // identifiers of the frames sent, mixed
    task::CycleState state;
};

static_assert(std::is_trivially_copyable_v<model::RobotParameters> && sizeof(Beginning) % 8 == 0 &&
              sizeof(model::RobotParameters) % 8 == 0 && sizeof(Frame) == 24 && sizeof(Told) == 48 &&
              sizeof(Outcome) == 88);

// Of a cycle that has run.
inline Outcome outcome_of(const task::Cycle& cycle, const WheelPair<double>& torque_Nm, std::uint32_t sent) {
    const auto& k = cycle.control().plant().dynamics;
    return {torque_Nm,     cycle.observer().motion().twist, cycle.odometry().pose(),
            k.k7_per_kg_m, k.k8_per_kg_m2,                  sent,
            task::CycleState::of(cycle.supervisor())};
}

// What a cycle sends.
class Sent {
  public:
    void note(const hal::CanFrame& frame) {
        ids_ = (ids_ ^ frame.id) * 0x01000193;  // FNV-1a
        if (frame.id >= kHostFrames || (frame.id & 0x1FU) != kSetInputTorque) return;
        float torque_Nm = 0;
        __builtin_memcpy(&torque_Nm, frame.data.data(), sizeof(torque_Nm));
        (torque_frames_++ == 0 ? torque_Nm_.left : torque_Nm_.right) = torque_Nm;
    }
    std::uint32_t ids() const { return ids_; }
    const WheelPair<double>& torque_Nm() const { return torque_Nm_; }  // at the motors; zero: none was sent

  private:
    static constexpr std::uint32_t kSetInputTorque = 0x0E;  // CANSimple
    static constexpr std::uint32_t kHostFrames = 0x600;     // and telemetry
    std::uint32_t ids_ = 0x811C9DC5;
    int torque_frames_ = 0;
    WheelPair<double> torque_Nm_;
};

}  // namespace wheelwright::m7
