// What the host must go on sending, by the kind of set-point that a mode's row names.
#pragma once

#include <cstdint>

#include "firmware/supervisor/modes.hpp"
#include "firmware/task/host_link.hpp"
#include "firmware/task/judge.hpp"

namespace wheelwright::task {

// Calls `look(set-point, its cycle time in ms)`; false where there is none.
template <typename Link, typename Look>
bool with_setpoint(Link& host, supervisor::Setpoint which, Look look) {
    switch (which) {
        case supervisor::Setpoint::torque:
            return look(host.torque_Nm, protocol::TorqueCommand::cycle_time_ms);
        case supervisor::Setpoint::velocity:
            return look(host.velocity, protocol::VelocityCommand::cycle_time_ms);
        case supervisor::Setpoint::goal:
            return look(host.goal, protocol::PoseGoal::cycle_time_ms);
        case supervisor::Setpoint::stream:
            return look(host.streamed, protocol::StreamedPose::cycle_time_ms);
        case supervisor::Setpoint::none:
            break;
    }
    return false;
}

// One that has begun to come has not been repeated for so many of its cycle times.
inline bool late(const HostLink& host, supervisor::Setpoint which, std::int64_t now_ns, double cycles) {
    return with_setpoint(host, which, [&](const auto& setpoint, double cycle_time_ms) {
        return setpoint.received && stale(setpoint.time_ns, now_ns, 1e-3 * cycle_time_ms * cycles);
    });
}

// Nobody is there, with a set-point or without. A limit of 0: nobody need be.
inline bool host_gone(const HostLink& host, std::int64_t now_ns, double limit_s) {
    return limit_s > 0 && stale(host.heard_ns(), now_ns, limit_s);
}

// Between driving modes: what has stopped coming does not act in the next mode, not for one cycle.
inline void forget_late(HostLink& host, std::int64_t now_ns, double cycles) {
    for (const supervisor::ModeRule& mode : supervisor::kModes) {
        if (!late(host, mode.setpoint, now_ns, cycles)) continue;
        with_setpoint(host, mode.setpoint, [](auto& setpoint, double) { return setpoint.received = false; });
    }
}

}  // namespace wheelwright::task
