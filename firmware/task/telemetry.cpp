#include "firmware/task/telemetry.hpp"

#include <algorithm>

#include "firmware/protocol/command_guard.hpp"

namespace wheelwright::task {
namespace {

// Telemetry is better at its limit than missing; only a value that is not finite is left out.
template <typename Message>
bool put(Message message, hal::CanFrame& out) {
    if constexpr (requires { message.saturate(); }) message.saturate();
    out.id = Message::id;
    out.length = Message::length;
    out.extended = out.remote = out.fd = out.bit_rate_switch = out.error = false;
    return message.encode(out.data) == protocol::CodecStatus::ok;
}

float narrow(double value) { return static_cast<float>(value); }

struct Period {
    std::uint32_t id;
    std::uint16_t period_ms;
};

template <typename... Messages>
constexpr std::array<Period, sizeof...(Messages)> periods() {
    return {Period{Messages::id, Messages::cycle_time_ms}...};
}

ReportPart part_of(std::uint32_t id) {
    switch (id) {
        case protocol::Status::id:
            return ReportPart::status;
        case protocol::Counters::id:
            return ReportPart::counters;
        case protocol::EstimateK5K7::id:
        case protocol::EstimateK6K8::id:
        case protocol::StandardErrorK5K7::id:
        case protocol::StandardErrorK6K8::id:
        case protocol::CovarianceK5K7::id:
        case protocol::CovarianceK6K8::id:
            return ReportPart::estimate;
        case protocol::EffectEstimate::id:
        case protocol::EffectStandardError::id:
            return ReportPart::effects;
        case protocol::IdentStatus::id:
            return ReportPart::ident;
        case protocol::IdentSizing::id:
            return ReportPart::ident_sizing;
        case protocol::DriveError::id:
            return ReportPart::drives;
        case protocol::DriveHealth::id:
            return ReportPart::drive_health;
        case protocol::TrajectoryPace::id:
            return ReportPart::pace;
        case protocol::Timing::id:
            return ReportPart::timing;
        case protocol::BusLoad::id:
            return ReportPart::bus_load;
        case protocol::LoopDesign::id:
            return ReportPart::design;
        default:
            return ReportPart::motion;
    }
}

}  // namespace

Telemetry::Telemetry() : slots_{} {
    using namespace protocol;  // NOLINT(google-build-using-namespace): a list of message names
    constexpr auto kPeriods =
        periods<Status, Counters, WheelState, Odometry, BodyState, TrackingError, EstimateK5K7, EstimateK6K8,
                StandardErrorK5K7, StandardErrorK6K8, CovarianceK5K7, CovarianceK6K8, EffectEstimate,
                EffectStandardError, IdentStatus, Timing, BusLoad, LoopDesign, DriveError, TrajectoryPace,
                IdentSizing, DriveHealth>();
    static_assert(kPeriods.size() == kSlots);
    // Spread over the shortest period, so that the frames of one period do not fall due together.
    for (std::size_t i = 0; i < kSlots; ++i) {
        slots_[i] = {kPeriods[i].id, kPeriods[i].period_ms, i, part_of(kPeriods[i].id)};
    }
}

void Telemetry::reply(const protocol::ParameterReply& reply) {
    if (reply_count_ == replies_.size()) {
        ++replies_lost_;
        return;
    }
    replies_[(reply_head_ + reply_count_) % replies_.size()] = reply;
    ++reply_count_;
}

Telemetry::Turn Telemetry::next(std::uint64_t cycle) {
    if (challenge_) return {true, true, protocol::ArmingChallenge::id, {}};
    if (reply_count_ > 0) return {true, true, protocol::ParameterReply::id, {}};
    if (cycle < first_due_) return {};
    Slot* latest = &slots_[0];
    std::uint64_t second_due = ~std::uint64_t{0};
    for (std::size_t i = 1; i < kSlots; ++i) {
        if (slots_[i].due < latest->due) {
            second_due = latest->due;
            latest = &slots_[i];
        } else if (slots_[i].due < second_due) {
            second_due = slots_[i].due;
        }
    }
    if (cycle - latest->due > latest->period_cycles) {
        ++deferred_;
        latest->due = cycle;
    }
    latest->due += latest->period_cycles;
    first_due_ = std::min(latest->due, second_due);
    return {true, false, latest->id, latest->part};
}

bool Telemetry::build(const Turn& turn, const CycleReport& report, Frame& out) {
    if (!turn.due) return false;
    if (!turn.reply) return build_message(turn.id, report, out);
    if (turn.id == protocol::ArmingChallenge::id) {
        const protocol::ArmingChallenge challenge = *challenge_;
        challenge_.reset();
        return put(challenge, out);
    }
    const protocol::ParameterReply reply = replies_[reply_head_];
    reply_head_ = (reply_head_ + 1) % replies_.size();
    --reply_count_;
    return put(reply, out);
}

bool Telemetry::build_message(std::uint32_t id, const CycleReport& r, Frame& out) {
    switch (id) {
        case protocol::Status::id: {
            protocol::Status status = r.status;
            status.alive = alive_;
            alive_ = protocol::next_alive(alive_);
            return put(status, out);
        }
        case protocol::Counters::id: {
            protocol::Counters counters;
            counters.cause = static_cast<protocol::CounterCause>(counter_turn_);
            counters.value = r.counters[counter_turn_];
            counter_turn_ = (counter_turn_ + 1) % r.counters.size();
            return put(counters, out);
        }
        case protocol::WheelState::id: {
            protocol::WheelState wheels;
            wheels.left_speed_rad_per_s = r.wheel_speed_rad_per_s.left;
            wheels.right_speed_rad_per_s = r.wheel_speed_rad_per_s.right;
            wheels.left_torque_Nm = r.torque_Nm.left;
            wheels.right_torque_Nm = r.torque_Nm.right;
            return put(wheels, out);
        }
        case protocol::Odometry::id: {
            protocol::Odometry odometry;
            odometry.x_m = r.pose.x_m;
            odometry.y_m = r.pose.y_m;
            odometry.heading_rad = wrap_angle_rad(r.pose.heading_rad);
            return put(odometry, out);
        }
        case protocol::BodyState::id: {
            protocol::BodyState body;
            body.forward_speed_m_per_s = r.twist.v_m_per_s;
            body.yaw_rate_rad_per_s = r.twist.omega_rad_per_s;
            body.reference_forward_speed_m_per_s = r.reference.v_m_per_s;
            body.reference_yaw_rate_rad_per_s = r.reference.omega_rad_per_s;
            return put(body, out);
        }
        case protocol::TrackingError::id: {
            protocol::TrackingError error;
            error.along_m = r.tracking_error.x_m;
            error.across_m = r.tracking_error.y_m;
            error.heading_rad = wrap_angle_rad(r.tracking_error.heading_rad);
            return put(error, out);
        }
        case protocol::EstimateK5K7::id: {
            protocol::EstimateK5K7 message;
            message.k5_m = narrow(r.estimate.k5_m);
            message.k7_per_kg_m = narrow(r.estimate.k7_per_kg_m);
            return put(message, out);
        }
        case protocol::EstimateK6K8::id: {
            protocol::EstimateK6K8 message;
            message.k6_per_m = narrow(r.estimate.k6_per_m);
            message.k8_per_kg_m2 = narrow(r.estimate.k8_per_kg_m2);
            return put(message, out);
        }
        case protocol::StandardErrorK5K7::id: {
            protocol::StandardErrorK5K7 message;
            message.k5_m = narrow(r.standard_error.k5_m);
            message.k7_per_kg_m = narrow(r.standard_error.k7_per_kg_m);
            return put(message, out);
        }
        case protocol::StandardErrorK6K8::id: {
            protocol::StandardErrorK6K8 message;
            message.k6_per_m = narrow(r.standard_error.k6_per_m);
            message.k8_per_kg_m2 = narrow(r.standard_error.k8_per_kg_m2);
            return put(message, out);
        }
        case protocol::CovarianceK5K7::id: {
            protocol::CovarianceK5K7 message;
            message.k5_s4_per_rad4 = narrow(r.covariance.k5_m);
            message.k7_per_Nm2 = narrow(r.covariance.k7_per_kg_m);
            return put(message, out);
        }
        case protocol::CovarianceK6K8::id: {
            protocol::CovarianceK6K8 message;
            message.k6_s4_per_m2_rad2 = narrow(r.covariance.k6_per_m);
            message.k8_per_Nm2 = narrow(r.covariance.k8_per_kg_m2);
            return put(message, out);
        }
        case protocol::EffectEstimate::id: {
            if (r.effect_count == 0) return false;
            const EffectReport& effect = r.effects[effect_turn_ % r.effect_count];
            effect_turn_ = (effect_turn_ + 1) % r.effect_count;
            protocol::EffectEstimate message;
            message.index = effect.index;
            message.value = narrow(effect.value);
            return put(message, out);
        }
        case protocol::EffectStandardError::id: {
            if (r.effect_count == 0) return false;
            const EffectReport& effect = r.effects[effect_error_turn_ % r.effect_count];
            effect_error_turn_ = (effect_error_turn_ + 1) % r.effect_count;
            protocol::EffectStandardError message;
            message.index = effect.index;
            message.value = narrow(effect.standard_error);
            return put(message, out);
        }
        case protocol::IdentStatus::id:
            return put(r.ident, out);
        case protocol::Timing::id:
            return put(r.timing, out);
        case protocol::BusLoad::id:
            return put(r.bus_load, out);
        case protocol::LoopDesign::id:
            return put(r.design, out);
        case protocol::DriveError::id: {
            protocol::DriveError error;
            error.wheel = static_cast<protocol::Wheel>(drive_turn_);
            error.generation = r.drive_generation;
            error.error = r.drive_error_bits[drive_turn_];
            drive_turn_ = 1 - drive_turn_;
            return put(error, out);
        }
        case protocol::DriveHealth::id:
            if (!r.drive_health_told) return false;
            health_turn_ = 1 - health_turn_;
            return put(r.drive_health[1 - health_turn_], out);
        case protocol::TrajectoryPace::id:
            return r.pace_known && put(r.pace, out);
        case protocol::IdentSizing::id: {
            if (r.ident.phase == protocol::IdentPhase::off) return false;
            protocol::IdentSizing sizing;
            sizing.quantity = static_cast<protocol::IdentQuantity>(quantity_turn_);
            sizing.value = narrow(r.ident_quantities[quantity_turn_]);
            quantity_turn_ = (quantity_turn_ + 1) % r.ident_quantities.size();
            return put(sizing, out);
        }
        default:
            return false;
    }
}

}  // namespace wheelwright::task
