// Cycles of the firmware as a host has recorded them, to be run again on another machine: what each was told,
// and what came of it. Little-endian, with the alignment that x86-64 and Armv7-M share. A file is
//     Beginning, the live parameters, and for each cycle its Told, its Outcome, and the frames it received
// Beside it lies what was sent, by record and by replay: frames, with the scheduled time of the cycle that
// sent each.
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
    WheelPair<double> torque_Nm;
    Twist<double> twist;
    Pose<double> pose;
    double k7_per_kg_m = 0, k8_per_kg_m2 = 0;  // the controllers' model
    task::CycleState state;
};

static_assert(std::is_trivially_copyable_v<model::RobotParameters> && sizeof(Beginning) % 8 == 0 &&
              sizeof(model::RobotParameters) % 8 == 0 && sizeof(Frame) == 24 && sizeof(Told) == 48 &&
              sizeof(Outcome) == 80);

// Of a cycle that has thought and not yet sent, but for its state.
inline Outcome outcome_of(const task::Cycle& cycle) {
    const auto& k = cycle.control().plant().dynamics;
    Outcome outcome;
    outcome.torque_Nm = cycle.output().torque_Nm;
    outcome.twist = cycle.observer().motion().twist;
    outcome.pose = cycle.odometry().pose();
    outcome.k7_per_kg_m = k.k7_per_kg_m;
    outcome.k8_per_kg_m2 = k.k8_per_kg_m2;
    return outcome;
}

inline Frame frame_of(const hal::CanFrame& from, std::int64_t time_ns) {
    Frame frame;
    frame.time_ns = time_ns;
    frame.id = from.id;
    frame.length = from.length;
    for (std::size_t i = 0; i < frame.length && i < frame.data.size(); ++i) frame.data[i] = from.data[i];
    return frame;
}

}  // namespace wheelwright::m7
