#include "tools/cli/message_text.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <type_traits>

#include "drivers/odrive/odrive_drive.hpp"
#include "firmware/protocol/command_guard.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"
#include "tools/cli/parameter_names.hpp"
#include "tools/logs/candump.hpp"

namespace wheelwright::tools {
namespace {

template <typename Number>
std::string shortest(Number value) {
    std::array<char, 48> digits{};
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    return {digits.data(), end};
}

// A scaled value with the decimals its step has.
std::string scaled_text(double value, double step) {
    if (step <= 0 || step >= 1) return shortest(value);
    int decimals = 0;
    for (double scale = step; decimals < 9 && std::abs(scale - std::round(scale)) > 1e-6; scale *= 10) {
        ++decimals;
    }
    std::array<char, 48> digits{};
    std::snprintf(digits.data(), digits.size(), "%.*f", decimals, value);
    return digits.data();
}

template <typename Field>
std::string value_text(const Field& value, const protocol::FieldInfo& info) {
    if constexpr (std::is_enum_v<Field>) {
        return std::string(to_string_view(value));
    } else if constexpr (std::is_same_v<Field, bool>) {
        return value ? "yes" : "no";
    } else if constexpr (std::is_same_v<Field, float>) {
        return shortest(value);
    } else if constexpr (std::is_floating_point_v<Field>) {
        return scaled_text(value, info.step);
    } else {
        return std::to_string(value);
    }
}

template <typename Message>
void fill(const hal::CanFrame& frame, MessageText& text) {
    text.name = Message::name;
    text.sender = Message::sender;
    const std::span<const std::uint8_t> bytes(frame.data.data(), frame.length);
    if constexpr (Message::sealed) {
        if (bytes.size() == Message::length && bytes[0] != protocol::seal_crc(bytes)) {
            text.error = "wrong_crc";
            return;
        }
    }
    Message message;
    const protocol::CodecStatus status = Message::decode(bytes, message);
    if (status != protocol::CodecStatus::ok) {
        text.error = to_string_view(status);
        return;
    }
    Message::for_each_field(message, [&](const protocol::FieldInfo& info, const auto& value) {
        if (info.name == "crc" || info.name == "alive") return;
        text.fields.push_back({std::string(info.name), value_text(value, info), std::string(info.unit)});
    });
}

}  // namespace

std::optional<MessageText> describe(const hal::CanFrame& frame) {
    if (frame.extended || frame.error || frame.remote || frame.fd) return std::nullopt;
    MessageText text;
    bool found = false;
    protocol::AllMessages::for_each([&]<typename Message>() {
        if (frame.id != Message::id) return;
        found = true;
        fill<Message>(frame, text);
    });
    if (!found) return std::nullopt;
    return text;
}

std::string one_line(const MessageText& message) {
    std::string line = message.name;
    if (!message.error.empty()) return line + "  bad frame: " + message.error;
    for (const FieldText& field : message.fields) {
        line.append("  ").append(field.name).append(" ").append(field.value);
    }
    return line;
}

std::string DriveErrors::text() const {
    std::string text;
    for (const protocol::DriveError& drive : latest_) {
        if (drive.error == 0) continue;
        const auto generation =
            drive.generation == 5 ? drivers::OdriveGeneration::v0_5 : drivers::OdriveGeneration::v0_6;
        std::string names;
        for (std::uint32_t bit = 1; bit != 0; bit <<= 1U) {
            if ((drive.error & bit) == 0) continue;
            names.append(names.empty() ? "" : ", ").append(drivers::odrive_error_name(generation, bit));
        }
        std::array<char, 16> number{};
        std::snprintf(number.data(), number.size(), "0x%X", unsigned{drive.error});
        text.append(text.empty() ? "the " : "; the ").append(to_string_view(drive.wheel));
        text.append(" drive reports ").append(names).append(" (").append(number.data()).append(")");
    }
    return text;
}

std::string advice(const protocol::Status& status, const DriveErrors& errors) {
    using protocol::DriveState;
    const bool left = status.drive_left == DriveState::other_generation;
    if (left || status.drive_right == DriveState::other_generation) {
        return std::string("the ") + (left ? "left" : "right") +
               " drive's frames are not those of the generation in the robot file: check drive.generation";
    }
    if (status.blocker == protocol::Blocker::watchdog_not_confirmed) {
        return "see drive.watchdog_assured and drive.watchdog_endpoint in the robot file, and check "
               "drive.generation";
    }
    if (status.blocker == protocol::Blocker::drive_error || status.fault == protocol::Fault::drive_error) {
        const std::string reported = errors.text();
        return (reported.empty() ? "a drive reports an error" : reported) +
               "; remove the cause, then `wheelwright ctl clear`";
    }
    if (status.blocker == protocol::Blocker::drive_out_of_limits) {
        return "a drive reports a supply or a temperature beyond its limit ([safety] of the robot file): "
               "`wheelwright monitor` shows which";
    }
    const bool silent = status.drive_left == DriveState::silent || status.drive_right == DriveState::silent;
    if (status.fault == protocol::Fault::arming_refused && !silent) {
        return "a drive is heard and does not arm: check its errors, and drive.generation in the robot file";
    }
    return "";
}

std::string pace_sentence(const protocol::TrajectoryPace& pace) {
    using protocol::PaceLimit;
    std::string_view limit;
    switch (pace.limited_by) {
        case PaceLimit::none:
            return "";
        case PaceLimit::speed:
            limit = "limits.speed_m_per_s";
            break;
        case PaceLimit::yaw_rate:
            limit = "limits.yaw_rate_rad_per_s";
            break;
        case PaceLimit::acceleration:
            limit = "limits.acceleration_m_per_s2";
            break;
        case PaceLimit::yaw_acceleration:
            limit = "limits.yaw_acceleration_rad_per_s2";
            break;
        case PaceLimit::torque:
            limit = "limits.torque_Nm";
            break;
    }
    return "the period is " + scaled_text(pace.period_s, 0.01) + " s in place of " +
           scaled_text(pace.asked_period_s, 0.01) + " s, so that " + std::string(limit) +
           " leaves room for feedback";
}

std::string frame_text(const hal::CanFrame& frame) {
    LogFrame entry;
    entry.frame = frame;
    const std::string line = format_candump_line(entry);
    return line.substr(line.rfind(' ') + 1);
}

}  // namespace wheelwright::tools
