#include "firmware/task/host_link.hpp"

#include <span>

namespace wheelwright::task {
namespace {

Pose<Real> pose_of(const auto& message) {
    return Pose<Real>(Pose<double>{message.x_m, message.y_m, message.heading_rad});
}
Twist<Real> twist_of(const auto& message) {
    return Twist<Real>(Twist<double>{message.forward_speed_m_per_s, message.yaw_rate_rad_per_s});
}

}  // namespace

// Guards and decodes; counts what is wrong.
template <typename Message>
bool HostLink::take(const hal::ReceivedFrame& received, Message& out) {
    const std::span<const std::uint8_t> bytes(received.frame.data.data(), received.frame.length);
    if (const auto cause = guard_.check(received.frame.id, bytes, received.timestamp_ns)) {
        count(*cause);
        return false;
    }
    const protocol::CodecStatus status = Message::decode(bytes, out);
    if (status == protocol::CodecStatus::ok) {
        if (Message::id != protocol::ExternalPose::id) heard_ns_ = received.timestamp_ns;
        return true;
    }
    count(protocol::rejection_cause(status, received.frame.id));
    return false;
}

bool HostLink::accept_anywhere(const hal::CanFrame& frame) {
    if (frame.extended || frame.remote || frame.error) return false;
    switch (frame.id) {
        case protocol::EmergencyStop::id:
            events_.stop = true;  // whatever its length: nothing may talk us out of a stop
            return true;
        case protocol::Status::id:
            count(Cause::foreign_control);
            return true;
        default:
            return false;
    }
}

bool HostLink::accept(const hal::ReceivedFrame& received) {
    const hal::CanFrame& frame = received.frame;
    if (frame.extended || frame.remote || frame.error) return false;
    const std::int64_t time_ns = received.timestamp_ns;
    switch (frame.id) {
        case protocol::ModeCommand::id: {
            protocol::ModeCommand command;
            if (take(received, command)) events_.mode = command.mode;
            return true;
        }
        case protocol::TorqueCommand::id: {
            protocol::TorqueCommand command;
            if (take(received, command)) {
                torque_Nm.put({Real(command.left_torque_Nm), Real(command.right_torque_Nm)}, time_ns);
            }
            return true;
        }
        case protocol::VelocityCommand::id: {
            protocol::VelocityCommand command;
            if (take(received, command)) {
                velocity.put(twist_of(command), time_ns);
            }
            return true;
        }
        case protocol::PoseGoal::id: {
            protocol::PoseGoal command;
            if (take(received, command)) {
                goal.put({pose_of(command), static_cast<model::GoalDirection>(command.direction)}, time_ns);
            }
            return true;
        }
        case protocol::StreamedPose::id: {
            protocol::StreamedPose command;
            if (take(received, command)) {
                if (half_alive_ != kNoHalf) count(Cause::rejected_unpaired);
                half_pose_ = pose_of(command);
                half_alive_ = command.alive;
            }
            return true;
        }
        case protocol::StreamedVelocity::id: {
            protocol::StreamedVelocity command;
            if (take(received, command)) {
                if (half_alive_ == command.alive) {
                    streamed.put({half_pose_, twist_of(command)}, time_ns);
                } else {
                    count(Cause::rejected_unpaired);
                }
                half_alive_ = kNoHalf;
            }
            return true;
        }
        case protocol::ExternalPose::id: {
            protocol::ExternalPose command;
            if (take(received, command)) {
                external_pose.put(pose_of(command), time_ns);
                events_.external_pose = true;
            }
            return true;
        }
        case protocol::TrajectoryCommand::id: {
            protocol::TrajectoryCommand command;
            if (take(received, command)) events_.trajectory = command;
            return true;
        }
        case protocol::IdentSettings::id: {
            protocol::IdentSettings command;
            if (take(received, command)) events_.ident = command;
            return true;
        }
        case protocol::ParameterRequest::id: {
            protocol::ParameterRequest command;
            if (take(received, command)) {
                if (events_.parameter_count < events_.parameters.size()) {
                    events_.parameters[events_.parameter_count++] = command;
                } else {
                    count(Cause::receive_overflow);
                }
            }
            return true;
        }
        case protocol::ClearFault::id: {
            protocol::ClearFault command;
            if (take(received, command)) events_.clear_fault = true;
            return true;
        }
        case protocol::ArmingAnswer::id: {
            protocol::ArmingAnswer answer;
            if (!take(received, answer)) return true;
            if (events_.answer) {
                count(Cause::rejected_answer);
            } else {
                events_.answer = answer;
            }
            return true;
        }
        case protocol::HostAlive::id: {
            protocol::HostAlive sign;
            take(received, sign);
            return true;
        }
        default:
            return accept_anywhere(frame);
    }
}

void HostLink::forget_setpoints() {
    torque_Nm.received = false;
    velocity.received = false;
    goal.received = false;
    streamed.received = false;
}

}  // namespace wheelwright::task
