// The host's side of the bus: takes command frames apart, guards them, and keeps the latest of each kind with
// its time. What is wrong with a frame is counted by cause, and the frame then changes nothing.
//
// Threads: the cycle's. No call allocates, blocks or throws.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "firmware/model/robot_parameters.hpp"
#include "firmware/model/types.hpp"
#include "firmware/protocol/command_guard.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"
#include "firmware/supervisor/modes.hpp"
#include "hal/can_bus.hpp"

namespace wheelwright::task {

// A set-point with the time its frame was received; never received: `received` is false.
template <typename T>
struct Setpoint {
    T value{};
    std::int64_t time_ns = 0;
    bool received = false;

    void put(const T& fresh, std::int64_t now_ns) {
        value = fresh;
        time_ns = now_ns;
        received = true;
    }
};

struct StreamedReference {
    Pose<Real> pose;
    Twist<Real> twist;
};

struct PoseGoal {
    Pose<Real> pose;
    model::GoalDirection direction = model::GoalDirection::forward;
};

// What arrived since the last cycle, once each. The rest of HostLink is the latest state.
struct HostEvents {
    std::optional<supervisor::Mode> mode;
    std::optional<protocol::ArmingAnswer> answer;  // the first: a later one finds no challenge
    std::optional<protocol::TrajectoryCommand> trajectory;
    std::optional<protocol::IdentSettings> ident;
    bool clear_fault = false;
    bool stop = false;
    bool external_pose = false;  // a new value stands in HostLink::external_pose
    std::array<protocol::ParameterRequest, 8> parameters;
    std::size_t parameter_count = 0;
};

class HostLink {
  public:
    using Cause = protocol::CounterCause;

    // Offers one received frame; true when its identifier is one of the firmware's commands.
    bool accept(const hal::ReceivedFrame& received);

    // What is heard wherever it comes from; true when the frame is one of these: a stop, and the Status of
    // another firmware (counted as foreign_control), as nobody receives what he sends himself.
    bool accept_anywhere(const hal::CanFrame& frame);

    // Forgets the events of the cycle before.
    void begin_cycle() { events_ = {}; }

    const HostEvents& events() const { return events_; }

    // When the last frame of the host came that was accepted; 0: none yet. A pose does not count: a camera
    // may send it that knows nothing of the host.
    std::int64_t heard_ns() const { return heard_ns_; }

    Setpoint<WheelPair<Real>> torque_Nm;
    Setpoint<Twist<Real>> velocity;
    Setpoint<PoseGoal> goal;
    Setpoint<StreamedReference> streamed;
    Setpoint<Pose<Real>> external_pose;

    // A mode's set-points begin anew when the mode is entered: what came before does not count.
    void forget_setpoints();

    void count(Cause cause, std::uint32_t amount = 1) { counters_[std::size_t(cause)] += amount; }
    std::uint32_t counter(Cause cause) const { return counters_[std::size_t(cause)]; }

  private:
    template <typename Message>
    bool take(const hal::ReceivedFrame& received, Message& out);

    HostEvents events_;
    std::int64_t heard_ns_ = 0;
    std::array<std::uint32_t, protocol::counter_cause_values.size()> counters_{};
    protocol::CommandGuard guard_;
    // A streamed pose waits for the velocities with the same alive counter.
    Pose<Real> half_pose_{};
    static constexpr std::uint8_t kNoHalf = 15;
    std::uint8_t half_alive_ = kNoHalf;
};

}  // namespace wheelwright::task
